"""Moment arms of actuators, as a matrix."""

import mujoco
import numpy as np
from numpy.typing import NDArray


def moment_arms(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """(nu, nv) moment arms of all actuators in the posture of the last kinematics, m or 1."""
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return moments
