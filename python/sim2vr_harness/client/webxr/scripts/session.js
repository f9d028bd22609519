// navigator.xr: its one immersive session, whose frames run when the harness says so, and inline
// sessions, which draw a preview on their canvas until then.
{
  const { compose, inverse, fromApp, transformOf, poseValues, IDENTITY } = sim.spaces;
  const { complete, dictionary, illegal, make, needs, number, own, record, taken } = sim.idl;
  const {
    XRRigidTransform, XRPose, XRSpace, XRReferenceSpace, XRBoundedReferenceSpace, XRInputSource, XRWebGLLayer,
  } = sim.classes;
  const HANDS = ['left', 'right'];
  const MODES = ['inline', 'immersive-vr', 'immersive-ar'];
  const FEATURES = ['viewer', 'local', 'local-floor', 'bounded-floor', 'unbounded'];
  const INPUT_EVENTS = ['select', 'selectstart', 'selectend', 'squeeze', 'squeezestart', 'squeezeend'];
  const ROOM_M = 2; // half the side of the square in which the user may move
  const EYES = { 1: ['none'], 2: ['left', 'right'] };
  const radians = (degrees) => (degrees * Math.PI) / 180;
  const wrongState = (why) => new DOMException(why, 'InvalidStateError');
  const chosen = (value, known, what) => {
    const text = String(value);
    if (includes(known, text)) return text;
    throw new TypeError(`The provided value '${text}' is not a valid enum value of type ${what}`);
  };
  const listOf = (value, what) => {
    if (value !== null && typeof value === 'object' && typeof value[Symbol.iterator] === 'function') return [...value];
    throw new TypeError(`${what} is not a sequence`);
  };

  const projection = ({ depthNear: near, depthFar: far }, fov, { width, height }) => {
    const f = 1 / Math.tan(fov / 2);
    return new Float32Array([
      (f * height) / width, 0, 0, 0, 0, f, 0, 0,
      0, 0, (near + far) / (near - far), -1,
      0, 0, (2 * near * far) / (near - far), 0,
    ]);
  };

  class XRView {
    constructor() { illegal(); }
    requestViewportScale(scale) {
      own(this, XRView);
      if (scale !== undefined && scale !== null) number(scale, 'scale');
    }
  }
  complete(XRView, ['eye', 'projectionMatrix', 'transform', 'recommendedViewportScale']);
  Object.defineProperty(XRView.prototype.requestViewportScale, 'length', { value: 1 });
  class XRViewerPose extends XRPose {}
  complete(XRViewerPose, ['views']);
  class XRRenderState { constructor() { illegal(); } }
  complete(XRRenderState, ['depthNear', 'depthFar', 'inlineVerticalFieldOfView', 'baseLayer']);

  class XRFrame {
    constructor() { illegal(); }
    getPose(space, baseSpace) {
      const frame = own(this, XRFrame);
      needs(2, arguments, 'getPose');
      const pose = located(frame, taken(space, XRSpace, 'space'), taken(baseSpace, XRSpace, 'baseSpace'));
      return pose ? make(XRPose, poseValues(pose)) : null;
    }
    getViewerPose(referenceSpace) {
      const frame = own(this, XRFrame);
      needs(1, arguments, 'getViewerPose');
      const base = taken(referenceSpace, XRReferenceSpace, 'referenceSpace');
      const { behind: session, state } = frame;
      if (!frame.animated) throw wrongState('not an animation frame');
      const head = located(frame, session._viewer, base);
      if (!head) return null;
      if (session._immersive) sim.viewed = { base: base.where(state), head };
      const eyes = session._eyes;
      const fov = session._render.inlineVerticalFieldOfView ?? radians(sim.settings.vertical_fov_deg);
      const layer = session._render.baseLayer && sim.layer(session._render.baseLayer);
      const size = session._immersive ? sim.settings : layer.gl.canvas;
      const view = (eye, index, place, angle, area) => make(XRView, {
        eye, index, frame, area, recommendedViewportScale: null,
        projectionMatrix: projection(session._render, angle, area), transform: transformOf(place),
      });
      const views = map(eyes, (eye, index) => {
        const offset = { p: [eyes.length === 1 ? 0 : (index - 0.5) * sim.settings.ipd_m, 0, 0], q: IDENTITY.q };
        return view(eye, index, compose(head, offset), fov,
          { x: index * size.width, y: 0, width: size.width, height: size.height });
      });
      forEach(session._observers, ({ place, fov_deg: degrees }, k) => {
        const where = place ? compose(inverse(base.where(state)), place) : head;
        push(views, view('none', views.length, where, radians(degrees), layer.areas[k]));
      });
      return make(XRViewerPose, { ...poseValues(head), views: Object.freeze(views) });
    }
  }
  complete(XRFrame, ['session', 'predictedDisplayTime']);
  // Where a space is in another, both of the frame's session.
  const located = (frame, space, base) => {
    if (!frame.active) throw wrongState('the frame is over');
    if (space.session !== frame.behind || base.session !== frame.behind) throw wrongState('a space of another session');
    const where = space.where(frame.state);
    const origin = base.where(frame.state);
    return where && origin && compose(inverse(origin), where);
  };
  const frameOf = (session, state, animated) => make(XRFrame, {
    session: session.page, predictedDisplayTime: sim.now(), behind: session, state, animated, active: true,
  });

  class XRInputSourceArray {
    constructor() { illegal(); }
    get length() { return own(this, XRInputSourceArray).list.length; }
  }
  complete(XRInputSourceArray);
  for (const name of ['entries', 'keys', 'values', 'forEach']) {
    Object.defineProperty(XRInputSourceArray.prototype, name, {
      value: window.Array.prototype[name], enumerable: true, configurable: true, writable: true,
    });
  }
  Object.defineProperty(XRInputSourceArray.prototype, Symbol.iterator, {
    value: window.Array.prototype.values, configurable: true, writable: true,
  });

  // A class of events whose attributes are what a function reads from the dictionary.
  const eventClass = (name, attributes, read) => {
    const Class = { [name]: class extends Event {
      constructor(type, eventInitDict) {
        needs(2, arguments, name);
        const values = read(dictionary(eventInitDict, 'eventInitDict'));
        super(type, eventInitDict);
        record(this, Class, values);
      }
    } }[name];
    complete(Class, attributes);
    return Class;
  };
  const XRSessionEvent = eventClass('XRSessionEvent', ['session'], ({ session }) => {
    taken(session, XRSession, 'session');
    return { session };
  });
  const XRInputSourceEvent = eventClass('XRInputSourceEvent', ['frame', 'inputSource'], ({ frame, inputSource }) => {
    taken(frame, XRFrame, 'frame');
    taken(inputSource, XRInputSource, 'inputSource');
    return { frame, inputSource };
  });
  const sourcesOf = (value, name) => {
    const found = listOf(value, name);
    forEach(found, (source) => taken(source, XRInputSource, name));
    return Object.freeze(found);
  };
  const XRInputSourcesChangeEvent = eventClass('XRInputSourcesChangeEvent', ['session', 'added', 'removed'],
    ({ session, added, removed }) => {
      taken(session, XRSession, 'session');
      return { session, added: sourcesOf(added, 'added'), removed: sourcesOf(removed, 'removed') };
    });
  eventClass('XRReferenceSpaceEvent', ['referenceSpace', 'transform'], ({ referenceSpace, transform = null }) => {
    taken(referenceSpace, XRReferenceSpace, 'referenceSpace');
    if (transform !== null) taken(transform, XRRigidTransform, 'transform');
    return { referenceSpace, transform };
  });

  class XRSession extends EventTarget {
    constructor() { illegal(); }
    updateRenderState(state = {}) {
      const session = own(this, XRSession);
      if (session._ended) throw wrongState('the session is over');
      const given = dictionary(state, 'state');
      const changes = {};
      for (const name of ['depthNear', 'depthFar', 'inlineVerticalFieldOfView']) {
        if (given[name] !== undefined) changes[name] = number(given[name], name);
      }
      if (given.baseLayer !== undefined) {
        changes.baseLayer = given.baseLayer;
        if (given.baseLayer !== null && taken(given.baseLayer, XRWebGLLayer, 'baseLayer').session !== session) {
          throw wrongState('a layer of another session');
        }
      }
      if (given.layers !== undefined && given.layers !== null && listOf(given.layers, 'layers').length) {
        throw new DOMException('layers are not there', 'NotSupportedError');
      }
      const fov = changes.inlineVerticalFieldOfView;
      if (fov !== undefined && session._immersive) throw wrongState('inlineVerticalFieldOfView in an immersive session');
      if (fov !== undefined) changes.inlineVerticalFieldOfView = Math.min(Math.max(fov, 0.01), Math.PI - 0.01);
      for (const name of ['depthNear', 'depthFar']) {
        if (name in changes) changes[name] = Math.max(0, changes[name]);
      }
      session._pending = { ...session._pending, ...changes };
    }
    async updateTargetFrameRate(rate) {
      const session = own(this, XRSession);
      needs(1, arguments, 'updateTargetFrameRate');
      const wished = number(rate, 'rate');
      if (session._ended || session.frameRate === null) throw wrongState('no frame rate to set');
      if (wished !== session.frameRate) throw new TypeError(`rate ${wished} is not among the supported frame rates`);
    }
    async requestReferenceSpace(type) {
      const session = own(this, XRSession);
      needs(1, arguments, 'requestReferenceSpace');
      const wished = chosen(type, FEATURES, 'XRReferenceSpaceType');
      if (session._ended) throw wrongState('the session is over');
      if (!includes(session.enabledFeatures, wished)) {
        throw new DOMException(`no reference space ${wished}`, 'NotSupportedError');
      }
      const of = (where) => make(XRReferenceSpace, { session, where });
      if (wished === 'viewer') return of((state) => state.head);
      // Where the head was at the start, at eye height.
      if (wished === 'local') return of((state) => ({ p: [0, state.eyes_m, 0], q: IDENTITY.q }));
      if (wished !== 'bounded-floor') return of(() => IDENTITY);
      const corners = [[-1, -1], [-1, 1], [1, 1], [1, -1]];
      return make(XRBoundedReferenceSpace, {
        session,
        where: () => IDENTITY,
        boundsGeometry: Object.freeze(map(corners,
          ({ 0: x, 1: z }) => new DOMPointReadOnly(x * ROOM_M, 0, z * ROOM_M, 1))),
      });
    }
    addEventListener(type, ...rest) {
      if (includes(INPUT_EVENTS, type)) sim.events.add(type);
      listen(this, type, ...rest);
    }
    requestAnimationFrame(callback) {
      const session = own(this, XRSession);
      if (typeof callback !== 'function') throw new TypeError('callback is not a function');
      if (session._ended) return 0;
      session._callbacks.set(++session._last, callback);
      return session._last;
    }
    cancelAnimationFrame(handle) {
      const session = own(this, XRSession);
      needs(1, arguments, 'cancelAnimationFrame');
      session._callbacks.delete(handle);
      session._running?.delete(handle);
    }
    async end() {
      const session = own(this, XRSession);
      if (session._ended) throw wrongState('the session is over');
      session._ended = true;
      previews.delete(session);
      await null;
      dispatch(this, new XRSessionEvent('end', { session: this }));
    }
  }
  complete(XRSession, [
    'visibilityState', 'frameRate', 'supportedFrameRates', 'renderState', 'inputSources', 'enabledFeatures',
    'isSystemKeyboardSupported', 'environmentBlendMode', 'interactionMode',
  ], ['end', 'inputsourceschange', ...INPUT_EVENTS, 'visibilitychange', 'frameratechange']);

  // What is behind an XRSession.
  class Session {
    constructor(mode, features) {
      this._immersive = mode !== 'inline';
      this._eyes = EYES[this._immersive ? sim.settings.eyes : 1];
      this.enabledFeatures = Object.freeze(features);
      this.visibilityState = 'visible';
      this.environmentBlendMode = 'opaque';
      this.interactionMode = this._immersive ? 'world-space' : 'screen-space';
      this.isSystemKeyboardSupported = false;
      this.frameRate = this._immersive ? sim.settings.frame_rate_hz : null;
      this.supportedFrameRates = this._immersive ? new Float32Array([this.frameRate]) : null;
      this._tracked = { list: [] };
      this.inputSources = make(XRInputSourceArray, this._tracked);
      this._render = {
        baseLayer: null, depthNear: 0.1, depthFar: 1000,
        inlineVerticalFieldOfView: this._immersive ? null : Math.PI / 2,
      };
      this.renderState = make(XRRenderState, this._render);
      this._viewer = { session: this, where: (state) => state.head };
      this._sources = Object.fromEntries(HANDS.map((hand) => [hand, sim.inputSource(this, hand)]));
      this._callbacks = new Map();
      this._observers = []; // of the frame that runs
      this._last = 0;
      this._ended = false;
      this.page = make(XRSession, this);
    }
    _settle() {
      if (!this._pending) return;
      this._render = { ...this._render, ...this._pending };
      this.renderState = make(XRRenderState, this._render);
      this._pending = null;
    }

    // Whether the page is ready to be shown frames.
    get _ready() {
      return Boolean((this._pending?.baseLayer ?? this._render.baseLayer) && this._callbacks.size);
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
        const inputSource = this._sources[hand];
        forEach(sim.takeInputs(inputSource, inputs[k]), (type) => {
          if (this._ended) return;
          const frame = frameOf(this, state, false);
          dispatch(this.page, new XRInputSourceEvent(type, { frame, inputSource }));
          own(frame, XRFrame).active = false;
        });
      });
      const { baseLayer, depthNear, depthFar } = this._render;
      sim.beforeFrame();
      this._observers = drawn && baseLayer ? sim.observers : [];
      if (this._observers.length) sim.layer(baseLayer).makeRoom(this._observers);
      const called = this._observers.length ? sim.uncut(() => this._call(state)) : this._call(state);
      if (!called || !drawn || this._ended) return null;
      return sim.layer(baseLayer).read(depthNear, depthFar, this._observers);
    }
    // Runs the callbacks; returns whether there were any.
    _call(state) {
      if (this._ended || !this._render.baseLayer || this._callbacks.size === 0) return false;
      this._running = this._callbacks; // of which one may cancel another
      this._callbacks = new Map();
      const frame = frameOf(this, state, true);
      this._running.forEach((callback) => sim.call(callback, sim.now(), frame));
      this._running = null;
      own(frame, XRFrame).active = false;
      return true;
    }
    _track(state) {
      const before = this._tracked.list;
      const list = map(filter(HANDS, (hand) => state[hand]), (hand) => this._sources[hand]);
      const added = filter(list, (source) => !includes(before, source));
      const removed = filter(before, (source) => !includes(list, source));
      if (added.length + removed.length === 0) return;
      this._tracked.list = list;
      forEach(HANDS, (_, k) => {
        delete this.inputSources[k];
        if (k < list.length) {
          Object.defineProperty(this.inputSources, k, { value: list[k], enumerable: true, configurable: true });
        }
      });
      dispatch(this.page, new XRInputSourcesChangeEvent('inputsourceschange', { session: this.page, added, removed }));
    }
  }

  // Cameras besides the eyes, each {place, fov_deg, width, height, deep}: place null is the head's,
  // deep asks for the depth as well. Drawn in frames that are drawn at all.
  sim.observers = [];
  sim.watchFrom = (rows) => {
    sim.observers = map(rows, ({ place, ...rest }) => ({ place: fromApp(place), ...rest }));
  };

  sim.events = new Set(); // of inputs, to which the page listens
  sim.wishes = new Set(); // features of sessions
  const previews = new Set(); // inline sessions
  sim.preview = () => previews.forEach((session) => {
    session._settle();
    session._call({ head: IDENTITY, eyes_m: 0 });
  });
  // A headset shows nothing of the window while a session runs, and its browser draws no frame of it.
  const { runFrames } = sim;
  sim.runFrames = () => {
    if (sim.settings.window_frames || !sim.session || sim.session._ended) runFrames();
  };
  const supports = (mode) => mode === 'immersive-vr' || mode === 'inline';
  class XRSystem extends EventTarget {
    constructor() { illegal(); }
    async isSessionSupported(mode) {
      own(this, XRSystem);
      needs(1, arguments, 'isSessionSupported');
      const wished = chosen(mode, MODES, 'XRSessionMode');
      sim.modes.add(wished);
      return supports(wished);
    }
    async supportsSession(mode) { // of pages older than isSessionSupported
      if (!(await this.isSessionSupported(mode))) throw new DOMException(mode, 'NotSupportedError');
    }
    async requestSession(mode, options = {}) {
      own(this, XRSystem);
      needs(1, arguments, 'requestSession');
      const wished = chosen(mode, MODES, 'XRSessionMode');
      const { requiredFeatures = [], optionalFeatures = [] } = dictionary(options, 'options');
      const required = map(listOf(requiredFeatures, 'requiredFeatures'), (name) => `${name}`);
      const optional = map(listOf(optionalFeatures, 'optionalFeatures'), (name) => `${name}`);
      sim.modes.add(wished);
      if (wished !== 'inline' && sim.session && !sim.session._ended) throw wrongState('there is a session already');
      const lacking = filter(required, (name) => !includes(FEATURES, name));
      forEach(lacking, (name) => sim.wishes.add(`${name} (required)`));
      if (!supports(wished) || lacking.length) {
        sim.refused = supports(wished) ? `the feature ${lacking[0]}` : `a session of ${wished}`;
        throw new DOMException(`sim2vr has no ${sim.refused}`, 'NotSupportedError');
      }
      const features = [...required, ...optional];
      forEach(features, (name) => sim.wishes.add(`${name}${includes(required, name) ? ' (required)' : ''}`));
      const granted = filter(FEATURES, (name) => includes(features, name));
      if (wished === 'inline') {
        const preview = new Session(wished, [...new Set(['viewer', ...granted])]);
        previews.add(preview);
        return preview.page;
      }
      sim.session = new Session(wished, [...new Set(['viewer', 'local', ...granted])]);
      return sim.session.page;
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
  complete(XRSystem, [], ['devicechange', 'sessiongranted']);
  const system = make(XRSystem, {});
  const userAgent = Object.getOwnPropertyDescriptor(Navigator.prototype, 'userAgent').get;
  Object.defineProperty(Navigator.prototype, 'xr', {
    get() {
      Reflect.apply(userAgent, this, []); // throws for what is no Navigator
      return system;
    },
    configurable: true,
    enumerable: true,
  });
  // A page finds the parts of WebXR that are covered; of all others, not even the names.
  for (const name of Object.getOwnPropertyNames(window)) if (/^XR/.test(name)) delete window[name];
  for (const [name, made] of Object.entries(sim.classes)) {
    define(window, name, made);
  }
  sim.system = system;
}
