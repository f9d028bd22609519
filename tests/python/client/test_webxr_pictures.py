"""Pictures of a page: what draws them, and their depth, behind lines and what is seen through."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.client import AppRefused, Observer, WebXRApp, frame_time_ns
from sim2vr_harness.client.webxr.browser import drawing_by
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
    for renderer in ("swiftshader", "mesa"):
        with open_page(PAGES / "touch.html", options={"renderer": renderer}) as app:
            for _ in range(2):
                app.reset(7, hands(0))
                pictures.append(app.image.astype(int))
            assert ("llvmpipe" in app.renderer_description) == (renderer == "mesa")
    for first, again in (pictures[:2], pictures[2:]):
        np.testing.assert_array_equal(first, again)
    # But for the edges of triangles, and one unit of rounding.
    assert (np.abs(pictures[0] - pictures[2]).max(axis=2) <= 1).mean() > 0.98


PAGE = """import {{ Boxes, button }} from './boxes.js';
const boxes = new Boxes();
const {{ gl }} = boxes;
const app = window.app = {{ error: 0 }};
const front = {{ centre: [0, 1.2, -1], half: [0.3, 0.3, 0.05], colour: [0.9, 0.1, 0.1] }};
const back = {{ centre: [0, 1.2, -2], half: [2, 2, 0.05], colour: [0.1, 0.9, 0.1] }};
boxes.list.push(...{order});
const draw = gl.drawArrays;
gl.drawArrays = (...args) => {{
  const thin = gl.getUniform(boxes.program, boxes.at.centre)[2] === -1;
  if (!thin) return draw.apply(gl, args);
  {before};
  draw.call(gl, {mode}, 0, 36);
  gl.disable(gl.BLEND);
  app.error ||= gl.getError();
}};
button('Enter VR', () => boxes.enter(() => {{}}));"""

LINES = ("", "gl.LINES")
ADDED = ("gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE)", "gl.TRIANGLES")
BLENDED = (
    "gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA)",
    "gl.TRIANGLES",
)
FRONT_M, BACK_M = 0.95, 1.95


@NEEDS_BROWSER
@pytest.mark.parametrize("order", ["[front, back]", "[back, front]"])
@pytest.mark.parametrize(
    ("drawn", "depth_m"),
    [(LINES, BACK_M), (ADDED, BACK_M), (BLENDED, FRONT_M)],
    ids=["lines", "additive", "opaque, by blending"],
)
def test_the_depth_is_that_of_what_is_solid(
    drawn: tuple[str, str], depth_m: float, order: str, shared: Callable[..., WebXRApp]
) -> None:
    """A depth of 10 m is 255. The colours are the page's own: red is in front."""
    script = PAGE.format(before=drawn[0], mode=drawn[1], order=order)
    app = shared(script, values={"error": "app.error"})
    app.reset(1, hands(0))
    assert app.step(50_000_000, hands(1)).values == {"error": 0}
    # Lines cross the middle of the face; all else covers it.
    assert app.image[36:45, 56:65, 0].max() > 150
    assert abs(int(app.image[36:45, 56:65, 3].min()) - 25.5 * depth_m) <= 1.0


OBSERVED = """import {{ Boxes, button }} from './boxes.js';
const boxes = new Boxes();
window.app = {{ views: 0 }};
boxes.list.push({{ centre: [0.5, 1.2, -1], half: [0.1, 0.1, 0.2], colour: [0.9, 0.1, 0.1] }});
const draw = boxes.draw;
boxes.draw = function (frame) {{
  app.views = frame.getViewerPose(this.space).views.length;
  {draw}
}};
button('Enter VR', () => boxes.enter(() => {{}}));"""


@NEEDS_BROWSER
def test_observers_look_from_elsewhere_and_change_nothing(shared: Callable[..., WebXRApp]) -> None:
    app = shared(OBSERVED.format(draw="draw.call(this, frame);"), values={"views": "app.views"})
    app.reset(1, hands(0))
    app.step(50_000_000, hands(1))
    eyes = app.image.copy()
    # From 3 m to the right of the box, looking left: its right face is 2.9 m away and 40 cm wide.
    left = (0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5))
    app.observe((Observer(80, 60, (3.5, 1.2, 1.0, *left), 40.0), Observer(90, 60)))
    for step, views in ((2, 3), (3, 3), (4, 1)):
        if views == 1:
            app.observe(())
        assert app.step(frame_time_ns(step, 20), hands(1)).values == {"views": views}
        np.testing.assert_array_equal(app.image, eyes)
        if views == 1:
            assert app.observed() == ()
            break
        outside, head = app.observed()
        assert outside.depth_m is not None
        box = np.isfinite(outside.depth_m)
        np.testing.assert_allclose(outside.depth_m[box], 2.9, atol=0.0015)
        focal = 30.0 / np.tan(np.radians(20.0))
        rows, columns = np.nonzero(box)
        inside = outside.rgb[rows.min() + 1 : rows.max(), columns.min() + 1 : columns.max()]
        assert (inside[..., 0] > 2 * inside[..., 1]).all()
        assert np.ptp(columns) + 1 == pytest.approx(0.4 * focal / 2.9, abs=1.5)
        assert np.ptp(rows) + 1 == pytest.approx(0.2 * focal / 2.9, abs=1.5)
        assert (columns.mean(), rows.mean()) == pytest.approx((39.5, 29.5), abs=0.6)
        assert head.depth_m is None
        assert head.rgb.shape == (60, 90, 3)
        assert (head.rgb[..., 0] > 2.0 * head.rgb[..., 1]).any()


@NEEDS_BROWSER
def test_a_page_that_draws_for_the_eyes_only_has_no_observers(
    shared: Callable[..., WebXRApp],
) -> None:
    first = (
        "const pose = frame.getViewerPose(this.space); const [view] = pose.views;"
        "draw.call(this, { getViewerPose: () => ({ views: [view] }) });"
    )
    app = shared(OBSERVED.format(draw=first), values={"views": "app.views"})
    app.reset(1, hands(0))
    app.step(50_000_000, hands(1))
    app.observe((Observer(80, 60, (3.5, 1.2, 1.0, 0.0, 0.0, 0.0, 1.0), 40.0),))
    app.step(100_000_000, hands(1))
    assert app.observed() == ()


DRAWS = """import {{ Boxes, button }} from './boxes.js';
const boxes = new Boxes('{kind}');
boxes.list.push({{ centre: [0, 1.2, -1.1], half: [0.2, 0.1, 0.1], colour: [0.9, 0.1, 0.1] }});
const {{ gl }} = boxes;
const app = window.app = {{ error: 0 }};
button('Enter VR', () => boxes.enter(() => {{
  // What a page relies on from one frame to the next.
  const green = gl.getParameter(gl.COLOR_CLEAR_VALUE)[1];
  const same = gl.getParameter(gl.ARRAY_BUFFER_BINDING) === app.buffer
    && green === Math.fround(0.2) && gl.isEnabled(gl.SCISSOR_TEST);
  if (app.buffer && !same) app.error += 1;
  app.error += gl.getError();
  app.buffer = gl.getParameter(gl.ARRAY_BUFFER_BINDING);
  gl.enable(gl.SCISSOR_TEST);
  gl.scissor(0, 0, 60, 80);
}}));"""


@NEEDS_BROWSER
def test_webgl_1_draws_what_webgl_2_draws(shared: Callable[..., WebXRApp]) -> None:
    pictures = []
    for kind in ("webgl", "webgl2"):
        app = shared(DRAWS.format(kind=kind), values={"error": "app.error"})
        app.reset(1, hands(0))
        for step in range(1, 4):
            reply = app.step(frame_time_ns(step, 20), hands(step))
        assert reply.values == {"error": 0}
        pictures.append(app.image.copy())
    assert (pictures[0] == pictures[1]).all()
    assert pictures[0][40, 55, 3] == pytest.approx(255 * 1.0 / 10.0, abs=1)  # m to the box's face
    assert (pictures[0][:, 60:, :3] == 0).all()  # right of the scissors: cleared by the harness


SAMPLES = """import { Boxes, button } from './boxes.js';
const boxes = new Boxes();
boxes.list.push({ centre: [0, 1.2, -1.1], half: [0.1, 0.1, 0.1], colour: [0.9, 0.1, 0.1] });
const { gl } = boxes;
const app = window.app = { error: 0 };
const [w, h] = [120, 80];
const samples = gl.createFramebuffer();
const attach = (point, format) => {
  const buffer = gl.createRenderbuffer();
  gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
  gl.renderbufferStorageMultisample(gl.RENDERBUFFER, 4, format, w, h);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, point, gl.RENDERBUFFER, buffer);
};
gl.bindFramebuffer(gl.FRAMEBUFFER, samples);
attach(gl.COLOR_ATTACHMENT0, gl.RGBA8);
attach(gl.DEPTH_KIND_ATTACHMENT, gl.FORMAT);
button('Enter VR', () => boxes.enter(() => {}));
const draw = boxes.draw;
boxes.draw = function (frame) {
  const { layer } = this;
  const { framebuffer } = layer;
  this.layer = { framebuffer: samples, getViewport: (view) => layer.getViewport(view) };
  draw.call(this, frame);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, samples);
  gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, framebuffer);
  gl.blitFramebuffer(0, 0, w, h, 0, 0, w, h, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  this.layer = layer;
  app.error ||= gl.getError();
};"""


@NEEDS_BROWSER
@pytest.mark.parametrize(
    ("kind", "form", "depth_m"),
    [("DEPTH_STENCIL", "DEPTH24_STENCIL8", 1.0), ("DEPTH", "DEPTH_COMPONENT16", 10.0)],
)
def test_a_picture_copied_from_more_samples_brings_its_depth_where_it_can(
    kind: str, form: str, depth_m: float, shared: Callable[..., WebXRApp]
) -> None:
    script = SAMPLES.replace("DEPTH_KIND", kind).replace("FORMAT)", f"{form})")
    app = shared(script, values={"error": "app.error"})
    assert app.reset(1, hands(0)).values == {"error": 0}
    red, green, _, depth = (int(value) for value in app.image[40, 60])
    assert red > 3 * green
    assert abs(depth - 25.5 * depth_m) <= 1.0
