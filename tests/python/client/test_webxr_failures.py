"""Pages that cannot be played, or not any more: one line each that names page and cause."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from processes import emptied, gone, group, of_type
from sim2vr_harness.client import (
    AppDied,
    AppError,
    AppRefused,
    AppTimeout,
    WebXRApp,
    frame_time_ns,
    limits,
)
from sim2vr_harness.client.limits import Kept
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from webxr_pages import NEEDS_BROWSER, PAGES, hands, open_page, page_with

ENTERS = """import { Boxes, button } from './boxes.js';
let frames = 0;
const boxes = new Boxes();
button('Enter VR', () => boxes.enter(() => { frames += 1; %s }));"""

REFUSED = {
    "no WebXR call": ("document.title = 'flat';", r"never calls WebXR \(navigator\.xr\)"),
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
    "source code": (
        "import './main.ts';",
        r"never calls WebXR .*loads https://\S*/main\.ts, source code that no browser runs: build",
    ),
    "WebVR": (
        "navigator.getVRDisplays = () => Promise.resolve([]);",
        r"page\.html: uses WebVR, which WebXR replaced, expected an engine with WebXR",
    ),
    "WebGL 1 without its extensions": (
        "import { Boxes, button } from './boxes.js'; const boxes = new Boxes('webgl');"
        "WebGLRenderingContext.prototype.getExtension = () => null;"
        "button('Enter VR', () => boxes.enter(() => {}).catch(() => {}));",
        r"draws with WebGL 1, where this browser has no WEBGL_depth_texture, expected WebGL 2",
    ),
}


Shared = Callable[..., WebXRApp]


@NEEDS_BROWSER
@pytest.mark.parametrize("what", REFUSED)
def test_a_page_that_cannot_be_played_says_why(what: str, shared: Shared) -> None:
    script, words = REFUSED[what]
    beside = {"main.ts": "export const lamps: number = 3;\n"}
    app = shared(script, beside=beside, options={"script_errors": "fail"})
    with pytest.raises(AppRefused, match=words) as caught:
        app.reset(1, hands(0))
    assert "\n" not in str(caught.value)
    assert "page.html" in str(caught.value)


DIES = {
    "endless loop": ("if (frames === 3) for (;;);", AppTimeout, r"gave no answer to .*page\.html"),
    "script error": (
        "if (frames === 3) frames.explode();",
        AppDied,
        r"page\.html: script error: TypeError: frames\.explode is not a function",
    ),
    "lost context": (
        "if (frames === 3) boxes.gl.getExtension('WEBGL_lose_context').loseContext();",
        AppDied,
        r"page\.html: lost its WebGL context",
    ),
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", DIES)
def test_a_page_that_fails_in_a_round_ends_it_and_is_replaced(what: str, shared: Shared) -> None:
    script, error, words = DIES[what]
    timeout_s = 3.0 if what == "endless loop" else 30.0
    app = shared(ENTERS % script, timeout_s=timeout_s, options={"script_errors": "fail"})
    app.reset(1, hands(0))
    with pytest.raises(error, match=words) as caught:
        play(app)
    assert "\n" not in str(caught.value)
    with pytest.raises(AppDied, match="was given up"):
        app.step(frame_time_ns(9, 20), hands(9))


@NEEDS_BROWSER
def test_a_session_that_the_page_ends_ends_the_round(shared: Shared) -> None:
    app = shared(ENTERS % "if (frames === 3) boxes.session.end();")
    for _ in range(2):
        ends = [app.reset(1, hands(0)).finished]
        ends += [app.step(frame_time_ns(k, 20), hands(k)).finished for k in (1, 2)]
        assert ends == [False, False, True]
    words = r"page\.html: the page ended its session .* after 0\.1 s; call reset"
    with pytest.raises(AppError, match=words):
        app.step(frame_time_ns(3, 20), hands(3))


def stepped(page: Path, users: int) -> tuple[Simulation, np.ndarray]:
    app = AppConfig(transport="webxr", page=str(page), task={"seconds": 5})
    simulation = Simulation(EnvConfig(app=app, vision=VisionConfig(width=24, height=16)), users)
    simulation.reset(seeds=range(1, users + 1))
    return simulation, np.zeros((users, simulation.action_space.shape[0]))


@NEEDS_BROWSER
def test_a_round_says_that_its_page_left(tmp_path: Path) -> None:
    page = page_with(tmp_path, ENTERS % "if (frames === 5) boxes.session.end();")
    simulation, still = stepped(page, 1)
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
    simulation, still = stepped(PAGES / "touch.html", 2)
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
def test_a_crashed_tab_is_given_up_at_once(tmp_path: Path) -> None:
    with open_page(page_with(tmp_path, ENTERS % "if (frames === 3) for (;;);")) as app:
        pid = app._browser.process.pid
        app.reset(1, hands(0))
        timer = threading.Timer(2.0, lambda: os.kill(of_type(pid, "renderer"), signal.SIGKILL))
        timer.start()
        began = time.monotonic()
        with pytest.raises(AppDied, match=r"page\.html: its tab crashed"):
            play(app)
        assert time.monotonic() - began < 10.0
        timer.join()
    assert emptied(pid, 5.0)


def play(app: Any) -> None:
    for step in range(1, 6):
        app.step(frame_time_ns(step, 20), hands(step))


@NEEDS_BROWSER
@pytest.mark.parametrize(("ending", "hung"), [(None, False), (signal.SIGKILL, True)])
def test_no_browser_outlives_the_harness(
    ending: signal.Signals | None, hung: bool, tmp_path: Path
) -> None:
    code = (
        "import sys, time; sys.path.insert(0, 'tests'); import webxr_pages as pages\n"
        "app = pages.open_page(pages.PAGES / 'touch.html'); app.reset(1, pages.hands(0))\n"
        "print(app._browser.process.pid, app._browser.home, flush=True); sys.stdin.readline()"
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
    if ending is not None:
        harness.send_signal(ending)
    harness.communicate("\n", timeout=20)
    assert emptied(int(number), 5.0)
    assert gone(Path(home).parent)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


# --- what a page may have us keep, and how much memory it may take --------------------------------


def test_the_first_and_the_last_texts_are_kept() -> None:
    kept = Kept()
    for k in range(1000):
        kept.add(f"{k} " + "x" * 10_000)
    words = [text.split()[0] for text in kept]
    assert words == [str(k) for k in [*range(20), *range(980, 1000)]]
    assert (len(kept), max(map(len, kept))) == (1000, 300)
    assert (kept.first[:2], kept.last[:4]) == ("0 ", "999 ")


@NEEDS_BROWSER
@pytest.mark.parametrize("kept", ["new Uint8Array(2e7).fill(1)"])
def test_a_page_that_takes_too_much_memory_has_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: str
) -> None:
    monkeypatch.setattr(limits, "MOST_MEMORY_BYTES", 400 << 20)
    script = f"""import {{ Boxes, button }} from './boxes.js';
    const boxes = new Boxes();
    const all = [];
    let frames = 0;
    const take = () => {{ while (frames > 0) all.push({kept}); frames++; }};
    button('Enter VR', () => boxes.enter(take));"""
    with open_page(page_with(tmp_path, script)) as app:
        app.reset(1, hands(0))
        with pytest.raises(
            AppDied,
            match=r"page\.html: takes \d+ MB of memory with its browser, expected at most 400",
        ):
            app.step(frame_time_ns(1, 20), hands(1))
