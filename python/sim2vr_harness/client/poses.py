"""Device poses on their way to an app outside this process: checked, as rows of numbers."""

from __future__ import annotations

import numpy as np

from sim2vr_harness.client.base import DevicePoses, Float64Array, Int64Array

__all__ = ["DEVICES", "frame_times", "pose_rows", "tracked_devices"]

DEVICES = ("head", "left_controller", "right_controller")
"""Order of the devices in a block of poses, and names of the fields of DevicePoses."""


def frame_times(times_ns: Int64Array) -> Int64Array:
    """(K,) int64 game times; ValueError for another shape or none at all."""
    times = np.asarray(times_ns, dtype=np.int64)
    if times.ndim != 1 or len(times) == 0:
        raise ValueError(f"times_ns: got shape {times.shape}, expected (K,) with K of 1 or more")
    return times


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
