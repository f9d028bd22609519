"""Beats as a differentiable game.

Boxes, mines and walls come by the levels of the true game. What is cut is decided by its rules, but
the reward is relaxed, so that it has a gradient: a cut counts with the probability that it would
happen if blade and box met a little elsewhere, a little faster or at a little other angle.
"""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.games.app_axes import head_of
from sim2vr_harness.games.beats.cuts import (
    CONTACT_MARGIN_M,
    Contact,
    aside,
    first_or_closest,
    off_stroke,
    turns,
)
from sim2vr_harness.games.beats.lane import Coming, Lane
from sim2vr_harness.games.beats.levels import Levels
from sim2vr_harness.games.beats.rules import (
    ANGLE_LIMIT_DEG,
    BLADE_RADIUS_M,
    CUT_PLANE_M,
    HEAD_RADIUS_M,
    MINE_RADIUS_M,
    STAB_MPS,
    TOLD_BOXES,
    TOLD_MINES,
    TOLD_WALLS,
)
from sim2vr_harness.games.beats.sabers import (
    HANDS,
    Blades,
    Sabers,
    distances,
    looked_away,
    nearest,
    swing,
    velocities,
)
from sim2vr_harness.games.beats.settings import GameModelSettings, Relaxation

_HEAD = tuple(f"head.{axis}_m" for axis in "xyz")
_ROOT = tuple(f"{hand}.root_{axis}_m" for hand in HANDS for axis in "xyz")
_AXIS = tuple(f"{hand}.axis_{axis}" for hand in HANDS for axis in "xyz")
_TIP = tuple(f"{hand}.tip_v{axis}_mps" for hand in HANDS for axis in "xyz")
FIELDS = (*_HEAD, *_ROOT, *_AXIS, *_TIP)
"""The privileged numbers that go with a user step, in this order."""

_MOMENTS = (0.25, 0.5, 0.75, 1.0)
"""Shares of a frame in which blades and boxes are tested for contact."""
_NEAR_M, _NEAR_S, _NEAR_MPS = 0.3, 0.12, 2.0
_STROKE_S, _STROKE_OFF_M = 0.5, 0.5
_WALL_SOFT_M, _CLEAR_M, _GONE_M = 0.03, 0.06, 10.0


class ImaginedBeats(State):
    """B rounds without an end; see :class:`~sim2vr_harness.games.imagined.ImaginedRounds`.

    A level that is over is followed by another one; a missed box ends nothing.

    Args:
        n: number of users B.
        levels: that are played.
        conditions: how many there are.
        settings: what is relaxed.
        step_s: duration of a user step, which is a frame.
        seed: of which level comes when.
    """

    names: tuple[str, ...]

    def __init__(
        self,
        n: int,
        levels: Levels,
        conditions: int,
        settings: GameModelSettings,
        *,
        step_s: float,
        seed: int,
    ) -> None:
        self.n, self.settings, self.sabers, self._step_s = n, settings, Sabers(), step_s
        self.frames = 1  # blades go straight from the end of a step to that of the next
        self.lane = Lane(n, levels, seed)
        self.spawn_weights = torch.ones(conditions, 1)
        self.counts = torch.zeros(2, conditions, 1)
        self.events = torch.zeros(len(EVENTS))
        """How often what happened since :meth:`clear_counts`; :data:`EVENTS` has the names."""
        self._origin = torch.zeros(n, 3)
        self._tip_velocity = torch.zeros(n, 2, 3)
        self._before: Blades | None = None
        """The blades at the last frame."""
        boxes, mines, walls = levels.box_time, levels.mine_time, levels.wall_start
        self._box_left = torch.ones(n, boxes.shape[1])
        self._mine_left = torch.ones(n, mines.shape[1])
        self._wall_left = torch.ones(n, walls.shape[1])
        """How likely each is still there, if contacts are soft."""
        self.names = _names()

    # --- rounds ------------------------------------------------------------------------------

    def calibrate(self, place: Tensor, fields: Tensor) -> None:
        """See the protocol."""
        root, axis = (_of(fields, names).reshape(-1, 2, 3) for names in (_ROOT, _AXIS))
        self.sabers.calibrate(place, root, axis)

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        """See the protocol; which level it is, and where in it, is left to chance."""
        with torch.no_grad():
            self.lane.begin(ids, busy=self.settings.values.busy_starts)
            self._box_left[ids], self._mine_left[ids], self._wall_left[ids] = 1.0, 1.0, 1.0
            self._origin[ids] = head_of(place) - _of(fields, _HEAD)
            self._tip_velocity[ids] = _of(fields, _TIP).reshape(-1, 2, 3)
            blades = self.sabers(place, self._origin[ids])
            if self._before is None:
                self._before = Blades(torch.zeros(self.n, 2, 3), torch.zeros(self.n, 2, 3))
            self._before.root[ids], self._before.axis[ids] = blades.root, blades.axis

    def begin(self, ids: Tensor) -> None:
        """See the protocol."""
        self.lane.begin(ids)

    def cut(self) -> None:
        """See the protocol."""
        before = self._before
        if before is not None:
            self._before = Blades(before.root.detach(), before.axis.detach())
        self._tip_velocity = self._tip_velocity.detach()
        for name in ("_box_left", "_mine_left", "_wall_left"):
            setattr(self, name, getattr(self, name).detach())

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """See the protocol: rounds may begin anywhere."""
        count = len(place)
        return torch.full((count,), torch.inf), torch.zeros(count, dtype=torch.long)

    def condition_of(self, fields: Tensor) -> Tensor:
        """See the protocol: a user step of one condition is as good as any other's."""
        return torch.zeros(len(fields), dtype=torch.long)

    def clear_counts(self) -> None:
        """See the protocol."""
        self.counts.zero_()
        self.events.zero_()

    def adapt(self) -> None:
        """See the protocol: levels come as they are."""

    _state = (
        "_origin",
        "_tip_velocity",
        "_box_left",
        "_mine_left",
        "_wall_left",
        "lane",
        "_before",
        "sabers.fixed",
    )

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state_dict`."""
        self._before = self._before or Blades(torch.zeros(0), torch.zeros(0))
        super().load_state_dict(state)

    # --- what is observed --------------------------------------------------------------------

    def observe(self, place: Tensor) -> Tensor:
        """(B, F) in the order of :attr:`names`, differentiable by the places."""
        lane, levels = self.lane, self.lane.levels
        head = head_of(place) - self._origin
        blades = self.sabers(place, self._origin)
        root = blades.root - head[:, None]
        on = torch.ones(self.n, 1)
        parts = [head]
        for hand in range(2):
            parts += [root[:, hand], blades.axis[:, hand], self._tip_velocity[:, hand], on]
        for hand in range(2):
            coming = lane.boxes(hand, head[:, 2].detach())
            middle = self._middles(lane.of(levels.box, coming), coming, head)
            parts.append(_told(coming, middle, lane.of(levels.box_cut, coming)))
        coming = lane.mines(head[:, 2].detach())
        parts.append(_told(coming, self._middles(lane.of(levels.mine, coming), coming, head)))
        parts.append(self._told_walls(head))
        parts.append(lane.speed[:, None])
        return torch.cat(parts, 1)

    def _middles(self, across: Tensor, coming: Coming, head: Tensor) -> Tensor:
        """(B, K, 3) middles of boxes or mines, minus the head."""
        away = CUT_PLANE_M + self.lane.speed[:, None] * coming.until_s
        return torch.cat([across, away[..., None]], -1) - head[:, None]

    def _told_walls(self, head: Tensor) -> Tensor:
        lane, levels = self.lane, self.lane.levels
        coming = lane.walls(head[:, 2].detach())
        ends = lane.of(levels.wall_end, coming) - lane.time_s[:, None]
        sides = lane.of(levels.wall, coming)
        x, y = head[:, None, 0], head[:, None, 1]
        told = [
            *(torch.ones_like(ends), coming.until_s, ends),
            *(sides[..., 0] - x, sides[..., 1] - x, sides[..., 2] - y, sides[..., 3] - y),
        ]
        return (torch.stack(told, -1) * coming.there[..., None]).flatten(1)

    # --- a user step -------------------------------------------------------------------------

    def step(self, places: Tensor, done: float) -> Tensor:
        """See the protocol; blades sweep straight from the end of a step to that of the next."""
        return self.play(places[:, -1], self.settings.relaxation(done))

    def play(self, place: Tensor, soft: Relaxation) -> Tensor:
        """Advance by one user step; see :meth:`step`."""
        lane = self.lane
        head = head_of(place) - self._origin
        after = self.sabers(place, self._origin)
        before = after if self._before is None else self._before
        reward = self._judge_boxes(before, after, head, soft)
        reward = reward - self._judge_mines(before, after, head, soft)
        over = lane.advance(self._step_s)
        reward = reward - self._judge_walls(head, soft)
        reward = reward - self.settings.values.gaze_cost * looked_away(place)
        boxes, mines = lane.passed()
        self._count("missed", boxes)
        self._count("avoided", mines)
        failed = boxes.sum(1).float()
        self.counts[1, :, 0].index_add_(0, lane.condition, failed)
        lane.box_gone, lane.mine_gone = lane.box_gone | boxes, lane.mine_gone | mines
        self._tip_velocity = (after.tip - before.tip) / self._step_s
        self._before = after
        ids = torch.nonzero(over).flatten()
        if len(ids):
            self.lane.begin(ids)
            for name in ("_box_left", "_mine_left", "_wall_left"):
                fresh = getattr(self, name).clone()
                fresh[ids] = 1.0
                setattr(self, name, fresh)
        return reward

    def _judge_boxes(self, before: Blades, after: Blades, head: Tensor, soft: Relaxation) -> Tensor:
        lane, levels = self.lane, self.lane.levels
        each = [lane.boxes(hand, head[:, 2].detach()) for hand in range(2)]
        coming = Coming(
            *(
                torch.cat([getattr(one, name) for one in each], 1)
                for name in ("which", "there", "until_s")
            )
        )
        across, cut = lane.of(levels.box, coming), lane.of(levels.box_cut, coming)
        half = lane.of(levels.box_half, coming)
        # Blades and boxes in this frame.
        shares = torch.tensor(_MOMENTS)
        blades = swing(before, after, shares)
        middles = self._during(across, coming, shares)
        free = cut.abs().sum(-1) == 0.0
        apart, along = distances(blades, middles, turns(cut), half)
        passed = (middles[..., 2] <= 0.0)[:, None]  # missed on the way, no one can cut it
        apart = torch.where(passed, _GONE_M, apart - BLADE_RADIUS_M)
        when = first_or_closest(apart)
        apart, along = (values.gather(-1, when)[..., 0] for values in (apart, along))
        axis = blades.axis[:, :, None].expand(*when.shape[:3], len(_MOMENTS), 3)
        axis = axis.gather(3, when[..., None].expand(*when.shape, 3))[..., 0, :]
        velocity = velocities(before, after, along, axis, self._step_s)
        flat = velocity[..., :2]
        speed = velocity.square().sum(-1).add(1e-6).sqrt()
        forward = (flat * cut[:, None]).sum(-1)
        sideways = flat[..., 0] * cut[:, None, :, 1] - flat[..., 1] * cut[:, None, :, 0]
        angle = torch.atan2((sideways.square() + 1e-8).sqrt(), forward).rad2deg()
        angle = torch.where(flat.detach().norm(dim=-1) < STAB_MPS, 180.0, angle)
        angle = torch.where(free[:, None], 0.0, angle)
        contact = Contact(apart, speed, angle, forward)
        own = torch.eye(2).repeat_interleave(TOLD_BOXES, 1)  # (blade, box): hand is the box's
        there = coming.there[:, None]
        # Take cut boxes away and count them, by the true rules.
        boxes_lane = self.lane
        cuts = coming.there[:, None] & contact.cuts()
        right = cuts & (contact.angle <= ANGLE_LIMIT_DEG) & (own > 0)
        self._count("sliced", right)
        self._count("wrong hand", (cuts & (own == 0)).any(1) & ~right.any(1))
        self._count("wrong direction", cuts & (own > 0) & ~right)
        gone, sliced = cuts.any(1), right.any(1)
        for row, ended in enumerate((sliced, gone & ~sliced)):
            self.counts[row, :, 0].index_add_(0, boxes_lane.condition, ended.sum(1).float())
        boxes_lane.box_gone = boxes_lane.box_gone.scatter(
            1, coming.which, boxes_lane.box_gone.gather(1, coming.which) | gone
        )
        left = self._box_left.gather(1, coming.which)
        chance = there * contact.chance(soft)
        worth = own * contact.worth(soft) - (1.0 - own) * soft.error
        reward = (left[:, None] * chance * worth).sum((1, 2))
        left = left * (1.0 - chance).prod(1)
        self._box_left = self._box_left.scatter(1, coming.which, left)
        if soft.near > 0.0:
            arrives = torch.exp(-(coming.until_s / _NEAR_S).square())[:, None]
            around = torch.exp(-aside(after, across, cut, half) / _NEAR_M)
            towards = 0.5 + 0.5 * torch.tanh(contact.forward / _NEAR_MPS)
            near = own * there * arrives * around * towards * left.detach()[:, None]
            reward = reward + soft.near * near.sum((1, 2))
        if soft.stroke > 0.0:
            first = slice(None, None, TOLD_BOXES)  # the next box of each hand
            until_s = coming.until_s[:, first] - self._step_s
            off = off_stroke(after, across[:, first], cut[:, first], until_s)
            due = coming.there[:, first] & (until_s.abs() < _STROKE_S)
            reward = reward + soft.stroke * (due * (1.0 - off / _STROKE_OFF_M)).sum(1)
        return reward

    def _during(self, across: Tensor, coming: Coming, shares: Tensor) -> Tensor:
        """(B, K, S, 3) middles at moments of the frame that begins now, from the origin."""
        until = coming.until_s[..., None] - shares * self._step_s
        away = CUT_PLANE_M + self.lane.speed[:, None, None] * until
        sides = across[:, :, None].expand(*away.shape, 2)
        return torch.cat([sides, away[..., None]], -1)

    def _judge_mines(self, before: Blades, after: Blades, head: Tensor, soft: Relaxation) -> Tensor:
        lane, levels = self.lane, self.lane.levels
        coming = lane.mines(head[:, 2].detach())
        if not bool(coming.there.any()):
            return torch.zeros(self.n)
        shares = torch.tensor(_MOMENTS)
        blades = swing(before, after, shares)
        middles = self._during(lane.of(levels.mine, coming), coming, shares)
        along, from_root = nearest(blades, middles)
        gap = from_root - along[..., None] * blades.axis[:, :, None]
        apart = gap.square().sum(-1).add(1e-8).sqrt() - MINE_RADIUS_M - BLADE_RADIUS_M
        # Avoided on the way, no one can touch it.
        apart = torch.where((middles[..., 2] <= 0.0)[:, None], _GONE_M, apart)
        apart = apart.amin((1, 3))  # (B, K)
        touched = coming.there & (apart <= 0.0)
        self._count("mines", touched)
        gone = lane.mine_gone.gather(1, coming.which) | touched
        lane.mine_gone = lane.mine_gone.scatter(1, coming.which, gone)
        left = self._mine_left.gather(1, coming.which)
        chance = coming.there * torch.sigmoid((CONTACT_MARGIN_M - apart) / soft.contact_m)
        self._mine_left = self._mine_left.scatter(1, coming.which, left * (1.0 - chance))
        return soft.hazard * (left * chance).sum(1)

    def _judge_walls(self, head: Tensor, soft: Relaxation) -> Tensor:
        lane, levels = self.lane, self.lane.levels
        coming = lane.walls(head[:, 2].detach())
        if not bool(coming.there.any()):
            return torch.zeros(self.n)
        speed = lane.speed[:, None]
        # They are reported at the time before; the head is where it is now.
        front = speed * (lane.of(levels.wall_start, coming) - lane.time_s[:, None])
        back = speed * (lane.of(levels.wall_end, coming) - lane.time_s[:, None])
        z, reach = head[:, None, 2], HEAD_RADIUS_M
        here = coming.there & (front - reach <= z) & (z <= back + reach)
        sides = lane.of(levels.wall, coming)
        x, y = head[:, None, 0], head[:, None, 1]
        deep = torch.stack(
            [x - sides[..., 0], sides[..., 1] - x, y - sides[..., 2], sides[..., 3] - y], -1
        ).amin(-1)
        deep = deep + reach
        touched = here & (deep > 0.0) & ~lane.wall_gone.gather(1, coming.which)
        self._count("walls", touched)
        gone = lane.wall_gone.gather(1, coming.which) | touched
        lane.wall_gone = lane.wall_gone.scatter(1, coming.which, gone)
        left = self._wall_left.gather(1, coming.which)
        chance = here * torch.sigmoid((deep + 0.02) / _WALL_SOFT_M)
        self._wall_left = self._wall_left.scatter(1, coming.which, left * (1.0 - chance))
        inside = (
            self.settings.values.wall_cost * (here * (deep + _CLEAR_M).clamp(min=0.0)).sum(1) / 0.1
        )
        return soft.hazard * (left * chance).sum(1) + inside

    def _count(self, event: str, happened: Tensor) -> None:
        self.events[EVENTS.index(event)] += happened.sum()


EVENTS = ("sliced", "missed", "wrong hand", "wrong direction", "mines", "avoided", "walls")


def _told(coming: Coming, middle: Tensor, cut: Tensor | None = None) -> Tensor:
    """(B, K F) what is reported of boxes or mines; 0 where there is none."""
    parts = [torch.ones_like(coming.until_s)[..., None], coming.until_s[..., None], middle]
    if cut is not None:
        parts.append(cut)
    return (torch.cat(parts, -1) * coming.there[..., None]).flatten(1)


def _of(fields: Tensor, names: tuple[str, ...]) -> Tensor:
    first = FIELDS.index(names[0])
    return fields[:, first : first + len(names)]


def _names() -> tuple[str, ...]:
    """What :meth:`ImaginedBeats.observe` gives, by the true game's names."""
    names = list(_HEAD)
    for k, hand in enumerate(HANDS):
        part = slice(3 * k, 3 * k + 3)
        names += [*_ROOT[part], *_AXIS[part], *_TIP[part], f"{hand}.on"]
    place = ("present", "time_s", "x_m", "y_m", "z_m")
    for hand in HANDS:
        for i in range(TOLD_BOXES):
            names += [f"{hand}{i}.{part}" for part in (*place, "dir_x", "dir_y")]
    names += [f"mine{i}.{part}" for i in range(TOLD_MINES) for part in place]
    wall = ("present", "start_s", "end_s", "left_m", "right_m", "bottom_m", "top_m")
    names += [f"wall{i}.{part}" for i in range(TOLD_WALLS) for part in wall]
    return (*names, "round.speed_mps")
