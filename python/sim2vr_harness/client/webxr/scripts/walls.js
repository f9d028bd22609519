// What a page under test has no business with: the network beyond its files, other windows, files
// to write. The browser is started without a way out; here it is said to the scripts of the page
// and of the frames within it.
{
  // Each wall is built by itself: a sandboxed frame throws at some, and still gets the others.
  const wall = (build) => {
    try {
      build();
    } catch {
      // The window has no such thing, or does not let its own scripts have it.
    }
  };
  const refuse = (name) => function () {
    throw new DOMException(`${name} is not there under sim2vr`, 'NotSupportedError');
  };
  // Absent, as from the browsers of headsets.
  for (const name of [
    'WebSocketStream', 'SharedWorker', 'showSaveFilePicker', 'showOpenFilePicker', 'showDirectoryPicker',
  ]) wall(() => { delete window[name]; });
  wall(() => { delete Navigator.prototype.gpu; });
  for (const name of Object.getOwnPropertyNames(window)) if (/^GPU/.test(name)) wall(() => { delete window[name]; });
  // Connections are made, and then fail as without a network, in the time of the page. Peers are the
  // browser's own: they find no way out.
  const { setTimeout: later } = window;
  const FAILS_AFTER_MS = 20;
  const AGAIN_AFTER_MS = 3000;
  const { dispatchEvent } = EventTarget.prototype;
  const send = (target, event) => dispatchEvent.call(target, event);
  const failing = (name, methods, begin) => wall(() => {
    const Real = window[name];
    if (!Real) return;
    const states = new WeakMap();
    const { prototype } = Real;
    const lists = new WeakMap(); // target -> {type: {handler, listener}}
    const Failing = function (url, ...rest) {
      if (!new.target) throw new TypeError(`Failed to construct '${name}': Please use the 'new' operator`);
      if (arguments.length === 0) throw new TypeError(`Failed to construct '${name}': 1 argument required, but only 0 present.`);
      const made = Reflect.construct(EventTarget, [], new.target);
      const state = { readyState: 0, ...begin(made, url, rest, () => states.get(made)) };
      states.set(made, state);
      return made;
    };
    Object.defineProperty(Failing, 'name', { value: name });
    Object.defineProperty(Failing, 'length', { value: 1 });
    Failing.prototype = prototype;
    for (const key of Object.keys(Real)) Object.defineProperty(Failing, key, Object.getOwnPropertyDescriptor(Real, key));
    for (const [key, member] of Object.entries(Object.getOwnPropertyDescriptors(prototype))) {
      if (/^on/.test(key)) {
        const type = key.slice(2);
        Object.defineProperty(prototype, key, {
          ...member,
          get() { return lists.get(this)?.[type]?.handler ?? null; },
          set(value) {
            const all = lists.get(this) ?? {};
            lists.set(this, all);
            if (!all[type]) {
              all[type] = {};
              this.addEventListener(type, (event) => all[type].handler?.call(this, event));
            }
            all[type].handler = typeof value === 'function' ? value : null;
          },
        });
      } else if (member.get) {
        Object.defineProperty(prototype, key, {
          ...member,
          get() {
            const state = states.get(this);
            if (!state) throw new TypeError('Illegal invocation');
            return state[key];
          },
          ...(member.set && { set(value) { states.get(this)[key] = value; } }),
        });
      }
    }
    for (const [key, method] of Object.entries(methods)) {
      Object.defineProperty(prototype, key, {
        value(...args) { return method(states.get(this), ...args); }, configurable: true, enumerable: true, writable: true,
      });
    }
    Object.defineProperty(prototype, 'constructor', { value: Failing, configurable: true, writable: true });
    Object.defineProperty(window, name, { value: Failing, configurable: true, writable: true });
  });
  const addressOf = (name, url) => {
    try {
      return new URL(url, document.baseURI);
    } catch {
      throw new DOMException(`Failed to construct '${name}': The URL '${url}' is invalid.`, 'SyntaxError');
    }
  };
  failing('WebSocket', {
    send(state) {
      if (state.readyState === 0) throw new DOMException('Still in CONNECTING state.', 'InvalidStateError');
    },
    close(state, code) {
      if (code !== undefined && code !== 1000 && !(code >= 3000 && code < 5000)) {
        throw new DOMException(`The code must be either 1000, or between 3000 and 4999. ${code} is neither.`, 'InvalidAccessError');
      }
      if (state.readyState < 2) state.readyState = 2;
    },
  }, (made, url, { 0: protocols = [] }, stateOf) => {
    const address = addressOf('WebSocket', url);
    address.protocol = address.protocol.replace(/^http/, 'ws');
    if (!/^wss?:$/.test(address.protocol) || address.hash) {
      throw new DOMException(`Failed to construct 'WebSocket': The URL '${url}' is invalid.`, 'SyntaxError');
    }
    const wished = typeof protocols === 'string' ? [protocols] : [...protocols].map(String);
    if (new Set(wished).size < wished.length || !wished.every((one) => /^[!#$%&'*+.^_`|~0-9A-Za-z-]+$/.test(one))) {
      throw new DOMException("Failed to construct 'WebSocket': The subprotocol is invalid.", 'SyntaxError');
    }
    later(() => {
      console.error(`WebSocket connection to '${address.href}' failed: no network under sim2vr`);
      stateOf().readyState = 3;
      send(made, new Event('error'));
      send(made, new CloseEvent('close', { code: 1006, reason: '', wasClean: false }));
    }, FAILS_AFTER_MS);
    return { url: address.href, protocol: '', extensions: '', bufferedAmount: 0, binaryType: 'blob' };
  });
  failing('EventSource', {
    close(state) { state.readyState = 2; },
  }, (made, url, { 0: init }, stateOf) => {
    const address = addressOf('EventSource', url);
    const own = address.origin === location.origin; // where there is no stream: for good
    const fail = () => {
      const state = stateOf();
      if (state.readyState === 2) return;
      if (own) state.readyState = 2;
      else later(fail, AGAIN_AFTER_MS);
      send(made, new Event('error'));
    };
    later(fail, FAILS_AFTER_MS);
    return { url: address.href, withCredentials: Boolean(init?.withCredentials) };
  });
  wall(() => {
    Object.defineProperty(ServiceWorkerContainer.prototype, 'register', {
      value: async () => refuse('serviceWorker')(),
    });
  });
  wall(() => { StorageManager.prototype.getDirectory = async () => refuse('getDirectory')(); });
  // A round begins without what another has kept; the harness clears what takes time to open.
  if (window === window.top && location.protocol !== 'about:') {
    wall(() => localStorage.clear());
    wall(() => sessionStorage.clear());
    wall(() => { window.name = ''; });
  }
  // What the machine has would make rounds differ.
  wall(() => { navigator.getGamepads = () => [null, null, null, null]; });
  for (const [name, value] of [['hardwareConcurrency', 4], ['deviceMemory', 4]]) {
    wall(() => {
      if (name in navigator) Object.defineProperty(Navigator.prototype, name, { get: () => value });
    });
  }
  // The harness's mouse has nothing to lock; the browser would wait for it.
  wall(() => { Element.prototype.requestPointerLock = async () => {}; });
  wall(() => { window.open = () => null; });
  wall(() => { window.alert = () => {}; });
  wall(() => { window.confirm = () => true; });
  wall(() => { window.prompt = () => null; });
  wall(() => {
    Navigator.prototype.sendBeacon = function sendBeacon(url) {
      const { protocol } = new URL(url, document.baseURI); // throws as the browser's own
      if (!/^https?:$/.test(protocol)) throw new TypeError('Beacons are only supported over HTTP(S).');
      return true; // queued, without a word of what becomes of it
    };
  });
}
