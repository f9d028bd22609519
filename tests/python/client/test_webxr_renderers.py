"""What draws in a browser: SwiftShader with one thread, or Mesa."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.client import AppRefused
from sim2vr_harness.client.webxr.renderers import drawing_by
from webxr_pages import NEEDS_BROWSER, PAGES, hands, open_page


@pytest.mark.parametrize("script", [False, True])
def test_the_browser_s_own_renderer_is_found_and_given_one_thread(
    tmp_path: Path, script: bool
) -> None:
    folder = tmp_path / "lib" / "browser"
    folder.mkdir(parents=True)
    library = folder / "libvk_swiftshader.so"
    library.touch()
    program = folder / "shell"
    program.write_bytes(b"\x7fELF")
    if script:
        program = tmp_path / "shell"
        program.write_text(f'#!/bin/sh\nexec {folder}/shell "$@"\n')
    drawing = drawing_by("swiftshader", str(program), "/tmp/x")
    assert drawing.flags[0] == "--use-angle=vulkan"
    assert drawing.environment["VK_DRIVER_FILES"] == "/tmp/x/driver.json"
    assert json.loads(drawing.files["driver.json"])["ICD"]["library_path"] == str(library)
    assert "ThreadCount=1\n" in drawing.files["SwiftShader.ini"]
    library.unlink()
    drawing = drawing_by("swiftshader", str(program), "/tmp/x")
    assert (drawing.flags[0], drawing.files) == ("--use-angle=swiftshader", {})


def test_a_renderer_that_there_is_not(tmp_path: Path) -> None:
    with pytest.raises(AppRefused, match=r"renderer: got 'gpu', expected one of swiftshader, mesa"):
        drawing_by("gpu", "/bin/sh", "/tmp/x")


@NEEDS_BROWSER
def test_swiftshader_has_one_thread_in_a_browser() -> None:
    with open_page(PAGES / "touch.html") as app:
        app.reset(7, hands(0))
        group, names = app._browser.process.pid, []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            if stat.read_text().rpartition(") ")[2].split()[2] == str(group):
                names += [file.read_text() for file in stat.parent.glob("task/*/comm")]
        assert sum(name.startswith("Thread<") for name in names) == 1


@NEEDS_BROWSER
def test_mesa_draws_the_same_scene() -> None:
    pictures = []
    for renderer in ("swiftshader", "mesa", "mesa"):
        with open_page(PAGES / "touch.html", options={"renderer": renderer}) as app:
            app.reset(7, hands(0))
            assert ("llvmpipe" in app.renderer_description) == (renderer == "mesa")
            pictures.append(app.image.astype(int))
    np.testing.assert_array_equal(pictures[1], pictures[2])
    # But for the edges of triangles, and one unit of rounding.
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) <= 1).mean() > 0.98
