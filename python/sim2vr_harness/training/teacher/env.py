"""The teacher's world: users in the true game, with privileged numbers and a curriculum."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.state import State
from sim2vr_harness.envs.config import EnvConfig, SenseConfig
from sim2vr_harness.envs.privileged import OBSERVATION, Lag, PrivilegedSenses
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation, StepBatch
from sim2vr_harness.games import ImaginedCondition, ImaginedGame, imagined_game, imagined_games
from sim2vr_harness.runs.teacher_config import TeacherConfig

FloatArray = NDArray[np.float64]

_SPREAD = 0.25
"""Standard deviation of a changed posture, as a share of the joints' ranges."""


class InitialStates:
    """Postures by condition and cell.

    Args:
        postures: condition -> cell -> (K, J) angles of the independent joints in rad.
    """

    def __init__(self, postures: Mapping[str, Mapping[int, FloatArray]]) -> None:
        self._postures = {name: dict(cells) for name, cells in postures.items()}

    def counts(self, condition: str) -> dict[int, int]:
        """Return the number of postures for each cell."""
        return {cell: len(found) for cell, found in self._postures[condition].items()}

    def draw(
        self, condition: str, weights: NDArray[np.floating], rng: np.random.Generator
    ) -> FloatArray | None:
        """Return a posture near a cell drawn by ``weights`` (by cell); None if there is none."""
        cells = [cell for cell, found in self._postures[condition].items() if len(found)]
        if not cells:
            return None
        chances = np.array([weights[cell] for cell in cells], dtype=np.float64)
        cell = cells[int(rng.choice(len(cells), p=chances / chances.sum()))]
        found = self._postures[condition][cell]
        return found[int(rng.integers(len(found)))]


def joint_box(
    simulation: Simulation, limits: Mapping[str, tuple[float, float]]
) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest angles of the independent joints, (J,) each, rad; ``limits`` by name."""
    low, high = (side.copy() for side in simulation.body.joint_ranges.T)
    for name, (least, most) in limits.items():
        joint = simulation.body.independent_joints.index(name)
        low[joint], high[joint] = max(low[joint], least), min(high[joint], most)
    return low, high


def find_start_postures(
    simulation: Simulation,
    game: ImaginedGame,
    conditions: Sequence[str],
    *,
    near_m: float,
    per_cell: int,
    seed: int,
    most_rounds: int = 400,
) -> InitialStates:
    """Look for postures that hold the tool where an action may begin, by asking the game.

    Half of the postures tried are drawn from the joints' ranges, half are neighbours of those found
    already; the game says how far each is from a start (:attr:`ImaginedGame.start_fields`).

    Args:
        simulation: users to try with; their rounds are lost.
        per_cell: how many to find for each cell.
        most_rounds: resets of all users per condition after which the search gives up.

    Raises:
        ValueError: the game does not know good starts.
    """
    batch: Any = simulation.apps[0].batch  # type: ignore[attr-defined]
    if game.start_fields is None:
        raise ValueError(f"game: got {game.name!r}, expected one that knows good starts")
    columns = [list(batch.privileged_names).index(name) for name in game.start_fields]
    rng = np.random.default_rng(seed)
    low, high = joint_box(simulation, game.start_limits)

    def found(condition: str) -> dict[int, FloatArray]:
        kept: dict[int, list[FloatArray]] = {}
        options = game.options(condition)
        for _ in range(most_rounds):
            tried = _candidates(kept, low, high, simulation.n, rng)
            simulation.reset(seeds=[0] * simulation.n, options=options, postures=list(tried))
            distances, cells = batch.privileged[:, columns].T
            for i in np.flatnonzero(distances <= near_m):
                postures = kept.setdefault(int(cells[i]), [])
                if len(postures) < per_cell:
                    postures.append(tried[i])
            if len(kept) == game.cells and all(len(k) == per_cell for k in kept.values()):
                break
        return {cell: np.array(postures) for cell, postures in sorted(kept.items())}

    return InitialStates({condition: found(condition) for condition in conditions})


def _candidates(
    kept: Mapping[int, list[FloatArray]],
    low: FloatArray,
    high: FloatArray,
    n: int,
    rng: np.random.Generator,
) -> FloatArray:
    tried = rng.uniform(low, high, (n, len(low)))
    if kept:
        # Neighbours of the rarest cells' postures lead to more of them, and beyond.
        cells = sorted(kept, key=lambda cell: len(kept[cell]))
        for i in range(n // 2):
            postures = kept[cells[i % min(3, len(cells))]]
            near = postures[int(rng.integers(len(postures)))]
            tried[i] = near + rng.normal(0.0, _SPREAD / 2, len(low)) * (high - low)
    return np.clip(tried, low, high)


_FAIL_RATE_MEMORY = 0.97
_FAILING_CELLS = 0.3
"""Proportion of spawns that follow the cells' fail rates; most are uniform, as in the true game."""
_STARTS_PER_CELL = 40
"""Number of start postures that are searched for each cell and condition."""
_EPISODE_S = 12.0
"""Episodes are cut after this time, so that starts near a cell are frequent; the value of the state
stands for the rest."""
_NEAR_START_M = 0.08
"""Farthest that a near start is from a good start of an action: within one movement of it."""
_EXPLORING_NEAR = 0.9


def game_of(env: EnvConfig) -> ImaginedGame:
    """Return the differentiable game model of the environment's game.

    Raises:
        InputError: there is none, or none for the hand that the user plays with.
    """
    app = env.app
    game = imagined_game(app.game) if app.transport == "in_process" else None
    if game is None:
        raise InputError(
            "recipe",
            f"'distill' for the game {app.game!r} ({app.transport})",
            f"a game in this process with a model ({', '.join(imagined_games())}), or recipe: ppo",
        )
    resolved = ResolvedEnv(env)
    facts, playing = resolved.facts, resolved.with_hand().config.app.options
    hand = playing.get(facts.hand_option or "", "right")
    missing = [device for device in game.devices if device not in ("headset", *facts.needs(hand))]
    if facts.devices and missing:
        raise InputError(
            "recipe",
            f"'distill' for a user who plays {app.game} with the {hand} hand",
            f"one with {missing[0]}, which its differentiable model is made for, or recipe: ppo",
        )
    return game


def blind_env(env: EnvConfig) -> EnvConfig:
    """Return ``env`` without pictures."""
    app = env.app.model_copy(update={"renderer": "null"})
    # The least that an app draws; its shape decides what the headset could see.
    scale = max(1, min(env.vision.width, env.vision.height) // 8)
    vision = env.vision.model_copy(
        update={
            "width": max(8, env.vision.width // scale),
            "height": max(8, env.vision.height // scale),
            "fovea": None,
            "channels": ("depth",),
            "eyes": 1,
        }
    )
    # Its own body, undelayed and clear; the actions stay those of the student.
    senses = (SenseConfig(sense="proprioception"),)
    return env.model_copy(update={"app": app, "vision": vision, "senses": senses})


class TeacherSimulation(State):
    """N users in the form of a teacher's vector environment.

    Rules and rewards are the true ones. The curriculum selects the targets that appear and the
    starts of rounds. Episodes are truncated after some time, the first ones at different times.

    Args:
        env: the true environment; images are switched off here.
        seed: of conditions, starts and episodes' lengths.
        n: number of users; None: ``config.imagined.n_envs``.

    Raises:
        InputError: the game has no differentiable model.
    """

    def __init__(
        self, env: EnvConfig, config: TeacherConfig, seed: int, *, n: int | None = None
    ) -> None:
        self.config, self.teacher = env, config
        self.n = n or config.imagined.n_envs
        self.step_count = 0
        """User steps of all users so far."""
        self.game = game_of(env)
        self.conditions = config.conditions or self.game.conditions
        self.simulation = Simulation(blind_env(env), self.n)
        self.resolved = self.simulation.resolved
        self.senses = privileged_senses(self.simulation, config, self.game, env)
        self.observation_space = self.senses.space
        self.action_space = self.simulation.action_space
        self.step_s = 1.0 / env.action_frequency_hz
        """Duration of a user step."""
        self._exploring_s: float | None = None
        self._rng = np.random.default_rng(seed)
        self._condition = np.zeros(self.n, dtype=np.int64)
        self._next_condition = 0
        self._length = np.zeros(self.n, dtype=np.int64)
        self._limit = np.ones(self.n, dtype=np.int64)
        self.fail_rates = np.ones((len(self.conditions), self.game.cells))
        """Running averages of the fail rates in training, by condition and cell."""
        self.postures: InitialStates | None = None
        if config.curriculum.near_starts > 0.0 and self.game.start_fields is not None:
            self.postures = find_start_postures(
                self.simulation,
                self.game,
                self.conditions,
                near_m=_NEAR_START_M,
                per_cell=_STARTS_PER_CELL,
                seed=seed,
            )

    def explore(self, seconds: float | None) -> None:
        """Shorten the next episodes and start them near a cell; None ends this."""
        self._exploring_s = seconds

    def condition_of(self, user: int) -> int:
        """Return the index of the condition that a user plays."""
        return int(self._condition[user])

    def describe(self, number: int) -> ImaginedCondition:
        """Return the parameters of a condition for imagined rounds.

        The first user's episode is lost.
        """
        name = self.conditions[number]
        options = self.game.options(name)
        self.simulation.reset([0], [0], options)
        first = map(float, self.senses.values()[0])
        start = dict(zip(self.senses.names, first, strict=True))
        return ImaginedCondition(name, {**self.config.app.options, **options}, start)

    # --- what a simulation does -----------------------------------------------------------------

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
            self._condition[row] = self._next_condition % len(self.conditions)
            self._next_condition += 1
        for number in range(len(self.conditions)):
            chosen = [k for k, row in enumerate(rows) if self._condition[row] == number]
            if not chosen:
                continue
            group = [rows[k] for k in chosen]
            started = self.simulation.reset(
                group,
                [given[k] for k in chosen],
                {**self._options(number), **(options or {})},
                [self._posture(number) for _ in group],
            )
            infos |= dict(zip(group, started, strict=True))
        seconds = self._exploring_s or _EPISODE_S
        limit = max(1, round(seconds / self.step_s))
        self._length[rows] = 0
        self._limit[rows] = limit
        if first:  # spread the ends over time
            self._limit[rows] = self._rng.integers(1, limit + 1, len(rows))
        return [infos[row] for row in rows]

    def _options(self, number: int) -> dict[str, Any]:
        share = _FAILING_CELLS
        fails = self.fail_rates[number] + 1e-3
        weights = (1.0 - share) / self.game.cells + share * fails / fails.sum()
        return self.game.options(self.conditions[number], weights.tolist())

    def _posture(self, number: int) -> NDArray[np.float64] | None:
        share = self.teacher.curriculum.near_starts
        near = self._rng.random() < (share if self._exploring_s is None else _EXPLORING_NEAR)
        if not near or self.postures is None:
            return None
        weights = self.fail_rates[number] + 0.1
        return self.postures.draw(self.conditions[number], weights, self._rng)

    def observation(self) -> dict[str, NDArray[Any]]:
        """``{"teacher": (N, size) float32}``, fresh."""
        return {OBSERVATION: self.senses.observe()}

    def step(self, actions: NDArray[Any]) -> StepBatch:
        """Advance all users by one user step."""
        result = self.simulation.step(np.clip(actions, -1.0, 1.0))
        self.step_count += self.n
        self._length += 1
        truncated = result.truncated | (~result.terminated & (self._length >= self._limit))
        for i in map(int, np.flatnonzero(truncated | result.terminated)):
            self._remember_failures(i, result.logs[i])
        return dataclasses.replace(result, truncated=truncated)

    def _remember_failures(self, i: int, log: Any) -> None:
        rates = self.fail_rates[self._condition[i]]
        succeeded, failed = self.game.outcomes(log)
        for cell, count in enumerate(succeeded + failed):
            if count > 0:
                # A cell that comes up twice moves the average as much as two episodes do.
                keep = _FAIL_RATE_MEMORY**count
                rates[cell] = keep * rates[cell] + (1.0 - keep) * failed[cell] / count

    # --- saved states --------------------------------------------------------------------------

    _state = (
        *("step_count", "_next_condition", "_rng", "_condition", "_length", "_limit"),
        *("fail_rates", "simulation"),
    )

    def close(self) -> None:
        """Free everything."""
        self.simulation.close()


def privileged_senses(
    simulation: Simulation, config: TeacherConfig, game: ImaginedGame, env: EnvConfig
) -> PrivilegedSenses:
    """Return the privileged observations of a teacher of these users.

    Args:
        simulation: the users; if senses are delayed, its states are recorded from the next reset.
    """
    lag = Lag.of(env, config.recognition_latency_steps)
    hidden = game.hidden_fields if config.hidden_fields is None else config.hidden_fields
    return PrivilegedSenses(
        simulation,
        hidden,
        felt=game.felt_fields,
        lag=lag,
    )
