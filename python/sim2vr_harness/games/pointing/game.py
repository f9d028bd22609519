"""The resident: what the fast recipe asks of pointing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.client import describe_game
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.app_axes import head_of, to_app
from sim2vr_harness.games.imagined import ImaginedCondition
from sim2vr_harness.games.pointing.settings import FAILING_BLOCKS, GameModelSettings, Relaxation

HIT_REWARD = 10.0
TAP_START_M = 0.05
"""Distance in front of a target at which a tap may begin."""
TIME_TOLERANCE_S = 1e-3
"""A target may go away by so much before its time is over."""


def distance_reward(distance: Tensor) -> Tensor:
    """The game's term of the tip's distance from the target, m, per user step."""
    return 0.1 * (torch.exp(-10.0 * distance) - 1.0)


@dataclass(frozen=True)
class PointingTask:
    """Blocks of a round, as its options define them.

    Attributes:
        targets: number of targets on the circle.
        blocks: (distance, width) of each block, m.
        timeout_s: time after which a target disappears.
        rearm_m: distance by which the tip must come out of the plane between selections.
        error_cost: cost of a selection beside the target.
        distance_weight: weight of :func:`distance_reward`, 0 or 1.
    """

    targets: int = 9
    blocks: tuple[tuple[float, float], ...] = ()
    timeout_s: float = 3.0
    rearm_m: float = 0.0
    error_cost: float = 5.0
    distance_weight: float = 1.0

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> PointingTask:
        """Return the task of a round's options, with the game's defaults for missing ones."""
        distances = options.get("distances_m", (0.10, 0.18, 0.32))
        widths = options.get("widths_m", (0.02, 0.03, 0.045))
        return cls(
            targets=int(options.get("targets", cls.targets)),
            blocks=tuple((float(d), float(w)) for d in distances for w in widths),
            timeout_s=float(options.get("timeout_seconds", cls.timeout_s)),
            rearm_m=float(options.get("rearm_m", cls.rearm_m)),
            error_cost=float(options.get("error_cost", cls.error_cost)),
            distance_weight=0.0 if options.get("sparse", False) else 1.0,
        )

    def center(self, block: int, target: int) -> tuple[float, float, float]:
        """Return a target's position relative to the circle's centre, m, in the app's axes."""
        radius = 0.5 * self.blocks[block][0] / math.cos(math.pi / (2 * self.targets))
        angle = 2.0 * math.pi * target / self.targets
        return radius * math.sin(angle), radius * math.cos(angle), 0.0

    def target_of(self, trial: int) -> int:
        """The number of the target of a trial, 0 to ``targets``: always the one opposite."""
        return trial * ((self.targets + 1) // 2) % self.targets

    def centers(self) -> Tensor:
        """(blocks, trials, 3) of the targets in the order of their trials."""
        return torch.tensor(
            [
                [self.center(block, self.target_of(trial)) for trial in range(self.targets + 1)]
                for block in range(len(self.blocks))
            ]
        )

    def widths(self) -> Tensor:
        """(blocks,) m."""
        return torch.tensor([width for _, width in self.blocks])


class Stylus:
    """The tip by the controller's place: it is fixed to it."""

    def __init__(self) -> None:
        # Along the grip's forward axis, unless the true game says something else.
        self.fixed = torch.tensor([0.10, 0.0, 0.0])
        """(3,) tip in the controller's frame, MuJoCo's axes, m."""

    def calibrate(self, place: Tensor, tip: Tensor) -> None:
        """Find where the tip is, from (K, D, 4, 4) places and (K, 3) tips from the head."""
        world = tip + head_of(place)
        back = torch.stack([world[:, 2], -world[:, 0], world[:, 1]], -1) - place[:, 0, :3, 3]
        self.fixed = torch.einsum("kji,kj->ki", place[:, 0, :3, :3], back).median(0).values

    def __call__(self, place: Tensor) -> Tensor:
        """(B, 3) tip in the world, app's axes, m."""
        return to_app(place[:, 0, :3, :3] @ self.fixed + place[:, 0, :3, 3])


_ROUND = ("round.side_m", "round.height_m", "round.depth_m")
_TIP = tuple(f"tip.{axis}_m" for axis in "xyz")
FIELDS = (*_ROUND, *_TIP, "tip.armed")
"""The privileged numbers that go with a user step, in this order."""

_DEPTH_MARGIN_M, _NEAR_M, _BEHIND_MARGIN_M, _BEHIND_M = 0.002, 0.04, 0.005, 0.02
_OLDEST_START_S = 0.5


class ImaginedPointing(State):
    """B rounds without an end; see :class:`~sim2vr_harness.games.imagined.ImaginedRounds`.

    A block that is over is followed by any other one.

    Args:
        n: number of users B.
        conditions: their options say which blocks there are, their starts where the circle is.
        settings: what is relaxed, and which blocks come up.
        frame_s: from one app frame to the next; a user step is one or more.
        seed: of blocks.
        frames: how many of them a user step is.

    Raises:
        ValueError: conditions with different blocks.
    """

    names: tuple[str, ...]

    def __init__(
        self,
        n: int,
        conditions: Sequence[ImaginedCondition],
        settings: GameModelSettings,
        *,
        frame_s: float,
        seed: int,
        frames: int = 1,
    ) -> None:
        self.n, self.settings, self.stylus, self._frame_s = n, settings, Stylus(), frame_s
        self.frames = frames
        self.generator = torch.Generator().manual_seed(seed)
        tasks = [PointingTask.of(condition.options) for condition in conditions]
        if len(set(tasks)) != 1:
            raise ValueError("conditions: got different blocks, expected the same in all of them")
        self.task = tasks[0]
        self._rules = torch.tensor([[c.start[name] for name in _ROUND] for c in conditions])
        """(C, 3) the circle's centre from the head at the round's start."""
        self._targets, self._widths = self.task.centers(), self.task.widths()
        count = len(conditions)
        self.spawn_weights = torch.ones(count, 1)
        self.block_weights = torch.full((count, len(self._widths)), 1.0 / len(self._widths))
        """(C, blocks) sampling weights of blocks by condition."""
        self.counts = torch.zeros(2, count, 1)
        """Hits and failures since :meth:`clear_counts`, by condition."""
        self.block_counts = torch.zeros(2, count, len(self._widths))
        """Hits and failures since :meth:`clear_counts`, by condition and block."""
        self.score = torch.zeros(n)
        """The true game's reward of the latest user step."""
        self.condition, self.block, self.trial = (torch.zeros(n, dtype=torch.long),) * 3
        self._age_s = torch.zeros(n)
        self._hope = torch.zeros(n)
        """(N,) relaxed expected reward of the selection of the current target."""
        self._armed = torch.zeros(n, dtype=torch.bool)
        self._tip, self._origin = torch.zeros(n, 3), torch.zeros(n, 3)
        width = ("target.present", "target.width_m")
        places = [
            f"{what}{a}_m" for what in ("target.", "target.place_", "next.place_") for a in "xyz"
        ]
        self.names = (*_ROUND, *_TIP, "tip.depth_m", "tip.armed", *width, *places)

    # --- rounds ------------------------------------------------------------------------------

    def calibrate(self, place: Tensor, fields: Tensor) -> None:
        self.stylus.calibrate(place, fields[:, len(_ROUND) : len(_ROUND) + 3])

    def start(self, ids: Tensor, place: Tensor, fields: Tensor, cell: Tensor) -> None:
        """Start rounds with a random target of a random age."""
        count, generator = len(ids), self.generator
        with torch.no_grad():
            condition = self.condition_of(fields)
            weights = self.block_weights[condition]
            self._set(ids, "condition", condition)
            self._set(ids, "block", torch.multinomial(weights, 1, generator=generator)[:, 0])
            trials = self._targets.shape[1]
            self._set(ids, "trial", torch.randint(0, trials, (count,), generator=generator))
            age = _OLDEST_START_S * torch.rand(count, generator=generator)
            self._set(ids, "_age_s", age)
            self._set(ids, "_hope", torch.zeros(count))
            self._set(ids, "_armed", fields[:, FIELDS.index("tip.armed")] > 0.5)
            self._set(ids, "_origin", head_of(place))
            self._set(ids, "_tip", self.stylus(place) - head_of(place))

    def begin(self, ids: Tensor) -> None:
        """Set rounds to the first target of their block."""
        self._set(ids, "trial", torch.zeros(len(ids), dtype=torch.long))
        self._set(ids, "_age_s", torch.zeros(len(ids)))

    def _set(self, ids: Tensor, name: str, values: Tensor) -> None:
        new = getattr(self, name).detach().clone()
        new[ids] = values
        setattr(self, name, new)

    def cut(self) -> None:
        self._tip, self._hope = self._tip.detach(), self._hope.detach()

    def nearest(self, place: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """(K,) distance from the nearest point 5 cm in front of a target's place, m; cell 0."""
        with torch.no_grad():
            tip = self.stylus(place) - head_of(place)
            starts = self._targets[:, :-1].flatten(0, 1) - torch.tensor([0.0, 0.0, TAP_START_M])
            from_center = tip - self._rules[condition]
            distance = (starts - from_center[:, None]).norm(dim=2).amin(1)
        return distance, torch.zeros_like(condition)

    def condition_of(self, fields: Tensor) -> Tensor:
        """Return (K,) the conditions of user steps."""
        return torch.cdist(fields[:, : len(_ROUND)], self._rules).argmin(1)

    def clear_counts(self) -> None:
        self.counts.zero_()
        self.block_counts.zero_()

    def adapt(self) -> None:
        """Increase the sampling weights of blocks with many failures."""
        counts, share = self.block_counts, FAILING_BLOCKS
        total = counts.sum(0)
        fails = torch.where(total > 0, counts[1] / total.clamp(min=1.0), torch.ones(())) + 0.02
        weights = (1.0 - share) / fails.shape[1] + share * fails / fails.sum(1, keepdim=True)
        self.block_weights.lerp_(weights, 0.5)

    _state = (
        *("condition", "block", "trial", "_age_s", "_hope", "_armed", "_tip", "_origin"),
        *("block_weights", "score"),
        *("stylus.fixed", "generator"),
    )

    # --- what is observed --------------------------------------------------------------------

    def _goal(self) -> Tensor:
        """(B, 3) the target that is up, from the head at the round's start, m."""
        return self._rules[self.condition] + self._targets[self.block, self.trial]

    def observe(self, place: Tensor) -> Tensor:
        """(B, F) in the order of :attr:`names`, differentiable by the places."""
        center, goal = self._rules[self.condition], self._goal()
        world, head = self.stylus(place), head_of(place)
        tip, moved = world - self._origin, self._origin - head
        last = self.trial + 1 == self._targets.shape[1]
        following = center + self._targets[self.block, torch.where(last, 0, self.trial + 1)]
        parts = [
            center,
            world - head,
            (tip - center)[:, 2:],
            self._armed[:, None].float(),
            torch.ones(self.n, 1),
            self._widths[self.block][:, None],
            goal - tip,
            goal + moved,
            torch.where(last[:, None], 0.0, following + moved),
        ]
        return torch.cat(parts, 1)

    # --- a user step -------------------------------------------------------------------------

    def step(self, places: Tensor, done: float) -> Tensor:
        return self.play(places, self.settings.relaxation(done))

    def play(self, places: Tensor, soft: Relaxation) -> Tensor:
        """Advance by one user step; see :meth:`step`."""
        b, frames = places.shape[:2]
        world = self.stylus(places.flatten(0, 1)).reshape(b, frames, 3)
        reward, self.score = torch.zeros(b), torch.zeros(b)
        for k in range(frames):
            reward = reward + self._frame(world[:, k] - self._origin, soft, 1.0 / frames)
        return reward

    def _frame(self, tip: Tensor, soft: Relaxation, share: float) -> Tensor:
        """Advance by an app frame, which is ``share`` of a user step; (B,) relaxed rewards."""
        before, goal, radius = self._tip, self._goal(), 0.5 * self._widths[self.block]
        plane = self._rules[self.condition, 2]
        front, depth = before[:, 2] - plane, tip[:, 2] - plane
        selected = self._armed & (front < 0.0) & (depth >= 0.0)
        # Where it came through the plane; until then, where it is.
        way = torch.where(selected, front / (front - depth).clamp(max=-1e-6), 1.0)
        through = before + way[:, None] * (tip - before)
        beside = (through - goal)[:, :2].square().sum(1).add(1e-10).sqrt()
        hit = selected & (beside <= radius)
        self._age_s = self._age_s + self._frame_s
        late = ~selected & (self._age_s >= self.task.timeout_s - TIME_TOLERANCE_S)

        aim = torch.sigmoid((radius - beside) / soft.aim_m)
        worth = HIT_REWARD * aim - soft.error * self.task.error_cost * (1.0 - aim)
        tap = torch.sigmoid((depth - _DEPTH_MARGIN_M) / soft.depth_m)
        around = torch.sigmoid(depth / _NEAR_M) * torch.sigmoid((radius - beside) / _NEAR_M)
        hope = self._armed * (tap * worth + soft.near * around)
        # A target's rewards add up to what its selection is worth, however long it is hoped for.
        reward = torch.where(selected, worth, torch.where(late, 0.0, hope)) - self._hope
        self._hope = torch.where(selected | late, 0.0, hope)
        out = torch.relu(depth + self.task.rearm_m + _BEHIND_MARGIN_M)
        behind = soft.behind * (~self._armed) * out / _BEHIND_M

        self._armed = (self._armed & ~selected) | ((depth < 0.0) & (depth <= -self.task.rearm_m))
        self._tip = tip
        self._count(hit, (selected & ~hit) | late)
        self._next(selected | late)
        far = share * distance_reward((self._goal() - tip).norm(dim=1))
        with torch.no_grad():
            errors = self.task.error_cost * (selected & ~hit)
            self.score = self.score + HIT_REWARD * hit - errors + self.task.distance_weight * far
        return reward - share * behind + soft.distance * far

    def _count(self, hit: Tensor, failed: Tensor) -> None:
        for number, ended in enumerate((hit, failed)):
            row = torch.nonzero(ended).flatten()
            where, ones = self.condition[row], torch.ones(len(row))
            self.block_counts[number].index_put_((where, self.block[row]), ones, accumulate=True)
            self.counts[number, :, 0].index_put_((where,), ones, accumulate=True)

    def _next(self, ended: Tensor) -> None:
        """Put the next target up where a trial is over."""
        over = ended & (self.trial + 1 == self._targets.shape[1])
        blocks = torch.multinomial(self.block_weights[self.condition], 1, generator=self.generator)[
            :, 0
        ]
        self.block = torch.where(over, blocks, self.block)
        self.trial = torch.where(over, 0, self.trial + ended)
        self._age_s = torch.where(ended, 0.0, self._age_s)


class Pointing:
    """Facts of Pointing for imagined rollouts: fields, devices, conditions and outcomes."""

    name = "pointing"
    settings = GameModelSettings
    devices = ("controller_right", "headset")
    fields = FIELDS
    cells = 1
    conditions = ("mid",)
    hidden_fields = (
        *("aid.*", "shown.*", "round.progress", "tip.v?_mps"),
        *("target.start", "target.age_s", "next.present", "* qacc", "fingertip *"),
    )
    felt_fields = ("tip.*",)
    facts = "shown.*"
    on_gpu = False
    attention_targets: tuple[str, ...] = ()
    start_fields: tuple[str, str] | None = ("aid.start_distance_m", "aid.start_cell")
    start_limits: Mapping[str, tuple[float, float]] = {"elbow_flexion": (0.5, 1.9)}

    def options(
        self, condition: str, weights: Sequence[float] | None = None
    ) -> dict[str, OptionValue]:
        """Return the condition's options; weights do not change the order of blocks."""
        return dict(describe_game(self.name).condition(condition).options)

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        """Return (2, 1) the numbers of hits, and of targets that were missed or timed out."""
        return np.array([[log.get("Points", 0.0)], [log.get("Failures", 0.0)]])

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
    ) -> ImaginedPointing:
        return ImaginedPointing(
            n, conditions, settings, frame_s=step_s / frames, frames=frames, seed=seed
        )


GAME = Pointing()
