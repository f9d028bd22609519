"""The options of a user's hands: what they can do with a place in sight, and without one.

An option at a place (:data:`PLACED`) is chosen together with a cell of the picture. The others
(:data:`FREE`) work a controller's stick or buttons while the hand goes on with what it does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.devices import input_named

_DIAGONAL = 0.5**0.5
SIDEWAYS = {
    "up": (0.0, 1.0),
    "up right": (-_DIAGONAL, _DIAGONAL),
    "right": (-1.0, 0.0),
    "down right": (-_DIAGONAL, -_DIAGONAL),
    "down": (0.0, -1.0),
    "down left": (_DIAGONAL, -_DIAGONAL),
    "left": (1.0, 0.0),
    "up left": (_DIAGONAL, _DIAGONAL),
}
"""Direction of each swing, to the left and up."""
MOVES = ("touch", "push", *SIDEWAYS)
"""Options that need no input: come and stay, go through away from the head, go through sideways."""
PLACED = (*MOVES, "press", "point", "hold", "grab", "release", "pull")
"""All options at a place. Of those with an input: come and pull the trigger; turn the aim ray to
the place and pull the trigger; come and keep the trigger pulled; come and close the squeeze, which
stays closed; come and open it; come, close it, go back from there and open it."""
FREE = {
    "turn left": ("thumbstick_x", -1.0),
    "turn right": ("thumbstick_x", 1.0),
    "walk back": ("thumbstick_y", -1.0),
    "walk forward": ("thumbstick_y", 1.0),
    "first button": ("first", 1.0),
    "second button": ("second", 1.0),
    "stick button": ("thumbstick_click", 1.0),
}
"""Options without a place: the input that each works, and its value."""
_GROUPS = {
    "touch": ("touch",),
    "push": ("push",),
    "swing": tuple(SIDEWAYS),
    "press": ("press",),
    "point": ("point",),
    "hold": ("hold",),
    "grab": ("grab", "release", "pull"),
    "turn": ("turn left", "turn right"),
    "walk": ("walk back", "walk forward"),
    "button": ("first button", "second button", "stick button"),
}
"""Options by the names that ``skills.options`` has for them."""
_NEEDS = {
    "press": ("trigger", "squeeze"),
    "point": ("trigger",),
    "hold": ("trigger", "squeeze"),
    "grab": ("squeeze", "trigger"),
    "turn": ("thumbstick_x",),
    "walk": ("thumbstick_y",),
    "button": ("first", "second", "thumbstick_click"),
}
"""Any of these inputs is needed; the first one brings the option along, of buttons each its own."""
_SAME = {"x": "first", "a": "first", "y": "second", "b": "second"}


def role_of(name: str) -> str:
    """Return what an input such as ``right.a`` is for, the same for both hands: ``first``."""
    own = input_named(name).name
    return _SAME.get(own, own)


@dataclass(frozen=True)
class OptionSet:
    """The options of a user.

    Attributes:
        placed: options at a place, in the order of :data:`PLACED`.
        free: options without a place, in the order of :data:`FREE`.
        inputs: the controller inputs that the user's actions work, in their order.
    """

    placed: tuple[str, ...] = MOVES
    free: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()

    @property
    def numbers(self) -> Tensor:
        """(M,) numbers of the options at a place in :data:`PLACED`."""
        return torch.tensor([PLACED.index(name) for name in self.placed])

    @property
    def favoured(self) -> tuple[int, ...]:
        """Positions of the options that half of the tries take: those with inputs, if any."""
        with_input = [k for k, name in enumerate(self.placed) if name not in MOVES]
        return tuple(with_input) or tuple(range(min(2, len(self.placed))))

    def rest(self, cells: int) -> int:
        """Return the number of the choice to rest; options without a place follow it."""
        return len(self.placed) * cells

    def count(self, cells: int) -> int:
        """Return the number of choices of a hand."""
        return self.rest(cells) + 1 + len(self.free)


PLAIN = OptionSet()
"""The options of a user without controller inputs."""


def option_set(inputs: Sequence[str], wanted: Sequence[str] | None = None) -> OptionSet:
    """Return the options that the inputs of an app allow.

    Args:
        inputs: ``env.user.inputs``.
        wanted: ``skills.options``; None: touch, push and swing, and with a trigger press and point,
            with a squeeze grab, with a thumbstick turn and walk, with buttons those.

    Raises:
        InputError: an option needs an input that is not there.
    """
    roles = {role_of(name) for name in inputs}
    if wanted is None:
        first = {name: needs if name == "button" else needs[:1] for name, needs in _NEEDS.items()}
        given = [name for name, needs in first.items() if name != "hold" and roles & set(needs)]
        wanted = ("touch", "push", "swing", *given)
    for name in wanted:
        needs = _NEEDS.get(name, ())
        if needs and not roles & set(needs):
            got = f"{name!r} with env.user.inputs [{', '.join(inputs)}]"
            raise InputError("skills.options", got, f"inputs with a {' or a '.join(needs)}")
    names = {option for name in wanted for option in _GROUPS[name]}
    free = tuple(name for name, (role, _) in FREE.items() if name in names and role in roles)
    return OptionSet(tuple(name for name in PLACED if name in names), free, tuple(inputs))


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
