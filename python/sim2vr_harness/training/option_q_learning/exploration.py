"""Exploratory decisions: random tries that go to rare colours more often than to common ones."""

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.policies.hierarchical.action_selection import OptionScene
from sim2vr_harness.policies.hierarchical.depth_grid import CELL_PX
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy

_TRY_STEPS = (6, 16)
"""How long a random try is seen through, user steps."""
_PULL_STEPS = 24
"""The same of pulls, which have an end of their own."""
_REST_SHARE = 0.1
_TRIED_M = 0.1
"""Places so near to what a hand reaches are tried more often."""
_COLOURS = 8


class Exploration:
    """Draws what N users try.

    Args:
        policy: of the users.
        rng: of the tries.
    """

    def __init__(self, policy: HierarchicalPolicy, rng: np.random.Generator) -> None:
        self._policy, self._sight, self.rng = policy, policy.values.sight, rng
        self._options = policy.values.options
        self.colours = np.ones(_COLOURS**3)
        """How often each colour was seen."""

    def draw(self, near: NDArray[np.float64], far: NDArray[np.float64]) -> int:
        """Draw a choice.

        Args:
            near: (cells,) weights of cells to do something at with the hand.
            far: (cells,) the same of cells to point at.
        """
        options, cells = self._options, self._sight.cells
        if self.rng.random() < _REST_SHARE:
            free = int(self.rng.integers(1 + len(options.free))) if options.free else 0
            return options.rest(cells) + free
        drawn = self.rng.random()
        # Half of the tries take options with inputs; without any, they touch or push.
        favoured = options.favoured
        if self.rng.random() < 0.5:
            move = favoured[self.rng.integers(len(favoured))]
        else:
            move = int(self.rng.integers(len(options.placed)))
        weights = far if options.placed[move] == "point" else near
        cell = int(np.searchsorted(np.cumsum(weights), drawn * weights.sum()))
        return move * cells + min(cell, cells - 1)

    def steps(self, chosen: int) -> int:
        """How long a try is seen through, user steps."""
        placed, option = self._options.placed, chosen // self._sight.cells
        if option < len(placed) and placed[option] == "pull":
            return _PULL_STEPS
        return int(self.rng.integers(*_TRY_STEPS))

    def curiosity(
        self, scene: OptionScene, users: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(K, cells) how much K users try: what is within reach, what has a rare colour.

        The second weights are those of cells to point at, near and far alike.
        """
        if not len(users):
            none = np.zeros((0, self._sight.cells))
            return none, none
        # (K, cells) how rare the rarest colour in each cell is.
        rarity_rare = 1.0 / (0.002 + self.colours / self.colours.sum())
        rows, columns = self._sight.rows, self._sight.columns
        own = scene.pictures.numpy()[users][:, :, : rows * CELL_PX, : columns * CELL_PX]
        each = rarity_rare[_colours(own)].reshape(-1, rows, CELL_PX, columns, CELL_PX)
        rarest: NDArray[np.float64] = each.max((2, 4)).reshape(len(users), -1)
        rare = rarest
        flat = scene.places[users].flatten(2).transpose(1, 2).reshape(-1, 3)
        reach = self._policy.primitives.near(flat, _TRIED_M).reshape(len(users), -1)
        there = np.where(scene.something.numpy()[users], 1.0, 1e-9)
        near = _spread(there * np.where(reach, 1.0, 0.03), rare)
        return near, _spread(there, rare) if "point" in self._options.placed else near

    def note_colours(self, scene: OptionScene) -> None:
        """Count what colours there are; what was seen long ago counts less."""
        pictures = scene.pictures.numpy()[:, :, ::2, ::2]
        seen = np.bincount(_colours(pictures).ravel(), minlength=_COLOURS**3)
        self.colours = 0.999 * self.colours + seen / seen.sum()


def _colours(pictures: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(N, H, W) numbers of the colours of pixels."""
    level = (pictures[:, :3].astype(np.int64) * _COLOURS) // 256
    number: NDArray[np.int64] = (level[:, 0] * _COLOURS + level[:, 1]) * _COLOURS + level[:, 2]
    return number


def _spread(where: NDArray[np.float64], rare: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, cells) weights that prefer rare colours among places, half of them by far."""
    weights: NDArray[np.float64] = where * (0.3 * rare / rare.mean() + 0.7)
    rarest = where * rare
    return 0.5 * weights / weights.sum(1, keepdims=True) + 0.5 * rarest / rarest.sum(
        1, keepdims=True
    )
