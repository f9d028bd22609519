"""Pages as they are on the web: older engines, missing files, previews, doors of every kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sim2vr_harness.client import frame_time_ns
from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with

pytestmark = NEEDS_BROWSER

OLD_ENGINE = """import { Boxes, button } from './boxes.js';
const boxes = new Boxes();
window.app = { names: 0, unknown: 0 };
const names = Object.getOwnPropertyNames(window).filter((name) => name.startsWith('XR'));
const count = (words) => names.filter((name) => words.test(name)).length;
app.names = count(/^XR(Session|WebGLLayer|ReferenceSpace|SessionEvent)$/);
app.unknown = count(/Ray|Hand|Joint|HitTest|Anchor|Plane|Light|Depth|Binding|Quad|SubImage/);
button('Enter VR', async () => {
  const session = await navigator.xr.requestSession('immersive-vr');
  // three.js r137 to r170: layers where the render state has them
  if (session.renderState.layers !== undefined) new XRWebGLBinding(session, boxes.gl);
  if (session.requestHitTestSource) throw new Error('hit tests');
  navigator.xr.requestSession = async () => session;
  boxes.enter(() => {}, []);
});"""


def played(page: Path | str, steps: int = 5, **changes: Any) -> dict[str, Any]:
    """Values after some frames of a page."""
    with open_page(page, **changes) as app:
        values = app.reset(1, hands(0)).values
        for step in range(1, steps):
            values = app.step(frame_time_ns(step, 20), hands(step)).values
        return dict(values)


def test_a_page_finds_no_trace_of_what_is_not_covered(tmp_path: Path) -> None:
    values = {"names": "app.names", "unknown": "app.unknown"}
    found = played(page_with(tmp_path, OLD_ENGINE), values=values)
    assert found == {"names": 4, "unknown": 0}
