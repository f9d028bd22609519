"""Pages that cannot be played, or not any more: one line each that names page and cause."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from processes import emptied, group
from sim2vr_harness.client import AppDied, AppRefused, AppTimeout, frame_time_ns
from sim2vr_harness.client.webxr.browser import Browser, find_browser
from sim2vr_harness.client.webxr.files import HOST, PageFiles
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
        r"asks for a session of immersive-ar, which is not covered",
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
    "WebGL 1": (
        "import { Boxes, button } from './boxes.js'; const boxes = new Boxes('webgl');"
        "button('Enter VR', () => boxes.enter(() => {}).catch(() => {}));",
        r"the page draws with WebGL 1, expected WebGL 2",
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
    with pytest.raises(AppRefused, match=words) as caught:
        loading(browser, page)
    assert "\n" not in str(caught.value)
    assert "page.html" in str(caught.value)


@NEEDS_BROWSER
def test_an_endless_loop_at_the_start_takes_its_time_only(tmp_path: Path) -> None:
    page = page_with(tmp_path, "for (;;);")
    with (
        open_page(page, start_timeout_s=4.0) as app,
        pytest.raises(AppTimeout, match=r"gave no answer to loading .*page\.html within 4 s"),
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
    "unmapped address": (
        "if (frames === 3) fetch('https://example.com/score').catch(() => {});",
        AppDied,
        r"page\.html: asks for https://example\.com/score",
    ),
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", DIES)
def test_a_page_that_fails_in_a_round_ends_it_and_is_replaced(what: str, tmp_path: Path) -> None:
    script, error, words = DIES[what]
    page = page_with(tmp_path, ENTERS % script)
    timeout_s = 3.0 if what == "endless loop" else 30.0
    with open_page(page, timeout_s=timeout_s) as app:
        app.reset(1, hands(0))
        with pytest.raises(error, match=words) as caught:
            for step in range(1, 6):
                app.step(frame_time_ns(step, 20), hands(step))
        assert "\n" not in str(caught.value)
        with pytest.raises(AppDied, match="was given up"):
            app.step(frame_time_ns(9, 20), hands(9))


@NEEDS_BROWSER
def test_errors_that_a_page_survives_can_be_ignored(tmp_path: Path) -> None:
    page = page_with(tmp_path, ENTERS % "if (frames === 2) setTimeout(() => nothing(), 1);")
    with open_page(page, options={"script_errors": "ignore"}) as app:
        app.reset(1, hands(0))
        for step in range(1, 6):
            app.step(frame_time_ns(step, 20), hands(step))


@NEEDS_BROWSER
def test_a_session_that_the_page_ends_ends_the_round(tmp_path: Path) -> None:
    page = page_with(tmp_path, ENTERS % "if (frames === 3) boxes.session.end();")
    with open_page(page) as app:
        for _ in range(2):
            ends = [app.reset(1, hands(0)).finished]
            ends += [app.step(frame_time_ns(k, 20), hands(k)).finished for k in (1, 2)]
            assert ends == [False, False, True]


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
@pytest.mark.parametrize("ending", ["killed", "exits"])
def test_no_browser_outlives_the_harness(ending: str) -> None:
    code = (
        "import sys, time; sys.path.insert(0, 'tests'); import webxr_pages as pages\n"
        "app = pages.open_page(pages.PAGES / 'touch.html'); app.reset(1, pages.hands(0))\n"
        "print(app._browser.process.pid, app._browser._home, flush=True)\n"
        + ("time.sleep(600)" if ending == "killed" else "")
    )
    harness = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert harness.stdout is not None
    number, home = harness.stdout.readline().split()
    if ending == "killed":
        assert group(int(number))
        harness.kill()
    harness.wait(20)
    harness.stdout.close()
    assert emptied(int(number))
    if ending == "exits":
        assert not Path(home).exists()


# --- what a page may not ----------------------------------------------------------------------

PRYING = """import { Boxes, button } from './boxes.js';
const app = window.app = { told: '' };
const tell = (what) => { app.told += what + ' '; };
const status = (url) => fetch(url).then((reply) => reply.status, () => 'refused');
tell(await status('../secret.txt'));
tell(await status('%2e%2e/secret.txt'));
tell(await status('..%2fsecret.txt'));
tell(await status('link.txt'));
tell(await status('inside.txt'));
for (const make of [
  () => new WebSocket('ws://127.0.0.1:9'), () => new RTCPeerConnection(),
  () => new SharedWorker('worker.js'),
]) { try { make(); tell('made'); } catch { tell('none'); } }
tell(await navigator.storage.getDirectory().then(() => 'made', () => 'none'));
tell(window.open('about:blank') === null ? 'none' : 'made');
const worker = new Worker('worker.js');
tell(await new Promise((resolve) => { worker.onmessage = ({ data }) => resolve(data); }));
const boxes = new Boxes();
button('Enter VR', () => boxes.enter(() => {}));
"""
WORKER = """const tries = ['https://example.com/', 'http://127.0.0.1:%d/', 'file:///etc/passwd'];
Promise.all(tries.map((url) => fetch(url).then(() => 'reached', () => 'refused')))
  .then((found) => new Promise((resolve) => {
    const socket = new WebSocket('ws://127.0.0.1:%d/');
    socket.onopen = () => resolve([...found, 'reached']);
    socket.onerror = () => resolve([...found, 'refused']);
  })).then((found) => postMessage(found.join(' ')));"""


@NEEDS_BROWSER
def test_a_page_cannot_leave_its_folder(tmp_path: Path) -> None:
    import socket

    folder = tmp_path / "page"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "inside.txt").write_text("inside")
    (folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    page = page_with(folder, PRYING)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        (folder / "worker.js").write_text(WORKER % (port, port))
        before = sorted(tmp_path.rglob("*"))
        with open_page(page) as app:
            try:
                app.reset(1, hands(0))
            except AppRefused as error:
                # The worker's own tries are seen, or it answers too late for this page.
                assert re.search("which app.map maps to no folder|never calls WebXR", str(error))
            deadline = time.monotonic() + 30.0
            told: list[str] = []
            while len(told) < 14 and time.monotonic() < deadline:
                told = app._page._evaluate("app.told").split()
                time.sleep(0.05)
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()
    assert told[:5] == ["404", "404", "404", "404", "200"]
    assert told[5:10] == ["none"] * 5
    assert told[10:] == ["refused"] * 4
    assert sorted(tmp_path.rglob("*")) == before


def test_addresses_lead_below_their_folders_only(tmp_path: Path) -> None:
    page = tmp_path / "page"
    engine = tmp_path / "engine"
    for folder in (page, engine / "build"):
        folder.mkdir(parents=True)
    (page / "index.html").write_text("<!doctype html>")
    (page / "a b.txt").write_text("spaced")
    (engine / "build" / "e.mjs").write_text("export {}")
    (tmp_path / "secret.txt").write_text("secret")
    cdn = "https://cdn.example.com/engine@1/"
    files = PageFiles(
        str(page), {cdn: str(engine), "https://one.example.com/x.js": str(engine / "build/e.mjs")}
    )
    assert files.url == f"{HOST}index.html"
    assert files.answer(f"{HOST}a%20b.txt?version=2#top").content == b"spaced"
    found = files.answer(f"{cdn}build/e.mjs")
    assert (found.status, found.mime) == (200, "text/javascript")
    assert files.answer("https://one.example.com/x.js").content == b"export {}"
    assert files.answer("https://one.example.com/x.js.map").status == 404
    for url in (
        f"{HOST}../secret.txt",
        f"{HOST}%2e%2e/secret.txt",
        f"{cdn}/etc/passwd",
        f"{HOST}%00",
    ):
        assert files.answer(url).status == 404
    assert files.answer("https://cdn.example.com/other/e.mjs").status == 0
    assert files.refused == ["https://cdn.example.com/other/e.mjs"]


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
