// ResizeObserver and IntersectionObserver that report after the frames' callbacks, in virtual time;
// the browser's own report whenever it draws the window.
{
  const resizes = new Set(); // observers with targets
  const intersections = new Set();
  const like = (kind, members) => Object.defineProperties(Object.create(kind.prototype),
    Object.fromEntries(map(Object.entries(members), ({ 0: name, 1: value }) => [name, { value, enumerable: true }])));
  const checked = (callback) => {
    if (typeof callback === 'function') return callback;
    throw new TypeError('parameter 1 is not a function');
  };
  // A class of observers that are in a set while they have targets.
  const observer = (active) => class {
    constructor(callback) {
      this._callback = checked(callback);
      this._targets = new Map(); // element -> what was reported last
    }
    _observe(target, last) {
      if (!(target instanceof Element)) throw new TypeError('parameter 1 is not an Element');
      this._targets.set(target, last);
      active.add(this);
    }
    unobserve(target) {
      this._targets.delete(target);
      if (this._targets.size === 0) active.delete(this);
    }
    disconnect() {
      this._targets.clear();
      active.delete(this);
    }
    _report() {
      const entries = [];
      this._targets.forEach((last, target) => {
        const entry = this._entry(target, last);
        if (entry) push(entries, entry);
      });
      if (entries.length) sim.call((...args) => Reflect.apply(this._callback, this, args), entries, this);
    }
  };
  const { ResizeObserverEntry, ResizeObserverSize, IntersectionObserverEntry } = window;

  // CSS pixels of an element's boxes; an inline one has none.
  const boxesOf = (target) => {
    const drawn = target instanceof SVGGraphicsElement && !(target instanceof SVGSVGElement);
    if (drawn) {
      const { width, height } = target.getBBox();
      return { content: [width, height], border: [width, height], at: [0, 0] };
    }
    const style = getComputedStyle(target);
    const px = (...names) => names.reduce((sum, name) => sum + (parseFloat(style[name]) || 0), 0);
    const extra = [
      px('paddingLeft', 'paddingRight', 'borderLeftWidth', 'borderRightWidth'),
      px('paddingTop', 'paddingBottom', 'borderTopWidth', 'borderBottomWidth'),
    ];
    const lengths = map(['width', 'height'], (name) => parseFloat(style[name]));
    if (style.display === 'none' || !every(lengths, Number.isFinite)) {
      return { content: [0, 0], border: [0, 0], at: [0, 0] };
    }
    const whole = style.boxSizing === 'border-box';
    return {
      content: map(lengths, (length, k) => Math.max(0, whole ? length - extra[k] : length)),
      border: map(lengths, (length, k) => (whole ? length : length + extra[k])),
      at: [px('paddingLeft'), px('paddingTop')],
    };
  };
  class ResizeObserver extends observer(resizes) {
    observe(target, { box = 'content-box' } = {}) { this._observe(target, { box, size: [0, 0] }); }
    _entry(target, last) {
      const { content, border, at } = boxesOf(target);
      const size = last.box === 'border-box' ? border : content;
      if (every(size, (length, k) => length === last.size[k])) return null;
      last.size = size;
      const sizeOf = ({ 0: inlineSize, 1: blockSize }) =>
        Object.freeze([like(ResizeObserverSize, { inlineSize, blockSize })]);
      return like(ResizeObserverEntry, {
        target,
        contentRect: new DOMRectReadOnly(at[0], at[1], content[0], content[1]),
        contentBoxSize: sizeOf(content),
        borderBoxSize: sizeOf(border),
        devicePixelContentBoxSize: sizeOf(map(content, (length) => Math.round(length))),
      });
    }
  }

  const overlap = (a, b) => {
    const left = Math.max(a.left, b.left);
    const top = Math.max(a.top, b.top);
    const right = Math.min(a.right, b.right);
    const bottom = Math.min(a.bottom, b.bottom);
    return right >= left && bottom >= top ? new DOMRectReadOnly(left, top, right - left, bottom - top) : null;
  };
  class IntersectionObserver extends observer(intersections) {
    constructor(callback, { root = null, rootMargin = '0px', threshold = 0 } = {}) {
      super(callback);
      const given = String(rootMargin).trim().split(/\s+/);
      this.root = root;
      this._margins = map([0, 1, 2, 3], (k) => given[k] ?? given[k - 2] ?? given[0]); // top, right, bottom, left
      this.rootMargin = this._margins.join(' ');
      this.thresholds = Object.freeze([threshold].flat().map(Number).sort((a, b) => a - b));
    }
    observe(target) { this._observe(target, { index: -1 }); }
    takeRecords() { return []; }
    _bounds() {
      const element = this.root instanceof Element ? this.root : null;
      const { left, top, width, height } = element?.getBoundingClientRect()
        ?? { left: 0, top: 0, width: innerWidth, height: innerHeight };
      const by = map(this._margins, (margin, k) =>
        (margin.endsWith('%') ? (k % 2 ? width : height) / 100 : 1) * (parseFloat(margin) || 0));
      return new DOMRectReadOnly(left - by[3], top - by[0], width + by[1] + by[3], height + by[0] + by[2]);
    }
    _entry(target, last) {
      const rootBounds = this._bounds();
      const boundingClientRect = target.getBoundingClientRect();
      let seen = target.getClientRects().length ? boundingClientRect : null;
      for (let above = target.parentElement; seen && above && above !== this.root; above = above.parentElement) {
        if (above !== document.documentElement && above !== document.body
          && getComputedStyle(above).overflow !== 'visible') {
          seen = overlap(seen, above.getBoundingClientRect());
        }
      }
      seen = seen && overlap(seen, rootBounds);
      const area = boundingClientRect.width * boundingClientRect.height;
      const isIntersecting = Boolean(seen);
      const ratio = area && seen ? (seen.width * seen.height) / area : Number(isIntersecting);
      const above = filter(this.thresholds, (one) => one <= ratio).length;
      const index = isIntersecting ? Math.max(1, above) : 0;
      if (index === last.index) return null;
      last.index = index;
      return like(IntersectionObserverEntry, {
        target, time: sim.now(), rootBounds, boundingClientRect, isIntersecting,
        intersectionRatio: ratio, intersectionRect: seen ?? new DOMRectReadOnly(),
      });
    }
  }
  for (const made of [ResizeObserver, IntersectionObserver]) {
    define(window, made.name, made);
  }
  // Reports what has changed since the last call.
  sim.observe = () => {
    for (const active of [resizes, intersections]) {
      active.forEach((one) => sim.call(() => one._report()));
    }
  };
}
