"""Constants of the model-based stage and the teacher's PPO, as small as tests need them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from sim2vr_harness.runs.teacher_config import ImaginedConfig, TeacherPPOConfig
from sim2vr_harness.training.teacher import stage


@contextmanager
def short_cycles(
    updates: int = 2,
    critic_first: int = 0,
    n_steps: int = 10,
    n_epochs: int = 1,
    ppo_critic_first: int = 1,
    judged_rounds: int = 0,
) -> Iterator[None]:
    """Train with little of everything: within a ``with`` statement, or below as a decorator."""
    fit = {"first_fit_minibatches": 20, "fit_minibatches": 20}
    ppo = {"n_steps": n_steps, "n_epochs": n_epochs, "critic_first_updates": ppo_critic_first}
    cycles = {"play_steps": 10, "updates": updates, "critic_first_updates": critic_first, **fit}
    with (
        patch.multiple(ImaginedConfig, **cycles),
        patch.multiple(TeacherPPOConfig, **ppo),
        patch.object(stage, "_EVALUATE_ROUNDS", judged_rounds),
    ):
        yield
