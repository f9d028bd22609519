"""OpenXR programs: the channel, values, rounds, and what goes wrong, with stand-ins."""

import json
import os
import re
import signal
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from openxr_programs import PLAY, hands, manifest, open_program, program
from sim2vr_harness.cli.main import main
from sim2vr_harness.client import (
    AppDied,
    AppError,
    AppRefused,
    AppTimeout,
    AppUnsupported,
    DevicePoses,
    HapticPulse,
    ProtocolError,
    frame_time_ns,
)

VALUES = {
    "score": r'printed("score: (\d+)")',
    "lines": 'printed("score")',
    "hits": r'label("hits (\d+)")',
    "labels": 'label("hits")',
    "buzzes": 'haptics("right")',
    "left": 'haptics("left")',
    "height": 'pose("right_controller.y")',
    "ball": r"printed('target at (\S+) (\S+) (\S+)')",
    "over": r'printed("score: (\d+)") >= 20',
}


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIM2VR_OPENXR_RUNTIME", str(manifest(tmp_path)))


def test_a_round_and_its_values(tmp_path: Path) -> None:
    with open_program(program(tmp_path), values=VALUES) as app:
        reply = app.reset(1, hands())
        at_rest = {"score": None, "lines": 0, "hits": None, "labels": 0, "buzzes": 0, "left": 0}
        assert reply.values == {**at_rest, "height": 1.1, "ball": None, "over": False}
        assert (app.image == [2, 110, 0, 128]).all()
        for step in (1, 2):
            reply = app.step(frame_time_ns(step, 20), hands(1.25, trigger=1.0))
            assert reply.haptics == (HapticPulse("right", 0.5, 0.0, 0.02),)
        assert reply.values == {
            "score": 20.0,
            "lines": 2,
            "hits": 2.0,
            "labels": 2,
            "buzzes": 2,
            "left": 0,
            # OpenXR's z points backwards, the app frame's forwards.
            "height": 1.25,
            "ball": (0.1, 1.25, 0.5),
            "over": True,
        }
        assert (app.image == [4, 125, 0, 128]).all()
        assert not reply.finished
        assert app.renderer_description == "fake over OpenXR (egl)"
        assert app.reset(1, hands()).values["score"] is None


def test_frames_of_a_step_and_the_one_that_is_drawn(tmp_path: Path) -> None:
    poses = DevicePoses.stack([hands(h) for h in (1.0, 1.1, 1.2)])
    with open_program(program(tmp_path), eyes=2) as app:
        app.reset(1, hands())
        times = np.array([frame_time_ns(k, 60) for k in (1, 2, 3)])
        app.step_frames(times, poses)
        assert (app.image[0] == [5, 120, 0, 128]).all()
        assert (app.image[1] == [5, 120, 1, 128]).all()
        app.step_frames(times + frame_time_ns(3, 60), poses, 0)
        assert (app.image[0] == [6, 100, 0, 128]).all()
        with pytest.raises(AppRefused, match=r"time_ns: got .* expected no step backwards"):
            app.step_frames(times, poses)


def test_each_round_is_another_process_and_arguments_have_the_seed(tmp_path: Path) -> None:
    place = tmp_path / "seeds"
    place.mkdir()
    note = "open(os.path.join(sys.argv[2], f'{sys.argv[1]} {os.getpid()}'), 'w')\n"
    with open_program(program(tmp_path, note + PLAY), "{seed}-{level}", str(place)) as app:
        for seed in (3, 4):
            app.reset(seed, hands(), {"level": 2})
    names = sorted(one.name.split()[0] for one in place.iterdir())
    assert names == ["3-2", "4-2"]
    assert len({one.name.split()[1] for one in place.iterdir()}) == 2


# --- what goes wrong ---------------------------------------------------------------------------

NO_IMAGES = "graphics='egl', depth_layers=True, image_bytes=0"
SMALL = "[os.memfd_create('small')] * 3"
NO_MEMORY = r"it sent no memory that its images fit into"
LATE = "say(8, call='xrEndFrame', reason='did not follow xrBeginFrame within 10 s')"
FOOT = "dict(kind='haptic', hand='foot', amplitude=1, duration_ns=0)"
NO_HAND = r"events, 0, haptic, hand: got 'foot', expected 'left' or 'right'"
FLAT = "answer(step()[0], 1, has_depth=False)"
NO_DEPTH = r"vision.channels: got depth, but fake.py"


@pytest.mark.parametrize(
    ("body", "error", "words"),
    [
        ("import time; time.sleep(60)", AppTimeout, r"no xrCreateInstance within 1 s; is it an"),
        ("hello(); time.sleep(60)", AppTimeout, r"no xrCreateSession within 1 s; it made an inst"),
        ("print('no GPU'); sys.exit(5)", AppDied, r"status 5 before its xrCreateInst.*no GPU"),
        ("print('qt.qpa.xcb: no display'); sys.exit(6)", AppRefused, r"^--xvfb: got no display"),
        (f"hello(); say(3, {SMALL}, {NO_IMAGES}); time.sleep(9)", ProtocolError, NO_MEMORY),
        (
            f"session(hello()); step(); {LATE}; time.sleep(9)",
            AppDied,
            r"xrEndFrame: did not follow",
        ),
        (f"session(hello()); answer([], 0, [{FOOT}]); time.sleep(9)", ProtocolError, NO_HAND),
        ("session(hello(), depth=False)", AppRefused, rf"{NO_DEPTH} does not enable the extension"),
        (f"session(hello()); {FLAT}; time.sleep(9)", AppRefused, rf"{NO_DEPTH} submits no depth"),
    ],
)
def test_failures_are_one_sentence(
    tmp_path: Path, body: str, error: type[Exception], words: str
) -> None:
    with (
        open_program(program(tmp_path, body), timeout_s=1.0, start_timeout_s=1.0) as app,
        pytest.raises(error, match=f"(?s){words}"),
    ):
        app.reset(1, hands())


def leaving(folder: Path, after: int, then: str, call: str = "xrRequestExitSession") -> Path:
    """A program that ends its session in the frame after so many, and does ``then``."""
    leave = f"    if shown > {after}: say(8, reason='', call='{call}'); {then}\n"
    return program(folder, PLAY.replace("    answer(", f"{leave}    answer("))


def test_a_program_that_leaves_ends_the_round(tmp_path: Path) -> None:
    with open_program(leaving(tmp_path, 3, "sys.exit(0)")) as app:
        app.reset(1, hands())
        reply = app.step(frame_time_ns(1, 20), hands())
        assert (reply.finished, reply.left) == (False, "")
        reply = app.step(frame_time_ns(2, 20), hands())
        words = "fake: the program ended its session (xrRequestExitSession) after 0.1 s"
        assert (reply.finished, reply.left) == (True, f"{words}, ended with exit status 0")
        with pytest.raises(AppError, match=f"^step: {re.escape(words)}.*; call reset first"):
            app.step(frame_time_ns(3, 20), hands())
        assert not app.reset(1, hands()).finished
    with open_program(leaving(tmp_path, 2, "time.sleep(60)")) as app:
        app.reset(1, hands())
        assert app.step(frame_time_ns(2, 20), hands()).left == words  # no status after a second


@pytest.mark.parametrize(
    ("after", "then", "error", "words"),
    [
        (2, "sys.exit(3)", AppDied, r"\(xrDestroySession\) after 1\.5 s, ended with exit status 3"),
        (0, "sys.exit(0)", AppRefused, r"before its first frame, ended with exit status 0, exp"),
    ],
)
def test_a_program_that_leaves_early_or_fails_then_is_named(
    tmp_path: Path, after: int, then: str, error: type[Exception], words: str
) -> None:
    file = leaving(tmp_path, after, then, "xrDestroySession")
    with open_program(file) as app, pytest.raises(error, match=rf"^fake: the program .*{words}"):
        app.reset(1, hands())
        app.step(frame_time_ns(30, 20), hands())


def test_rounds_say_that_their_program_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the table, in results.json, and in a sentence; a status is a failure."""
    play = ["--user", "still", "--episodes", "1", "--out", str(tmp_path / "results")]
    play += ["--set", "env.app.task={seconds: 3}"]
    with pytest.raises(SystemExit, match="0"):
        main(["evaluate", "--openxr", str(leaving(tmp_path, 20, "sys.exit(0)")), *play])
    said = capsys.readouterr()
    assert "the program ended its session (xrRequestExitSession) after 0.9 s" in said.err
    found = json.loads((tmp_path / "results/results.json").read_text())["standard"]
    assert (found["app_left"], found["app_failed"]) == (1, 0)
    assert "App left VR by itself" in said.out


def pids(folder: Path) -> list[int]:
    """Processes of the programs of a folder."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = file.read_bytes().split(b"\0")
            if len(words) > 1 and words[1].startswith(os.fsencode(folder)):
                found.append(int(file.parent.name))
    return found


def test_a_killed_program_is_started_again(tmp_path: Path) -> None:
    with open_program(program(tmp_path)) as app:
        app.reset(1, hands())
        os.kill(pids(tmp_path)[0], signal.SIGKILL)
        with pytest.raises(AppDied, match=r"was killed \(SIGKILL\) before its answer to a step"):
            app.step(frame_time_ns(1, 20), hands())
        app.reset(1, hands())
        assert app.usable


def test_what_cannot_be_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_program(program(tmp_path)) as app:
        for capability, call in (
            ("save", app.save),
            ("views", lambda: app.render_third_person(8, 8)),
            ("time_ns", lambda: app.reset(1, hands(), time_ns=5)),
        ):
            with pytest.raises(AppUnsupported, match=f"^{capability}: a program"):
                call()
    with pytest.raises(AppRefused, match=r"frame_rate_hz: got '60', expected one of 72, 90"):
        open_program(program(tmp_path), options={"frame_rate_hz": 60})
    monkeypatch.setenv("SIM2VR_OPENXR_RUNTIME", "/none.json")
    with pytest.raises(AppRefused, match=r"OpenXR runtime: got '/none.json' in SIM2VR_OPENXR_RUNT"):
        open_program(program(tmp_path))


@pytest.mark.parametrize(
    ("engine", "options", "far"),
    [("", {}, 10.0), ("Qt", {}, 2000.0), ("Qt", {"depth_unit_m": "0.01"}, 1000.0)],
)
def test_depth_is_in_the_unit_of_the_engine(
    tmp_path: Path, engine: str, options: dict[str, object], far: float
) -> None:
    """10 m in the units of the program."""
    told = (
        "plain = say\n"
        "say = lambda kind, *files, **what: plain(\n"
        f"    kind, *files, **(what | {{'engine': {engine!r}}}))\n"
        "config = hello()\n"
        "print('far:', config['farthest_m'], flush=True)\n"
    )
    file = program(tmp_path, PLAY.replace("config = hello()\n", told))
    with open_program(file, values={"far": r'printed("far: (\S+)")'}, options=options) as app:
        assert app.reset(1, hands()).values["far"] == far
