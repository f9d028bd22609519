"""Settings of the teacher, which has privileged observations and learns from imagined rollouts."""

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

    In a cycle, users play the true game (``n_envs`` of them), a differentiable model of the body is
    fitted to their user steps, and the policy learns from rollouts of that model in the game's
    differentiable model.
    """

    cycles: int = Field(default=22, ge=1, le=100_000)
    """Cycles of imagined rollouts, in which the teacher learns all that it knows."""
    n_envs: int = Field(default=128, ge=1, le=MOST_USERS)
    """Users that play the true game at the same time."""
    first_play_steps: int = Field(default=600, ge=1, le=1_000_000)
    """User steps of every user in the first cycle, in which they move about at random."""
    play_steps: ClassVar[int] = 100
    """User steps of every user in a later cycle: 5 s at 20 Hz, a few targets of a game."""
    first_fit_minibatches: ClassVar[int] = 1500
    """Minibatches of 1024 user steps that the untrained body model is fitted to in the first
    cycle."""
    fit_minibatches: ClassVar[int] = 215
    """Minibatches of 1024 user steps that it is fitted to in each later cycle."""
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
    almost zero."""
    critic_first_updates: ClassVar[int] = 30
    """Updates at the start in which the critic alone learns: its gradients are noise at first."""
    action_noise: Weight = 0.12
    """Standard deviation of the noise on the actions, true and imagined, so that the policy
    tolerates exploration noise."""
    restart_share: Chance = 0.2
    """Share of users that continue from a state of the true game after a window."""
    keep_best: bool = False
    """True: the teacher is the policy of the cycle that played best in the true game (noise on the
    actions, all conditions have the same weight); False: that of the last cycle."""
    average_updates: int = Field(default=0, ge=0, le=MOST_STEPS)
    """The policy that plays, and that the teacher is, has the mean weights of about the last so
    many updates; 0: those of the last. From one cycle to the next rates of the last weights in the
    true game go up and down by .2, as they follow each body model into its errors (Polyak and
    Juditsky 1992)."""
    delay_ramp_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles in which the delays of senses grow from 0 to their full values: a policy that can act
    on undelayed observations learns sooner to act on delayed ones. 0: full delays from the
    start."""
    undelayed_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles before that in which observations are undelayed: the policy first learns to move, then
    to act without recent observations."""
    noise_ramp_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles in which motor noise of imagined users grows from 0 to its full value: a policy that
    can play learns to do so in spite of noise. 0: full noise from the start."""
    cost_ramp_cycles: int = Field(default=0, ge=0, le=100_000)
    """Cycles in which ``effort`` and ``movement_cost`` grow from 0 to their full values: with both
    high from the start, an untrained policy would not learn to play. 0: full costs from the
    start."""
    near_starts: Chance = 0.5
    """Share of imagined users that begin near a living target."""
    effort: Weight = 0.1
    """Cost of the mean square of activations per user step, for users whose own effort model has a
    memory or depends on forces; others (``neural``, ``muscle_state``) have their own."""
    effort_by: Literal["muscle", "volume"] = "muscle"
    """Weight of muscles in ``effort``: all equal, or by their volume, which their energy
    consumption depends on, so that a shoulder costs more than a wrist."""
    gradient_limit: Norm | None = None
    """Limit on the norm of the gradient of a user's reward by an action (and by the joints' angles,
    1/rad); None: no limit. Motors need one, because a servo's response within 50 ms is steep."""
    actuator_range_cost: Weight = 0.0
    """Cost per user step of actuator targets beyond their ranges, by the square of the share of the
    range; above 0 gradients lead back into the range, at 0 there are none. Motors whose targets
    have drifted to the ends of their ranges otherwise stay there."""
    activation_cost: Weight = 0.0
    """Cost per user step of actuators away from their rest values, by the mean square of shares of
    ranges. Without it, targets that actions increment drift when no reward depends on them, for
    example between two targets."""
    action_rate_cost: Weight = 0.0
    """Cost per user step of the difference between commanded and actual actuator values, by the
    mean square of shares of ranges. Gradients otherwise find commands that oscillate between the
    ends, which no student with delayed senses can repeat, and no person's muscles do."""
    movement_cost: Weight = 0.0
    """Cost per user step of moving the hands through space, by the mean square of their speed,
    m^2/s^2: the mass of an arm has to be accelerated and stopped again, that of a rotating hand is
    small. At the speed that a game requires, strikes then use less of the arm and are less
    hurried."""
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
    """The game's conditions, in turn; None: those that its differentiable model names."""
    hidden_fields: tuple[str, ...] | None = None
    """Patterns of privileged numbers, and of the own body's, that the teacher does not observe;
    None: those that the game model names."""
    recognition_latency_steps: int = Field(default=0, ge=0, le=100)
    """User steps from an object's first image to the teacher's first observation of it. At first
    an object covers a pixel or two; a student cannot recognise it and imitate a reaction to it."""
    imagined: ImaginedConfig = ImaginedConfig()
    """Imagined rollouts, in which the teacher is trained."""
    curriculum: CurriculumConfig = CurriculumConfig()
    """Starts of rounds in the true game."""
