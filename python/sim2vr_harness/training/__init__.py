"""Training of simulated users: one folder per algorithm.

For users of the library::

    from sim2vr_harness.training import load_config, train

    train(load_config("whacamole_constrained_distill"), "runs/mine", report=print)

- :mod:`.run`: one training session, its stages, progress and loggers
- :mod:`.model_based`, :mod:`.teacher`, :mod:`.dagger`, :mod:`.ppo`: the stages of ``distill``
- :mod:`.motor_control`, :mod:`.option_q_learning`: the stages of ``skills``

Configurations and run folders are in :mod:`sim2vr_harness.runs`, networks and trained users in
:mod:`sim2vr_harness.policies`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from sim2vr_harness.base.cores import settle_torch

if TYPE_CHECKING:
    from sim2vr_harness.policies.store import TrainedUser, find_user, list_cards
    from sim2vr_harness.runs.config import TrainingConfig, load_config, parse_config
    from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
    from sim2vr_harness.training.run.stage import Report
    from sim2vr_harness.training.run.trainer import TrainResult, train

__all__ = [
    "Report",
    "SimulationVecEnv",
    "TrainResult",
    "TrainedUser",
    "TrainingConfig",
    "find_user",
    "list_cards",
    "load_config",
    "parse_config",
    "train",
]

_HOMES = {
    "Report": "training.run.stage",
    "SimulationVecEnv": "training.ppo.vec_env",
    "TrainResult": "training.run.trainer",
    "TrainedUser": "policies.store",
    "TrainingConfig": "runs.config",
    "find_user": "policies.store",
    "list_cards": "policies.store",
    "load_config": "runs.config",
    "parse_config": "runs.config",
    "train": "training.run.trainer",
}

settle_torch()


def __dir__() -> list[str]:
    """List the public names, lazily loaded ones included."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Import a public name when it is first requested: configurations are read without torch."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"sim2vr_harness.{_HOMES[name]}"), name)
