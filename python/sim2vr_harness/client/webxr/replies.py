"""Validation of a page's replies: its scripts may have replaced anything."""

import base64
import sys
from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    StrictInt,
    TypeAdapter,
)

from sim2vr_harness.client.answers import (
    Amplitude,
    Duration,
    Number,
    Place,
    Rotation,
    Text,
    bad_reply,
    checked,
)
from sim2vr_harness.client.base import AppValue
from sim2vr_harness.client.devices import Hand

Texts = Annotated[tuple[Text, ...], Field(max_length=200)]
Failure = tuple[Text, Text] | None
"""Its kind and why the page cannot go on; None: it can."""


def _value(answer: object) -> object:
    parts = answer if isinstance(answer, list) and len(answer) == 3 else [answer]
    if answer is None or isinstance(answer, bool):
        return answer
    if not all(
        isinstance(one, (int, float))
        and not isinstance(one, bool)
        and abs(one) <= sys.float_info.max  # not NaN either
        for one in parts
    ):
        raise ValueError("a finite number, true or false, null, or x y z")
    return tuple(map(float, parts)) if isinstance(answer, list) else answer


def _bytes(answer: object) -> object:
    return base64.b64decode(answer, validate=True) if isinstance(answer, str) else answer


def _png(answer: object) -> object:
    return _bytes(answer.removeprefix(_PNG)) if isinstance(answer, str) else answer


_PNG = "data:image/png;base64,"
PNG = Annotated[bytes, BeforeValidator(_png)]


class Reply(BaseModel):
    """An object of a page's, without other keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Pulse(NamedTuple):
    """A vibration that the page requested."""

    hand: Hand
    amplitude: Amplitude
    duration_s: Duration


class Value(NamedTuple):
    """The value of an expression, or why it has none."""

    name: Text
    value: Annotated[AppValue, BeforeValidator(_value)]
    lacks: Text | None = None


class StepReply(Reply):
    """The answer to a step."""

    haptics: Annotated[tuple[Pulse, ...], Field(max_length=10_000)]
    ended: StrictBool
    """True if the page ended its session."""
    failure: Failure
    values: tuple[Value, ...]
    places: tuple[Place | None, ...]
    """Of the objects that were sought; None: there is none of the name."""
    picture: Annotated[bytes | None, BeforeValidator(_bytes)]
    """Of the drawn frame; None: none was drawn."""
    observed: Annotated[tuple[PNG, ...], Field(max_length=4)] = ()
    """Of the drawn frame's observers; below the colours is the depth, if it is requested."""


class DoorReply(Reply):
    """Progress of a page towards VR."""

    done: StrictBool = False
    """True if the page has entered VR, or will not."""
    failure: Failure = None
    click: StrictBool = False
    """True if an element has to be clicked first."""
    at: tuple[Number, Number] | None = None
    """Position of the element for the mouse, x y in CSS pixels; None: it has none."""


@dataclass(frozen=True)
class PageReport:
    """Engines, objects and inputs of a page, and the sessions that it requests."""

    __pydantic_config__ = ConfigDict(extra="forbid")
    engines: Texts = ()
    """Names with versions."""
    sessions: Texts = ()
    """Kinds that it asks about."""
    features: Texts = ()
    """Of the sessions that it asks for."""
    objects: Texts = ()
    """Names of its scene's objects."""
    inputs: Texts = ()
    """Events and parts of controllers that it listens to or reads."""


class Thing(NamedTuple):
    """An object of a page that people may be able to use.

    Attributes:
        name: unique.
        how: by what it listens to; ``unknown``: it does not.
        place_m: middle, right, up, ahead.
        half_m: half of its size along these axes.
        events: that it has received.
        state: changes with where it is and how it looks.
    """

    name: Text
    how: Literal["touch", "point", "look", "unknown"]
    place_m: Place
    half_m: Place
    events: StrictInt
    state: StrictInt


class Signs(NamedTuple):
    """Perceptible state of a page at a moment.

    Attributes:
        objects: object's number -> a number that changes with its appearance.
        sounds: number of sounds that were started or stopped so far.
        text: number that changes with the text of the document.
        rays: origins and directions of the latest rays that the page tested objects against, app
            frame.
    """

    objects: Annotated[dict[int, StrictInt], Field(max_length=1000)]
    sounds: StrictInt
    text: StrictInt
    rays: Annotated[tuple[tuple[Place, Place], ...], Field(max_length=16)]


class Box(NamedTuple):
    """A box around something that a page shows, app frame.

    Attributes:
        name: of it, or of what it belongs to.
        place: of its middle, x y z in m.
        rotation: x y z w, not normalised.
        size: along its own axes, m.
        color: red, green, blue (sRGB) and opacity, 0 to 1.
    """

    name: Text
    place: Place
    rotation: Rotation
    size: Place
    color: Rotation


STEP = TypeAdapter(StepReply)
DOOR = TypeAdapter(DoorReply)
REPORT = TypeAdapter(PageReport)
SIGNS = TypeAdapter(Signs)
THINGS: TypeAdapter[tuple[Thing, ...]] = TypeAdapter(
    Annotated[tuple[Thing, ...], Field(max_length=200)]
)
BOXES: TypeAdapter[tuple[Box, ...]] = TypeAdapter(Annotated[tuple[Box, ...], Field(max_length=500)])
PLACE: TypeAdapter[tuple[float, float, float]] = TypeAdapter(Place)
TEXT: TypeAdapter[str] = TypeAdapter(Text)


def step_reply(
    answer: object, names: Collection[str], places: int, picture_bytes: int
) -> StepReply:
    """Return a step's answer.

    Args:
        answer: as it came.
        names: of the expressions that it must hold.
        places: number of objects that were sought.
        picture_bytes: size of a picture.

    Raises:
        BadReply: it is another thing.
    """
    reply = checked("a step's answer", STEP, answer)
    given = [one.name for one in reply.values]
    if sorted(given) != sorted(names):
        raise bad_reply("values", given, f"one of each: {', '.join(names)}")
    if len(reply.places) != places:
        raise bad_reply("places", len(reply.places), str(places))
    if reply.picture is not None and len(reply.picture) != picture_bytes:
        raise bad_reply("picture", f"{len(reply.picture)} bytes", f"{picture_bytes}")
    return reply
