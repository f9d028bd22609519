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

  class XRRigidTransform {
    constructor(position = {}, orientation = { w: 1 }) {
      const { x = 0, y = 0, z = 0 } = position ?? {};
      const q = map(['x', 'y', 'z'], (axis) => orientation?.[axis] ?? 0);
      push(q, orientation?.w ?? 1);
      const length = Math.hypot(q[0], q[1], q[2], q[3]);
      if (!(length > 0)) throw new DOMException('orientation of length 0', 'InvalidStateError');
      this._pose = { p: [x, y, z], q: map(q, (part) => part / length) };
    }
    static _of(pose) {
      const made = Object.create(XRRigidTransform.prototype);
      made._pose = pose;
      return made;
    }
    get position() {
      const { 0: x, 1: y, 2: z } = this._pose.p;
      return (this._position ??= new DOMPointReadOnly(x, y, z, 1));
    }
    get orientation() {
      const { 0: x, 1: y, 2: z, 3: w } = this._pose.q;
      return (this._orientation ??= new DOMPointReadOnly(x, y, z, w));
    }
    get matrix() { return (this._matrix ??= matrixOf(this._pose)); }
    get inverse() { return (this._inverse ??= XRRigidTransform._of(inverse(this._pose))); }
  }

  class XRPose {
    constructor(pose) {
      this.transform = XRRigidTransform._of(pose);
      this.emulatedPosition = false;
      this.linearVelocity = null;
      this.angularVelocity = null;
    }
  }

  // A space is where a function of the device's state says; null: not tracked.
  class XRSpace extends EventTarget {
    constructor(where) {
      super();
      this._where = where;
    }
  }
  class XRReferenceSpace extends XRSpace {
    constructor(where, bounds) {
      super(where);
      this.onreset = null;
      if (bounds) this.boundsGeometry = bounds;
    }
    getOffsetReferenceSpace(offset) {
      return new this.constructor((state) => compose(this._where(state), offset._pose), this.boundsGeometry);
    }
  }
  class XRBoundedReferenceSpace extends XRReferenceSpace {}

  // The app's frame is left-handed with z forward: position (x, y, -z), rotation (-x, -y, z, w).
  const fromApp = (row) => row && {
    p: [row[0], row[1], -row[2]],
    q: [-row[3], -row[4], row[5], row[6]],
  };
  sim.spaces = { compose, inverse, fromApp, IDENTITY };
  sim.classes = { XRRigidTransform, XRPose, XRSpace, XRReferenceSpace, XRBoundedReferenceSpace };
}
