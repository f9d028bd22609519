"""Saved states: ``state_dict`` and ``load_state_dict`` of objects that list their fields."""

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np


class State:
    """An object whose future depends on the fields in ``_state``; a dot leads into a part.

    Fields are plain values, arrays, tensors, random generators, lists and dataclasses of these, and
    parts with ``state_dict`` of their own. What is saved is plain values and tensors only.
    """

    _state: ClassVar[tuple[str, ...]] = ()

    def state_dict(self) -> dict[str, Any]:
        """Copy everything that the future depends on."""
        return {name: _saved(attrgetter(name)(self)) for name in self._state}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state_dict` of an object that was made alike.

        Raises:
            ValueError: it is the state of something else.
        """
        for name in self._state:
            if name not in state:
                raise ValueError(f"got a state without {name}, expected {type(self).__name__}'s")
        for name in self._state:
            owner, _, field = name.rpartition(".")
            part = attrgetter(owner)(self) if owner else self
            now = getattr(part, field)
            new = _restored(now, state[name])
            if new is not now:
                setattr(part, field, new)


class RowState:
    """N users whose states are saved one by one, by the fields in ``_state``.

    Fields are arrays (N, ...), lists of N random generators, parts with these two methods, and
    None for a part that is not there. A field's name in the state has no leading underscore.
    """

    _state: ClassVar[tuple[str, ...]] = ()

    def state_dict(self, i: int) -> dict[str, Any]:
        """Copy everything that user i's future depends on."""
        state: dict[str, Any] = {}
        for name in self._state:
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                state[name.lstrip("_")] = np.array(value[i])
            elif isinstance(value, list):
                state[name.lstrip("_")] = json.dumps(value[i].bit_generator.state).encode()
            elif value is not None:
                state[name.lstrip("_")] = value.state_dict(i)
        return state

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Let user i go on from :meth:`state_dict` of any user.

        Raises:
            ValueError: an entry has another shape.
        """
        for name in self._state:
            value = getattr(self, name)
            if value is None:
                continue
            given = state[name.lstrip("_")]
            if isinstance(value, np.ndarray):
                if np.shape(given) != value.shape[1:]:
                    raise ValueError(
                        f"state of {getattr(self, 'name', type(self).__name__)!r}, "
                        f"{name.lstrip('_')}: got shape {np.shape(given)}, expected "
                        f"{value.shape[1:]}"
                    )
                value[i] = given
            elif isinstance(value, list):
                value[i].bit_generator.state = json.loads(bytes(given))
            else:
                value.load_state_dict(i, given)


def _saved(value: Any) -> Any:
    if isinstance(value, State):
        return value.state_dict()
    if hasattr(value, "state_dict"):  # may share its tensors, as torch's modules do
        return _saved(value.state_dict())
    if isinstance(value, np.ndarray):
        import torch

        return torch.from_numpy(value.copy())
    if isinstance(value, np.random.Generator):
        return json.dumps(value.bit_generator.state)
    if hasattr(value, "get_state"):  # torch's generators
        return value.get_state()
    if hasattr(value, "clone"):  # tensors
        return value.detach().clone()
    if isinstance(value, Mapping):
        return {name: _saved(part) for name, part in value.items()}
    if isinstance(value, list | tuple | deque):
        return [_saved(part) for part in value]
    if is_dataclass(value):
        return {field.name: _saved(getattr(value, field.name)) for field in fields(value)}
    return value


def _restored(now: Any, given: Any) -> Any:
    """Return what a field that is ``now`` becomes; parts, generators and arrays change in place."""
    if hasattr(now, "load_state_dict"):
        now.load_state_dict(given)
    elif isinstance(now, np.ndarray):
        now[...] = given.cpu().numpy()
    elif isinstance(now, np.random.Generator):
        now.bit_generator.state = json.loads(given)
    elif hasattr(now, "set_state"):
        if given is not None:  # None: another device had none
            now.set_state(given.cpu())
    elif isinstance(now, deque):
        return deque(given, now.maxlen)
    elif is_dataclass(now) and not isinstance(now, type):
        names = [field.name for field in fields(now)]
        return replace(now, **{name: _restored(getattr(now, name), given[name]) for name in names})
    elif hasattr(given, "clone"):
        return given.clone()
    elif isinstance(given, list):
        return [_restored(None, part) for part in given]
    else:
        return given
    return now
