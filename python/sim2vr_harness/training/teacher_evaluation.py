"""How well a teacher plays: whole rounds by the true rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher_env import OBSERVATION, PrivilegedSenses, blind_env
from sim2vr_harness.training.teacher_policy import TeacherPolicy

__all__ = ["TeacherScore", "evaluate_teacher"]

_CELLS = 9


@dataclass(frozen=True)
class TeacherScore:
    """Pooled over the rounds of one condition.

    Attributes:
        condition: of the game.
        rounds: how many.
        hits: mean per round.
        hit_rate: hits / (hits + misses), pooled.
        cell_rates: (9,) the same per cell; NaN where nothing came up.
        hit_speed_mps: mean at the hits.
        effort: mean cost of effort per user step.
        game_return: mean of the rounds' sums of the game's reward.
    """

    condition: str
    rounds: int
    hits: float
    hit_rate: float
    cell_rates: tuple[float, ...]
    hit_speed_mps: float
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
) -> list[TeacherScore]:
    """Play whole rounds, all side by side; uniform spawns, no aids, true physics.

    Args:
        policy: the teacher's.
        env: the true environment.
        config: of the teacher.
        rounds: per condition; round k has seed ``seed + k``.
        seed: of the first round.
        deterministic: whether actions are means instead of samples.
        conditions: of the game; None takes the teacher's.
    """
    names = list(conditions or config.conditions)
    jobs = [(name, seed + k) for name in names for k in range(rounds)]
    simulation = Simulation(blind_env(env), len(jobs))
    try:
        senses = PrivilegedSenses(simulation, config.hidden_fields)
        for i, (name, round_seed) in enumerate(jobs):
            simulation.reset([i], [round_seed], {"condition": name})
        rng = None if deterministic else np.random.default_rng(seed)
        logs: list[dict[str, float] | None] = [None] * len(jobs)
        effort, returns = np.zeros(len(jobs)), np.zeros(len(jobs))
        steps = np.zeros(len(jobs))
        while any(log is None for log in logs):
            decided = policy.act({OBSERVATION: senses.observe()}, rng)
            result = simulation.step(decided)
            ended = np.flatnonzero(result.terminated | result.truncated)
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
            [log or {} for log, job in zip(logs, jobs, strict=True) if job[0] == name],
            float(np.sum(effort[_of(jobs, name)]) / np.sum(steps[_of(jobs, name)])),
            float(np.mean(returns[_of(jobs, name)])),
        )
        for name in names
    ]


def _of(jobs: Sequence[tuple[str, int]], name: str) -> list[int]:
    return [i for i, job in enumerate(jobs) if job[0] == name]


def _score(
    name: str, logs: Sequence[dict[str, Any]], effort: float, game_return: float
) -> TeacherScore:
    def total(key: str) -> float:
        return float(sum(log.get(key, 0.0) for log in logs))

    hits, misses = total("Points"), total("Misses")
    cells = []
    for cell in range(_CELLS):
        hit, missed = total(f"hitsTarget{cell}"), total(f"missesTarget{cell}")
        cells.append(hit / (hit + missed) if hit + missed else float("nan"))
    return TeacherScore(
        condition=name,
        rounds=len(logs),
        hits=hits / len(logs),
        hit_rate=hits / max(1.0, hits + misses),
        cell_rates=tuple(cells),
        hit_speed_mps=total("HitSpeedSum") / max(1.0, hits),
        effort=effort,
        game_return=game_return,
    )
