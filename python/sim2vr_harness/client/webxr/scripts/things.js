// What a page's people can do something with: objects that listen, and those that rays are tested
// against. For audits: the first call of `sim.things` attaches counters to the page's objects.
{
  const EVENTS = new RegExp('^(click|fusing|(mouse|pointer|touch|select|squeeze|grip|trigger)[a-z]*|hover.*|grab.*|'
    + 'drag.*|stretch.*|activate.*|hit.*|raycaster-intersected.*|obbcollision.*|pinch.*)$');
  const ABLE = '[grabbable], [clickable], [hoverable], [draggable], [droppable], [stretchable], [link], '
    + '[onclick], [onmousedown], [onmouseenter], [onmouseover], [ondragstart], [gui-interactable]';
  const CARRIED = '[raycaster], [cursor], [camera], [tracked-controls], [hand-controls], [hand-tracking-controls], '
    + '[laser-controls], [oculus-touch-controls], [meta-touch-controls], [super-hands]';
  const MOST = 200;
  const listen = EventTarget.prototype.addEventListener; // the browser's: what counts is not heard
  const heard = new WeakMap(); // element -> types of events that the page listens to
  const tested = new WeakMap(); // three.js object -> how often a ray has met it
  const counts = new WeakMap(); // object or element -> events so far
  const wrapped = new WeakSet(); // prototypes whose raycast is watched
  sim.heard = (target, type) => {
    if (!(target instanceof Element) || !target.tagName.startsWith('A-') || !EVENTS.test(type)) return;
    if (!heard.has(target)) heard.set(target, new Set());
    heard.get(target).add(type);
  };

  const count = (thing) => void counts.set(thing, (counts.get(thing) ?? 0) + 1);
  const counted = (thing, types, add) => {
    if (counts.has(thing)) return;
    counts.set(thing, 0);
    for (const type of types) add(type, () => count(thing));
  };
  // Has rays note which objects they are tested against, and which of these they meet.
  const watchRays = (object) => {
    let owner = object;
    while (owner && !Object.hasOwn(owner, 'raycast')) owner = Object.getPrototypeOf(owner);
    if (!owner || wrapped.has(owner) || owner === object) return;
    wrapped.add(owner);
    const { raycast } = owner;
    owner.raycast = function (caster, found) {
      const before = found.length;
      const result = Reflect.apply(raycast, this, [caster, found]);
      tested.set(this, (tested.get(this) ?? 0) + (found.length > before ? 1 : 0));
      return result;
    };
  };

  const corner = (e, x, y, z) => [
    e[0] * x + e[4] * y + e[8] * z + e[12],
    e[1] * x + e[5] * y + e[9] * z + e[13],
    e[2] * x + e[6] * y + e[10] * z + e[14],
  ];
  // Middle and half of the size of what is drawn below an object, in the app's frame.
  const boxOf = (object) => {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    object.updateWorldMatrix(true, true);
    object.traverseVisible((part) => {
      const places = part.geometry?.attributes?.position;
      if (!places?.count || !part.geometry.computeBoundingBox) return;
      if (!part.geometry.boundingBox) part.geometry.computeBoundingBox();
      const { min, max } = part.geometry.boundingBox;
      for (let k = 0; k < 8; k++) {
        const at = corner(part.matrixWorld.elements, k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
        forEach(at, (value, axis) => {
          low[axis] = Math.min(low[axis], value);
          high[axis] = Math.max(high[axis], value);
        });
      }
    });
    if (!every([...low, ...high], Number.isFinite)) return null;
    const middle = map(low, (value, axis) => (value + high[axis]) / 2);
    return [[middle[0], middle[1], -middle[2]], map(low, (value, axis) => (high[axis] - value) / 2)];
  };
  const shown = (object) => {
    for (let each = object; each; each = each.parent) if (!each.visible) return false;
    return true;
  };
  // What of an object people may notice: where it is, and how it looks.
  const stateOf = (object) => {
    const state = [];
    object.traverse((part) => {
      for (const material of [part.material].flat()) {
        push(state, material?.color?.getHex?.(), material?.emissive?.getHex?.(), material?.opacity, material?.map?.uuid);
      }
      push(state, part.visible, part.text, part.children.length);
      forEach([...part.matrix.elements], (value) => push(state, Math.round(value * 1e3)));
    });
    return hash(JSON.stringify(state));
  };
  const hash = (text) => {
    let found = 5381;
    for (let k = 0; k < text.length; k++) found = (found * 33 + text.charCodeAt(k)) % 4294967291;
    return found;
  };

  const ofElements = (rows) => {
    const rays = [...document.querySelectorAll('[raycaster]')].map((one) => one.components?.raycaster?.data.objects);
    const aims = [...document.querySelectorAll('[raycaster], [cursor]')];
    const gaze = aims.length > 0 && aims.every((one) => one.closest('[camera], a-camera'));
    const selector = rays.filter((one) => one).join(', ');
    for (const element of document.querySelectorAll('a-scene *')) {
      const object = element.object3D;
      if (!object || element.closest(CARRIED) || element.querySelector(CARRIED)) continue;
      const types = heard.get(element) ?? new Set();
      const chosen = selector && element.matches(selector);
      const listens = types.size || chosen || element.matches(ABLE);
      if (!listens && (!element.id || !object.children.length)) continue;
      const all = [...types, 'click', 'raycaster-intersected', 'grab-start', 'hover-start', 'hit', 'hitstart', 'link'];
      counted(element, new Set(all), (type, call) => Reflect.apply(listen, element, [type, call]));
      const name = element.id || element.getAttribute('name') || element.className.toString().split(' ')[0]
        || element.tagName.toLowerCase();
      const touched = [...types].some((type) => /^(hit|obb|grab|hover-start|pinch|drag)/.test(type))
        || element.matches('[grabbable], [hoverable], [draggable]');
      const how = gaze ? 'look' : touched ? 'touch' : 'point';
      push(rows, [object, name, listens ? how : 'unknown', counts.get(element)]);
    }
  };
  const ofThree = (rows) => {
    for (const reference of sim.scenes) {
      const visit = (object) => {
        if (object.hasLinearVelocity !== undefined || object.isCamera) return; // a controller, the head
        if (object.isMesh || object.isSprite || object.isPoints) watchRays(object);
        const own = object._listeners ?? {};
        const types = Object.keys(own).filter((type) => EVENTS.test(type) && own[type].length);
        const handlers = object.__r3f?.eventCount > 0;
        if (types.length) counted(object, types, (type, call) => object.addEventListener(type, call));
        const listens = types.length > 0 || handlers;
        const drawn = object.isMesh || object.isSprite;
        if (!object.el && (listens || (drawn && (tested.has(object) || object.name)))) {
          const how = listens || tested.has(object) ? 'point' : 'unknown';
          push(rows, [object, object.name || object.type, how, (counts.get(object) ?? 0) + (tested.get(object) ?? 0)]);
        }
        forEach(object.children, visit);
      };
      const scene = reference.deref();
      if (scene) visit(scene);
    }
  };
  const ofBabylon = (found) => {
    for (const scene of window.BABYLON?.EngineStore?.Instances?.flatMap((one) => one.scenes) ?? []) {
      for (const mesh of scene.meshes) {
        if (!mesh.isEnabled() || !mesh.isVisible || !mesh.getTotalVertices()) continue;
        const actions = mesh.actionManager?.actions ?? [];
        const drags = (mesh.behaviors ?? []).some((one) => /Drag|Manipul/.test(one.name));
        const near = mesh.isNearPickable || mesh.isNearGrabbable;
        if (!counts.has(mesh)) {
          counts.set(mesh, 0);
          for (const action of actions) action.onBeforeExecuteObservable?.add(() => count(mesh));
        }
        const { minimumWorld: low, maximumWorld: high } = mesh.getBoundingInfo().boundingBox;
        const side = scene.useRightHandedSystem ? -1 : 1;
        const how = near ? 'touch' : actions.length || drags ? 'point' : 'unknown';
        const { x, y, z } = mesh.material?.diffuseColor ?? mesh.material?.albedoColor ?? {};
        push(found, [mesh.name, how,
          [(low.x + high.x) / 2, (low.y + high.y) / 2, side * (low.z + high.z) / 2],
          [(high.x - low.x) / 2, (high.y - low.y) / 2, (high.z - low.z) / 2],
          counts.get(mesh), hash(JSON.stringify([x, y, z, mesh.scaling, mesh.position, mesh.visibility]))]);
      }
    }
  };
  // Rows of name, how (touch, point, look or unknown), middle, half of the size, events so far, and
  // a number that changes with how it looks; things of a name are numbered.
  sim.things = () => {
    const objects = [];
    const found = [];
    ofElements(objects);
    ofThree(objects);
    for (const { 0: object, 1: name, 2: how, 3: events } of objects) {
      const box = shown(object) && boxOf(object);
      if (box) push(found, [name, how, ...box, events, stateOf(object)]);
    }
    ofBabylon(found);
    const known = new Map();
    forEach(found, (row) => {
      const again = (known.get(row[0]) ?? 0) + 1;
      known.set(row[0], again);
      row[0] = slice(again > 1 ? `${row[0]} (${again})` : row[0], 0, 60);
    });
    return found.slice(0, MOST);
  };
}
