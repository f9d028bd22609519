"""Beats as a differentiable game.

Boxes, mines and walls come by the levels of the true game. What is cut is decided by its rules, but
the reward is relaxed, so that it has a gradient: a cut counts with the probability that it would
happen if blade and box met a little elsewhere, a little faster or at a little other angle.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.games.app_axes import head_of, to_app
from sim2vr_harness.games.beats.levels import NEVER_S, Levels
from sim2vr_harness.games.beats.rules import (
    ANGLE_LIMIT_DEG,
    ANGLE_POINTS,
    BASE_POINTS,
    BLADE_FROM_M,
    BLADE_M,
    BLADE_RADIUS_M,
    CUT_PLANE_M,
    FAR_M,
    FULL_CUT_MPS,
    HEAD_RADIUS_M,
    MIN_CUT_MPS,
    MINE_RADIUS_M,
    SPEED_POINTS,
    STAB_MPS,
    TOLD_BOXES,
    TOLD_MINES,
    TOLD_WALLS,
    WALL_BEHIND_M,
)
from sim2vr_harness.games.beats.settings import GameModelSettings, Relaxation

HANDS = ("left", "right")
"""Hands, in the order of the boxes' hand numbers."""
_ALONG_M = (-0.15, 0.0, 0.15)
"""Points of a blade by which its distance from a box is found, about the one nearest to the box's
middle: within 2 cm of the exact distance."""


@dataclass(frozen=True)
class Blades:
    """Both sabers' blades, the app's axes (x right, y up, z forward), from the round's origin.

    Attributes:
        root: (B, 2, 3) lower ends, m.
        axis: (B, 2, 3) unit vectors to the tips.
    """

    root: Tensor
    axis: Tensor

    @property
    def tip(self) -> Tensor:
        """(B, 2, 3) m."""
        return self.root + BLADE_M * self.axis


def looked_away(place: Tensor) -> Tensor:
    """Return (B,) squared angles of heads from the direction of the boxes, 1 at 45 degrees.

    Roll counts half.
    """
    ahead, up = place[:, -1, 0, 0], place[:, -1, 2, 2]
    # 2 (1 - cos) is the angle's square, nearly; it has no corner at 0.
    squares: Tensor = 2.0 * (1.0 - ahead) + (1.0 - up)
    return squares / (0.25 * torch.pi) ** 2


class Sabers:
    """The blades by the controllers' places: they are fixed to them."""

    def __init__(self) -> None:
        # Along the grip's forward axis, unless the true game says something else.
        root = torch.tensor([BLADE_FROM_M, 0.0, 0.0])
        axis = torch.tensor([1.0, 0.0, 0.0])
        self.fixed = torch.stack([root, axis]).repeat(2, 1, 1)
        """(2, 2, 3) of each hand, in the controller's frame (MuJoCo's axes): root and axis."""

    def calibrate(self, place: Tensor, root: Tensor, axis: Tensor) -> None:
        """Find how the blades are fixed.

        Args:
            place: (K, D, 4, 4) of both controllers and the headset.
            root: (K, 2, 3) lower ends from the head.
            axis: (K, 2, 3).
        """
        hands = place[:, :2]
        rotation = hands[..., :3, :3]
        head = head_of(place)[:, None]
        given = torch.stack([root + head, axis], 2)  # (K, 2, 2, 3)
        back = torch.stack([given[..., 2], -given[..., 0], given[..., 1]], -1)
        back = torch.stack([back[:, :, 0] - hands[..., :3, 3], back[:, :, 1]], 2)
        local = torch.einsum("khji,khpj->khpi", rotation, back)
        self.fixed = local.median(0).values
        self.fixed[:, 1] /= self.fixed[:, 1].norm(dim=1, keepdim=True)

    def __call__(self, place: Tensor, origin: Tensor) -> Blades:
        """(B, D, 4, 4) places and (B, 3) the rounds' origins."""
        hands = place[:, :2]
        turned = torch.einsum("bhij,hpj->bhpi", hands[..., :3, :3], self.fixed)
        root = to_app(turned[:, :, 0] + hands[..., :3, 3]) - origin[:, None]
        return Blades(root, to_app(turned[:, :, 1]))


def swing(before: Blades, after: Blades, shares: Tensor) -> Blades:
    """The blades at moments of a frame: hands move straight and turn at constant rate, nearly.

    Args:
        before: at the frame before.
        after: at this one.
        shares: (S,) of the frame's duration.

    Returns:
        roots and axes (B, 2, S, 3).
    """
    part = shares[:, None]
    root = before.root[:, :, None] + part * (after.root - before.root)[:, :, None]
    axis = before.axis[:, :, None] + part * (after.axis - before.axis)[:, :, None]
    return Blades(root, axis / axis.norm(dim=-1, keepdim=True).clamp(min=0.1))


def nearest(blades: Blades, middles: Tensor) -> tuple[Tensor, Tensor]:
    """Return the position along a blade of the point nearest to a box's middle.

    Args:
        blades: (B, 2, S, 3).
        middles: (B, K, S, 3) m.

    Returns:
        (B, 2, K, S) distances from the root, m, and (B, 2, K, S, 3) the middles relative to the
        root.
    """
    from_root = middles[:, None] - blades.root[:, :, None]
    along = (from_root * blades.axis[:, :, None]).sum(-1)
    return along.clamp(0.0, BLADE_M), from_root


def distances(
    blades: Blades, middles: Tensor, turns: Tensor, half_m: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the distances of the blades' axes from cubes, m; below 0 inside.

    Args:
        blades: (B, 2, S, 3).
        middles: (B, K, S, 3) of the cubes.
        turns: (B, K, 2) cosine and sine of their rotation about z.
        half_m: (B, K) half of an edge.

    Returns:
        (B, 2, K, S) distances, and the position along the blade of the point nearest to the middle.
    """
    along, from_root = nearest(blades, middles)
    shifts = torch.tensor(_ALONG_M)
    points = (along[..., None] + shifts).clamp(0.0, BLADE_M)  # (B, 2, K, S, P)
    axis = blades.axis[:, :, None, :, None]
    apart = points[..., None] * axis - from_root[..., None, :]
    cos, sin = turns[:, None, :, None, None, 0], turns[:, None, :, None, None, 1]
    x = cos * apart[..., 0] + sin * apart[..., 1]
    y = cos * apart[..., 1] - sin * apart[..., 0]
    beyond = torch.stack([x, y, apart[..., 2]], -1).abs() - half_m[:, None, :, None, None, None]
    outside = beyond.clamp(min=0.0).square().sum(-1).add(1e-8).sqrt()
    deep = beyond.amax(-1).clamp(max=0.0)
    return (outside + deep).amin(-1), along


def velocities(before: Blades, after: Blades, along: Tensor, axis: Tensor, step_s: float) -> Tensor:
    """(B, 2, K, 3) velocity of blades' points less what is along the blade, m/s.

    Args:
        before: (B, 2, 3).
        after: (B, 2, 3).
        along: (B, 2, K) how far the points are from the roots, m.
        axis: (B, 2, K, 3) of the blade at that moment.
        step_s: duration of the frame.
    """
    moved = (after.root - before.root)[:, :, None]
    turned = (after.axis - before.axis)[:, :, None]
    velocity = (moved + along[..., None] * turned) / step_s
    return velocity - (velocity * axis).sum(-1, keepdim=True) * axis


_BEFORE_S = (0.5, 1.0)
"""Range of the time between the start of a busy round and the arrival of a box."""


@dataclass(frozen=True)
class Coming:
    """The next K things of a kind, of B rounds, as they are in the game.

    Attributes:
        which: (B, K) their places in the level's lists.
        there: (B, K) whether there is one.
        until_s: (B, K) time until they arrive.
    """

    which: Tensor
    there: Tensor
    until_s: Tensor


class Lane(State):
    """B rounds' levels and how far they are.

    Args:
        n: number of rounds B.
        levels: to choose from.
        seed: of which level comes when.
    """

    def __init__(self, n: int, levels: Levels, seed: int) -> None:
        self.n, self.levels = n, levels
        self.generator = torch.Generator().manual_seed(seed)
        self.level = torch.zeros(n, dtype=torch.long)
        """(B,) numbers of the levels."""
        self.time_s = torch.zeros(n)
        """(B,) the level's time."""
        self.box_gone = torch.zeros(n, levels.box_time.shape[1], dtype=torch.bool)
        self.mine_gone = torch.zeros(n, levels.mine_time.shape[1], dtype=torch.bool)
        self.wall_gone = torch.zeros(n, levels.wall_start.shape[1], dtype=torch.bool)
        """Flags of boxes and mines that were cut, touched or missed, and of walls that the head was
        in."""

    @property
    def speed(self) -> Tensor:
        """(B,) m/s."""
        return self.levels.speed[self.level]

    @property
    def condition(self) -> Tensor:
        """(B,)."""
        return self.levels.condition[self.level]

    def begin(self, ids: Tensor, *, busy: float | None = None) -> None:
        """Start rounds ``ids`` with newly sampled levels.

        Args:
            ids: (K,).
            busy: share of those that begin shortly before a box arrives, the others at any moment;
                None: all at the level's start.
        """
        count, generator = len(ids), self.generator
        level = torch.randint(len(self.levels.speed), (count,), generator=generator)
        self.level[ids] = level
        if busy is None:
            self.time_s[ids] = 0.0
        else:
            any_s = torch.rand(count, generator=generator) * self.levels.length[level]
            times = self.levels.box_time[level]
            real = (times < NEVER_S).float() + 1e-9
            box = torch.multinomial(real, 1, generator=generator)
            least, most = _BEFORE_S
            before_s = least + (most - least) * torch.rand(count, generator=generator)
            near_s = (times.gather(1, box)[:, 0] - before_s).clamp(min=0.0)
            hurried = torch.rand(count, generator=generator) < busy
            self.time_s[ids] = torch.where(hurried & (near_s < NEVER_S / 2), near_s, any_s)
        arrived = self.time_s[ids, None] + self._late(level)
        self.box_gone[ids] = self.levels.box_time[level] <= arrived
        self.mine_gone[ids] = self.levels.mine_time[level] <= arrived
        self.wall_gone[ids] = self.levels.wall_end[level] <= self.time_s[ids, None]

    def _late(self, level: Tensor) -> Tensor:
        """Return (K, 1) the negative time from a box's time to its passing of the head plane, s."""
        return -CUT_PLANE_M / self.levels.speed[level, None]

    def advance(self, step_s: float) -> Tensor:
        """Advance the time and return (B,) True for levels that are over."""
        self.time_s = self.time_s + step_s
        return self.time_s >= self.levels.length[self.level] - 1e-3

    def passed(self) -> tuple[Tensor, Tensor]:
        """(B, N) boxes and (B, M) mines that have come to the head plane and are not gone."""
        late = self.time_s[:, None] + self._late(self.level)
        boxes = (self.levels.box_time[self.level] <= late) & ~self.box_gone
        return boxes, (self.levels.mine_time[self.level] <= late) & ~self.mine_gone

    def boxes(self, hand: int, head_z: Tensor) -> Coming:
        """The next boxes of a hand that have been seen; ``head_z`` (B,) m from the origin."""
        time = self.levels.box_time[self.level]
        mine = (self.levels.box_hand[self.level] == hand) & ~self.box_gone
        return self._next(time, mine & self._seen(time, CUT_PLANE_M, head_z), TOLD_BOXES)

    def mines(self, head_z: Tensor) -> Coming:
        """The next mines that have been seen."""
        time = self.levels.mine_time[self.level]
        seen = self._seen(time, CUT_PLANE_M, head_z)
        return self._next(time, ~self.mine_gone & seen, TOLD_MINES)

    def walls(self, head_z: Tensor) -> Coming:
        """The next walls that have been seen, whether the head was in them or not."""
        time, end = self.levels.wall_start[self.level], self.levels.wall_end[self.level]
        behind_s = WALL_BEHIND_M / self.speed[:, None]
        there = self._seen(time, 0.0, head_z) & (end + behind_s > self.time_s[:, None])
        return self._next(time, there, TOLD_WALLS)

    def _seen(self, time: Tensor, at_m: float, head_z: Tensor) -> Tensor:
        until = time - self.time_s[:, None]
        away = at_m + self.speed[:, None] * until - head_z[:, None]
        return (away <= FAR_M) & (until <= self.levels.approach[self.level, None])

    def _next(self, time: Tensor, there: Tensor, count: int) -> Coming:
        until = torch.where(there, time - self.time_s[:, None], torch.tensor(torch.inf))
        first = until.topk(count, dim=1, largest=False)
        present = first.values < torch.inf
        nothing = time.shape[1] - 1  # the last one never comes: no one else is written over
        which = torch.where(present, first.indices, nothing)
        return Coming(which, present, torch.where(present, first.values, 0.0))

    def of(self, values: Tensor, coming: Coming) -> Tensor:
        """(B, K, ...) the levels' ``values`` (P, N, ...) of what comes."""
        return values[self.level[:, None], coming.which]

    _state = ("level", "time_s", "box_gone", "mine_gone", "wall_gone", "generator")


CONTACT_MARGIN_M, _SPEED_MARGIN_MPS, _ANGLE_MARGIN_DEG = 0.01, 0.1, 5.0
_STROKE_MPS, _DRAWN_M = 3.0, 0.4


@dataclass(frozen=True)
class Contact:
    """Closest or first contact of blades and boxes in a frame, (B, 2 blades, K boxes).

    Attributes:
        apart: distance of the surfaces, m.
        speed: speed of the blade across its axis, m/s.
        angle: angle between the blade's motion and the demanded direction, degrees; 0 if any
            direction counts.
        forward: speed along the demanded direction, m/s.
    """

    apart: Tensor
    speed: Tensor
    angle: Tensor
    forward: Tensor

    def cuts(self) -> Tensor:
        """Return True where a blade cuts a box under the true rules."""
        return (self.apart <= 0.0) & (self.speed >= MIN_CUT_MPS)

    def chance(self, soft: Relaxation) -> Tensor:
        """Return the relaxed probability that each blade cuts each box."""
        touch = torch.sigmoid((CONTACT_MARGIN_M - self.apart) / soft.contact_m - 1.0)
        speed = (self.speed - MIN_CUT_MPS - _SPEED_MARGIN_MPS) / soft.speed_mps
        return touch * torch.sigmoid(speed)

    def worth(self, soft: Relaxation) -> Tensor:
        """Return the relaxed points of a cut by the right blade."""
        off = ANGLE_LIMIT_DEG - _ANGLE_MARGIN_DEG - self.angle
        good = torch.sigmoid(off / soft.angle_deg)
        return good * points(self.speed, self.angle) - (1.0 - good) * soft.error


def points(speed: Tensor, angle: Tensor) -> Tensor:
    """Return the points of a correct slice, not rounded."""
    swift = ((speed - MIN_CUT_MPS) / (FULL_CUT_MPS - MIN_CUT_MPS)).clamp(0.0, 1.0)
    straight = (1.0 - angle / ANGLE_LIMIT_DEG).clamp(min=0.0)
    return BASE_POINTS + SPEED_POINTS * swift + ANGLE_POINTS * straight


def turns(cut: Tensor) -> Tensor:
    """(B, K, 2) cosine and sine of how boxes are turned, by their demanded directions."""
    free = cut.abs().sum(-1, keepdim=True) == 0.0
    return torch.where(free, torch.tensor([1.0, 0.0]), cut)


def aside(blades: Blades, across: Tensor, cut: Tensor, half: Tensor) -> Tensor:
    """Return (B, 2, K) distances of blades from the boxes' places in the cut plane, m; 0 inside."""
    plane = torch.full_like(across[..., :1], CUT_PLANE_M)
    middles = torch.cat([across, plane], -1)[:, :, None]
    now = Blades(blades.root[:, :, None], blades.axis[:, :, None])
    apart, _ = distances(now, middles, turns(cut), half)
    return apart[..., 0].clamp(min=0.0)


def off_stroke(blades: Blades, across: Tensor, cut: Tensor, until_s: Tensor) -> Tensor:
    """Return (B, 2) the distance of each blade from a stroke through its next box, m.

    The stroke passes the box's middle in the cut plane when the box is there, at constant speed
    from its start; if any direction counts, the goal is the middle itself.

    Args:
        blades: (B, 2, 3).
        across: (B, 2, 2) x and y of the next box of each hand.
        cut: (B, 2, 2) demanded directions.
        until_s: (B, 2) times until they arrive.
    """
    drawn = (_STROKE_MPS * until_s).clamp(-_DRAWN_M, _DRAWN_M)
    plane = torch.full_like(across[..., :1], CUT_PLANE_M)
    goal = torch.cat([across - drawn[..., None] * cut, plane], -1)
    from_root = goal - blades.root
    along = (from_root * blades.axis).sum(-1, keepdim=True).clamp(0.0, BLADE_M)
    return (from_root - along * blades.axis).square().sum(-1).add(1e-6).sqrt()


def first_or_closest(apart: Tensor) -> Tensor:
    """(..., 1) the first moment of contact, or where there is none the closest."""
    moments = apart.shape[-1]
    order = torch.arange(moments, 0, -1)
    touches = (apart <= 0.0) * order
    first, closest = touches.argmax(-1, keepdim=True), apart.argmin(-1, keepdim=True)
    return torch.where(touches.amax(-1, keepdim=True) > 0, first, closest)


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
        """Numbers of events since :meth:`clear_counts`, in the order of :data:`EVENTS`."""
        self._origin = torch.zeros(n, 3)
        self._tip_velocity = torch.zeros(n, 2, 3)
        self._before: Blades | None = None
        """The blades at the last frame."""
        boxes, mines, walls = levels.box_time, levels.mine_time, levels.wall_start
        self._box_left = torch.ones(n, boxes.shape[1])
        self._mine_left = torch.ones(n, mines.shape[1])
        self._wall_left = torch.ones(n, walls.shape[1])
        """Probability that each object is still present, with soft contacts."""
        self.names = _names()

    # --- rounds ------------------------------------------------------------------------------

    def calibrate(self, place: Tensor, fields: Tensor) -> None:
        root, axis = (_of(fields, names).reshape(-1, 2, 3) for names in (_ROOT, _AXIS))
        self.sabers.calibrate(place, root, axis)

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        """Start rounds at a random time of a random level."""
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
        self.lane.begin(ids)

    def cut(self) -> None:
        before = self._before
        if before is not None:
            self._before = Blades(before.root.detach(), before.axis.detach())
        self._tip_velocity = self._tip_velocity.detach()
        for name in ("_box_left", "_mine_left", "_wall_left"):
            setattr(self, name, getattr(self, name).detach())

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """Return infinite distances, because rounds may begin anywhere."""
        count = len(place)
        return torch.full((count,), torch.inf), torch.zeros(count, dtype=torch.long)

    def condition_of(self, fields: Tensor) -> Tensor:
        """Return condition 0 for all user steps, because conditions are equivalent here."""
        return torch.zeros(len(fields), dtype=torch.long)

    def clear_counts(self) -> None:
        self.counts.zero_()
        self.events.zero_()

    def adapt(self) -> None:
        """Do nothing: levels determine the objects."""

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
        """Restore a state of :meth:`state_dict`."""
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
        """Advance by one user step; blades move on straight lines between the ends of steps."""
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
    """Return (B, K F) privileged observations of boxes or mines; 0 if there is none."""
    parts = [torch.ones_like(coming.until_s)[..., None], coming.until_s[..., None], middle]
    if cut is not None:
        parts.append(cut)
    return (torch.cat(parts, -1) * coming.there[..., None]).flatten(1)


def _of(fields: Tensor, names: tuple[str, ...]) -> Tensor:
    first = FIELDS.index(names[0])
    return fields[:, first : first + len(names)]


def _names() -> tuple[str, ...]:
    """Return the names of the values of :meth:`ImaginedBeats.observe`, as in the true game."""
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
