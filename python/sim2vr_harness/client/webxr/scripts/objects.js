// Where a page's objects are, by their names: of three.js, A-Frame and Babylon.js, as they are.
{
  const scenes = new Set();
  sim.threeScenes = () => filter(map([...scenes], (reference) => reference.deref()), Boolean);
  const tools = new EventTarget(); // three.js tells its developer tools of every scene
  tools.addEventListener('observe', ({ detail }) => {
    if (detail?.isScene) scenes.add(new WeakRef(detail));
  });
  tools.addEventListener('register', ({ detail }) => { sim.revision = detail?.revision; });
  Object.defineProperty(window, '__THREE_DEVTOOLS__', { value: tools, configurable: true });

  // Babylon.js has no such hook, and a bundled one no global: each of its engines sets this property
  // of itself, before anything else of its canvas.
  const engines = new Set();
  Object.defineProperty(window.Object.prototype, '_renderingCanvas', {
    configurable: true,
    get() { return undefined; },
    set(value) {
      Object.defineProperty(this, '_renderingCanvas', { value, configurable: true, enumerable: true, writable: true });
      engines.add(new WeakRef(this));
    },
  });
  sim.babylonScenes = () => {
    const found = new Set(window.BABYLON?.EngineStore?.Instances ?? []);
    for (const reference of engines) found.add(reference.deref());
    return [...found].flatMap((one) => (Array.isArray(one?.scenes) ? one.scenes : []));
  };

  // Runs a frame in which engines leave out nothing that the eyes do not see: others look on.
  sim.uncut = (frame) => {
    const changed = [];
    const set = (object, name, value) => {
      if (object[name] === undefined || object[name] === value) return;
      push(changed, [object, name, object[name]]);
      object[name] = value;
    };
    for (const scene of sim.threeScenes()) scene.traverse((object) => set(object, 'frustumCulled', false));
    for (const scene of sim.babylonScenes()) {
      for (const mesh of scene.meshes) set(mesh, 'alwaysSelectAsActiveMesh', true);
    }
    try {
      return frame();
    } finally {
      forEach(changed, ({ 0: object, 1: name, 2: value }) => { object[name] = value; });
    }
  };

  sim.babylonVersion = () => {
    for (const reference of engines) {
      const known = reference.deref()?.constructor?.Version;
      if (known) return known;
    }
    return window.BABYLON?.Engine?.Version;
  };

  // From the page's world to the user's space, whose origin lies on the floor: a page may carry its
  // user about, or measure heights from the eyes. (4, 4) by columns, right-handed.
  const NEAR_M = 0.01;
  const product = (a, b) => map(Array.from({ length: 16 }), (_, k) => {
    let sum = 0;
    for (let j = 0; j < 4; j++) sum += a[(k % 4) + 4 * j] * b[j + 4 * Math.floor(k / 4)];
    return sum;
  });
  const inverted = (e) => { // of a turn with a scale, and a shift
    const minor = (i, j) => {
      const [a, b, c, d] = [(i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3];
      return e[a + 4 * c] * e[b + 4 * d] - e[a + 4 * d] * e[b + 4 * c];
    };
    const size = e[0] * minor(0, 0) + e[4] * minor(0, 1) + e[8] * minor(0, 2);
    const found = [...UNMOVED];
    for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) found[j + 4 * i] = minor(i, j) / size;
    for (let i = 0; i < 3; i++) {
      found[12 + i] = -(found[i] * e[12] + found[4 + i] * e[13] + found[8 + i] * e[14]);
    }
    return found;
  };
  const UNMOVED = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  // What carries the camera that the headset moves.
  const rigOf = () => {
    const { p } = sim.viewed.head;
    for (const scene of sim.threeScenes()) {
      const cameras = [];
      scene.traverse((object) => object.isCamera && push(cameras, object));
      for (const camera of cameras) {
        for (let each = camera; each?.parent; each = each.parent) {
          const { x, y, z } = each.position;
          if (Math.hypot(x - p[0], y - p[1], z - p[2]) < NEAR_M) return each.parent;
        }
      }
    }
    return null;
  };
  sim.userSpace = () => {
    if (!sim.viewed) return UNMOVED;
    const rig = rigOf();
    rig?.updateWorldMatrix(true, false);
    const base = [...sim.spaces.transformOf(sim.viewed.base).matrix];
    const found = rig ? product(base, inverted(rig.matrixWorld.elements)) : base;
    return every(found, Number.isFinite) ? found : UNMOVED;
  };
  // A point, or with w 0 a direction, moved by a matrix; and then in the app's frame.
  sim.moved = (e, { 0: x, 1: y, 2: z }, w = 1) =>
    map([0, 1, 2], (row) => e[row] * x + e[row + 4] * y + e[row + 8] * z + e[row + 12] * w);
  sim.forUser = (e, point, w = 1) => {
    const at = sim.moved(e, point, w);
    return [at[0], at[1], -at[2]];
  };
  sim.product = product;

  const ofThree = (object) => {
    object.updateWorldMatrix(true, false);
    return sim.forUser(sim.userSpace(), object.matrixWorld.elements.slice(12, 15));
  };
  const ofBabylon = (node) => {
    node.computeWorldMatrix?.(true);
    const { x, y, z } = node.getAbsolutePosition();
    return sim.forUser(sim.userSpace(), [x, y, node.getScene().useRightHandedSystem ? z : -z]);
  };
  sim.colorOfBabylon = ({ material }) => material?.diffuseColor ?? material?.albedoColor;
  sim.looksOfBabylon = (mesh) => {
    const { r, g, b } = sim.colorOfBabylon(mesh) ?? {};
    return [r, g, b, mesh.scaling, mesh.position, mesh.visibility];
  };
  const named = (name) => {
    const element = window.AFRAME && document.getElementById(name);
    if (element?.object3D) return ofThree(element.object3D);
    for (const scene of sim.threeScenes()) {
      const found = scene.getObjectByName(name);
      if (found) return ofThree(found);
    }
    for (const scene of sim.babylonScenes()) {
      const found = scene.getNodeByName(name);
      if (found) return ofBabylon(found);
    }
    return null;
  };
  const names = () => {
    const found = [];
    for (const scene of sim.threeScenes()) scene.traverse((object) => object.name && found.push(object.name));
    for (const scene of sim.babylonScenes()) {
      for (const node of scene.getNodes()) found.push(node.name);
    }
    for (const element of document.querySelectorAll('a-scene [id]')) {
      if (element.object3D) found.push(element.id);
    }
    return [...new Set(found)];
  };
  sim.names = names;
  // Position of a named object, x y z in metres, in the app's frame (left-handed, z forward).
  sim.locate = (name) => {
    const found = named(name);
    if (found) return found;
    const known = names();
    const list = known.length ? known.slice(0, 20).join(', ') : 'none';
    throw new Error(`no object ${JSON.stringify(name)}; objects with names: ${list}`);
  };
}
