"""Judge for each person and target whether it is seen, reached and held, and the exertion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sim2vr_harness.audit.equilibrium import NEAR_M, Balancer
from sim2vr_harness.audit.grip import can_grip, grip_share
from sim2vr_harness.audit.pacing import REACH_S, Paced, minutes_at_pace
from sim2vr_harness.audit.population import Limitation, Subject
from sim2vr_harness.audit.reaching import Bools, Crowd, FloatArray, Ints, Rows, Solved
from sim2vr_harness.audit.targets import Target
from sim2vr_harness.client.frames import position_to_app, position_to_mujoco
from sim2vr_harness.users.exertion import (
    Strength,
    endurance_time,
    nicer_correction,
)
from sim2vr_harness.users.kinematics.inverse import CLOSE_M

HALF_FIELD_DEG = 45.0
"""Half the field of view of the headset, to every side (as our apps draw it)."""
MODELS = ("3CC-r, shoulder", "NICER", "Consumed Endurance")
"""Models of exertion in reports; NICER decides whether a posture is held long enough."""
_EASY = 0.25
"""Share of activation."""
_HELD = 2
"""Postures of which the activations are computed; the published strength is of all."""
_TURN, _NOD = "neck_rotation", "neck_flexion"
_TRUNK_MOTORS = ("trunk_flexion", "trunk_bending", "trunk_rotation")


@dataclass
class Judged:
    """Verdicts on N persons and T targets.

    Attributes:
        limitation: Of all persons.
        seen, reached, held: (N, T) whether.
        feasible: (N, T) whether the model's own muscles bring the hand there and hold it. Where
            they do not, the model excludes the person. True where nothing was searched.
        leans: (N, T) whether the trunk is needed to reach.
        one_hand: (N, T) whether one hand at least reaches.
        needed_m: (N, T, 3) shift of the target after which the hand reaches it: right, up, ahead.
        places_m: (N, T, 3) where the targets are: right, up, ahead.
        share: (N, T) least largest activation of the shoulder's muscles; NaN: not reached,
            infinite: no activations balance the posture.
        published_share: (N, T) torque as a share of published strength; NaN: not reached.
        trunk_share: (N, T) torque at the trunk as a share of its strength; NaN: not reached.
        grip_share: (N, T) grip force as a share of the person's; 0 where nothing is gripped.
        loads: (3, N, T) torque at the shoulder, Nm, and angles of shoulder and elbow, degrees; NaN:
            not reached.
        postures: (N, T, J) of the independent joints; NaN: not reached.
        minutes: (N, T) until exhaustion, by model, without breaks; NaN: not reached.
        paced: (N, T) the same at the app's pace; empty: no pace is known.
    """

    limitation: Limitation
    seen: Bools
    reached: Bools
    held: Bools
    feasible: Bools
    leans: Bools
    one_hand: Bools
    needed_m: FloatArray
    places_m: FloatArray
    share: FloatArray
    published_share: FloatArray
    trunk_share: FloatArray
    grip_share: FloatArray
    loads: FloatArray
    postures: FloatArray
    minutes: dict[str, FloatArray]
    paced: dict[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def joined(cls, parts: Sequence[Judged]) -> Judged:
        """Return verdicts of the same persons on the targets of several parts."""
        joined: dict[str, Any] = {"limitation": parts[0].limitation}
        for name in (f.name for f in fields(cls) if f.name != "limitation"):
            values = [getattr(each, name) for each in parts]
            if name in ("minutes", "paced"):
                joined[name] = {
                    model: np.concatenate([each[model] for each in values], axis=1)
                    for model in values[0]
                }
            else:
                joined[name] = np.concatenate(values, axis=2 if name == "loads" else 1)
        return cls(**joined)

    @property
    def usable(self) -> Bools:
        """(N, T) whether the person can use the target."""
        return np.asarray(self.seen & self.reached & self.held)


def places_of(crowd: Crowd, target: Target, persons: Ints) -> FloatArray:
    """Return (B, 3) where a target is for persons, MuJoCo's world, m."""
    place = np.repeat(position_to_mujoco(target.place_m)[None], len(persons), axis=0)
    return place + crowd.heads[persons] if target.from_head else place


def seen(crowd: Crowd, persons: Ints, places: FloatArray) -> Bools:
    """Return (B,) whether places come into view when the head turns within its limits.

    The head turns to the side and nods; trunk and feet stay.
    """
    body = crowd.subjects[0].body
    turn = np.degrees(body.joint_ranges[body.independent_joints.index(_TURN)])
    nod = np.degrees(body.joint_ranges[body.independent_joints.index(_NOD)])
    ahead, left, up = np.moveaxis(places - crowd.heads[persons], -1, 0)
    aside = np.degrees(np.arctan2(-left, ahead))
    raised = np.degrees(np.arctan2(up, np.hypot(ahead, left)))
    across = (aside >= turn[0] - HALF_FIELD_DEG) & (aside <= turn[1] + HALF_FIELD_DEG)
    # Forward is positive: the greatest nod looks down.
    upright = (raised >= -nod[1] - HALF_FIELD_DEG) & (raised <= -nod[0] + HALF_FIELD_DEG)
    return np.asarray(across & upright)


def reach_either(
    crowd: Crowd,
    target: Target,
    persons: Ints,
    places: FloatArray,
    *,
    quick: bool = False,
    close_m: FloatArray | None = None,
) -> tuple[Solved, Bools, Bools]:
    """Reach places with the hands that a target takes; ``quick``: see :class:`.Rows`.

    ``close_m``: (B,) how near is enough; None: the target's.

    Returns:
        The posture that counts, whether all hands that are needed reach, and whether one does.
    """
    left_handed = np.array([crowd.subjects[i].mirrored for i in persons.tolist()], dtype=bool)
    close = np.full(len(persons), target.radius_m) if close_m is None else close_m
    close = np.maximum(close, CLOSE_M)
    rows = Rows(
        persons, left_handed, places, close, target.ray if target.how == "point" else None, quick
    )
    best = crowd.solve(rows)
    one = best.reached.copy()
    if target.hand == "preferred" or (crowd.one_hand and target.hand == "either"):
        return best, one, one
    if crowd.one_hand:
        return best, np.zeros_like(one), one
    both = target.hand == "both"
    again = (
        np.arange(len(persons))
        if both
        else np.flatnonzero(~best.reached | (best.leans & (not quick)))
    )
    if not len(again):
        return best, one, one
    other = crowd.solve(Rows(persons, ~left_handed, places, close, rows.ray, quick).take(again))
    reached = one.copy()
    reached[again] = one[again] & other.reached if both else one[again] | other.reached
    one[again] |= other.reached
    # With both hands the harder one counts: the one that fails, or leans.
    worse = (other.gap_m > best.gap_m[again]) | (
        (other.gap_m == best.gap_m[again]) & other.leans & ~best.leans[again]
    )
    better = (other.gap_m < best.gap_m[again]) | (
        (other.gap_m == best.gap_m[again]) & ~other.leans & best.leans[again]
    )
    taken = worse if both else better
    for name in ("angles", "found", "gap_m", "nearest", "leans"):
        getattr(best, name)[again[taken]] = getattr(other, name)[taken]
    return best, reached, one


def judge(
    crowd: Crowd,
    targets: Sequence[Target],
    limitation: Limitation,
    pace: float | None = None,
    *,
    muscles: bool = False,
) -> Judged:
    """Judge every person of a crowd on every target.

    Args:
        crowd: The persons.
        limitation: Of all persons.
        pace: Uses of a target in a minute; None: not known.
        muscles: Whether to search for postures that the model's own muscles hold.
    """
    n, t = len(crowd.subjects), len(targets)
    yes = np.zeros((6, n, t), dtype=bool)
    yes[5] = True
    numbers = np.full((6 + len(MODELS), n, t), np.nan)
    chosen = np.full((n, t, len(crowd.rest)), np.nan)
    needed, where = np.zeros((2, n, t, 3))
    persons = np.arange(n)
    grips = np.array(
        [[grip_share(s, each, limitation) for each in targets] for s in crowd.subjects]
    )
    for column, target in enumerate(targets):
        places = places_of(crowd, target, persons)
        where[:, column] = position_to_app(places)
        yes[0, :, column] = seen(crowd, persons, places)
        yes[1:3, :, column] = yes[4, :, column] = target.how == "look"
    # Columns of targets that the same kind of reach gets to, in order.
    kinds: dict[tuple[bytes, str], list[int]] = {}
    for alike_column, alike_target in enumerate(targets):
        if alike_target.how != "look":
            ray = alike_target.ray.key if alike_target.how == "point" else b""
            kinds.setdefault((ray, alike_target.hand), []).append(alike_column)
    alike = list(kinds.values())
    for columns in alike:
        who, which = np.tile(persons, len(columns)), np.repeat(columns, n)
        places = np.concatenate([places_of(crowd, targets[i], persons) for i in columns])
        close = np.array([targets[i].radius_m for i in which.tolist()])
        solved, reached, one = reach_either(crowd, targets[columns[0]], who, places, close_m=close)
        yes[1, who, which], yes[3, who, which], yes[4, who, which] = reached, solved.leans, one
        needed[who, which] = position_to_app(solved.nearest - places)
        for row in np.flatnonzero(reached).tolist():
            person, column = int(who[row]), int(which[row])
            postures = solved.angles[row][solved.found[row]]
            load, best, holds, able = _held(
                crowd, person, postures, targets[column], limitation, muscles=muscles
            )
            yes[2, person, column], yes[5, person, column] = holds, able
            numbers[:, person, column], chosen[person, column] = load, best
    return Judged(
        limitation,
        yes[0],
        yes[1],
        yes[2],
        yes[5],
        yes[3],
        yes[4],
        needed,
        where,
        numbers[0],
        numbers[1],
        numbers[2],
        grips,
        numbers[3:6],
        chosen,
        dict(zip(MODELS, numbers[6:], strict=True)),
        {} if pace is None else _paced(crowd, targets, numbers, limitation, pace),
    )


def _paced(
    crowd: Crowd,
    targets: Sequence[Target],
    numbers: FloatArray,
    limitation: Limitation,
    pace: float,
) -> dict[str, FloatArray]:
    """Minutes until exhaustion at a pace, (N, T) by model; NaN: not reached."""
    person, column = np.nonzero(~np.isnan(numbers[3]))
    if not len(person):  # all targets are looked at, or beyond everyone's reach
        return {model: np.full(numbers[0].shape, np.nan) for model in MODELS}
    raised = np.array([each.hold_s + 2.0 * REACH_S for each in targets])[column]
    factors = np.array([float(np.asarray(each.strength.factor)) for each in crowd.subjects])
    men = np.array([each.man for each in crowd.subjects], dtype=bool)
    arms = Paced(
        numbers[0][person, column],
        numbers[3, person, column],
        numbers[4, person, column],
        numbers[5, person, column],
        Strength(men[person], (factors * limitation.strength)[person]),
        raised,
        np.maximum(60.0 / pace, raised),
    )
    found = {}
    for model, minutes in minutes_at_pace(arms).items():
        found[model] = np.full(numbers[0].shape, np.nan)
        found[model][person, column] = minutes
    return found


def hold_any(
    subject: Subject, postures: FloatArray, target: Target, limitation: Limitation
) -> tuple[list[float], FloatArray, bool]:
    """Return what :func:`hold` does of the easiest posture, it, and whether it can be held.

    Args:
        subject: Who holds it.
        postures: (C, J), at least one, the easiest first; an easily held one is the last tried.
        target: Says how long and with what load.
        limitation: Of the person.
    """
    best, posture = hold(subject, postures[0], target.load_kg, limitation), postures[0]
    for angles in postures[1:_HELD]:
        if best[0] <= _EASY:
            break
        load = hold(subject, angles, target.load_kg, limitation)
        if load[0] < best[0]:
            best, posture = load, angles
    return best, posture, can_hold(subject, postures, target, limitation)


def _held(
    crowd: Crowd,
    person: int,
    postures: FloatArray,
    target: Target,
    limitation: Limitation,
    *,
    muscles: bool,
) -> tuple[list[float], FloatArray, bool, bool]:
    """Return what :func:`hold_any` does, and whether the model's muscles suffice.

    ``muscles``: whether to look for that, and for a posture which takes less of them.
    """
    subject = crowd.subjects[person]
    load, best, holds = hold_any(subject, postures, target, limitation)
    if not muscles:
        return load, best, holds, True
    place = crowd.hand(person, postures[0])
    able, better = _feasible(subject, (best, *postures), place, target, limitation)
    again = hold(subject, better, target.load_kg, limitation)
    return (again, better, holds, able) if again[0] < load[0] else (load, best, holds, able)


def _feasible(
    subject: Subject,
    postures: Sequence[FloatArray],
    place: FloatArray,
    target: Target,
    limitation: Limitation,
) -> tuple[bool, FloatArray]:
    """Return whether the model's muscles bring the hand to a target, and the best posture.

    Args:
        subject: Whose.
        postures: (J,) each, that reach it, the most easily held first.
        place: (3,) where the hand then is, in the body's own frame, m.
        target: Says how near is enough, and with what load.
        limitation: Of the person.
    """
    balancer = Balancer(subject, limitation.strength, target.load_kg)
    if target.how == "point":
        return balancer.holds(postures[0]), postures[0]
    close = max(NEAR_M, target.radius_m)
    best = balancer.search(place, np.array(postures[1:]), close)[0]
    able = best.holds(close)
    return able, best.angles if able else postures[0]


def can_hold(
    subject: Subject, postures: FloatArray, target: Target, limitation: Limitation
) -> bool:
    """Return whether a shoulder of published strength holds one of the postures (C, J) long enough.

    The grip has to last as long. Time: as NICER has it. The muscles of the arm model do not decide:
    raised, they are too weak to do what recorded people do.
    """
    if not can_grip(grip_share(subject, target, limitation), target.hold_s):
        return False
    strength = _strength(subject, limitation)
    for angles in postures:
        load = subject.holder.load(angles, target.load_kg)
        elbow = load.shoulder_deg, load.elbow_deg
        maximum = strength.shoulder_torque(*elbow)
        needed = load.torque + nicer_correction(*elbow, strength.man)
        if load.torque <= maximum and endurance_time(needed / maximum) >= target.hold_s:
            return True
    return False


def _strength(subject: Subject, limitation: Limitation) -> Strength:
    factor = np.asarray(subject.strength.factor) * limitation.strength
    return Strength(subject.strength.man, factor)


def hold(
    subject: Subject, angles: FloatArray, load_kg: float, limitation: Limitation
) -> list[float]:
    """Return shares of muscles, published strength and trunk, the load, and minutes by model.

    A weaker person's muscles are activated more in proportion: activations are relative to it.
    """
    factor = limitation.strength
    held = subject.holder.hold(
        angles,
        load_kg,
        _strength(subject, limitation),
        limits_bear=True,
        muscle_strength=factor,
    )
    share = np.inf if held.share is None else held.share
    minutes = [held.endurance_s[model] / 60.0 for model in MODELS]
    trunk = _trunk_share(subject, angles) / factor
    load = held.torque_nm, held.shoulder_deg, held.elbow_deg
    return [share, held.strength_share, trunk, *load, *minutes]


def _trunk_share(subject: Subject, angles: FloatArray) -> float:
    """Largest torque of gravity at the trunk's joints as a share of the motors' limits."""
    model, torques = subject.body.physics_model, subject.holder.torques(angles)
    shares = []
    for joint in _TRUNK_MOTORS:
        need = float(torques[model.joint(joint).dofadr[0]])
        low, high = model.actuator(f"{joint}_motor").forcerange
        shares.append(need / (high if need > 0.0 else low))
    return max(shares)
