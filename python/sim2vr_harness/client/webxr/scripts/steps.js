// What the harness calls: enter the session, run the frames of a user step, read values.
{
  const TICK_MS = 1000 / 60;
  // A recorded page has run before its first frame in VR: it runs as long again, at the same times.
  const { start } = sim.settings;
  const flat = start ? filter(start.frames_ms, (time) => time <= start.first_ms) : [];
  const MOST_TICKS = 900 // 15 s of the page's time to get ready
    + (start ? flat.length + Math.ceil(start.first_ms / TICK_MS) : 0);
  const LEAST_TICKS = 120; // after its last click, of a page that has not called WebXR when time is short
  const PART = 30; // of which each call of `enter` runs
  const MOST_STILL = 30; // at the time of the recorded first frame: a browser enters VR between two ticks
  const CLICK_EVERY = 15;
  const AGAIN_AFTER = 60;
  const MOST_IDLE_MS = 2000; // that a session may go without asking for a frame
  const AGAIN = /\b(try again|retry|reload|refresh)\b/i;
  const LIKELY = /\b(vr|xr|webxr|immersive|headset)\b|enter-?vr|vr-?button|vricon/i;
  const POSSIBLE = /\b(start|play|begin|enter|go|launch|continue|ok)\b/i;

  sim.haptics = [];
  const { btoa } = window;
  sim.values = new Map();
  sim.drawing = true;
  sim.modes = new Set(); // of sessions that the page asks about
  sim.failure = null;
  sim.fail = (kind, text) => { sim.failure ??= [kind, text]; };

  const base64 = (bytes) => {
    if (toBase64) return toBase64(bytes);
    let text = '';
    for (let k = 0; k < bytes.length; k += 0x8000) {
      text += Reflect.apply(String.fromCharCode, String, subarray(bytes, k, k + 0x8000));
    }
    return btoa(text);
  };
  // Runs what the page does of itself up to a time.
  const advance = async (time, preview) => {
    await sim.loaded();
    await sim.runTimers(time);
    sim.wakeWorkers();
    await sim.loaded();
    sim.animate();
    sim.runFrames();
    if (preview) sim.preview();
    sim.observe();
  };

  // Elements that listen to being clicked, whatever they look like.
  const CLICKS = ['click', 'pointerdown', 'pointerup', 'mousedown', 'mouseup', 'touchend'];
  const listening = new WeakSet();
  EventTarget.prototype.addEventListener = function (type, ...rest) {
    if (includes(CLICKS, type) && this instanceof Element) listening.add(this);
    sim.heard(this, type);
    return listen(this, type, ...rest);
  };
  const BUTTONS = 'button, a, input[type=button], input[type=submit], [role=button], [onclick], '
    + '[class*=vr i], [id*=vr i]';
  const elements = (root) => [...root.querySelectorAll('*')].flatMap(
    (element) => [element, ...(element.shadowRoot ? elements(element.shadowRoot) : [])]);

  const leadsAway = (node) => node instanceof HTMLAnchorElement && /^(https?|mailto):/.test(node.href)
    && node.href.split('#')[0] !== location.href.split('#')[0];
  // What looks as if it led into VR, the likeliest first; then what can be clicked at all.
  const doors = () => {
    const words = (element) => [
      element.id, element.className?.baseVal ?? element.className, element.title,
      element.getAttribute('aria-label'), element.value, element.textContent.slice(0, 80),
    ].filter((word) => typeof word === 'string').join(' ');
    const clickable = (element) => element.onclick || listening.has(element);
    const all = elements(document).filter((element) => !element.disabled
      && !/^(html|body|a-scene|canvas)$/i.test(element.tagName) && !leadsAway(element.closest('a'))
      && !AGAIN.test(words(element)) && !exits.has(element)
      && (element.matches(BUTTONS) || clickable(element)));
    const likely = all.filter((element) => LIKELY.test(words(element)));
    const possible = all.filter((element) => !likely.includes(element) && POSSIBLE.test(words(element)));
    const others = [...all, ...document.querySelectorAll('canvas'), document.body].filter(
      (element) => !likely.includes(element) && !possible.includes(element) && clickable(element)
        && !AGAIN.test(words(element)) && !exits.has(element));
    return { likely, all: [...likely, ...possible, ...others] };
  };
  // The place of an element where the mouse meets it, x y in the window; null: nowhere.
  const pointOf = (element) => {
    const box = () => element.getBoundingClientRect();
    const inside = ({ left, top, right, bottom }) =>
      left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
    if (!inside(box())) element.scrollIntoView({ block: 'center', inline: 'center', behavior: 'instant' });
    const { left, top, width, height } = box();
    const at = [left + width / 2, top + height / 2];
    let hit = document.elementFromPoint(...at);
    for (let inner = hit; (inner = inner?.shadowRoot?.elementFromPoint(...at)) && inner !== hit;) hit = inner;
    while (hit && hit !== element) hit = hit.parentNode ?? hit.host;
    return width && height && hit ? at : null;
  };
  // Clicks an element that the mouse does not meet: a hidden one, or one below another.
  sim.click = () => {
    const init = { bubbles: true, cancelable: true, composed: true, button: 0, view: window };
    for (const type of ['pointerdown', 'mousedown', 'pointerup', 'mouseup', 'click']) {
      const kind = type.startsWith('pointer') ? PointerEvent : MouseEvent;
      sim.door.dispatchEvent(new kind(type, init));
    }
  };
  // The mouse is where the harness clicks, and nowhere at any other time.
  let clicking = false;
  for (const type of [
    'click', 'mousedown', 'mouseup', 'mousemove', 'mouseover', 'mouseout', 'mouseenter',
    'mouseleave', 'pointerdown', 'pointerup', 'pointermove', 'pointerover', 'pointerout',
    'pointerenter', 'pointerleave',
  ]) {
    listen(window, type, (event) => {
      if (event.isTrusted && !clicking) event.stopImmediatePropagation();
    }, true);
  }
  // A click of the harness does not leave the page.
  listen(window, 'click', (event) => {
    if (clicking && event.composedPath().some(leadsAway)) event.preventDefault();
  });
  // Nor does what the click brings about later, by a script: what was clicked is no door into VR.
  const exits = new Map(); // element -> where it leads
  window.navigation?.addEventListener('navigate', (event) => {
    if (!sim.door || sim.session || !event.cancelable || event.destination.sameDocument) return;
    event.preventDefault();
    const { url } = event.destination;
    exits.set(sim.door, url === location.href ? 'loads the page again' : `leads to ${slice(url, 0, 200)}`);
  });
  listen(window, 'submit', (event) => {
    if (clicking) event.preventDefault();
  });

  // The element to click, null: none. Those that look likely are clicked again each second.
  const clicks = new Map(); // element -> {count, at}
  const nextDoor = () => {
    const { likely, all } = doors();
    const due = filter(all, (element) => {
      const last = clicks.get(element);
      return !last || (includes(likely, element) && ticks - last.at >= AGAIN_AFTER);
    });
    const count = (element) => clicks.get(element)?.count ?? 0;
    const door = due.find((element) => includes(likely, element)) ?? due.find((element) => !count(element));
    if (door) clicks.set(door, { count: count(door) + 1, at: ticks });
    return door ?? null;
  };

  // Brings the page nearer to VR; called until it is done, or has failed. An answer with `click`:
  // click at `at`, or by `sim.click` where that is null, first.
  let ticks = 0;
  let shown = 0; // recorded frames that have run
  let clicked = 0; // the tick of the last click
  let free = 0; // ticks in which it could be clicked
  let still = 0;
  const nextTime = () => {
    if (shown < flat.length) return flat[shown++];
    const time = sim.now() + TICK_MS;
    return start && time > start.first_ms && still++ < MOST_STILL ? start.first_ms : time;
  };
  const held = () => start && (shown < flat.length ? flat[shown] : sim.now() + TICK_MS) <= start.requested_ms;
  const doorOf = (element) => {
    sim.door = element;
    clicked = ticks;
    clicking = true;
    return { click: true, at: pointOf(element) };
  };
  sim.enter = async (selector, hurried) => {
    clicking = false;
    if (hurried && !start && sim.modes.size === 0 && ticks - clicked >= LEAST_TICKS) {
      return { done: true, failure: ['enter', notEntered(selector)] };
    }
    if (start) free ||= selector ? 1 : CLICK_EVERY; // at once
    for (const until = ticks + PART; ticks < Math.min(until, MOST_TICKS);) {
      ticks += 1;
      await advance(nextTime(), true);
      await sim.turn();
      if (sim.failure) return { done: true, failure: sim.failure };
      if (sim.session) {
        if (sim.session._ready && shown === flat.length) {
          await sim.loaded();
          await sim.turn();
          return { done: true, failure: sim.failure };
        }
        continue;
      }
      if (held()) continue;
      const k = free++;
      if (selector) {
        const element = k % AGAIN_AFTER === 1 && document.querySelector(selector);
        if (element) return doorOf(element);
      } else if (k === 2) {
        dispatch(sim.system, Object.assign(new Event('sessiongranted'), { session: { mode: 'immersive-vr' } }));
      }
      if (sim.offer) {
        sim.offer();
      } else if (!selector && k > 2 && k % CLICK_EVERY === 0) {
        const door = nextDoor();
        if (door) return doorOf(door);
      }
    }
    return ticks < MOST_TICKS ? {} : { done: true, failure: ['enter', notEntered(selector)] };
  };
  const notEntered = (selector) => {
    if (selector && !document.querySelector(selector)) return `has no element ${selector} to enter VR by`;
    const names = [];
    clicks.forEach((_, element) => {
      const exit = exits.has(element) ? ` (${exits.get(element)})` : '';
      const label = element.textContent.trim() || element.getAttribute('aria-label') || element.title || element.id;
      push(names, `${label.slice(0, 30) || `<${element.localName} class="${element.getAttribute('class') ?? ''}">`}${exit}`);
    });
    const tried = names.slice(0, 5).join(', ');
    if (sim.modes.size === 0 && navigator.getVRDisplays) { // browsers have none: the page brings a polyfill
      return 'uses WebVR, which WebXR replaced, expected an engine with WebXR (A-Frame 1.0 or three.js r112, or later)';
    }
    if (sim.modes.size === 0) return `never calls WebXR (navigator.xr)${tried && `; tried to click: ${tried}`}`;
    if (sim.session) return 'enters VR, but asks for no frames there';
    if (!sim.modes.has('immersive-vr') && sim.modes.has('immersive-ar')) {
      return 'is an AR page: it asks for immersive-ar only, expected immersive-vr';
    }
    if (sim.refused) return `asks for ${sim.refused}, which is not covered`;
    return `never enters VR; tried to click: ${tried || 'nothing that looks like it'}`;
  };

  const finite = (value) => {
    if (Number.isFinite(value)) return value;
    throw new TypeError(`is ${typeof value === 'number' ? value : typeof value}, expected a finite number`);
  };
  const plain = (value) => {
    if (typeof value === 'boolean' || value === null) return value;
    if (typeof value === 'number') return finite(value);
    if (Array.isArray(value) && value.length === 3) return map([value[0], value[1], value[2]], finite);
    if (value && every(['x', 'y', 'z'], (axis) => typeof value[axis] === 'number')) {
      return map([value.x, value.y, -value.z], finite); // a vector of the page, right-handed
    }
    throw new TypeError(`is ${value === undefined ? 'undefined' : typeof value}, expected a number, true or false, or x y z`);
  };
  const readValues = () => {
    const found = [];
    sim.values.forEach((read, name) => {
      try {
        push(found, [name, plain(read(sim.locate))]);
      } catch (error) {
        push(found, [name, 0, slice(String(error?.message ?? error), 0, 300)]);
      }
    });
    return found;
  };

  const place = (name) => {
    try {
      return sim.locate(name);
    } catch {
      return null;
    }
  };

  let asked = 0; // when the session had a callback last, ms
  // Runs frames: [time_ms, head, [left, right], [inputs left, right], drawn]; times since `sim.base`.
  // Afterwards it reads values, and where the objects of some names are.
  sim.step = async (frames, withValues, sought) => {
    let picture = null;
    for (let k = 0; k < frames.length; k++) {
      const { 0: time, 1: head, 2: hands, 3: inputs, 4: drawn } = frames[k];
      await advance(sim.base + time, false);
      sim.drawing = drawn;
      picture = sim.session._frame({ head, hands, inputs, drawn }) ?? picture;
      sim.drawing = true;
      await sim.turn();
      if (sim.session._callbacks.size) asked = sim.now();
      else if (sim.now() - asked > MOST_IDLE_MS) sim.fail('idle', 'asks for no more frames');
      if (sim.failure || sim.session._ended) break;
    }
    await sim.loaded();
    const haptics = sim.haptics;
    sim.haptics = [];
    return { // by value: the browser writes it down, no toJSON of the page does
      haptics,
      ended: sim.session._ended,
      failure: sim.failure,
      values: withValues ? readValues() : [],
      places: map(sought, place),
      picture: picture && base64(picture.eyes),
      observed: picture?.observed ?? [],
    };
  };
  sim.begin = () => {
    sim.base = asked = start ? Math.max(sim.now(), start.first_ms) : sim.now() + TICK_MS;
    let count = 0;
    sim.beforeFrame = () => { if (start) sim.seedFrame(count++); }; // as the recorder does
    sim.haptics = [];
  };
}
