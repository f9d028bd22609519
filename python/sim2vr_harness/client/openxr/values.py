r"""Values of a task in an OpenXR program: from what it prints, labels, vibrates and from poses.

An expression is one of these, with a comparison behind it if it shall be a truth:

- ``printed("score: (\d+)")``: the number in brackets in the last line that matches; without
  brackets, how many lines matched; with three pairs of brackets a place x y z in OpenXR's frame,
- ``label("hit")``: the same of labels that the program begins or inserts (XR_EXT_debug_utils),
- ``haptics("right")``, ``left`` or ``any``: how many vibrations the program has requested,
- ``pose("head.y")``: a coordinate of a device, x y z in metres, app frame.
"""

import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim2vr_harness.client.base import AppValue, Float64Array
from sim2vr_harness.client.devices import HANDS, HapticPulse
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.poses import DEVICES

MOST_CHARACTERS = 2000
"""Of a line that is searched."""
_FORM = re.compile(r"\s*(\w+)\(\s*(\"(?:[^\"\\]|\\.)*\"|'[^']*')\s*\)\s*(?:(\S+)\s*(\S+))?\s*")
_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
    "==": operator.eq,
    "!=": operator.ne,
}
_EXPECTED = (
    'printed("REGEX"), label("REGEX"), haptics("left|right|any") or pose("DEVICE.x|y|z"), and '
    "behind it nothing or a comparison such as >= 3"
)


@dataclass(frozen=True)
class Happened:
    """Observed output of a program in a step."""

    poses: Float64Array
    """(3, 7) head, left, right at its end."""
    haptics: Sequence[HapticPulse] = ()
    labels: Sequence[str] = ()
    lines: Sequence[str] = ()


class _Source(ABC):
    """Source of a value."""

    value: AppValue = None

    def begin(self) -> None:
        """Begin a round."""
        self.value = None

    @abstractmethod
    def take(self, happened: Happened) -> None:
        """Take in a step."""


class _Texts(_Source):
    """Numbers in texts, or how many match."""

    def __init__(self, kind: str, pattern: str) -> None:
        self._kind = kind
        try:
            self._pattern = re.compile(pattern)
        except re.error as error:
            raise ValueError(f"the regular expression {pattern!r} ({error})") from error
        if self._pattern.groups not in (0, 1, 3):
            raise ValueError(
                f"{self._pattern.groups} pairs of brackets in {pattern!r}; none counts, one is a "
                "number and three are a place (write further ones as (?:...))"
            )
        self.begin()

    def begin(self) -> None:
        self.value = None if self._pattern.groups else 0

    def take(self, happened: Happened) -> None:
        for text in happened.lines if self._kind == "printed" else happened.labels:
            match = self._pattern.search(text[:MOST_CHARACTERS])
            if match is None:
                continue
            if not self._pattern.groups:
                assert isinstance(self.value, int)
                self.value += 1
            elif (numbers := _numbers(match)) is not None:
                x, *yz = numbers
                self.value = (x, yz[0], -yz[1]) if yz else x


def _numbers(match: re.Match[str]) -> list[float] | None:
    """The numbers of all groups; None where one is none."""
    try:
        found = [float(group) for group in match.groups()]
    except (TypeError, ValueError):
        return None
    return found if np.isfinite(found).all() else None


class _Haptics(_Source):
    def __init__(self, hand: str) -> None:
        if hand not in ("any", *HANDS):
            raise ValueError(f"the hand {hand!r}; there are left, right and any")
        self._hand = hand
        self.begin()

    def begin(self) -> None:
        self.value = 0

    def take(self, happened: Happened) -> None:
        assert isinstance(self.value, int)
        self.value += sum(
            pulse.amplitude > 0.0 and self._hand in ("any", pulse.hand)
            for pulse in happened.haptics
        )


class _Pose(_Source):
    def __init__(self, what: str) -> None:
        device, _, axis = what.partition(".")
        if device not in DEVICES or axis not in ("x", "y", "z"):
            raise ValueError(f"{what!r}; there are {', '.join(DEVICES)} with .x, .y and .z")
        self._place = DEVICES.index(device), "xyz".index(axis)

    def take(self, happened: Happened) -> None:
        self.value = float(happened.poses[self._place])


@dataclass
class _Value:
    source: _Source
    compare: Callable[[float, float], bool] | None = None
    limit: float = 0.0

    @property
    def value(self) -> AppValue:
        found = self.source.value
        if self.compare is None or found is None or isinstance(found, tuple):
            return found if self.compare is None else False
        return self.compare(float(found), self.limit)


class ProgramValues:
    """The values of one program in one round.

    Args:
        expressions: name -> expression.

    Raises:
        AppRefused: an expression that is none; says which there are.
    """

    def __init__(self, expressions: Mapping[str, str]) -> None:
        self._values = {name: _parsed(text) for name, text in expressions.items()}

    @property
    def of_lines(self) -> bool:
        """True if any value is read from printed lines."""
        return any(
            isinstance(one.source, _Texts) and one.source._kind == "printed"
            for one in self._values.values()
        )

    def begin(self) -> None:
        """Begin a round."""
        for one in self._values.values():
            one.source.begin()

    def take(self, happened: Happened) -> dict[str, AppValue]:
        """Take in a step; returns the values after it."""
        for one in self._values.values():
            one.source.take(happened)
        return {name: one.value for name, one in self._values.items()}


def _parsed(text: str) -> _Value:
    match = _FORM.fullmatch(text)
    try:
        if match is None:
            raise ValueError("another form")
        function, quoted, sign, limit = match.groups()
        words = quoted[1:-1].replace('\\"', '"')
        source = _source(function, words)
        if sign is None:
            return _Value(source)
        if sign not in _COMPARISONS:
            raise ValueError(f"{sign!r} behind it")
        return _Value(source, _COMPARISONS[sign], float(limit))
    except ValueError as error:
        raise AppRefused(
            f"task: got the expression {text!r} with {error}, expected {_EXPECTED}"
        ) from error


def _source(function: str, words: str) -> _Source:
    match function:
        case "printed" | "label":
            return _Texts(function, words)
        case "haptics":
            return _Haptics(words)
        case "pose":
            return _Pose(words)
    raise ValueError(f"{function!r}")
