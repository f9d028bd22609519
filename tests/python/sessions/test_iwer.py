"""IWER's own recorder and player against our reader and writer, in Node; npm brings it."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from parts import missing
from python.sessions.sessions_made import FRAMES, full_session
from sim2vr_harness.client import input_named
from sim2vr_harness.sessions import JOINT_NAMES, read_session
from sim2vr_harness.sessions.frames import from_webxr, relative
from sim2vr_harness.sessions.iwer import iwer_recording, write_iwer
from webxr_pages import require_npm

ORACLE = Path(__file__).with_name("iwer_oracle.mjs")


@pytest.fixture(scope="module")
def iwer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which IWER is installed."""
    if shutil.which("node") is None:
        missing("npm", "no Node")
    require_npm()
    folder: Path = tmp_path_factory.mktemp("iwer")
    install = ["npm", "install", "--no-audit", "--no-fund", "--prefix", str(folder), "iwer@2"]
    subprocess.run(install, check=True, timeout=120, capture_output=True)
    return folder


def node(iwer: Path, *arguments: object) -> None:
    command = ["node", str(ORACLE), str(iwer), *map(str, arguments)]
    subprocess.run(command, check=True, timeout=60)


def buttons_of(row: np.ndarray) -> tuple[list[float], list[float]]:
    """Values and touches of WebXR's seven buttons of a Touch controller, by hand."""
    values = [row[0], row[1], 0, row[4], row[5], row[6], 0]
    return values, [row[8], 0, 0, row[9], row[10], row[11], row[12]]


def test_iwer_plays_every_frame_and_button_of_ours(iwer: Path, tmp_path: Path) -> None:
    session = full_session()
    write_iwer(session, tmp_path / "ours.json")
    node(iwer, "play", tmp_path / "ours.json", tmp_path / "played.json")
    played: list[dict[str, Any]] = json.loads((tmp_path / "played.json").read_text())
    assert len(played) == FRAMES
    np.testing.assert_allclose([f["time"] for f in played], session.time_ns / 1e6, atol=1e-6)
    heads = from_webxr(np.array([frame["head"] for frame in played]))
    np.testing.assert_allclose(heads, session.head, atol=2e-6)
    for h, (side, one) in enumerate(session.controllers.items()):
        inputs = [frame["inputs"][h] for frame in played]
        assert {each["hand"] for each in inputs} == {side}
        for key, poses in (("ray", one.aim), ("grip", one.grip)):
            found = from_webxr(np.array([each[key] for each in inputs]))
            np.testing.assert_allclose(found, poses, atol=2e-6)
        assert one.inputs is not None and one.aim is not None
        for k, each in enumerate(inputs):
            values, _ = buttons_of(one.inputs[k])
            # The player takes values and axes of a frame, pressed and touched of the next one.
            pressed, touched = buttons_of(one.inputs[min(k + 1, FRAMES - 1)])
            bits = [(v > 0, v > 0 or t > 0) for v, t in zip(pressed, touched, strict=True)]
            expected = [[*two, value] for two, value in zip(bits, values, strict=True)]
            assert each["buttons"] == expected
            assert each["axes"] == [0, 0, one.inputs[k][2], -one.inputs[k][3]]
    assert session.right is not None and session.right.joints is not None
    joints = np.array([frame["inputs"][1]["joints"] for frame in played])
    assert joints.shape == (FRAMES, len(JOINT_NAMES), 8)
    seen = relative(session.right.ray()[:, None], session.right.joints[..., :7])
    np.testing.assert_allclose(from_webxr(joints[..., :7]), seen, atol=2e-6)


def test_every_frame_and_button_that_iwer_recorded_is_read(iwer: Path, tmp_path: Path) -> None:
    node(iwer, "record", tmp_path / "theirs.json", 60)
    session = read_session(tmp_path / "theirs.json")
    assert (len(session), session.notes, session.rounding_m) == (60, (), 1e-3)
    k = np.arange(60)
    # As iwer_oracle.mjs moves them, z towards the player there.
    np.testing.assert_allclose(session.head[:, 0], 0.01 * k, atol=6e-4)
    np.testing.assert_allclose(session.head[:, 2], 0.2, atol=6e-4)
    np.testing.assert_allclose(session.head[:, 4], -np.sin(0.025 * k), atol=2e-3)
    assert session.left is not None and session.right is not None
    np.testing.assert_allclose(session.left.grip[:, 0], -0.5, atol=6e-4)
    np.testing.assert_allclose(session.right.ray()[:, 2], 0.4, atol=6e-4)
    names = ("trigger", "squeeze", "thumbstick", "lower", "upper")
    for each in json.loads((tmp_path / "theirs.json.expected").read_text()):
        side = ("left", "right")[each["hand"]]
        one = session.controllers[side]
        assert one.inputs is not None
        row, values = one.inputs[each["k"]], each["values"]
        own = {"thumbstick": "thumbstick_click", "lower": "x", "upper": "y"}
        for name in names:
            assert row[input_named(f"left.{own.get(name, name)}").column] == values[name]
        touches = {"thumbstick": "thumbstick_touch", "lower": "x_touch", "upper": "y_touch"}
        for name in ("trigger", "thumbstick", "lower", "upper", "thumbrest"):
            column = input_named(f"left.{touches.get(name, f'{name}_touch')}").column
            assert row[column] == values[f"{name}_touch"]
        assert (row[2], -row[3]) == tuple(each["stick"])
    # Written again, the buttons are those of IWER's file.
    again, theirs = iwer_recording(session), json.loads((tmp_path / "theirs.json").read_text())
    for ours, frame in zip(again["frames"], theirs["frames"], strict=True):
        assert [each[-1][:7] for each in ours[8:]] == [each[-1][:7] for each in frame[8:]]


def test_button_states_that_a_touch_controller_does_not_have_are_noted(tmp_path: Path) -> None:
    recording = iwer_recording(full_session())
    recording["frames"][3][8][9][2] = [1, 1, 1]  # a touchpad
    recording["frames"][4][8][9][6] = [1, 1, 1]  # a thumb rest that is pressed
    (tmp_path / "a.json").write_text(json.dumps(recording))
    assert read_session(tmp_path / "a.json").notes == (
        "2 states of buttons that a Touch controller does not have are left out",
    )
