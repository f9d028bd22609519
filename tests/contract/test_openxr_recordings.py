"""Rounds that the recording layer wrote in an unmodified program, played back into it.

The layer lies over this runtime, so that the same devices can be recorded and replayed; the program
answers a replay with the vibrations that it gave when it was recorded.
"""

from pathlib import Path

import numpy as np
import pytest

from openxr_programs import PROGRAMS, Played, hands, opened, playable
from sim2vr_harness.client import DevicePoses, frame_time_ns
from sim2vr_harness.client.openxr.runtime_files import find_runtime
from sim2vr_harness.sessions.formats import read_session
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.session import Session

SQUEEZE = 1
"""Column of the squeeze in a row of inputs."""
STEPS = 60


@pytest.fixture(params=["hello_xr, Vulkan2", "pyopenxr"])
def played(request: pytest.FixtureRequest) -> Played:
    return playable(PROGRAMS[str(request.param)])


def recorded(played: Played, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Session:
    """A round in which the hand squeezes now and then and goes to each target that is printed."""
    layers = find_runtime().parent / "layer"
    if not layers.is_dir():  # of a wheel: beside the runtime
        layers = layers.parent
    file = folder / "round.jsonl"
    with monkeypatch.context() as patch:
        patch.setenv("XR_API_LAYER_PATH", str(layers))
        patch.setenv("XR_ENABLE_API_LAYERS", "XR_APILAYER_SIM2VR_recording")
        patch.setenv("SIM2VR_OPENXR_RECORD", str(file))
        target = r'printed("target: (\S+) (\S+) (\S+)")'
        with opened(played, values={"target": target}) as app:
            reply = app.reset(1, hands())
            for step in range(1, STEPS):
                poses = toward(reply.values["target"], step)
                reply = app.step(frame_time_ns(step, 20), poses)
    return read_session(file)


def toward(target: object, step: int) -> DevicePoses:
    """The right hand, at a target in the second half of a second, and squeezing in the first."""
    poses = hands(1.1 + 0.002 * step)
    assert poses.right_controller is not None and poses.right_inputs is not None
    if step % 20 < 10:
        poses.right_inputs[SQUEEZE] = 1.0
    elif np.size(target) == 3:
        poses.right_controller[:3] = np.asarray(target, float)
    return poses


def test_a_recorded_round_replays_with_the_same_events(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = recorded(played, tmp_path, monkeypatch)
    assert len(session) >= STEPS
    buzzes = [event for event in session.events if event.kind == "haptic"]
    assert len(buzzes) >= 3
    program, *arguments = played.command
    replay = replay_session(
        session,
        app={
            "transport": "openxr",
            "executable": program,
            "arguments": tuple(arguments),
            "options": dict(played.options),
        },
    )
    assert replay.comparison.same, replay.comparison.first
    assert replay.comparison.recorded == len(buzzes)
