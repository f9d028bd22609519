"""Stages of model-based trainings: cycle after cycle, saved after each."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.utils import get_device
from torch import Tensor

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.progress import View
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.policies.teacher import TeacherPolicy, new_teacher
from sim2vr_harness.runs.checkpoint import write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer, Task, value_function
from sim2vr_harness.training.run.stage import Callbacks, Stage
from sim2vr_harness.training.teacher.env import TeacherSimulation
from sim2vr_harness.world_models.body_dynamics import BodyModel
from sim2vr_harness.world_models.effort import imagined_effort, volume_shares
from sim2vr_harness.world_models.learning_device import LearningDevice
from sim2vr_harness.world_models.observation import ImaginedSenses
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import TransitionStore

_NEAR_M = 0.12
"""Farthest that a near start is from a good start of an action."""
_RANDOM_SECONDS = 1.0
"""Length of an episode of random actions: long enough to leave its start."""


@dataclass(frozen=True)
class CycleReport:
    """Results of one training cycle.

    Attributes:
        cycle: its number, from 1.
        step: user steps simulated in the true game so far.
        updates: of the policy so far.
        played: success rate in the true game, with noise on the actions, by condition; NaN if no
            target appeared, and in the first cycle, in which actions are random.
        imagined: the same in imagined rollouts.
        worst_cell: the lowest success rate of any cell in imagined rollouts.
        place_error_m: body model error: mean distance between predicted and simulated device
            positions after one user step.
    """

    cycle: int
    step: int
    updates: int
    played: tuple[float, ...]
    imagined: tuple[float, ...]
    worst_cell: float
    place_error_m: float

    def in_words(self, cycles: int) -> str:
        """Return a line of text on the cycle, with the number of all cycles."""

        def rates(values: Sequence[float]) -> str:
            return ", ".join("-" if math.isnan(value) else f"{value:.2f}" for value in values)

        known = any(not math.isnan(rate) for rate in self.played)
        played = f", {rates(self.played)} in the app" if known else ""
        return (
            f"Cycle {self.cycle}/{cycles}: success rates {rates(self.imagined)} in imagined "
            f"rollouts (worst cell {self.worst_cell:.2f}){played}; body model error "
            f"{1000.0 * self.place_error_m:.1f} mm in a step"
        )


class GameTask(Task):
    """Training task whose goal is success in a game; see :class:`~.trainer.Task`.

    Args:
        policy: the policy to train; its statistics of observations are set here.
        simulation: users in the true game; their rounds continue from cycle to cycle.
        seed: of all random numbers drawn here, except for the body model's.

    Raises:
        InputError: the policy observes something that the game's model does not compute, or the
            model cannot be used with this user.
    """

    policy: TeacherPolicy
    starts, recent_per_early = 9, 2
    random_size = (0.05, 0.8)

    def __init__(
        self,
        config: ImaginedConfig,
        policy: TeacherPolicy,
        simulation: TeacherSimulation,
        *,
        seed: int,
    ) -> None:
        self.config, self.policy, self.simulation = config, policy, simulation
        self.actor = [*policy.hidden.parameters(), *policy.action_net.parameters()]
        self.batch = simulation.simulation.users
        self.rng = np.random.default_rng([seed, 91])
        self._seed = seed
        self.persons = ImaginedPersons(simulation.resolved)
        self.body = BodyModel(
            simulation.simulation.body,
            simulation.game.devices,
            simulation.step_s,
            width=config.body_width,
            persons=self.persons,
        )
        self._conditions = [simulation.describe(k) for k in range(len(simulation.conditions))]
        self.users, self.game = self.imagine(config.users)
        self.senses = self.imagined_senses(self.users, self.game)
        self.parts = (self.game, self.senses)
        self.warm_up = self.senses.warm_up
        self.success_rates: tuple[float, ...] = ()
        self._near: dict[tuple[int, int], Tensor] = {}
        self._started = self._random = False
        self._outcomes = np.zeros((2, len(simulation.conditions)))
        """Successes and failures of the simulated users since they began to collect."""

    def imagine(self, n: int) -> tuple[ImaginedUsers, Any]:
        """Return N imagined users, and their rounds, an ``ImaginedRounds``."""
        users = self.simulation.simulation.users
        noise = None if users.noise is None else users.noise.settings
        game, config = self.simulation.game, self.config
        try:
            rounds = game.rounds(
                n,
                self._conditions,
                game.settings.model_validate(config.game),
                step_s=self.simulation.step_s,
                frames=self.simulation.config.frames_per_step,
                seed=torch_seed(self._seed) + 3,
                gamma=config.gamma,
            )
        except ValueError as error:
            expected = "a setting that the game model has"
            raise InputError("teacher.imagined", str(error), expected) from error
        shares = volume_shares(users.body) if config.effort_by == "volume" else None
        imagined = ImaginedUsers(
            users.body,
            self.body,
            n,
            effort=imagined_effort(users.effort, self.body.drives, config.effort, shares),
            noise=noise,
            persons=self.persons,
            actuator_range_cost=config.actuator_range_cost,
            activation_cost=config.activation_cost,
            action_rate_cost=config.action_rate_cost,
            movement_cost=config.movement_cost,
        )
        return imagined, rounds

    def imagined_senses(self, users: ImaginedUsers, rounds: Any) -> ImaginedSenses:
        """Return the senses with which a policy observes imagined users, before they start."""
        senses = self.simulation.senses
        try:
            return ImaginedSenses(senses.layout, senses.everything, users, rounds)
        except KeyError as error:
            raise InputError(
                "teacher.hidden_fields",
                f"patterns that leave {error.args[0]!r} to be observed",
                "patterns that also hide it, as the game model does not have it",
            ) from None

    # --- simulated users ---------------------------------------------------------------------

    def begin_collecting(self, *, randomly: bool) -> None:
        sim = self.simulation
        if not self._started:
            seeds = np.random.SeedSequence([self._seed, 93]).generate_state(sim.n, np.uint32)
            sim.reset(seeds=[int(seed) for seed in seeds])
            self._started = True
        self._random = randomly
        sim.explore(_RANDOM_SECONDS if randomly else None)
        self._outcomes[:] = 0.0
        self._count(range(sim.n), -1.0)  # what was before does not count

    def policy_actions(self) -> NDArray[Any]:
        return self.policy.act(self.simulation.observation())

    def simulate(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[Any], NDArray[Any]]:
        """Advance by one user step; steps that end an episode are not learned from."""
        sim = self.simulation
        over = sim.step(actions).over
        columns = [sim.senses.names.index(name) for name in sim.game.fields]
        persons, fields = self.persons.of(sim.simulation), sim.senses.values()[:, columns]
        return ~over & ~self.batch.diverged, over, persons, fields

    def restart(self, ids: NDArray[np.int64]) -> None:
        self._count(ids, 1.0)
        self.simulation.reset(ids.tolist())  # with new logs, which begin with 0

    def end_collecting(self) -> None:
        self._count(range(self.simulation.n), 1.0)
        shown = self._outcomes.sum(0)
        known = (shown > 0.0) & (not self._random)
        rates = np.where(known, self._outcomes[0] / np.maximum(shown, 1.0), np.nan)
        self.success_rates = tuple(map(float, rates))
        self.simulation.explore(None)

    def _count(self, ids: Any, sign: float) -> None:
        """Add the outcomes of users' rounds, as far as they are."""
        sim = self.simulation
        logs = sim.simulation.logs
        for user in map(int, ids):
            outcomes = sim.game.outcomes(logs[user]).sum(axis=1)
            self._outcomes[:, sim.condition_of(user)] += sign * outcomes

    # --- a cycle -----------------------------------------------------------------------------

    def begin_cycle(self, cycle: int) -> None:
        """Set the delays, imagined motor noise and costs of this cycle."""
        config = self.config

        def reached(cycles: int, after: int = 0) -> float:
            since = cycle - after
            if since < 0:
                return 0.0
            return 1.0 if cycles == 0 else min(1.0, since / cycles)

        share = reached(config.delay_ramp_cycles, config.undelayed_cycles)
        self.senses.be_late(share)
        self.simulation.senses.be_late(share)
        self.users.noise_share = reached(config.noise_ramp_cycles)
        self.users.cost_share = reached(config.cost_ramp_cycles)

    def calibrate(self, steps: TransitionStore) -> None:
        self.game.calibrate(self.place(steps), steps.fields)

    def begin_updates(self, pool: TransitionStore) -> None:
        """Find the states near a good start of an action, by condition and cell."""
        condition = self.game.condition_of(pool.fields)
        distance, cell = self.game.nearest(self.place(pool), condition)
        close = distance < _NEAR_M
        self._near = {
            (c, k): torch.nonzero(close & (condition == c) & (cell == k)).flatten().cpu()
            for c in range(len(self._conditions))
            for k in range(self.simulation.game.cells)
        }
        self.game.clear_counts()

    def report(
        self, cycle: int, updates: int, success_rates: tuple[float, ...], place_error_m: float
    ) -> CycleReport:
        counts = self.game.counts
        rates = counts[0] / counts.sum(0).clamp(min=1.0)
        self.game.adapt()
        return CycleReport(
            cycle=cycle,
            step=self.simulation.step_count,
            updates=updates,
            played=success_rates,
            imagined=tuple(float(rate) for rate in rates.mean(1)),
            worst_cell=float(rates.min()),
            place_error_m=place_error_m,
        )

    # --- imagined users ----------------------------------------------------------------------

    def start(self, ids: Tensor, pool: TransitionStore, rows: Tensor) -> None:
        """Start imagined episodes; some of them start near a target."""
        weights = self.game.spawn_weights.cpu()
        with rows.device:
            cells = torch.full((len(ids),), -1)
            near = torch.rand(len(ids)) < self.config.near_starts
            for i in torch.nonzero(near).flatten().tolist():
                c = int(torch.randint(len(self._conditions), ()))
                k = int(torch.multinomial(weights[c], 1))
                there = self._near[c, k]
                if len(there):
                    rows[i], cells[i] = there[int(torch.randint(len(there), ()))], k
        rows, cells = rows.to(ids.device), cells.to(ids.device)
        begin = pool.rows(rows)
        self.users.start(ids, begin.after)
        self.game.start(ids, self.place(begin), begin.fields, cells)
        self.senses.start(ids)

    def observe(self) -> Tensor:
        return self.senses.observe()

    def present(self) -> Tensor:
        return self.senses.present()

    def normalise(self, observations: Tensor) -> None:
        normaliser = self.policy.normaliser
        normaliser.mean.copy_(observations.mean(0))
        spread = self.senses.spread(observations.std(0).clamp(min=0.05))
        normaliser.variance.copy_(spread.square())

    def action_mean(self, observation: Tensor) -> Tensor:
        return self.policy.action_mean({OBSERVATION: observation})

    def step(self, actions: Tensor, done: float) -> Tensor:
        reward: Tensor = self.game.step(self.users.places(self.game.frames), done)
        self.senses.look(actions)
        return reward

    def cut(self) -> None:
        self.game.cut()
        self.senses.cut()

    # --- exact resume ------------------------------------------------------------------------

    _state = ("game", "senses", "simulation")

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, whose tensors are on the device except for the simulation's."""
        super().load_state_dict(state)
        self._started = True


GameTrainer = ModelBasedTrainer[GameTask]


def torch_seed(seed: int) -> int:
    """Return the first of the seeds of torch's random generator in a training."""
    return int(np.random.SeedSequence([seed, 92]).generate_state(1)[0])


def game_trainer(
    config: ImaginedConfig,
    policy: TeacherPolicy,
    simulation: TeacherSimulation,
    *,
    seed: int,
    device: str | torch.device = "cpu",
) -> GameTrainer:
    """Return the training of a policy in a game's model; see :class:`GameTask`."""
    first, learning = torch_seed(seed), LearningDevice(device)
    with learning.seeded(first), learning.active():
        task = GameTask(config, policy, simulation, seed=seed)
        torch.manual_seed(first + 1)
        critic = value_function(
            task.senses.size,
            config.critic_width,
            lambda observation: policy.normaliser({OBSERVATION: observation}),
            config.gamma,
        )
        torch.manual_seed(first + 2)
        return ModelBasedTrainer(task, config, critic, learning)


class CycleStage(Stage):
    """A stage of a model-based training: cycle after cycle, saved after each."""

    unit, log_file = "cycles", "cycles.jsonl"

    _learner: ModelBasedTrainer[Any]

    @property
    def done(self) -> float:
        """Cycles that are over."""
        return self._learner.cycle

    @abstractmethod
    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        """Write the policy; ``report`` is that of the last cycle, None before the first one."""

    def learned(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parts of the state that must be finite."""
        names = {"policy": "task.policy", "body model": "body", "critic": "_critic"}
        return {title: state[name] for title, name in (names | {"optimizer": "_optimizer"}).items()}

    def run(self, callbacks: Callbacks) -> None:
        """Run the remaining cycles."""
        trainer, report = self._learner, None
        self.resume(callbacks)
        callbacks.say(f"Imagined rollouts on {trainer.device}.")
        while not trainer.finished:
            cycle = trainer.cycle

            def show(doing: str, share: float, cycle: int = cycle) -> None:
                callbacks.doing(doing)
                text = f"cycle {cycle + 1} of {self.total:.0f}: {doing}"
                callbacks.show(lambda: View(cycle + share, text))

            report = trainer.step(show)
            self.remember()
            self.save()
            callbacks.say(report.in_words(round(self.total)))
            self.log(callbacks, asdict(report))
        self.write_result(self.folder / self.result, trainer, report)
        self.tidy()


class ImaginedStage(CycleStage):
    """The training of a teacher in a game's model."""

    name = "imagined"
    title = "a teacher learns from imagined rollouts, by gradients through a body model."
    result, state_of = "policy.pt", "the state of these rollouts"

    def __init__(self, config: TrainingConfig, folder: Path) -> None:
        super().__init__(config, folder, config.teacher.imagined.cycles)

    def open(self) -> None:
        """Make the teacher and its simulation."""
        config = self._config
        sim = self._simulation = TeacherSimulation(config.env, config.teacher, config.seed)
        policy = new_teacher(sim.observation_space, sim.action_space, seed=config.seed)
        device = get_device(config.device) if sim.game.on_gpu else "cpu"
        imagined, seed = config.teacher.imagined, config.seed
        self._learner = game_trainer(imagined, policy, sim, seed=seed, device=device)

    def run(self, callbacks: Callbacks) -> None:
        """Report the settings that are easier than the game, and train."""
        imagined = self._config.teacher.imagined
        if imagined.cycles <= imagined.easier_cycles:
            callbacks.say(
                f"All of the {imagined.cycles} cycles are easier than the game: senses as late, "
                f"muscles as noisy and ways as dear as they will be after {imagined.easier_cycles}."
            )
        super().run(callbacks)

    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        write_tensors(file, trainer.task.policy.state_dict())
