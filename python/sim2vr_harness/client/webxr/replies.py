"""Validation of a page's replies: its scripts may have replaced anything."""

import base64
import math
from collections.abc import Collection
from dataclasses import dataclass, fields

from sim2vr_harness.client.answers import (
    BadReply,
    bad_reply,
    list_in,
    number_in,
    pulse_in,
    text_in,
    truth_in,
)
from sim2vr_harness.client.base import AppValue
from sim2vr_harness.client.devices import HapticPulse

__all__ = [
    "BadReply",
    "Box",
    "DoorReply",
    "PageReport",
    "Signs",
    "StepReply",
    "Thing",
    "boxes_reply",
    "door_reply",
    "place_in",
    "report_reply",
    "signs_reply",
    "step_reply",
    "text_in",
    "things_reply",
]

MOST_TEXTS = 200
MOST_THINGS = 200
MOST_BOXES = 500
MOST_OBJECTS = 1000
MOST_RAYS = 16
MOST_PULSES = 10_000
"""Vibrations of one step."""


@dataclass(frozen=True)
class StepReply:
    """The answer to a step.

    Attributes:
        haptics: vibrations, in order.
        ended: whether the page ended its session.
        failure: why the page cannot go on; None: it can.
        values: of the expressions that have one, by name.
        lacking: of the other expressions, by name: why not.
        picture: bytes of the drawn frame; None: none was drawn.
    """

    haptics: tuple[HapticPulse, ...]
    ended: bool
    failure: str | None
    values: dict[str, AppValue]
    lacking: dict[str, str]
    picture: bytes | None


@dataclass(frozen=True)
class DoorReply:
    """How far a page is on its way into VR.

    Attributes:
        done: whether it has entered, or will not.
        failure: why it will not; None otherwise.
        click: whether an element is to be clicked first.
        at: where the mouse meets it, x y in CSS pixels; None: nowhere.
    """

    done: bool = False
    failure: str | None = None
    click: bool = False
    at: tuple[float, float] | None = None


@dataclass(frozen=True)
class PageReport:
    """What a page is made of and asks for.

    Attributes:
        engines: names with versions.
        sessions: kinds that it asks about.
        features: of the sessions that it asks for.
        objects: names of its scene's objects.
        inputs: events and parts of controllers that it listens to or reads.
    """

    engines: tuple[str, ...] = ()
    sessions: tuple[str, ...] = ()
    features: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Thing:
    """An object of a page that people may be able to use.

    Attributes:
        name: unique.
        how: ``touch``, ``point`` or ``look``, by what it listens to; ``unknown``: it does not.
        place_m: middle, right, up, ahead.
        half_m: half of its size along these axes.
        events: that it has received.
        state: changes with where it is and how it looks.
    """

    name: str
    how: str
    place_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    events: int
    state: int


def things_reply(answer: object) -> tuple[Thing, ...]:
    """Return the objects of a page that people may use; raises :class:`BadReply`."""
    rows = list_in("things", answer, MOST_THINGS)
    return tuple(_thing_in(row) for row in rows)


def _thing_in(row: object) -> Thing:
    if not isinstance(row, list) or len(row) != 6:
        raise bad_reply("things", row, "name, how, place, half of the size, events, state")
    name, how = text_in("things, name", row[0]), text_in("things, how", row[1])
    if how not in ("touch", "point", "look", "unknown"):
        raise bad_reply("things, how", how, "touch, point, look or unknown")
    events, state = (int(number_in("things", each)) for each in row[4:])
    place, half = place_in("things, place", row[2]), place_in("things, half of the size", row[3])
    return Thing(name, how, place, half, events, state)


@dataclass(frozen=True)
class Signs:
    """What people may notice of a page at a moment.

    Attributes:
        objects: how each object looks: its number -> a number that changes with it.
        sounds: that were started or stopped so far.
        text: changes with the text of the document.
        rays: origin and direction of those that the page last tested objects against, app frame.
    """

    objects: dict[int, int]
    sounds: int
    text: int
    rays: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]


def signs_reply(answer: object) -> Signs:
    """Return what people may notice of a page; raises :class:`BadReply`."""
    if not isinstance(answer, list) or len(answer) != 4:
        raise bad_reply("signs", answer, "objects, sounds, text, rays")
    objects = [_two_in("signs, object", row) for row in list_in("signs", answer[0], MOST_OBJECTS)]
    rays = [_two_in("signs, ray", row) for row in list_in("signs, rays", answer[3], MOST_RAYS)]
    return Signs(
        {int(number_in("signs", a)): int(number_in("signs", b)) for a, b in objects},
        int(number_in("signs, sounds", answer[1])),
        int(number_in("signs, text", answer[2])),
        tuple((place_in("signs, ray", a), place_in("signs, ray", b)) for a, b in rays),
    )


def _two_in(what: str, row: object) -> tuple[object, object]:
    if not isinstance(row, list) or len(row) != 2:
        raise bad_reply(what, row, "a pair")
    return row[0], row[1]


@dataclass(frozen=True)
class Box:
    """A box around something that a page shows, app frame.

    Attributes:
        name: of it, or of what it belongs to.
        place: of its middle, x y z in m.
        rotation: x y z w, not normalised.
        size: along its own axes, m.
        color: red, green, blue (sRGB) and opacity, 0 to 1.
    """

    name: str
    place: tuple[float, ...]
    rotation: tuple[float, ...]
    size: tuple[float, ...]
    color: tuple[float, ...]


def boxes_reply(answer: object) -> tuple[Box, ...]:
    """Return what a page shows, as boxes; raises :class:`BadReply`."""
    return tuple(_box_in(row) for row in list_in("boxes", answer, MOST_BOXES))


def _box_in(row: object) -> Box:
    if not isinstance(row, list) or len(row) != 5:
        raise bad_reply("boxes", row, "name, place, rotation, size, colour")
    counts = {"place": 3, "rotation": 4, "size": 3, "color": 4}
    parts = {
        name: numbers_in(f"boxes, {name}", each, count)
        for (name, count), each in zip(counts.items(), row[1:], strict=True)
    }
    return Box(text_in("boxes, name", row[0]), **parts)


def report_reply(answer: object) -> PageReport:
    """Return what a page is made of; raises :class:`BadReply`."""
    keys = tuple(each.name for each in fields(PageReport))
    if not isinstance(answer, dict) or set(answer) != set(keys):
        raise bad_reply("the report", answer, f"an object of {', '.join(keys)}")
    lists = {key: list_in(key, answer[key], MOST_TEXTS) for key in keys}
    return PageReport(**{key: tuple(text_in(key, one) for one in lists[key]) for key in keys})


def door_reply(answer: object) -> DoorReply:
    """Return how far a page is; raises :class:`BadReply`."""
    match answer:
        case ["more"]:
            return DoorReply()
        case ["done", failure]:
            return DoorReply(done=True, failure=_failure_in(failure))
        case ["click"]:
            return DoorReply(click=True)
        case ["click", x, y]:
            return DoorReply(click=True, at=(number_in("click", x), number_in("click", y)))
    raise bad_reply("the way into VR", answer, "more, done or click")


def step_reply(answer: object, names: Collection[str], picture_bytes: int) -> StepReply:
    """Return a step's answer.

    Args:
        answer: as it came.
        names: of the expressions that it must hold.
        picture_bytes: size of a picture.

    Raises:
        BadReply: it is another thing.
    """
    keys = ("haptics", "ended", "failure", "values", "picture")
    if not isinstance(answer, dict) or set(answer) != set(keys):
        raise bad_reply("a step's answer", answer, f"an object of {', '.join(keys)}")
    pulses = list_in("haptics", answer["haptics"], MOST_PULSES)
    values, lacking = _values_in(answer["values"], names)
    return StepReply(
        haptics=tuple(_pulse_in(one) for one in pulses),
        ended=truth_in("ended", answer["ended"]),
        failure=_failure_in(answer["failure"]),
        values=values,
        lacking=lacking,
        picture=_picture_in(answer["picture"], picture_bytes),
    )


def _failure_in(answer: object) -> str | None:
    """Return why a page cannot go on, None if it can; raises :class:`BadReply`."""
    if answer is None:
        return None
    if not isinstance(answer, list) or len(answer) != 2:
        raise bad_reply("failure", answer, "null, or a kind and a text")
    return text_in("failure", answer[1])


def place_in(what: str, answer: object) -> tuple[float, float, float]:
    """Return a place x y z; raises :class:`BadReply`."""
    x, y, z = numbers_in(what, answer, 3)
    return x, y, z


def numbers_in(what: str, answer: object, count: int) -> tuple[float, ...]:
    """Return so many finite numbers; raises :class:`BadReply`."""
    if not isinstance(answer, list) or len(answer) != count:
        words = {3: "three", 4: "four"}
        raise bad_reply(what, answer, f"{words[count]} finite numbers")
    return tuple(number_in(what, part) for part in answer)


def _values_in(
    answer: object, names: Collection[str]
) -> tuple[dict[str, AppValue], dict[str, str]]:
    values: dict[str, AppValue] = {}
    lacking: dict[str, str] = {}
    for row in list_in("values", answer, len(names)):
        if not isinstance(row, list) or len(row) not in (2, 3) or row[0] not in [*names]:
            raise bad_reply("values", row, "a known name, its value, and an error if there is one")
        if len(row) == 3:
            lacking[row[0]] = text_in(f"values.{row[0]}", row[2])
        else:
            values[row[0]] = _value_in(f"values.{row[0]}", row[1])
    if len(values) + len(lacking) != len(names):
        raise bad_reply("values", [*values, *lacking], f"one of each: {', '.join(names)}")
    return values, lacking


def _value_in(what: str, answer: object) -> AppValue:
    if answer is None or isinstance(answer, bool):
        return answer
    if isinstance(answer, list):
        return place_in(what, answer)
    if isinstance(answer, int) and math.isfinite(number_in(what, answer)):
        return answer
    return number_in(what, answer)


def _pulse_in(answer: object) -> HapticPulse:
    if not isinstance(answer, list) or len(answer) != 3:
        raise bad_reply("haptics", answer, "a hand, an amplitude and a duration")
    return pulse_in(*answer)


def _picture_in(answer: object, picture_bytes: int) -> bytes | None:
    if answer is None:
        return None
    if not isinstance(answer, str):
        raise bad_reply("picture", answer, "a text in base64")
    try:
        content = base64.b64decode(answer, validate=True)
    except ValueError as error:
        raise bad_reply("picture", answer, "a text in base64") from error
    if len(content) != picture_bytes:
        raise bad_reply("picture", f"{len(content)} bytes", f"{picture_bytes}")
    return content
