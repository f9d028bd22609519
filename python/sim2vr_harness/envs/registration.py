"""Gymnasium ids of the environments; importing ``sim2vr_harness.envs`` registers them."""

from __future__ import annotations

import gymnasium

WHACAMOLE_ID = "sim2vr/WhacAMole-v0"


def register_envs() -> None:
    """Registers every environment id; idempotent."""
    if WHACAMOLE_ID not in gymnasium.registry:
        gymnasium.register(
            WHACAMOLE_ID,
            entry_point="sim2vr_harness.envs.gym_env:Sim2VREnv",
            vector_entry_point="sim2vr_harness.envs.vector_env:Sim2VRVectorEnv",
        )
