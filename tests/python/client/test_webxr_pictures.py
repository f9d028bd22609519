"""Pictures of a page: what draws them, and their depth, behind lines and what is seen through."""

from collections.abc import Callable

import numpy as np
import pytest

from sim2vr_harness.client import Observer, WebXRApp, frame_time_ns
from webxr_pages import NEEDS_BROWSER, PAGES, hands, open_page


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
