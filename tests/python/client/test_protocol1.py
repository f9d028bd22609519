"""Protocol 1 against a stand-in that knows the reference's fields only, faults included."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.base.notices import set_notice
from sim2vr_harness.client import (
    INPUT_COUNT,
    AppDied,
    AppError,
    AppRefused,
    AppTimeout,
    AppUnsupported,
    DevicePoses,
    Protocol1App,
    ProtocolError,
    connect,
    frame_time_ns,
    start_unity_app,
    unity_arguments,
)
from sim2vr_harness.client.protocol1 import decode_reply, log_in

POSES = DevicePoses(
    head=np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0]),
    right_controller=np.array([0.25, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0]),
)
ONE = DevicePoses(POSES.head[None], POSES.right_controller[None])  # type: ignore[index]
FIELDS = {
    *("headsetPosition", "headsetRotation", "leftControllerPosition", "leftControllerRotation"),
    *("rightControllerPosition", "rightControllerRotation", "currentTimestep", "nextTimestep"),
    *("reset", "isFinished", "quitApplication"),
}


@contextmanager
def started(
    executable: Path, *arguments: str, timeout_s: float = 20.0, **settings: Any
) -> Iterator[Protocol1App]:
    channel = start_unity_app(executable, arguments).channel(timeout_s, 20.0)
    with Protocol1App(channel, **settings) as app:
        yield app


def play(app: Protocol1App, steps: int, start: int = 1) -> list[Any]:
    return [app.step(frame_time_ns(k, 20), POSES) for k in range(start, start + steps)]


@pytest.fixture(autouse=True)
def _no_orphans(no_orphans: Callable[[], list[int]]) -> None:
    pass


def test_a_round_follows_the_reference(fake_app: Path, tmp_path: Path) -> None:
    record = tmp_path / "messages"
    with started(fake_app, "-round", "0.5", "-record", str(record)) as app:
        reply = app.reset(7, POSES)
        # A reset's reply counts for image and time feature only (the stand-in says 99).
        assert (reply.reward, reply.finished, reply.time_feature) == (0.0, False, -1.0)
        replies = play(app, 11)
        assert [reply.finished for reply in replies] == [False] * 10 + [True]
        assert [reply.reward for reply in replies] == [0.25] * 11
        assert replies[4].time_feature == pytest.approx(2 * 0.25 / 0.5 - 1)
        assert replies[4].log == {"Points": 5.0, "Elapsed": pytest.approx(0.25)}
        assert app.image.shape == (80, 120, 4)
        assert app.image[7, 33].tolist() == [33, 7, 11, 50]  # 20 * 0.55 s, 100 * 0.5 m
        app.reset(8, POSES)
        play(app, 1)
    handshake, *states, quit_ = [json.loads(line) for line in record.read_text().splitlines()]
    assert handshake["timestep"] == 0.002
    assert (handshake["sampleFrequency"], handshake["timeScale"]) == (20, 5)
    assert quit_ == {"quitApplication": True}
    assert all(set(state) == FIELDS for state in states)
    assert [state["reset"] for state in states] == [True] + [False] * 11 + [True, False]
    # The clock runs on over the rounds, from where the last one ended.
    times = [*(0.05 * k for k in range(12)), 0.55, 0.60]
    assert [state["currentTimestep"] for state in states] == pytest.approx(times, abs=1e-12)
    assert [state["nextTimestep"] for state in states] == pytest.approx(
        [time + 0.05 for time in times], abs=1e-12
    )
    assert states[3]["currentTimestep"] == 3 / 20
    assert states[0]["leftControllerRotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert states[0]["rightControllerPosition"] == {"x": 0.25, "y": 1.0, "z": 0.5}


def test_the_user_ends_a_round(fake_app: Path, tmp_path: Path) -> None:
    record = tmp_path / "messages"
    with started(fake_app, "-round", "60", "-record", str(record)) as app:
        app.reset(0, POSES)
        app.start_step(np.array([frame_time_ns(1, 20)]), ONE, last=True)
        reply = app.finish_step()
        # The app says finished because it was told to; the game did not end the round.
        assert not reply.finished
        assert json.loads(record.read_text().splitlines()[2])["isFinished"] is True
        with pytest.raises(AppError, match="call reset first"):
            app.step(frame_time_ns(2, 20), POSES)
        app.reset(0, POSES)
    with started(fake_app, "-fault", "deaf@2") as app:
        app.reset(1, POSES)
        app.start_step(np.array([50_000_000]), ONE, last=True)
        with pytest.raises(ProtocolError, match="informed that the round is over"):
            app.finish_step()


def test_what_the_reference_has_no_word_for(fake_app: Path) -> None:
    with started(fake_app, options={"condition": "medium"}) as app:
        assert app.capabilities == {"left_controller"}
        app.reset(1, POSES, {"condition": "medium"})
        for call in (app.save, app.state_hash, lambda: app.load(b""),
                     lambda: app.render_headset(30, 20),
                     lambda: app.render_third_person(30, 20),
                     lambda: app.head_request(1)):  # fmt: skip
            with pytest.raises(AppUnsupported, match=r"^(save|views|head_request): .*-app has"):
                call()
        with pytest.raises(AppUnsupported, match=r"^inputs: .*of the right controller"):
            app.step(50_000_000, replace(POSES, right_inputs=np.ones(INPUT_COUNT)))
        np.testing.assert_array_equal(app.render_headset(120, 80), app.image)
        with pytest.raises(AppRefused, match=r"condition: got 'hard'.*expected 'medium'"):
            app.reset(1, POSES, {"condition": "hard"})
        play(app, 1)  # and nothing has happened to the round


@pytest.mark.parametrize(
    ("fault", "error", "message"),
    [
        ("die", AppDied, r"ended with exit status 1 during a step(.|\n)*NullReferenceException"),
        ("leave", AppDied, r"closed its connection during a step"),
        ("hang", AppTimeout, r"gave no answer to a step within 0.5 s, though its process is"),
        ("garbage", ProtocolError, r"answered a step with another thing: the reply: got .*decode"),
        ("reward", ProtocolError, r"reward: got 'much', expected a finite number"),
        ("missing", ProtocolError, r"timeFeature: got nothing, expected a value"),
        ("image", ProtocolError, r"image: .*expected an array of bytes"),
        ("size", ProtocolError, r"image: got 90 x 60 pixels, expected 120 x 80"),
        ("overflow", ProtocolError, r"reward: got 1e\+39, expected at most 3.4e\+38"),
        ("deep", ProtocolError, r"logDict: got '\[+\.\.\.\[+', expected JSON nested at most 100 d"),
        ("deep-reply", ProtocolError, r"the reply: got .*, expected JSON nested at most 100 deep"),
        ("bomb", ProtocolError, r"image: got .*decompression bomb.*expected a PNG file"),
    ],
)
def test_faults_in_mid_step(
    fake_app: Path, fault: str, error: type[Exception], message: str
) -> None:
    timeout_s = 0.5 if error is AppTimeout else 20.0
    with started(fake_app, "-fault", f"{fault}@3", timeout_s=timeout_s) as app:
        app.reset(1, POSES)
        play(app, 1)
        with pytest.raises(error, match=message):
            play(app, 1, start=2)
        # It stays given up, whatever is asked.
        with pytest.raises(AppDied, match="was given up: "):
            play(app, 1, start=3)
        with pytest.raises(AppDied, match="was given up: "):
            app.reset(1, POSES)


def test_what_is_refused_at_the_start(fake_app: Path) -> None:
    with pytest.raises(AppRefused, match=r"refused its arguments: condition: got nothing"):
        started(fake_app, "-refuse").__enter__()
    with (
        started(fake_app, width=60, height=40) as app,
        pytest.raises(AppRefused, match=r"vision.width.*60 x 40.*120 x 80, expected the app"),
    ):
        app.reset(1, POSES)
    with pytest.raises(AppTimeout, match=r"the app at tcp://127.0.0.1:9 gave no answer to the h"):
        Protocol1App(connect("127.0.0.1:9", 0.3), start_timeout_s=0.3)


def test_an_app_that_runs_already(fake_app: Path, tmp_path: Path) -> None:
    starting = start_unity_app(fake_app, ())
    port = starting.process.command[3]
    with Protocol1App(connect(f"127.0.0.1:{port}", 5.0)) as app:
        app.reset(1, POSES)
        play(app, 2)
        assert app.renderer_description == f"the app at tcp://127.0.0.1:{port} (protocol 1)"
        starting.process.kill()
        with pytest.raises(AppDied, match="closed the connection during a step"):
            play(app, 1, start=3)


def test_options_become_the_references_arguments() -> None:
    said: list[str] = []
    set_notice(said.append)
    try:
        options = {"condition": "hard", "adaptive": True, "sparse": False, "round_seconds": 10.0}
        assert unity_arguments(options, [], None) == ["-condition", "hard", "-adaptive"]
        logs = ["-logging", "-outputFolder", "/logs"]
        assert unity_arguments({}, ["-adaptive"], Path("/logs")) == ["-adaptive", *logs]
    finally:
        set_notice(None)
    assert any("no argument for env.app.options.round_seconds; its own" in one for one in said)


# --- reading replies -------------------------------------------------------------------------


@pytest.mark.parametrize("image", [b"", b"\x00", bytes(range(256)), b"\x89PNG" * 500])
def test_replies_read_the_same_with_and_without_spaces(image: bytes) -> None:
    # A text that looks like the image's field must not be taken for it.
    fields = {"logDict": '{"image":[1,2]}', "image": list(image), "reward": 1.5}
    for spaces in ((",", ":"), (", ", ": ")):
        text = json.dumps(fields, separators=spaces).encode()
        assert decode_reply(text) == ({"logDict": fields["logDict"], "reward": 1.5}, image)
    assert decode_reply(b'{"image":null,"reward":0}') == ({"reward": 0}, b"")
    for numbers in (b"1,2,256", b"1,2,-3", b"1,,2", b"1.5", b'"a"'):
        with pytest.raises(ValueError):
            decode_reply(b'{"image":[' + numbers + b"]}")


def test_the_numbers_of_a_log() -> None:
    # Unity's JSON has what is not finite as a text.
    text = '{"a":1,"b":true,"c":null,"d":"NaN","e":"Infinity","f":1e999}'
    assert log_in(text) == {"a": 1.0, "b": 1.0}
    assert log_in("null") == log_in("") == log_in(None) == {}
    for value in ('{"a":[]}', '{"a":"x"}', '{"a":1' + "0" * 400 + "}"):
        with pytest.raises(ValueError, match=r"^logDict, a: got .*, expected "):
            log_in(value)
