#!/usr/bin/env python3
"""Play one small page with many versions of three.js and A-Frame from npm; print a table.

Each page shows a red cube and a ray drawn from the right controller. A version passes if the page
enters VR, the picture has the cube at its place, and the ray follows the controller.

    python tools/research/engine_matrix.py [--folder FOLDER] [PACKAGE@VERSION ...]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from sim2vr_harness.client import (
    APP_FAILURES,
    AppPlace,
    AppRefused,
    AppsWanted,
    DevicePoses,
    WebXRApp,
)
from sim2vr_harness.client.runtime import frame_time_ns
from sim2vr_harness.client.webxr.packages import package_of
from sim2vr_harness.client.webxr.vendor import read_map, vendor

VERSIONS = (
    *(f"three@0.{release}.0" for release in (120, 132, 147, 158, 164, 170)),
    "three@latest",
    *(f"aframe@1.{minor}.0" for minor in (2, 3, 4, 5, 6, 7)),
    "aframe@latest",
)

THREE_PAGE = """<!doctype html><button id="vr">Enter VR</button>
<script type="module">
import * as THREE from '{address}build/three.module.js';
const renderer = new THREE.WebGLRenderer();
renderer.xr.enabled = true;
document.body.append(renderer.domElement);
const scene = new THREE.Scene();
scene.background = new THREE.Color(0x88aacc);
const cube = new THREE.Mesh(
  new THREE.BoxGeometry(0.3, 0.3, 0.3), new THREE.MeshBasicMaterial({{ color: 0xcc0000 }}));
cube.position.set(0, 1.3, -1);
cube.name = 'cube';
scene.add(cube);
for (const k of [0, 1]) {{
  const hand = renderer.xr.getController(k);
  const points = [new THREE.Vector3(0, 0, 0), new THREE.Vector3(0, 0, -2)];
  hand.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(points),
    new THREE.LineBasicMaterial({{ color: 0x00ff00 }})));
  hand.name = `ray${{k}}`;
  scene.add(hand);
}}
const camera = new THREE.PerspectiveCamera();
const wishes = {{ optionalFeatures: ['local-floor', 'layers'] }};
document.querySelector('#vr').onclick = async () =>
  renderer.xr.setSession(await navigator.xr.requestSession('immersive-vr', wishes));
renderer.setAnimationLoop(() => renderer.render(scene, camera));
</script>"""
AFRAME_PAGE = """<!doctype html><script src="{address}dist/aframe-master.js"></script>
<a-scene background="color: #8ac">
  <a-box id="cube" position="0 1.3 -1" width=".3" height=".3" depth=".3" color="#c00"
    material="shader: flat"></a-box>
  <a-entity id="ray1" laser-controls="hand: right" raycaster="objects: #cube"></a-entity>
</a-scene>"""


def play(spec: str, folder: Path) -> str:
    """Return "plays", or why a version does not."""
    address = f"https://cdn.jsdelivr.net/npm/{spec}/"
    package = package_of(f"{address}package.json")
    assert package is not None
    if without := vendor([package], folder):
        return without[0].why
    text = THREE_PAGE if package.name == "three" else AFRAME_PAGE
    page = folder / f"{spec.replace('/', '_')}.html"
    page.write_text(text.format(address=address))
    place = AppPlace(page=str(page), map=read_map(folder / "map.json"))
    with WebXRApp(AppsWanted(n=1, game="page", place=place)) as app:
        try:
            return _judge(app)
        except (*APP_FAILURES, AppRefused) as error:
            return str(error).partition(": ")[2]


def _judge(app: WebXRApp) -> str:
    head = np.array([0.0, 1.3, 0.0, 0.0, 0.0, 0.0, 1.0])
    places = []
    for step in range(20):  # A-Frame looks for controllers now and then
        hand = np.array([0.2 + 0.01 * step, 1.1, 0.3, 0.0, 0.0, 0.0, 1.0])
        poses = DevicePoses(head, right_controller=hand)
        if step:
            app.step(frame_time_ns(step, 20), poses)
        else:
            app.reset(1, poses)
        if step > 10:
            places.append(_ray(app))
    height, width = app.image.shape[:2]
    red, green, blue, depth = app.image[height // 2, width // 2].tolist()
    if not (red > 150 and green < 60 and blue < 60):
        return f"no cube in front: colour {red} {green} {blue}"
    if abs(depth / 255 * 10 - 0.85) > 0.08:  # m to the cube's face
        return f"depth of the cube {depth / 255 * 10:.2f} m, expected 0.85"
    moved = np.diff([place[0] for place in places])
    return "plays" if np.allclose(moved, 0.01, atol=1e-3) else f"the ray moves by {moved} m a step"


def _ray(app: WebXRApp) -> tuple[float, float, float]:
    """Return where the right controller's ray begins: the one of two that is not at the origin."""
    found = [(0.0, 0.0, 0.0)]
    for name in ("ray0", "ray1"):
        try:
            found.append(app.locate(name))
        except AppRefused:
            continue
    return max(found, key=lambda place: abs(place[0]))


def main() -> None:
    """Print a row per version."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("specs", nargs="*", default=VERSIONS)
    parser.add_argument("--folder", type=Path, help="keep the packages here")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as passing:
        folder = given.folder or Path(passing)
        print("| engine | result |\n|---|---|")
        for spec in given.specs:
            print(f"| {spec} | {play(spec, folder)} |", flush=True)


if __name__ == "__main__":
    main()
