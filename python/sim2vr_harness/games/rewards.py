"""The seam between a game's reward and those who look at it without playing: terms as formulas."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sim2vr_harness.base.errors import InputError

When = Literal["step", "arrival", "absence"]

NAMES: dict[str, str] = {
    "x": "distance to the target, m",
    "v": "speed towards the target, m/s",
    "t": "time since the movement began, s",
    "dt": "length of a user step, s",
}
"""What a formula may use."""

_CALLS: dict[str, Callable[..., float]] = {
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "abs": abs,
    "min": min,
    "max": max,
}
_OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_LONGEST = 300


class Formula:
    """Arithmetic in :data:`NAMES`: numbers, + - * / **, comparisons, ``a if b else c``, functions.

    Args:
        text: The formula.
        field: Where it was written, for errors.

    Raises:
        InputError: It is no such formula.
    """

    def __init__(self, text: str | float, field: str = "value") -> None:
        self.text, self._field = str(text), field
        if len(self.text) > _LONGEST:
            raise self._wrong(f"{len(self.text)} characters", f"at most {_LONGEST}")
        try:
            self._tree = ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise self._wrong(repr(self.text), f"a formula in {', '.join(NAMES)}") from error
        self._check(self._tree)

    def _wrong(self, got: str, expected: str) -> InputError:
        return InputError(self._field, got, expected)

    def _check(self, node: ast.AST) -> None:
        match node:
            case ast.Constant(value=bool()) | ast.Constant(value=complex()):
                pass
            case ast.Constant(value=int() | float()):
                return
            case ast.Name(id=name) if name in NAMES:
                return
            case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=inner):
                return self._check(inner)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                self._check(left)
                return self._check(right)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _OPERATORS:
                self._check(left)
                return self._check(right)
            case ast.IfExp(test=test, body=body, orelse=other):
                for part in (test, body, other):
                    self._check(part)
                return
            case ast.Call(func=ast.Name(id=name), args=[_, *_] as args, keywords=[]) if (
                name in _CALLS
            ):
                for argument in args:
                    self._check(argument)
                return
        known = ", ".join((*NAMES, *_CALLS))
        raise self._wrong(
            f"{ast.unparse(node)!r} in {self.text!r}", f"numbers, + - * / **, and {known}"
        )

    def __call__(self, **values: float) -> float:
        """Return its value.

        Raises:
            InputError: It has none there, such as at a division by 0.
        """
        try:
            value = float(self._value(self._tree, values))
        except (ArithmeticError, ValueError, TypeError) as error:
            value = math.nan
            raise self._wrong(
                f"{self.text!r}, which has no value at {values}", "a number"
            ) from error
        if not math.isfinite(value):
            raise self._wrong(f"{self.text!r}, which is {value} at {values}", "a finite number")
        return value

    def _value(self, node: ast.AST, values: Mapping[str, float]) -> Any:
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                return values[name]
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return -self._value(inner, values)
            case ast.UnaryOp(operand=inner):
                return self._value(inner, values)
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self._value(left, values), self._value(right, values)
                if isinstance(op, ast.Pow) and abs(b) > 100:
                    raise OverflowError("too high a power")
                return _OPERATORS[type(op)](a, b)
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return _OPERATORS[type(op)](self._value(left, values), self._value(right, values))
            case ast.IfExp(test=test, body=body, orelse=other):
                return self._value(body if self._value(test, values) else other, values)
            case ast.Call(func=ast.Name(id=name), args=args):
                return _CALLS[name](*(self._value(argument, values) for argument in args))
        raise AssertionError(f"checked before: {ast.dump(node)}")


@dataclass(frozen=True)
class Term:
    """A part of a reward.

    Attributes:
        name: For people.
        when: ``step``: in every user step, until the target is gone; ``arrival``: once, at the
            target; ``absence``: once, at the end, where no one came.
        value: What it is worth.
    """

    name: str
    when: When
    value: Formula


@dataclass(frozen=True)
class RewardTerms:
    """A reward, as far as one movement to one target goes.

    Attributes:
        name: Of the game or task.
        terms: Its parts.
        start_m: How far away a movement begins.
        reached_m: How near is there.
        seconds: How long a movement has, at most.
        stays: Whether the target stays after it was reached, and with it the terms of each step.
    """

    name: str
    terms: tuple[Term, ...]
    start_m: float = 0.5
    reached_m: float = 0.025
    seconds: float = 1.0
    stays: bool = False
