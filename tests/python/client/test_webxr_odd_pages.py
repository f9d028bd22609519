"""Pages that do things in their own way, and are played all the same."""

from pathlib import Path

import pytest

from sim2vr_harness.client import AppRefused
from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with

pytestmark = NEEDS_BROWSER

ENTRANCES = {
    "no button, in another language": """
        const made = document.body.appendChild(document.createElement('span'));
        made.textContent = 'Los';
        made.addEventListener('pointerup', go);""",
    "in a shadow, after three seconds": """
        setTimeout(async () => {
          if (!(await navigator.xr.isSessionSupported('immersive-vr'))) return;
          const root = document.createElement('div').attachShadow({ mode: 'open' });
          root.innerHTML = '<button>Enter</button>';
          root.querySelector('button').onclick = go;
          document.body.append(root.host);
        }, 3000);""",
    "anywhere": "boxes.canvas.addEventListener('click', go);",
    "a wrong one first": """
        const quit = document.body.appendChild(document.createElement('button'));
        quit.textContent = 'Play flat';
        quit.onclick = () => {};
        button('Immersive', go);""",
    "an offer": "boxes.offered = navigator.xr.offerSession('immersive-vr').then(go);",
}


@pytest.mark.parametrize("entrance", ENTRANCES)
def test_the_way_into_vr_is_found(entrance: str, tmp_path: Path) -> None:
    script = f"""import {{ Boxes, button }} from './boxes.js';
    const boxes = new Boxes();
    const go = (session) => {{
      if (session instanceof XRSession) navigator.xr.requestSession = async () => session;
      boxes.enter(() => {{}}, []);
    }};
    {ENTRANCES[entrance]}"""
    with open_page(page_with(tmp_path, script)) as app:
        app.reset(1, hands(0))


def test_an_entrance_that_the_page_has_not(tmp_path: Path) -> None:
    script = "navigator.xr.isSessionSupported('immersive-vr');"
    with (
        open_page(page_with(tmp_path, script), options={"enter": "#go"}) as app,
        pytest.raises(AppRefused, match=r"page\.html: has no element #go to enter VR by"),
    ):
        app.reset(1, hands(0))


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


@pytest.mark.parametrize(
    ("kind", "form", "depth_m"),
    [("DEPTH_STENCIL", "DEPTH24_STENCIL8", 1.0), ("DEPTH", "DEPTH_COMPONENT16", 10.0)],
)
def test_a_picture_copied_from_more_samples_brings_its_depth_where_it_can(
    kind: str, form: str, depth_m: float, tmp_path: Path
) -> None:
    script = SAMPLES.replace("DEPTH_KIND", kind).replace("FORMAT)", f"{form})")
    with open_page(page_with(tmp_path, script), values={"error": "app.error"}) as app:
        assert app.reset(1, hands(0)).values == {"error": 0}
        red, green, _, depth = (int(value) for value in app.image[40, 60])
        assert red > 3 * green
        assert abs(depth - 25.5 * depth_m) <= 1.0
