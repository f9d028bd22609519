"""Postures in which a user is about to act: reference-state initialisation for a teacher."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.games import ImaginedGame

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
        """How many postures there are for each cell."""
        return {cell: len(found) for cell, found in self._postures[condition].items()}

    def draw(
        self, condition: str, weights: NDArray[np.floating], rng: np.random.Generator
    ) -> FloatArray | None:
        """A posture near a cell drawn by ``weights`` (by cell); None where there is none."""
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
        game: what the fast recipe knows of it.
        conditions: of the game.
        near_m: how near is near enough.
        per_cell: how many to find for each cell.
        seed: of the search.
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
