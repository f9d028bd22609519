// What the harness calls: enter the session, run the frames of a user step, read values.
{
  const TICK_MS = 1000 / 60;
  const MOST_TICKS = 900; // 15 s of the page's time to get ready
  const CLICK_EVERY = 15;
  const LIKELY = /\b(vr|xr|webxr|immersive|headset)\b|enter-?vr|vr-?button|vricon/i;
  const POSSIBLE = /\b(start|play|begin|enter|go|launch|continue|ok)\b/i;

  sim.haptics = [];
  const { btoa } = window;
  sim.values = new Map();
  sim.drawing = true;
  sim.asked = false;
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
  const tick = async (time) => {
    await sim.loaded();
    await sim.runTimers(time);
    sim.runFrames();
    await sim.turn();
  };

  // Elements that listen to being clicked, whatever they look like.
  const CLICKS = ['click', 'pointerdown', 'pointerup', 'mousedown', 'mouseup', 'touchend'];
  const listening = new WeakSet();
  const { addEventListener } = EventTarget.prototype;
  EventTarget.prototype.addEventListener = function (type, ...rest) {
    if (includes(CLICKS, type) && this instanceof Element) listening.add(this);
    return Reflect.apply(addEventListener, this, [type, ...rest]);
  };
  const BUTTONS = 'button, a, input[type=button], input[type=submit], [role=button], [onclick], '
    + '[class*=vr i], [id*=vr i]';
  const elements = (root) => [...root.querySelectorAll('*')].flatMap(
    (element) => [element, ...(element.shadowRoot ? elements(element.shadowRoot) : [])]);

  // What looks as if it led into VR, the likeliest first; then what can be clicked at all.
  const doors = () => {
    const words = (element) => [
      element.id, element.className?.baseVal ?? element.className, element.title,
      element.getAttribute('aria-label'), element.value, element.textContent.slice(0, 80),
    ].filter((word) => typeof word === 'string').join(' ');
    const clickable = (element) => element.onclick || listening.has(element);
    const all = elements(document).filter((element) => !element.disabled
      && !/^(html|body|a-scene|canvas)$/i.test(element.tagName)
      && (element.matches(BUTTONS) || clickable(element)));
    const likely = all.filter((element) => LIKELY.test(words(element)));
    const possible = all.filter((element) => !likely.includes(element) && POSSIBLE.test(words(element)));
    const others = [...all, ...document.querySelectorAll('canvas'), document.body].filter(
      (element) => !likely.includes(element) && !possible.includes(element) && clickable(element));
    return [...likely, ...possible, ...others];
  };
  const knock = (element) => {
    for (const type of ['pointerdown', 'mousedown', 'pointerup', 'mouseup']) {
      const kind = type.startsWith('pointer') ? PointerEvent : MouseEvent;
      element.dispatchEvent(new kind(type, { bubbles: true, cancelable: true, button: 0 }));
    }
    element.click();
  };

  // Brings the page into VR; returns null, or why it does not get there.
  sim.enter = async (selector) => {
    const tried = new Set();
    for (let k = 0; k < MOST_TICKS; k++) {
      await tick(sim.now() + TICK_MS);
      if (sim.failure) return sim.failure;
      if (sim.session) {
        if (sim.session._ready) {
          await sim.loaded();
          await sim.turn();
          return sim.failure;
        }
        continue;
      }
      if (k === 1 && selector) {
        const element = document.querySelector(selector);
        if (!element) return ['enter', `has no element ${selector} to enter VR by`];
        knock(element);
      } else if (sim.offer) {
        sim.offer();
      } else if (k === 2 && !selector) {
        sim.fire(sim.system, Object.assign(new Event('sessiongranted'), { session: { mode: 'immersive-vr' } }));
      } else if (k > 2 && k % CLICK_EVERY === 0 && !selector) {
        const door = doors().find((element) => !tried.has(element));
        if (door) {
          tried.add(door);
          knock(door);
        }
      }
    }
    if (!sim.asked) return ['no-webxr', 'never calls WebXR (navigator.xr)'];
    if (sim.session) return ['enter', 'enters VR, but asks for no frames there'];
    if (sim.refused) return ['enter', `asks for ${sim.refused}, which is not covered`];
    const clicked = [...tried].slice(0, 5).map((element) => element.textContent.trim().slice(0, 30) || element.id);
    return ['enter', `never enters VR; tried to click: ${clicked.join(', ') || 'nothing that looks like it'}`];
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

  // Runs frames: [time_ms, head, [left, right], [inputs left, right], drawn]; times since `sim.base`.
  sim.step = async (frames, withValues) => {
    let picture = null;
    for (let k = 0; k < frames.length; k++) {
      const { 0: time, 1: head, 2: hands, 3: inputs, 4: drawn } = frames[k];
      await sim.loaded();
      await sim.runTimers(sim.base + time);
      sim.runFrames();
      sim.drawing = drawn;
      picture = sim.session._frame({ head, hands, inputs, drawn }) ?? picture;
      sim.drawing = true;
      await sim.turn();
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
      picture: picture && base64(picture),
    };
  };
  sim.begin = () => {
    sim.base = sim.now() + TICK_MS;
    sim.haptics = [];
  };
}
