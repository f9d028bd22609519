"""The sense of the own body: joints, end effectors, muscles and motors."""

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.bodies import Body
from sim2vr_harness.users.bodies.rules import RULES


class Proprioception:
    """Observes the bodies of a `UserBatch`, as the SIM2VR paper's user does.

    Order of the entries (56 for the wrist model), all unfiltered:

    1. angles of the observed joints, scaled from their range to [-1, 1] (a little outside where a
       joint yields at its limit);
    2. their velocities in rad/s;
    3. their accelerations of the last substep in rad/s^2;
    4. positions of the end effectors in m, MuJoCo world frame (x forward, y left, z up): of the
       wrist model the fingertip;
    5. muscle activations, scaled from [0, 1] to [-1, 1];
    6. smoothed targets of the motors, scaled from [0, 1] to [-1, 1].

    Unlike in the reference, entries 1, 2, 4, 5 and 6 all belong to the end of the step.

    Args:
        body: the body to observe.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self._low, high = body.observed_ranges.T
        self._span = high - self._low
        self._motors = tuple(
            name
            for group in body.actuator_groups
            if RULES[group.rule].remembers
            for name in group.actuators
        )
        self.size = (
            3 * len(body.observed_joints)
            + 3 * len(body.end_effectors)
            + len(body.muscles)
            + len(self._motors)
        )

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
        joints = self.body.observed_joints
        motion = [f"{joint} {kind}" for kind in ("qpos", "qvel", "qacc") for joint in joints]
        tips = [f"{tip} {axis}" for tip in self.body.end_effectors for axis in "xyz"]
        muscles = [f"{muscle} act" for muscle in self.body.muscles]
        return (*motion, *tips, *muscles, *(f"{motor} target" for motor in self._motors))

    def observe(self, batch: UserBatch) -> NDArray[np.float32]:
        """Returns (N, size) float32, owned by the caller.

        Raises:
            ValueError: the batch is made of another user model.
        """
        if batch.body.action_names != self.body.action_names:
            raise ValueError(
                f"batch: got bodies {batch.body.name!r}, expected {self.body.name!r}, the body "
                "this proprioception was made for"
            )
        dofs = self.body.qvel_observed
        angles = batch.qpos[:, self.body.qpos_observed]
        parts = (
            (angles - self._low) / self._span * 2.0 - 1.0,
            batch.qvel[:, dofs],
            batch.qacc[:, dofs],
            batch.end_effector_pos,
            (batch.act - 0.5) * 2.0,
            (batch.motor - 0.5) * 2.0,
        )
        return np.concatenate(parts, axis=1, dtype=np.float32)
