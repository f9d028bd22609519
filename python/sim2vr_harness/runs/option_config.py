"""How a motor layer is trained, and how a user with one learns a game."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from sim2vr_harness.base.settings import (
    MOST_STEPS,
    Chance,
    Settings,
    Weight,
    Width,
)
from sim2vr_harness.runs.ppo_config import MOST_USERS

__all__ = ["MotorTrainingConfig", "PeopleTrainingConfig", "QLearningConfig", "SkillsConfig"]


class MotorTrainingConfig(Settings):
    """Practice of a body's motor layer: hands that come where they are told to, when and how."""

    cycles: int = Field(default=20, ge=1, le=100_000)
    """Cycles of training. In each, bodies move in MuJoCo, the body model is fitted to it, the layer
    learns from imagined rollouts."""
    bodies: int = Field(default=128, ge=1, le=MOST_USERS)
    """Simulated bodies that move in a cycle."""
    width: Width = 256
    """Width of the two hidden layers of the motor layer, and of the critic's."""
    strikes: bool = False
    """True: hands come through places when and as fast as they are told, as those do who follow
    other hands; they wait and wind up where there is time. Games' moves say where, not when."""


class PeopleTrainingConfig(Settings):
    """Training of a human motor policy: movements that a person starts, corrects and ends."""

    cycles: int = Field(default=14, ge=2, le=100_000)
    """Cycles of training: in each, persons move, and the forward model of the body is fitted to it.
    The last one ends with the training of the policy in space."""
    bodies: int = Field(default=48, ge=1, le=MOST_USERS)
    """Simulated persons that move in a cycle."""
    random_steps: int = Field(default=400, ge=1, le=1_000_000)
    """User steps of each person in the first cycle, at random."""
    goal_steps: int = Field(default=120, ge=1, le=1_000_000)
    """User steps of each person in a later cycle, to goals."""
    fit_minibatches: int = Field(default=500, ge=1, le=1_000_000)
    """Minibatches that the forward model is fitted to in a cycle; three times as many in the
    first."""
    updates: int = Field(default=450, ge=1, le=1_000_000)
    """Updates of the policy in space, of 512 movements each."""
    width: Width = 64
    """Width of the two hidden layers of the policy in space."""
    body_width: Width = 128
    """Width of the hidden layers of the forward model."""
    success_reward: Weight = 5.0
    """Reward of a movement that ends as its goal says."""
    miss_cost: Weight = 3.0
    """Cost of a movement that ends otherwise."""
    time_cost: Weight = 7.0
    """Cost of time while a goal is pursued, 1/s."""
    distance_cost: Weight = 15.0
    """Cost of the distance to the goal at the end of a movement, 1/m."""
    effort_cost: Weight = 0.15
    """Cost of the time integral of the hand's squared acceleration, s^3/m^2."""
    weber: Chance = 0.05
    """Standard deviation of a goal's perceived place, of its distance from the hand."""
    least_m: Weight = 0.001
    """The same of a goal at the hand, m."""
    late_steps: int = Field(default=2, ge=0, le=100)
    """User steps by which the distance between hand and goal is seen late."""

    @property
    def perception(self) -> dict[str, float]:
        """How goals are misjudged."""
        return {"weber": self.weber, "least_m": self.least_m, "late_steps": self.late_steps}


class QLearningConfig(Settings):
    """How a user with a motor layer finds out what is worth doing with what it sees."""

    users: int = Field(default=32, ge=1, le=MOST_USERS)
    """Environments in which users play at the same time."""
    user_steps: int = Field(default=120_000, ge=1, le=MOST_STEPS)
    """User steps of the Q-learning, of all users together."""
    try_steps: int = Field(default=8_000, ge=0, le=MOST_STEPS)
    """User steps at the start in which all is tried at random."""
    explore_last: Chance = 0.08
    """Proportion of exploratory decisions after ``explore_steps``."""
    explore_steps: int = Field(default=50_000, ge=1, le=MOST_STEPS)
    """User steps over which that proportion falls."""


class SkillsConfig(Settings):
    """Users who bring a motor layer to a game and learn what is worth doing with what they see."""

    user: Literal["student", "hierarchical"] = "student"
    """Who plays in the end. ``student``: a policy from senses to muscles, which then goes on by PPO
    with the true effort. ``hierarchical``: the Q-network, with the motor layer below it; it plays
    as soon as it has learned, and completes each action that it has selected."""
    people: bool = False
    """True: users see late, need time to decide, and move by the human motor policy of their body;
    the cost of effort counts in what they decide. ``train GAME --people`` sets it."""
    motor: str | None = None
    """File of the motor layer; None: the one that ships for the body, or, where none does, one that
    the run makes first."""
    motor_training: MotorTrainingConfig = MotorTrainingConfig()
    """Training of the motor layer."""
    people_training: PeopleTrainingConfig = PeopleTrainingConfig()
    """Training of a human motor policy."""
    q_learning: QLearningConfig = QLearningConfig()
    """Q-learning of what to do with what is seen."""
