"""How a teacher is trained: settings of its learner, and the aids on the way to the true task."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["ActionsConfig", "AidsConfig", "Ramp", "TeacherConfig", "TeacherPPOConfig"]


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Ramp(_Settings):
    """A number that changes linearly with the user steps taken, between two constants."""

    start: float
    end: float
    from_step: int = Field(default=0, ge=0)
    to_step: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _forwards(self) -> Self:
        if self.to_step < self.from_step:
            raise ValueError(
                f"to_step: got {self.to_step}, expected from_step={self.from_step} or more"
            )
        return self

    def at(self, step: int) -> float:
        """The value after ``step`` user steps."""
        if step >= self.to_step:
            return self.end
        if step <= self.from_step:
            return self.start
        share = (step - self.from_step) / (self.to_step - self.from_step)
        return self.start + share * (self.end - self.start)


def _constant(value: float) -> Ramp:
    return Ramp(start=value, end=value)


class StrokeConfig(_Settings):
    """Numbers of the script that strikes (training/strokes.py), for one placement."""

    run_up_m: float
    """How far in front of a target a stroke begins."""
    lateral_m: float
    """How far beside a target's middle a stroke may begin."""
    lateral_under_way_m: float
    """How much more is allowed once it is under way."""
    begin_m: float
    """Least distance in front of a target at which a stroke begins."""
    follow_through_m: float
    """How far behind a target's middle a stroke goes on."""
    approach_per_s2: float
    approach_damping_per_s: float
    stroke_mps: float
    """Wanted strike speed."""
    stroke_per_s: float
    steering_per_s2: float
    """Towards the target's middle during a stroke."""
    greatest_mps2: float
    """Of the hand's acceleration, along each axis."""
    cost_per_m: float
    """Of a target's distance, by which one is chosen."""
    cost_per_s: float
    """Of the time a target has left."""
    cost_per_mps: float
    """What moving towards a target is worth."""
    least_life_s: float
    """Targets with less time left come last."""
    life_s_per_m: float
    """How much more time a distant target needs."""
    posture_rad: tuple[float, ...]
    posture_stiffness_per_s2: float
    joint_damping_per_s: float


STROKES = {
    "round.low": StrokeConfig(
        run_up_m=0.1916,
        lateral_m=0.0347,
        lateral_under_way_m=0.0633,
        begin_m=0.0506,
        follow_through_m=0.0312,
        approach_per_s2=107.0662,
        approach_damping_per_s=13.7162,
        stroke_mps=1.3675,
        stroke_per_s=34.3243,
        steering_per_s2=146.884,
        greatest_mps2=42.522,
        cost_per_m=1.7382,
        cost_per_s=0.5428,
        cost_per_mps=0.3184,
        least_life_s=0.156,
        life_s_per_m=0.1191,
        posture_stiffness_per_s2=8.6018,
        joint_damping_per_s=7.0596,
        posture_rad=(0.896, 1.009, 0.27, 1.721, 0.345, 0.319, 0.044),
    ),
    "round.mid": StrokeConfig(
        run_up_m=0.195,
        lateral_m=0.0255,
        lateral_under_way_m=0.1035,
        begin_m=0.0314,
        follow_through_m=0.0645,
        approach_per_s2=92.7982,
        approach_damping_per_s=13.9529,
        stroke_mps=1.994,
        stroke_per_s=13.4715,
        steering_per_s2=145.4915,
        greatest_mps2=42.7867,
        cost_per_m=2.0615,
        cost_per_s=0.6263,
        cost_per_mps=0.4063,
        least_life_s=0.133,
        life_s_per_m=0.3081,
        posture_stiffness_per_s2=11.5967,
        joint_damping_per_s=4.7107,
        posture_rad=(1.605, 0.902, -0.15, 1.18, -0.05, -0.062, -0.082),
    ),
    "round.high": StrokeConfig(
        run_up_m=0.1442,
        lateral_m=0.0231,
        lateral_under_way_m=0.0043,
        begin_m=0.0237,
        follow_through_m=0.0634,
        approach_per_s2=77.94,
        approach_damping_per_s=11.4244,
        stroke_mps=2.0612,
        stroke_per_s=22.4519,
        steering_per_s2=166.0479,
        greatest_mps2=34.2847,
        cost_per_m=2.1355,
        cost_per_s=0.245,
        cost_per_mps=0.3911,
        least_life_s=0.133,
        life_s_per_m=0.4657,
        posture_stiffness_per_s2=17.7764,
        joint_damping_per_s=4.1004,
        posture_rad=(1.426, 0.847, -0.239, 1.72, 0.465, 0.582, 0.548),
    ),
}
"""By the privileged number that is 1 at the placement."""


class ActionsConfig(_Settings):
    """What the teacher decides; what reaches the muscles are changes of activation either way."""

    kind: Literal["strokes", "hand", "joints", "muscles"] = "strokes"
    """``muscles``: the changes themselves. ``joints``: accelerations of the independent joints, for
    which the least activations are computed (users/joint_drive.py). ``hand``: where the hand is
    pulled to, along the app's axes from its aim. ``strokes``: what the hand's acceleration has more
    than the script of training/strokes.py wants."""
    strokes: dict[str, StrokeConfig] = STROKES
    correction_mps2: float = Field(default=15.0, gt=0.0)
    """What 1 stands for, of ``strokes``."""
    aim: str | None = "next0"
    """The aim: the target of this name among the privileged numbers while there is one, otherwise,
    and always with None, where the game says the hand may wait (``aid.home_*``)."""
    reach_m: float = Field(default=0.4, gt=0.0)
    """What 1 stands for, of the place that the hand is pulled to."""
    hand_stiffness_per_s2: float = Field(default=200.0, ge=0.0)
    """Acceleration of the hand per distance from that place."""
    hand_damping_per_s: float = Field(default=16.0, ge=0.0)
    """Deceleration of the hand per velocity, beside that of the joints."""
    hand_mps2: float = Field(default=40.0, gt=0.0)
    """The greatest acceleration wanted of the hand, along each axis."""
    hand_scale_mps2: float = Field(default=4.0, gt=0.0)
    """Errors of the hand's acceleration count in this unit, those of the joints in their own."""
    postures_rad: dict[str, tuple[float, ...]] = {
        "round.low": (0.35, 1.1, 0.2, 1.5, 0.5, 0.2, 0.1),
        "round.mid": (1.7, 0.8, 0.2, 1.2, 0.0, 0.3, 0.4),
        "round.high": (1.3, 1.1, -0.1, 1.6, 0.3, 0.35, 0.2),
    }
    """Where the joints are drawn to beside what the hand does, by the privileged number that is 1
    then; from here the muscles move the hand to and fro fastest."""
    posture_stiffness_per_s2: float = Field(default=15.0, ge=0.0)
    acceleration_radps2: tuple[float, ...] = (40.0, 60.0, 120.0, 120.0, 100.0, 60.0, 100.0)
    """What 1 stands for, by joint."""
    damping_per_s: float = Field(default=4.0, ge=0.0)
    """Deceleration per velocity, so that no action means coming to rest."""
    effort: float = Field(default=0.02, gt=0.0)
    """Weight of the activations' squares against the acceleration's."""


class AidsConfig(_Settings):
    """What helps the teacher to find the strokes at all; all of it ends on the true task.

    With either the starts and the elbow, or the shaping and the threshold left out, a prototype's
    hit rate after 0.33 M steps was 0.02 to 0.18 instead of 0.54.
    """

    progress: Ramp = _constant(10.0)
    """Reward per metre by which the hammer comes nearer to the target that expires first."""
    strike: Ramp = _constant(20.0)
    """Reward per metre of strike near a target: of speed (m/s, at most 1) over time (s)."""
    straight_elbow: Ramp = _constant(0.3)
    """Cost per rad by which the elbow is straighter than ``elbow_rad``, and user step."""
    elbow_rad: float = 0.5
    strike_threshold_mps: Ramp = Ramp(start=0.3, end=0.8, to_step=500_000)
    """What the game asks of a hit; the true value is 0.8."""
    life_seconds: Ramp = _constant(1.0)
    """How long a target lives; the true value is 1."""
    effort: Ramp = _constant(1.0)
    """Share of the true cost of effort."""
    near_starts: Ramp = _constant(0.7)
    """Share of episodes that start with the hammer near a cell, instead of the true start."""
    near_start_m: float = Field(default=0.08, gt=0.0)
    """How near: the marker's distance from a point 10 cm in front of a cell."""
    start_elbow_rad: tuple[float, float] = (0.5, 1.9)
    starts_per_cell: int = Field(default=40, ge=1)
    """Start postures that are looked for, for each cell and placement."""
    failing_cells: Ramp = _constant(0.5)
    """Share of spawns that go by the cells' fail rates; the others are uniform."""
    episode_seconds: Ramp = _constant(5.0)
    """Episodes are cut after this time; the value of the state stands for the rest."""


class TeacherPPOConfig(_Settings):
    """Proximal policy optimisation on numbers; names are Stable-Baselines3's where it has one."""

    n_envs: int = Field(default=128, ge=1)
    n_steps: int = Field(default=32, ge=1)
    batch_size: int = Field(default=1024, ge=2)
    n_epochs: int = Field(default=6, ge=1)
    gamma: float = Field(default=0.96, ge=0.0, le=1.0)
    gae_lambda: float = Field(default=0.93, ge=0.0, le=1.0)
    clip_range: float = Field(default=0.2, gt=0.0)
    ent_coef: float = 0.0
    max_grad_norm: float = Field(default=1.0, gt=0.0)
    """Of the actor's and of the critic's gradient, each."""
    learning_rate: float = Field(default=3.0e-4, gt=0.0)
    """At the start; it follows ``target_kl`` from there."""
    learning_rate_range: tuple[float, float] = (5.0e-5, 2.0e-3)
    target_kl: float | None = Field(default=0.05, gt=0.0)
    """An update that moves the policy by more than twice this lowers the learning rate, one that
    moves it by less than half of it raises it. None keeps the rate."""
    critic_first_iterations: int = Field(default=10, ge=0)
    """Iterations at the start in which the critic alone learns: the script plays already, and is
    not to be judged by a critic that knows nothing."""
    mean_penalty: float = Field(default=1.0e-3, ge=0.0)
    """Cost of means beyond the actions' range, squared."""
    reward_scale: float = Field(default=0.2, gt=0.0)
    net_arch: tuple[int, ...] = (256, 256)
    """Hidden layers of actor and critic each, SiLU."""
    action_scale: float = Field(default=0.5, gt=0.0)
    """Means are the actor's outputs times this."""
    log_std_init: float = -2.6
    log_std_min: float = -3.0
    observation_clip: float = Field(default=8.0, gt=0.0)
    """Of the normalised observation."""

    @property
    def steps_per_iteration(self) -> int:
        """User steps of all environments between two updates."""
        return self.n_envs * self.n_steps

    @model_validator(mode="after")
    def _whole_minibatches(self) -> Self:
        if self.steps_per_iteration % self.batch_size:
            raise ValueError(
                f"batch_size: got {self.batch_size}, expected a divisor of n_envs * n_steps = "
                f"{self.steps_per_iteration}"
            )
        return self


class TeacherConfig(_Settings):
    """The first stage of a distilled training: a policy on privileged numbers, without pictures."""

    total_timesteps: int = Field(default=3_000_000, ge=1)
    conditions: tuple[str, ...] = ("low-medium", "medium", "high-medium")
    """The game's conditions, in turn."""
    hidden_fields: tuple[str, ...] = ("aid.*", "round.elapsed_s", "cell*.?_m")
    """Patterns of privileged numbers that the teacher does not observe."""
    coarse_physics_s: float | None = Field(default=0.005, gt=0.0)
    """Physics step at first, which makes user steps cheaper."""
    coarse_until_step: int = Field(default=2_000_000, ge=0)
    """From here on the physics is the true one."""
    actions: ActionsConfig = ActionsConfig()
    ppo: TeacherPPOConfig = TeacherPPOConfig()
    aids: AidsConfig = AidsConfig()
    evaluate_every_steps: int = Field(default=250_000, ge=1)
    evaluate_rounds: int = Field(default=4, ge=0)
    """Rounds of 60 s per condition, true rules, uniform spawns, stochastic policy."""
