"""What people see when they watch: the scene, and the buttons beside it, in a browser."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from chromium import Page
from processes import free_port, until
from sim2vr_harness.client import AppScene, SceneMesh, SceneObject
from sim2vr_harness.tools.watch.browser import Viewer
from sim2vr_harness.tools.watch.frames import Playlist, ViewerFrame
from webxr_pages import NEEDS_BROWSER

pytestmark = NEEDS_BROWSER

SHEET = SceneMesh(
    "sheet",
    np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
    np.array([[0, 2, 1], [0, 3, 2]]),
)
TIME = "document.body?.innerText.match(/([0-9.]+) s {0,3}\\s*Hits/)?.[1]"
PRESS = """(() => { [...document.querySelectorAll('button')]
  .find(button => button.textContent.trim() === '%s').click(); })()"""


def show() -> Playlist:
    """A red sheet of 2 x 2 m that faces the player, for longer than any test."""

    def moments() -> Iterator[ViewerFrame]:
        pose = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        red = np.array([1.0, 0.0, 0.0, 1.0], np.float32)
        sheet = SceneObject(1, "Sheet", 0, 0, pose, np.ones(3), red, False)
        for k in range(1, 100_001):
            picture = np.full((40, 60, 3), 128, np.uint8)
            yield ViewerFrame(k / 20.0, AppScene((sheet,), (SHEET,)), picture, f"Hits {k}")

    return Playlist("a sheet", 20.0, moments)


def red_share(page: Page, file: Path) -> float:
    page.picture(file, whole=False)
    with Image.open(file) as picture:
        pixels: Any = np.asarray(picture.convert("RGB")).astype(int)
    return float(((pixels[..., 0] > 90) & (pixels[..., 1:].max(axis=-1) < 70)).mean())


def test_the_scene_is_drawn_and_the_buttons_work(tmp_path: Path) -> None:
    over = threading.Event()
    theatre = Viewer(show(), port=free_port())
    runner = threading.Thread(target=theatre.run, args=(over.is_set,))
    runner.start()
    try:
        with Page(served=True) as page:
            page.open(theatre.address, 700, 450)
            page.wait_for(f"!!({TIME})")
            page.wait_for("document.querySelectorAll('canvas').length > 0")
            # The colour of a lit sheet is some red; nothing else on the page is.
            assert until(lambda: red_share(page, tmp_path / "scene.png") > 0.03)
            page.value(PRESS % "pause")
            assert until(lambda: not theatre.playback.playing)
            at = theatre.playback.at
            page.wait_for(f"({TIME}) === '{(at + 1) / 20.0:.2f}'")
            page.value(PRESS % "step")
            page.wait_for(f"({TIME}) === '{(at + 2) / 20.0:.2f}'")
            page.value(PRESS % "again")
            assert until(lambda: theatre.playback.at < at or theatre.playback.playing)
            assert page.errors == [] or all("ERR_FILE_NOT_FOUND" in e for e in page.errors)
    finally:
        over.set()
        runner.join()
        theatre.close()
