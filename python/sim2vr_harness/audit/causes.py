"""Why a person cannot use a target, in words."""

from __future__ import annotations

from collections import Counter

import numpy as np

from sim2vr_harness.audit.grip import can_grip
from sim2vr_harness.audit.judging import Judged
from sim2vr_harness.audit.reaching import FloatArray, Ints
from sim2vr_harness.audit.targets import AuditTarget

_LEAST_M = 0.005
_SIDES = (("left", "right"), ("down", "up"), ("back", "ahead"))


def cause(judged: Judged, target: AuditTarget, person: int, column: int) -> str | None:
    """Return why a person cannot use a target; None: it can be used."""
    place, needed = judged.places_m[person, column], judged.needed_m[person, column]
    if not judged.seen[person, column]:
        return "behind" if place[2] < 0.0 else "out of view"
    if not judged.reached[person, column]:
        if target.hand == "both" and judged.one_hand[person, column]:
            return "needs two hands"
        if target.how == "point":
            return "the ray cannot be aimed there"
        side = int(np.abs(needed).argmax())
        if side == 0:
            return "too far to the side"
        if side == 1:
            return "too high" if needed[1] < 0.0 else "too low"
        return "behind" if place[2] < 0.0 else "too far" if needed[2] < 0.0 else "too near"
    if not judged.held[person, column]:
        weak = judged.published_share[person, column] > 1.0
        if not weak and not can_grip(judged.grip_share[person, column], target.hold_s):
            return "grip too weak" if target.grip_n > 0.0 else "too heavy to grip"
        if target.load_kg > 0.0:
            return "too heavy"
        return "too weak to hold the arm" if weak else "held too long"
    return None


def causes(judged: Judged, target: AuditTarget, column: int, members: Ints) -> dict[str, int]:
    """Return how many of some persons are excluded by each cause, the most frequent first."""
    found = (cause(judged, target, int(person), column) for person in members)
    counts = Counter(each for each in found if each is not None)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def shift_words(shift_m: FloatArray) -> str:
    """Return a shift, right, up, ahead, in words: ``12 cm down and 5 cm back``."""
    parts = [
        f"{100.0 * abs(metres):.0f} cm {_SIDES[axis][metres > 0.0]}"
        for axis, metres in sorted(enumerate(shift_m.tolist()), key=lambda part: -abs(part[1]))
        if abs(metres) >= _LEAST_M
    ]
    return " and ".join(parts) or "less than 1 cm"
