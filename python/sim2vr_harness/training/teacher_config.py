"""How a teacher is trained: settings of its learner, and the aids on the way to the true task."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from sim2vr_harness.settings import Settings, check_whole_minibatches

__all__ = ["AidsConfig", "ImaginationConfig", "Ramp", "TeacherConfig", "TeacherPPOConfig"]


class Ramp(Settings):
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


class ImaginationConfig(Settings):
    """Practice in the mind, before the teacher learns in the true game (training/imagination).

    A cycle: users of the true game play (``teacher.ppo.n_envs`` of them), a differentiable model of
    the body is fitted to what they did, and the policy practises with it.
    """

    cycles: int = Field(default=22, ge=0)
    """0: no practice, the teacher begins with nothing."""
    first_play_steps: int = Field(default=600, ge=1)
    """User steps of every user in the first cycle, in which they move about at random."""
    wild_seconds: float = Field(default=1.0, gt=0.0)
    """Their episodes last so long, and begin with the hammer near a cell."""
    play_steps: int = Field(default=100, ge=1)
    """User steps of every user in a later cycle."""
    kept_cycles: int = Field(default=12, ge=1)
    """Cycles whose user steps are kept, beside the first."""
    first_fit_minibatches: int = Field(default=1500, ge=20)
    fit_minibatches: int = Field(default=215, ge=20)
    """Minibatches of 1024 user steps that the body model is fitted to."""
    body_width: int = Field(default=256, ge=1)
    critic_width: int = Field(default=256, ge=1)
    users: int = Field(default=512, ge=1)
    """Imagined ones."""
    updates: int = Field(default=90, ge=1)
    """Of the policy in a cycle."""
    window_steps: int = Field(default=16, ge=1)
    """User steps through which gradients go."""
    gamma: float = Field(default=0.96, ge=0.0, le=1.0)
    lam: float = Field(default=0.9, ge=0.0, le=1.0)
    """Of the critic's returns."""
    learning_rate: float = Field(default=1e-3, gt=0.0)
    """Constant for the first half of the updates, then linear to almost nothing."""
    critic_learning_rate: float = Field(default=1e-3, gt=0.0)
    critic_first_updates: int = Field(default=30, ge=0)
    action_noise: float = Field(default=0.12, ge=0.0)
    """Standard deviation on the actions, in play and in practice, so that what is learned bears
    the noise of a policy that explores."""
    error_share: float = Field(default=0.3, ge=0.0)
    """Noise on the imagined motion, in units of the body model's error."""
    restart_share: float = Field(default=0.2, ge=0.0, le=1.0)
    """Users who go on from a state of the true game after a window."""
    near_starts: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of those who begin near a living target."""
    near_m: float = Field(default=0.12, gt=0.0)
    """How near: the marker's distance from a point 10 cm in front of it."""
    single_targets: float = Field(default=0.4, ge=0.0, le=1.0)
    """Share of users who never have more than one target at a time. With several, the policy went
    for the near ones only, and never learned to reach the far corner."""
    failing_cells: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of spawns that go by the cells' fail rates; the others are uniform."""
    failing_value: float = Field(default=1.0, ge=0.0)
    """A hit in a cell that fails k times as often as the mean, at most 3 times, is worth this times
    k - 1 hits more: with several targets at once the far cells are given up otherwise."""
    overlap_m: float = Field(default=0.015, gt=0.0)
    speed_mps: float = Field(default=0.3, gt=0.0)
    near_reward: float = Field(default=3.0, ge=0.0)
    distance_reward: float = Field(default=7.0, ge=0.0)
    """How soft hits are and what helps to find them, at first; by the middle of the practice they
    are 0.004, 0.08, 0.2 and 1 (the game's own)."""
    effort: float = Field(default=0.1, ge=0.0)
    """Cost of the mean square of activations per user step."""
    stuck_cost: float = Field(default=0.0, ge=0.0)
    """Cost per user step of the hammer staying in a target that it is in and has not hit. A user
    who may hit at any speed waits where targets grow into the hammer otherwise."""


class AidsConfig(Settings):
    """What may help a teacher to find the strokes at all; all of it ends on the true task.

    After practice in the mind there is little to help with: rewards are the true ones.
    """

    progress: Ramp = _constant(0.0)
    """Reward per metre by which the hammer comes nearer to the target that expires first."""
    strike: Ramp = _constant(0.0)
    """Reward per metre of strike near a target: of speed (m/s, at most 1) over time (s)."""
    straight_elbow: Ramp = _constant(0.0)
    """Cost per rad by which the elbow is straighter than ``elbow_rad``, and user step."""
    elbow_rad: float = 0.5
    strike_threshold_mps: Ramp = _constant(0.8)
    """What the game asks of a hit; the true value is 0.8."""
    life_seconds: Ramp = _constant(1.0)
    """How long a target lives; the true value is 1."""
    effort: Ramp = _constant(1.0)
    """Share of the true cost of effort."""
    near_starts: Ramp = _constant(0.3)
    """Share of episodes that start with the hammer near a cell, instead of the true start."""
    near_start_m: float = Field(default=0.08, gt=0.0)
    """How near: the marker's distance from a point 10 cm in front of a cell."""
    start_elbow_rad: tuple[float, float] = (0.5, 1.9)
    starts_per_cell: int = Field(default=40, ge=1)
    """Start postures that are looked for, for each cell and placement."""
    failing_cells: Ramp = _constant(0.3)
    """Share of spawns that go by the cells' fail rates; the others are uniform."""
    episode_seconds: Ramp = _constant(12.0)
    """Episodes are cut after this time; the value of the state stands for the rest."""


class TeacherPPOConfig(Settings):
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
    """Iterations at the start in which the critic alone learns: the policy plays already, and is
    not to be judged by a critic that knows nothing."""
    mean_penalty: float = Field(default=1.0e-3, ge=0.0)
    """Cost of means beyond the actions' range, squared."""
    reward_scale: float = Field(default=0.2, gt=0.0)
    net_arch: tuple[int, ...] = (256, 256)
    """Hidden layers of actor and critic each, SiLU."""
    action_scale: float = Field(default=0.5, gt=0.0)
    """Means are the actor's outputs times this."""
    log_std_init: float = -2.1
    log_std_min: float = -3.0
    observation_clip: float = Field(default=8.0, gt=0.0)
    """Of the normalised observation."""

    @property
    def steps_per_iteration(self) -> int:
        """User steps of all environments between two updates."""
        return self.n_envs * self.n_steps

    @model_validator(mode="after")
    def _whole_minibatches(self) -> Self:
        check_whole_minibatches(self.steps_per_iteration, self.batch_size)
        return self


class TeacherConfig(Settings):
    """The first stage of a distilled training: a policy on privileged numbers, without pictures."""

    total_timesteps: int = Field(default=3_000_000, ge=1)
    conditions: tuple[str, ...] = ("low-medium", "medium", "high-medium")
    """The game's conditions, in turn."""
    hidden_fields: tuple[str, ...] = (
        *("aid.*", "round.elapsed_s", "cell*.?_m", "*.overlap", "nearest.*", "hammer.v?_mps"),
        *("* qacc", "fingertip *"),
    )
    """Patterns of privileged numbers, and of the own body's, that the teacher does not observe."""
    coarse_physics_s: float | None = Field(default=0.005, gt=0.0)
    """Physics step at first, which makes user steps cheaper."""
    coarse_until_step: int = Field(default=2_000_000, ge=0)
    """From here on the physics is the true one."""
    imagination: ImaginationConfig = ImaginationConfig()
    ppo: TeacherPPOConfig = TeacherPPOConfig()
    aids: AidsConfig = AidsConfig()
    evaluate_every_steps: int = Field(default=250_000, ge=1)
    evaluate_rounds: int = Field(default=4, ge=0)
    """Rounds of 60 s per condition, true rules, uniform spawns, stochastic policy."""
