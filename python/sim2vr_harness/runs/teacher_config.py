"""Settings of the teacher, who observes privileged numbers and learns from imagined rollouts."""

from typing import ClassVar, Literal

from pydantic import Field

from sim2vr_harness.base.settings import (
    MOST_STEPS,
    Chance,
    Factor,
    LearningRate,
    Norm,
    Settings,
    Weight,
    Width,
)
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.runs.ppo_config import MOST_USERS


class ImaginedConfig(Settings):
    """Imagined rollouts: the model-based learning of the teacher.

    A cycle: users of the true game play (``n_envs`` of them), a differentiable model of
    the body is fitted to what they did, and the policy learns from rollouts of that model in the
    game's differentiable model.
    """

    cycles: int = Field(default=22, ge=1, le=100_000)
    """Cycles of imagined rollouts, in which the teacher learns all that it knows."""
    n_envs: int = Field(default=128, ge=1, le=MOST_USERS)
    """Users who play the true game at the same time."""
    first_play_steps: int = Field(default=600, ge=1, le=1_000_000)
    """User steps of every user in the first cycle, in which they move about at random."""
    play_steps: ClassVar[int] = 100
    """User steps of every user in a later cycle: 5 s at 20 Hz, a few targets of a game."""
    first_fit_minibatches: ClassVar[int] = 1500
    """Minibatches of 1024 user steps that the body model is fitted to in the first cycle: it knows
    nothing yet."""
    fit_minibatches: ClassVar[int] = 215
    """Minibatches of 1024 user steps that it is fitted to in a later cycle, to what is new."""
    body_width: Width = 256
    """Width of the body model's hidden layers."""
    critic_width: Width = 256
    """Width of the critic's hidden layers."""
    users: int = Field(default=512, ge=1, le=100_000)
    """Imagined users."""
    updates: ClassVar[int] = 90
    """Updates of the policy in a cycle: with more it learns the errors of the body model."""
    window_steps: int = Field(default=16, ge=1, le=10_000)
    """User steps through which gradients go."""
    gamma: Chance = 0.96
    """Discount factor per user step."""
    learning_rate: LearningRate = 1e-3
    """Learning rate of the policy: constant for the first half of the updates, then linear to
    almost nothing."""
    critic_first_updates: ClassVar[int] = 30
    """Updates at the start in which the critic alone learns: its gradients are noise at first."""
    action_noise: Weight = 0.12
    """Standard deviation on the actions, true and imagined, so that what is learned bears the noise
    of a policy that explores."""
    restart_share: Chance = 0.2
    """Users who go on from a state of the true game after a window."""
    keep_best: bool = False
    """True: the teacher is the policy of the cycle that played best in the true game (noise on the
    actions, all conditions have the same weight); False: that of the last cycle."""
    average_updates: int = Field(default=0, ge=0, le=MOST_STEPS)
    """The policy that plays, and that the teacher is, has the mean weights of about the last so
    many updates; 0: those of the last. From one cycle to the next rates of the last weights in the
    true game go up and down by .2, as they follow each body model into its errors (Polyak and
    Juditsky 1992)."""
    delay_ramp_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles in which late senses become as late as they are, from the present on: who has learned
    to act on the present learns sooner to act on the past. 0: at once."""
    undelayed_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles before that in which the present is known: to move is learned first, to do without
    what is not seen yet after it."""
    noise_ramp_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles in which motor noise of imagined users grows from nothing to what it is: who has
    learned what to do learns to do it in spite of noise. 0: noisy from the start."""
    cost_ramp_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles in which ``effort`` and ``movement_cost`` grow from nothing to what they are: where
    both are high, no one who cannot play yet would learn to. 0: as high from the start."""
    near_starts: Chance = 0.5
    """Share of those who begin near a living target."""
    effort: Weight = 0.1
    """Cost of the mean square of activations per user step, for users whose own effort remembers
    or looks at forces; others (``neural``, ``muscle_state``) have their own."""
    effort_by: Literal["muscle", "volume"] = "muscle"
    """Muscles count alike in it, or each by its volume, as what it burns does: then a shoulder is
    dear and a wrist cheap."""
    gradient_limit: Norm | None = None
    """Longest gradient of a user's reward by an action (and by the joints' angles, 1/rad); None:
    none. Motors need one: what a servo does in 50 ms is steep."""
    actuator_range_cost: Weight = 0.0
    """Cost per user step of aiming actuators beyond their ranges, by the square of the share of the
    range; above 0 gradients lead back from there, at 0 there are none. Motors whose targets have
    drifted to the ends of their ranges stay there otherwise."""
    activation_cost: Weight = 0.0
    """Cost per user step of actuators away from where they rest, by the mean square of shares of
    ranges. What actions add to drifts away where nothing is at stake: between two targets."""
    action_rate_cost: Weight = 0.0
    """Cost per user step of what is asked of actuators beside what they do, by the mean square of
    shares of ranges. Gradients find commands that go to and fro between the ends, which no student
    who sees late can repeat, and no person's muscles do."""
    movement_cost: Weight = 0.0
    """Cost per user step of carrying hands from place to place, by the mean square of their speed,
    m^2/s^2: the mass of an arm is sped up and stopped again, that of a hand that turns is small.
    Who strikes as fast as the game asks does it with less of the arm then, and hurries less."""
    reward_scale: Factor = 1.0
    """Factor on the game's reward and the effort: a success should be worth about 10."""
    game: dict[str, OptionValue] = Field(default_factory=dict)
    """Settings of the differentiable game model (``games/NAME/settings.py``)."""

    @property
    def easier_cycles(self) -> int:
        """Cycles in which senses are not as late, muscles not as noisy or ways not as dear yet."""
        late = self.undelayed_cycles + self.delay_ramp_cycles
        return max(late, self.noise_ramp_cycles, self.cost_ramp_cycles)


class CurriculumConfig(Settings):
    """Starts of the teacher's rounds in the true game; rewards and rules do not change."""

    near_starts: Chance = 0.3
    """Share of episodes that start near a good start of an action, instead of the true start."""


class TeacherConfig(Settings):
    """The first stage of a distilled training: a policy on privileged numbers, no pictures."""

    conditions: tuple[str, ...] | None = None
    """The game's conditions, in turn; None takes those that its differentiable model names."""
    hidden_fields: tuple[str, ...] | None = None
    """Patterns of privileged numbers, and of the own body's, that the teacher does not observe;
    None takes those that the game model names."""
    recognition_latency_steps: int = Field(default=0, ge=0, le=100)
    """User steps from an object's first image to the teacher's first observation of it. At first
    an object covers a pixel or two; a student cannot recognise it and imitate a reaction to it."""
    imagined: ImaginedConfig = ImaginedConfig()
    """Imagined rollouts, in which the teacher is trained."""
    curriculum: CurriculumConfig = CurriculumConfig()
    """Starts of rounds in the true game."""
