// Where a page's objects are, by their names: of three.js, A-Frame and Babylon.js, as they are.
{
  const scenes = new Set();
  sim.scenes = scenes;
  const tools = new EventTarget(); // three.js tells its developer tools of every scene
  tools.addEventListener('observe', ({ detail }) => {
    if (detail?.isScene) scenes.add(new WeakRef(detail));
  });
  tools.addEventListener('register', ({ detail }) => { sim.revision = detail?.revision; });
  Object.defineProperty(window, '__THREE_DEVTOOLS__', { value: tools, configurable: true });

  const ofThree = (object) => {
    object.updateWorldMatrix(true, false);
    const e = object.matrixWorld.elements;
    return [e[12], e[13], -e[14]];
  };
  const ofBabylon = (node) => {
    node.computeWorldMatrix?.(true);
    const { x, y, z } = node.getAbsolutePosition();
    return [x, y, node.getScene().useRightHandedSystem ? -z : z];
  };
  const named = (name) => {
    const element = window.AFRAME && document.getElementById(name);
    if (element?.object3D) return ofThree(element.object3D);
    for (const reference of scenes) {
      const found = reference.deref()?.getObjectByName(name);
      if (found) return ofThree(found);
    }
    for (const scene of window.BABYLON?.EngineStore?.Instances?.flatMap((one) => one.scenes) ?? []) {
      const found = scene.getNodeByName(name);
      if (found) return ofBabylon(found);
    }
    return null;
  };
  const names = () => {
    const found = [];
    for (const reference of scenes) {
      reference.deref()?.traverse((object) => object.name && found.push(object.name));
    }
    for (const scene of window.BABYLON?.EngineStore?.Instances?.flatMap((one) => one.scenes) ?? []) {
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
