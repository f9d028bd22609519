"""The depth picture of a page: what is solid, behind lines and what is seen through."""

from pathlib import Path

import pytest

from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with

pytestmark = NEEDS_BROWSER

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


@pytest.mark.parametrize("order", ["[front, back]", "[back, front]"])
@pytest.mark.parametrize(
    ("drawn", "depth_m"),
    [(LINES, BACK_M), (ADDED, BACK_M), (BLENDED, FRONT_M)],
    ids=["lines", "additive", "opaque, by blending"],
)
def test_the_depth_is_that_of_what_is_solid(
    drawn: tuple[str, str], depth_m: float, order: str, tmp_path: Path
) -> None:
    """A depth of 10 m is 255. The colours are the page's own: red is in front."""
    page = page_with(tmp_path, PAGE.format(before=drawn[0], mode=drawn[1], order=order))
    with open_page(page, values={"error": "app.error"}) as app:
        for frame in range(2):
            moment = app.reset(1, hands(0)) if frame == 0 else app.step(50_000_000, hands(1))
        assert moment.values == {"error": 0}
        # Lines cross the middle of the face; all else covers it.
        red = app.image[36:45, 56:65, 0].max()
        depths = app.image[36:45, 56:65, 3]
        assert red > 150
        assert abs(int(depths.min()) - 25.5 * depth_m) <= 1.0
