"""The seam between the fast recipe and a game.

Imagined (model-based) rollouts need rules whose reward has a gradient; a curriculum needs to know
where a game's targets come up and which of them fail. Both are stated here, in tensors and plain
values, so that a game's room knows nothing of bodies, policies or learners.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.settings import Settings
from sim2vr_harness.client.base import OptionValue

if TYPE_CHECKING:  # settings are read without torch
    from torch import Tensor


@dataclass(frozen=True)
class ImaginedCondition:
    """One of the conditions that imagined rounds are of.

    Attributes:
        name: of the game's condition.
        options: of a round, all that are set.
        start: the privileged numbers at a round's start.
    """

    name: str
    options: Mapping[str, OptionValue]
    start: Mapping[str, float]


class ImaginedRounds(Protocol):
    """B rounds without an end, differentiable by where the devices are.

    Places are (B, D, 4, 4), the transforms of :attr:`ImaginedGame.devices` in MuJoCo's world frame,
    m. ``fields`` are the privileged numbers that :attr:`ImaginedGame.fields` names, (K, F).
    """

    names: tuple[str, ...]
    """What :meth:`observe` gives, by the names of the true game's privileged numbers."""
    spawn_weights: Tensor
    """(C, cells) how often targets come up, by condition and cell; rows sum to 1."""
    counts: Tensor
    """(2, C, cells) successes and failures since :meth:`clear_counts`."""
    frames: int
    """Moments of a user step that it looks at, evenly spread, the last one being its end."""

    def calibrate(self, place: Tensor, fields: Tensor) -> None:
        """Find out from user steps of the true game how the tools are fixed to the devices."""

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        """Let rounds ``ids`` (K,) go on from states of the true game.

        Args:
            ids: (K,) which.
            place: (K, D, 4, 4) where their devices are.
            fields: (K, F) what the true game said there.
            cell: (K,) where a target lives; -1 leaves all to chance.
        """

    def begin(self, ids: Tensor) -> None:
        """Let rounds that have been started be at a round's first moment; tests compare from there.

        Args:
            ids: (K,) which.
        """

    def condition_of(self, fields: Tensor) -> Tensor:
        """(K,) in which condition these user steps were taken."""

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """(K,) how far the tool is from the nearest good start of an action, m, and (K,) its cell.

        A game whose rounds may begin anywhere says infinity.

        Args:
            place: (K, D, 4, 4).
            condition: (K,).
        """

    def observe(self, place: Tensor) -> Tensor:
        """(B, F) what a teacher observes of the game, in the order of :attr:`names`."""

    def step(self, places: Tensor, done: float) -> Tensor:
        """Advance by one user step.

        Args:
            places: (B, F, D, 4, 4) where the devices are in F = :attr:`frames` moments of the step,
                the last one at its end.
            done: share of the imagined rollouts that is over; rewards are soft at first.

        Returns:
            (B,) rewards, differentiable by all places since :meth:`cut`.
        """

    def cut(self) -> None:
        """Forget what led to the present: gradients end here."""

    def clear_counts(self) -> None:
        """Count successes and failures anew."""

    def adapt(self) -> None:
        """Change spawns and worth of the cells by what :attr:`counts` says has failed."""

    def state_dict(self) -> dict[str, Any]:
        """Everything that the rounds' future depends on."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state_dict`."""


class ImaginedGame(Protocol):
    """What the fast recipe knows of a game.

    Attributes:
        name: of the game, as the runtime's registry has it.
        settings: its keys of ``teacher.imagined.game``, with their defaults.
        devices: the worn devices whose places decide, by the names of their sites.
        fields: the privileged numbers that :class:`ImaginedRounds` take.
        cells: how many places targets come up in.
        conditions: those that a teacher trains in unless the configuration names others.
        hidden_fields: patterns of privileged numbers, and of the own body's, that a teacher does
            not observe: the model does not know them, or they would help too much.
        felt_fields: patterns of the privileged numbers that a user feels as well as sees: where the
            tool in its hand is.
        facts: pattern of the privileged numbers, 0 or 1, that the picture shows: a student's
            image features learn to name them.
        attention_targets: objects for attention crops, the first ones first, by the beginning of
            their privileged numbers: NAME.present, and NAME.x_m, NAME.y_m and NAME.z_m from the
            head in the app's frame. A student may learn to find them (``policy.attention_crops``).
        start_fields: the privileged numbers that say how far the tool is from the nearest good
            start of an action, m, and for which cell; None: rounds start where they start.
        on_gpu: whether imagined rounds can run on a GPU: a user step reads no tensor's values.
        start_limits: joint -> lowest and highest angle, rad, of the postures that rounds of the
            curriculum may start in; joints not named have their whole range.
    """

    name: str
    settings: type[Settings]
    devices: tuple[str, ...]
    fields: tuple[str, ...]
    cells: int
    conditions: tuple[str, ...]
    hidden_fields: tuple[str, ...]
    felt_fields: tuple[str, ...]
    facts: str
    attention_targets: tuple[str, ...]
    start_fields: tuple[str, str] | None
    on_gpu: bool
    start_limits: Mapping[str, tuple[float, float]]

    def options(
        self, condition: str, weights: Sequence[float] | None = None
    ) -> dict[str, OptionValue]:
        """Return the options of a round.

        Args:
            condition: its name.
            weights: (cells,) how often targets come up in each; None leaves the game's own.
        """

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        """(2, cells) successes and failures since the round's start, from the game's log."""

    def rounds(
        self,
        n: int,
        conditions: Sequence[ImaginedCondition],
        settings: Any,
        *,
        step_s: float,
        frames: int,
        seed: int,
        gamma: float,
    ) -> ImaginedRounds:
        """Return N imagined rounds.

        Args:
            n: how many.
            conditions: in the order of their numbers.
            settings: an instance of :attr:`settings`.
            step_s: duration of a user step.
            frames: F, app frames of a user step.
            seed: of what comes up when and where.
            gamma: how much of a reward is left to who learns a user step later.

        Raises:
            ValueError: the model does not know this duration of a step, or so many frames.
        """
