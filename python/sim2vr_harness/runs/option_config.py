"""Settings of the motor policy and of value learning over its options."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, field_validator

from sim2vr_harness.base.errors import shown
from sim2vr_harness.base.settings import (
    MOST_STEPS,
    Chance,
    Settings,
    Width,
)
from sim2vr_harness.runs.ppo_config import MOST_USERS


class MotorTrainingConfig(Settings):
    """Training of a body's motor policy: hands that reach goals in time, speed and direction."""

    cycles: int = Field(default=20, ge=1, le=100_000)
    """Cycles of training. In each, bodies move in MuJoCo, the body model is fitted to it, the layer
    learns from imagined rollouts."""
    bodies: int = Field(default=128, ge=1, le=MOST_USERS)
    """Simulated bodies that move in a cycle."""
    width: Width = 256
    """Width of the two hidden layers of the motor layer, and of the critic's."""
    strikes: bool = False
    """True: goals have a time and a speed, as in motion tracking; hands wait and wind up where
    there is time. The motor options of games have a place and no time."""


@dataclass(frozen=True)
class PeopleTraining:
    """Training of a human motor policy: a forward model of the bodies of persons.

    Constants, so that one set of parameters holds for all apps (docs/concepts/people.md).
    """

    cycles: int = 14
    """Cycles of training: persons move, and the forward model of the body is fitted to it."""
    bodies: int = 48
    """Arms that move in a cycle: of this number of virtual participants, or of half as many with
    two."""
    random_steps: int = 400
    """User steps of each person in the first cycle, at random."""
    goal_steps: int = 120
    """User steps of each person in a later cycle, to goals."""
    fit_minibatches: int = 500
    """Minibatches that the forward model is fitted to in a cycle; three times as many in the
    first."""
    body_width: int = 128
    """Width of the hidden layers of the forward model."""
    weber: float = 0.05
    """Standard deviation of a goal's perceived place, of its distance from the hand."""
    least_m: float = 0.001
    """The same of a goal at the hand, m."""
    late_steps: int = 2
    """User steps by which the distance between hand and goal is seen late."""

    @property
    def perception(self) -> dict[str, float]:
        """Noise and delay of perceived goals."""
        return {"weber": self.weber, "least_m": self.least_m, "late_steps": self.late_steps}


class QLearningConfig(Settings):
    """Q-learning over motor options at image cells, for a user with a motor layer."""

    users: int = Field(default=32, ge=1, le=MOST_USERS)
    """Environments in which users play at the same time."""
    user_steps: int = Field(default=64_000, ge=1, le=MOST_STEPS)
    """User steps of the Q-learning, of all users together."""
    try_steps: int = Field(default=8_000, ge=0, le=MOST_STEPS)
    """User steps at the start in which all is tried at random."""
    explore_last: Chance = 0.08
    """Proportion of exploratory decisions after ``explore_steps``."""
    explore_steps: int = Field(default=35_000, ge=1, le=MOST_STEPS)
    """User steps over which that proportion falls."""


LOSS_AVERSION = 2.25
"""Weight of losses relative to gains (Tversky and Kahneman 1992)."""
OptionName = Literal[
    "touch", "push", "swing", "press", "point", "hold", "grab", "turn", "walk", "button"
]


class SkillsConfig(Settings):
    """Training of users with a motor layer that learn which actions are worthwhile in a game."""

    user: Literal["hierarchical", "person"] = "hierarchical"
    """Policy that plays. ``hierarchical``: the Q-network, with the motor layer below it; it
    completes each action that it has selected. ``person``: the same with the limits of people:
    vision is delayed, decisions take time, and the human motor policy of the body moves it; ``train
    GAME --people`` sets it."""
    instruction: Literal["accurate", "balanced", "fast"] = "fast"
    """What participants are asked to be. Where they choose their vigour, outcomes below zero weigh
    :data:`LOSS_AVERSION` times as much as gains; the same as gains for ``fast``, and by its square
    for ``accurate``."""
    motor: str | None = None
    """File of the motor layer; None: the one that ships for the body, or, where none does, one that
    the run makes first."""
    motor_training: MotorTrainingConfig = MotorTrainingConfig()
    """Training of the motor layer."""
    options: tuple[OptionName, ...] | None = Field(default=None, min_length=1)
    """Options of the hands (docs/concepts/training.md); None: touch, push and swing, and those that
    ``env.user.inputs`` allow."""
    tool: Literal["auto", "none"] | Annotated[float, Field(gt=0.0, le=3.0)] = "auto"
    """Tool in the hands: ``auto`` finds it in the images, ``none``: no tool, a length: a straight
    tool that extends the controller forward by so much, m."""
    q_learning: QLearningConfig = QLearningConfig()
    """Q-learning of the values of motor options."""

    @property
    def people(self) -> bool:
        """Return whether virtual participants play, with the limits of people."""
        return self.user == "person"

    @property
    def loss_weight(self) -> float:
        """Return the weight of outcomes below zero: 1 for users who are no persons."""
        power = {"fast": 0, "balanced": 1, "accurate": 2}[self.instruction]
        return LOSS_AVERSION**power if self.people else 1.0

    @field_validator("tool", mode="before")
    @classmethod
    def _known_tool(cls, tool: object) -> object:
        length = isinstance(tool, int | float) and not isinstance(tool, bool) and 0 < tool <= 3
        if tool not in ("auto", "none") and not length:
            raise ValueError(f"got {shown(tool)}, expected 'auto', 'none' or a length of up to 3 m")
        return tool
