"""How a student is trained: the second stage of a distilled training."""

from __future__ import annotations

from pydantic import Field

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.settings import Settings

__all__ = ["StudentConfig"]


class StudentConfig(Settings):
    """The second stage: a policy that sees imitates the teacher (DAgger)."""

    n_envs: int = Field(default=64, ge=1)
    frames: int = Field(default=200_000, ge=1)
    """User steps that are collected, all of which are kept until the stage is over."""
    app_options: dict[str, OptionValue] = Field(default_factory=dict)
    """Options of the game in this stage that differ from ``env.app.options``."""
    rollout_steps: int = Field(default=32, ge=1)
    """User steps per user between two times of learning."""
    samples_per_frame: float = Field(default=3.0, gt=0.0)
    """How often a frame is learned from, on average, per frame that is collected."""
    batch_size: int = Field(default=500, ge=1)
    learning_rate: float = Field(default=1e-3, gt=0.0)
    """Constant for the first half of the frames, then linear to almost nothing."""
    weight_decay: float = Field(default=1e-4, ge=0.0)
    max_grad_norm: float = Field(default=1.0, gt=0.0)
    imitation_weight: float = Field(default=4.0, gt=0.0)
    facts_weight: float = Field(default=0.2, ge=0.0)
    """Of the heads that name facts of the picture, such as which targets are there."""
    teacher_rounds: int = Field(default=3, ge=0)
    """Rounds of collecting in which the teacher acts for everybody."""
    teacher_share: float = Field(default=0.6, ge=0.0, le=1.0)
    """Share of the steps on which the teacher acts in the round after those."""
    teacher_share_decay: float = Field(default=0.9, ge=0.0, le=1.0)
    noise_std: float = Field(default=0.1, ge=0.0)
    """Noise on the actions of some users, so that unusual situations are seen too."""
    noisy_users: float = Field(default=0.25, ge=0.0, le=1.0)
    image_noise: float = Field(default=0.0, ge=0.0)
    """Standard deviation of noise on the pictures that are learned from, of 255."""
    log_std: float = -1.5
    """Logarithm of the actions' standard deviation with which the student goes on to PPO."""
    stagger_steps: int = Field(default=1200, ge=1)
    """Users' first rounds are cut at random within so many steps, so that rounds do not run in
    phase."""
    statistics_episodes: int = Field(default=100, ge=1)
    checkpoint_rounds: int = Field(default=20, ge=1)
