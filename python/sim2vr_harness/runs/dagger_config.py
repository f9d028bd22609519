"""Settings of the student, the second stage of a distilled training."""

from pydantic import Field

from sim2vr_harness.base.settings import Chance, LearningRate, Settings, Weight
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.runs.ppo_config import MOST_BATCH, MOST_USERS


class StudentConfig(Settings):
    """The second stage: a policy that sees imitates the teacher (DAgger)."""

    n_envs: int = Field(default=64, ge=1, le=MOST_USERS)
    """Environments that run at the same time."""
    frames: int = Field(default=200_000, ge=1, le=1_000_000_000)
    """User steps that are collected."""
    kept_frames: int | None = Field(default=None, ge=1, le=1_000_000_000)
    """User steps that are learned from, the latest; None: all. They are kept in files until the
    stage is over, some 30 KB for a picture of three channels: more than the memory has are slow."""
    app_options: dict[str, OptionValue] = Field(default_factory=dict)
    """Options of the game in this stage that differ from ``env.app.options``."""
    samples_per_frame: float = Field(default=3.0, gt=0.0, le=1000.0)
    """Mean number of times that each collected frame is used for training."""
    batch_size: int = Field(default=500, ge=1, le=MOST_BATCH)
    """User steps per minibatch."""
    learning_rate: LearningRate = 1e-3
    """Learning rate: constant for the first half of the frames, then linear to almost zero."""
    numbers_weight: Weight = 0.0
    """Weight in the loss of the head that predicts the teacher's observations of the game
    (standardised, mean squared error) from all that the student senses; 0: no such head. If many
    objects have to be recognised in a small image, imitating actions alone trains recognition too
    slowly."""
    teacher_share: Chance = 0.6
    """Share of the steps on which the teacher acts after the first rounds of collecting, in which
    it acts for every user."""
    teacher_share_decay: Chance = 0.9
    """Factor on that proportion from round to round."""
    noise_std: Weight = 0.1
    """Noise on the actions of some users, so that unusual situations are seen too."""
    log_std: float = Field(default=-1.5, ge=-20.0, le=5.0)
    """Logarithm of the actions' standard deviation with which PPO continues the student."""
    stagger_steps: int = Field(default=1200, ge=1, le=1_000_000_000)
    """Users' first rounds are truncated at random within this number of steps, so that rounds do
    not run in phase."""
