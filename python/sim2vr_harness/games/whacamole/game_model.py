"""Whac-A-Mole as a differentiable game.

Targets come and go by the game's own rules: where they are, how long they live, how many at once,
when the next one comes. What is hit is decided by the rules too, but the reward is relaxed, so that
it has a gradient: a hit counts with the probability that it would happen if hammer and target met a
little elsewhere and at a little other speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.whacamole.areas import areas_of
from sim2vr_harness.games.whacamole.hammer import POSE_FIELDS, Hammer, depths, points
from sim2vr_harness.games.whacamole.rules import (
    BAN_S,
    CELLS,
    FADING_FRAMES,
    FRAME_S,
    GROWING_FRAMES,
    LAST_FRAME,
    LIFE_S,
    MOST_TARGETS,
    START_M,
)
from sim2vr_harness.games.whacamole.settings import (
    FAILING_CELLS,
    FAILING_VALUE,
    SINGLE_TARGETS,
    GameModelSettings,
    Relaxation,
)
from sim2vr_harness.games.whacamole.shaping import (
    Targets,
    central,
    facing,
    going_blind,
    hardness,
    in_plane,
    on_stroke,
)

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
        settings: what is relaxed, and which cells come up.
        step_s: duration of a user step.
        frames: F, app frames of a step, in each of which the hammer may hit.
        seed: of spawns.
        gamma: how much of a reward is left to who learns a user step later.
        options: of each condition, those that are set: where the area is.

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
        """Of spawns; on a GPU they come from torch's own, which a captured graph draws from."""
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
        """How many ordinary hits a hit is worth, by condition and cell."""
        self.counts = torch.zeros(2, len(conditions), CELLS)
        """Hits and misses since :meth:`clear_counts`, by condition and cell."""
        self._earned = torch.zeros(len(conditions))
        """What hits were worth for where and how hard they were since :meth:`clear_counts`."""
        self._foregone = torch.zeros(len(conditions), LAST_FRAME + 1)
        """What hitting a target takes away, in hits at that age; by condition and age."""
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
        """See the protocol."""
        first = FIELDS.index(POSE_FIELDS[0])
        self.hammer.calibrate(place, fields[:, first : first + len(POSE_FIELDS)])

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        """See the protocol."""
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
        """See the protocol: the first target comes at once."""
        self._age[ids], self._ban_s[ids] = -1, -FRAME_S

    def cut(self) -> None:
        """See the protocol."""
        self._velocity, self._root = self._velocity.detach(), self._root.detach()
        self._left, self._face = self._left.detach(), self._face.detach()

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """(K,) distance from the nearest point 10 cm in front of a cell, m, and (K,) that cell."""
        with torch.no_grad():
            marker, _ = self.hammer(place)
            front = self._cells[condition] - START_M * self._axes[condition, 2][:, None]
            distance, cell = (front - marker[:, None]).norm(dim=2).min(1)
        return distance, cell

    def condition_of(self, fields: Tensor) -> Tensor:
        """(K,) which condition user steps were taken in."""
        return torch.cdist(fields[:, : len(_ROUND)], self._rules).argmin(1)

    @staticmethod
    def velocity_of(fields: Tensor) -> Tensor:
        """(K, 3) the filtered velocity of the hammer's root after user steps, m/s."""
        first = FIELDS.index(_ROOT_VELOCITY[0])
        return fields[:, first : first + 3]

    def clear_counts(self) -> None:
        """See the protocol."""
        self.counts.zero_()
        self._earned.zero_()

    def adapt(self) -> None:
        """Let cells that are missed come up more often, and be worth more."""
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
        """(C, ages) what targets that are spared at an age will bring, in hits at that age.

        They are hit as surely and as well as others were, at the age at which that is worth most,
        of those that are waited for; where it is worth less than a hit at once, there is nothing to
        wait for. (Of those that had not been hit by an age, most are hard to hit: who strikes soon
        would never learn to wait.)
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
        """Go on from :meth:`state_dict`, also on a device of the other kind."""
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
        """See the protocol."""
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
        """What hits in a frame, by the true rules; and what it is worth, relaxed."""
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
        """(B,) what helps to find hits, once a user step: by its last frame."""
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
    """What :meth:`ImaginedWhacAMole.observe` gives, by the true game's names."""
    pose = (*POSE_FIELDS[:3], *_ROOT_VELOCITY, *POSE_FIELDS[3:])
    state = ("present", "alive", "life_s")
    cells = [f"cell{cell}.{name}" for cell in range(CELLS) for name in state]
    order = (*state, "x_m", "y_m", "z_m")
    following = [f"next{i}.{name}" for i in range(MOST_TARGETS) for name in order]
    return (*_ROUND, *pose, "hammer.strike_mps", "hammer.depth_m", *cells, *following)
