"""Recordings of IWER's ``ActionRecorder`` (Immersive Web Emulation Runtime, npm ``iwer`` 2).

A recording is JSON: ``schema``, a list of [index, input source], and ``frames``, each
[milliseconds, pose of the viewer, input ...] with poses of seven numbers in WebXR's frame. An input
is [index, ray, [grip], [25 joints of 8 numbers], [buttons and axes]], as its schema has them; a
button is [pressed, touched, value]. Joints are relative to the ray.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_json
from sim2vr_harness.client import INPUT_COUNT, input_named
from sim2vr_harness.sessions.checks import MOST_FRAMES
from sim2vr_harness.sessions.frames import composed, from_webxr, grip_of, relative, to_webxr
from sim2vr_harness.sessions.session import (
    JOINT_NAMES,
    JOINTS,
    SIDES,
    AppIdentity,
    Controller,
    FloatArray,
    Session,
)

_EXPECTED = "a recording of IWER's ActionRecorder: JSON with schema and frames"
MOST_IWER = 64 * 2**20
"""Bytes of a recording, which is parsed as a whole: at eight times that in memory."""
_ROUNDING_M = 1e-3
_PROFILES = ("oculus-touch-v2", "oculus-touch", "generic-trigger-squeeze-thumbstick")
_BUTTONS, _AXES = 7, 4
_FIRST_INPUT = 8


def _column(name: str) -> int:
    return input_named(f"left.{name}").column


_STICK_X, _STICK_Y = _column("thumbstick_x"), _column("thumbstick_y")
_VALUES = {0: "trigger", 1: "squeeze", 3: "thumbstick_click", 4: "x", 5: "y"}
_TOUCHES = {
    0: "trigger_touch", 3: "thumbstick_touch", 4: "x_touch", 5: "y_touch", 6: "thumbrest_touch",
}  # fmt: skip
_VALUE_COLUMNS = {button: _column(name) for button, name in _VALUES.items()}
_TOUCH_COLUMNS = {button: _column(name) for button, name in _TOUCHES.items()}


def looks_like_iwer(content: Mapping[str, Any]) -> bool:
    """Return True if a JSON object is such a recording."""
    return isinstance(content.get("schema"), list) and isinstance(content.get("frames"), list)


def read_iwer(path: Path) -> Session:
    """Read a recording; times begin at 0.

    Raises:
        InputError: the file is no recording, or has an unreadable frame; names file and frame.
    """
    name = file_name(path)
    content = read_json(path, _EXPECTED, most=MOST_IWER)
    if not looks_like_iwer(content):
        raise InputError(name, f"an object of {', '.join(content)[:60]}", _EXPECTED)
    entries = content["schema"]
    found = {}
    for entry in entries:
        match entry:
            case [int(index), dict(source)] if isinstance(source.get("handedness"), str):
                counts = [source.get("numButtons", 0), source.get("numAxes", 0)]
                if not all(type(n) is int and 0 <= n <= 100 for n in counts):
                    raise InputError(f"{name}, schema", shown(counts, 40), "0 to 100 buttons, axes")
                sequence = source.get("jointSequence", list(JOINT_NAMES))
                if source.get("hasHand") and sequence != list(JOINT_NAMES):
                    expected = "the 25 joints of WebXR in its order"
                    raise InputError(f"{name}, jointSequence", shown(sequence, 60), expected)
                found[index] = source
            case _:
                expected = "[index, {handedness, hasGrip, hasHand, hasGamepad, ...}]"
                raise InputError(f"{name}, schema", shown(entry, 60), expected)
    schema, frames = found, content["frames"]
    if not 1 <= len(frames) <= MOST_FRAMES:
        raise InputError(name, f"{len(frames):,} frames", f"1 to {MOST_FRAMES:,}")
    times = np.zeros(len(frames))
    head = np.zeros((len(frames), 7))
    hands: dict[str, _Hand] = {side: _Hand(len(frames)) for side in SIDES}
    for i, frame in enumerate(frames):
        place = f"{name}, frame {i}"
        if not isinstance(frame, list) or len(frame) < _FIRST_INPUT:
            raise InputError(place, shown(frame, 60), "[milliseconds, pose of the viewer, inputs]")
        times[i], *head[i] = _numbers(frame[:_FIRST_INPUT], _FIRST_INPUT, place)
        for given in frame[_FIRST_INPUT:]:
            _take_input(given, schema, hands, i, place)
    lost = sum(hand.lost for hand in hands.values())
    notes = [f"{lost:,} states of buttons that a Touch controller does not have are left out"]
    return Session(
        time_ns=np.rint((times - times[0]) * 1e6).astype(np.int64),
        head=from_webxr(head),
        left=hands["left"].controller(),
        right=hands["right"].controller(),
        app=AppIdentity("page"),
        source="iwer",
        rounding_m=_ROUNDING_M,
        notes=tuple(notes if lost else ()),
    )


class _Hand:
    """One side's input sources, as frames are read."""

    def __init__(self, count: int) -> None:
        self.aim, self.grip = np.full((2, count, 7), np.nan)
        self.inputs = np.full((count, INPUT_COUNT), np.nan)
        self.joints: FloatArray | None = None
        self.lost = 0

    def controller(self) -> Controller | None:
        """Return what was read, in the app's frame; None: nothing."""
        if np.isnan(self.aim[:, 0]).all():
            return None
        aim = from_webxr(self.aim)
        gripless = np.isnan(self.grip[:, 0])
        grip = np.where(gripless[:, None], grip_of(aim), from_webxr(self.grip))
        joints = self.joints
        if joints is not None:
            poses = composed(aim[:, None], from_webxr(joints[..., :7]))
            joints = np.concatenate([poses, joints[..., 7:]], axis=-1)
        inputs = None if np.isnan(self.inputs).all() else self.inputs
        return Controller(grip, aim, inputs, joints)


def _take_input(
    given: Any, schema: Mapping[int, dict[str, Any]], hands: dict[str, _Hand], i: int, place: str
) -> None:
    if not (isinstance(given, list) and given and isinstance(given[0], int)):
        raise InputError(place, f"the input {shown(given, 40)}", "[index, ray, ...]")
    source = schema.get(given[0])
    if source is None:
        raise InputError(place, f"input source {given[0]}", "one that the schema has")
    hand = hands.get(source["handedness"])
    if hand is None:  # a gaze or a screen: no hand's
        return
    place += f", {source['handedness']} input"
    parts = iter(given[8:])
    hand.aim[i] = _numbers(given[1:8], 7, place)
    if source.get("hasGrip"):
        hand.grip[i] = _numbers(next(parts, None), 7, place)
    if source.get("hasHand"):
        if hand.joints is None:
            hand.joints = np.full((len(hand.aim), JOINTS, 8), np.nan)
        hand.joints[i] = np.reshape(_numbers(next(parts, None), 8 * JOINTS, place), (JOINTS, 8))
    if source.get("hasGamepad"):
        _take_gamepad(hand, i, next(parts, None), source, place)


def _take_gamepad(hand: _Hand, i: int, given: Any, source: Mapping[str, Any], place: str) -> None:
    buttons, axes = source.get("numButtons", 0), source.get("numAxes", 0)
    if not isinstance(given, list) or len(given) != buttons + axes:
        raise InputError(
            place, f"the gamepad {shown(given, 40)}", f"{buttons} buttons, {axes} axes"
        )
    row = np.zeros(INPUT_COUNT)
    for k, button in enumerate(given[:buttons]):
        pressed, touched, value = (0, 0, 0) if button is None else _numbers(button, 3, place)
        if k in _VALUE_COLUMNS:
            row[_VALUE_COLUMNS[k]] = value
        if k in _TOUCH_COLUMNS:
            row[_TOUCH_COLUMNS[k]] = touched
        kept = _button(row, k)
        hand.lost += kept != [pressed, touched, value]
    stick = [0.0 if one is None else one for one in given[buttons:]][-2:] or [0.0, 0.0]
    row[[_STICK_X, _STICK_Y]] = np.array(_numbers(stick, 2, place)) * [1.0, -1.0]
    hand.inputs[i] = row + 0.0  # no -0


def _numbers(row: Any, count: int, place: str) -> list[float]:
    if (
        isinstance(row, list)
        and len(row) == count
        and all(
            isinstance(n, (int, float)) and type(n) is not bool and math.isfinite(n) for n in row
        )
    ):
        return row
    raise InputError(place, shown(row, 60), f"{count} finite numbers")


# --- writing -------------------------------------------------------------------------------------


def write_iwer(session: Session, path: Path) -> None:
    """Write a session as IWER's ``ActionPlayer`` plays it.

    Raises:
        OSError: the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(iwer_recording(session), separators=(",", ":")) + "\n")


def iwer_recording(session: Session) -> dict[str, Any]:
    """Return the recording: ``schema`` and ``frames``, positions to a micrometre."""
    controllers = list(session.controllers.items())
    schema = [[i, _source(side, one)] for i, (side, one) in enumerate(controllers)]
    rows = [_input_rows(i, one) for i, (_, one) in enumerate(controllers)]
    head = _rounded(to_webxr(session.head))
    times_ms = (session.time_ns - session.time_ns[0]) / 1e6
    frames = [
        [time_ms, *head[k], *(inputs[k] for inputs in rows if inputs[k] is not None)]
        for k, time_ms in enumerate(np.round(times_ms, 6).tolist())
    ]
    return {"schema": schema, "frames": frames}


def _source(side: str, controller: Controller) -> dict[str, Any]:
    source: dict[str, Any] = {
        "handedness": side,
        "targetRayMode": "tracked-pointer",
        "profiles": list(_PROFILES),
        "hasGrip": True,
        "hasHand": controller.joints is not None,
        "hasGamepad": True,
        "mapping": "xr-standard",
        "numButtons": _BUTTONS,
        "numAxes": _AXES,
    }
    if controller.joints is not None:
        source["jointSequence"] = list(JOINT_NAMES)
    return source


def _input_rows(index: int, controller: Controller) -> list[list[Any] | None]:
    """A row per frame; None while the controller is not tracked."""
    aim = controller.ray()
    rays, grips = _rounded(to_webxr(aim)), _rounded(to_webxr(controller.grip))
    joints: list[list[float]] | None = None
    if controller.joints is not None:
        poses = to_webxr(relative(aim[:, None], controller.joints[..., :7]))
        both = np.concatenate([poses, controller.joints[..., 7:]], axis=-1)
        joints = _rounded(np.nan_to_num(both).reshape(len(aim), -1))
    count = len(controller.grip)
    inputs = np.zeros((count, INPUT_COUNT)) if controller.inputs is None else controller.inputs
    gamepads = [_gamepad(row) for row in np.nan_to_num(inputs)]
    return [
        [index, *rays[k], grips[k], *([] if joints is None else [joints[k]]), gamepads[k]]
        if tracked
        else None
        for k, tracked in enumerate(controller.tracked)
    ]


def _gamepad(row: FloatArray) -> list[Any]:
    axes = [0, 0, float(row[_STICK_X]), 0.0 - float(row[_STICK_Y])]
    return [*(_button(row, k) for k in range(_BUTTONS)), *axes]


def _button(row: FloatArray, k: int) -> list[Any]:
    """[pressed, touched, value] by IWER's rules: any value presses, what is pressed is touched."""
    value = float(row[_VALUE_COLUMNS[k]]) if k in _VALUE_COLUMNS else 0
    touch = float(row[_TOUCH_COLUMNS[k]]) if k in _TOUCH_COLUMNS else 0
    return [int(value > 0), int(value > 0 or touch > 0), value]


def _rounded(numbers: FloatArray) -> list[list[float]]:
    rounded: list[list[float]] = (np.round(numbers, 6) + 0.0).tolist()
    return rounded
