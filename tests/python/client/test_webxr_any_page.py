"""Pages as they are on the web: older engines, missing files, previews, doors of every kind."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import AppDied, AppRefused, WebXRApp, frame_time_ns
from sim2vr_harness.client.transport import PageStart
from webxr_pages import NEEDS_BROWSER, NEEDS_ENGINES, hands, open_page, page_with

pytestmark = NEEDS_BROWSER


Shared = Callable[..., WebXRApp]


def played(app: WebXRApp, steps: int = 5) -> dict[str, Any]:
    """Values after some frames of a page."""
    values = app.reset(1, hands(0)).values
    for step in range(1, steps):
        values = app.step(frame_time_ns(step, 20), hands(step)).values
    return dict(values)


def named(*names: str) -> dict[str, str]:
    """Expressions for numbers of the page, -1 where it has not set them."""
    return {name: f"app.{name} ?? -1" for name in names}


def plays(inner: str) -> str:
    """A page that enters VR by a button and counts its frames."""
    return (
        "import { Boxes, button } from './boxes.js'; const boxes = new Boxes();"
        "let frames = 0; const app = window.app = {};"
        f"const go = () => boxes.enter(() => {{ app.frames = ++frames; }}, []);\n{inner}"
    )


BUTTON = "button('Enter VR', go);"


def test_what_a_page_can_do_without_is_a_note(tmp_path: Path) -> None:
    script = plays(f"""{BUTTON}
    const add = (tag, source) =>
      document.body.appendChild(Object.assign(document.createElement(tag), source));
    add('img', {{ src: 'https://images.example/logo.png' }});
    add('script', {{ src: 'https://counter.example/count.js', async: true }});
    new FontFace('Nice', 'url(https://fonts.example/nice.woff2)').load();
    new Promise((resolve, reject) => add('img', {{ onerror: reject, src: 'gone.png' }}));
    setInterval(() => {{ throw new Error('adds nothing'); }}, 10);""")
    page = page_with(tmp_path, script)
    with open_page(page, values={"frames": "app.frames"}) as app:
        app.reset(1, hands(0))
        replies = [app.step(frame_time_ns(step, 20), hands(step)) for step in range(1, 5)]
        assert [reply.values["frames"] for reply in replies] == [2, 3, 4, 5]
        asks, missing, errors = app.notes
    for name in ("images.example/logo.png", "counter.example/count.js", "fonts.example/nice.woff2"):
        assert f"https://{name}" in asks
    assert missing.startswith("not found: https://page.invalid/gone.png")
    assert "Event" in errors
    assert "adds nothing" in errors


@pytest.mark.parametrize(("requested_ms", "first_ms"), [(51.0, 59.0), (80.0, 83.0), (50.0, 200.0)])
def test_vr_begins_when_it_began_in_the_recording(
    requested_ms: float, first_ms: float, tmp_path: Path
) -> None:
    """Whether or not that lies on the page's ticks: what moves is where it was."""
    count = "app.frames = ++frames; app.first ??= performance.now();"
    script = plays(f"button('Enter VR', () => boxes.enter(() => {{ {count} }}, []));")
    start = PageStart((16.0, 33.0, 50.0), requested_ms, first_ms)
    page = page_with(tmp_path, script)
    with open_page(page, values=named("frames", "first"), page_start=start) as app:
        assert played(app) == {"frames": 5, "first": first_ms}


def test_a_loop_that_an_error_stopped_ends_the_round(shared: Shared) -> None:
    script = plays("""button('Enter VR', async () => {
      await boxes.enter(() => {}, []);
      const { session } = boxes;
      for (let k = 1; k < 10; k++) session.cancelAnimationFrame(k);
      session.requestAnimationFrame(function frame() {
        if (++frames === 3) throw new Error('no target');
        session.requestAnimationFrame(frame);
      });
    });""")
    with pytest.raises(AppDied, match=r"asks for no more frames \(script error: Error: no target"):
        played(shared(script), 60)


DOORS = {
    "a drawn icon": "document.body.insertAdjacentHTML('beforeend', `<svg id='vr-icon'"
    " width='40' height='20'><rect width='40' height='20'/></svg>`);"
    "document.querySelector('#vr-icon').addEventListener('click', go);",
    "links before it": "document.body.insertAdjacentHTML('afterbegin',"
    " `<a href='boxes.js'>WebXR</a>"
    "<a href='https://example.org/vr'><b id='vr-logo'>VR</b></a>`); button('Enter VR', go);",
    "a link of its own": "document.body.insertAdjacentHTML('afterbegin', `<a href='#'>VR</a>`);"
    "document.querySelector('a').onclick = go;",
    "hidden": "button('Enter VR', go); document.querySelector('button').style.display = 'none';",
    "below the window's edge": "document.body.style.height = '9000px'; button('Enter VR', go);",
    "an error until it is ready": "let ready = false; setTimeout(() => { ready = true; }, 400);"
    "button('Enter VR', () => { if (!ready) throw new Error('not yet'); go(); });",
    "a user's own click": "button('Enter VR', (event) => {"
    " if (event.isTrusted && navigator.userActivation.isActive) go(); });",
    "full screen": "button('Enter VR', () => boxes.canvas.requestFullscreen().then(go));",
    "a port in a worker": """
      const text = `onmessage = ({ data, ports: [port] }) => {
        port.onmessage = (event) => port.postMessage(event.data + data); };`;
      const worker = new Worker(URL.createObjectURL(new Blob([text])));
      const far = new MessageChannel();
      far.port1.onmessage = ({ data }) => { if (data === 42) button('Enter VR', go); };
      far.port1.postMessage(2);
      worker.postMessage(40, [far.port2]);""",
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
    "an offer": "navigator.xr.offerSession('immersive-vr').then((session) => {"
    " navigator.xr.requestSession = async () => session; go(); });",
    "beside one that loads again": "button('Enter VR anew', () => location.reload());"
    "button('Try again', () => location.reload()); button('Go', go);",
}


@pytest.mark.parametrize("door", DOORS)
def test_the_door_into_vr(door: str, shared: Shared) -> None:
    app = shared(plays(DOORS[door]), values=named("frames"))
    assert played(app, steps=3) == {"frames": 3}


LEADS_AWAY = {
    "another address": (
        "button('Enter VR', () => { location.href = 'boxes.js'; });",
        r"never calls WebXR .*; tried to click: Enter VR \(leads to \S*boxes\.js\)$",
    ),
    "itself, by its name": (
        "button('Try again', () => location.reload());"
        "await import('https://cdn.example.com/engine.js').catch(() => {});",
        r"never calls WebXR \(navigator\.xr\) \(asks for https://cdn\.example\.com/engine\.js, "
        r"which app\.map maps to no folder; try: page vendor\)$",
    ),
    "itself, unasked": (
        "await import('https://cdn.example.com/engine.js').catch(() => {});"
        "setTimeout(() => location.reload(), 100);",
        r"page\.html: loaded itself again before it entered VR "
        r"\(asks for https://cdn\.example\.com/engine\.js, "
        r"which app\.map maps to no folder; try: page vendor\)$",
    ),
}


@pytest.mark.parametrize("what", LEADS_AWAY)
def test_what_leaves_the_page_is_no_door(what: str, shared: Shared) -> None:
    script, words = LEADS_AWAY[what]
    app = shared(f"import {{ button }} from './boxes.js';\n{script}")
    with pytest.raises(AppRefused, match=words):
        app.reset(1, hands(0))


def test_files_above_the_folder_come_with_the_options_that_serve_them(tmp_path: Path) -> None:
    (tmp_path / "game").mkdir()
    (tmp_path / "engine.js").write_text("window.engine = 1;\n")
    page = page_with(tmp_path / "game", f"import '../engine.js';\n{plays(BUTTON)}")
    with open_page(page) as app, pytest.raises(AppRefused) as caught:
        app.reset(1, hands(0))
    words = str(caught.value).split()
    address = words[words.index("--page") + 1]
    prefix, _, folder = words[words.index("--map") + 1].rstrip(")").partition("=")
    assert folder == str(tmp_path)
    with open_page(address, map={prefix: folder}, values=named("frames")) as app:
        assert played(app, steps=3) == {"frames": 3}


HELPER = """importScripts('more.js');
let beats = 0;
setTimeout(() => { throw new Error('a worker that goes on'); }, 60);
setInterval(() => postMessage(['beat', ++beats, performance.now()]), 50);
onmessage = async ({ data }) => {
  const text = await (await fetch('numbers.json')).json();
  postMessage(['sum', data + text[0] + more, performance.now(), Math.random()]);
};
const canvas = new OffscreenCanvas(8, 8).getContext('2d');
let drawn = 0;
requestAnimationFrame(function frame() {
  requestAnimationFrame(frame);
  canvas.fillRect(0, 0, 8, 8);
  drawn += 1;
  if (drawn === 10) postMessage(['drawn', performance.now()]);
});"""
WORKER_PAGE = """const worker = new Worker('helper.js');
app.entries = 0;
worker.onmessage = ({ data }) => {
  app.entries += 1;
  if (data[0] === 'sum') Object.assign(app, { sum: data[1], chance: data[3] });
  if (data[0] === 'beat') app.late = performance.now() - data[2];
};
const gone = new Worker('nothing-here.js');
gone.onerror = () => { app.gone = 1; };
button('Enter VR', go);
setTimeout(() => worker.postMessage(40), 500);
"""


def test_workers_keep_the_time_of_their_page(shared: Shared) -> None:
    beside = {"helper.js": HELPER, "more.js": "const more = 1;", "numbers.json": "[1]"}
    values = named("entries", "sum", "chance", "late", "gone", "frames")
    app = shared(plays(WORKER_PAGE), beside=beside, values=values)
    first = played(app, steps=20)
    assert played(app, steps=20) == first
    assert (first["sum"], first["gone"]) == (42, 1)
    assert 0 <= first["late"] < 50  # ms: delivered with the frame after the worker's beat
    # 19 steps of 50 ms: a beat in each, one sum, one drawn.
    assert first["entries"] >= 19 + 2


ANIMATED = """document.body.insertAdjacentHTML('beforeend', `<style>
@keyframes fade { from { opacity: 1 } to { opacity: 0 } }
#splash { animation: fade 2s linear 1s both; width: 50px; height: 50px }
#bar { transition: width 4s linear; width: 0px; height: 5px }
</style><div id="splash"></div><div id="bar"></div>`);
const splash = document.querySelector('#splash');
const bar = document.querySelector('#bar');
app.early = 0;
splash.onanimationend = ({ elapsedTime }) => {
  app.faded = performance.now() - begun;
  app.elapsed = elapsedTime;
  splash.remove();
  button('Enter VR', go);
};
const begun = performance.now();
requestAnimationFrame(() => requestAnimationFrame(() => {
  bar.style.width = '400px';
  bar.ontransitionend = () => { app.full = performance.now() - begun; };
}));
setTimeout(() => {
  app.opacity = Number(getComputedStyle(splash).opacity);
  app.width = parseFloat(getComputedStyle(bar).width);
}, 2000);
"""


def test_css_animations_keep_the_time_of_the_page(shared: Shared) -> None:
    app = shared(plays(ANIMATED), values=named("faded", "elapsed", "opacity", "width", "full"))
    found = played(app, steps=90)
    assert found["faded"] == pytest.approx(3000, abs=35)  # ms: delay and duration, to two frames
    assert found["elapsed"] == 2  # s, without the delay, as CSS Animations has it
    assert found["opacity"] == pytest.approx(0.5, abs=0.02)
    assert found["width"] == pytest.approx(200, abs=8)  # px after 2 s of 4
    assert found["full"] == pytest.approx(4000, abs=100)
    assert played(app, steps=5)["faded"] == found["faded"]


@NEEDS_ENGINES
def test_what_moves_is_located_where_it_is_in_every_step() -> None:
    """The ball of balls comes nearer at .6 m/s; what was located before comes with a step."""
    ahead = []
    with open_page("balls") as app:
        app.reset(1, hands(0))
        for step in range(1, 6):
            app.step(frame_time_ns(step, 20), hands(0))
            ahead.append(app.locate("ball")[2])
            with pytest.raises(AppRefused, match=r'no object "bell"; objects with names: .*ball'):
                app.locate("bell")
    assert np.diff(ahead) == pytest.approx([-0.03] * 4, abs=1e-6)
