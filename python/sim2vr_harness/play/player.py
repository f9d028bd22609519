"""The loop that plays rounds: each as if it were alone, several in parallel."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.notices import notice_once
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.client import Condition, GameFacts, OptionValue
from sim2vr_harness.play.round import Round, round_result
from sim2vr_harness.policies.protocol import Act, FunctionPolicy, Policy


@dataclass(frozen=True)
class Job:
    """A round to play.

    Attributes:
        condition: The game's condition.
        episode: Number within the condition, from 0.
        seed: Seed of body, game and policy.
        options: The condition's options of the game.
        person: Number of the participant who plays it; None: drawn by the seed, if users differ.
    """

    condition: str
    episode: int
    seed: int
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    person: int | None = None


class Watcher:
    """Looks on while rounds are played, for example to film or to measure them."""

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Rounds begin; user i plays the job at index i."""

    def stepped(self, reward: NDArray[Any], infos: Sequence[Mapping[str, Any]]) -> None:
        """All users have taken a step; those whose rounds have ended rest."""

    def measured(self, index: int, result: Round) -> Round:
        """Return the round that user ``index`` has finished with what this watcher measured."""
        return result

    def ended(self, index: int, result: Round) -> None:
        """User ``index`` has finished the round; all watchers have measured it."""


def jobs_for(
    conditions: Sequence[Condition], episodes: int, seed: int, people: int | None = None
) -> list[Job]:
    """Return ``episodes`` rounds per condition; round k has seed ``seed + k`` in each of them.

    Args:
        conditions: To be played.
        episodes: Rounds per condition, and per participant.
        seed: Of the first round.
        people: How many participants play them, one after the other; None: drawn by the seeds.
    """
    players = [None] if people is None else range(people)
    rounds = [person for person in players for _ in range(episodes)]
    return [
        Job(condition.name, k, seed + k, condition.options, person)
        for condition in conditions
        for k, person in enumerate(rounds)
    ]


class Player:
    """Lets the users of a simulation play a round each.

    Args:
        simulation: N users.
        policy: Acts for them, and looks on if it is a watcher; or a function of one user's
            observation and random numbers.

    Attributes:
        rounds: N, None for those that are not over.
        actions: (N, A) of the last step.
        logs: N, the game's named numbers, as last reported.
        game_returns: (N,) sums of the game's rewards so far.
        efforts: (N,) sums of the costs of effort so far.
        step_count: User steps so far.
    """

    def __init__(
        self,
        simulation: Any,
        policy: Policy | Act,
        facts: GameFacts,
        *,
        deterministic: bool = False,
        watchers: Sequence[Watcher] = (),
    ) -> None:
        self.simulation, self._facts = simulation, facts
        self._policy = policy if isinstance(policy, Policy) else FunctionPolicy(policy)
        own: Any = policy
        self._watchers: list[Watcher] = [*([own] if isinstance(own, Watcher) else []), *watchers]
        self._deterministic = deterministic

    @property
    def seconds(self) -> float:
        """Game time since the rounds began."""
        return self.step_count / float(self.simulation.config.action_frequency_hz)

    @property
    def returns(self) -> NDArray[np.float64]:
        """(N,) the games' rewards minus the costs of effort so far."""
        return self.game_returns - self.efforts

    def play(
        self, jobs: Sequence[Job], on_progress: Callable[[float], None] = lambda share: None
    ) -> list[Round]:
        """Play N rounds to their ends.

        Args:
            jobs: N.
        """
        with torch_threads(1):
            self.begin(jobs)
            for _ in self.steps():
                # Of a round the share of its time that has passed, which the user senses.
                none = np.zeros((len(jobs), 1))
                passed = self._observation.get("stateful_information", none)[:, 0]
                over = [result is not None for result in self.rounds]
                on_progress(float(np.where(over, 1.0, (passed + 1.0) / 2.0).mean()))
        return [result for result in self.rounds if result is not None]

    def begin(self, jobs: Sequence[Job], *, endless: bool = False) -> None:
        """Begin N rounds.

        Args:
            jobs: N.
            endless: Whether users whose rounds are over begin others, and sums go on.
        """
        n = len(jobs)
        self._jobs, self._endless, self.step_count = jobs, endless, 0
        self._rngs: list[np.random.Generator | None] = [
            None if self._deterministic else np.random.default_rng([job.seed, 1]) for job in jobs
        ]
        self._started = []
        for i, job in enumerate(jobs):
            who = {} if job.person is None else {"persons": [job.person]}
            self._started += self.simulation.reset(
                ids=[i], seeds=[job.seed], options=dict(job.options), **who
            )
        self._memory = self._policy.begin(n)
        self.actions = np.zeros((n, *self.simulation.action_space.shape), np.float32)
        self.game_returns, self.efforts, self._changes = np.zeros((3, n))
        self.logs: list[Mapping[str, float]] = [{} for _ in jobs]
        self.rounds: list[Round | None] = [None for _ in jobs]
        for watcher in self._watchers:
            watcher.started(self.simulation, jobs)

    def steps(self) -> Iterator[Any]:
        """Play the rounds that were begun, and yield the ``StepBatch`` of every user step."""
        while playing := [i for i, result in enumerate(self.rounds) if result is None]:
            self._observation = self.simulation.observation()
            acted = self._policy.act(self._observation, self._memory, self._rngs)
            actions = np.array(acted, np.float32)
            resting = [i for i, result in enumerate(self.rounds) if result is not None]
            actions[resting] = 0.0
            outcome = self.simulation.step(actions, resting)
            if self.step_count:
                self._changes[playing] += np.abs(actions - self.actions).mean(axis=1)[playing]
            self.step_count, self.actions = self.step_count + 1, actions
            for i in playing:
                info = outcome.infos[i]
                self.game_returns[i] += info["game_reward"]
                self.efforts[i] += info["effort_cost"]
                self.logs[i] = info.get("log", self.logs[i])
            for watcher in self._watchers:
                watcher.stepped(outcome.reward, outcome.infos)
            if self._endless:
                self._policy.restart(self._memory, self.simulation.renew(outcome))
            else:
                for i in np.flatnonzero(outcome.over[playing]).tolist():
                    self._finish(playing[i], outcome.infos[playing[i]])
            yield outcome

    def _finish(self, i: int, info: Mapping[str, Any]) -> None:
        job, steps = self._jobs[i], self.step_count
        result = round_result(
            self._facts,
            condition=job.condition,
            episode=job.episode,
            seed=job.seed,
            steps=steps,
            game_return=float(self.game_returns[i]),
            effort=float(self.efforts[i]),
            game_seed=self._started[i].get("seed"),
            person=self._started[i].get("person"),
            action_change=float(self._changes[i] / (steps - 1)) if steps > 1 else None,
            info=info,
            log=self.logs[i],
        )
        for watcher in self._watchers:
            result = watcher.measured(i, result)
        self.rounds[i] = result
        if words := info.get("app_error") or info.get("app_left"):
            # A snapshot's round has no condition.
            which = f"{job.condition}, round {job.episode}: " if job.condition else ""
            notice_once(f"{which}{words}")
        for watcher in self._watchers:
            watcher.ended(i, result)


def reward_per_minute(
    simulation: Any,
    policy: Policy,
    seeds: Sequence[int],
    steps: int,
    *,
    deterministic: bool,
    on_step: Callable[[Any], None] = lambda outcome: None,
) -> tuple[float, float]:
    """Let all users play for some time, one round after the other.

    Args:
        simulation: Of N users; it is reset.
        policy: Acts for them.
        seeds: N, of the first rounds.
        steps: User steps to play, of each user.
        on_step: Called with the outcome of each step of the simulation.

    Returns:
        Mean reward of the app and mean cost of effort, both per minute.
    """
    player = Player(simulation, policy, GameFacts(""), deterministic=deterministic)
    player.begin([Job("", k, seed) for k, seed in enumerate(seeds)], endless=True)
    for _, outcome in zip(range(steps), player.steps(), strict=False):
        on_step(outcome)
    per_minute = 60.0 * simulation.config.action_frequency_hz / steps
    return float(player.game_returns.mean()) * per_minute, float(player.efforts.mean()) * per_minute


def play(
    make_simulation: Callable[[int], Any],
    make_policy: Callable[[Any], Policy | Act],
    jobs: Sequence[Job],
    facts: GameFacts,
    *,
    deterministic: bool,
    batch: int = 10,
    watchers: Sequence[Watcher] = (),
    on_progress: Callable[[float], None] = lambda share: None,
) -> list[Round]:
    """Play rounds in as many waves as it takes; the results do not depend on ``batch``.

    Args:
        make_simulation: Number of users -> a new simulation of them.
        make_policy: Simulation -> the policy, or a function of observation and random numbers.
        jobs: The rounds.
        batch: How many rounds are played in parallel at most.

    Returns:
        One round per job, in their order.
    """
    results: list[Round] = []
    player: Player | None = None
    # Waves of one size go on in the same apps.
    waves = -(-len(jobs) // batch)
    batch = -(-len(jobs) // max(1, waves))
    try:
        for start in range(0, len(jobs), batch):
            wave = jobs[start : start + batch]
            if player is None or player.simulation.n != len(wave):
                if player is not None:
                    player.simulation.close()
                    player = None
                simulation = make_simulation(len(wave))
                try:
                    policy = make_policy(simulation)
                except BaseException:
                    simulation.close()
                    raise
                player = Player(
                    simulation, policy, facts, deterministic=deterministic, watchers=watchers
                )

            def advance(share: float, first: int = start, size: int = len(wave)) -> None:
                on_progress((first + share * size) / len(jobs))

            results += player.play(wave, advance)
    finally:
        if player is not None:
            player.simulation.close()
    return results
