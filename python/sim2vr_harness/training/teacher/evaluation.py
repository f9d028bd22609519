"""Evaluation of a teacher: whole rounds in the true game."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.state_actor_critic import TeacherPolicy
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher.env import blind_env, game_of, privileged_senses


@dataclass(frozen=True)
class TeacherScore:
    """Pooled over the rounds of one condition.

    Attributes:
        condition: of the game.
        rounds: how many.
        successes: mean per round.
        success_rate: successes / (successes + failures), pooled.
        cell_rates: (cells,) the same per cell; NaN where nothing came up.
        effort: mean cost of effort per user step.
        game_return: mean of the rounds' sums of the game's reward.
    """

    condition: str
    rounds: int
    successes: float
    success_rate: float
    cell_rates: tuple[float, ...]
    effort: float
    game_return: float

    @property
    def worst_cell(self) -> float:
        """The lowest of the cells' rates."""
        return float(np.nanmin(self.cell_rates))


def evaluate_teacher(
    policy: TeacherPolicy,
    env: EnvConfig,
    config: TeacherConfig,
    *,
    rounds: int,
    seed: int = 1,
    deterministic: bool = False,
    conditions: Sequence[str] | None = None,
    on_progress: Callable[[int, int], None] = lambda ended, rounds: None,
) -> list[TeacherScore]:
    """Play whole rounds, all in one batch, without the curriculum.

    Args:
        policy: the teacher's.
        env: the true environment.
        config: of the teacher.
        rounds: per condition; round k has seed ``seed + k``.
        seed: of the first round.
        deterministic: whether actions are means instead of samples.
        conditions: of the game; None takes the teacher's.
        on_progress: called at every user step with how many of how many rounds have ended.
    """
    game = game_of(env)
    names = list(conditions or config.conditions or game.conditions)
    jobs = [(name, seed + k) for name in names for k in range(rounds)]
    rng = None if deterministic else np.random.default_rng(seed)
    with closing(Simulation(blind_env(env), len(jobs))) as simulation:
        senses = privileged_senses(simulation, config, game, env)
        for i, (name, round_seed) in enumerate(jobs):
            simulation.reset([i], [round_seed], game.options(name))
        played = _played(
            simulation, lambda: policy.act({OBSERVATION: senses.observe()}, rng), on_progress
        )
    return [
        _score(
            name,
            [game.outcomes(played.logs[i]) for i in _of(jobs, name)],
            float(np.sum(played.effort[_of(jobs, name)]) / np.sum(played.steps[_of(jobs, name)])),
            float(np.mean(played.returns[_of(jobs, name)])),
        )
        for name in names
    ]


@dataclass(frozen=True)
class _Rounds:
    """A round of each of N users: last logs, and (N,) sums of effort cost, reward and steps."""

    logs: dict[int, dict[str, float]]
    effort: NDArray[np.float64]
    returns: NDArray[np.float64]
    steps: NDArray[np.float64]


def _played(
    simulation: Simulation,
    act: Callable[[], NDArray[np.float32]],
    on_progress: Callable[[int, int], None],
) -> _Rounds:
    """Play until every user's round is over; those who are done play on without being counted."""
    n = simulation.n
    found = _Rounds({}, np.zeros(n), np.zeros(n), np.zeros(n))
    while len(found.logs) < n:
        on_progress(len(found.logs), n)
        result = simulation.step(act())
        playing = np.array([i not in found.logs for i in range(n)])
        for total, now in (
            (found.effort, result.effort_cost),
            (found.returns, result.game_reward),
            (found.steps, 1.0),
        ):
            total += playing * now
        ended = np.flatnonzero(result.over).tolist()
        found.logs.update({i: dict(result.logs[i]) for i in ended if i not in found.logs})
        if ended and len(found.logs) < n:
            simulation.reset(ended)
    return found


def _of(jobs: Sequence[tuple[str, int]], name: str) -> list[int]:
    return [i for i, job in enumerate(jobs) if job[0] == name]


def _score(
    name: str, outcomes: Sequence[NDArray[np.float64]], effort: float, game_return: float
) -> TeacherScore:
    succeeded, failed = np.sum(outcomes, axis=0)
    shown = succeeded + failed
    rates = np.where(shown > 0.0, succeeded / np.maximum(shown, 1.0), np.nan)
    return TeacherScore(
        condition=name,
        rounds=len(outcomes),
        successes=float(succeeded.sum()) / len(outcomes),
        success_rate=float(succeeded.sum() / max(1.0, shown.sum())),
        cell_rates=tuple(map(float, rates)),
        effort=effort,
        game_return=game_return,
    )


def describe(scores: Sequence[TeacherScore]) -> str:
    """One line for people: success rate of every condition, and its worst cell's."""
    return "; ".join(
        f"{score.condition} {score.success_rate:.3f} ({score.successes:.0f} per round, "
        f"worst cell {int(np.nanargmin(score.cell_rates))} {score.worst_cell:.2f})"
        for score in scores
    )
