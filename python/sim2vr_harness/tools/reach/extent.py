"""Reachable workspace of a point of a body, from its joints' limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sim2vr_harness.users.kinematics.forward import Linkage
from sim2vr_harness.users.kinematics.inverse import CLOSE_M, solve

FloatArray = NDArray[np.float64]

FURTHEST_MARGIN_M = 0.3
"""Margins inside are looked for up to here."""

_SAMPLES = 6000
_FAR_M = 1000.0
"""A place so far away in a direction is as good as the direction: 0.1 mm of error."""
_STARTS = 4
_MOST_SIDES = 4
"""Of the six sides of a cell."""
_DIRECTIONS = 32
"""All around, in which a margin is looked for first."""


@dataclass(frozen=True)
class Verdict:
    """Whether a place can be reached.

    Attributes:
        margin_m: inside: how far the place can be moved in any direction and still be reached, as
            far as was looked; outside: minus the distance to the nearest place that can be reached.
        nearest_m: (3,) the reachable place nearest to it, MuJoCo's world.
        posture: (K,) angles that bring the point there.
    """

    margin_m: float
    nearest_m: FloatArray
    posture: FloatArray

    @property
    def inside(self) -> bool:
        """Whether the place can be reached."""
        return self.margin_m >= 0.0


@dataclass(frozen=True)
class Volume:
    """The cells of a grid whose middles can be reached.

    Attributes:
        cell_m: edge of a cell.
        low_m: (3,) middle of the first cell, MuJoCo's world.
        reached: (X, Y, Z) whether.
    """

    cell_m: float
    low_m: FloatArray
    reached: NDArray[np.bool_]

    @property
    def litres(self) -> float:
        """How much room it is."""
        return float(self.reached.sum() * self.cell_m**3 * 1000.0)

    def middles(self, cells: NDArray[np.integer]) -> FloatArray:
        """(N, 3) middles of cells (N, 3)."""
        return self.low_m + cells * self.cell_m

    def surface(self) -> FloatArray:
        """(N, 3) middles of the reached cells with a neighbour that is not."""
        padded = np.pad(self.reached, 1)
        inner = padded.copy()
        for axis, step in product(range(3), (1, -1)):
            inner &= np.roll(padded, step, axis)
        rim = padded & ~inner
        return self.middles(np.argwhere(rim) - 1)


@dataclass
class Reach:
    """Everywhere that a point can be brought within the joints' limits.

    What the body would collide with, and what its muscles can hold, does not count.

    Args:
        linkage: moves the point.
        seed: of the postures that are drawn to begin with.
    """

    linkage: Linkage
    seed: int = 1
    postures: FloatArray = field(init=False)
    """(N, K) angles, drawn from the limits: half of them evenly, half of them near the limits."""
    points: FloatArray = field(init=False)
    """(N, 3) where they bring the point, m."""

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        low, high = self.linkage.limits.T
        shape = (_SAMPLES // 2, len(low))
        shares = np.concatenate([rng.random(shape), rng.beta(0.3, 0.3, shape)])
        self.postures = np.concatenate([self.linkage.rest[None], low + shares * (high - low)])
        self.points = self.linkage.place(self.postures)
        self._tree = cKDTree(self.points)

    def extent(self) -> FloatArray:
        """(2, 3) least and greatest coordinates that can be reached, MuJoCo's world, m."""
        found = np.stack([self.furthest(sign * np.eye(3)) for sign in (-1.0, 1.0)])
        return np.stack([found[0].diagonal(), found[1].diagonal()])

    def furthest(self, directions: FloatArray) -> FloatArray:
        """(D, 3) the places reached furthest in directions (D, 3), m."""
        best = np.argsort(-(directions @ self.points.T), axis=1)[:, :_STARTS]
        starts = self.postures[best].reshape(-1, self.postures.shape[1])
        towards = np.repeat(self.points.mean(axis=0) + directions * _FAR_M, _STARTS, axis=0)
        q, _ = solve(self.linkage, towards, starts, iterations=300, gain_m=1e-9)
        places = self.linkage.place(q).reshape(len(directions), _STARTS, 3)
        along = np.einsum("dsx,dx->ds", places, directions)
        return places[np.arange(len(directions)), along.argmax(axis=1)]

    def nearest(
        self, places: FloatArray, also: FloatArray | None = None, starts: int = _STARTS
    ) -> tuple[FloatArray, FloatArray]:
        """Bring the point as near to places as it gets.

        Args:
            places: (B, 3) m.
            also: (B, S, K) postures to start from before those that were drawn.
            starts: how many of those, the nearest ones.

        Returns:
            Angles (B, K) and distances (B,) m.
        """
        _, near = self._tree.query(places, k=starts)
        first = self.postures[near]
        if also is not None:
            first = np.concatenate([also, first], axis=1)
        b, s, k = first.shape
        q, distance = np.empty((b, k)), np.full(b, np.inf)
        for start in range(s):
            # A point that is there already needs no other start.
            rows = np.flatnonzero(distance > CLOSE_M)
            if not len(rows):
                break
            found, off = solve(self.linkage, places[rows], first[rows, start])
            better = off < distance[rows]
            q[rows[better]], distance[rows[better]] = found[better], off[better]
        return q, distance

    def judge(self, places: FloatArray) -> list[Verdict]:
        """Say of places (T, 3), MuJoCo's world, whether they can be reached, and by how much."""
        q, distance = self.nearest(places)
        nearest = self.linkage.place(q)
        margins = -distance
        inside = np.flatnonzero(distance <= CLOSE_M)
        margins[inside] = self._margins(places[inside], q[inside])
        return [
            Verdict(float(margin), near, posture)
            for margin, near, posture in zip(margins, nearest, q, strict=True)
        ]

    def _margins(self, places: FloatArray, postures: FloatArray) -> FloatArray:
        """How far from places everything can be reached, (T,) m; see :attr:`Verdict.margin_m`.

        A direction that holds at a radius is taken to hold at every smaller one.
        """
        count = len(places)
        # Directions all around, and last the one that points out where something failed.
        directions = np.repeat(_directions(_DIRECTIONS + 1)[None], count, axis=0)
        failing = np.ones((count, _DIRECTIONS + 1), dtype=bool)
        good, bad = np.zeros(count), np.full(count, FURTHEST_MARGIN_M)
        radius, open_ = bad.copy(), np.ones(count, dtype=bool)
        while open_.any():
            target, direction = np.nonzero(failing & open_[:, None])
            tested = places[target] + directions[target, direction] * radius[target, None]
            q, distance = self.nearest(tested, postures[target][:, None], starts=2)
            off = np.zeros(failing.shape)
            off[target, direction] = distance
            outwards = np.zeros(directions.shape)
            outwards[target, direction] = tested - self.linkage.place(q)
            fails = off > CLOSE_M
            any_fails = fails.any(axis=1)
            good = np.where(open_ & ~any_fails, radius, good)
            bad = np.where(open_ & any_fails, radius, bad)
            for i in np.flatnonzero(open_ & any_fails):
                worst = off[i].argmax()
                directions[i, -1] = outwards[i, worst] / off[i, worst]
                failing[i] = fails[i]
                failing[i, -1] = True
            open_ &= (bad - good > 1e-3) & (good < FURTHEST_MARGIN_M)
            radius = 0.5 * (good + bad)
        return good

    def fill(self, cell_m: float = 0.05) -> Volume:
        """Find every cell of a grid whose middle can be reached, from those that were drawn on.

        Args:
            cell_m: edge of a cell, m.
        """
        low, high = self.extent()
        first = np.floor(low / cell_m) * cell_m
        shape = tuple((np.ceil((high - first) / cell_m).astype(int) + 1).tolist())
        volume = Volume(cell_m, first, np.zeros(shape, dtype=bool))
        known = np.zeros(shape, dtype=np.int64)  # how often it was tried
        postures: dict[int, FloatArray] = {}
        cells = np.unique(np.rint((self.points - first) / cell_m).astype(int), axis=0)
        own: FloatArray | None = None
        while len(cells):
            known[tuple(cells.T)] += 1
            places = volume.middles(cells)
            q, distance = self._once(places, own)
            ok = distance <= CLOSE_M
            reached = cells[ok]
            volume.reached[tuple(reached.T)] = True
            flat = np.ravel_multi_index(tuple(reached.T), shape)
            postures.update(zip(flat.tolist(), q[ok], strict=True))
            cells, own = _neighbours(reached, flat, postures, volume.reached, known)
        self._mend(volume)
        return volume

    def _mend(self, volume: Volume) -> None:
        """Look again at cells that most neighbours of can be reached, from other postures."""
        padded = np.pad(volume.reached, 1)
        around = sum(
            np.roll(padded, step, axis).astype(int) for axis, step in product(range(3), (1, -1))
        )
        doubtful = np.argwhere(~padded & (np.asarray(around, dtype=int) >= _MOST_SIDES)) - 1
        if len(doubtful):
            _, distance = self.nearest(volume.middles(doubtful))
            volume.reached[tuple(doubtful[distance <= CLOSE_M].T)] = True

    def _once(self, places: FloatArray, own: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        if own is None:
            _, near = self._tree.query(places)
            own = self.postures[near]
        return solve(self.linkage, places, own, iterations=25, close_m=0.5 * CLOSE_M)


def _neighbours(
    reached: NDArray[np.int64],
    flat: NDArray[np.int64],
    postures: dict[int, FloatArray],
    done: NDArray[np.bool_],
    tried: NDArray[np.int64],
) -> tuple[NDArray[np.int64], FloatArray]:
    """Cells beside those just reached that are worth a try, and the posture to begin it with."""
    sides = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    beside = (reached[:, None] + sides).reshape(-1, 3)
    source = np.repeat(flat, len(sides))
    within = ((beside >= 0) & (beside < done.shape)).all(axis=1)
    beside, source = beside[within], source[within]
    worth = ~done[tuple(beside.T)] & (tried[tuple(beside.T)] < 3)
    beside, source = beside[worth], source[worth]
    cells, index = np.unique(beside, axis=0, return_index=True)
    return cells, np.array([postures[i] for i in source[index].tolist()])


def _directions(count: int) -> FloatArray:
    """(count, 3) unit vectors spread evenly, by Fibonacci's spiral."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    around = np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(around), ring * np.sin(around), z], axis=1)
