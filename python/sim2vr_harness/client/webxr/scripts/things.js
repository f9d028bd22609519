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
  const attached = new WeakMap(); // object or element -> types of events that are counted
  const counted = (thing, types, add) => {
    if (!attached.has(thing)) attached.set(thing, new Set());
    const known = attached.get(thing);
    for (const type of types) {
      if (known.has(type)) continue;
      known.add(type);
      add(type, () => count(thing));
    }
  };
  // Events that attributes of a document's element listen to, such as onclick.
  const attributes = (element) => filter(
    map([...element.attributes], ({ name }) => (/^on/.test(name) ? name.slice(2) : '')),
    (type) => EVENTS.test(type),
  );
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
      sim.ray?.(caster);
      tested.set(this, (tested.get(this) ?? 0) + (found.length > before ? 1 : 0));
      return result;
    };
  };

  // Middle and half of the size of what is drawn below an object, in the app's frame.
  const boxOf = (object, user) => {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    object.updateWorldMatrix(true, true);
    object.traverseVisible((part) => {
      const places = part.geometry?.attributes?.position;
      if (!places?.count || !part.geometry.computeBoundingBox) return;
      if (!part.geometry.boundingBox) part.geometry.computeBoundingBox();
      const { min, max } = part.geometry.boundingBox;
      const e = sim.product(user, part.matrixWorld.elements);
      for (let k = 0; k < 8; k++) {
        const at = sim.moved(e, [k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z]);
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
  const looks = (part) => {
    const state = [part.visible, part.text, part.children?.length];
    for (const material of [part.material].flat()) {
      const { color, emissive, opacity, map: image, wireframe, uniforms } = material ?? {};
      push(state, color?.getHex?.(), emissive?.getHex?.(), opacity, wireframe, image?.uuid, image?.version);
      for (const { value } of Object.values(uniforms ?? {})) {
        push(state, typeof value === 'number' ? value : value?.getHex?.() ?? value?.uuid);
      }
    }
    const places = part.geometry?.attributes?.position;
    push(state, part.geometry?.uuid, places?.count, places?.version);
    forEach([...part.matrix?.elements ?? []], (value) => push(state, Math.round(value * 1e3)));
    return state;
  };
  // What of an object people may notice: where it is, and how it looks.
  const stateOf = (object) => {
    const state = [];
    object.traverse((part) => push(state, ...looks(part)));
    return hash(JSON.stringify(state));
  };
  const hash = (text) => {
    let found = 5381;
    for (let k = 0; k < text.length; k++) found = (found * 33 + text.charCodeAt(k)) % 4294967291;
    return found;
  };

  // A cursor on the scene itself is the mouse: it carries nothing.
  const carriedBy = (element) => {
    const carrier = element.closest(CARRIED);
    return carrier !== null && !carrier.isScene;
  };
  const ofElements = (rows) => {
    const rays = [...document.querySelectorAll('[raycaster]')].map((one) => one.components?.raycaster?.data.objects);
    const aims = [...document.querySelectorAll('[raycaster], [cursor]')].filter((one) => !one.isScene);
    const gaze = aims.length > 0 && aims.every((one) => one.closest('[camera], a-camera'));
    const selector = rays.filter((one) => one).join(', ');
    for (const element of document.querySelectorAll('a-scene *')) {
      const object = element.object3D;
      if (!object || carriedBy(element) || element.querySelector(CARRIED)) continue;
      const types = new Set([...heard.get(element) ?? [], ...attributes(element)]);
      const chosen = selector && element.matches(selector);
      const listens = types.size || chosen || element.matches(ABLE);
      if (!listens && (!element.id || !object.children.length)) continue;
      counted(element, types, (type, call) => listen(element, type, call)); // not heard as the page's
      const name = element.id || element.getAttribute('name') || element.className.toString().split(' ')[0]
        || element.tagName.toLowerCase();
      const touched = [...types].some((type) => /^(hit|obb|grab|hover-start|pinch|drag)/.test(type))
        || element.matches('[grabbable], [hoverable], [draggable]');
      const how = gaze ? 'look' : touched ? 'touch' : 'point';
      push(rows, [object, name, listens ? how : 'unknown', counts.get(element) ?? 0]);
    }
  };
  const ofThree = (rows) => {
    for (const scene of sim.threeScenes()) {
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
          push(rows, [object, object.name || object.type, how, counts.get(object) ?? 0]);
        }
        forEach(object.children ?? [], visit);
      };
      visit(scene);
    }
  };
  const ofBabylon = (found, user) => {
    for (const scene of sim.babylonScenes()) {
      for (const mesh of scene.meshes) {
        if (!mesh.isEnabled() || !mesh.isVisible || !mesh.getTotalVertices()) continue;
        const actions = mesh.actionManager?.actions ?? [];
        const drags = (mesh.behaviors ?? []).some((one) => /Drag|Manipul/.test(one.name));
        const near = mesh.isNearPickable || mesh.isNearGrabbable;
        counted(mesh, actions, (action, call) => action.onBeforeExecuteObservable?.add(call));
        const { minimumWorld: low, maximumWorld: high } = mesh.getBoundingInfo().boundingBox;
        const side = scene.useRightHandedSystem ? -1 : 1;
        const how = near ? 'touch' : actions.length || drags ? 'point' : 'unknown';
        push(found, [nameOf(mesh, mesh.name), how,
          sim.forUser(user, [(low.x + high.x) / 2, (low.y + high.y) / 2, -side * (low.z + high.z) / 2]),
          [(high.x - low.x) / 2, (high.y - low.y) / 2, (high.z - low.z) / 2],
          counts.get(mesh) ?? 0, hash(JSON.stringify(sim.looksOfBabylon(mesh)))]);
      }
    }
  };
  // Things of a name are numbered, for good: also while others of that name are hidden.
  const names = new WeakMap();
  const numbers = new Map();
  const nameOf = (thing, name) => {
    if (!names.has(thing)) {
      const number = (numbers.get(name) ?? 0) + 1;
      numbers.set(name, number);
      names.set(thing, slice(number > 1 ? `${name} (${number})` : name, 0, 60));
    }
    return names.get(thing);
  };
  // Rows of name, how (touch, point, look or unknown), middle, half of the size, events so far, and
  // a number that changes with how it looks.
  sim.things = () => {
    const objects = [];
    const found = [];
    ofElements(objects);
    ofThree(objects);
    const user = sim.userSpace();
    for (const { 0: object, 1: plain, 2: how, 3: events } of objects) {
      if (found.length >= MOST) break; // measuring 100,000 objects takes longer than a frame
      const name = nameOf(object, plain);
      const box = shown(object) && boxOf(object, user);
      if (box) push(found, [name, how, ...box, events, stateOf(object)]);
    }
    ofBabylon(found, user);
    return found.slice(0, MOST);
  };
  Object.assign(sim, { hash, looks, CARRIED });
}
