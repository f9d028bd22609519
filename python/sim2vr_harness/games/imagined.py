"""Interface between imagined rollouts and a game.

Imagined (model-based) rollouts need rules whose reward has a gradient; a curriculum needs the
places at which targets appear and the failures at each. Both are stated here, in tensors and plain
values, so that a game's package does not depend on bodies, policies or learners.
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
    """A condition of imagined rounds.

    Attributes:
        name: name of the game's condition.
        options: all options that are set for a round.
        start: the privileged observations at a round's start.
    """

    name: str
    options: Mapping[str, OptionValue]
    start: Mapping[str, float]


class ImaginedRounds(Protocol):
    """B rounds without an end, differentiable with respect to the device poses.

    Places are (B, D, 4, 4), the transforms of :attr:`ImaginedGame.devices` in MuJoCo's world frame,
    m. ``fields`` are the privileged observations that :attr:`ImaginedGame.fields` names, (K, F).
    """

    names: tuple[str, ...]
    """Names of the values of :meth:`observe`, as in the true game's privileged observations."""
    spawn_weights: Tensor
    """(C, cells) spawn weights of targets by condition and cell; rows sum to 1."""
    counts: Tensor
    """(2, C, cells) successes and failures since :meth:`clear_counts`."""
    frames: int
    """Number of evenly spaced frames per user step that the rules evaluate, the last at its end."""

    def calibrate(self, place: Tensor, fields: Tensor) -> None:
        """Estimate from user steps of the true game how the tools are fixed to the devices."""

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        """Start rounds ``ids`` (K,) from states of the true game.

        Args:
            ids: (K,) numbers of the rounds.
            place: (K, D, 4, 4) poses of their devices.
            fields: (K, F) privileged observations of the true game in these states.
            cell: (K,) cell with a living target; -1: random.
        """

    def begin(self, ids: Tensor) -> None:
        """Set started rounds to the first frame of a round; tests compare from there.

        Args:
            ids: (K,) numbers of the rounds.
        """

    def condition_of(self, fields: Tensor) -> Tensor:
        """Return (K,) the conditions of these user steps."""

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """Return (K,) distances of the tool from the nearest good start, m, and (K,) its cell.

        The distance is infinite in a game whose rounds may begin anywhere.

        Args:
            place: (K, D, 4, 4).
            condition: (K,).
        """

    def observe(self, place: Tensor) -> Tensor:
        """Return (B, F) a teacher's observation of the game, in the order of :attr:`names`."""

    def step(self, places: Tensor, done: float) -> Tensor:
        """Advance by one user step.

        Args:
            places: (B, F, D, 4, 4) poses of the devices in F = :attr:`frames` frames of the step,
                the last one at its end.
            done: finished proportion of the imagined rollouts; rewards are soft at first.

        Returns:
            (B,) rewards, differentiable by all places since :meth:`cut`.
        """

    def cut(self) -> None:
        """Detach the state from its history, so that gradients end here."""

    def clear_counts(self) -> None:
        """Set the counts of successes and failures to zero."""

    def adapt(self) -> None:
        """Adapt spawn weights and values of the cells to the failures in :attr:`counts`."""

    def state_dict(self) -> dict[str, Any]:
        """Return the complete state of the rounds."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`."""


class ImaginedGame(Protocol):
    """Facts about a game for imagined rollouts.

    Attributes:
        name: name of the game in the runtime's registry.
        settings: class of the keys of ``teacher.imagined.game``, with their defaults.
        devices: the worn devices whose poses the rules use, by the names of their sites.
        fields: the privileged observations that :class:`ImaginedRounds` read.
        cells: number of places at which targets appear.
        conditions: conditions in which a teacher trains unless the configuration names others.
        hidden_fields: patterns of privileged observations, and of proprioception, that a teacher
            does not observe: the model does not predict them, or they would help too much.
        felt_fields: patterns of the privileged observations that a user perceives by touch as well
            as by vision: the pose of the tool in its hand.
        facts: pattern of the privileged observations, 0 or 1, that the image shows: a student's
            image features learn to predict them.
        attention_targets: objects for attention crops, the first ones first, by the prefix of
            their privileged observations: NAME.present, and NAME.x_m, NAME.y_m and NAME.z_m from
            the head in the app's frame. A student may learn to find them
            (``policy.attention_crops``).
        start_fields: the privileged observations with the tool's distance from the nearest good
            start of an action, m, and with its cell; None: starts are not selected.
        on_gpu: True if imagined rounds can run on a GPU: a user step reads no tensor's values.
        start_limits: joint -> lowest and highest angle, rad, of the start postures in the
            curriculum; joints not named have their whole range.
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
            weights: (cells,) spawn weight of each cell; None: the game's own.
        """

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        """Return (2, cells) successes and failures since the round's start, from the game's log."""

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
            n: number of rounds.
            conditions: in the order of their numbers.
            settings: an instance of :attr:`settings`.
            step_s: duration of a user step.
            frames: F, app frames of a user step.
            seed: seed of the targets' times and places.
            gamma: discount factor per user step.

        Raises:
            ValueError: the model does not support this step duration or number of frames.
        """
