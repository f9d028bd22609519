"""A hand of a scripted user: it follows places, with the controller, a tool, or the aim ray."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base import rotations
from sim2vr_harness.users.kinematics.posture_controller import (
    AIM_RAY,
    DeviceRay,
    FoundPosture,
    PostureController,
)

FloatArray = NDArray[np.float64]
By = Literal["touch", "ray"]

REACH_M = 0.02
"""A place to which a posture comes so near is within reach."""
_AIMED_DEG = 1.0
"""A ray that is nearer to its direction points there."""
_MOVED_M = 0.003
"""A place that moves by more gets a new posture."""
_NEAR_M = 0.1
"""A place that moves by less, and is within reach, gets one near the posture before."""


class Hand:
    """A hand, and what it does.

    Args:
        simulation: Of the users.
        side: ``right`` or ``left``.
        user: Whose hand it is.

    Raises:
        ValueError: The body has no muscles, or wears no controller there.
    """

    def __init__(self, simulation: Any, side: str, user: int) -> None:
        self._users, self.device, self._user = simulation.users, f"controller_{side}", user
        self._controller = PostureController(self._users.who.body(user), self.device)
        self.ray: DeviceRay = AIM_RAY
        """Ray with which the hand points."""
        self.place: FloatArray | None = None
        """(3,) goal of the hand in MuJoCo's world, m."""
        self._by: By = "touch"
        self._found: FoundPosture | None = None
        self._tip_m: FloatArray = np.zeros(3)

    @property
    def position(self) -> FloatArray:
        """(3,) of the controller, MuJoCo's world, m."""
        return self._pose[0]

    @property
    def _pose(self) -> tuple[FloatArray, FloatArray]:
        """Position (3,), m, and rotation (4,) w x y z of the controller."""
        positions, quats = self._users.device_poses(self.device)
        return positions[self._user], quats[self._user]

    def hold_tool(self, place: FloatArray | None) -> None:
        """Touch with what is at that place, (3,), instead of the controller; None: the latter."""
        self._tip_m = np.zeros(3)
        if place is not None:
            position, quat = self._pose
            self._tip_m = turned(quat * [1.0, -1.0, -1.0, -1.0], place - position)

    def error(self, place: FloatArray, by: By) -> float:
        """Return how far hand or tool are from a place, m; of the ray the angle, degrees."""
        position, quat = self._pose
        gap = place - position
        if by == "touch":
            return float(np.linalg.norm(gap - turned(quat, self._tip_m)))
        gap = gap - turned(quat, self.ray.origin_m)
        along = turned(quat, self.ray.direction) @ gap / max(float(np.linalg.norm(gap)), 1e-9)
        return float(np.degrees(np.arccos(np.clip(along, -1.0, 1.0))))

    def off_m(self, place: FloatArray, by: By) -> float:
        """Return how far hand or tool are from a place; of the ray by how much it passes it, m."""
        error = self.error(place, by)
        far = float(np.linalg.norm(place - self.position))
        return error if by == "touch" else far * float(np.sin(np.radians(min(error, 90.0))))

    def follow(self, place: FloatArray, by: By) -> None:
        """Move towards a place, (3,) MuJoCo's world, from the next :meth:`action` on."""
        far = np.inf
        if self.place is not None and by == self._by:
            far = float(np.linalg.norm(place - self.place))
        if far > _MOVED_M:
            self._found = self._search(place, by, nearby=far < _NEAR_M)
            self.place, self._by = place, by

    def beyond_m(self, place: FloatArray) -> float:
        """Return by how much a place is out of the hand's reach, m; 0: within reach."""
        gap_m = self._search(place, "touch").gap_m
        return 0.0 if gap_m < REACH_M else gap_m

    def _search(self, place: FloatArray, by: By, *, nearby: bool = False) -> FoundPosture:
        start = self._controller.angles(self._users.qpos[self._user])
        if by == "ray":
            goal: dict[str, Any] = {"aim_at": place, "ray": self.ray}
        else:
            goal = {"place": place, "tip_m": self._tip_m}
        if nearby and self._found is not None:
            found = self._controller.find(self._found.angles, **goal, nearby=True)
            if found.gap_m < REACH_M and found.error_deg < _AIMED_DEG:
                return found
        return self._controller.find(start, **goal)

    def action(self) -> NDArray[np.float32] | None:
        """Return the body's action, (B,); None: the hand follows nothing."""
        if self._found is None:
            return None
        users, i = self._users, self._user
        return self._controller.towards(
            users.qpos[i], users.qvel[i], users.act[i], self._found.angles
        )


def head_angles(users: Any, user: int, place: FloatArray) -> tuple[float, float, float]:
    """Return how far a head is bent forward and turned aside, and how far it faces beside a place.

    Args:
        users: They wear headsets.
        user: Whose head it is.
        place: (3,) MuJoCo's world, m.
    """
    positions, quats = users.device_poses("headset")
    faces, gap = turned(quats[user], np.array([1.0, 0.0, 0.0])), place - positions[user]
    beside = float(faces @ gap) / max(float(np.linalg.norm(gap)), 1e-9)
    down, aside = -np.arcsin(np.clip(faces[2], -1.0, 1.0)), abs(np.arctan2(faces[1], faces[0]))
    found = np.degrees([down, aside, np.arccos(np.clip(beside, -1.0, 1.0))]).tolist()
    return found[0], found[1], found[2]


def turned(quat: FloatArray, vector: FloatArray) -> FloatArray:
    """(3,) a vector turned by a quaternion w x y z."""
    return rotations.turned(quat[1:], quat[0], vector)
