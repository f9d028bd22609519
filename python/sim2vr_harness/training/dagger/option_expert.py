"""A user with a motor layer beside a student: what it would do with what it sees."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.policies.hierarchical.action_selection import ActionSelector
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.frame_history import FrameHistory
from sim2vr_harness.policies.hierarchical.primitives import OptionChoice, PrimitiveController
from sim2vr_harness.training.dagger.expert import proprioception_scale

_UNIT_M = 0.4


class OptionExpert:
    """See :class:`~sim2vr_harness.training.dagger.dagger.Guide`.

    It remembers nothing but the pictures: the choice is made anew in every user step, so that what
    it does follows from what is seen and felt.

    Args:
        net: says what is worth doing.
        primitives: of the users' hands.
        simulation: the users; watched from their next reset on.
        late_steps: user steps by which they see late.
    """

    def __init__(
        self,
        net: ActionValueMap,
        primitives: PrimitiveController,
        simulation: Any,
        late_steps: int = 0,
    ) -> None:
        self._net, self._selector = (
            net,
            ActionSelector(simulation, primitives, FrameHistory(simulation, late_steps)),
        )
        self._choice = OptionChoice(simulation.n, len(primitives.tool))
        self._size = simulation.action_space.shape[0]

    def actions(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol."""
        self._selector.choose_best(self._net, self._choice)
        body = self._selector.actions(self._choice)
        actions = np.zeros((len(body), self._size), np.float32)
        actions[:, : body.shape[1]] = body
        return actions

    def facts(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: none."""
        return np.zeros((simulation.n, 0), np.float32)

    def numbers(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: the move and the place of every hand."""
        head = simulation.users.device_poses("headset")[0]
        place = (self._choice.place.numpy() - head[:, None]) / _UNIT_M
        known = [-1, *self._selector.primitives.options.numbers.tolist()]
        moves = self._choice.move.numpy()[..., None] == np.array(known)
        told = np.concatenate([place, moves], 2).reshape(len(head), -1)
        return np.clip(told, -3.0, 3.0).astype(np.float32)

    crop_columns: tuple[tuple[int, ...], ...] = ()

    def crop_places(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: nothing is known of the game."""
        return np.zeros((simulation.n, 0, 3), np.float32)

    def proprioception_scale(
        self, simulation: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See the protocol."""
        return proprioception_scale(self, simulation)
