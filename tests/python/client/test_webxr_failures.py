"""Pages that cannot be played, or not any more: one line each that names page and cause."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from processes import emptied, gone, group, of_type
from sim2vr_harness.client import AppDied, AppError, AppRefused, AppTimeout, frame_time_ns
from sim2vr_harness.client.webxr.browser import Browser, find_browser
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.page import Page
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from webxr_pages import NEEDS_BROWSER, PAGES, hands, open_page, page_with

ENTERS = """import { Boxes, button } from './boxes.js';
let frames = 0;
const boxes = new Boxes();
button('Enter VR', () => boxes.enter(() => { frames += 1; %s }));"""

REFUSED = {
    "no WebXR call": ("document.title = 'flat';", r"never calls WebXR \(navigator\.xr\)"),
    "never enters": (
        "import { button } from './boxes.js'; navigator.xr.isSessionSupported('immersive-vr');"
        "button('Enter VR', () => {});",
        r"never enters VR; tried to click: Enter VR",
    ),
    "a session of another kind": (
        "navigator.xr.requestSession('immersive-ar').catch(() => {});",
        r"is an AR page: it asks for immersive-ar only, expected immersive-vr",
    ),
    "hands": (
        "navigator.xr.requestSession('immersive-vr', {requiredFeatures: ['hand-tracking']})"
        ".catch(() => {});",
        r"asks for the feature hand-tracking, which is not covered",
    ),
    "script error": (
        "const app = {};\napp.start();",
        r"script error: TypeError: app\.start is not a function \(page\.html:\d+\)",
    ),
    "syntax error": ("let let = 1;", r"script error: SyntaxError: .*\(page\.html:\d+\)"),
    "unmapped address": (
        "import 'https://cdn.example.com/engine.js';",
        r"asks for https://cdn\.example\.com/engine\.js, which app\.map maps to no folder",
    ),
    "missing file": ("import './engine.js';", r"never calls WebXR .*not found: .*/engine\.js"),
    "source code": (
        "import './main.ts';",
        r"never calls WebXR .*loads https://\S*/main\.ts, source code that no browser runs: build",
    ),
    "WebVR": (
        "navigator.getVRDisplays = () => Promise.resolve([]);",
        r"page\.html: uses WebVR, which WebXR replaced, expected an engine with WebXR",
    ),
    "a door without words": (
        "import { button } from './boxes.js'; button('', () => {}); button('', () => {});"
        "const made = document.querySelectorAll('button'); made[0].title = 'Go VR';"
        "made[1].className = 'enter-vr';",
        r'tried to click: Go VR, <button class="enter-vr">$',
    ),
    "WebGL 1 without its extensions": (
        "import { Boxes, button } from './boxes.js'; const boxes = new Boxes('webgl');"
        "WebGLRenderingContext.prototype.getExtension = () => null;"
        "button('Enter VR', () => boxes.enter(() => {}).catch(() => {}));",
        r"draws with WebGL 1, where this browser has no WEBGL_depth_texture, expected WebGL 2",
    ),
    "WebGL 1 without its extensions, unhandled": (
        "import { Boxes, button } from './boxes.js'; const boxes = new Boxes('webgl');"
        "WebGLRenderingContext.prototype.getExtension = () => null;"
        "button('Enter VR', () => boxes.enter(() => {}));",
        r"page\.html: draws with WebGL 1, where this browser has no WEBGL_depth_texture, expected",
    ),
    "no frames": (
        "navigator.xr.requestSession('immersive-vr');",
        r"enters VR, but asks for no frames there",
    ),
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    made = Browser(find_browser(), 30.0)
    yield made
    made.stop()


def loading(browser: Browser, file: Path, start_timeout_s: float = 30.0) -> None:
    """Loads a page in a tab of a browser that pages share."""
    settings = {"seed": 0, "width": 16, "height": 16, "eyes": 1, "profile": "oculus-touch"}
    page = Page(
        browser,
        PageFiles(str(file), {}),
        settings,
        values={},
        enter=None,
        ignore_errors=False,
        timeout_s=30.0,
        start_timeout_s=start_timeout_s,
    )
    page.load(1, {})


@NEEDS_BROWSER
@pytest.mark.parametrize("what", REFUSED)
def test_a_page_that_cannot_be_played_says_why(what: str, tmp_path: Path, browser: Browser) -> None:
    script, words = REFUSED[what]
    page = page_with(tmp_path, script)
    (tmp_path / "main.ts").write_text("export const lamps: number = 3;\n")
    with pytest.raises(AppRefused, match=words) as caught:
        loading(browser, page)
    assert "\n" not in str(caught.value)
    assert "page.html" in str(caught.value)


@NEEDS_BROWSER
def test_an_endless_loop_at_the_start_takes_its_time_only(tmp_path: Path) -> None:
    page = page_with(tmp_path, "for (;;);")
    with (
        open_page(page, start_timeout_s=4.0) as app,
        pytest.raises(AppRefused, match=r"page\.html: gave no answer for 1 s while it loaded"),
    ):
        app.reset(1, hands(0))


DIES = {
    "endless loop": ("if (frames === 3) for (;;);", AppTimeout, r"gave no answer to .*page\.html"),
    "script error": (
        "if (frames === 3) frames.explode();",
        AppDied,
        r"page\.html: script error: TypeError: frames\.explode is not a function",
    ),
    "rejected promise": (
        "if (frames === 3) Promise.reject(new Error('no more'));",
        AppDied,
        r"page\.html: script error: Error: no more",
    ),
    "lost context": (
        "if (frames === 3) boxes.gl.getExtension('WEBGL_lose_context').loseContext();",
        AppDied,
        r"page\.html: lost its WebGL context",
    ),
    "another address": (
        "if (frames === 3) location.href = 'boxes.js';",
        AppDied,
        r"page\.html: (went to another address|left its document)",
    ),
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", DIES)
def test_a_page_that_fails_in_a_round_ends_it_and_is_replaced(what: str, tmp_path: Path) -> None:
    script, error, words = DIES[what]
    page = page_with(tmp_path, ENTERS % script)
    timeout_s = 3.0 if what == "endless loop" else 30.0
    strict = {"script_errors": "fail"}
    with open_page(page, timeout_s=timeout_s, options=strict) as app:
        app.reset(1, hands(0))
        with pytest.raises(error, match=words) as caught:
            for step in range(1, 6):
                app.step(frame_time_ns(step, 20), hands(step))
        assert "\n" not in str(caught.value)
        with pytest.raises(AppDied, match="was given up"):
            app.step(frame_time_ns(9, 20), hands(9))


@NEEDS_BROWSER
def test_a_session_that_the_page_ends_ends_the_round(tmp_path: Path) -> None:
    page = page_with(tmp_path, ENTERS % "if (frames === 3) boxes.session.end();")
    with open_page(page) as app:
        for _ in range(2):
            ends = [app.reset(1, hands(0)).finished]
            ends += [app.step(frame_time_ns(k, 20), hands(k)).finished for k in (1, 2)]
            assert ends == [False, False, True]
        with pytest.raises(
            AppError, match=r"page\.html: the page ended its session .* after 0\.1 s; call reset"
        ):
            app.step(frame_time_ns(3, 20), hands(3))


@NEEDS_BROWSER
def test_a_page_that_leaves_in_its_first_frame_cannot_be_played(tmp_path: Path) -> None:
    with (
        open_page(page_with(tmp_path, ENTERS % "boxes.session.end();")) as app,
        pytest.raises(
            AppRefused, match=r"page\.html: the page ended its session .* first frame, exp"
        ),
    ):
        app.reset(1, hands(0))


@NEEDS_BROWSER
def test_a_round_says_that_its_page_left(tmp_path: Path) -> None:
    page = page_with(tmp_path, ENTERS % "if (frames === 5) boxes.session.end();")
    app = AppConfig(transport="webxr", page=str(page), task={"seconds": 5})
    simulation = Simulation(EnvConfig(app=app, vision=VisionConfig(width=24, height=16)), 1)
    simulation.reset(seeds=[1])
    still = np.zeros((1, simulation.action_space.shape[0]))
    while not (batch := simulation.step(still)).over[0]:
        pass
    info = batch.info(0)
    assert (batch.terminated[0], info["termination"]) == (True, "app_left")
    assert "page.html: the page ended its session (XRSession.end) after 0.2 s" in info["app_left"]
    simulation.reset(ids=[0])
    assert simulation.step(still).answered.all()
    simulation.close()


@NEEDS_BROWSER
def test_users_go_on_when_a_browser_is_killed() -> None:
    app = AppConfig(transport="webxr", page=str(PAGES / "touch.html"), task={"seconds": 5})
    simulation = Simulation(EnvConfig(app=app, vision=VisionConfig(width=24, height=16)), 2)
    simulation.reset(seeds=[1, 2])
    still = np.zeros((2, simulation.action_space.shape[0]))
    simulation.step(still)
    killed: Any = simulation.apps[0]
    os.killpg(killed.app._browser.process.pid, signal.SIGKILL)
    batch = simulation.step(still)
    assert batch.truncated.tolist() == [True, False]
    assert batch.info(0)["termination"] == "app_failed"
    assert "killed (SIGKILL)" in batch.info(0)["app_error"]
    simulation.reset(ids=[0])
    assert simulation.step(still).answered.all()
    simulation.close()


@NEEDS_BROWSER
@pytest.mark.parametrize("loading", [False, True])
def test_a_crashed_tab_is_given_up_at_once(loading: bool, tmp_path: Path) -> None:
    script = "for (;;);" if loading else ENTERS % "if (frames === 3) for (;;);"
    with open_page(page_with(tmp_path, script)) as app:
        pid = app._browser.process.pid
        if not loading:
            app.reset(1, hands(0))
        timer = threading.Timer(2.0, lambda: os.kill(of_type(pid, "renderer"), signal.SIGKILL))
        timer.start()
        began = time.monotonic()
        with pytest.raises(AppDied, match=r"page\.html: its tab crashed") as caught:
            app.reset(1, hands(0)) if loading else play(app)
        assert time.monotonic() - began < 10.0
        assert "\n" not in str(caught.value)
        timer.join()
    assert emptied(pid, 5.0)


def play(app: Any) -> None:
    for step in range(1, 6):
        app.step(frame_time_ns(step, 20), hands(step))


ENDINGS = {
    "exits": None,
    "SIGKILL": signal.SIGKILL,
    "SIGTERM": signal.SIGTERM,
}


@NEEDS_BROWSER
@pytest.mark.parametrize("hung", [False, True])
@pytest.mark.parametrize("ending", ENDINGS)
def test_no_browser_outlives_the_harness(ending: str, hung: bool, tmp_path: Path) -> None:
    code = (
        "import sys, time; sys.path.insert(0, 'tests'); import webxr_pages as pages\n"
        "app = pages.open_page(pages.PAGES / 'touch.html'); app.reset(1, pages.hands(0))\n"
        "print(app._browser.process.pid, app._browser._home, flush=True); sys.stdin.readline()"
    )
    harness = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert harness.stdout is not None
    number, home = harness.stdout.readline().split()
    assert len(group(int(number))) > 2
    assert Path(home, "profile").is_dir()
    if hung:
        os.kill(of_type(int(number), "gpu-process"), signal.SIGSTOP)
    if (by := ENDINGS[ending]) is not None:
        harness.send_signal(by)
    harness.communicate("\n", timeout=20)
    assert emptied(int(number), 5.0)
    assert gone(Path(home).parent)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


@pytest.mark.parametrize(
    ("page", "mapped", "words"),
    [
        ("nowhere.html", {}, r"app\.page: got 'nowhere\.html', which is no file"),
        (".", {}, r"app\.page: got '\.', which is no file"),
        (
            "https://x.example.com/a.html",
            {},
            r"app\.page: .*no file below the addresses of app.map",
        ),
        ("page.html", {"cdn": "."}, r"app\.map: got 'cdn', expected the beginning of an address"),
        (
            "page.html",
            {"https://c.de/": "no"},
            r"app\.map: got 'no' for https://c\.de/, which is not",
        ),
    ],
)
def test_places_that_are_not_there(page: str, mapped: dict[str, str], words: str) -> None:
    with pytest.raises(AppRefused, match=words):
        PageFiles(page, mapped)


def test_a_sandbox_that_cannot_be_had_is_said_in_one_line(tmp_path: Path) -> None:
    browser = tmp_path / "chromium"
    browser.write_text(
        "#!/bin/sh\necho 'FATAL: No usable sandbox! If this is Debian,' >&2; exit 1\n"
    )
    browser.chmod(0o755)
    with pytest.raises(AppRefused, match=r"app\.browser: got .*chromium, whose sandbox") as caught:
        Browser(str(browser), 30.0)
    assert "\n" not in str(caught.value)


@NEEDS_BROWSER
def test_settings_that_cannot_be() -> None:
    with pytest.raises(AppRefused, match=r"app\.browser: got '/bin/nope', which is no program"):
        open_page(PAGES / "touch.html", browser="/bin/nope")
    with pytest.raises((AppDied, AppRefused), match="true"):
        open_page(PAGES / "touch.html", browser="true")
    with pytest.raises(AppRefused, match=r"profile: got 'hands', expected one of oculus-touch"):
        open_page(PAGES / "touch.html", options={"profile": "hands"})
    with (
        open_page(PAGES / "touch.html", values={"x": "app.scor.x"}) as app,
        pytest.raises(
            AppRefused, match=r"'app\.scor\.x', of which .*touch\.html says: Cannot read"
        ),
    ):
        app.reset(1, hands(0))
