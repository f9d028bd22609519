"""Motor primitives of a hand: reach a place and stay, or swing through it in a direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from sim2vr_harness.policies.hierarchical.motor_policy import (
    MOMENT_S,
    WIDTH_M,
    WIDTHS_M,
    MotorGoals,
    MotorPolicy,
    tips,
)
from sim2vr_harness.policies.hierarchical.options import (
    FREE,
    MOVES,
    PLACED,
    PLAIN,
    ROLES,
    SIDEWAYS,
    ControllerInputs,
    OptionSet,
)
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS, Pointing, off_ray, turn_rays

__all__ = [
    "MOVES",
    "PERSONS",
    "Manner",
    "OptionChoice",
    "PrimitiveController",
    "is_strike",
    "is_swing",
    "points",
]

_TOUCH_MPS, _STRAIGHT_MPS, _STRIKE_MPS = 0.9, 2.0, 1.2
"""Lowest approach speeds of hands: touch after lifting off, touch on a straight path, strike."""
_DEEPER_M, _AHEAD_M = 0.025, 0.03
"""Offsets of the goal along the direction of movement. Hands that touch aim behind the place by a
little more than half a depth step. Hands that push at the hand's speed aim before the place,
because the front of a tool arrives first."""
_FURTHER = 1.25
"""Distance at which a hand begins a strike, as a multiple of the run-up."""
_REACHED_M = 0.06
_AHEAD_S, _SOON_S = torch.arange(0.0, 2.5, 0.05), 0.2
"""Times at which the way of a thing that comes is followed ahead, and the shortest time in which a
hand comes to meet it, s."""
_SWING_S, _GONE_S = 0.4, 0.1
"""Time before a meeting at which a hand leaves the start of its run-up, and after it is over, s."""
_DEPTH_WEIGHT = 0.2
"""Weight of depth relative to height and side in the search for the nearest reachable place."""


@dataclass(frozen=True)
class Manner:
    """Parameters of the motion primitives.

    Attributes:
        push_mps: speed through a place, away from the head.
        swing_mps: speed through a place, sideways.
        run_up_m: distance over which a hand accelerates.
        slowest: proportion of the expected speed below which the hand starts the movement again.
        lift_m: largest distance that a hand keeps from the surface until it is beside the place,
            so that it touches nothing on the way.
        by_hand: whether the hand has the speed of a push and carries its tool along, to a little
            before the place; else the tip has this speed, which the wrist can produce.
        commitment: difference in value at which another option replaces the current one, as a
            proportion of a good reward.
        by_width: whether a hand stays before an object until it is well inside its width.
        turns_rays: whether hands that point control the angles of their rays; else they bring the
            ray's point 80 cm ahead to the line to the place.
    """

    push_mps: float = 2.5
    swing_mps: float = 2.0
    run_up_m: float = 0.4
    slowest: float = 0.55
    lift_m: float = 0.05
    by_hand: bool = False
    commitment: float = 0.0
    by_width: bool = False
    turns_rays: bool = False


MEASURED = Manner(by_width=True)
"""Parameters for the measured body, which is trained before the persons."""
PERSONS = Manner(
    push_mps=1.3,
    swing_mps=1.3,
    by_hand=True,
    by_width=True,
    turns_rays=True,
    commitment=0.1,
)
"""Parameters for persons (docs/concepts/people.md)."""
_AIMED = 0.6
"""Share of a thing's width that a hand aims at which comes to it, or whose ray does."""
_ENTERS, _ENTERED, _LIFTED_M, _WELL_BEHIND_M = 0.8, 0.5, 0.02, 0.04
"""Hands that heed widths: from how far beside a thing's middle they go in, and from where deepest,
as shares of its radius; how far outside the first they are lifted off most; how deep deepest is."""
_ABOVE_M = 0.01
"""A hand that is no farther beside its place does not stay before it any more."""
_COMING_MPS = 0.1
"""A hand that is slower sideways to its place does not stay before it so far."""
_TAP_M, _THROUGH_M, _TAP_S = 0.02, 0.005, 0.4
"""Hands that tap: how far behind a surface they aim, and turn back, m; the time after which they
turn back in any case."""
_ARC_M, _ARC_FROM_M = 0.02, 0.06
"""How much farther from the surface than usual they come and go, and from where beside it, m."""
_TOUCH, _PUSH = MOVES.index("touch"), MOVES.index("push")
_SIDEWAYS = torch.tensor([[0.0, *SIDEWAYS.get(name, (0.0, 0.0))] for name in (*PLACED, "rest")])
"""(M + 1, 3) directions of swings, of all others 0; the last row is that of move -1."""
_POINT, _PULL = PLACED.index("point"), PLACED.index("pull")
_ARRIVING = torch.tensor(
    [PLACED.index(n) for n in ("touch", "press", "hold", "grab", "release", "pull")]
)
_ARRIVED_M = 0.035
"""A hand that is so near has come to its place."""
_BACK = torch.tensor([-0.3, 0.0, 0.0])
"""The way of a closed hand that pulls, m."""
_PULLED_S = 1.2
"""Time after which a hand that pulls opens, even if it has not moved the full distance."""
_ON_M, _ON_RAD = 0.012, 0.014
"""Tolerances within which a ray is on its place (either one), besides the inside of its width."""
_PULL_S, _LET_GO_S, _AGAIN_S = 0.1, 0.1, 0.6
"""Duration of a trigger pull, the shortest release, and the pause between pulls at one place."""
_SAME_M = 0.06


def is_swing(move: Tensor) -> Tensor:
    """Return True for each move, by number, that goes through a place sideways."""
    return (move >= len(MOVES) - len(SIDEWAYS)) & (move < len(MOVES))


def is_strike(move: Tensor) -> Tensor:
    """Return True for each move, by number, that goes through a place."""
    return is_swing(move) | (move == _PUSH)


def points(move: Tensor) -> Tensor:
    """Return True for each move, by number, that points at a place."""
    return move == _POINT


def _at(place: Tensor, point: Tensor) -> Tensor:
    """Return (N, H, 3) positions of points (H, 3) of devices at (N, H, 4, 4)."""
    return tips(place, point.expand(len(place), *point.shape))


class _Reach:
    """Reachable positions of a point of a device.

    Args:
        points: (P, 3) samples of these positions, m.
    """

    def __init__(self, points: Tensor) -> None:
        self._points = points.numpy().astype(np.float64)
        self._scale = np.array([_DEPTH_WEIGHT, 1.0, 1.0])
        self._near = cKDTree(self._points)
        self._beside = cKDTree(self._points * self._scale)

    def within(self, wanted: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
        """Return (K,) True for places (K, 3) within the radius of a reachable position.

        A search bounded by the radius takes an eighth of the time of one for the distance.
        """
        away: NDArray[np.float64] = self._near.query(wanted, distance_upper_bound=radius_m)[0]
        return away < radius_m

    def nearest(self, wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 3) these places, or where what is beyond reach is waited for."""
        beyond = ~self.within(wanted, _REACHED_M)
        found = wanted.copy()
        if beyond.any():
            _, instead = self._beside.query(wanted[beyond] * self._scale)
            found[beyond] = self._points[instead]
        return found


class OptionChoice:
    """Options of N users' H hands: a move and a place each.

    Attributes:
        move: (N, H) number of the move, -1: rest.
        seen: (N, H, 3) position of the target in MuJoCo's world frame, m.
        place: (N, H, 3) the same, or the position at which a hand waits for a target beyond its
            reach; 0: none.
        width: (N, H) apparent width of the target, m.
        rested: (N, H) user steps for which a hand with a target has not moved.
        at: (N, H, 3) position of the hand at the start of this time.
        left: (N, H, 3) target at which the hand waited for too long.
        leaving: (N, H) user steps for which the hand avoids this target.
        vain: (N, H) number of times that a hand came back to it and stopped short of it again.
        correction: (N, H, 3) correction of the direction of a ray that points.
        pulled: (N, H) user steps until a trigger is pulled again at the same place.
        pulled_at: (N, H, 3) the place at which it was pulled.
        closed: (N, H) user steps for which the hand has held its squeeze closed; 0: it is open.
        closed_at: (N, H, 3) position at which the hand closed.
        free: (N, H) number of the option without a place that a hand has begun.
        free_left: (N, H) remaining user steps for which this option holds its input.
        tapped: (N, H) user steps since the hand went in for a tap; 0: it has not.
        tapped_at: (N, H, 3) target of this tap.
        velocity: (N, H, 3) of a target that comes and is to be struck, m/s; 0: of others.
        due_s: (N, H) time until such a target is at the place, s; NaN: of others.
    """

    def __init__(self, n: int, hands: int) -> None:
        self.move = torch.full((n, hands), -1, dtype=torch.long)
        self.seen = torch.zeros(n, hands, 3)
        self.place = torch.zeros(n, hands, 3)
        self.width = torch.full((n, hands), WIDTH_M)
        self.rested = torch.zeros(n, hands, dtype=torch.long)
        self.at = torch.full((n, hands, 3), torch.inf)
        self.left = torch.full((n, hands, 3), torch.inf)
        self.leaving = torch.zeros(n, hands, dtype=torch.long)
        self.vain = torch.zeros(n, hands, dtype=torch.long)
        self.correction = torch.zeros(n, hands, 3)
        self.pulled = torch.zeros(n, hands, dtype=torch.long)
        self.pulled_at = torch.full((n, hands, 3), torch.inf)
        self.closed = torch.zeros(n, hands, dtype=torch.long)
        self.closed_at = torch.zeros(n, hands, 3)
        self.free = torch.zeros(n, hands, dtype=torch.long)
        self.free_left = torch.zeros(n, hands, dtype=torch.long)
        self.tapped = torch.zeros(n, hands, dtype=torch.long)
        self.tapped_at = torch.full((n, hands, 3), torch.inf)
        self.velocity = torch.zeros(n, hands, 3)
        self.due_s = torch.full((n, hands), torch.nan)

    def copy(self) -> OptionChoice:
        """Return a copy."""
        new = object.__new__(OptionChoice)
        vars(new).update({name: value.clone() for name, value in vars(self).items()})
        return new

    def put(self, users: NDArray[Any], other: OptionChoice) -> None:
        """Take over from another choice of N users what some of them do."""
        for name, value in vars(self).items():
            value[users] = vars(other)[name][users]

    def forget(self, users: Sequence[int]) -> None:
        """Set users to rest at the start of their rounds."""
        self.put(np.asarray(users, np.int64), OptionChoice(*self.move.shape))


class PrimitiveController:
    """Turns moves into goals of a motor layer, in every user step anew.

    Args:
        tool: (H, 2, 3) points of each device that things are done with, its frame, m: the tip,
            with which it touches and pushes, and the middle, with which it swings through things.
        poses: (P, H, 4, 4) places that the devices can be at.
        rays: with which they point, see :mod:`~.pointing`.
    """

    def __init__(
        self,
        layer: MotorPolicy,
        tool: Tensor,
        poses: Tensor,
        options: OptionSet = PLAIN,
        manner: Manner = Manner(),
        rays: Tensor = AIM_RAYS,
    ) -> None:
        self.layer, self.tool, self.options, self.manner = layer, tool, options, manner
        self.lifts = torch.ones(1, 1, 1)
        """(1, 1, 1) 1: hands stay before surfaces until they are there; 0: they go straight."""
        self.rays, self._pointing = rays, Pointing(poses, rays)
        self._inputs = ControllerInputs(options.inputs, layer.hands)
        self._works = [ROLES.index(FREE[name][0]) for name in options.free]
        self._values = torch.tensor([FREE[name][1] for name in options.free])
        self._reach = [
            [_Reach(_at(poses, tool[:, which])[:, hand]) for which in range(2)]
            for hand in range(len(tool))
        ]

    def within_reach(self, hand: int, places: Tensor, swings: Tensor) -> Tensor:
        """Return (K, 3) places, or for those beyond reach the positions at which the hand waits.

        Args:
            swings: (K,) bool, True for swings through the place.
        """
        found, middle = places.numpy().astype(np.float64), swings.numpy()
        for reach, which in zip(self._reach[hand], (~middle, middle), strict=True):
            if which.any():
                found[which] = reach.nearest(found[which])
        return torch.from_numpy(found).float()

    def meeting(
        self,
        hand: int,
        move: Tensor,
        there: Tensor,
        velocity: Tensor,
        wanted: Tensor,
        late_s: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Return (K, 3) places to meet things at, and (K,) seconds until then; NaN: they rest.

        It is the middle of the first part of the thing's way within reach, or as far along it as
        the hand still comes.

        Args:
            move: (K,) numbers of the moves.
            there: (K, 3) where the things were seen, m.
            velocity: (K, 3) theirs, m/s; 0: of those that do not come.
            wanted: (K, 3) where the hand goes for what does not come.
            late_s: (K,) or (1,) how long ago they were seen, s.
        """
        due_s = torch.full((len(there),), torch.nan)
        comes = velocity.abs().sum(-1) > 0.0
        if not comes.any():
            return wanted, due_s
        late_s = late_s.expand(len(there))[comes]
        way = there[comes, None] + velocity[comes, None] * _AHEAD_S[:, None]
        middle, inside = is_swing(move[comes]), late_s[:, None] < _AHEAD_S
        for reach, own in zip(self._reach[hand], (~middle, middle), strict=True):
            within = reach.within(way[own].numpy().astype(np.float64), _REACHED_M)
            inside[own] &= torch.from_numpy(within)
        first = inside.int().argmax(1)
        number = torch.arange(len(_AHEAD_S))
        left = (~inside & (number >= first[:, None])).int()
        left[:, -1] = 1
        last = left.argmax(1) - 1
        soon = ((late_s + _SOON_S) / _AHEAD_S[1]).ceil().long()
        at = torch.minimum(torch.maximum((first + last) // 2, soon), last).clamp(min=0)
        met = inside.any(1)
        wanted, place = wanted.clone(), way[torch.arange(len(way)), at]
        wanted[comes] = torch.where(met[:, None], place, wanted[comes])
        due_s[comes] = torch.where(met, _AHEAD_S[at] - late_s, torch.nan)
        return wanted, due_s

    def near(self, places: Tensor, radius_m: float) -> NDArray[np.bool_]:
        """Return (K,) True for places (K, 3) within the radius of a tip's reachable positions."""
        wanted = places.numpy().astype(np.float64)
        each = [tip.within(wanted, radius_m) for tip, _ in self._reach]
        return np.logical_or.reduce(each)

    def tips(self, place: Tensor, soon: Tensor) -> tuple[Tensor, Tensor]:
        """Return (N, H, 3) positions, m, and velocities, m/s, of tips.

        Args:
            place: (N, H, 4, 4) poses of the devices.
            soon: their poses ``MOMENT_S`` later.
        """
        now = _at(place, self.tool[:, 0])
        return now, (_at(soon, self.tool[:, 0]) - now) / MOMENT_S

    def goals(self, choice: OptionChoice, head: Tensor, place: Tensor, soon: Tensor) -> MotorGoals:
        """Return the goals of this user step.

        Args:
            choice: what the hands do.
            head: (N, 3) where the headsets are.
            place: (N, H, 4, 4) where the devices are.
            soon: the same ``MOMENT_S`` later.
        """
        goals, manner = MotorGoals.none(*choice.move.shape), self.manner
        goals.tip = torch.where(
            is_swing(choice.move)[..., None], self.tool[:, 1], self.tool[:, 0]
        ).clone()
        now = tips(place, goals.tip)
        velocity = (tips(soon, goals.tip) - now) / MOMENT_S
        away = choice.place - head[:, None]
        away = away / away.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        pushes = (choice.move == _PUSH)[..., None]
        swings = manner.swing_mps * _SIDEWAYS[choice.move]
        directions = torch.where(pushes, manner.push_mps * away, swings)
        touches = torch.isin(choice.move, _ARRIVING)[..., None]
        way = now - choice.place
        along = (way * away).sum(-1, keepdim=True)
        sideways = way - along * away
        beside = sideways.norm(dim=-1, keepdim=True)
        lift_m = self.manner.lift_m
        if self.manner.by_width:
            radius = 0.5 * choice.width[..., None]
            depth = _inside(beside, radius, lift_m * self.lifts)
            taps = (choice.move == _TOUCH)[..., None] & (self.lifts > 0.0)
            tap = self._tap(choice, along, sideways, velocity, radius)
            depth = torch.where(taps, tap, depth)
        else:
            lifted = ((beside - _ABOVE_M) / lift_m).clamp(0.0, 1.0)
            closing = -(velocity * sideways).sum(-1, keepdim=True) / beside.clamp(min=1e-6)
            coming = (closing / _COMING_MPS).clamp(0.0, 1.0)
            lifted = torch.where(lifted < 1.0, lifted * coming, lifted) * self.lifts
            depth = _DEEPER_M - lifted * (_DEEPER_M + lift_m)
        goals.place = choice.place + depth * away * touches
        back = (choice.move == _PULL) & (choice.closed > 0)
        goals.place = torch.where(back[..., None], choice.closed_at + _BACK, goals.place)
        pointing = points(choice.move)
        aimed = (_AIMED * choice.width).clamp(*WIDTHS_M)
        goals.width = torch.where(touches[..., 0] | pointing, aimed, goals.width)
        goals.velocity = directions
        if manner.by_hand:
            # Let hands push that carry their tools along; return where what pushes is, and its
            # velocity.
            placed = (place, soon)
            moving = (now, velocity)
            hand_now, hand_velocity = moving
            hand, later = placed[0][..., :3, 3], placed[1][..., :3, 3]
            carried = goals.place - _AHEAD_M * away + hand - hand_now
            goals.place = torch.where(pushes, carried, goals.place)
            goals.tip = torch.where(pushes, torch.zeros(()), goals.tip)
            hand_velocity = torch.where(pushes, (later - hand) / MOMENT_S, hand_velocity)
            now, velocity = torch.where(pushes, hand, hand_now), hand_velocity
        if not manner.by_hand:
            self._run_up(goals, now, velocity, choice.due_s.isnan())
        # A hand waits for what comes where its run-up begins.
        timed = ~choice.due_s.isnan()
        waits = (choice.due_s > _SWING_S)[..., None]
        begin = goals.place - manner.run_up_m * torch.nn.functional.normalize(directions, dim=-1)
        goals.place = torch.where(waits, begin, goals.place)
        goals.velocity = torch.where(waits, torch.zeros(()), goals.velocity)
        goals.due_s = torch.where(waits[..., 0], torch.nan, choice.due_s)
        choice.due_s = torch.where(
            choice.due_s > -_GONE_S, choice.due_s - self.layer.step_s, torch.nan
        )
        way = goals.place - now
        far = way.norm(dim=-1)
        closing = (velocity * way).sum(-1) / far.clamp(min=1e-3)
        comes = torch.where(self.lifts[..., 0] > 0.0, _TOUCH_MPS, _STRAIGHT_MPS)
        slow = torch.where(touches[..., 0], comes, torch.tensor(_STRIKE_MPS))
        goals.left_s = (far / torch.maximum(closing, slow)).clamp(0.05, 1.2)
        goals.left_s = torch.where(
            timed & ~waits[..., 0], goals.due_s.clamp(min=0.05), goals.left_s
        )
        goals.active = (choice.move >= 0).float()
        if pointing.any():
            goals.place = torch.where(pointing[..., None], choice.seen, goals.place)
            if manner.turns_rays:
                turn_rays(goals, pointing, place, self.rays)
            else:
                self._pointing.aim(goals, choice.correction, pointing, place)
        return goals

    def _tap(
        self,
        choice: OptionChoice,
        along: Tensor,
        sideways: Tensor,
        velocity: Tensor,
        radius: Tensor,
    ) -> Tensor:
        """Return (N, H, 1) depths behind surfaces, m, of the goals of hands that tap.

        A hand comes to the front of its object in an arc. It goes in when it is inside the object's
        width, does not return before it is through, and taps the same place again after a pause.

        Args:
            choice: what the hands do; what they remember of their taps is changed in place.
            along: (N, H, 1) distances of the tips behind their places, m.
            sideways: (N, H, 3) from the lines of sight to the tips, m.
            velocity: (N, H, 3) of the tips, m/s.
            radius: (N, H, 1) radii of the objects, m.
        """
        step_s, beside = self.layer.step_s, sideways.norm(dim=-1)
        soon = (sideways + step_s * velocity).norm(dim=-1)
        inside = torch.maximum(beside, soon) < _ENTERS * radius[..., 0]
        same = ((choice.seen - choice.tapped_at).norm(dim=-1) < _SAME_M) & (choice.move == _TOUCH)
        choice.tapped[~same] = 0
        choice.tapped += (choice.tapped > 0).long()
        begins = (choice.tapped == 0) & (along[..., 0] < 0.0) & inside
        choice.tapped[begins] = 1
        choice.tapped_at[begins] = choice.seen[begins]
        back = round(_TAP_S / step_s)
        through = (choice.tapped > 0) & (along[..., 0] > _THROUGH_M)
        choice.tapped = torch.where(through, choice.tapped.clamp(min=back), choice.tapped)
        choice.tapped[choice.tapped > back + round(_AGAIN_S / step_s)] = 0
        arc = ((beside - 2.0 * radius[..., 0]) / _ARC_FROM_M).clamp(0.0, 1.0)
        arc = torch.where(choice.tapped > 0, 1.0, arc)
        before = self.manner.lift_m + _ARC_M * arc
        goes = (choice.tapped > 0) & (choice.tapped < back)
        return torch.where(goes, _TAP_M, -before)[..., None]

    def inputs(self, choice: OptionChoice, place: Tensor) -> NDArray[np.float32]:
        """(N, F) actions of the fingers in this user step.

        Args:
            choice: what the hands do; what they remember of their inputs is changed in place.
            place: (N, H, 4, 4) where the devices are.
        """
        if not self.options.inputs:
            return np.zeros((len(place), 0), np.float32)
        steps = [round(time_s / self.layer.step_s) for time_s in (_PULL_S, _LET_GO_S, _AGAIN_S)]
        pull, let_go, again = (max(1, count) for count in steps)
        # (N, H) hands that are where they go for, or whose ray is on it.
        near = (_at(place, self.tool[:, 0]) - choice.place).norm(dim=-1) < _ARRIVED_M
        beside, along = off_ray(place, choice.seen, self.rays)
        within = (_ON_RAD * along).clamp(min=_ON_M)
        if self.manner.by_width:
            within = torch.maximum(within, 0.5 * _ENTERED * choice.width)
        met = (along > 0.0) & (beside < within)
        arrived = torch.where(points(choice.move), met, near)
        move = choice.move

        def does(name: str) -> Tensor:
            return arrived & (move == PLACED.index(name))

        fresh = ~((choice.seen - choice.pulled_at).norm(dim=-1) < _SAME_M)
        ready = (choice.pulled <= 0) | (fresh & (choice.pulled <= again - pull - let_go))
        pulls = (does("press") | does("point")) & ready
        choice.pulled[pulls] = again
        choice.pulled_at[pulls] = choice.seen[pulls]
        # Close and open hands; those that have pulled open.
        closes = does("grab") | does("pull")
        opens = does("release")
        tip = _at(place, self.tool[:, 0])
        back = (tip - choice.closed_at - _BACK).norm(dim=-1) < _ARRIVED_M
        late = choice.closed >= round(_PULLED_S / self.layer.step_s)
        pulled = (choice.move == _PULL) & (choice.closed > 0) & (back | late)
        begins = closes & (choice.closed == 0)
        choice.closed_at[begins] = tip[begins]
        choice.closed += ((choice.closed > 0) | closes).long()
        choice.closed[opens | pulled] = 0
        values = torch.zeros(*move.shape, len(ROLES))
        pulled = (choice.pulled > again - pull) | does("hold")
        values[..., ROLES.index("trigger")] = pulled.float()
        values[..., ROLES.index("squeeze")] = (choice.closed > 0).float()
        for number, (role, value) in enumerate(zip(self._works, self._values, strict=True)):
            values[..., role][(choice.free == number) & (choice.free_left > 0)] = value
        choice.pulled = (choice.pulled - 1).clamp(min=0)
        choice.free_left = (choice.free_left - 1).clamp(min=0)
        return self._inputs.actions(values)

    def begin_free(self, choice: OptionChoice, which: Tensor, option: Tensor) -> None:
        """Let hands (N, H) begin options without a place, by their positions in the set."""
        choice.free = torch.where(which, option, choice.free)
        choice.free_left[which] = max(1, round(_PULL_S / self.layer.step_s))

    def _run_up(self, goals: MotorGoals, now: Tensor, velocity: Tensor, free: Tensor) -> None:
        """Send hands back that are about to go through their place too slowly.

        Args:
            goals: changed in place.
            now: (N, H, 3) where the tips are.
            velocity: (N, H, 3) theirs.
            free: (N, H) False for hands that have a time to be there.
        """
        speed, run_up = goals.velocity.norm(dim=-1, keepdim=True), self.manner.run_up_m
        direction = goals.velocity / speed.clamp(min=1e-6)
        before = ((goals.place - now) * direction).sum(-1, keepdim=True)
        due = self.manner.slowest * speed * (1.0 - before / run_up).clamp(max=1.0)
        late = (velocity * direction).sum(-1, keepdim=True) < due
        back = late & (speed > 0.0) & free[..., None]
        begin = goals.place - _FURTHER * run_up * direction
        goals.place = torch.where(back, begin, goals.place)
        goals.velocity = torch.where(back, torch.zeros(()), goals.velocity)


def _inside(beside: Tensor, radius: Tensor, lift_m: Tensor) -> Tensor:
    """Return (N, H, 1) depths of goals behind surfaces for hands with ``by_width``, m.

    Depths are negative before the surface.

    Args:
        beside: (N, H, 1) distances from the middles of objects, m.
        radius: (N, H, 1) radii of the objects, m.
        lift_m: (1, 1, 1) largest distance of hands before the surface.
    """
    share = beside / radius
    behind = _WELL_BEHIND_M * ((_ENTERS - share) / (_ENTERS - _ENTERED)).clamp(max=1.0)
    before = lift_m * ((beside - _ENTERS * radius) / _LIFTED_M).clamp(max=1.0)
    return torch.where(share < _ENTERS, behind, -before)
