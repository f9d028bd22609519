"""Pages as they are on the web: older engines, missing files, previews, doors of every kind."""

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from sim2vr_harness.client import AppDied, AppRefused, frame_time_ns
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


def plays(inner: str) -> str:
    """A page that enters VR by a button and counts its frames."""
    return (
        "import { Boxes, button } from './boxes.js'; const boxes = new Boxes();"
        "let frames = 0; const app = window.app = {};"
        f"const go = () => boxes.enter(() => {{ app.frames = ++frames; }}, []);\n{inner}"
    )


BUTTON = "button('Enter VR', go);"


def test_what_a_page_can_do_without_is_a_note(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
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
    # Each kind once, though two windows show the page.
    with open_page(page) as app:
        app.reset(1, hands(0))
    logged = [record.message for record in caplog.records]
    assert [sum(words in line for line in logged) for words in ("asks for", "not found")] == [1, 1]


def test_a_loop_that_an_error_stopped_ends_the_round(tmp_path: Path) -> None:
    script = plays("""button('Enter VR', async () => {
      await boxes.enter(() => {}, []);
      const { session } = boxes;
      for (let k = 1; k < 10; k++) session.cancelAnimationFrame(k);
      session.requestAnimationFrame(function frame() {
        if (++frames === 3) throw new Error('no target');
        session.requestAnimationFrame(frame);
      });
    });""")
    with (
        open_page(page_with(tmp_path, script)) as app,
        pytest.raises(AppDied, match=r"asks for no more frames \(script error: Error: no target"),
    ):
        app.reset(1, hands(0))
        for step in range(1, 60):
            app.step(frame_time_ns(step, 20), hands(step))


def test_a_preview_on_the_canvas_comes_before_vr(tmp_path: Path) -> None:
    script = plays("""app.previews = app.wrong = 0;
    const { gl } = boxes;
    navigator.xr.isSessionSupported('inline').then(async (yes) => {
      const session = yes && await navigator.xr.requestSession('inline');
      session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl) });
      const space = await session.requestReferenceSpace('viewer');
      session.requestAnimationFrame(function frame(time, xr) {
        session.requestAnimationFrame(frame);
        const [view] = xr.getViewerPose(space).views;
        const { baseLayer } = session.renderState;
        const { width, height } = baseLayer.getViewport(view);
        // The canvas itself, 90 degrees from top to bottom.
        if (baseLayer.framebuffer !== null || width !== gl.canvas.width
          || height !== gl.canvas.height || Math.abs(view.projectionMatrix[5] - 1) > 1e-6)
          app.wrong += 1;
        app.previews += 1;
      });
    });
    button('Enter VR', async () => {
      app.ar = await navigator.xr.isSessionSupported('immersive-ar');
      go();
    });""")
    values = {name: f"app.{name}" for name in ("previews", "wrong", "ar", "frames")}
    with open_page(page_with(tmp_path, script), values=values) as app:
        first = app.reset(1, hands(0)).values
        last = app.step(frame_time_ns(1, 20), hands(1)).values
    previews = first["previews"]
    assert isinstance(previews, int)
    assert previews > 5
    assert first == {"previews": previews, "wrong": 0, "ar": False, "frames": 1}
    assert last == {**first, "frames": 2}  # the immersive session has the display


DOORS = {
    "a drawn icon before it": "document.body.insertAdjacentHTML('beforeend', `<svg id='vr-icon'"
    " width='40' height='20'><rect width='40' height='20'/></svg>`); button('Enter VR', go);",
    "a drawn icon": "document.body.insertAdjacentHTML('beforeend', `<svg id='vr-icon'"
    " width='40' height='20'><rect width='40' height='20'/></svg>`);"
    "document.querySelector('#vr-icon').addEventListener('click', go);",
    "links before it": "document.body.insertAdjacentHTML('afterbegin',"
    " `<a href='boxes.js'>WebXR</a>"
    "<a href='https://example.org/vr'><b id='vr-logo'>VR</b></a>`); button('Enter VR', go);",
    "a link of its own": "document.body.insertAdjacentHTML('afterbegin', `<a href='#'>VR</a>`);"
    "document.querySelector('a').onclick = go;",
    "a form's button": "document.body.insertAdjacentHTML('afterbegin',"
    " `<form><button>Enter VR</button></form>`); document.querySelector('button').onclick = go;",
    "hidden": "button('Enter VR', go); document.querySelector('button').style.display = 'none';",
    "below the window's edge": "document.body.style.height = '9000px'; button('Enter VR', go);",
    "late": "setTimeout(() => button('Enter VR', go), 12000);",
    "an error until it is ready": "let ready = false; setTimeout(() => { ready = true; }, 400);"
    "button('Enter VR', () => { if (!ready) throw new Error('not yet'); go(); });",
    "nothing until it is ready": "let ready = false; setTimeout(() => { ready = true; }, 3000);"
    "button('Enter VR', () => ready && go());",
    "a user's own click": "button('Enter VR', (event) => {"
    " if (event.isTrusted && navigator.userActivation.isActive) go(); });",
    "full screen": "button('Enter VR', () => boxes.canvas.requestFullscreen().then(go));",
    "pointer lock": "button('Enter VR', () => boxes.canvas.requestPointerLock().then(go));",
    "a port in a worker": """
      const text = `onmessage = ({ data, ports: [port] }) => {
        port.onmessage = (event) => port.postMessage(event.data + data); };`;
      const worker = new Worker(URL.createObjectURL(new Blob([text])));
      const far = new MessageChannel();
      far.port1.onmessage = ({ data }) => { if (data === 42) button('Enter VR', go); };
      far.port1.postMessage(2);
      worker.postMessage(40, [far.port2]);""",
    "sound": "button('Enter VR', () => new AudioContext().resume().then(go));",
}


@pytest.mark.parametrize("door", DOORS)
def test_the_door_into_vr(door: str, tmp_path: Path) -> None:
    page = page_with(tmp_path, plays(DOORS[door]))
    assert played(page, steps=3, values={"frames": "app.frames"}) == {"frames": 3}


LEADS_AWAY = {
    "another address": (
        "button('Enter VR', () => { location.href = 'boxes.js'; });",
        r"never calls WebXR .*; tried to click: Enter VR \(leads to \S*boxes\.js\)$",
    ),
    "itself, in a while": (
        "button('Start', () => setTimeout(() => location.reload(), 100));",
        r"tried to click: Start \(loads the page again\)$",
    ),
    "itself, by its name": (
        "button('Try again', () => location.reload());"
        "await import('https://cdn.example.com/engine.js').catch(() => {});",
        r"never calls WebXR \(navigator\.xr\) "
        r"\(asks for https://cdn\.example\.com/engine\.js, which app\.map maps to no folder\)$",
    ),
    "itself, unasked": (
        "await import('https://cdn.example.com/engine.js').catch(() => {});"
        "setTimeout(() => location.reload(), 100);",
        r"page\.html: loaded itself again before it entered VR "
        r"\(asks for https://cdn\.example\.com/engine\.js, which app\.map maps to no folder\)$",
    ),
    "another address, unasked": (
        "setTimeout(() => { location.href = 'boxes.js'; }, 100);",
        r"went to another address, \S*boxes\.js before it entered VR$",
    ),
}


@pytest.mark.parametrize("what", LEADS_AWAY)
def test_what_leaves_the_page_is_no_door(what: str, tmp_path: Path) -> None:
    script, words = LEADS_AWAY[what]
    page = page_with(tmp_path, f"import {{ button }} from './boxes.js';\n{script}")
    with open_page(page) as app, pytest.raises(AppRefused, match=words):
        app.reset(1, hands(0))


def test_a_door_beside_one_that_loads_again_is_found(tmp_path: Path) -> None:
    script = plays(
        "button('Enter VR anew', () => location.reload());"
        "button('Try again', () => location.reload()); button('Go', go);"
    )
    assert played(page_with(tmp_path, script), steps=3, values={"frames": "app.frames"}) == {
        "frames": 3
    }


@pytest.mark.parametrize("clock", ["performance.now()", "Date.now()", "new Date()"])
def test_a_wait_on_a_clock_ends_the_same_each_time(clock: str, tmp_path: Path) -> None:
    script = plays(f"""{BUTTON}
    app.reads = app.ahead = 0;
    const wait = (ms) => {{
      const end = +{clock} + ms;
      while ({clock} < end) app.reads += 1;
    }};
    wait(4);
    setTimeout(() => {{
      const from = performance.now();
      wait(4);
      app.ahead = performance.now() - from;
    }});""")
    page = page_with(tmp_path, script)
    values = {"frames": "app.frames", "reads": "app.reads", "ahead": "app.ahead"}
    first, again = (played(page, steps=3, values=values) for _ in range(2))
    assert first == again
    assert first["frames"] == 3
    # Two waits of 4 ms, each 100,000 reads at a standstill and some 400 that move on.
    assert 200_600 < first["reads"] < 201_000
    assert 3.0 < first["ahead"] < 4.2


def test_few_reads_of_a_clock_do_not_move_it(tmp_path: Path) -> None:
    script = plays(f"""{BUTTON}
    const from = performance.now();
    for (let k = 0; k < 50000; k++) Date.now();
    app.moved = performance.now() - from;""")
    assert played(page_with(tmp_path, script), values={"moved": "app.moved"}) == {"moved": 0.0}


def test_a_page_without_webxr_is_told_so_soon(tmp_path: Path) -> None:
    # Each frame takes a twentieth of a second to draw.
    script = """const draw = () => {
      let sum = 0;
      for (let k = 0; k < 2e7; k++) sum += k;
      document.title = sum;
      requestAnimationFrame(draw);
    };
    draw();"""
    with open_page(page_with(tmp_path, script)) as app:
        began = time.monotonic()
        with pytest.raises(AppRefused, match="never calls WebXR"):
            app.reset(1, hands(0))
        assert time.monotonic() - began < 10.0


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
    values = {"frames": "app.frames"}
    assert played(address, map={prefix: folder}, steps=3, values=values) == {"frames": 3}


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


def test_webgl_1_draws_what_webgl_2_draws(tmp_path: Path) -> None:
    pictures = []
    for kind in ("webgl", "webgl2"):
        page = page_with(tmp_path, DRAWS.format(kind=kind))
        with open_page(page, values={"error": "app.error"}) as app:
            app.reset(1, hands(0))
            for step in range(1, 4):
                reply = app.step(frame_time_ns(step, 20), hands(step))
            assert reply.values == {"error": 0}
            pictures.append(app.image.copy())
    assert (pictures[0] == pictures[1]).all()
    assert pictures[0][40, 55, 3] == pytest.approx(255 * 1.0 / 10.0, abs=1)  # m to the box's face
    assert (pictures[0][:, 60:, :3] == 0).all()  # right of the scissors: cleared by the harness


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
WORKER_PAGE = """const log = app.log = [];
const worker = new Worker('helper.js');
worker.onmessage = ({ data }) => {
  log.push([...data, performance.now()].join());
  app.entries = log.length;
  if (data[0] === 'sum') Object.assign(app, { sum: data[1], chance: data[3] });
  if (data[0] === 'beat') app.late = performance.now() - data[2];
  app.digest = [...log.join()].reduce((sum, one) => (sum * 31 + one.charCodeAt()) % 1e9, 7);
};
const gone = new Worker('nothing-here.js');
gone.onerror = () => { app.gone = 1; };
button('Enter VR', go);
setTimeout(() => worker.postMessage(40), 500);
"""


def test_workers_keep_the_time_of_their_page(tmp_path: Path) -> None:
    (tmp_path / "helper.js").write_text(HELPER)
    (tmp_path / "more.js").write_text("const more = 1;")
    (tmp_path / "numbers.json").write_text("[1]")
    page = page_with(tmp_path, plays(WORKER_PAGE))
    names = ("entries", "digest", "sum", "chance", "late", "gone", "frames")
    values = {name: f"app.{name} ?? 0" for name in names}
    first = played(page, steps=20, values=values)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        assert played(page, steps=20, values=values) == first
    finally:
        for process in busy:
            process.kill()
            process.wait()
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


def test_css_animations_keep_the_time_of_the_page(tmp_path: Path) -> None:
    values = {name: f"app.{name}" for name in ("faded", "elapsed", "opacity", "width", "full")}
    page = page_with(tmp_path, plays(ANIMATED))
    found = played(page, steps=90, values={name: f"{path} ?? -1" for name, path in values.items()})
    assert found["faded"] == pytest.approx(3000, abs=35)  # ms: delay and duration, to two frames
    assert found["elapsed"] == 2  # s, without the delay, as CSS Animations has it
    assert found["opacity"] == pytest.approx(0.5, abs=0.02)
    assert found["width"] == pytest.approx(200, abs=8)  # px after 2 s of 4
    assert found["full"] == pytest.approx(4000, abs=100)
    assert played(page, steps=5, values={"faded": "app.faded"})["faded"] == found["faded"]


SOUNDS = """const context = new AudioContext();
const source = context.createBufferSource();
source.buffer = context.createBuffer(1, 44100, 44100);
source.connect(context.destination);
source.onended = () => { app.ended = context.currentTime - app.started; };
button('Enter VR', async () => {
  await context.resume();
  app.started = context.currentTime;
  source.start(context.currentTime + 0.5);
  go();
});
const clock = setInterval(() => {
  app.off = Math.abs(context.currentTime - performance.now() / 1000);
}, 100);
"""


def test_audio_contexts_keep_the_time_of_the_page(tmp_path: Path) -> None:
    page = page_with(tmp_path, plays(SOUNDS))
    found = played(page, steps=60, values={"ended": "app.ended ?? -1", "off": "app.off"})
    assert found["ended"] == pytest.approx(0.5 + 1.0)  # s: start and duration of the buffer
    assert found["off"] < 0.05  # s: from the document's start to the context's


OBSERVED = """const log = []; app.log = log; app.digest = 0;
const note = (...what) => {
  for (const part of [...what, performance.now()]) app.digest = (app.digest * 31 + part) % 1e9;
};
document.body.insertAdjacentHTML('beforeend', `<div id="box" style="width: 300px; height: 200px;
  padding: 5px; border: 2px solid; position: absolute; top: 10px; left: 0"></div>`);
const box = document.querySelector('#box');
new ResizeObserver(([{ contentRect, borderBoxSize: [border] }]) => {
  Object.assign(app, { width: contentRect.width, border: border.inlineSize });
  app.resizes = (app.resizes ?? 0) + 1;
  note(1, contentRect.width);
}).observe(box);
new IntersectionObserver(([entry]) => {
  app.seen = entry.intersectionRatio;
  note(2, app.seen);
}, { threshold: [0, 0.5, 1] }).observe(box);
const channel = new MessageChannel();
let left = 500;
app.chain = 0;
channel.port1.onmessage = ({ data }) => {
  note(3, data);
  if (--left) channel.port2.postMessage(left); else app.chain = performance.now() - begun;
};
const begun = performance.now();
channel.port2.postMessage(left);
window.addEventListener('message', ({ data, source }) => { if (source === window) note(4, data); });
requestIdleCallback(() => note(5));
window.scheduler?.postTask(() => note(6));
app.changed = 0;
let drawn = '';
requestAnimationFrame(function frame() {
  requestAnimationFrame(frame);
  if (drawn !== box.style.width) app.changed += 1;
  drawn = box.style.width;
});
let turns = 0;
setInterval(() => {
  box.style.width = `${300 + ++turns}px`;
  if (turns === 20) box.style.left = `${innerWidth - 30}px`;
  window.postMessage(turns, '*');
}, 20);
document.body.style.overflow = 'hidden';
button('Enter VR', go);
"""


def test_what_comes_between_frames_is_the_same_beside_a_busy_processor(tmp_path: Path) -> None:
    page = page_with(tmp_path, plays(OBSERVED))
    names = ("digest", "resizes", "width", "border", "seen", "chain", "changed")
    values = {name: f"app.{name}" for name in names}
    changes: dict[str, Any] = {"values": values, "options": {"window_frames": "run"}}
    first = played(page, steps=20, **changes)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        assert played(page, steps=20, **changes) == first
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert first["chain"] == pytest.approx(500 * 0.2)  # ms: 0.2 each
    assert first["border"] == first["width"] + 2 * (5 + 2)  # padding and border
    assert first["resizes"] == first["changed"] > 20  # one for each change that a frame finds
    assert 0 < first["seen"] < 0.5
