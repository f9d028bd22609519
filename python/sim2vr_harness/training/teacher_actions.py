"""What a teacher decides, and what its muscles are told."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training.teacher_config import ActionsConfig
from sim2vr_harness.users.joint_drive import JointDrive

__all__ = ["TeacherActions"]

_HAND = "controller_right"


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
        self._config = config
        if config.kind != "muscles":
            self._drive = JointDrive(self._users, config.acceleration_radps2, effort=config.effort)
            size = self._drive.size + (3 if config.kind == "hand" else 0)
            self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    def of_muscles(self, actions: NDArray[Any]) -> NDArray[np.float64]:
        """The changes of activation, (N, M) in [-1, 1], that the users' present state asks for.

        Args:
            actions: (N, A), clipped to [-1, 1].
        """
        clipped = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        if self._drive is None:
            return clipped
        speeds = self._users.qvel[:, self._users.user.qvel_independent]
        rest = -self._damping_per_s * speeds
        if self._config.kind == "joints":
            wanted = clipped * self._drive.scale_radps2
        else:
            wanted = self._drive.joint_accelerations(
                _HAND,
                position_to_mujoco(self._config.hand_mps2 * clipped[:, :3]),
                self._config.beside * clipped[:, 3:] * self._drive.scale_radps2,
            )
        return self._drive.activations(wanted + rest) - self._users.act
