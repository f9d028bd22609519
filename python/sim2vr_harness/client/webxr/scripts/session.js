// navigator.xr: its one immersive session, whose frames run when the harness says so, and inline
// sessions, which draw a preview on their canvas until then.
{
  const { compose, inverse, fromApp, IDENTITY } = sim.spaces;
  const {
    XRRigidTransform, XRPose, XRSpace, XRReferenceSpace, XRBoundedReferenceSpace, XRInputSource,
  } = sim.classes;
  const HANDS = ['left', 'right'];
  const FEATURES = ['viewer', 'local', 'local-floor', 'bounded-floor', 'unbounded'];
  const INPUT_EVENTS = ['select', 'selectstart', 'selectend', 'squeeze', 'squeezestart', 'squeezeend'];
  const ROOM_M = 2; // half the side of the square in which the user may move
  const EYES = { 1: ['none'], 2: ['left', 'right'] };

  const projection = (session) => {
    const { depthNear: near, depthFar: far, baseLayer, inlineVerticalFieldOfView } = session.renderState;
    const { width, height } = session._immersive ? sim.settings : baseLayer._gl.canvas;
    const fov = inlineVerticalFieldOfView ?? (sim.settings.vertical_fov_deg * Math.PI) / 180;
    const f = 1 / Math.tan(fov / 2);
    const bounded = Number.isFinite(far);
    return new Float32Array([
      (f * height) / width, 0, 0, 0, 0, f, 0, 0,
      0, 0, bounded ? (near + far) / (near - far) : -1, -1,
      0, 0, bounded ? (2 * near * far) / (near - far) : -2 * near, 0,
    ]);
  };

  class XRView {
    constructor(index, pose, session) {
      this._index = index;
      this.eye = session._eyes[index];
      this.projectionMatrix = projection(session);
      this.transform = XRRigidTransform._of(pose);
      this.recommendedViewportScale = null;
      this.isFirstPersonObserver = false;
    }
    requestViewportScale() {}
  }
  class XRViewerPose extends XRPose {
    constructor(pose, views) {
      super(pose);
      this.views = Object.freeze(views);
    }
  }

  class XRFrame {
    constructor(session, state, animated) {
      this.session = session;
      this.predictedDisplayTime = sim.now();
      this._state = state;
      this._animated = animated;
      this._active = true;
    }
    _locate(space, base) {
      if (!this._active) throw new DOMException('the frame is over', 'InvalidStateError');
      const where = space._where(this._state);
      const origin = base._where(this._state);
      return where && origin && compose(inverse(origin), where);
    }
    getPose(space, base) {
      const pose = this._locate(space, base);
      return pose ? new XRPose(pose) : null;
    }
    getViewerPose(base) {
      if (!this._animated) throw new DOMException('not an animation frame', 'InvalidStateError');
      const head = this._locate(this.session._viewer, base);
      if (!head) return null;
      if (this.session._immersive) sim.viewed = { base: base._where(this._state), head };
      const eyes = this.session._eyes;
      const views = map(eyes, (_, k) => {
        const offset = { p: [eyes.length === 1 ? 0 : (k - 0.5) * sim.settings.ipd_m, 0, 0], q: IDENTITY.q };
        return new XRView(k, compose(head, offset), this.session);
      });
      return new XRViewerPose(head, views);
    }
    fillPoses(spaces, base, transforms) {
      return every(spaces, (space, k) => {
        const pose = this._locate(space, base);
        if (pose) transforms.set(XRRigidTransform._of(pose).matrix, 16 * k);
        return Boolean(pose);
      });
    }
  }

  const { dispatchEvent: dispatch, addEventListener: listen } = EventTarget.prototype;
  // Events that also have an on... attribute.
  const fire = (target, event) => {
    const handler = target[`on${event.type}`];
    if (typeof handler === 'function') sim.call((given) => Reflect.apply(handler, target, [given]), event);
    Reflect.apply(dispatch, target, [event]);
  };
  class XRSessionEvent extends Event {
    constructor(type, { session, ...init }) {
      super(type, init);
      this.session = session;
    }
  }
  class XRInputSourceEvent extends Event {
    constructor(type, { frame, inputSource, ...init }) {
      super(type, init);
      Object.assign(this, { frame, inputSource });
    }
  }
  class XRInputSourcesChangeEvent extends XRSessionEvent {
    constructor(type, { added, removed, ...init }) {
      super(type, init);
      Object.assign(this, { added, removed });
    }
  }

  class XRSession extends EventTarget {
    constructor(mode, features) {
      super();
      this._immersive = mode !== 'inline';
      this._eyes = EYES[this._immersive ? sim.settings.eyes : 1];
      this.enabledFeatures = Object.freeze(features);
      this.visibilityState = 'visible';
      this.environmentBlendMode = 'opaque';
      this.interactionMode = this._immersive ? 'world-space' : 'screen-space';
      this.isSystemKeyboardSupported = false;
      this.domOverlayState = null;
      this.frameRate = sim.settings.frame_rate_hz;
      this.supportedFrameRates = new Float32Array([this.frameRate]);
      this.inputSources = [];
      this.renderState = Object.freeze({
        baseLayer: null, depthNear: 0.1, depthFar: 1000,
        inlineVerticalFieldOfView: this._immersive ? null : Math.PI / 2,
      });
      this._viewer = new XRSpace((state) => state.head);
      this._sources = Object.fromEntries(HANDS.map((hand) => [hand, new XRInputSource(hand)]));
      this._callbacks = new Map();
      this._last = 0;
      this._ended = false;
    }
    updateRenderState(changes = {}) {
      if (this._ended) throw new DOMException('the session is over', 'InvalidStateError');
      if (changes.layers?.length) {
        throw new DOMException('layers are not there', 'NotSupportedError');
      }
      const known = filter(Object.entries(changes),
        ({ 0: key, 1: value }) => value !== undefined && key in this.renderState);
      this._pending = { ...this._pending, ...Object.fromEntries(known) };
    }
    _settle() {
      if (!this._pending) return;
      this.renderState = Object.freeze({ ...this.renderState, ...this._pending });
      this._pending = null;
    }
    async requestReferenceSpace(type) {
      if (!includes(this.enabledFeatures, type)) {
        throw new DOMException(`no reference space ${type}`, 'NotSupportedError');
      }
      if (type === 'viewer') return new XRReferenceSpace((state) => state.head);
      if (type === 'local') {
        // Where the head was at the start, at eye height.
        return new XRReferenceSpace((state) => ({ p: [0, state.eyes_m, 0], q: IDENTITY.q }));
      }
      const corners = [[-1, -1], [-1, 1], [1, 1], [1, -1]];
      if (type !== 'bounded-floor') return new XRReferenceSpace(() => IDENTITY);
      return new XRBoundedReferenceSpace(() => IDENTITY,
        corners.map(([x, z]) => new DOMPointReadOnly(x * ROOM_M, 0, z * ROOM_M, 1)));
    }
    addEventListener(type, ...rest) {
      if (includes(INPUT_EVENTS, type)) sim.events.add(type);
      Reflect.apply(listen, this, [type, ...rest]);
    }
    requestAnimationFrame(callback) {
      if (this._ended) return 0;
      this._callbacks.set(++this._last, callback);
      return this._last;
    }
    cancelAnimationFrame(id) { this._callbacks.delete(id); }
    async updateTargetFrameRate() {}
    async end() {
      if (this._ended) return;
      this._ended = true;
      fire(this, new XRSessionEvent('end', { session: this }));
    }

    // Whether the page is ready to be shown frames.
    get _ready() {
      return Boolean((this._pending?.baseLayer ?? this.renderState.baseLayer) && this._callbacks.size);
    }

    // One frame: rows of the devices in the app's frame, null where one is not tracked.
    _frame({ head, hands, inputs, drawn }) {
      this._settle();
      const left = fromApp(hands[0]);
      const right = fromApp(hands[1]);
      this._eyes_m ??= head[1];
      const state = { head: fromApp(head), left, right, eyes_m: this._eyes_m };
      this._track(state);
      forEach(HANDS, (hand, k) => {
        if (!state[hand]) return;
        const source = this._sources[hand];
        forEach(source._take(inputs[k]), (type) => {
          const frame = new XRFrame(this, state, false);
          fire(this, new XRInputSourceEvent(type, { frame, inputSource: source }));
          frame._active = false;
        });
      });
      const layer = this.renderState.baseLayer;
      sim.beforeFrame();
      if (!this._call(state) || !drawn || this._ended) return null;
      return layer._read(this.renderState.depthNear, this.renderState.depthFar);
    }
    // Runs the callbacks; returns whether there were any.
    _call(state) {
      const callbacks = this._callbacks;
      if (this._ended || !this.renderState.baseLayer || callbacks.size === 0) return false;
      this._callbacks = new Map();
      const frame = new XRFrame(this, state, true);
      callbacks.forEach((callback) => sim.call(callback, sim.now(), frame));
      frame._active = false;
      return true;
    }
    _track(state) {
      const tracked = map(filter(HANDS, (hand) => state[hand]), (hand) => this._sources[hand]);
      const added = filter(tracked, (source) => !includes(this.inputSources, source));
      const removed = filter(this.inputSources, (source) => !includes(tracked, source));
      if (added.length + removed.length === 0) return;
      this.inputSources = tracked;
      fire(this, new XRInputSourcesChangeEvent('inputsourceschange', { session: this, added, removed }));
    }
  }
  for (const type of [
    'end', 'inputsourceschange', 'select', 'selectstart', 'selectend', 'squeeze', 'squeezestart',
    'squeezeend', 'visibilitychange', 'frameratechange',
  ]) XRSession.prototype[`on${type}`] = null;

  sim.events = new Set(); // of inputs, to which the page listens
  sim.wishes = new Set(); // features of sessions
  const previews = new Set(); // inline sessions
  sim.preview = () => previews.forEach((session) => {
    session._settle();
    session._call({ head: IDENTITY, eyes_m: 0 });
  });
  const supports = (mode) => mode === 'immersive-vr' || mode === 'inline';
  class XRSystem extends EventTarget {
    async isSessionSupported(mode) {
      sim.modes.add(String(mode));
      return supports(mode);
    }
    async supportsSession(mode) {
      if (!(await this.isSessionSupported(mode))) throw new DOMException(mode, 'NotSupportedError');
    }
    async requestSession(mode, { requiredFeatures = [], optionalFeatures = [] } = {}) {
      sim.modes.add(String(mode));
      const lacking = filter(requiredFeatures, (name) => !includes(FEATURES, name));
      forEach(lacking, (name) => sim.wishes.add(`${name} (required)`));
      if (!supports(mode) || lacking.length) {
        sim.refused = supports(mode) ? `the feature ${lacking[0]}` : `a session of ${mode}`;
        throw new DOMException(`sim2vr has no ${sim.refused}`, 'NotSupportedError');
      }
      const wished = [...requiredFeatures, ...optionalFeatures];
      forEach(wished, (name) => sim.wishes.add(`${name}${includes(requiredFeatures, name) ? ' (required)' : ''}`));
      const granted = filter(FEATURES, (name) => includes(wished, name));
      if (mode === 'inline') {
        const preview = new XRSession(mode, [...new Set(['viewer', ...granted])]);
        previews.add(preview);
        return preview;
      }
      if (sim.session && !sim.session._ended) {
        throw new DOMException('there is a session already', 'InvalidStateError');
      }
      sim.session = new XRSession(mode, [...new Set(['viewer', 'local', ...granted])]);
      return sim.session;
    }
    // The harness is who takes an offer, when the page has loaded.
    offerSession(mode, init) {
      sim.modes.add(String(mode));
      return new Promise((resolve, reject) => {
        sim.offer = () => {
          sim.offer = null;
          this.requestSession(mode, init).then(resolve, reject);
        };
      });
    }
  }
  const system = new XRSystem();
  system.ondevicechange = null;
  Object.defineProperty(Navigator.prototype, 'xr', { get: () => system, configurable: true });
  Object.assign(sim.classes, {
    XRView, XRViewerPose, XRFrame, XRSession, XRSystem, XRSessionEvent, XRInputSourceEvent,
    XRInputSourcesChangeEvent,
  });
  // A page finds the parts of WebXR that are covered; of all others, not even the names.
  for (const name of Object.getOwnPropertyNames(window)) if (/^XR/.test(name)) delete window[name];
  for (const [name, made] of Object.entries(sim.classes)) {
    Object.defineProperty(window, name, { value: made, configurable: true, writable: true });
  }
  sim.system = system;
  sim.fire = fire;
}
