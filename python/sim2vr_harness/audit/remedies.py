"""Changes that would include 95 % of people: the smallest shift of a target, or another input."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from sim2vr_harness.audit.judging import Judged, can_hold, grip_time, reach_either, seen
from sim2vr_harness.audit.population import Limitation
from sim2vr_harness.audit.reaching import Bools, Crowd, FloatArray, Ints
from sim2vr_harness.audit.targets import Target
from sim2vr_harness.client.frames import position_to_mujoco

GOAL = 0.95
_LEAST_M = 0.005
_SIDES = (("left", "right"), ("down", "up"), ("back", "ahead"))
_SAMPLE = 20
"""Sample for the search of shifts; all participants confirm the one that is found."""
_STEP_M, _STEP_SHARE, _FARTHEST_M = 0.02, 0.08, 1.5
_LOADS_KG = (10.0, 7.5, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.5, 0.0)
_GRIPS_N = (300.0, 200.0, 150.0, 100.0, 75.0, 50.0, 30.0, 20.0, 10.0, 5.0)
_TIMES_S = (600.0, 300.0, 120.0, 60.0, 30.0, 15.0, 10.0, 5.0, 2.0, 1.0)


@dataclass(frozen=True)
class Remedy:
    """Changes to a target that include more people.

    Attributes:
        shift_m: (3,) right, up, ahead, after which at least 95 % can use the target; None: no shift
            up to 1.5 m is enough.
        share: Proportion of people who can use it after the shift.
        reach_m: (3,) the smallest shift found after which a sample sees and reaches it.
        ray: Proportion who can use it at its place with a ray; None: not computed.
        one_hand: Proportion who can use it with either hand; None: one hand is enough already.
        load_kg: Largest load that 95 % hold there; None: not computed, or none.
        hold_s: Longest time that 95 % hold there; None: not computed, or none.
        grip_n: Largest grip force that 95 % have; None: not computed, or none.
    """

    shift_m: FloatArray | None
    share: float
    reach_m: FloatArray | None = None
    ray: float | None = None
    one_hand: float | None = None
    load_kg: float | None = None
    hold_s: float | None = None
    grip_n: float | None = None

    def plain(self) -> dict[str, Any]:
        """Return it for JSON, shifts in cm and in words."""
        found: dict[str, Any] = {}
        for name, shift in (("reach_shift", self.reach_m), ("shift", self.shift_m)):
            found[f"{name}_cm"] = None if shift is None else np.round(100.0 * shift, 1).tolist()
            found[name] = None if shift is None else shift_words(shift)
        return found | {
            "share_after": round(self.share, 4),
            "by_ray": self.ray,
            "one_hand": self.one_hand,
            "load_kg": self.load_kg,
            "hold_s": self.hold_s,
            "grip_n": self.grip_n,
        }


def shift_words(shift_m: FloatArray) -> str:
    """Return a shift, right, up, ahead, in words: ``12 cm down and 5 cm back``."""
    parts = [
        f"{100.0 * abs(metres):.0f} cm {_SIDES[axis][metres > 0.0]}"
        for axis, metres in sorted(enumerate(shift_m.tolist()), key=lambda part: -abs(part[1]))
        if abs(metres) >= _LEAST_M
    ]
    return " and ".join(parts) or "less than 1 cm"


def usable_at(
    crowd: Crowd,
    target: Target,
    persons: Ints,
    places: FloatArray,
    limitation: Limitation,
    *,
    hold: bool = True,
) -> Bools:
    """Return (B,) whether participants can use a target at places (B, 3), MuJoCo's world, m.

    ``hold``: whether they have to hold the posture, too.
    """
    usable = seen(crowd, persons, places)
    rows = np.flatnonzero(usable)
    if target.how == "look" or not len(rows):
        return usable
    solved, reached, _ = reach_either(crowd, target, persons[rows], places[rows], quick=not hold)
    usable[rows] = reached
    if hold:
        for i in np.flatnonzero(reached).tolist():
            subject = crowd.subjects[int(persons[rows[i]])]
            postures = solved.angles[i][solved.found[i]]
            usable[rows[i]] = can_hold(subject, postures, target, limitation)
    return usable


def remedy(crowd: Crowd, target: Target, judged: Judged, column: int) -> Remedy:
    """Search for changes to a target that include 95 % of a crowd."""
    everyone = np.arange(len(crowd.subjects))
    here = crowd.places(target, everyone)

    def share(changed: Target) -> float:
        return float(usable_at(crowd, changed, everyone, here, judged.limitation).mean())

    reached = judged.reached[:, column].mean() >= GOAL
    tires = reached and judged.seen[:, column].mean() >= GOAL
    by_hand = target.how in ("touch", "press")
    ray = share(replace(target, how="point")) if by_hand and not reached else None
    one = share(replace(target, hand="either")) if target.hand == "both" else None
    load_kg = None
    if tires:  # the largest of some loads that 95 % hold, below the target's own
        solved, _, _ = reach_either(crowd, target, everyone, here)
        for kg in (each for each in _LOADS_KG if each < target.load_kg):
            lighter = replace(target, load_kg=kg)
            held = [
                solved.reached[i]
                and can_hold(subject, solved.angles[i][solved.found[i]], lighter, judged.limitation)
                for i, subject in enumerate(crowd.subjects)
            ]
            if np.mean(held) >= GOAL:
                load_kg = kg
                break
    weaker = (each for each in _GRIPS_N if tires and load_kg is None and each < target.grip_n)
    grip_n = next((each for each in weaker if share(replace(target, grip_n=each)) >= GOAL), None)
    hold_s = None
    if tires and load_kg is None and grip_n is None:  # the longest of some times, likewise
        minutes = judged.minutes["NICER"][:, column]
        strong = judged.published_share[:, column] <= 1.0
        seconds = np.where(strong, 60.0 * np.nan_to_num(minutes, posinf=np.inf), 0.0)
        seconds = np.minimum(seconds, grip_time(judged.grip_share[:, column]))
        shorter = (each for each in _TIMES_S if each < target.hold_s)
        hold_s = next((each for each in shorter if (seconds >= each).mean() >= GOAL), None)
    shift, reach, after = None, None, float(judged.usable[:, column].mean())
    if load_kg is None and hold_s is None and grip_n is None:
        shift, reach, after = _shift(crowd, target, judged, column)
    return Remedy(shift, after, reach, ray, one, load_kg, hold_s, grip_n)


def _shift(
    crowd: Crowd, target: Target, judged: Judged, column: int
) -> tuple[FloatArray | None, FloatArray | None, float]:
    """Return the smallest shifts found for use and for reach, and the share of users."""
    everyone = np.arange(len(crowd.subjects))
    sample = everyone[:_SAMPLE]
    here = crowd.places(target, everyone)
    # (D, 3) unit vectors: along axes and between them, and the mean of what participants need.
    steps = np.array(
        [each for each in product((-1.0, 0.0, 1.0), repeat=3) if 0 < sum(map(abs, each)) < 3]
    )
    needed = judged.needed_m[~judged.reached[:, column], column]
    mean = needed.mean(axis=0) if len(needed) else np.zeros(3)
    if np.linalg.norm(mean) > 1e-3:
        steps = np.concatenate([mean[None], steps])
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    # No one gets there by a shift below the own gap: 95 % need at least that quantile.
    gaps = np.linalg.norm(judged.needed_m[:, column], axis=1)
    gaps = np.where(judged.reached[:, column], 0.0, gaps)
    metres = max(float(np.quantile(gaps[sample], GOAL, method="lower")), 0.01)
    reach: FloatArray | None = None
    while metres <= _FARTHEST_M:
        # Shifts (D, 3) with which enough of a sample see and reach, the best first.
        shifts = directions * metres
        persons = np.tile(sample, len(shifts))
        moved = position_to_mujoco(np.repeat(shifts, len(sample), axis=0))
        places = here[persons] + moved
        in_view = seen(crowd, persons, places).reshape(len(shifts), -1).mean(axis=1) >= GOAL
        rows = np.flatnonzero(np.repeat(in_view, len(sample)))
        usable = np.zeros(len(persons), dtype=bool)
        if len(rows):
            usable[rows] = usable_at(crowd, target, persons[rows], places[rows], _ANY, hold=False)
        shares = usable.reshape(len(shifts), -1).mean(axis=1)
        order = sorted(np.flatnonzero(shares >= GOAL).tolist(), key=lambda i: -shares[i])
        for shift in shifts[order[:_CONFIRMED]]:
            reach = shift if reach is None else reach
            after = _confirmed(crowd, target, here, shift, judged.limitation)
            if after >= GOAL:
                return shift, reach, after
        metres += max(_STEP_M, _STEP_SHARE * metres)
    return None, reach, float(judged.usable[:, column].mean())


_ANY = Limitation("any")
_QUICK_MISSES = 0.03
"""Proportion of participants that the quick search may miss."""
_CONFIRMED = 6
"""Directions of a length that all participants try."""


def _confirmed(
    crowd: Crowd, target: Target, here: FloatArray, shift: FloatArray, limitation: Limitation
) -> float:
    """Return the share of people who can use the target there, holding included.

    All participants are computed only if a sample of them can.
    """
    share = 0.0
    for count in (_SAMPLE, len(here)):
        persons = np.arange(min(count, len(here)))
        places = here[persons] + position_to_mujoco(shift)
        reach = usable_at(crowd, target, persons, places, limitation, hold=False)
        if reach.mean() < GOAL - _QUICK_MISSES:
            return float(reach.mean())
        share = float(usable_at(crowd, target, persons, places, limitation).mean())
        if share < GOAL:
            break
    return share
