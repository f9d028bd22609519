"""Constants of the model-based stage, as small as tests need them."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from sim2vr_harness.runs.teacher_config import ImaginedConfig


@contextmanager
def short_cycles(updates: int = 2, critic_first: int = 0) -> Iterator[None]:
    """Train with little of everything: within a ``with`` statement, or below as a decorator."""
    fit = {"first_fit_minibatches": 20, "fit_minibatches": 20}
    cycles = {"play_steps": 10, "updates": updates, "critic_first_updates": critic_first, **fit}
    with patch.multiple(ImaginedConfig, **cycles):
        yield
