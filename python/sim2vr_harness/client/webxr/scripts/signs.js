// What people may notice of a page that is used: for audits, which try things.
{
  const MOST = 1000; // objects
  const MOST_RAYS = 16;
  const MOST_TEXT = 20000;
  const numbers = new WeakMap(); // object -> its number
  let last = 0;
  const numberOf = (object) => {
    if (!numbers.has(object)) numbers.set(object, ++last);
    return numbers.get(object);
  };
  let rays = new Map(); // of the last frame in which rays were tested, as text -> caster's ray
  let at = -1;
  sim.ray = ({ ray }) => {
    if (sim.now() !== at) rays = new Map();
    at = sim.now();
    if (!ray || rays.size >= MOST_RAYS) return;
    const row = map([ray.origin, ray.direction], ({ x, y, z }) => [x, y, z]);
    rays.set(JSON.stringify(row), row);
  };
  sim.sounds = 0;
  const counting = (owner, name) => {
    const original = owner?.prototype[name];
    if (!original) return;
    owner.prototype[name] = function (...args) {
      sim.sounds += 1;
      return Reflect.apply(original, this, args);
    };
  };
  counting(window.AudioScheduledSourceNode, 'start');
  counting(window.AudioBufferSourceNode, 'start');
  counting(window.HTMLMediaElement, 'play');
  counting(window.HTMLMediaElement, 'pause');

  const carried = (object) => object.isCamera || object.hasLinearVelocity !== undefined
    || Boolean(!object.el?.isScene && object.el?.matches?.(sim.CARRIED));
  const visit = (object, found) => {
    if (carried(object) || found.length >= MOST) return;
    push(found, [numberOf(object), sim.hash(JSON.stringify(sim.looks(object)))]);
    forEach(object.children ?? [], (child) => visit(child, found));
  };
  // Numbers of objects and of how they look, sounds so far, a number that changes with the document's
  // text, and the rays of the last frame that tested any: origin and direction, the app's frame.
  sim.signs = () => {
    const found = [];
    for (const scene of sim.threeScenes()) visit(scene, found);
    for (const scene of sim.babylonScenes()) {
      for (const mesh of scene.meshes.slice(0, MOST - found.length)) {
        push(found, [numberOf(mesh), sim.hash(JSON.stringify([...sim.looksOfBabylon(mesh), mesh.isEnabled()]))]);
      }
    }
    const user = sim.userSpace();
    const aims = map([...rays.values()], ({ 0: from, 1: towards }) => [
      sim.forUser(user, from), sim.forUser(user, towards, 0),
    ]);
    const text = slice(document.body?.textContent ?? '', 0, MOST_TEXT);
    return [Object.fromEntries(found), sim.sounds, sim.hash(text), aims];
  };
}
