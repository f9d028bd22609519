"""Environments: a simulated user, its senses and a VR app in lockstep.

Importing :mod:`sim2vr_harness` registers their Gymnasium ids, such as ``sim2vr/WhacAMole-v0``.
"""

from sim2vr_harness.envs.config import (
    AppConfig,
    EffortConfig,
    EnvConfig,
    FoveaConfig,
    NoiseConfig,
    SenseConfig,
    UserConfig,
    VisionConfig,
)
from sim2vr_harness.envs.gym_env import Sim2VREnv
from sim2vr_harness.envs.simulation import Simulation, StepBatch
from sim2vr_harness.envs.vector_env import Sim2VRVectorEnv

__all__ = [
    "AppConfig",
    "EffortConfig",
    "EnvConfig",
    "FoveaConfig",
    "NoiseConfig",
    "SenseConfig",
    "Sim2VREnv",
    "Sim2VRVectorEnv",
    "Simulation",
    "StepBatch",
    "UserConfig",
    "VisionConfig",
]
