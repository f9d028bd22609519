"""What a teacher decides, and what its muscles are told."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.client.frames import position_to_app, position_to_mujoco
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training.strokes import Fields, Strokes, vectors
from sim2vr_harness.training.teacher_config import ActionsConfig
from sim2vr_harness.users.joint_drive import JointDrive

__all__ = ["TeacherActions"]

_HAND = "controller_right"


class TeacherActions:
    """Turns a teacher's actions into those of any user: changes of activation.

    Args:
        simulation: the users who act.
        fields: the game's privileged numbers.
        config: what the actions stand for.
        strokes: another script than ``config.strokes`` describes.
    """

    def __init__(
        self,
        simulation: Simulation,
        fields: Fields,
        config: ActionsConfig,
        strokes: Strokes | None = None,
    ) -> None:
        self._users = simulation.users
        self._fields = fields
        self._config = config
        self._drive: JointDrive | None = None
        self._strokes = strokes or Strokes(fields, config.strokes)
        self.space: spaces.Box = simulation.action_space
        """Box(-1, 1) of the teacher's own actions."""
        if config.kind != "muscles":
            self._drive = JointDrive(self._users, config.acceleration_radps2, effort=config.effort)
            size = self._drive.size if config.kind == "joints" else 3
            self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    def of_muscles(self, actions: NDArray[Any]) -> NDArray[np.float64]:
        """The changes of activation, (N, M) in [-1, 1], that the users' present state asks for.

        Args:
            actions: (N, A), clipped to [-1, 1].
        """
        clipped = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
        if self._drive is None:
            return clipped
        return self._controls(self._drive, clipped) - self._users.act

    def _controls(self, drive: JointDrive, clipped: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, M) muscle controls in [0, 1]."""
        config, user = self._config, self._users.user
        speeds = self._users.qvel[:, user.qvel_independent]
        braked = -config.damping_per_s * speeds
        if config.kind == "joints":
            return drive.controls_for(clipped * drive.scale_radps2 + braked)
        angles = self._users.qpos[:, user.qpos_independent]
        if config.kind == "strokes":
            joints = self._strokes.joints_radps2(angles, speeds)
            hand = self._strokes.hand_mps2() + config.correction_mps2 * clipped
        else:
            joints = config.posture_stiffness_per_s2 * (self._posture() - angles) + braked
            hand = self._pull(drive, clipped, speeds)
        return drive.controls_for(joints, _HAND, position_to_mujoco(hand), config.hand_scale_mps2)

    def _posture(self) -> NDArray[np.float64]:
        """(N, J) where the joints are drawn to, rad."""
        postures = np.zeros((self._users.n, len(self._users.user.independent_joints)))
        for field, angles in self._config.postures_rad.items():
            postures += self._fields.field(field)[:, None] * np.array(angles)
        return postures

    def _pull(
        self, drive: JointDrive, places: NDArray[np.float64], speeds: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N, 3) acceleration of the hand, m/s^2, the app's axes."""
        config = self._config
        aim = vectors(self._fields, "aid.home_")
        if config.aim is not None:
            there = self._fields.field(f"{config.aim}.present")[:, None] > 0.0
            aim = np.where(there, vectors(self._fields, f"{config.aim}."), aim)
        velocity = position_to_app(drive.device_velocities(_HAND, speeds))
        pull = config.hand_stiffness_per_s2 * (aim + config.reach_m * places)
        pull = pull - config.hand_damping_per_s * velocity
        return np.clip(pull, -config.hand_mps2, config.hand_mps2)
