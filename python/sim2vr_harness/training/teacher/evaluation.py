"""How well a teacher plays: whole rounds by the true rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.state_actor_critic import TeacherPolicy
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher.env import blind_env, game_of, privileged_senses

__all__ = ["TeacherScore", "describe", "evaluate_teacher"]


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
    """Play whole rounds, all side by side, without the curriculum.

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
    simulation = Simulation(blind_env(env), len(jobs))
    try:
        senses = privileged_senses(simulation, config, game, env)
        for i, (name, round_seed) in enumerate(jobs):
            simulation.reset([i], [round_seed], game.options(name))
        rng = None if deterministic else np.random.default_rng(seed)
        logs: list[dict[str, float] | None] = [None] * len(jobs)
        effort, returns = np.zeros(len(jobs)), np.zeros(len(jobs))
        steps = np.zeros(len(jobs))
        while any(log is None for log in logs):
            on_progress(sum(log is not None for log in logs), len(logs))
            decided = policy.act({OBSERVATION: senses.observe()}, rng)
            result = simulation.step(decided)
            ended = np.flatnonzero(result.over)
            playing = np.array([log is None for log in logs])
            effort += playing * result.effort_cost
            returns += playing * result.game_reward
            steps += playing
            for i in map(int, ended):
                if logs[i] is None:
                    logs[i] = dict(result.logs[i])
            if len(ended) and any(log is None for log in logs):
                simulation.reset([int(i) for i in ended])
    finally:
        simulation.close()
    return [
        _score(
            name,
            [
                game.outcomes(log or {})
                for log, job in zip(logs, jobs, strict=True)
                if job[0] == name
            ],
            float(np.sum(effort[_of(jobs, name)]) / np.sum(steps[_of(jobs, name)])),
            float(np.mean(returns[_of(jobs, name)])),
        )
        for name in names
    ]


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
