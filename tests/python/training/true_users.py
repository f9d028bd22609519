"""What users of the true game do, in the tensors of imagined rollouts."""

import mujoco
import numpy as np
import torch

from sim2vr_harness.training.teacher.env import TeacherSimulation
from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.transitions import Motion


def motion_of(users: UserBatch, drives: ActuatorState) -> Motion:
    """The users' joints and actuators; all are average."""
    joints, dofs = users.body.qpos_independent, users.body.qvel_independent
    parts = (users.qpos[:, joints], users.qvel[:, dofs], drives.of(users))
    tensors = [torch.tensor(part, dtype=torch.float32) for part in parts]
    return Motion(*tensors, torch.zeros(users.n, 0))


def worn_by(sim: TeacherSimulation) -> torch.Tensor:
    """(N, D, 4, 4) where the users' devices are, which the app is told."""
    place = np.tile(np.eye(4), (sim.n, len(sim.game.devices), 1, 1))
    for k, device in enumerate(sim.game.devices):
        positions, quaternions = sim.simulation.users.device_poses(device)
        place[:, k, :3, 3] = positions
        for i, quaternion in enumerate(quaternions):
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, quaternion)
            place[i, k, :3, :3] = rotation.reshape(3, 3)
    return torch.tensor(place, dtype=torch.float32)
