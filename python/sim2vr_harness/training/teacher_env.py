"""The teacher's world: users in the true game, with privileged sight and aids that fade."""

from __future__ import annotations

import dataclasses
import fnmatch
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EnvConfig, SenseConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.envs.step_batch import StepBatch
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.start_postures import (
    StartPostures,
    find_start_postures,
    joint_box,
)
from sim2vr_harness.training.teacher_config import TeacherConfig

__all__ = ["OBSERVATION", "PrivilegedSenses", "TeacherSimulation", "blind_env"]

OBSERVATION = "teacher"
_CELLS = 9
_FAIL_RATE_MEMORY = 0.97
_ELBOW = "elbow_flexion"
_EXPLORING_NEAR = 0.9


def blind_env(env: EnvConfig, timestep_s: float | None = None) -> EnvConfig:
    """``env`` without pictures, with another physics step if one is given."""
    app = env.app.model_copy(update={"renderer": "null"})
    # The least that an app draws; its shape decides what the headset could see.
    scale = max(1, min(env.vision.width, env.vision.height) // 8)
    vision = env.vision.model_copy(
        update={
            "width": max(8, env.vision.width // scale),
            "height": max(8, env.vision.height // scale),
            "channels": ("depth",),
            "eyes": 1,
        }
    )
    # Its own body, undelayed and clear; the actions stay those of the student.
    senses = (SenseConfig(sense="proprioception"),)
    user = env.user.model_copy(update={"timestep_s": timestep_s}) if timestep_s else env.user
    return env.model_copy(update={"app": app, "vision": vision, "senses": senses, "user": user})


class PrivilegedSenses:
    """What a teacher observes: the own body, and the game's privileged numbers.

    Args:
        simulation: users whose apps run in this process.
        hidden: patterns of names that are left out.

    Raises:
        InputError: the game publishes none.
    """

    def __init__(self, simulation: Simulation, hidden: Sequence[str]) -> None:
        self._simulation = simulation
        self._batch: Any = getattr(simulation.apps[0], "batch", None)
        self.names: tuple[str, ...] = () if self._batch is None else self._batch.privileged_names
        if not self.names:
            app = simulation.config.app
            raise InputError(
                "recipe",
                f"'distill' for the game {app.game!r} ({app.transport})",
                "a game in this process that publishes privileged numbers, or recipe: ppo",
            )
        self._body = _shown(simulation.proprioception.names, hidden)
        self._columns = _shown(self.names, hidden)
        self.size = len(self._body) + len(self._columns)

    @property
    def space(self) -> spaces.Dict:
        """``{"teacher": (size,) float32}``."""
        limit = np.finfo(np.float32).max
        return spaces.Dict({OBSERVATION: spaces.Box(-limit, limit, (self.size,), np.float32)})

    @property
    def observed_names(self) -> tuple[str, ...]:
        """A name for every entry of an observation."""
        body = self._simulation.proprioception.names
        return (*(body[i] for i in self._body), *(self.names[i] for i in self._columns))

    def values(self) -> NDArray[np.float32]:
        """(N, F) all present privileged numbers, a copy."""
        values: NDArray[np.float32] = self._batch.privileged.copy()
        return values

    def field(self, name: str) -> NDArray[np.float32]:
        """(N,) the present values of one privileged number, a copy."""
        values: NDArray[np.float32] = self._batch.privileged[:, self.names.index(name)].copy()
        return values

    def observe(self) -> NDArray[np.float32]:
        """(N, size) float32, fresh."""
        body = self._simulation.proprioception.observe(self._simulation.users)
        fields = self._batch.privileged[:, self._columns]
        return np.concatenate([body[:, self._body], fields], axis=1, dtype=np.float32)


def _shown(names: Sequence[str], hidden: Sequence[str]) -> NDArray[np.int64]:
    """Where the names are that match none of the patterns."""
    return np.array(
        [
            i
            for i, name in enumerate(names)
            if not any(fnmatch.fnmatchcase(name, pattern) for pattern in hidden)
        ],
        dtype=np.int64,
    )


class TeacherSimulation:
    """N users as a teacher's vector environment wants them (``SimulationLike``).

    Rewards are those of the task plus the aids, times ``reward_scale``; ``infos`` hold the task's
    own. Episodes are cut after a while (truncated), the first ones at different times.

    Args:
        env: the true environment; pictures are switched off here.
        config: of the teacher.
        seed: of conditions, starts and episodes' lengths.
        postures: start postures; None looks for them if any are wanted.
        physics_timestep_s: another physics step than the user's own.
    """

    def __init__(
        self,
        env: EnvConfig,
        config: TeacherConfig,
        seed: int,
        *,
        postures: StartPostures | None = None,
        physics_timestep_s: float | None = None,
    ) -> None:
        self.config = config
        self.n = config.ppo.n_envs
        self.step_count = 0
        """User steps of all users so far: the aids go by it."""
        blind = blind_env(env, physics_timestep_s)
        self.simulation = Simulation(blind, self.n)
        self.senses = PrivilegedSenses(self.simulation, config.hidden_fields)
        self.observation_space = self.senses.space
        self.action_space = self.simulation.action_space
        self._elbow = int(
            self.simulation.body.qpos_independent[
                self.simulation.body.independent_joints.index(_ELBOW)
            ]
        )
        self.step_s = 1.0 / env.action_frequency_hz
        """Duration of a user step."""
        self._exploring_s: float | None = None
        self._rng = np.random.default_rng(seed)
        self._condition = np.zeros(self.n, dtype=np.int64)
        self._next_condition = 0
        self._length = np.zeros(self.n, dtype=np.int64)
        self._limit = np.ones(self.n, dtype=np.int64)
        self._aids = np.zeros((2, self.n))
        self.fail_rates = np.ones((len(config.conditions), _CELLS))
        """Running averages of the fail rates in training, by condition and cell."""
        self.postures = postures
        if postures is None and config.aids.near_starts.start > 0.0:
            self.postures = self._find_postures(seed)

    def _find_postures(self, seed: int) -> StartPostures:
        aids = self.config.aids
        return find_start_postures(
            self.simulation,
            self.config.conditions,
            box=joint_box(self.simulation, {_ELBOW: aids.start_elbow_rad}),
            near_m=aids.near_start_m,
            per_cell=aids.starts_per_cell,
            seed=seed,
        )

    def explore(self, seconds: float | None) -> None:
        """Let episodes be so short and begin near a cell, from the next ones on; None ends it."""
        self._exploring_s = seconds

    def condition_of(self, user: int) -> int:
        """Which of the configured conditions a user plays."""
        return int(self._condition[user])

    def told_of(self, number: int) -> dict[str, float]:
        """What the game says of a condition (``round.*``), by the true rules.

        The first user's episode is lost.
        """
        self.simulation.reset([0], [0], {"condition": self.config.conditions[number]})
        first = self.senses.values()[0]
        return {
            name: float(value)
            for name, value in zip(self.senses.names, first, strict=True)
            if name.startswith("round.")
        }

    # --- SimulationLike ------------------------------------------------------------------------

    def reset(
        self,
        ids: Sequence[int] | None = None,
        seeds: Sequence[int | None] | None = None,
        options: Any = None,
    ) -> list[dict[str, Any]]:
        """Start new episodes: conditions in turn, some of them near a cell."""
        rows = list(range(self.n)) if ids is None else [int(i) for i in ids]
        given = [None] * len(rows) if seeds is None else list(seeds)
        first = ids is None
        infos: dict[int, dict[str, Any]] = {}
        for row in rows:
            self._condition[row] = self._next_condition % len(self.config.conditions)
            self._next_condition += 1
        for number in range(len(self.config.conditions)):
            chosen = [k for k, row in enumerate(rows) if self._condition[row] == number]
            if not chosen:
                continue
            group = [rows[k] for k in chosen]
            told = self.simulation.reset(
                group,
                [given[k] for k in chosen],
                {**self._options(number), **(options or {})},
                [self._posture(number) for _ in group],
            )
            infos |= dict(zip(group, told, strict=True))
        seconds = self._exploring_s or self.config.aids.episode_seconds.at(self.step_count)
        limit = max(1, round(seconds / self.step_s))
        self._length[rows] = 0
        self._limit[rows] = limit
        if first:  # spread the ends over time
            self._limit[rows] = self._rng.integers(1, limit + 1, len(rows))
        self._aids[:, rows] = self._aid_sums()[:, rows]
        return [infos[row] for row in rows]

    def _options(self, number: int) -> dict[str, Any]:
        aids, step = self.config.aids, self.step_count
        share = aids.failing_cells.at(step)
        fails = self.fail_rates[number] + 1e-3
        weights = (1.0 - share) / _CELLS + share * fails / fails.sum()
        return {
            "condition": self.config.conditions[number],
            "strike_threshold_mps": aids.strike_threshold_mps.at(step),
            "life_seconds": aids.life_seconds.at(step),
            "spawn_weights": weights.tolist(),
        }

    def _posture(self, number: int) -> NDArray[np.float64] | None:
        share = self.config.aids.near_starts.at(self.step_count)
        near = self._rng.random() < (share if self._exploring_s is None else _EXPLORING_NEAR)
        if not near or self.postures is None:
            return None
        weights = self.fail_rates[number] + 0.1
        return self.postures.draw(self.config.conditions[number], weights, self._rng)

    def observation(self) -> dict[str, NDArray[Any]]:
        """``{"teacher": (N, size) float32}``, fresh."""
        return {OBSERVATION: self.senses.observe()}

    def step(self, actions: NDArray[Any]) -> StepBatch:
        """Advance everyone by one user step."""
        result = self.simulation.step(np.clip(actions, -1.0, 1.0))
        self.step_count += self.n
        self._length += 1
        truncated = result.truncated | (~result.terminated & (self._length >= self._limit))
        reward = (
            result.reward + self._aid_reward(result.effort_cost)
        ) * self.config.ppo.reward_scale
        for i in map(int, np.flatnonzero(truncated | result.terminated)):
            self._remember_failures(i, result.logs[i])
        return dataclasses.replace(result, reward=reward, truncated=truncated)

    def _aid_sums(self) -> NDArray[np.float64]:
        return np.stack(
            [self.senses.field("aid.progress_m"), self.senses.field("aid.strike")]
        ).astype(np.float64)

    def _aid_reward(self, effort: NDArray[np.float64]) -> NDArray[np.float64]:
        aids, step = self.config.aids, self.step_count
        sums = self._aid_sums()
        progress, strike = sums - self._aids
        self._aids = sums
        users = self.simulation.users
        straightness = np.maximum(0.0, aids.elbow_rad - users.qpos[:, self._elbow])
        return (
            aids.progress.at(step) * progress
            + aids.strike.at(step) * strike
            - aids.straight_elbow.at(step) * straightness
            + (1.0 - aids.effort.at(step)) * effort
        )

    def _remember_failures(self, i: int, log: Any) -> None:
        rates = self.fail_rates[self._condition[i]]
        for cell in range(_CELLS):
            hits = log.get(f"hitsTarget{cell}", 0.0)
            misses = log.get(f"missesTarget{cell}", 0.0)
            if hits + misses > 0:
                # A cell that comes up twice moves the average as much as two episodes do.
                keep = _FAIL_RATE_MEMORY ** (hits + misses)
                rates[cell] = keep * rates[cell] + (1.0 - keep) * misses / (hits + misses)

    # --- saved states --------------------------------------------------------------------------

    _SAVED = ("_condition", "_length", "_limit", "_aids", "fail_rates")

    def save_state(self) -> bytes:
        """The exact state, the episodes' and the aids' included."""
        header = {
            "step_count": self.step_count,
            "next_condition": self._next_condition,
            "rng": self._rng.bit_generator.state,
            "arrays": {name: getattr(self, name).tolist() for name in self._SAVED},
        }
        text = json.dumps(header).encode()
        return len(text).to_bytes(8, "little") + text + self.simulation.save_state()

    def load_state(self, state: bytes) -> list[int]:
        """Continue from :meth:`save_state`; returns the users whose rounds had to start anew."""
        size = int.from_bytes(state[:8], "little")
        header = json.loads(state[8 : 8 + size])
        anew = self.simulation.load_state(state[8 + size :])
        self.step_count = int(header["step_count"])
        self._next_condition = int(header["next_condition"])
        self._rng.bit_generator.state = header["rng"]
        for name in self._SAVED:
            getattr(self, name)[...] = header["arrays"][name]
        return anew

    def close(self) -> None:
        """Free everything."""
        self.simulation.close()
