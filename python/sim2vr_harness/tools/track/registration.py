"""Registration of a recorded world to that of a body, by the person's head."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.frames import pose_to_app, pose_to_mujoco, position_to_mujoco
from sim2vr_harness.tools.track.paths import RecordedPath

FloatArray = NDArray[np.float64]

EYE_SHARE = 0.936
"""Height of the eyes above the floor while standing, as a share of the stature (Drillis and
Contini 1966)."""
STANDING_M = 1.35
"""Least height of the head of a standing adult; lower heads do not show a person's stature."""
_USUAL_HAND_M = {"controller_right": (0.31, -0.14, -0.15), "controller_left": (0.31, 0.14, -0.15)}
"""Ahead, left and up of the headset: medians of 54 recorded rounds of Whac-A-Mole, where no headset
was recorded."""


@dataclass(frozen=True)
class Placement:
    """Registration of a recorded world in the body's: rotation about the vertical, scale and shift.

    Attributes:
        head_m: (3,) position of the recorded head, in the recorded world, MuJoCo's axes.
        at_m: (3,) the same point in the body's world.
        left_rad: rotation of the recording to the left (from above) about the head.
        scale: of distances from the head.
        notes: remarks for the reader.
    """

    head_m: FloatArray
    at_m: FloatArray
    left_rad: float = 0.0
    scale: float = 1.0
    notes: tuple[str, ...] = field(default=())

    def places(self, poses: FloatArray) -> FloatArray:
        """(N, 3) in the body's world, of recorded poses (N, 7) in the app's frame."""
        away = position_to_mujoco(poses[:, :3]) - self.head_m
        return self.at_m + self.scale * away @ _turn(self.left_rad).T

    def turns(self, poses: FloatArray) -> FloatArray:
        """(N, 4) rotations w x y z in the body's world, of recorded poses (N, 7)."""
        return _turned(self.left_rad, pose_to_mujoco(poses)[1])

    def recorded(self, places: FloatArray, turns: FloatArray) -> FloatArray:
        """(N, 7) poses in the recorded world, app's frame, of the body's (N, 3) and (N, 4)."""
        away = (places - self.at_m) / self.scale
        return pose_to_app(
            self.head_m + away @ _turn(-self.left_rad).T, _turned(-self.left_rad, turns)
        )


def place(
    path: RecordedPath,
    body_head_m: FloatArray,
    *,
    yaw: float | Literal["head"] = 0.0,
    scale: float = 1.0,
    offset_m: FloatArray | None = None,
) -> Placement:
    """Register a recorded world so that the middle of the recorded head is at the body's head.

    Without a recorded head, the middle of the hand's path is registered with the usual position of
    the hand.

    Args:
        path: the recording.
        body_head_m: (3,) position of the body's headset, MuJoCo's world.
        yaw: degrees by which the person is turned to the right of the recorded forward; ``head``:
            the direction of the head at the middle of the time.
        scale: of distances from the head.
        offset_m: (3,) a further shift in the body's world: forward, left, up.
    """
    notes: list[str] = []
    facing = 0.0
    if path.headset is not None:
        head = np.median(position_to_mujoco(path.headset[:, :3]), axis=0)
        # Angle to the right, rad, that a head looks at in the middle of the time.
        w, x, y, z = pose_to_mujoco(path.headset)[1].T
        ahead, left = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        facing = float(np.arctan2(-np.median(left), np.median(ahead)))
        at = np.array(body_head_m, dtype=np.float64)
        if yaw != "head" and abs(np.degrees(facing) - yaw) > 45.0:
            notes.append(
                f"the head looks {np.degrees(facing):.0f} degrees to the right of the recorded "
                "forward; --yaw head lets the body face there"
            )
    else:
        device = next(iter(path.hands))
        head = np.median(position_to_mujoco(path.hands[device][:, :3]), axis=0)
        at = np.asarray(body_head_m) + np.array(_USUAL_HAND_M[device])
        notes.append(
            "no head was recorded: the middle of the hand's path is put 31 cm ahead of, 14 cm "
            "beside and 15 cm below the body's headset"
        )
    turned = facing if yaw == "head" else float(np.radians(yaw))
    shift = np.zeros(3) if offset_m is None else offset_m
    return Placement(head, at + shift, turned, scale, tuple(notes))


def head_height_m(path: RecordedPath) -> float | None:
    """Median height of the headset above the recorded floor; None without a headset."""
    return None if path.headset is None else float(np.median(path.headset[:, 1]))


def estimated_stature_m(path: RecordedPath) -> float | None:
    """Return the stature estimated from the height of a standing person's head; None: unknown."""
    height = head_height_m(path)
    if height is None or height < STANDING_M:
        return None
    return float(np.clip(height / EYE_SHARE, 1.0, 2.5))


def _turn(left_rad: float) -> FloatArray:
    """(3, 3) turn to the left about the vertical."""
    c, s = np.cos(left_rad), np.sin(left_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _turned(left_rad: float, quats: FloatArray) -> FloatArray:
    """(N, 4) rotations w x y z, turned to the left about the world's vertical."""
    c, s = np.cos(left_rad / 2.0), np.sin(left_rad / 2.0)
    w, x, y, z = quats.T
    return np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=1)
