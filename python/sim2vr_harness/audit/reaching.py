"""Postures that bring participants' hands, or the rays from them, to places: many pairs at once.

A row is a participant, a side and a place. Bodies are right-handed; a left hand is reached with by
the mirror image of the place. The arm alone is tried first, then with the trunk. Of the postures
found the one with the least torque at the shoulder counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sim2vr_harness.audit.population import EYE_HEIGHT_STANDING, Limitation, Stance, Subject
from sim2vr_harness.audit.targets import Target
from sim2vr_harness.client.frames import position_to_app, position_to_mujoco
from sim2vr_harness.users import AVERAGE, Body
from sim2vr_harness.users.exertion import arms_of
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import CLOSE_M, solve
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay

FloatArray = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MIRROR, _UP = np.array([1.0, -1.0, 1.0]), np.array([0.0, 0.0, 1.0])
"""MuJoCo's world: y points to the left."""
_DEVICE = "controller_right"
_TRUNK = "trunk_"
_SAMPLES = 4000
_EASY_STARTS, _STARTS = 2, 2
"""With a straight wrist, and with any."""
_QUICK_STARTS = 2
_ITERATIONS = 25
_KEPT = 4
"""Postures of a row that are kept."""
_SEED = 1
_TURNED = ("pro_sup", "deviation", "flexion")
_HALF_RANGE = np.radians([90.0, 17.5, 45.0])
_TURNED_NM = 2.0
"""Torque that counts as much as one of these joints half its range away from the middle."""
_ELEVATIONS_DEG = (5.0, 45.0, 80.0)
"""Of the upper arm in postures from which pointing starts."""


@dataclass(frozen=True)
class Rows:
    """Pairs of a participant and a place.

    Attributes:
        persons: (B,) numbers of participants.
        mirrored: (B,) True if the left hand is used.
        places: (B, 3) MuJoCo's world, m.
        close_m: (B,) distance that counts as near.
        ray: ray that has to reach the place instead of the hand; None: the hand.
        quick: True if only reachability is needed, not the effort: fewer postures are tried.
    """

    persons: Ints
    mirrored: Bools
    places: FloatArray
    close_m: FloatArray
    ray: DeviceRay | None = None
    quick: bool = False

    def take(self, chosen: Ints) -> Rows:
        """Return some of the rows."""
        names = ("persons", "mirrored", "places", "close_m")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})


@dataclass
class Solved:
    """Postures of rows.

    Attributes:
        angles: (B, C, J) of the body's independent joints, rad: postures, the easiest first.
        found: (B, C) which of them bring the hand or ray there.
        gap_m: (B,) how far the hand or ray is from the place; 0: there.
        nearest: (B, 3) where it then is, MuJoCo's world, m.
        leans: (B,) whether the trunk is needed.
    """

    angles: FloatArray
    found: Bools
    gap_m: FloatArray
    nearest: FloatArray
    leans: Bools

    @property
    def reached(self) -> Bools:
        """(B,) whether the places are reached."""
        return self.gap_m <= 0.0


class Crowd:
    """Bodies of participants under a limitation, prepared for reaching.

    Args:
        subjects: The participants.
        stance: Of participants whose limitation does not set one.
        limitation: Of all of them.
    """

    def __init__(self, subjects: Sequence[Subject], stance: Stance, limitation: Limitation) -> None:
        if limitation.recline_deg is not None:
            subjects = [
                each
                if each.recline_deg == limitation.recline_deg
                else replace(each, recline_deg=limitation.recline_deg)
                for each in subjects
            ]
        self.subjects = subjects
        self.one_hand = limitation.one_hand
        """True if only the preferred hand can be used."""
        self._limitation = limitation
        first = subjects[0].body
        self._joints = first.independent_joints
        self.rest = np.array([first.reset_rule.posture.get(j, 0.0) for j in self._joints])
        self._hands = [Linkage(each.body, Point(_DEVICE)) for each in subjects]
        self._stacks: dict[bytes, Linkage] = {}
        heads = [Linkage(each.body, Point("headset")) for each in subjects]
        self.heads = np.array([each.place(each.rest[None])[0] for each in heads])
        """(N, 3) where the headsets are with the necks at rest, MuJoCo's world, m."""
        statures = np.array([each.person.stature_m for each in subjects])
        self._sizes = statures / AVERAGE.stature_m
        self.lift_m = np.zeros(len(subjects))
        """(N,) how far the bodies stand above the height of the arm model, m."""
        if (limitation.stance or stance) == "standing":
            self.lift_m = EYE_HEIGHT_STANDING * statures - self.heads[:, 2]
        self.lift_m = self.lift_m + limitation.lift_m
        # (3, 3) axes of the bodies in the world: ahead, left and up, as columns; None: upright.
        self._axes: FloatArray | None = None
        if leans := np.radians(subjects[0].recline_deg):
            c, s = np.cos(leans), np.sin(leans)
            self._axes = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        self._hips = np.array([_hips(each.body) for each in subjects])
        self.heads = self.world(self.heads, np.arange(len(subjects)))
        self._samples: dict[tuple[bool, bool], tuple[FloatArray, cKDTree]] = {}

    def places(self, target: Target, persons: Ints) -> FloatArray:
        """(B, 3) where a target is for participants, MuJoCo's world, m."""
        place = np.repeat(position_to_mujoco(target.place_m)[None], len(persons), axis=0)
        return place + self.heads[persons] if target.from_head else place

    def local(self, places: FloatArray, persons: Ints, mirrored: Bools) -> FloatArray:
        """(B, 3) places in the bodies' own frames, as the right hand is to get there; m."""
        places = places - self.lift_m[persons, None] * _UP
        if self._axes is not None:
            places = self.upright(places - self._hips[persons]) + self._hips[persons]
        return places * np.where(mirrored[:, None], MIRROR, 1.0)

    def world(self, places: FloatArray, persons: Ints) -> FloatArray:
        """(B, 3) where places in the bodies' own frames are, MuJoCo's world, m."""
        if self._axes is not None:
            places = (places - self._hips[persons]) @ self._axes.T + self._hips[persons]
        return places + self.lift_m[persons, None] * _UP

    def upright(self, vectors: FloatArray) -> FloatArray:
        """(B, 3) vectors of MuJoCo's world in the axes of the bodies."""
        return vectors if self._axes is None else vectors @ self._axes

    def hand(self, person: int, angles: FloatArray) -> FloatArray:
        """(3,) where a posture (J,) brings a right hand, in the body's own frame, m."""
        linkage = self._hands[person]
        place: FloatArray = linkage.place(
            angles[[self._joints.index(joint) for joint in linkage.joints]][None]
        )[0]
        return place

    def landmarks(self, person: int) -> FloatArray:
        """(3, 3) eyes and both shoulders of a person: right, up, ahead, m."""
        body = self.subjects[person].body
        shoulder = Linkage(body, Point(arms_of(body)[0].upper_arm))
        right = shoulder.place(np.zeros((1, len(shoulder.joints))))[0]
        both = self.world(np.stack([right, right * MIRROR]), np.array([person, person]))
        return position_to_app([self.heads[person], *both])

    def solve(self, rows: Rows) -> Solved:
        """Bring hands, or rays, to places."""
        count = len(rows.persons)
        local = self.local(rows.places, rows.persons, rows.mirrored)
        stack = self._stack(rows.ray)
        found = _Best(count, len(stack.joints))
        for trunk in (True,) if rows.quick else (False, True):
            left = np.flatnonzero(found.gap[:, 0] > 0.0)
            if not len(left):
                break
            part = rows.take(left)
            starts = self._starts(part, local[left], trunk)
            bodies = stack.take(part.persons)
            if not trunk:  # it stays where it is
                limits = bodies.limits.copy()
                limits[:, [joint.startswith(_TRUNK) for joint in bodies.joints]] = 0.0
                bodies = bodies.with_limits(limits)
            for start in starts[: _QUICK_STARTS if rows.quick else None]:
                if rows.quick:
                    left = np.flatnonzero(found.gap[:, 0] > 0.0)
                    part, start = rows.take(left), start[left]
                    bodies = stack.take(part.persons)
                    if not len(left):
                        break
                q, gap = solve(bodies, local[left], start, iterations=_ITERATIONS, close_m=2e-4)
                gap = np.where(gap <= np.maximum(CLOSE_M, part.close_m), 0.0, gap)
                there = (gap == 0.0) & (not rows.quick)
                # (B,) what tells easy postures from others; infinite where the hand is not there.
                cost = np.full(len(q), np.inf)
                cost_angles = self._whole(stack, q)
                turned = [stack.joints.index(joint) for joint in _TURNED]
                for row in np.flatnonzero(there).tolist():
                    load = self.subjects[int(part.persons[row])].holder.load(cost_angles[row], 0.0)
                    strain = (q[row, turned] / _HALF_RANGE) ** 2
                    cost[row] = load.torque + _TURNED_NM * float(strain.sum())
                found.offer(left, q, gap, cost, leans=trunk)
        nearest = stack.take(rows.persons).place(found.q[:, 0])
        nearest = nearest * np.where(rows.mirrored[:, None], MIRROR, 1.0)
        nearest = self.world(nearest, rows.persons)
        angles = np.stack([self._whole(stack, found.q[:, i]) for i in range(_KEPT)], axis=1)
        return Solved(angles, found.gap == 0.0, found.gap[:, 0], nearest, found.leans)

    def _stack(self, ray: DeviceRay | None) -> Linkage:
        key = b"" if ray is None else ray.key
        if key not in self._stacks:
            hands, direction = self._hands, None
            if ray is not None:
                x, y, z = ray.origin_m.tolist()
                hands = [Linkage(each.body, Point(_DEVICE, (x, y, z))) for each in self.subjects]
                direction = ray.direction
            stack = Linkage.stacked(hands, direction)
            limits = stack.limits.copy()
            for joint, narrow in self._limitation.limits_deg.items():
                column = stack.joints.index(joint)
                low, high = np.radians(narrow)
                limits[:, column, 0] = np.maximum(limits[:, column, 0], low)
                limits[:, column, 1] = np.minimum(limits[:, column, 1], high)
            self._stacks[key] = stack.with_limits(limits)
        return self._stacks[key]

    def _starts(self, rows: Rows, local: FloatArray, trunk: bool) -> FloatArray:
        """(S, B, K) postures to begin with."""
        if rows.ray is not None:
            # (S, K) postures with the elbow at a right angle and the upper arm raised more and
            # more.
            stack = self._stack(rows.ray)
            raised = np.repeat(stack.rest[None], len(_ELEVATIONS_DEG), axis=0)
            raised[:, stack.joints.index("elbow_flexion")] = np.radians(90.0)
            raised[:, stack.joints.index("elv_angle")] = np.radians(60.0)
            raised[:, stack.joints.index("shoulder_elv")] = np.radians(_ELEVATIONS_DEG)
            starts = np.repeat(raised[:, None], len(local), axis=1)
            starts[:, :, -1] = np.linalg.norm(local - self.heads[rows.persons], axis=1)
            return starts
        scaled = local * (self._sizes[0] / self._sizes[rows.persons, None])
        chosen: list[FloatArray] = []
        for straight, count in ((True, _EASY_STARTS), (False, _STARTS)):
            if (trunk, straight) not in self._samples:
                self._samples[trunk, straight] = _samples(self._hands[0], trunk, straight)
            postures, tree = self._samples[trunk, straight]
            chosen.append(postures[tree.query(scaled, k=count)[1].reshape(len(local), count)])
        return np.swapaxes(np.concatenate(chosen, axis=1), 0, 1)

    def _whole(self, stack: Linkage, q: FloatArray) -> FloatArray:
        """(B, J) angles of all joints: the others rest."""
        angles = np.repeat(self.rest[None], len(q), axis=0)
        for column, joint in enumerate(stack.joints):
            if joint in self._joints:
                angles[:, self._joints.index(joint)] = q[:, column]
        return angles


class _Best:
    """The best postures of each row so far: nearest first, then least cost."""

    def __init__(self, count: int, joints: int) -> None:
        self.q = np.zeros((count, _KEPT, joints))
        self.gap, self.cost = np.full((2, count, _KEPT), np.inf)
        self.leans = np.zeros(count, dtype=bool)

    def offer(
        self, rows: Ints, q: FloatArray, gap: FloatArray, cost: FloatArray, *, leans: bool
    ) -> None:
        """Store postures (R, K) of some rows if they are among the best."""
        self.leans[rows] |= leans & (gap < self.gap[rows, 0])
        gaps = np.concatenate([self.gap[rows], gap[:, None]], axis=1)
        costs = np.concatenate([self.cost[rows], cost[:, None]], axis=1)
        postures = np.concatenate([self.q[rows], q[:, None]], axis=1)
        order = np.lexsort((costs, gaps), axis=1)[:, :_KEPT]
        self.gap[rows] = np.take_along_axis(gaps, order, axis=1)
        self.cost[rows] = np.take_along_axis(costs, order, axis=1)
        self.q[rows] = np.take_along_axis(postures, order[..., None], axis=1)


def _hips(body: Body) -> FloatArray:
    """Return where the trunk bends forward, (3,) of the upright body, m."""
    data = mujoco.MjData(body.physics_model)
    mujoco.mj_kinematics(body.physics_model, data)
    hips: FloatArray = data.joint(f"{_TRUNK}flexion").xanchor.copy()
    return hips


def _samples(hand: Linkage, trunk: bool, straight: bool) -> tuple[FloatArray, cKDTree]:
    """Return random postures within the limits, and the positions of the hand in them.

    Args:
        hand: Of one participant.
        trunk: Whether the trunk leans in them.
        straight: Whether wrist and forearm are near their middle.
    """
    rng = np.random.default_rng(_SEED)
    low, high = hand.limits.T
    postures = low + rng.random((_SAMPLES, len(low))) * (high - low)
    leaning = np.array([joint.startswith(_TRUNK) for joint in hand.joints])
    postures[:, leaning] *= 0.7 if trunk else 0.0
    if straight:
        postures[:, [hand.joints.index(joint) for joint in _TURNED]] *= 0.2
    return postures, cKDTree(hand.place(postures))
