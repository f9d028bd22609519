"""Parts of what an app answers, checked: JSON, numbers, truths, texts and lists.

An app may answer anything. A part that cannot be used raises :class:`BadReply`, which the
transports turn into the failure of that one app.
"""

import json
import math
import reprlib
from typing import Any

from sim2vr_harness.client.devices import HANDS, HapticPulse

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


class BadReply(ValueError):
    """A part of an answer that cannot be used: which part, got and expected."""


def bad_reply(what: str, got: object, expected: str) -> BadReply:
    """Return the error for a part; ``got`` is cut to a length."""
    return BadReply(f"{what}: got {reprlib.repr(got)}, expected {expected}")


def json_in(what: str, text: bytes | str) -> Any:
    """Return what a JSON text holds; raises :class:`BadReply`."""
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise _too_deep(what, text) from error
    except ValueError as error:
        raise bad_reply(what, text[:60], f"JSON ({error})") from error
    level = [content]
    for _ in range(DEEPEST):
        level = [part for whole in level for part in _parts(whole)]
        if not level:
            return content
    raise _too_deep(what, text)


def object_in(what: str, text: bytes | str) -> dict[str, Any]:
    """Return the object that a JSON text holds; raises :class:`BadReply`."""
    content = json_in(what, text)
    if not isinstance(content, dict):
        raise bad_reply(what, content, "a JSON object")
    return content


def number_in(what: str, answer: object, most: float = math.inf) -> float:
    """Return a finite number of at most that magnitude; raises :class:`BadReply`."""
    if isinstance(answer, bool) or not isinstance(answer, (int, float)):
        raise bad_reply(what, answer, "a finite number")
    try:
        number = float(answer)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise bad_reply(what, answer, "a finite number")
    if abs(number) > most:
        raise bad_reply(what, answer, f"a number from -{most:.3g} to {most:.3g}")
    return number


def truth_in(what: str, answer: object) -> bool:
    """Return true or false; raises :class:`BadReply`."""
    if not isinstance(answer, bool):
        raise bad_reply(what, answer, "true or false")
    return answer


def text_in(what: str, answer: object) -> str:
    """Return a text in one line, cut to a length; raises :class:`BadReply`."""
    if not isinstance(answer, str):
        raise bad_reply(what, answer, "a text")
    return " ".join(answer[:MOST_CHARACTERS].split())


def pulse_in(
    hand: object, amplitude: object, duration_s: object, frequency_hz: object = 0.0
) -> HapticPulse:
    """Return a vibration; raises :class:`BadReply`."""
    known = next((one for one in HANDS if one == hand), None)
    if known is None:
        raise bad_reply("haptics, hand", hand, " or ".join(HANDS))
    strength = number_in("haptics, amplitude", amplitude)
    if not 0.0 <= strength <= 1.0:
        raise bad_reply("haptics, amplitude", strength, "0 to 1")
    length_s = number_in("haptics, duration in s", duration_s)
    if length_s < 0.0 and length_s != SHORTEST_S:
        raise bad_reply("haptics, duration in s", length_s, "0 or more")
    pitch_hz = number_in("haptics, frequency in Hz", frequency_hz)
    if pitch_hz < 0.0:
        raise bad_reply("haptics, frequency in Hz", pitch_hz, "0 or more")
    return HapticPulse(known, strength, pitch_hz, length_s)


def list_in(what: str, answer: object, most: int) -> list[Any]:
    """Return a list of at most that many entries; raises :class:`BadReply`."""
    if not isinstance(answer, list):
        raise bad_reply(what, answer, "a list")
    if len(answer) > most:
        raise bad_reply(what, f"{len(answer)} entries", f"at most {most}")
    return answer


def _parts(whole: object) -> list[Any]:
    """The lists and objects directly in a list or object."""
    if isinstance(whole, dict):
        whole = list(whole.values())
    return (
        [part for part in whole if isinstance(part, (list, dict))]
        if isinstance(whole, list)
        else []
    )


def _too_deep(what: str, text: bytes | str) -> BadReply:
    return bad_reply(what, text[:60], f"JSON nested at most {DEEPEST} deep")
