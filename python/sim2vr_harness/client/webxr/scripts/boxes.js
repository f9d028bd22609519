// What a page shows, as boxes: pictures from outside show them beside the body.
{
  const MOST = 500;
  const size = (low, high, scale) => map(['x', 'y', 'z'], (axis) => Math.abs((high[axis] - low[axis]) * scale[axis]));
  // Of a right-handed frame in the app's, and back.
  const mirrored = ([x, y, z], [i, j, k, w]) => [[x, y, -z], [-i, -j, k, w]];
  const nameOf = (object) => {
    for (let each = object; each; each = each.parent) if (each.el?.id || each.name) return each.el?.id || each.name;
    return object.type;
  };
  const localBox = (mesh) => {
    const { geometry } = mesh;
    if (!geometry?.attributes?.position?.count || !geometry.computeBoundingBox) return null;
    const owner = mesh.isInstancedMesh ? mesh : geometry;
    if (!owner.boundingBox) owner.computeBoundingBox?.();
    return owner.boundingBox;
  };
  const ofThree = (mesh, user) => {
    const box = localBox(mesh);
    const material = [mesh.material].flat()[0];
    if (!box || !material?.visible) return null;
    mesh.updateWorldMatrix(true, false);
    const e = sim.product(user, mesh.matrixWorld.elements);
    const [place, turn, scale] = [mesh.position.clone(), mesh.quaternion.clone(), mesh.scale.clone()];
    ({ __proto__: mesh.matrixWorld, elements: e }).decompose(place, turn, scale);
    const middle = sim.moved(e, map(['x', 'y', 'z'], (axis) => (box.min[axis] + box.max[axis]) / 2));
    const hex = material.color?.getHex?.() ?? 0x999999;
    const color = map([16, 8, 0], (shift) => ((hex >> shift) & 255) / 255);
    push(color, material.transparent ? Math.min(1, Math.max(0, material.opacity)) : 1);
    return [nameOf(mesh), ...mirrored(middle, [turn.x, turn.y, turn.z, turn.w]), size(box.min, box.max, scale), color];
  };
  const ofBabylon = (mesh, flipped) => {
    const [scale, place] = [mesh.scaling.clone(), mesh.position.clone()];
    const turn = mesh.absoluteRotationQuaternion.clone();
    mesh.computeWorldMatrix(true).decompose(scale, turn, place);
    const { minimum, maximum, centerWorld: c } = mesh.getBoundingInfo().boundingBox;
    const pose = [[c.x, c.y, c.z], [turn.x, turn.y, turn.z, turn.w]];
    const { r, g, b } = sim.colorOfBabylon(mesh) ?? { r: 0.6, g: 0.6, b: 0.6 };
    const color = map([r, g, b, mesh.visibility * (mesh.material?.alpha ?? 1)], (v) => Math.min(1, Math.max(0, v)));
    return [mesh.name, ...(flipped ? mirrored(...pose) : pose), size(minimum, maximum, scale), color];
  };
  // Rows of name, middle, rotation x y z w, size along its own axes (m, the app's frame), and
  // colour: red, green, blue (sRGB) and opacity, 0 to 1.
  sim.boxes = () => {
    const found = [];
    const add = (row) => {
      if (!row || found.length >= MOST || !every(row.slice(1).flat(), Number.isFinite)) return;
      row[0] = slice(String(row[0] || 'mesh'), 0, 60);
      push(found, row);
    };
    const user = sim.userSpace();
    for (const scene of sim.threeScenes()) {
      scene.traverseVisible?.((object) => object.isMesh && add(ofThree(object, user)));
    }
    for (const scene of sim.babylonScenes()) {
      for (const mesh of scene.meshes) {
        if (mesh.isEnabled() && mesh.isVisible && mesh.getTotalVertices()) {
          add(ofBabylon(mesh, scene.useRightHandedSystem));
        }
      }
    }
    return found;
  };
}
