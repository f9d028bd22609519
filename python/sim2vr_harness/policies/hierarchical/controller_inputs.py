"""Fingers: from what hands do with triggers, sticks and buttons to a user's actions."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.client.devices import input_named
from sim2vr_harness.policies.hierarchical.options import role_of

ROLES = (
    "trigger",
    "squeeze",
    "thumbstick_x",
    "thumbstick_y",
    "first",
    "second",
    "thumbstick_click",
)
"""Inputs of a hand; ``first`` and ``second`` are its buttons, x and y or a and b."""
_INSTEAD = {"trigger": "squeeze", "squeeze": "trigger"}
"""The input that does the work of one that the hand does not have."""


class ControllerInputs:
    """The actions of a user's fingers.

    Args:
        names: ``env.user.inputs``.
        hands: the devices of the hands, such as ``controller_right``.
    """

    def __init__(self, names: Sequence[str], hands: Sequence[str]) -> None:
        own = [input_named(name) for name in names]
        self._low = np.array([one.low for one in own], dtype=np.float32)
        self._sources: list[tuple[int, list[int]]] = []
        """Of each input the number of its hand (-1: not a hand's) and the roles that it plays."""
        there = {(one.hand, role_of(name)) for one, name in zip(own, names, strict=True)}
        for one, name in zip(own, names, strict=True):
            role = role_of(name)
            roles = [role] if role in ROLES else []
            other = _INSTEAD.get(role)
            if other is not None and (one.hand, other) not in there:
                roles.append(other)
            device = f"controller_{one.hand}"
            hand = list(hands).index(device) if device in hands else -1
            self._sources.append((hand, [ROLES.index(each) for each in roles]))

    def actions(self, values: Tensor) -> NDArray[np.float32]:
        """(N, F) actions for values (N, H, ROLES) of the inputs; all others are at rest."""
        found = np.zeros((len(values), len(self._sources)), np.float32)
        for column, (hand, roles) in enumerate(self._sources):
            if hand >= 0 and roles:
                each = values[:, hand, roles].numpy()
                found[:, column] = each[np.arange(len(each)), np.abs(each).argmax(1)]
        return (2.0 * (found - self._low) / (1.0 - self._low) - 1.0).astype(np.float32)


def with_inputs_at_rest(body: NDArray[np.float32], names: Sequence[str]) -> NDArray[np.float32]:
    """(N, A + F) actions (N, A) of bodies whose fingers leave F inputs alone."""
    if not names:
        return body
    low = np.array([input_named(name).low for name in names], dtype=np.float32)
    rest = -2.0 * low / (1.0 - low) - 1.0
    return np.concatenate([body, np.tile(rest, (len(body), 1))], 1).astype(np.float32)
