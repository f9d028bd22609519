"""Steps of scripted users: ``touch NAME``, ``press NAME by ray``, and scripts of them in YAML."""

import difflib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field, field_validator

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.files import read_yaml
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.client.devices import HANDS, INPUT_NAMES

Place = str | tuple[float, float, float]
"""Name of an object, or x y z in metres, app frame."""
Hand = Literal["left", "right"]

FORMS = (
    "touch NAME [with TOOL]",
    "point NAME",
    "press NAME [by touch | by ray]",
    "grab NAME to NAME2",
    "reach NAME",
    "SCRIPT.yaml",
)
"""Forms of a scripted user; NAME is an object, or X Y Z in metres."""

_KINDS = tuple(dict.fromkeys(form.split()[0] for form in FORMS[:-1]))
_FARTHEST_M = 1000.0
_MOST_STEPS = 10_000
_AXES = 3


@dataclass(frozen=True)
class Step:
    """A step of a scripted user.

    Attributes:
        text: As written.
        kind: ``touch``, ``point``, ``press`` or ``grab``.
        place: Target of the step.
        to: Second place, to which ``grab`` moves the object.
        by: ``touch`` or ``ray``; None: touch for targets within reach, else ray.
        seconds: Time limit to arrive, and with ``grab`` again to move.
        hand: Hand that acts; None: the one that the task needs, or the right one.
        inputs: Names of the inputs that ``press`` and ``grab`` operate, without the hand; None: the
            task's trigger or squeeze.
        tool: Name of an object that the controller holds and that goes to ``place`` instead.
        entry: Number of its entry in the script.
        until: Number of the app or event of the task; its entry is repeated until that changes.
    """

    text: str
    kind: str
    place: Place
    to: Place | None = None
    by: Literal["touch", "ray"] | None = None
    seconds: float = 5.0
    hand: Hand | None = None
    inputs: tuple[str, ...] | None = None
    tool: str | None = None
    entry: int = 0
    until: str | None = None


def is_script(user: str) -> bool:
    """Return True if ``--user`` names a scripted user: a step in words, or a YAML file."""
    words = user.split()
    if user.endswith((".yaml", ".yml")):
        return True
    return bool(words) and (
        words[0] in _KINDS
        or (len(words) > 1 and bool(difflib.get_close_matches(words[0], _KINDS, n=1, cutoff=0.6)))
    )


def read_steps(user: str) -> tuple[Step, ...]:
    """Return the steps of ``--user``.

    Raises:
        InputError: The words are of another form, or the file cannot be used.
    """
    if not user.endswith((".yaml", ".yml")):
        return (parse_step(user, "--user"),)
    file = Path(user).expanduser()
    content = read_yaml(file, "a list of steps in YAML")
    if not isinstance(content, list) or not content:
        got = "no steps" if content in (None, []) else shown(content)
        raise InputError(str(file), got, "a list of steps, such as - touch NAME")
    steps = [
        replace(step, entry=k)
        for k, one in enumerate(content, 1)
        for step in _of_entry(one, f"{file}: {k}")
    ]
    if len(steps) > _MOST_STEPS:
        raise InputError(str(file), f"{len(steps):,} steps", f"at most {_MOST_STEPS:,}")
    return tuple(steps)


class _Entry(Settings):
    """An entry of a script."""

    do: str | tuple[str, ...]
    """A step in words, or a list of them."""
    repeats: int = Field(default=1, ge=1, le=1000)
    """Number of times that the entry is executed."""
    until: Annotated[str | None, Field(max_length=200)] = None
    """Repeat until this number of the app, or event of the task, has changed."""
    seconds: float = Field(default=5.0, ge=0.1, le=600.0)
    """Time limit to arrive, s."""
    hand: Hand | None = None
    """Hand that acts; None: the one that the task needs, or the right one."""
    input: Annotated[str | None, Field(max_length=40)] = None
    """Input that ``press`` and ``grab`` operate: trigger, squeeze, a, ..."""
    tool: Annotated[str | None, Field(max_length=200)] = None
    """An object in the hand that touches instead of the controller."""

    @field_validator("input")
    @classmethod
    def _known_input(cls, name: str | None) -> str | None:
        known = dict.fromkeys(one.partition(".")[2] for one in INPUT_NAMES)
        if name is not None and name not in known:
            raise ValueError(f"got {name!r}, expected one of {', '.join(known)}")
        return name


def _of_entry(content: Any, field: str) -> list[Step]:
    """Return the steps of an entry: words, or a mapping.

    Raises:
        InputError: It is something else.
    """
    if isinstance(content, str):
        return [parse_step(content, field)]
    if not isinstance(content, dict):
        raise InputError(field, shown(content), f"a step: {_forms()}, or a mapping with do")
    try:
        entry = _Entry.model_validate(content)
    except pydantic.ValidationError as error:
        raise first_problem(error, _Entry, (field,)) from error
    texts = (entry.do,) if isinstance(entry.do, str) else entry.do
    if not texts:
        raise InputError(f"{field}.do", "an empty list", "at least one step")
    common: dict[str, Any] = {
        "seconds": entry.seconds,
        "hand": entry.hand,
        "inputs": None if entry.input is None else (entry.input,),
        "until": entry.until,
    }
    if entry.tool is not None:
        common["tool"] = entry.tool
    steps = [replace(parse_step(text, field), **common) for text in texts]
    for step in steps:
        # Refuse an input that no hand, or not the step's, has.
        for name in step.inputs or ():
            hands = [hand for hand in HANDS if f"{hand}.{name}" in INPUT_NAMES]
            if step.hand is not None and step.hand not in hands:
                raise InputError(
                    f"{field}.input", f"{name!r} of the {step.hand} hand", "another input"
                )
    return steps * entry.repeats


def parse_step(text: str, field: str) -> Step:
    """Return the step that words describe.

    Args:
        text: Such as ``grab handle to 0.1 1.0 0.3``.
        field: What the error names.

    Raises:
        InputError: The words have another form.
    """
    kind, _, rest = text.strip().partition(" ")
    rest = rest.strip()
    if kind not in _KINDS:
        raise unknown_name(field, kind, _KINDS)
    wanted = [form for form in FORMS if form.split()[0] == kind]
    if not rest:
        raise InputError(field, repr(text), wanted[0])
    if kind == "grab":
        name, _, to = rest.rpartition(" to ")
        if not name.strip() or not to.strip():
            raise InputError(field, repr(text), wanted[0])
        return Step(text, kind, _place(name, field), to=_place(to, field), by="touch")
    tool = None
    if kind == "touch" and " with " in rest:
        rest, _, tool = rest.rpartition(" with ")
    by: Literal["touch", "ray"] | None = "ray" if kind == "point" else "touch"
    if kind == "press":
        by = None
        for way in ("touch", "ray"):
            if rest.endswith(f" by {way}"):
                by, rest = way, rest.removesuffix(f" by {way}")
    kind = "touch" if kind == "reach" else kind
    return Step(text, kind, _place(rest, field), by=by, tool=tool)


def _place(text: str, field: str) -> Place:
    """Return three numbers as a place, other words as a name."""
    words = text.strip().split()
    numbers = [_number(word) for word in words]
    if len(words) != _AXES or None in numbers:
        return text.strip()
    if any(not math.isfinite(x) or abs(x) > _FARTHEST_M for x in numbers if x is not None):
        raise InputError(field, shown(text), f"X Y Z within {_FARTHEST_M:,.0f} m")
    x, y, z = (float(word) for word in words)
    return (x, y, z)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _forms() -> str:
    return ", ".join(FORMS[:-2])
