"""Playing rounds in parallel, each as if it were alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.notices import notice_once
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.client import Condition, GameFacts, OptionValue
from sim2vr_harness.envs.protocols import SimulationLike
from sim2vr_harness.evaluation.exertion import ExertionRecorder
from sim2vr_harness.evaluation.metrics import RoundResult, round_result
from sim2vr_harness.evaluation.muscle_groups import groups_of, worst_of
from sim2vr_harness.policies.protocol import Act, FunctionPolicy, Policy


@dataclass(frozen=True)
class Job:
    """A round to play.

    Attributes:
        condition: The game's condition.
        episode: Number within the condition, from 0.
        seed: Seed of body, game and policy.
        options: The condition's options of the game.
        person: Number of the person who plays it; None: drawn by the seed, if users differ.
    """

    condition: str
    episode: int
    seed: int
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    person: int | None = None


class Watcher(Protocol):
    """Looks on while rounds are played, for example to film them."""

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Rounds begin; the job at index i is played by user i."""

    def stepped(self, reward: NDArray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Everyone has taken a step; after :meth:`ended` a user's steps are of no interest."""

    def ended(self, index: int, result: RoundResult) -> None:
        """User ``index`` has finished the job."""


def jobs_for(
    conditions: Sequence[Condition], episodes: int, seed: int, people: int | None = None
) -> list[Job]:
    """Return ``episodes`` rounds per condition; round k has seed ``seed + k`` in each of them.

    Args:
        conditions: To be played.
        episodes: Rounds per condition, and per person.
        seed: Of the first round.
        people: How many persons play them, one after the other; None: drawn by the seeds.
    """
    players = [None] if people is None else range(people)
    rounds = [person for person in players for _ in range(episodes)]
    return [
        Job(condition.name, k, seed + k, condition.options, person)
        for condition in conditions
        for k, person in enumerate(rounds)
    ]


def play(
    make_simulation: Callable[[int], SimulationLike],
    make_policy: Callable[[SimulationLike], Policy | Act],
    jobs: Sequence[Job],
    facts: GameFacts,
    *,
    deterministic: bool,
    batch: int = 10,
    watchers: Sequence[Watcher] = (),
    on_progress: Callable[[float], None] = lambda share: None,
) -> list[RoundResult]:
    """Play rounds; the results do not depend on ``batch``.

    Args:
        make_simulation: Number of users -> a new simulation of them.
        make_policy: Simulation -> the policy, or a function of observation and random numbers.
        jobs: The rounds.
        facts: What the game publishes.
        deterministic: Whether actions are the policy's mean instead of samples.
        batch: How many rounds are played in parallel at most.
        watchers: Look on.
        on_progress: Called with the share of the work done, from 0 to 1.

    Returns:
        One result per job, in their order.
    """
    results: list[RoundResult] = []
    simulation: SimulationLike | None = None
    try:
        for start in range(0, len(jobs), batch):
            wave = jobs[start : start + batch]
            if simulation is None or simulation.n != len(wave):
                if simulation is not None:
                    simulation.close()
                simulation = make_simulation(len(wave))
                policy = make_policy(simulation)

            def advance(share: float, first: int = start, size: int = len(wave)) -> None:
                on_progress((first + share * size) / len(jobs))

            with torch_threads(1):
                wave_play = _Wave(simulation, policy, wave, facts, deterministic, watchers)
                results += wave_play.run(advance)
    finally:
        if simulation is not None:
            simulation.close()
    return results


class _Wave:
    """Rounds that start together."""

    def __init__(
        self,
        simulation: SimulationLike,
        policy: Policy | Act,
        jobs: Sequence[Job],
        facts: GameFacts,
        deterministic: bool,
        watchers: Sequence[Watcher],
    ) -> None:
        self._simulation, self._jobs = simulation, jobs
        self._policy = policy if isinstance(policy, Policy) else FunctionPolicy(policy)
        self._memory = self._policy.begin(len(jobs))
        self._facts, self._watchers = facts, watchers
        self._fatigue = groups_of(simulation)
        self._rngs: list[np.random.Generator | None] = [
            None if deterministic else np.random.default_rng([job.seed, 1]) for job in jobs
        ]
        self._game_seeds: list[int | None] = []
        self._persons: list[Mapping[str, Any] | None] = []
        for i, job in enumerate(jobs):
            who = {} if job.person is None else {"persons": [job.person]}
            (started,) = simulation.reset(
                ids=[i], seeds=[job.seed], options=dict(job.options), **who
            )
            self._game_seeds.append(started.get("seed"))
            self._persons.append(started.get("person"))
        self._exertion = ExertionRecorder(simulation)
        self._steps = 0
        self._game_returns = np.zeros(len(jobs))
        self._efforts = np.zeros(len(jobs))
        self._changes = np.zeros(len(jobs))
        self._before: NDArray[np.float32] | None = None
        self._logs: list[Mapping[str, float]] = [{} for _ in jobs]
        self._results: list[RoundResult | None] = [None for _ in jobs]

    def run(self, on_progress: Callable[[float], None]) -> list[RoundResult]:
        for watcher in self._watchers:
            watcher.started(self._simulation, self._jobs)
        while any(result is None for result in self._results):
            observation = self._simulation.observation()
            actions = self._policy.act(observation, self._memory, self._rngs)
            # Who is done rests until the others are.
            over = np.array([result is not None for result in self._results])
            self._step(np.where(over[:, None], np.float32(0.0), actions))
            on_progress(self._share(observation))
        return [result for result in self._results if result is not None]

    def _step(self, actions: NDArray[np.float32]) -> None:
        outcome = self._simulation.step(actions)
        self._steps += 1
        playing = np.array([result is None for result in self._results])
        self._exertion.step(playing)
        if self._before is not None:
            self._changes += playing * np.abs(actions - self._before).mean(axis=1)
        self._before = actions
        over = outcome.over
        for i, info in enumerate(outcome.infos):
            if self._results[i] is None:
                self._game_returns[i] += info["game_reward"]
                self._efforts[i] += info["effort_cost"]
                self._logs[i] = info.get("log", self._logs[i])
        for watcher in self._watchers:
            watcher.stepped(outcome.reward, outcome.infos)
        ended = [int(i) for i in np.flatnonzero(over)]
        for i in ended:
            self._finish(i, outcome.infos[i])
        if ended and any(result is None for result in self._results):
            # The others play on, and a simulation steps all of its users or none.
            self._simulation.reset(ids=ended, seeds=[0] * len(ended))

    def _finish(self, i: int, info: Mapping[str, Any]) -> None:
        if self._results[i] is None:
            job = self._jobs[i]
            result = round_result(
                self._facts,
                condition=job.condition,
                episode=job.episode,
                seed=job.seed,
                steps=self._steps,
                game_return=float(self._game_returns[i]),
                effort=float(self._efforts[i]),
                game_seed=self._game_seeds[i],
                person=self._persons[i],
                exertion=self._exertion.values(i),
                action_change=float(self._changes[i] / (self._steps - 1))
                if self._steps > 1
                else None,
                info=info,
                log=self._logs[i],
                **self._fatigued(i),
            )
            self._results[i] = result
            if words := info.get("app_error") or info.get("app_left"):
                notice_once(f"{job.condition}, round {job.episode}: {words}")
            for watcher in self._watchers:
                watcher.ended(i, result)

    def _fatigued(self, i: int) -> dict[str, Any]:
        """Return the arguments of :func:`round_result` about the fatigue of user ``i``."""
        if self._fatigue is None:
            return {}
        worst = worst_of(self._simulation, i)
        parts = self._fatigue.part_names
        return {"fatigue": self._fatigue.values(worst), "fatigue_parts": parts}

    def _share(self, observation: dict[str, NDArray]) -> float:
        feature = observation.get("stateful_information", np.zeros((len(self._jobs), 1)))
        shares = [
            1.0 if result is not None else float(feature[i, 0] + 1.0) / 2.0
            for i, result in enumerate(self._results)
        ]
        return float(np.mean(shares))
