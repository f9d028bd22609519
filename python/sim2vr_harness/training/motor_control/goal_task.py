"""Goals of hands as the task of a model-based training, whose policy is a motor policy."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import motor_noise
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.goal_sampler import GoalSampler
from sim2vr_harness.policies.hierarchical.motor_policy import INSIDE, MotorPolicy, reachable_poses
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for, save_motor_layer
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.option_config import MotorTrainingConfig
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.training.model_based.stage import CycleStage
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer, Task, value_function
from sim2vr_harness.users import Body, UserBatch
from sim2vr_harness.users.noise import MotorNoiseSettings
from sim2vr_harness.world_models.body_dynamics import BodyModel
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import TransitionStore

MOTOR_STATE = "the state of a motor training"
"""Name in error messages of the file that holds a motor trainer's state."""

_EPISODE_STEPS, _RANDOM_EPISODE_STEPS = 60, 20
_EFFORT = 0.3
"""Cost of the mean square of the drives per user step; arriving well is worth about 10."""
_FIRST_PLAY_STEPS, _BODY_WIDTH, _USERS, _WINDOW_STEPS = 400, 256, 256, 16
"""User steps of each body in the first cycle, with random actions; width of the body model's hidden
layers; imagined users; user steps of backpropagation through time, about the duration of a
reach."""


class _Cycles(ImaginedConfig):
    """Goals are many and differ: more is learned from each body model than of a game."""

    fit_minibatches: ClassVar[int] = 300
    updates: ClassVar[int] = 100
    critic_first_updates: ClassVar[int] = 20


def _settings(config: MotorTrainingConfig) -> ImaginedConfig:
    """Return the settings of the cycles.

    Goals are reached within about 20 user steps, which the discount factor fits. The policy is
    small, and learns fast. Policies above it are not exact, hence the noise on the actions.
    """
    return _Cycles(
        cycles=config.cycles,
        first_play_steps=_FIRST_PLAY_STEPS,
        body_width=_BODY_WIDTH,
        users=_USERS,
        window_steps=_WINDOW_STEPS,
        critic_width=config.width,
        gamma=0.95,
        learning_rate=1.5e-3,
        action_noise=0.06,
        restart_share=0.15,
        actuator_range_cost=0.1,
    )


@dataclass(frozen=True)
class MotorTrainingCycle:
    """Results of one cycle: medians over the simulated bodies in MuJoCo.

    In the first cycle actions are random, so the hands have no goals and the errors are 0.

    Attributes:
        cycle: its number, from 1.
        place_m: distance between tip and goal at the time of arrival.
        speed_mps: difference between actual and desired velocity at that time.
        follow_m: distance of the tips from the paths that they track.
        model_m: body model error: mean distance between predicted and simulated hand positions
            after one user step.
    """

    cycle: int
    place_m: float
    speed_mps: float
    follow_m: float
    model_m: float

    def in_words(self, cycles: int) -> str:
        """Return a line of text on the cycle, with the number of all cycles."""
        if self.cycle == 1:
            return (
                f"Cycle 1/{cycles}: moved at random, to learn what muscles and motors do "
                f"(it predicts hands to {1000 * self.model_m:.0f} mm a step)"
            )
        return (
            f"Cycle {self.cycle}/{cycles}: arrives {1000 * self.place_m:.0f} mm from its goals and "
            f"{self.speed_mps:.2f} m/s from the speeds wanted, follows "
            f"{1000 * self.follow_m:.0f} mm beside its paths (medians)"
        )


class GoalTask(Task):
    """Training task in which hands reach goals at given times.

    Args:
        noise: motor noise of the muscles, imagined and simulated; None: no noise.
        begin: a motor policy of this body to continue from, of the same width; None: a new one.
            The body model is fitted from scratch.
    """

    policy: MotorPolicy
    recent_per_early, random_size = 3, (0.05, 0.7)

    def __init__(
        self,
        config: MotorTrainingConfig,
        body: Body,
        step_s: float,
        *,
        noise: MotorNoiseSettings | None,
        threads: int,
        seed: int,
        begin: MotorPolicy | None,
    ) -> None:
        self.starts = 8 if begin is None else 0
        self._user = body
        substeps = round(step_s / body.timestep)
        self.batch = UserBatch(
            body, config.bodies, threads=threads, effort="zero", noise=noise, substeps=substeps
        )
        self.rng = np.random.default_rng([seed, 31])
        self.policy = MotorPolicy(body, step_s, width=config.width)
        self.actor = list(self.policy.net.parameters())
        self.body = BodyModel(body, self.policy.hands, step_s, width=_BODY_WIDTH)
        muscles = self.policy.drives.muscle_columns

        def effort(after: Tensor, control: Tensor) -> Tensor:
            if not len(muscles):
                return torch.zeros(len(after))
            return _EFFORT * after[:, muscles].square().mean(1)

        self.users = ImaginedUsers(
            body,
            self.body,
            _USERS,
            effort=effort,
            noise=noise,
            actuator_range_cost=_settings(config).actuator_range_cost,
        )
        poses, strikes = reachable_poses(self.policy, seed), config.strikes
        self.goals = GoalSampler(poses, _USERS, step_s, seed + 5, strikes=strikes)
        self._played = GoalSampler(poses, config.bodies, step_s, seed + 6, strikes=strikes)
        """Goals of the simulated bodies."""
        self.parts = (self.goals,)
        self._observed: Tensor | None = None
        self._age = np.zeros(config.bodies, dtype=np.int64)
        self._random = False

    # --- simulated bodies --------------------------------------------------------------------

    def begin_collecting(self, *, randomly: bool) -> None:
        self._random = randomly
        self._played.clear()
        self.restart(np.arange(self.batch.n))

    @property
    def _longest(self) -> int:
        """User steps of an episode."""
        return _RANDOM_EPISODE_STEPS if self._random else _EPISODE_STEPS

    def stagger(self) -> None:
        self._age[:] = self.rng.integers(0, self._longest, self.batch.n)

    def motion(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return angles, speeds and drives, as float32."""
        angles, speeds, drives = self.policy.motion(self.batch)
        return angles.numpy(), speeds.numpy(), drives.numpy()

    def policy_actions(self) -> NDArray[Any]:
        return self.policy.act(self.batch, self._played.goals)

    def simulate(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[Any], NDArray[Any]]:
        self.batch.step(np.clip(actions, -1.0, 1.0))
        if not self._random:
            with torch.no_grad():
                self._played.step(*self.policy.places(*self.policy.motion(self.batch)[:2]))
        self._age += 1
        diverged, none = self.batch.diverged, np.zeros((self.batch.n, 0))
        return ~diverged, (self._age >= self._longest) | diverged, none, none

    def restart(self, ids: NDArray[np.int64]) -> None:
        """Start new episodes, each in a random posture."""
        low, high = self._user.joint_ranges.T
        middle, half = 0.5 * (low + high), 0.5 * INSIDE * (high - low)
        postures = middle + half * self.rng.uniform(-1.0, 1.0, (len(ids), len(low)))
        seeds = self.rng.integers(2**31, size=len(ids))
        self.batch.reset(ids, [np.random.default_rng(s) for s in seeds], list(postures))
        self._age[ids] = 0
        rows = torch.from_numpy(ids)
        with torch.no_grad():
            angles, speeds, _ = self.policy.motion(self.batch)
            self._played.start(rows, self.policy.places(angles[rows], speeds[rows])[0])

    # --- a cycle -----------------------------------------------------------------------------

    def report(
        self, cycle: int, updates: int, success_rates: tuple[float, ...], place_error_m: float
    ) -> MotorTrainingCycle:
        return MotorTrainingCycle(cycle, **self._played.measured(), model_m=place_error_m)

    # --- imagined users ----------------------------------------------------------------------

    def start(self, ids: Tensor, pool: TransitionStore, rows: Tensor) -> None:
        begin = pool.rows(rows)
        self.users.start(ids, begin.after)
        with torch.no_grad():
            place, _ = self.policy.places(begin.after.angles, begin.after.speeds)
        self.goals.start(ids, place)
        self._observed = None

    def _places(self) -> tuple[Tensor, Tensor]:
        motion = self.users.motion
        return self.policy.places(motion.angles, motion.speeds)

    def observe(self) -> Tensor:
        """Return what the policy observes, computed once per user step."""
        if self._observed is None:
            motion = self.users.motion
            goals = self.goals.observe(*self._places())
            self._observed = self.policy.observe(motion.angles, motion.speeds, motion.drives, goals)
        return self._observed

    present = observe

    def normalise(self, observations: Tensor) -> None:
        self.policy.mean.copy_(observations.mean(0))
        self.policy.std.copy_(observations.std(0).clamp(min=0.05))

    def action_mean(self, observation: Tensor) -> Tensor:
        mean: Tensor = self.policy(observation)
        return mean

    def step(self, actions: Tensor, done: float) -> Tensor:
        self._observed = None
        return self.goals.step(*self._places())

    def cut(self) -> None:
        self._observed = None

    # --- exact resume ------------------------------------------------------------------------

    _state = ("goals", "_played")

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state; the simulated bodies start every cycle in new states."""
        super().load_state_dict(state)
        self._observed = None


MotorTrainer = ModelBasedTrainer[GoalTask]


def motor_trainer(
    config: MotorTrainingConfig,
    body: Body,
    step_s: float,
    *,
    noise: MotorNoiseSettings | None = None,
    threads: int = 0,
    seed: int = 1,
    begin: MotorPolicy | None = None,
) -> MotorTrainer:
    """Return the training of a body's motor policy; see :class:`GoalTask`."""
    settings = _settings(config)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        task = GoalTask(config, body, step_s, noise=noise, threads=threads, seed=seed, begin=begin)
        policy = task.policy
        critic = value_function(policy.size, config.width, policy.normalised, settings.gamma)
        if begin is not None:
            policy.take(begin.weights())
        return ModelBasedTrainer(task, settings, critic)


def needs_motor_policy(config: TrainingConfig, env: ResolvedEnv) -> bool:
    """Return whether a run has to train its motor layer first."""
    if config.skills.motor is not None or config.skills.people:
        return False
    try:
        motor_layer_for(env.body, 1.0 / config.env.action_frequency_hz)
    except InputError:
        return True
    return False


class MotorStage(CycleStage):
    """The training of a motor policy."""

    name = "motor"
    title = "hands learn to reach their goals (no motor policy ships for this body)."
    result, state_of = "layer.pt", MOTOR_STATE

    def __init__(self, config: TrainingConfig, folder: Path, env: ResolvedEnv) -> None:
        super().__init__(config, folder, config.skills.motor_training.cycles)
        self._env = env

    @property
    def layer_file(self) -> Path:
        """File of the motor policy; it exists once the stage is finished."""
        return self.folder / self.result

    def open(self) -> None:
        """Make the trainer."""
        config = self._config
        env = config.env
        self._learner = motor_trainer(
            config.skills.motor_training,
            self._env.body,
            1.0 / env.action_frequency_hz,
            noise=motor_noise(env.user.noise),
            threads=budget(env.cores),
            seed=config.seed,
        )

    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        save_motor_layer(file, trainer.task.policy, **({} if report is None else asdict(report)))
