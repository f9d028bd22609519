"""Gymnasium ids of the environments: one for every game that the runtime knows."""

from __future__ import annotations

import gymnasium

from sim2vr_harness.client import describe_game, list_games

__all__ = ["env_id", "register_envs"]


def env_id(game: str) -> str:
    """The id of a game's environment, such as ``sim2vr/WhacAMole-v0``.

    Raises:
        ValueError: There is no such game; names the nearest.
    """
    return f"sim2vr/{describe_game(game).id}-v0"


def register_envs() -> None:
    """Register the id of every game; idempotent. Without the extension module there are no games.

    Only entry strings are handed over: what an environment needs is loaded when one is made.
    """
    try:
        games = list_games()
    except RuntimeError:
        return
    for game in games:
        if env_id(game) not in gymnasium.registry:
            gymnasium.register(
                env_id(game),
                entry_point="sim2vr_harness.envs.gym_env:Sim2VREnv",
                vector_entry_point="sim2vr_harness.envs.vector_env:Sim2VRVectorEnv",
                kwargs={"game": game},
            )
