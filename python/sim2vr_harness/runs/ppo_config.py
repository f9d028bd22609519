"""Settings of proximal policy optimisation, for every stage that learns by it."""

from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from sim2vr_harness.base.settings import (
    MOST_STEPS,
    Factor,
    Norm,
    Settings,
    Weight,
    check_whole_minibatches,
)

MOST_USERS = 16_384
"""Most users of a training; each has a body and an app of its own."""


MOST_BATCH = 100_000_000
"""User steps that are learned from at a time."""


class LearningRateConfig(Settings):
    """Learning rate: constant at first, then linear in the user steps, over ``total_timesteps``."""

    initial: float = Field(default=5.0e-5, ge=0.0, le=1.0)
    """Learning rate at the start; a plain number for ``learning_rate`` is a constant one."""
    final: float = Field(default=1.0e-7, ge=0.0, le=1.0)
    """Learning rate at the end, to which it falls linearly."""
    constant_fraction: float = Field(default=0.2, ge=0.0, lt=1.0)
    """Share of ``total_timesteps`` during which ``initial`` holds."""


class PPOConfig(Settings):
    """Proximal policy optimisation; names are Stable-Baselines3's."""

    n_envs: int = Field(default=10, ge=1, le=MOST_USERS)
    """Environments that run at the same time."""
    n_steps: int = Field(default=4000, ge=1, le=MOST_BATCH)
    """User steps per environment and iteration."""
    batch_size: int = Field(default=1000, ge=2, le=MOST_BATCH)
    """User steps per minibatch; divides ``n_envs * n_steps``."""
    n_epochs: int = Field(default=10, ge=1, le=10_000)
    """Passes over an iteration's user steps."""
    gamma: float = Field(default=0.99, ge=0.0, le=1.0)
    """Discount factor per user step."""
    gae_lambda: float = Field(default=0.95, ge=0.0, le=1.0)
    """Lambda of generalised advantage estimation."""
    clip_range: Factor = 0.2
    """Largest relative change of an action's probability that is rewarded."""
    ent_coef: float = Field(default=0.0, ge=-1e6, le=1e6)
    """Weight of the entropy bonus."""
    vf_coef: Weight = 0.5
    """Weight of the critic's loss."""
    max_grad_norm: Norm = 0.5
    """Norm that gradients are clipped to."""
    target_kl: Factor | None = 1.0
    """An update ends when the policy has moved by 1.5 times this KL divergence; None: no limit."""
    critic_first_updates: int = Field(default=0, ge=0, le=MOST_STEPS)
    """Updates at the start, one per iteration, in which only the critic is trained, so that an
    untrained critic does not change a policy that can already play."""
    learning_rate: LearningRateConfig = LearningRateConfig()
    """Learning rate; a plain number is a constant rate."""
    critic_learning_rate_factor: float = Field(default=1.0, gt=0.0, le=1e4)
    """Factor on the learning rate of the weights that only the values depend on: an untrained
    critic with a trained actor needs a higher rate than the actor tolerates."""

    @property
    def steps_per_iteration(self) -> int:
        """User steps of all environments between two updates."""
        return self.n_envs * self.n_steps

    @field_validator("learning_rate", mode="before")
    @classmethod
    def _constant(cls, value: Any) -> Any:
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return {"initial": value, "final": value, "constant_fraction": 0.0}
        if not isinstance(value, (dict, LearningRateConfig)):
            keys = ", ".join(LearningRateConfig.model_fields)
            raise ValueError(f"got {value!r}, expected a number, or {keys}")
        return value

    @model_validator(mode="after")
    def _whole_minibatches(self) -> Self:
        check_whole_minibatches(self.steps_per_iteration, self.batch_size)
        return self
