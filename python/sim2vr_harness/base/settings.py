"""Base class of all configuration models: bounds, and errors of one sentence."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin

import pydantic
from pydantic import BaseModel, ConfigDict, Field

from sim2vr_harness.base.errors import InputError, shown

MOST_STEPS = 10**12
"""User steps, frames and other counts of a training; at 10,000 a second three years."""

Chance = Annotated[float, Field(ge=0.0, le=1.0)]
"""A share of a whole."""
Factor = Annotated[float, Field(gt=0.0, le=1e6)]
"""Factor of a product."""
Norm = Annotated[float, Field(gt=0.0, le=1e12)]
"""That gradients are cut to; a great one cuts none."""
LearningRate = Annotated[float, Field(gt=0.0, le=1.0)]
Weight = Annotated[float, Field(ge=0.0, le=1e6)]
"""Of a term that is added, or a standard deviation; 0 leaves it out."""
Width = Annotated[int, Field(ge=1, le=8192)]
"""Of a layer of a network."""


class _OneSentence(type(BaseModel)):  # type: ignore[misc]
    """Lets ``Physique(stature_m=9)`` say in one sentence what is wrong, as a file's reader does."""

    def __call__(cls, *args: Any, **values: Any) -> Any:
        try:
            return super().__call__(*args, **values)
        except pydantic.ValidationError as error:
            raise first_problem(error, cls) from error


if TYPE_CHECKING:
    _Model = BaseModel
else:

    class _Model(BaseModel, metaclass=_OneSentence):
        """Model whose constructor reports errors in one sentence; hidden from the type checker."""


class Settings(_Model):
    """Unknown keys and numbers that are not finite are errors; values do not change.

    Every number has bounds, below and above (``tests/python/test_bounds.py``): what cannot be meant
    is refused before it overflows, divides by zero or never ends.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def check_whole_minibatches(steps_per_iteration: int, batch_size: int) -> None:
    """Raise ValueError unless an iteration's user steps make a whole number of minibatches."""
    if steps_per_iteration % batch_size:
        raise ValueError(
            f"batch_size: got {batch_size}, expected a divisor of n_envs * n_steps = "
            f"{steps_per_iteration}"
        )


# --- words for what is wrong ------------------------------------------------------------------


def first_problem(
    error: pydantic.ValidationError, model: type[BaseModel], below: Sequence[str] = ()
) -> InputError:
    """Word the first of pydantic's problems: dotted key, got, expected.

    Args:
        error: of pydantic.
        model: the one that was validated.
        below: keys that lead to ``model``.
    """
    # An unknown key explains more than the wrong value it may have caused.
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    return _input_error(problems[0], below, model)


def _input_error(problem: Any, below: Sequence[str], model: type[BaseModel]) -> InputError:
    """Word one of pydantic's problems: dotted key, got, expected.

    Args:
        problem: of pydantic.
        below: keys that lead to ``model``.
        model: the one that was validated.
    """
    location = _written(model, problem["loc"])
    field = ".".join([*below, *location]) or "configuration"
    if problem["type"] == "extra_forbidden":
        root = model
        key_model = model_at(location[:-1], root)
        known = list(key_model.model_fields) if key_model else []
        prefix = "".join(f"{part}." for part in [*below, *location[:-1]])
        # One of names that is most like name, the first of equals; None if none.
        name = location[-1]
        likeness = [difflib.SequenceMatcher(None, name, each).ratio() for each in known]
        alike = max(likeness, default=0.0)
        near = known[likeness.index(alike)] if alike >= _LIKE else None
        here = prefix + near if near else None
        # What was written without its mapping is meant wherever it is; else it is meant here.
        best = here if prefix and here else _elsewhere(location[-1], root) or here
        hint = f" (did you mean {best!r}?)" if best else ""
        return InputError(
            prefix + location[-1], "an unknown key", f"one of {', '.join(known) or 'no keys'}{hint}"
        )
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] == "value_error":
        key, separator, rest = message.partition("got ")
        if separator and (not key or key.endswith(": ")):
            got, _, expected = rest.partition(", expected ")
            inner = [*below, *location, key[:-2]] if key else [field]
            return InputError(".".join(inner), got, expected)
    expected = message.removeprefix("Input should be ")
    if problem["type"] == "model_type":
        expected = "a mapping of keys to values"
    elif problem["type"] in _WORDS:
        expected = _WORDS[problem["type"]]
    elif problem["type"] == "string_pattern_mismatch":
        expected = f"text like {problem['ctx']['pattern']}"
    elif problem["type"] in ("too_short", "too_long"):
        least = problem["type"] == "too_short"
        count = problem["ctx"]["min_length" if least else "max_length"]
        expected = f"at {'least' if least else 'most'} {count} entries"
    got = "nothing" if problem["type"] == "missing" else shown(problem["input"])
    return InputError(field, got, expected[:1].lower() + expected[1:])


_WORDS = {
    "missing": "a value: this key is needed",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_parsing": "a number",
    "float_type": "a number",
    "bool_parsing": "true or false",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a mapping of keys to values",
}


def _written(model: type[BaseModel], location: Sequence[Any]) -> list[str]:
    """Return the keys of a problem as people write them: without the members of a union."""
    parts: list[str] = []
    for part in (str(part) for part in location):
        if part == "[key]" or part.startswith(_PYDANTICS):
            continue
        above = model_at(parts, model)
        inside_value = above is None and parts and model_at(parts[:-1], model) is None
        if inside_value and part in _UNION_MEMBERS:
            break
        parts.append(part)
    return parts


_PYDANTICS = ("function-", "constrained-", "literal[")
"""Beginnings of the names that pydantic generates."""
_UNION_MEMBERS = ("bool", "int", "float", "str", "list[float]")


_LIKE = 0.4


def _elsewhere(name: str, root: type[BaseModel]) -> str | None:
    """Return the dotted key of the field called ``name`` that is nearest to the top, if one is."""
    matches = [key for key in _all_keys(root) if key.rpartition(".")[2] == name]
    depth = min((key.count(".") for key in matches), default=0)
    nearest = [key for key in matches if key.count(".") == depth]
    return nearest[0] if len(nearest) == 1 else None


def _all_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for name, field in model.model_fields.items():
        keys.append(prefix + name)
        child = _as_model(field.annotation)
        if child is not None:
            keys += _all_keys(child, f"{prefix}{name}.")
    return keys


def model_at(location: Sequence[str], root: type[BaseModel]) -> type[BaseModel] | None:
    """Return the model that these keys lead to from ``root``; None where there is none."""
    return _as_model(annotation_at(location, root))


def annotation_at(location: Sequence[str], root: type[BaseModel]) -> Any:
    """Return the declared type of the key that these names lead to; None where there is none."""
    at: Any = root
    for part in location:
        model = _as_model(at)
        if model is not None:
            field = model.model_fields.get(part)
            at = None if field is None else field.annotation
        else:
            plain = _without_none(at)
            if get_origin(plain) not in (tuple, dict):
                at = None
            else:
                at = get_args(plain)[get_origin(plain) is dict]
    return at


def _as_model(annotation: Any) -> type[BaseModel] | None:
    plain = _without_none(annotation)
    return plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None


def _without_none(annotation: Any) -> Any:
    if get_origin(annotation) not in (Union, UnionType):
        return annotation
    members = [member for member in get_args(annotation) if member is not type(None)]
    models = [one for one in members if isinstance(one, type) and issubclass(one, BaseModel)]
    if len(models) == 1:
        return models[0]  # beside which a name may stand for one
    return members[0] if len(members) == 1 else None
