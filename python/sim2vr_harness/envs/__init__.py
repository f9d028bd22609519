"""Environments: a simulated user, its senses and a VR app in lockstep.

Importing this package registers the Gymnasium ids, so both of these work::

    import sim2vr_harness.envs

    gymnasium.make("sim2vr/WhacAMole-v0")

    gymnasium.make("sim2vr_harness.envs:sim2vr/WhacAMole-v0")

and for 64 users on all cores::

    gymnasium.make_vec("sim2vr/WhacAMole-v0", num_envs=64)
"""

from sim2vr_harness.envs.config import (
    AppConfig,
    EffortConfig,
    EnvConfig,
    NoiseConfig,
    UserConfig,
    VisionConfig,
)
from sim2vr_harness.envs.gym_env import Sim2VREnv
from sim2vr_harness.envs.registration import register_envs
from sim2vr_harness.envs.simulation import Simulation, StepBatch
from sim2vr_harness.envs.vector_env import Sim2VRVectorEnv

__all__ = [
    "AppConfig",
    "EffortConfig",
    "EnvConfig",
    "NoiseConfig",
    "Sim2VREnv",
    "Sim2VRVectorEnv",
    "Simulation",
    "StepBatch",
    "UserConfig",
    "VisionConfig",
    "register_envs",
]

register_envs()
