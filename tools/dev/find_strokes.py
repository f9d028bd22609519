"""Finds the numbers of the striking script (training/strokes.py) by the cross-entropy method.

    tools/dev/find_strokes.py --generations 40 --out strokes.json

Every generation plays rounds of 20 s with numbers drawn around the best so far, all placements side
by side, physics at 5 ms; the best fifth says where the next ones are drawn. Prints hit rates.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from sim2vr_harness.envs.config import AppConfig, EnvConfig, UserConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training.strokes import Strokes
from sim2vr_harness.training.teacher_actions import TeacherActions
from sim2vr_harness.training.teacher_config import STROKES, ActionsConfig, StrokeConfig
from sim2vr_harness.training.teacher_env import PrivilegedSenses, blind_env

CONDITIONS = {"round.low": "low-medium", "round.mid": "medium", "round.high": "high-medium"}
NAMES = [name for name in StrokeConfig.model_fields if name != "posture_rad"]
POSTURE = len(STROKES["round.mid"].posture_rad)
SPREAD = 0.25
"""First standard deviation, of the numbers themselves; postures: rad."""


def row(config: StrokeConfig) -> np.ndarray:
    """(P,) the numbers of a script, the posture last."""
    return np.array([*(getattr(config, name) for name in NAMES), *config.posture_rad])


def table(numbers: np.ndarray) -> dict[str, object]:
    """The inverse of :func:`row`, ready for JSON."""
    values = [round(float(value), 4) for value in numbers]
    return {**dict(zip(NAMES, values, strict=False)), "posture_rad": values[-POSTURE:]}


class CandidateStrokes(Strokes):
    """A script with other numbers for every user."""

    def take(self, rows: np.ndarray) -> None:
        """rows: (N, P), see :func:`row`."""
        self._tables = {name: rows[:, i] for i, name in enumerate(NAMES)}
        self._postures = rows[:, -POSTURE:]

    def _placements(self) -> np.ndarray:
        return np.eye(len(self._postures))


class Rig:
    """``candidates`` scripts for each placement, ``rounds`` rounds each."""

    def __init__(self, candidates: int, rounds: int, seconds: float, threads: int) -> None:
        self.candidates, self.rounds = candidates, rounds
        self.n = len(CONDITIONS) * candidates * rounds
        app = AppConfig(options={"condition": "random", "round_seconds": seconds})
        env = EnvConfig(app=app, threads=threads, user=UserConfig(timestep_s=0.005))
        self.simulation = Simulation(blind_env(env), self.n)
        self.senses = PrivilegedSenses(self.simulation, ())
        self.strokes = CandidateStrokes(self.senses, STROKES)
        config = ActionsConfig()
        self.actions = TeacherActions(self.simulation, self.senses, config, self.strokes)

    def hit_rates(self, numbers: np.ndarray, seed: int) -> np.ndarray:
        """(placements, candidates); numbers: (placements, candidates, P)."""
        simulation = self.simulation
        self.strokes.take(np.repeat(numbers.reshape(-1, numbers.shape[-1]), self.rounds, axis=0))
        each = self.candidates * self.rounds
        for k, condition in enumerate(CONDITIONS.values()):
            seeds = [seed + i % self.rounds for i in range(each)]
            ids = list(range(k * each, (k + 1) * each))
            simulation.reset(ids, seeds, {"condition": condition})
        uncorrected = np.zeros((self.n, *self.actions.space.shape))
        while True:
            result = simulation.step(self.actions.of_muscles(uncorrected))
            ended = np.flatnonzero(result.terminated | result.truncated)
            if len(ended) == self.n:  # rounds are equally long
                break
            if len(ended):
                simulation.reset(ended.tolist())
        hits, misses = (
            np.array([result.logs[i][name] for i in range(self.n)])
            .reshape(len(CONDITIONS), self.candidates, self.rounds)
            .sum(axis=2)
            for name in ("Points", "Misses")
        )
        rates: np.ndarray = hits / np.maximum(hits + misses, 1.0)
        return rates


def main() -> None:
    """Search, and write the numbers after every generation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--candidates", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("strokes.json"))
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    rig = Rig(options.candidates, options.rounds, 20.0, options.threads)
    mean = np.stack([row(STROKES[flag]) for flag in CONDITIONS])
    spread = SPREAD * np.abs(mean)
    spread[:, -POSTURE:] = 0.12
    least = 0.1 * spread
    for generation in range(options.generations):
        began = time.monotonic()
        noise = rng.standard_normal((len(mean), options.candidates, mean.shape[1]))
        noise[:, 0] = 0.0
        drawn = mean[:, None] + spread[:, None] * noise
        drawn[..., :-POSTURE] = np.maximum(drawn[..., :-POSTURE], 0.0)
        rates = rig.hit_rates(drawn, 1000 + generation * options.rounds)
        best = np.argsort(-rates, axis=1)[:, : max(4, options.candidates // 5)]
        for k in range(len(mean)):
            elite = drawn[k][best[k]]
            mean[k] = 0.6 * elite.mean(axis=0) + 0.4 * mean[k]
            spread[k] = np.maximum(0.6 * elite.std(axis=0) + 0.4 * spread[k], least[k])
        elite_rates = [float(rates[k][best[k]].mean()) for k in range(len(mean))]
        print(
            f"{generation}: all {np.round(rates.mean(axis=1), 3)}, best fifth "
            f"{np.round(elite_rates, 3)} ({time.monotonic() - began:.0f} s)",
            flush=True,
        )
        found = {flag: table(mean[k]) for k, flag in enumerate(CONDITIONS)}
        options.out.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
