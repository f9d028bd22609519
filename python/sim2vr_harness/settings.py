"""What all configuration models share."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

__all__ = ["Settings", "check_whole_minibatches"]


class Settings(BaseModel):
    """Unknown keys and numbers that are not finite are errors; values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def check_whole_minibatches(steps_per_iteration: int, batch_size: int) -> None:
    """Raise ValueError unless an iteration's user steps make a whole number of minibatches."""
    if steps_per_iteration % batch_size:
        raise ValueError(
            f"batch_size: got {batch_size}, expected a divisor of n_envs * n_steps = "
            f"{steps_per_iteration}"
        )
