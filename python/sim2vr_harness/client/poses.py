"""Validation of device reports that are sent to an app outside this process."""

import numpy as np

from sim2vr_harness.client.devices import (
    HANDS,
    INPUT_COUNT,
    DevicePoses,
    Float64Array,
    Int64Array,
)
from sim2vr_harness.client.errors import AppRefused, AppUnsupported

DEVICES = ("head", "left_controller", "right_controller")
"""Order of the devices in a block of poses, and names of the fields of DevicePoses."""
_ROTATION_TOLERANCE = 1e-3


def frame_times(times_ns: Int64Array) -> Int64Array:
    """(K,) int64 game times; ValueError for another shape or none at all."""
    times = np.asarray(times_ns, dtype=np.int64)
    if times.ndim != 1 or len(times) == 0:
        raise ValueError(f"times_ns: got shape {times.shape}, expected (K,) with K of 1 or more")
    return times


def later_times(times_ns: Int64Array, last_ns: int) -> Int64Array:
    """(K,) int64 game times after those before.

    Raises:
        AppRefused: one runs backwards.
    """
    times = frame_times(times_ns)
    if times[0] < last_ns or (np.diff(times) < 0).any():
        raise AppRefused(
            f"time_ns: got {int(times[0])} after {last_ns}, expected no step backwards"
        )
    return times


def one_frame(poses: DevicePoses) -> DevicePoses:
    """Return the devices of one moment as those of a step of one frame.

    Raises:
        ValueError: a row of another shape; names it.
    """
    rows: dict[str, Float64Array | None] = {}
    for name, row in vars(poses).items():
        if row is None:
            rows[name] = None
            continue
        given = np.asarray(row, dtype=np.float64)
        if given.shape != ((INPUT_COUNT,) if name.endswith("_inputs") else (7,)):
            pose_rows(poses)
            input_rows(poses)
        rows[name] = given[None]
    return DevicePoses(**rows)  # type: ignore[arg-type]


def tracked_devices(poses: DevicePoses) -> int:
    """Bits of the tracked devices: 1 head, 2 left controller, 4 right controller."""
    return sum(1 << bit for bit, name in enumerate(DEVICES) if getattr(poses, name) is not None)


def pose_rows(poses: DevicePoses, frames: int | None = None) -> Float64Array:
    """The poses as one block, zeros where a device is not tracked.

    Args:
        poses: of one moment, or of K frames.
        frames: K, or None for one moment.

    Returns:
        (K, 3, 7) float64, or (1, 3, 7): head, left, right; position x y z (m), rotation x y z w.

    Raises:
        ValueError: a pose of another shape; names it.
    """
    shape = (7,) if frames is None else (frames, 7)
    rows = np.zeros((1 if frames is None else frames, len(DEVICES), 7))
    for k, name in enumerate(DEVICES):
        pose = getattr(poses, name)
        if pose is None:
            continue
        given = np.asarray(pose, dtype=np.float64)
        if given.shape != shape:
            raise ValueError(
                f"{name}: got shape {given.shape}, expected {shape}: position x y z, rotation "
                "x y z w" + ("" if frames is None else ", one row per frame")
            )
        rows[:, k] = given
    return rows


def input_rows(poses: DevicePoses, frames: int | None = None) -> Float64Array:
    """The controllers' inputs as one block, zeros where they are at rest.

    Args:
        poses: of one moment, or of K frames.
        frames: K, or None for one moment.

    Returns:
        (K, 2, INPUT_COUNT) float64, or (1, 2, INPUT_COUNT): left, right.

    Raises:
        ValueError: inputs of another shape; names the controller.
    """
    shape = (INPUT_COUNT,) if frames is None else (frames, INPUT_COUNT)
    rows = np.zeros((1 if frames is None else frames, len(HANDS), INPUT_COUNT))
    for k, hand in enumerate(HANDS):
        inputs = getattr(poses, f"{hand}_inputs")
        if inputs is None:
            continue
        given = np.asarray(inputs, dtype=np.float64)
        if given.shape != shape:
            raise ValueError(f"{hand}_inputs: got shape {given.shape}, expected {shape}")
        rows[:, k] = given
    return rows


def require_devices(poses: DevicePoses, capabilities: frozenset[str], app: str) -> None:
    """Refuse a left controller, and inputs that are not at rest, of an app that knows none.

    Raises:
        AppUnsupported: names the capability.
    """
    if poses.left_controller is not None and "left_controller" not in capabilities:
        raise AppUnsupported(f"left_controller: {app} has no left controller")
    if "inputs" in capabilities:
        return
    for hand in HANDS:
        inputs = getattr(poses, f"{hand}_inputs")
        if inputs is not None and np.any(inputs):
            raise AppUnsupported(
                f"inputs: {app} takes no triggers, sticks and buttons, got some of the {hand} "
                "controller that are not at rest"
            )


def check_finite(rows: Float64Array) -> None:
    """ValueError naming the device whose numbers are not all finite; JSON has no word for them.

    Args:
        rows: (K, 3, 7), see :func:`pose_rows`.
    """
    if np.isfinite(rows).all():
        return
    frame, device = np.argwhere(~np.isfinite(rows).all(axis=2))[0]
    raise ValueError(
        f"{DEVICES[device]}: got {rows[frame, device].tolist()}, expected finite numbers"
    )


def checked_rows(poses: DevicePoses, frames: int) -> tuple[Float64Array, Float64Array]:
    """:func:`pose_rows` and :func:`input_rows` of K frames.

    Raises:
        ValueError: a shape, a number that is not finite or a rotation that is none; names it.
    """
    rows, inputs = pose_rows(poses, frames), input_rows(poses, frames)
    check_finite(rows)
    if not np.isfinite(inputs).all():
        raise AppRefused("inputs: got numbers that are not finite, expected finite ones")
    for k, name in enumerate(DEVICES):
        if getattr(poses, name) is None:
            continue
        lengths = np.linalg.norm(rows[:, k, 3:], axis=1)
        if (np.abs(lengths - 1.0) > _ROTATION_TOLERANCE).any():
            got = rows[int(np.abs(lengths - 1.0).argmax()), k, 3:].tolist()
            raise AppRefused(f"{name}.rotation: got {got}, expected a quaternion of length 1")
    return rows, inputs
