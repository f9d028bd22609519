"""What a teacher decides, and what its muscles are told."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training.teacher_config import ActionsConfig
from sim2vr_harness.users.joint_drive import JointDrive

__all__ = ["TeacherActions"]


class TeacherActions:
    """Turns a teacher's actions into those of any user: changes of activation.

    Args:
        simulation: the users who act.
        config: what the actions stand for.
    """

    def __init__(self, simulation: Simulation, config: ActionsConfig) -> None:
        self._users = simulation.users
        self._damping_per_s = config.damping_per_s
        self._drive: JointDrive | None = None
        self.space: spaces.Box = simulation.action_space
        """Box(-1, 1) of the teacher's own actions."""
        if config.kind == "joints":
            self._drive = JointDrive(self._users, config.acceleration_radps2, effort=config.effort)
            self.space = spaces.Box(-1.0, 1.0, (self._drive.size,), np.float32)

    def of_muscles(self, actions: NDArray[Any]) -> NDArray[np.float64]:
        """The changes of activation, (N, M) in [-1, 1], that the users' present state asks for.

        Args:
            actions: (N, A), clipped to [-1, 1].
        """
        clipped = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        if self._drive is None:
            return clipped
        speeds = self._users.qvel[:, self._users.user.qvel_independent]
        wanted = clipped * self._drive.scale_radps2 - self._damping_per_s * speeds
        return self._drive.activations(wanted) - self._users.act
