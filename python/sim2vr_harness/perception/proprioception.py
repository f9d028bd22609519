"""The sense of the own body: joints, fingertip and muscles."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.user import User


class Proprioception:
    """Observes the bodies of a `UserBatch`, as the SIM2VR paper's user does.

    Order of the entries (56 for the wrist model), all unfiltered:

    1. angles of the independent joints, scaled from their range to [-1, 1] (a little outside where
       a joint yields at its limit);
    2. their velocities in rad/s;
    3. their accelerations of the last substep in rad/s^2;
    4. position of the fingertip in m, MuJoCo world frame (x forward, y left, z up);
    5. muscle activations, scaled from [0, 1] to [-1, 1].

    Unlike in the reference, entries 1, 2, 4 and 5 all belong to the end of the step.

    Args:
        user: the user to observe.
    """

    def __init__(self, user: User) -> None:
        self.user = user
        self._low, high = user.joint_ranges.T
        self._span = high - self._low
        self.size = 3 * len(user.independent_joints) + 3 + len(user.muscles)

    @property
    def observation_space(self) -> spaces.Box:
        """Space of one user's observation, (size,) float32, unbounded."""
        # Every finite float32: accelerations have no natural bound, and environment checkers take
        # infinite ones for a mistake.
        limit = np.finfo(np.float32).max
        return spaces.Box(-limit, limit, (self.size,), np.float32)

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every entry, e.g. "elbow_flexion qvel"."""
        joints = self.user.independent_joints
        motion = [f"{joint} {kind}" for kind in ("qpos", "qvel", "qacc") for joint in joints]
        tip = [f"{self.user.end_effector} {axis}" for axis in "xyz"]
        return (*motion, *tip, *(f"{muscle} act" for muscle in self.user.muscles))

    def observe(self, batch: UserBatch) -> NDArray[np.float32]:
        """Returns (N, size) float32, owned by the caller.

        Raises:
            ValueError: the batch is made of another user model.
        """
        if batch.user.muscles != self.user.muscles:
            raise ValueError(
                f"batch: got users {batch.user.name!r}, expected {self.user.name!r}, the model "
                "this proprioception was made for"
            )
        dofs = self.user.qvel_independent
        angles = batch.qpos[:, self.user.qpos_independent]
        parts = (
            (angles - self._low) / self._span * 2.0 - 1.0,
            batch.qvel[:, dofs],
            batch.qacc[:, dofs],
            batch.end_effector_pos,
            (batch.act - 0.5) * 2.0,
        )
        return np.concatenate(parts, axis=1, dtype=np.float32, casting="same_kind")
