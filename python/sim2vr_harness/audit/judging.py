"""Judge for each participant and target whether it is seen, reached and held, and the exertion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim2vr_harness.audit.pacing import MODELS, PACING, Paced, minutes_at_pace
from sim2vr_harness.audit.population import Limitation, Subject
from sim2vr_harness.audit.postures import BALANCE, Balancer
from sim2vr_harness.audit.reaching import Bools, Crowd, FloatArray, Ints, Rows, Solved
from sim2vr_harness.audit.targets import Target
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.users.exertion import Strength, endurance_time, nicer_correction
from sim2vr_harness.users.kinematics.inverse import CLOSE_M

HALF_FIELD_DEG = 45.0
"""Half the field of view of the headset, to every side (as our apps draw it)."""
EASY_RAISED_DEG = (-15.0, 0.0)
"""Elevations of targets, seen from the eyes, that Penumudi et al. 2020 recommend."""
_PRESS_S, _SWINGS_M = 0.1, 0.35
"""Of a press, and from the hand to the elbow, about which a tremor turns the ray: assumed."""
_EASY = 0.25
"""Share of activation below which no other posture is tried."""
_HELD = 2
"""Postures of which the activations are computed; the published strength is of all."""
_TURN, _NOD = "neck_rotation", "neck_flexion"
_TRUNK_MOTORS = ("trunk_flexion", "trunk_bending", "trunk_rotation")


@dataclass(frozen=True)
class GripSettings:
    """The force that keeps a thing in the hand, and how long a participant has it."""

    man_kg: float = 51.0
    woman_kg: float = 31.0
    """Median grip strength (Dodds et al. 2014)."""
    friction: float = 0.5
    margin: float = 1.4
    """Coefficient between hand and thing, and how many times the least force people press with:
    assumed."""
    endurance_s: float = 33.55
    endurance_power: float = 1.61
    """Endurance of hands is ``endurance_s * share^-endurance_power`` (Frey-Law and Avin 2010, read
    second-hand)."""
    gravity_mps2: float = 9.81
    source: str = (
        "strength 51 kg (men), 31 kg (women): Dodds et al. 2014; friction 0.5 and a margin of 1.4: "
        "assumed; endurance: Frey-Law and Avin 2010, second-hand"
    )
    """As reports quote it."""


GRIP = GripSettings()


def grip_share(subject: Subject, target: Target, limitation: Limitation) -> float:
    """Return the grip force that a target requires as a share of a participant's strength.

    An object between palm and fingers is pressed from two sides. The controller's own weight is not
    included.
    """
    held_n = GRIP.margin * target.load_kg * GRIP.gravity_mps2 / (2.0 * GRIP.friction)
    strength = subject.shoulder(limitation)
    median_kg = GRIP.man_kg if strength.man else GRIP.woman_kg
    whole_n = GRIP.gravity_mps2 * median_kg * float(np.asarray(strength.factor))
    return (held_n + target.grip_n) / whole_n


def grip_time(share: ArrayLike) -> FloatArray:
    """Return how long hands hold a share of their maximum, s; endless at 0, none above 1."""
    share = np.asarray(share, dtype=np.float64)
    with np.errstate(divide="ignore"):
        time = GRIP.endurance_s * share**-GRIP.endurance_power
    return np.asarray(np.where(share > 1.0, 0.0, time), dtype=np.float64)


def can_grip(share: ArrayLike, hold_s: float) -> Bools:
    """Return whether a share of the strength can be held for ``hold_s``."""
    return np.asarray((np.asarray(share) <= 1.0) & (grip_time(share) >= hold_s))


@dataclass
class Judged:
    """Verdicts on N participants and T targets.

    Attributes:
        limitation: Of all participants.
        seen, reached, held: (N, T) True if the target is seen, reached, held.
        feasible: (N, T) True if the model's own muscles bring the hand there and hold it. If they
            do not, the model excludes the participant. True if nothing was searched.
        leans: (N, T) True if the trunk is needed to reach.
        one_hand: (N, T) True if at least one hand reaches.
        needed_m: (N, T, 3) shift of the target after which the hand reaches it: right, up, ahead.
        places_m: (N, T, 3) positions of the targets: right, up, ahead.
        gaze: (3, N, T) results of :func:`gaze`; 0 if nothing was searched.
        grip_share: (N, T) grip force as a share of the participant's; 0 if nothing is gripped.
        exertion: (9, N, T) results of :func:`hold`; NaN: not reached.
        postures: (N, T, J) of the independent joints; NaN: not reached.
        paced: (N, T) minutes until exhaustion at the app's pace, by model; empty: the pace is
            unknown.
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
    gaze: FloatArray
    grip_share: FloatArray
    exertion: FloatArray
    postures: FloatArray
    paced: dict[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def joined(cls, parts: Sequence[Judged]) -> Judged:
        """Return verdicts of the same participants on the targets of several parts."""
        joined: dict[str, Any] = {
            each.name: np.concatenate(
                [getattr(part, each.name) for part in parts],
                axis=2 if each.name in ("exertion", "gaze") else 1,
            )
            for each in fields(cls)
            if each.name not in ("limitation", "paced")
        }
        paced = {
            model: np.concatenate([part.paced[model] for part in parts], axis=1)
            for model in parts[0].paced
        }
        return cls(parts[0].limitation, **joined, paced=paced)

    @property
    def usable(self) -> Bools:
        """(N, T) whether the participant can use the target."""
        return np.asarray(self.seen & self.reached & self.held)

    @property
    def share(self) -> FloatArray:
        """(N, T) least largest activation of the shoulder's muscles; infinite: no balance."""
        return np.asarray(self.exertion[0])

    @property
    def published_share(self) -> FloatArray:
        """(N, T) torque as a share of published strength."""
        return np.asarray(self.exertion[1])

    @property
    def trunk_share(self) -> FloatArray:
        """(N, T) torque at the trunk as a share of its strength."""
        return np.asarray(self.exertion[2])

    @property
    def minutes(self) -> dict[str, FloatArray]:
        """(N, T) until exhaustion, by model, without breaks."""
        return dict(zip(MODELS, self.exertion[6:], strict=True))


def directions(crowd: Crowd, persons: Ints, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (B,) degrees to the right and (B,) degrees up of places, from the eyes at rest."""
    ahead, left, up = np.moveaxis(crowd.upright(places - crowd.heads[persons]), -1, 0)
    aside = np.degrees(np.arctan2(-left, ahead))
    return aside, np.degrees(np.arctan2(up, np.hypot(ahead, left)))


def gaze(crowd: Crowd, persons: Ints, places: FloatArray) -> FloatArray:
    """Return (3, B) :func:`directions`, and the neck's torque as a share of its strength.

    The neck turns and nods towards the place within its limits; the torque is that of flexion.
    """
    aside, raised = directions(crowd, persons, places)
    share = np.zeros(len(persons))
    for row, person in enumerate(persons.tolist()):
        subject = crowd.subjects[person]
        body, model, angles = subject.body, subject.body.physics_model, crowd.rest.copy()
        for joint, degrees in ((_TURN, aside[row]), (_NOD, -raised[row])):
            column = body.independent_joints.index(joint)
            angles[column] = np.clip(np.radians(degrees), *body.joint_ranges[column])
        need = float(subject.holder.gravity(angles)[model.joint(_NOD).dofadr[0]])
        low, high = model.actuator(f"{_NOD}_motor").forcerange
        share[row] = need / (high if need > 0.0 else low)
    return np.array([aside, raised, share])


def seen(crowd: Crowd, persons: Ints, places: FloatArray) -> Bools:
    """Return (B,) whether places come into view when the head turns within its limits.

    The head turns to the side and nods; trunk and feet stay.
    """
    body = crowd.subjects[0].body
    turn, nod = (
        np.degrees(body.joint_ranges[body.independent_joints.index(joint)])
        for joint in (_TURN, _NOD)
    )
    aside, raised = directions(crowd, persons, places)
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
    """Reach places with the hands that a target requires; ``quick``: see :class:`.Rows`.

    ``close_m``: (B,) distance that counts as near; None: the target's.

    Returns:
        The posture of the result, True if all required hands reach, and True if one does.
    """
    left_handed = np.array([crowd.subjects[i].mirrored for i in persons.tolist()], dtype=bool)
    close = np.full(len(persons), target.radius_m) if close_m is None else close_m
    close = np.maximum(close, CLOSE_M)
    ray = target.ray if target.how == "point" else None
    best = crowd.solve(Rows(persons, left_handed, places, close, ray, quick))
    one = best.reached.copy()
    if target.hand == "preferred" or (crowd.one_hand and target.hand == "either"):
        return best, one, one
    if crowd.one_hand:
        return best, np.zeros_like(one), one
    both = target.hand == "both"
    again = np.arange(len(persons))
    if not both:
        again = np.flatnonzero(~best.reached | (best.leans & (not quick)))
    if not len(again):
        return best, one, one
    other = crowd.solve(Rows(persons, ~left_handed, places, close, ray, quick).take(again))
    reached = one.copy()
    reached[again] = one[again] & other.reached if both else one[again] | other.reached
    one[again] |= other.reached
    # With both hands the harder one counts, the one that fails, or leans; else the easier one.
    easier, harder = (best.gap_m[again], best.leans[again]), (other.gap_m, other.leans)
    if not both:
        easier, harder = harder, easier
    taken = (harder[0] > easier[0]) | ((harder[0] == easier[0]) & harder[1] & ~easier[1])
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
    """Judge every participant of a crowd on every target.

    Args:
        crowd: The participants.
        limitation: Of all participants.
        pace: Uses of a target in a minute; None: not known.
        muscles: Whether to search for postures that the model's own muscles hold.
    """
    n, t = len(crowd.subjects), len(targets)
    visible, reached, held, leans, one_hand = np.zeros((5, n, t), dtype=bool)
    needed_m, places_m = np.zeros((2, n, t, 3))
    judged = Judged(
        limitation,
        visible,
        reached,
        held,
        np.ones((n, t), dtype=bool),
        leans,
        one_hand,
        needed_m,
        places_m,
        np.zeros((3, n, t)),
        np.array([[grip_share(s, each, limitation) for each in targets] for s in crowd.subjects]),
        np.full((6 + len(MODELS), n, t), np.nan),
        np.full((n, t, len(crowd.rest)), np.nan),
    )
    persons = np.arange(n)
    # Columns of targets that the same kind of reach gets to, in order.
    kinds: dict[tuple[bytes, str], list[int]] = {}
    for column, target in enumerate(targets):
        places = crowd.places(target, persons)
        judged.places_m[:, column] = position_to_app(places)
        judged.seen[:, column] = seen(crowd, persons, places)
        if muscles:
            judged.gaze[:, :, column] = gaze(crowd, persons, places)
        if target.how == "look":
            for told in (judged.reached, judged.held, judged.one_hand):
                told[:, column] = True
        else:
            ray = target.ray.key if target.how == "point" else b""
            kinds.setdefault((ray, target.hand), []).append(column)
    for columns in kinds.values():
        who, which = np.tile(persons, len(columns)), np.repeat(columns, n)
        places = np.concatenate([crowd.places(targets[i], persons) for i in columns])
        close = np.array([targets[i].radius_m for i in which.tolist()])
        solved, reached, one = reach_either(crowd, targets[columns[0]], who, places, close_m=close)
        judged.reached[who, which], judged.one_hand[who, which] = reached, one
        judged.leans[who, which] = solved.leans
        judged.needed_m[who, which] = position_to_app(solved.nearest - places)
        for row in np.flatnonzero(reached).tolist():
            at = int(who[row]), int(which[row])
            postures = solved.angles[row][solved.found[row]]
            exertion, judged.postures[at], judged.held[at], judged.feasible[at] = _hold_best(
                crowd, at[0], postures, targets[at[1]], limitation, muscles=muscles
            )
            judged.exertion[:, at[0], at[1]] = exertion
    if pace is not None:
        judged.paced = _paced(crowd, targets, judged, pace)
    return judged


def _paced(
    crowd: Crowd, targets: Sequence[Target], judged: Judged, pace: float
) -> dict[str, FloatArray]:
    """Return minutes until exhaustion at a pace, (N, T) by model; NaN: not reached."""
    found = {model: np.full(judged.seen.shape, np.nan) for model in MODELS}
    person, column = np.nonzero(~np.isnan(judged.exertion[3]))
    if len(person):  # not all targets are looked at, or beyond everyone's reach
        raised = np.array([each.hold_s + 2.0 * PACING.reach_s for each in targets])[column]
        shoulders = [each.shoulder(judged.limitation) for each in crowd.subjects]
        men = np.array([each.man for each in shoulders], dtype=bool)
        factors = np.array([float(np.asarray(each.factor)) for each in shoulders])
        share, _, _, torque, shoulder, elbow = judged.exertion[:6, person, column]
        strength = Strength(men[person], factors[person])
        cycle = np.maximum(60.0 / pace, raised)
        arms = Paced(share, torque, shoulder, elbow, strength, raised, cycle)
        for model, minutes in minutes_at_pace(arms).items():
            found[model][person, column] = minutes
    return found


def _hold_best(
    crowd: Crowd,
    person: int,
    postures: FloatArray,
    target: Target,
    limitation: Limitation,
    *,
    muscles: bool,
) -> tuple[FloatArray, FloatArray, bool, bool]:
    """Return the results of :func:`hold` for the easiest posture, it, and whether it is held.

    The last result is whether the model's muscles suffice; ``muscles``: True to search for that,
    and for a posture that needs less of them.

    Args:
        postures: (C, J), at least one, the easiest first; the search ends at an easily held one.
    """
    subject = crowd.subjects[person]
    best, chosen = hold(subject, postures[0], target.load_kg, limitation), postures[0]
    for angles in postures[1:_HELD]:
        if best[0] <= _EASY:
            break
        tried = hold(subject, angles, target.load_kg, limitation)
        if tried[0] < best[0]:
            best, chosen = tried, angles
    holds = can_hold(subject, postures, target, limitation)
    holds = holds and steady(target, crowd.places(target, np.array([person]))[0], limitation)
    if not muscles:
        return best, chosen, holds, True
    balancer = Balancer(subject.body, limitation.strength, target.load_kg)
    if target.how == "point":
        return best, chosen, holds, balancer.holds(chosen)
    close = max(BALANCE.near_m, target.radius_m)
    found = balancer.search(crowd.hand(person, postures[0]), postures, close)[0]
    able = found.holds(close)
    if able:
        tried = hold(subject, found.angles, target.load_kg, limitation)
        if tried[0] < best[0]:
            best, chosen = tried, found.angles
    return best, chosen, holds, able


def can_hold(
    subject: Subject, postures: FloatArray, target: Target, limitation: Limitation
) -> bool:
    """Return whether a shoulder of published strength holds one of the postures (C, J) long enough.

    The grip has to last as long. The endurance time is that of NICER. The muscles of the arm model
    are not considered: in raised arms, they are too weak for what recorded people do.
    """
    if not can_grip(grip_share(subject, target, limitation), target.hold_s):
        return False
    strength = subject.shoulder(limitation)
    for angles in postures:
        load = subject.holder.load(angles, target.load_kg)
        elbow = load.shoulder_deg, load.elbow_deg
        maximum = strength.shoulder_torque(*elbow)
        needed = load.torque + nicer_correction(*elbow, strength.man)
        if load.torque <= maximum and endurance_time(needed / maximum) >= target.hold_s:
            return True
    return False


def steady(target: Target, place: FloatArray, limitation: Limitation) -> bool:
    """Return whether at least half of the presses stay on the target in spite of a tremor.

    The hand swings along a line through the target's middle, a ray by the angle at the elbow. A
    target of unknown size has none to miss. ``place``: (3,) up last, m.
    """
    swing = limitation.tremor_m
    if target.how == "point":
        swing *= float(np.hypot(*place[:2])) / _SWINGS_M
    if swing <= target.radius_m or target.radius_m == 0.0:
        return True
    inside = 2.0 / np.pi * float(np.arcsin(target.radius_m / swing))
    press_s = 0.0 if target.how == "touch" else _PRESS_S
    return inside - 2.0 * limitation.tremor_hz * press_s >= 0.5


def hold(
    subject: Subject, angles: FloatArray, load_kg: float, limitation: Limitation
) -> FloatArray:
    """Return the exertion of holding a posture, (9,).

    Shares of the strength of muscles, of published strength and of the trunk; torque at the
    shoulder (Nm) and angles of shoulder and elbow (degrees); minutes until exhaustion by
    :data:`MODELS`. A weaker participant's muscles are activated more in proportion: activations are
    relative to their strength.
    """
    factor, model = limitation.strength, subject.body.physics_model
    held = subject.holder.hold(
        angles,
        load_kg,
        subject.shoulder(limitation),
        limits_bear=True,
        muscle_strength=factor,
    )
    # The largest torque of gravity at the trunk's joints as a share of the motors' limits.
    torques, trunk = subject.holder.gravity(angles), 0.0
    for joint in _TRUNK_MOTORS:
        need = float(torques[model.joint(joint).dofadr[0]])
        low, high = model.actuator(f"{joint}_motor").forcerange
        trunk = max(trunk, need / (high if need > 0.0 else low))
    share = np.inf if held.share is None else held.share
    load = held.torque_nm, held.shoulder_deg, held.elbow_deg
    minutes = [held.endurance_s[each] / 60.0 for each in MODELS]
    return np.array([share, held.strength_share, trunk / factor, *load, *minutes])
