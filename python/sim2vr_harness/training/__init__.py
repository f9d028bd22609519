"""Learning to play with Stable-Baselines3; the only room that imports it.

For users of the library::

    from sim2vr_harness.training import load_config, train

    train(load_config("whacamole_constrained_distill"), "runs/mine", report=print)

- :mod:`.config`, :mod:`.ppo_config`, :mod:`.teacher_config`, :mod:`.student_config`: the validated
  configuration (no torch needed); :mod:`.retired`: keys that recorded ones may still have
- :mod:`.trainer`: one training session; :mod:`.stages`: what a stage of a run is, and what runs
  them; :mod:`.recipes`: which stages a run is made of
- :mod:`.ppo_stage`, :mod:`.teacher_stage`, :mod:`.student_stage`, :mod:`.imagined`: the stages
- :mod:`.policy`, :mod:`.teacher_policy`: the reference's network, and that of teachers
- :mod:`.vec_env`, :mod:`.buffer`, :mod:`.ppo`: the pieces PPO runs on
- :mod:`.checkpoint`, :mod:`.run_folder`: what is kept of a run, and exact resumption;
  :mod:`.finite`, :mod:`.locking`, :mod:`.interrupts`: what is kept, who writes, what may stop it
- :mod:`.trust`: programs that files name are started only if the user has said so
- :mod:`.trained_users`: whom others can let play
- :mod:`.measuring`: what the benchmark needs of Stable-Baselines3
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
    "Report": "stages",
    "SimulationVecEnv": "vec_env",
    "TrainResult": "trainer",
    "TrainedUser": "trained_users",
    "TrainingConfig": "config",
    "find_user": "trained_users",
    "list_cards": "trained_users",
    "load_config": "config",
    "parse_config": "config",
    "train": "trainer",
}

settle_torch()


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: configurations are read without torch."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
