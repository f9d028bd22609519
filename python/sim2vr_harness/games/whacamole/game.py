"""The resident: what the fast recipe asks of Whac-A-Mole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.imagined import ImaginedCondition
from sim2vr_harness.games.whacamole.rules import (
    BAN_S,
    BOX_M,
    CELL_M,
    CELLS,
    COLUMNS,
    FADING_FRAMES,
    FRAME_S,
    GROWING_FRAMES,
    HAMMER_HALF_M,
    LAST_FRAME,
    LIFE_S,
    MARKER_M,
    MOST_TARGETS,
    START_M,
    TARGET_HALF_M,
    VOLUME_BEHIND_M,
    area_of,
)
from sim2vr_harness.games.whacamole.settings import (
    FAILING_CELLS,
    FAILING_VALUE,
    RUN_UP_M,
    SINGLE_TARGETS,
    GameModelSettings,
    Relaxation,
)

_STROKES_S, _STROKE_MPS, _THROUGH_M, _STROKE_OFF_M = (0.6, 1.0), 1.5, 0.03, 0.3
"""Parameters of a stroke through a target's middle: times after its spawn (s), speed, depth behind
the middle (m), and distance from the stroke at which the reward is 0 (m)."""
_CENTRE_M = 0.02
"""Scale of the distance from a target's middle; people's end points have an SD of 1.5 cm per
axis."""
_HARD_MPS = 3.0
"""Speed of the hardest hit; faster hits earn no more."""
_CLEAR_M, _AWAY_M = START_M, 0.5 * CELL_M
"""Distances at which a hammer is clear: in front of the plane, and beside a target."""
_SEEN_FRAMES = 3
"""Age from which a target can have been seen, in frames (0.15 s): people's hands begin to move
towards it after 0.19 s."""


@dataclass(frozen=True)
class Targets:
    """Target areas of B users, and the ages of their targets.

    Attributes:
        age: (B, cells) frames; -1 without a target.
        area: (B, 3) middle of the area, m.
        axes: (B, 3, 3) axes right, up and behind, as rows.
        strike: (B, 3) direction whose speed hits are judged by.
        cells: (B, cells, 3) middles of the targets' volumes, m.
    """

    age: Tensor
    area: Tensor
    axes: Tensor
    strike: Tensor
    cells: Tensor

    def aside(self, point: Tensor) -> Tensor:
        """(B, cells) distance of points (B, 3) from the cells' middles, in their plane, m."""
        gap = self.cells - point[:, None]
        aside: Tensor = (gap @ self.axes[:, :2].transpose(1, 2)).square().sum(2).add(1e-8).sqrt()
        return aside

    def depth(self, marker: Tensor) -> Tensor:
        """(B,) m behind the targets' plane; negative before it."""
        return ((marker - self.area) * self.axes[:, 2]).sum(1)

    def strike_mps(self, velocity: Tensor) -> Tensor:
        """(B,) speed of velocities (B, 3) towards the targets; hits are judged by the root's."""
        return (velocity * self.strike).sum(1)


def central(targets: Targets, box: Tensor, share: float) -> Tensor:
    """(B, cells) the worth of a hit by where in the target it is, 1 in its middle.

    Args:
        targets: of the users.
        box: (B, 3) the middle of what hits.
        share: of the worth, that is for the middle.
    """
    if share == 0.0:
        return torch.ones(len(box), CELLS)
    off = targets.aside(box) / _CENTRE_M
    return 1.0 - share * (1.0 - torch.exp(-0.5 * off.square()))


def hardness(targets: Targets, velocity: Tensor, share: float) -> Tensor:
    """(B,) the worth of a hit by the velocity of what hits (B, 3), m/s."""
    if share == 0.0:
        return torch.ones(len(velocity))
    hard = (targets.strike_mps(velocity) / _HARD_MPS).clamp(0.0, 1.0)
    return 1.0 - share * (1.0 - hard)


def facing(targets: Targets, axes: Tensor, share: float) -> Tensor:
    """(B,) the worth of a hit by the hammer's axes (B, 3, 3); its face looks against its x."""
    if share == 0.0:
        return torch.ones(len(axes))
    faces = -(axes[:, 0] * targets.axes[:, 2]).sum(1)
    return 1.0 - 0.5 * share * (1.0 - faces)


def in_plane(targets: Targets, marker: Tensor) -> Tensor:
    """(B,) 1 in the plane, 2 well behind it, 0 well before it or at a target."""
    near = (1.0 + targets.depth(marker) / _CLEAR_M).clamp(0.0, 2.0)
    aside = torch.where(targets.age >= 0, targets.aside(marker), _AWAY_M)
    return near * (aside.amin(1) / _AWAY_M).clamp(max=1.0)


def going_blind(targets: Targets, marker: Tensor, velocity: Tensor) -> Tensor:
    """(B,) m/s towards the targets where there is none that can have been seen."""
    off = torch.where(targets.age >= _SEEN_FRAMES, targets.aside(marker) / _AWAY_M, 10.0)
    before_one = torch.exp(-0.5 * off.amin(1).square())
    return targets.strike_mps(velocity).clamp(min=0.0) * (1.0 - before_one)


def on_stroke(targets: Targets, marker: Tensor) -> Tensor:
    """(B,) 1 on the stroke that would hit the oldest target, less beside it, 0 without one.

    Strokes begin at rest in front of the cell, speed up evenly, and go through it; the second
    one is for users that have missed.
    """
    age, cell = targets.age.max(1)
    rows = torch.arange(len(age))
    first_s, second_s = (at_s - FRAME_S * age for at_s in _STROKES_S)
    until_s = torch.where(first_s > -1.5 * FRAME_S, first_s, second_s)[:, None]
    takes_s = 2.0 * RUN_UP_M / _STROKE_MPS
    before_m = RUN_UP_M * (1.0 - (1.0 - until_s.clamp(max=takes_s) / takes_s).square())
    before_m = before_m.clamp(min=-_THROUGH_M)
    goal = targets.cells[rows, cell] - before_m * targets.axes[:, 2]
    off = (marker - goal).square().sum(1).add(1e-8).sqrt()
    return (age >= 0) * (1.0 - off / _STROKE_OFF_M)


POSE_FIELDS = (
    *(f"hammer.{axis}_m" for axis in "xyz"),
    *(f"hammer.{part}_{axis}" for part in ("face", "handle") for axis in "xyz"),
)
"""The privileged numbers that :meth:`Hammer.calibrate` goes by."""


class Hammer:
    """The hammer's pose by the places of controller and headset: it is fixed to the controller."""

    def __init__(self) -> None:
        self.fixed = torch.zeros(13, 9)
        """Marker, face and handle, linear in the place's position, rotation and 1."""

    def calibrate(self, place: Tensor, pose: Tensor) -> None:
        """Find how the hammer is fixed, from (K, 2, 4, 4) places and (K, 9) poses that belong."""
        known = self._known(place)
        least = known.double().cpu(), pose.double().cpu()  # GPUs do not have this driver
        self.fixed.copy_(torch.linalg.lstsq(*least, driver="gelsd").solution)

    @staticmethod
    def _known(place: Tensor) -> Tensor:
        hand, head, ones = place[:, 0], place[:, 1], torch.ones(len(place), 1)
        # From the head, since that is where the target area is placed, and people differ in height.
        return torch.cat([hand[:, :3, 3] - head[:, :3, 3], hand[:, :3, :3].flatten(1), ones], 1)

    def __call__(self, place: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 3) marker from the head, m, and (B, 3, 3) axes x, y, z as rows, the app's axes."""
        pose = self._known(place) @ self.fixed
        x, y = -pose[:, 3:6], pose[:, 6:]
        return pose[:, :3], torch.stack([x, y, torch.cross(x, y, dim=1)], 1)


@cache
def _sizes(device: torch.device) -> tuple[Tensor, ...]:
    """(3,) from root to marker and to the collider, and the half extents of hammer and target."""
    sizes = MARKER_M, BOX_M, HAMMER_HALF_M, TARGET_HALF_M
    return tuple(torch.tensor(size, device=device) for size in sizes)


def points(marker: Tensor, axes: Tensor) -> tuple[Tensor, Tensor]:
    """Root of the hammer and middle of its collider, (B, 3) m each."""
    to_marker, to_box, _, _ = _sizes(axes.device)
    root = marker - torch.einsum("k,bkx->bx", to_marker, axes)
    box = root + torch.einsum("k,bkx->bx", to_box, axes)
    return root, box


def depths(frame: Tensor, cells: Tensor, axes: Tensor, box: Tensor) -> Tensor:
    """Return penetration depths of the hammer's box in the targets' (separating axes), m.

    The boxes overlap if all depths are above 0.

    Args:
        frame: (B, 3, 3) axes of the targets, as rows.
        cells: (B, C, 3) middles of their boxes.
        axes: (B, 3, 3) axes of the hammer.
        box: (B, 3) middle of its box.

    Returns:
        (B, C, 7): depths along the axes of the target and of the hammer, and the least along the
        nine cross products of their edges. Without the last, 8 % more boxes seem to overlap, and
        without the hammer's axes 60 %.
    """
    _, _, hammer, target = _sizes(axes.device)
    edges = torch.cross(frame[:, :, None], axes[:, None], dim=3).flatten(1, 2)  # (B, 9, 3)
    length = edges.norm(dim=2, keepdim=True)
    edges = edges / length.clamp(min=1e-3)
    directions = torch.cat([frame, axes, edges], 1)
    reach = ((directions @ frame.transpose(1, 2)).abs() * target).sum(2)
    reach = reach + ((directions @ axes.transpose(1, 2)).abs() * hammer).sum(2)
    apart = ((cells - box[:, None]) @ directions.transpose(1, 2)).abs()
    deep = reach[:, None] - apart  # (B, C, 15)
    parallel = (length[..., 0] < 1e-2)[:, None]  # no direction of its own
    across = torch.where(parallel, 1.0, deep[..., 6:]).amin(2, keepdim=True)
    return torch.cat([deep[..., :6], across], 2)


def areas_of(
    conditions: Sequence[Mapping[str, float]], options: Sequence[Mapping[str, OptionValue]]
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the target areas of C conditions, from the head, in the app's axes, m.

    Args:
        conditions: the privileged numbers named ``round.*``.
        options: those that are set: they move the area.

    Returns:
        (C, 3) middles; (C, 3, 3) axes right, up and behind, as rows; (C, 3) directions whose speed
        hits are judged by; (C, cells, 3) middles of the targets' volumes.
    """
    placements = ("round.low", "round.mid", "round.high")
    place = torch.tensor([[c[name] for name in placements] for c in conditions]).argmax(1)
    where = [area_of(int(row), changes) for row, changes in zip(place, options, strict=True)]
    area, ups, behind, strike = (
        torch.tensor([getattr(one, name) for one in where])
        for name in ("middle_m", "up", "behind", "strike")
    )
    right = torch.tensor([1.0, 0.0, 0.0]).expand_as(ups)
    cell = torch.arange(CELLS)
    across, up = cell % COLUMNS - 1.0, 1.0 - cell // COLUMNS
    cell_m = torch.tensor([one.cell_m for one in where])[:, None, None]
    cells = (
        area[:, None]
        + (across[None, :, None] * cell_m) * right[:, None]
        + (up[None, :, None] * cell_m) * ups[:, None]
        + VOLUME_BEHIND_M * behind[:, None]
    )
    return area, torch.stack([right, ups, behind], 1), strike, cells


_ROUND = (
    *("round.low", "round.mid", "round.high"),
    *("round.constrained", "round.max_targets", "round.strike_threshold_mps"),
)
_ROOT_VELOCITY = tuple(f"hammer.root_v{axis}_mps" for axis in "xyz")
FIELDS = (*_ROUND, *POSE_FIELDS, *_ROOT_VELOCITY)
"""The privileged numbers that go with a user step, in this order."""

_SPEED_MARGIN_MPS, _OVERLAP_MARGIN_M, _NEAR_M = 0.05, 0.002, 0.04


class ImaginedWhacAMole(State):
    """B rounds without an end; see :class:`~sim2vr_harness.games.imagined.ImaginedRounds`.

    Args:
        n: number of users B.
        conditions: of each condition, the privileged numbers named ``round.*``.
        settings: softness of hits and additional rewards.
        step_s: duration of a user step.
        frames: F, app frames of a step, in each of which the hammer may hit.
        seed: seed of spawns.
        gamma: discount factor per user step.
        options: options that are set in each condition, which determine the target area.

    Raises:
        ValueError: another duration than one frame.
    """

    names: tuple[str, ...]

    def __init__(
        self,
        n: int,
        conditions: Sequence[Mapping[str, float]],
        settings: GameModelSettings,
        *,
        step_s: float,
        seed: int,
        gamma: float,
        frames: int = 1,
        options: Sequence[Mapping[str, OptionValue]] | None = None,
    ) -> None:
        if abs(step_s - FRAME_S) > 1e-6:
            expected = "20, the frames that the imagined game is made of"
            raise ValueError(f"action_frequency_hz: got {1.0 / step_s:g}, expected {expected}")
        self.n, self.settings, self.hammer = n, settings, Hammer()
        self._gamma = gamma
        self.frames = 1 if settings.whole_steps else frames
        self._frame_s = FRAME_S / self.frames
        self._follows = 1.0 - 0.5 ** (frames / self.frames)
        """Share of a frame's speed in the velocity that is judged: a half in each of the app's."""
        on_cpu = torch.get_default_device().type == "cpu"
        self.generator = torch.Generator().manual_seed(seed) if on_cpu else None
        """Generator of spawns; on a GPU it is torch's own, which captured graphs need."""
        self._threshold = torch.tensor([c["round.strike_threshold_mps"] for c in conditions])
        self._constrained = torch.tensor([c["round.constrained"] for c in conditions])
        self._most = torch.tensor([int(c["round.max_targets"]) for c in conditions])
        self._single = torch.arange(n) < round(SINGLE_TARGETS * n)
        self._rules = torch.tensor([[c[name] for name in _ROUND] for c in conditions])
        self._area, self._axes, self._strike, self._cells = areas_of(
            conditions, [{} for _ in conditions] if options is None else options
        )
        self.spawn_weights = torch.full((len(conditions), CELLS), 1.0 / CELLS)
        """By condition and cell."""
        self.hit_values = torch.ones(len(conditions), CELLS)
        """(C, cells) value of a hit relative to an ordinary one, by condition and cell."""
        self.counts = torch.zeros(2, len(conditions), CELLS)
        """Hits and misses since :meth:`clear_counts`, by condition and cell."""
        self._earned = torch.zeros(len(conditions))
        """(C,) summed value of hits, by place and speed, since :meth:`clear_counts`."""
        self._foregone = torch.zeros(len(conditions), LAST_FRAME + 1)
        """Opportunity cost of hitting a target, in hits at that age, by condition and age."""
        self.names = _names()
        # Make the state of rounds in which nothing has happened.
        self.condition = torch.zeros(n, dtype=torch.long)
        self._velocity, self._root, self._face = (torch.zeros(n, 3) for _ in range(3))
        self._age = torch.full((n, CELLS), -1)
        self._fading = torch.zeros(n, CELLS, dtype=torch.long)
        self._ban_s = torch.zeros(n)
        self._inside = torch.zeros(n, CELLS, dtype=torch.bool)
        self._hit = torch.zeros(n, CELLS, dtype=torch.bool)
        self._left = torch.ones(n, CELLS)

    # --- rounds ------------------------------------------------------------------------------

    def calibrate(self, place: Tensor, fields: Tensor) -> None:
        first = FIELDS.index(POSE_FIELDS[0])
        self.hammer.calibrate(place, fields[:, first : first + len(POSE_FIELDS)])

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        condition = self.condition_of(fields)
        with torch.no_grad():
            self._velocity[ids] = self.velocity_of(fields)
            self.condition[ids] = condition
            self._root[ids], self._face[ids] = points(*self.hammer(place))
            # (K, cells) ages of the targets that some users begin with, in frames.
            count, generator = len(ids), self.generator
            rows, ages = torch.arange(count), torch.full((count, CELLS), -1)
            weights = self.spawn_weights[condition]
            first = torch.multinomial(weights, 1, generator=generator)[:, 0]
            first = torch.where(cell >= 0, cell, first)
            ages[rows, first] = torch.randint(0, LAST_FRAME // 2, (count,), generator=generator)
            more = torch.randint(-LAST_FRAME, LAST_FRAME, (count, CELLS), generator=generator)
            more = more.clamp(min=-1)
            allowed = (torch.where(self._single, 1, self._most[self.condition]) - 1)[ids]
            order = torch.rand(count, CELLS, generator=generator).argsort(1).argsort(1)
            others = (order < allowed[:, None]) & (torch.arange(CELLS) != first[:, None])
            self._age[ids] = torch.where(others, more, ages)
            count = len(ids)
            self._fading[ids] = 0
            self._ban_s[ids] = BAN_S * torch.rand(count, generator=self.generator)
            self._inside[ids], self._hit[ids], self._left[ids] = False, False, 1.0

    def begin(self, ids: Tensor) -> None:
        """Set rounds to their start: the first target appears at once."""
        self._age[ids], self._ban_s[ids] = -1, -FRAME_S

    def cut(self) -> None:
        self._velocity, self._root = self._velocity.detach(), self._root.detach()
        self._left, self._face = self._left.detach(), self._face.detach()

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """Return (K,) distances from the nearest point 10 cm before a cell, m, and (K,) cells."""
        with torch.no_grad():
            marker, _ = self.hammer(place)
            front = self._cells[condition] - START_M * self._axes[condition, 2][:, None]
            distance, cell = (front - marker[:, None]).norm(dim=2).min(1)
        return distance, cell

    def condition_of(self, fields: Tensor) -> Tensor:
        """Return (K,) the conditions of user steps."""
        return torch.cdist(fields[:, : len(_ROUND)], self._rules).argmin(1)

    @staticmethod
    def velocity_of(fields: Tensor) -> Tensor:
        """Return (K, 3) filtered velocities of the hammer's root after user steps, m/s."""
        first = FIELDS.index(_ROOT_VELOCITY[0])
        return fields[:, first : first + 3]

    def clear_counts(self) -> None:
        self.counts.zero_()
        self._earned.zero_()

    def adapt(self) -> None:
        """Increase the spawn weights and values of cells with many misses."""
        counts, share = self.counts, FAILING_CELLS
        total = counts.sum(0)
        fails = torch.where(total > 0, counts[1] / total.clamp(min=1.0), 1.0) + 0.02
        uniform = 1.0 / fails.shape[1]
        weights = (1.0 - share) * uniform + share * fails / fails.sum(1, keepdim=True)
        self.spawn_weights.lerp_(weights, 0.5)
        often = fails / fails.mean(1, keepdim=True)
        values = 1.0 + FAILING_VALUE * (often.clamp(1.0, 3.0) - 1.0)
        self.hit_values.lerp_(values, 0.5)
        self._foregone.lerp_(self._later(), 0.5)

    def _later(self) -> Tensor:
        """Return (C, ages) the expected value of not hitting a target, in hits at that age.

        It assumes that the target is hit later, with the observed success rate and quality, at the
        most valuable age for which the policy waits; it is 0 if a hit at once is worth more. (The
        success rate of targets that were not hit by some age would be a poor estimate: most of them
        are hard to hit, so a policy that strikes early would never learn to wait.)
        """
        ages = torch.arange(LAST_FRAME + 1)
        now = self._worth_at(ages) * self._gamma**ages
        waited_for = now * (FRAME_S * ages <= self.settings.values.delay_until_s + 1e-6)
        best = waited_for[1:].flip(0).cummax(0).values.flip(0) / now[:-1]
        best = torch.where(best > 1.0, best, 0.0)
        sure = self._earned / self.counts.sum((0, 2)).clamp(min=1.0)
        return sure[:, None] * torch.cat([best, torch.zeros(1)])

    _state = (
        *("_velocity", "_root", "_face", "_age", "_fading", "_ban_s", "_inside", "_hit", "_left"),
        *("condition", "spawn_weights", "hit_values", "_foregone"),
        *("hammer.fixed", "generator"),
    )

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`, also on a device of the other kind."""
        super().load_state_dict(state if self.generator else {**state, "generator": None})

    # --- what is observed --------------------------------------------------------------------

    def observe(self, place: Tensor) -> Tensor:
        """(B, F) in the order of :attr:`names`, differentiable by the places."""
        targets = self._targets()
        marker, axes = self.hammer(place)
        strike = targets.strike_mps(self._velocity)[:, None]
        depth = targets.depth(marker)[:, None]
        present = (self._age >= 0).float()
        alive = (self._age >= GROWING_FRAMES).float()
        life = present * (LIFE_S - FRAME_S * self._age)
        oldest = torch.where(
            self._age >= 0, self._age + 1e-3 * torch.arange(CELLS).flip(0), -1.0
        ).topk(MOST_TARGETS, 1)
        there, which = (oldest.values >= 0).float(), oldest.indices
        rows = torch.arange(self.n)[:, None]
        places = targets.cells[rows, which] - marker[:, None]
        following = [there, alive.gather(1, which) * there, life.gather(1, which) * there]
        parts = [
            self._rules[self.condition],
            marker,
            self._velocity,
            -axes[:, 0],
            axes[:, 1],
            strike,
            depth,
            torch.stack([present, alive, life], 2).flatten(1),
            torch.cat([torch.stack(following, 2), places * there[..., None]], 2).flatten(1),
        ]
        return torch.cat(parts, 1)

    # --- a user step -------------------------------------------------------------------------

    def step(self, places: Tensor, done: float) -> Tensor:
        return self.play(places, self.settings.relaxation(done))

    def play(self, places: Tensor, soft: Relaxation) -> Tensor:
        """Advance by one user step; see :meth:`step`."""
        # Targets of the next frame, after hits at the poses of this one.
        old = (self._age >= LAST_FRAME) & ~self._hit
        for number, ended in enumerate((self._hit, old)):
            self.counts[number].index_add_(0, self.condition, ended.float())
        gone = self._hit | old
        self._age = torch.where(gone, -1, torch.where(self._age >= 0, self._age + 1, self._age))
        self._fading = torch.where(gone, FADING_FRAMES, (self._fading - 1).clamp(min=0))
        self._ban_s = self._ban_s - FRAME_S
        free = (self._age < 0) & (self._fading == 0)
        most = torch.where(self._single, 1, self._most[self.condition])
        wanted = ((~free).sum(1) < most) & (self._ban_s < 0.0)
        # The largest of the logarithms plus Gumbel noise: a draw by the weights.
        noise = torch.rand(self.n, CELLS, generator=self.generator).clamp(1e-9, 1.0 - 1e-7)
        scores = self.spawn_weights[self.condition].log() - (-noise.log()).log()
        cell = torch.where(free, scores, -1e9).argmax(1)
        new = wanted[:, None] & (torch.arange(CELLS) == cell[:, None])
        self._age = torch.where(new, 0, self._age)
        ban = BAN_S * torch.rand(self.n, generator=self.generator)
        self._ban_s = torch.where(wanted, ban, self._ban_s)
        self._left = torch.where(gone | new, 1.0, self._left)
        targets = self._targets()
        b, frames = places.shape[:2]
        marker, axes = self.hammer(places.flatten(0, 1))
        root, box = points(marker, axes)
        frame, cells = _each(targets.axes, frames), _each(targets.cells, frames)
        depth = depths(frame, cells, axes, box)
        root, depth = root.reshape(b, frames, 3), depth.reshape(b, frames, CELLS, -1)
        self._hit = torch.zeros_like(self._inside)
        # The likeliest frame of a step counts. Chances of all frames would add up for a hammer that
        # only hovers at a target, the more of them the higher the frame rate.
        chance = torch.zeros(b, CELLS)
        for k in range(frames):
            raw = (root[:, k] - self._root) / self._frame_s
            self._velocity = self._velocity + self._follows * (raw - self._velocity)
            self._root = root[:, k]
            touch = self._judge(depth[:, k], targets.strike_mps(self._velocity), soft)
            chance = torch.maximum(chance, touch.chance)
        # A true hit has its whole worth, and the gradient of its chance. Where frames are short it
        # is seen at the target's rim, as likely as not: who trembles there would earn more.
        chance = chance + self._hit * (1.0 - chance).detach()
        last = marker.reshape(b, frames, 3)[:, -1]
        middle = box.reshape(b, frames, 3)[:, -1]
        worths = self._worths(targets, middle, axes.reshape(b, frames, 3, 3)[:, -1], soft)
        values = self.hit_values[self.condition] * self._worth_at(self._age)
        self._face = middle
        self._earned.index_add_(0, self.condition, (worths.detach() * self._hit).sum(1))
        gained = worths * chance
        if soft.foregone > 0.0:
            later = self._foregone[self.condition].gather(1, self._age.clamp(min=0))
            given_up = later * self._hit * (chance - chance.detach())
            gained = gained - soft.foregone * given_up
        hits = self.settings.values.hit_reward * (values * gained * self._left).sum(1)
        worth = hits + self._shaped(targets, last, depth[:, -1], touch, soft)
        self._left = self._left * (1.0 - chance)
        return worth

    def _targets(self) -> Targets:
        """Return the users' target areas, with the ages of their targets."""
        c = self.condition
        return Targets(self._age, self._area[c], self._axes[c], self._strike[c], self._cells[c])

    def _worths(self, targets: Targets, middle: Tensor, axes: Tensor, soft: Relaxation) -> Tensor:
        """(B, cells) the worth of a hit by its place, its velocity and the hammer's direction."""
        velocity = (middle - self._face) / FRAME_S
        hard = hardness(targets, velocity, self.settings.impact_speed_weight)[:, None]
        return (
            central(targets, middle, soft.centre) * hard * facing(targets, axes, soft.face)[:, None]
        )

    def _judge(self, depth: Tensor, strike: Tensor, soft: Relaxation) -> _Touch:
        """Return the hits of a frame under the true rules, and their relaxed value."""
        condition = self.condition
        inside = (depth > 0.0).all(2) & (self._age >= 0)
        counts = (self._age >= GROWING_FRAMES) & ~self._inside & ~self._hit
        threshold = self._threshold[condition]
        constrained = self._constrained[condition] > 0.0
        fast = (strike > threshold) | ~constrained
        self._hit = self._hit | (inside & counts & fast[:, None])  # only coming in is a hit
        within = inside & self._inside
        speed = torch.sigmoid((strike - threshold - _SPEED_MARGIN_MPS) / soft.speed_mps)
        speed = torch.where(constrained, speed, 1.0)[:, None]
        overlap = _product(torch.sigmoid((depth - _OVERLAP_MARGIN_M) / soft.overlap_m))
        self._inside = inside
        return _Touch(counts * overlap * speed, counts, within)

    def _shaped(
        self, targets: Targets, marker: Tensor, depth: Tensor, touch: _Touch, soft: Relaxation
    ) -> Tensor:
        """Return (B,) the shaping rewards of a user step, from its last frame."""
        condition = self.condition
        alive = self._age >= GROWING_FRAMES
        towards = targets.strike_mps(self._velocity) - self._threshold[condition]
        towards = torch.sigmoid(towards / 0.5)
        towards = torch.where(self._constrained[condition] > 0.0, towards, 1.0)
        around = _product(torch.sigmoid(depth / _NEAR_M))
        near = (touch.counts * self._left.detach() * around * towards[:, None]).sum(1)
        distance = (targets.cells - marker[:, None]).norm(dim=2)
        far = (alive * (torch.exp(-10.0 * distance) - 1.0) / 10.0).sum(1)
        worth = soft.near * near + soft.distance * far
        if soft.stroke > 0.0:
            worth = worth + soft.stroke * on_stroke(targets, marker)
        if soft.dwell > 0.0:  # few trainings pay for it
            worth = worth - soft.dwell * (touch.within * (1.0 + depth.amin(2) / _NEAR_M)).sum(1)
        if soft.plane > 0.0:
            worth = worth - soft.plane * in_plane(targets, marker)
        if soft.blind > 0.0:
            worth = worth - soft.blind * going_blind(targets, marker, self._velocity)
        return worth

    def _worth_at(self, age: Tensor) -> Tensor:
        """The worth of a hit by how old its target is, frames; 1 after a third of its life."""
        return torch.exp(self.settings.values.delay_gain_per_s * (FRAME_S * age - LIFE_S / 3.0))


@dataclass(frozen=True)
class _Touch:
    """A frame of the hammer.

    Attributes:
        chance: (B, cells) of a hit, relaxed.
        counts: (B, cells) which cells a coming hammer would hit.
        within: (B, cells) in which targets the hammer stays.
    """

    chance: Tensor
    counts: Tensor
    within: Tensor


def _each(values: Tensor, frames: int) -> Tensor:
    """(B, ...) -> (B F, ...), the same in every frame of a user's step."""
    return values if frames == 1 else values.repeat_interleave(frames, 0)


def _product(values: Tensor) -> Tensor:
    """The product over the last dimension; on a GPU without the gradient's count of zeros."""
    if values.device.type == "cpu":
        return values.prod(-1)
    return reduce(torch.mul, values.unbind(-1))


def _names() -> tuple[str, ...]:
    """Return the names of the values of :meth:`ImaginedWhacAMole.observe`, as in the true game."""
    pose = (*POSE_FIELDS[:3], *_ROOT_VELOCITY, *POSE_FIELDS[3:])
    state = ("present", "alive", "life_s")
    cells = [f"cell{cell}.{name}" for cell in range(CELLS) for name in state]
    order = (*state, "x_m", "y_m", "z_m")
    following = [f"next{i}.{name}" for i in range(MOST_TARGETS) for name in order]
    return (*_ROUND, *pose, "hammer.strike_mps", "hammer.depth_m", *cells, *following)


class WhacAMole:
    """Facts of Whac-A-Mole for imagined rollouts: fields, devices, conditions and outcomes."""

    name = "whacamole"
    settings = GameModelSettings
    devices = ("controller_right", "headset")
    fields = FIELDS
    cells = CELLS
    conditions = ("low-medium", "medium", "high-medium")
    hidden_fields = (
        *("aid.*", "round.elapsed_s", "cell*.?_m", "*.overlap", "nearest.*", "hammer.v?_mps"),
        *("* qacc", "fingertip *"),
    )
    felt_fields = ("hammer.*",)
    facts = "cell*.present"
    on_gpu = True
    attention_targets: tuple[str, ...] = ()
    start_fields: tuple[str, str] | None = ("aid.start_distance_m", "aid.start_cell")
    start_limits: Mapping[str, tuple[float, float]] = {"elbow_flexion": (0.5, 1.9)}

    def options(
        self, condition: str, weights: Sequence[float] | None = None
    ) -> dict[str, OptionValue]:
        options: dict[str, OptionValue] = {"condition": condition}
        return options if weights is None else options | {"spawn_weights": list(weights)}

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        return np.array(
            [
                [log.get(f"{kind}Target{cell}", 0.0) for cell in range(CELLS)]
                for kind in ("hits", "misses")
            ]
        )

    def rounds(
        self,
        n: int,
        conditions: Sequence[ImaginedCondition],
        settings: GameModelSettings,
        *,
        step_s: float,
        frames: int,
        seed: int,
        gamma: float,
    ) -> ImaginedWhacAMole:
        starts = [condition.start for condition in conditions]
        options = [condition.options for condition in conditions]
        return ImaginedWhacAMole(
            n,
            starts,
            settings,
            step_s=step_s,
            frames=frames,
            seed=seed,
            options=options,
            gamma=gamma,
        )


GAME = WhacAMole()
