// Poses and spaces of WebXR: right-handed, x right, y up, z backward, metres, rotations x y z w.
{
  const multiply = (a, b) => [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  ];
  const turned = (q, v) => {
    const x = q[1] * v[2] - q[2] * v[1];
    const y = q[2] * v[0] - q[0] * v[2];
    const z = q[0] * v[1] - q[1] * v[0];
    return [
      v[0] + 2 * (q[3] * x + q[1] * z - q[2] * y),
      v[1] + 2 * (q[3] * y + q[2] * x - q[0] * z),
      v[2] + 2 * (q[3] * z + q[0] * y - q[1] * x),
    ];
  };
  // A pose: {p: [x, y, z], q: [x, y, z, w]}.
  const compose = (a, b) => {
    const p = turned(a.q, b.p);
    return { p: [a.p[0] + p[0], a.p[1] + p[1], a.p[2] + p[2]], q: multiply(a.q, b.q) };
  };
  const inverse = (a) => {
    const q = [-a.q[0], -a.q[1], -a.q[2], a.q[3]];
    const p = turned(q, a.p);
    return { p: [-p[0], -p[1], -p[2]], q };
  };
  const IDENTITY = { p: [0, 0, 0], q: [0, 0, 0, 1] };
  const matrixOf = ({ p, q: { 0: x, 1: y, 2: z, 3: w } }) => new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w), 0,
    2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w), 0,
    2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y), 0,
    p[0], p[1], p[2], 1,
  ]);

  // Classes as Web IDL has them. What is behind an object that a page holds is kept here, so that it
  // has no members but its interface's, and those say no to objects of another kind.
  const records = new WeakMap(); // object -> {of: its class, and the values of its attributes}
  const is = (object, Class) => {
    for (let each = records.get(object)?.of; each; each = Object.getPrototypeOf(each)) {
      if (each === Class) return true;
    }
    return false;
  };
  const own = (object, Class) => {
    if (is(object, Class)) return records.get(object);
    throw new TypeError('Illegal invocation');
  };
  // An argument, or a member of a dictionary, that has to be an object of a class.
  const taken = (object, Class, what) => {
    if (is(object, Class)) return records.get(object);
    throw new TypeError(`${what} is not of type '${Class.name}'`);
  };
  const dictionary = (value, what) => {
    if (value === undefined || value === null) return {};
    if (typeof value === 'object' || typeof value === 'function') return value;
    throw new TypeError(`${what} is not an object`);
  };
  const number = (value, what) => {
    const found = +value; // throws at what is no number, as of a symbol
    if (Number.isFinite(found)) return found;
    throw new TypeError(`${what} is not a finite number`);
  };
  const needs = (count, args, what) => {
    if (args.length < count) throw new TypeError(`${what}: ${count} arguments required, but only ${args.length} present`);
  };
  const record = (object, Class, values) => {
    values.of = Class;
    records.set(object, values);
    return object;
  };
  const make = (Class, values) => {
    const target = Class.prototype instanceof EventTarget;
    const made = target ? Reflect.construct(EventTarget, [], Class) : Object.create(Class.prototype);
    return record(made, Class, values);
  };
  const illegal = () => { throw new TypeError('Illegal constructor'); };
  // Gives a class its attributes and event handlers, and all of its members what they have in a browser.
  const complete = (Class, attributes = [], handlers = []) => {
    const { prototype } = Class;
    forEach(attributes, (name) => Object.defineProperty(prototype, name, {
      ...Object.getOwnPropertyDescriptor({ get [name]() { return own(this, Class)[name]; } }, name),
      set: undefined,
    }));
    forEach(handlers, (type) => {
      const name = `on${type}`;
      Object.defineProperty(prototype, name, Object.getOwnPropertyDescriptor({
        get [name]() { return own(this, Class)[name]?.handler ?? null; },
        set [name](value) {
          const behind = own(this, Class);
          const handler = typeof value === 'function' || (typeof value === 'object' && value) ? value : null;
          if (behind[name] && handler) {
            behind[name].handler = handler; // keeps its place among the listeners
            return;
          }
          if (behind[name]) unlisten(this, type, behind[name].listener);
          behind[name] = handler && {
            handler,
            listener: (event) => {
              const given = behind[name].handler;
              if (typeof given === 'function' && Reflect.apply(given, this, [event]) === false) event.preventDefault();
            },
          };
          if (handler) listen(this, type, behind[name].listener);
        },
      }, name));
    });
    forEach(Reflect.ownKeys(prototype), (name) => {
      if (name !== 'constructor' && typeof name === 'string') Object.defineProperty(prototype, name, { enumerable: true });
    });
    forEach(Reflect.ownKeys(Class), (name) => {
      if (name !== 'prototype' && name !== 'length' && name !== 'name') Object.defineProperty(Class, name, { enumerable: true });
    });
    Object.defineProperty(prototype, Symbol.toStringTag, { value: Class.name, configurable: true });
    sim.classes[Class.name] = Class;
  };
  sim.classes = {};

  class XRRigidTransform {
    constructor(position = {}, orientation = {}) {
      const part = (from, axis, usual, what) => (from[axis] === undefined ? usual : number(from[axis], `${what}.${axis}`));
      const place = dictionary(position, 'position');
      const turn = dictionary(orientation, 'orientation');
      const p = map(['x', 'y', 'z'], (axis) => part(place, axis, 0, 'position'));
      if (part(place, 'w', 1, 'position') !== 1) throw new TypeError('position.w is not 1');
      const q = map(['x', 'y', 'z', 'w'], (axis, k) => part(turn, axis, k === 3 ? 1 : 0, 'orientation'));
      const length = Math.hypot(q[0], q[1], q[2], q[3]);
      if (!(length > 0)) throw new DOMException('orientation of length 0', 'InvalidStateError');
      record(this, XRRigidTransform, { pose: { p, q: map(q, (each) => each / length) } });
    }
    get position() {
      const behind = own(this, XRRigidTransform);
      const { 0: x, 1: y, 2: z } = behind.pose.p;
      return (behind.position ??= new DOMPointReadOnly(x, y, z, 1));
    }
    get orientation() {
      const behind = own(this, XRRigidTransform);
      const { 0: x, 1: y, 2: z, 3: w } = behind.pose.q;
      return (behind.orientation ??= new DOMPointReadOnly(x, y, z, w));
    }
    get matrix() {
      const behind = own(this, XRRigidTransform);
      if (!behind.matrix?.length) behind.matrix = matrixOf(behind.pose); // a page may detach it
      return behind.matrix;
    }
    get inverse() {
      const behind = own(this, XRRigidTransform);
      return (behind.inverse ??= make(XRRigidTransform, { pose: inverse(behind.pose), inverse: this }));
    }
  }
  Object.defineProperty(XRRigidTransform, 'length', { value: 0 });
  complete(XRRigidTransform);
  const transformOf = (pose) => make(XRRigidTransform, { pose });

  class XRPose { constructor() { illegal(); } }
  complete(XRPose, ['transform', 'linearVelocity', 'angularVelocity', 'emulatedPosition']);
  const poseValues = (pose) => ({
    transform: transformOf(pose), linearVelocity: null, angularVelocity: null, emulatedPosition: false,
  });

  // A space is where a function of the device's state says; null: not tracked.
  class XRSpace extends EventTarget { constructor() { illegal(); } }
  complete(XRSpace);
  class XRReferenceSpace extends XRSpace {
    getOffsetReferenceSpace(originOffset) {
      const { of, session, where, boundsGeometry } = own(this, XRReferenceSpace);
      const { pose } = taken(originOffset, XRRigidTransform, 'originOffset');
      const back = inverse(pose);
      return make(of, {
        session,
        where: (state) => {
          const origin = where(state);
          return origin && compose(origin, pose);
        },
        boundsGeometry: boundsGeometry && Object.freeze(map(boundsGeometry, ({ x, y, z }) => {
          const { p } = compose(back, { p: [x, y, z], q: IDENTITY.q });
          return new DOMPointReadOnly(p[0], p[1], p[2], 1);
        })),
      });
    }
  }
  complete(XRReferenceSpace, [], ['reset']);
  class XRBoundedReferenceSpace extends XRReferenceSpace {}
  complete(XRBoundedReferenceSpace, ['boundsGeometry']);

  // The app's frame is left-handed with z forward: position (x, y, -z), rotation (-x, -y, z, w).
  const fromApp = (row) => row && {
    p: [row[0], row[1], -row[2]],
    q: [-row[3], -row[4], row[5], row[6]],
  };
  sim.spaces = { compose, inverse, fromApp, transformOf, poseValues, IDENTITY };
  sim.idl = { complete, dictionary, illegal, is, make, needs, number, own, record, taken };
}
