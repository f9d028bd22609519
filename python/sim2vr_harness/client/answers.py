"""Types of what an app may answer, for pydantic, and the words for what is another thing.

An app may answer anything. A part that cannot be used raises :class:`BadReply`, which the
transports turn into the failure of that one app.
"""

import json
import reprlib
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, Field, StrictStr, TypeAdapter, ValidationError

T = TypeVar("T")

DEEPEST = 100
"""Lists and objects within each other in a JSON text; those of apps have fewer than ten."""
MOST_CHARACTERS = 500
"""Of a text that an app answers with."""
LARGEST = 3.402823567e38
"""Larger numbers are infinite in binary32."""
SHORTEST_S = -1e-9
"""Duration of the shortest vibration that a device can (``XR_MIN_HAPTIC_DURATION``)."""

UNREADABLE = (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)
"""Raised where an answer is read whose parts are other things than expected."""


def lasting(duration_s: float) -> float:
    """Return the duration of a vibration; ValueError if it has none."""
    if duration_s < 0.0 and duration_s != SHORTEST_S:
        raise ValueError("0 or more")
    return duration_s


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Binary32 = Annotated[Number, Field(ge=-LARGEST, le=LARGEST)]
Text = Annotated[StrictStr, AfterValidator(lambda text: " ".join(text[:MOST_CHARACTERS].split()))]
"""In one line, cut to a length."""
Place = tuple[Number, Number, Number]
Rotation = tuple[Number, Number, Number, Number]
Amplitude = Annotated[Number, Field(ge=0.0, le=1.0)]
Frequency = Annotated[Number, Field(ge=0.0)]
Duration = Annotated[Number, AfterValidator(lasting)]
"""Seconds of a vibration."""


class _Pitch(BaseModel):
    """The head's pitch, degrees up, that an app wishes for; None: no wish."""

    pitch_deg: Number | None = None


PITCH = TypeAdapter(_Pitch)
OBJECT: TypeAdapter[dict[str, Any]] = TypeAdapter(dict[str, Any])


class BadReply(ValueError):
    """A part of an answer that cannot be used: which part, got and expected."""


def bad_reply(what: str, got: object, expected: str) -> BadReply:
    """Return the error for a part; ``got`` is cut to a length."""
    return BadReply(f"{what}: got {reprlib.repr(got)}, expected {expected}")


_EXPECTED = {
    "extra_forbidden": "no such key",
    "unexpected_keyword_argument": "no such key",
    "tuple_type": "a list",
    "named_tuple_type": "a list",
    "too_long": "at most {max_length} entries",
    "dict_type": "a JSON object",
    "model_type": "a JSON object",
    "dataclass_type": "a JSON object",
    "less_than_equal": "at most {le:.3g}",
    "greater_than_equal": "at least {ge:.3g}",
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "a text",
}
"""Words for pydantic's kinds of errors; the others have pydantic's own."""


def checked(what: str, kind: TypeAdapter[T], answer: object) -> T:
    """Return an answer as a type has it.

    Raises:
        BadReply: it is another thing; names the first part that is.
    """
    try:
        return kind.validate_python(answer)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        part = ", ".join(map(str, [what, *problem["loc"]]))
        if problem["type"] == "missing":
            raise BadReply(f"{part}: got nothing, expected a value") from error
        words = str(problem["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
        if problem["type"] in _EXPECTED:
            words = _EXPECTED[problem["type"]].format(**problem.get("ctx", {}))
        raise bad_reply(part, problem["input"], words) from error


def json_in(what: str, text: bytes | str) -> Any:
    """Return what a JSON text holds; raises :class:`BadReply`."""
    try:
        content = json.loads(text)
        level = [content]
        for _ in range(DEEPEST + 1):
            wholes = [part for part in level if isinstance(part, (list, dict))]
            level = [
                part for one in wholes for part in (one.values() if isinstance(one, dict) else one)
            ]
            if not wholes:
                return content
    except RecursionError:
        pass
    except ValueError as error:
        raise bad_reply(what, text[:60], f"JSON ({error})") from error
    raise bad_reply(what, text[:60], f"JSON nested at most {DEEPEST} deep")


def read(what: str, kind: TypeAdapter[T], text: bytes | str) -> T:
    """Return what a JSON text holds as a type has it; raises :class:`BadReply`."""
    return checked(what, kind, json_in(what, text))
