"""Whac-A-Mole as a differentiable game, for users who are a learned body.

Targets come and go by the game's own rules (docs/games/whacamole.md): where they are, how long they
live, how many at once, when the next one comes. What is hit is decided by the rules too, but the
reward is relaxed, so that it has a gradient: a hit counts with the probability that it would happen
if hammer and target met a little elsewhere and at a little other speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from sim2vr_harness.training.imagination.body import BodyModel, Experience, Motion
from sim2vr_harness.training.imagination.noise import ImaginedNoise
from sim2vr_harness.users import Body
from sim2vr_harness.users.noise import MotorNoiseSettings

__all__ = ["CONTROLLER", "FIELDS", "HammerModel", "ImaginedWhacAMole", "Relaxation"]

CONTROLLER = "controller_right"
_ROUND = (
    *("round.low", "round.mid", "round.high"),
    *("round.constrained", "round.max_targets", "round.strike_threshold_mps"),
)
_POSE = (
    *(f"hammer.{axis}_m" for axis in "xyz"),
    *(f"hammer.{part}_{axis}" for part in ("face", "handle") for axis in "xyz"),
)
_ROOT_VELOCITY = tuple(f"hammer.root_v{axis}_mps" for axis in "xyz")
FIELDS = (*_ROUND, *_POSE, *_ROOT_VELOCITY)
"""The privileged numbers that steps of an :class:`Experience` have, in this order."""

_CELLS = 9
_FRAME_S = 0.049999997
_LIFE_S = 1.098
"""What a target has left in the frame in which it appears, growing included."""
_GROWING, _LAST = 2, 21
"""Frames until a target can be hit, and the last one in which it is there."""
_FADING = 7
"""Frames in which an ended target still keeps its cell."""
_BAN_S = 0.5
"""A target may appear up to so long after the one before it."""
_TARGETS = 3
"""Most targets of which a teacher is told in the order of their expiry."""
_S = math.sqrt(0.5)

# facts/whacamole.md, sections 3 to 5; by placement low, mid, high, the app's axes, from the head.
_AREA_M = ((0.15, -0.30, 0.35), (0.15, -0.10, 0.40), (0.15, 0.20, 0.30))
_UP = ((0.0, _S, _S), (0.0, 1.0, 0.0), (0.0, _S, -_S))
_BEHIND = ((0.0, -_S, _S), (0.0, 0.0, 1.0), (0.0, _S, _S))
_STRIKE = ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
_CELL_M, _VOLUME_BEHIND_M = 0.125, 0.010
_TARGET_HALF_M = (0.0225, 0.0225, 0.0125)
_HAMMER_HALF_M = (0.05, 0.0275, 0.0275)
# From the root, along the hammer's axes.
_MARKER_M = (-0.0482, 0.1385, -0.0005)
_BOX_M = (-0.000401, 0.139758, -0.000818)
_START_M = 0.10
_SPEED_MARGIN_MPS, _OVERLAP_MARGIN_M, _NEAR_M = 0.05, 0.002, 0.04


class HammerModel(nn.Module):
    """The hammer's pose by a body's angles: it is fixed to the controller."""

    fixed: Tensor

    def __init__(self, body: BodyModel) -> None:
        super().__init__()
        self._body = body
        self.register_buffer("fixed", torch.zeros(13, 9))

    def calibrate(self, steps: Experience) -> float:
        """Find how the hammer is fixed from poses that the game told; returns the mean error, m."""
        first = FIELDS.index(_POSE[0])
        told = steps.fields[:, first : first + len(_POSE)]
        known = self._known(steps.after.angles)
        solution = torch.linalg.lstsq(known.double(), told.double(), driver="gelsd").solution
        self.fixed.copy_(solution)
        return float((known @ self.fixed - told)[:, :3].norm(dim=1).mean())

    def _known(self, angles: Tensor) -> Tensor:
        place = self._body.chain(angles)
        ones = torch.ones(len(place), 1)
        return torch.cat([place[:, :3, 3], place[:, :3, :3].flatten(1), ones], 1)

    def forward(self, angles: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 3) marker from the head, m, and (B, 3, 3) axes x, y, z as rows, the app's axes."""
        pose = self._known(angles) @ self.fixed
        x, y = -pose[:, 3:6], pose[:, 6:]
        return pose[:, :3], torch.stack([x, y, torch.cross(x, y, dim=1)], 1)


@dataclass(frozen=True)
class Relaxation:
    """How soft a hit is, and what else is rewarded.

    Attributes:
        overlap_m: width of the step from apart to overlapping.
        speed_mps: width of the step from too slow to fast enough.
        near: reward for being near a living target at speed.
        distance: reward for the game's own term of distance to living targets, times this.
        effort: cost of the mean square of activations.
        stuck: cost of staying in a target, which must be left before it can be hit: a hit has no
            gradient that says so.
    """

    overlap_m: float
    speed_mps: float
    near: float
    distance: float
    effort: float
    stuck: float = 0.0


class ImaginedWhacAMole:
    """B rounds without an end, with users of a body model.

    Args:
        user: the body.
        body: its model.
        hammer: the tool's.
        conditions: of each condition, the privileged numbers named ``round.*``.
        n: number of users B.
        single: share of them that never have more than one target, so that far cells are
            practised too: while there is another target, those are left aside.
        seed: of spawns.
        noise: of the muscles' controls; None for none.
    """

    def __init__(
        self,
        user: Body,
        body: BodyModel,
        hammer: HammerModel,
        conditions: Sequence[Mapping[str, float]],
        n: int,
        *,
        single: float,
        seed: int,
        noise: MotorNoiseSettings | None = None,
    ) -> None:
        self.n, self.body, self.hammer = n, body, hammer
        self._muscle_names = [f"{muscle} act" for muscle in user.muscles]
        self._joint_names = list(user.independent_joints)
        self._low, self._high = torch.tensor(user.joint_ranges.T.copy(), dtype=torch.float32)
        self.generator = torch.Generator().manual_seed(seed)
        placements = ("round.low", "round.mid", "round.high")
        place = torch.tensor([[c[name] for name in placements] for c in conditions]).argmax(1)
        self._threshold = torch.tensor([c["round.strike_threshold_mps"] for c in conditions])
        self._constrained = torch.tensor([c["round.constrained"] for c in conditions])
        self._most = torch.tensor([int(c["round.max_targets"]) for c in conditions])
        self._single = torch.arange(n) < round(single * n)
        self._told = torch.tensor([[c[name] for name in _ROUND] for c in conditions])
        cell = torch.arange(_CELLS)
        across, up = (cell % 3 - 1.0) * _CELL_M, (1.0 - cell // 3) * _CELL_M
        area, ups, behind = (torch.tensor(t)[place] for t in (_AREA_M, _UP, _BEHIND))
        right = torch.tensor([1.0, 0.0, 0.0]).expand_as(ups)
        self._axes = torch.stack([right, ups, behind], 1)
        self._area, self._strike = area, torch.tensor(_STRIKE)[place]
        self._cells = (
            area[:, None]
            + across[None, :, None] * right[:, None]
            + up[None, :, None] * ups[:, None]
            + _VOLUME_BEHIND_M * behind[:, None]
        )
        self.spawn_weights = torch.full((len(conditions), _CELLS), 1.0 / _CELLS)
        """By condition and cell."""
        self.hit_values = torch.ones(len(conditions), _CELLS)
        """How many ordinary hits a hit is worth, by condition and cell."""
        self.counts = torch.zeros(2, len(conditions), _CELLS)
        """Hits and misses since :meth:`clear_counts`, by condition and cell."""
        self.condition = torch.zeros(n, dtype=torch.long)
        joints, muscles = len(user.independent_joints), len(user.muscles)
        self.motion = Motion(
            torch.zeros(n, joints), torch.zeros(n, joints), torch.zeros(n, muscles)
        )
        self._velocity, self._root = torch.zeros(n, 3), torch.zeros(n, 3)
        self._age = torch.full((n, _CELLS), -1)
        self._fading = torch.zeros(n, _CELLS, dtype=torch.long)
        self._ban_s = torch.zeros(n)
        self._inside = torch.zeros(n, _CELLS, dtype=torch.bool)
        self._hit = torch.zeros(n, _CELLS, dtype=torch.bool)
        self._left = torch.ones(n, _CELLS)
        self._noise = None if noise is None else ImaginedNoise(noise, n, muscles)
        self._posed: tuple[Motion, Tensor, Tensor] | None = None

    # --- rounds ------------------------------------------------------------------------------

    def start(
        self, ids: Tensor, motion: Motion, velocity: Tensor, condition: Tensor, cell: Tensor
    ) -> None:
        """Let some users go on from elsewhere.

        Args:
            ids: (K,) which.
            motion: theirs, of K users.
            velocity: (K, 3) the filtered velocity of the hammer's root, m/s.
            condition: (K,) which of the conditions.
            cell: (K,) where a target lives; -1 leaves all to chance.
        """
        self._posed = None
        with torch.no_grad():
            for name in ("angles", "speeds", "act"):
                getattr(self.motion, name)[ids] = getattr(motion, name)
            self._velocity[ids], self.condition[ids] = velocity, condition
            self._root[ids] = self._points(*self.hammer(motion.angles))[0]
            self._age[ids] = self._first_ages(ids, condition, cell)
            count = len(ids)
            self._fading[ids] = 0
            self._ban_s[ids] = _BAN_S * torch.rand(count, generator=self.generator)
            self._inside[ids], self._hit[ids], self._left[ids] = False, False, 1.0
            if self._noise is not None:
                self._noise.forget(ids)

    def _first_ages(self, ids: Tensor, condition: Tensor, cell: Tensor) -> Tensor:
        """(K, cells) ages of the targets that some users begin with, in frames."""
        count, generator = len(ids), self.generator
        rows, ages = torch.arange(count), torch.full((count, _CELLS), -1)
        weights = self.spawn_weights[condition]
        first = torch.multinomial(weights, 1, generator=generator)[:, 0]
        first = torch.where(cell >= 0, cell, first)
        ages[rows, first] = torch.randint(0, _LAST // 2, (count,), generator=generator)
        more = torch.randint(-_LAST, _LAST, (count, _CELLS), generator=generator).clamp(min=-1)
        allowed = (torch.where(self._single, 1, self._most[self.condition]) - 1)[ids]
        order = torch.rand(count, _CELLS, generator=generator).argsort(1).argsort(1)
        others = (order < allowed[:, None]) & (torch.arange(_CELLS) != first[:, None])
        return torch.where(others, more, ages)

    def cut(self) -> None:
        """Forget what led to the present: gradients end here."""
        self.motion = self.motion.detach()
        self._velocity, self._root = self._velocity.detach(), self._root.detach()
        self._left = self._left.detach()

    def broken(self) -> Tensor:
        """(B,) whether a user's body has left what a body can do."""
        motion = self.motion
        wild = motion.speeds.detach().abs().amax(1) > 40.0
        return wild | ~torch.isfinite(motion.angles.detach()).all(1)

    def nearest(self, angles: Tensor, condition: Tensor) -> tuple[Tensor, Tensor]:
        """(K,) distance from the nearest point 10 cm in front of a cell, m, and (K,) that cell."""
        with torch.no_grad():
            marker, _ = self.hammer(angles)
            front = self._cells[condition] - _START_M * self._axes[condition, 2][:, None]
            distance, cell = (front - marker[:, None]).norm(dim=2).min(1)
        return distance, cell

    def condition_of(self, steps: Experience) -> Tensor:
        """(K,) which condition user steps were taken in."""
        return torch.cdist(steps.fields[:, : len(_ROUND)], self._told).argmin(1)

    @staticmethod
    def velocity_of(steps: Experience) -> Tensor:
        """(K, 3) the filtered velocity of the hammer's root after user steps, m/s."""
        first = FIELDS.index(_ROOT_VELOCITY[0])
        return steps.fields[:, first : first + 3]

    def clear_counts(self) -> None:
        """Count hits and misses anew."""
        self.counts.zero_()

    _STATE = (
        *("_velocity", "_root", "_age", "_fading", "_ban_s", "_inside", "_hit", "_left"),
        *("condition", "spawn_weights", "hit_values"),
    )

    def state(self) -> dict[str, Tensor]:
        """Everything that the rounds' future depends on, but for the body model."""
        own = {name: getattr(self, name).clone() for name in self._STATE}
        if self._noise is not None:
            own |= self._noise.state()
        return own | {
            "angles": self.motion.angles.clone(),
            "speeds": self.motion.speeds.clone(),
            "act": self.motion.act.clone(),
            "generator": self.generator.get_state(),
        }

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on from :meth:`state`."""
        self._posed = None
        for name in self._STATE:
            setattr(self, name, state[name].clone())
        self.motion = Motion(*(state[name].clone() for name in ("angles", "speeds", "act")))
        self.generator.set_state(state["generator"])
        if self._noise is not None:
            self._noise.load_state(state)

    # --- what is observed --------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """What :meth:`observe` gives, by the names of a teacher's observation."""
        joints = self._joint_names
        body = [*(f"{j} qpos" for j in joints), *(f"{j} qvel" for j in joints)]
        hammer = [*_POSE[:3], *_ROOT_VELOCITY, *_POSE[3:], "hammer.strike_mps", "hammer.depth_m"]
        state = ("present", "alive", "life_s")
        cells = [f"cell{cell}.{name}" for cell in range(_CELLS) for name in state]
        order = (*state, "x_m", "y_m", "z_m")
        following = [f"next{i}.{name}" for i in range(_TARGETS) for name in order]
        return (*body, *self._muscle_names, *_ROUND, *hammer, *cells, *following)

    def observe(self) -> Tensor:
        """(B, F) in the order of :attr:`names`, differentiable by the motion."""
        motion, condition = self.motion, self.condition
        marker, axes = self._pose()
        strike = (self._velocity * self._strike[condition]).sum(1, keepdim=True)
        behind = self._axes[condition, 2]
        depth = ((marker - self._area[condition]) * behind).sum(1, keepdim=True)
        present = (self._age >= 0).float()
        alive = (self._age >= _GROWING).float()
        life = present * (_LIFE_S - _FRAME_S * self._age)
        oldest = torch.where(
            self._age >= 0, self._age + 1e-3 * torch.arange(_CELLS).flip(0), torch.tensor(-1.0)
        ).topk(_TARGETS, 1)
        there, which = (oldest.values >= 0).float(), oldest.indices
        rows = torch.arange(self.n)[:, None]
        places = self._cells[condition][rows, which] - marker[:, None]
        following = [there, alive.gather(1, which) * there, life.gather(1, which) * there]
        parts = [
            2.0 * (motion.angles - self._low) / (self._high - self._low) - 1.0,
            motion.speeds,
            2.0 * motion.act - 1.0,
            self._told[condition],
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

    def step(self, actions: Tensor, soft: Relaxation, *, error_share: float) -> Tensor:
        """Advance everyone by one user step.

        Args:
            actions: (B, M) changes of activation.
            soft: what is rewarded.
            error_share: noise on the motion, in units of the body model's error.

        Returns:
            (B,) rewards, differentiable by all actions since :meth:`cut`.
        """
        control = (self.motion.act + actions.clamp(-1.0, 1.0)).clamp(0.0, 1.0)
        if self._noise is not None:
            control = self._noise.apply(control)
        after = self.body(self.motion, control)
        self.motion = self.body.disturbed(after, error_share) if error_share > 0.0 else after
        self._next_frame()
        marker, axes = self._pose()
        root, box = self._points(marker, axes)
        self._velocity = self._velocity + 0.5 * ((root - self._root) / _FRAME_S - self._velocity)
        self._root = root
        return self._judge(marker, box, axes, soft)

    def _next_frame(self) -> None:
        """Targets of the next frame, after hits at the poses of this one."""
        old = (self._age >= _LAST) & ~self._hit
        for number, ended in enumerate((self._hit, old)):
            row, cell = torch.nonzero(ended, as_tuple=True)
            where = (self.condition[row], cell)
            self.counts[number].index_put_(where, torch.ones(len(row)), accumulate=True)
        gone = self._hit | old
        self._age = torch.where(gone, -1, torch.where(self._age >= 0, self._age + 1, self._age))
        self._fading = torch.where(gone, _FADING, (self._fading - 1).clamp(min=0))
        self._ban_s = self._ban_s - _FRAME_S
        free = (self._age < 0) & (self._fading == 0)
        most = torch.where(self._single, 1, self._most[self.condition])
        wanted = ((~free).sum(1) < most) & (self._ban_s < 0.0)
        # The largest of the logarithms plus Gumbel noise: a draw by the weights.
        noise = torch.rand(self.n, _CELLS, generator=self.generator).clamp(1e-9, 1.0 - 1e-7)
        scores = self.spawn_weights[self.condition].log() - (-noise.log()).log()
        cell = torch.where(free, scores, torch.tensor(-1e9)).argmax(1)
        rows = torch.arange(self.n)[wanted]
        self._age[rows, cell[wanted]] = 0
        ban = _BAN_S * torch.rand(self.n, generator=self.generator)
        self._ban_s = torch.where(wanted, ban, self._ban_s)
        left = torch.where(gone, torch.ones(()), self._left)
        left[rows, cell[wanted]] = 1.0
        self._left = left

    def _pose(self) -> tuple[Tensor, Tensor]:
        """Marker and axes of the hammer now; what is observed after a step is the step's own."""
        if self._posed is None or self._posed[0] is not self.motion:
            self._posed = (self.motion, *self.hammer(self.motion.angles))
        return self._posed[1:]

    @staticmethod
    def _points(marker: Tensor, axes: Tensor) -> tuple[Tensor, Tensor]:
        """Root of the hammer and middle of its collider, (B, 3) m each."""
        root = marker - torch.einsum("k,bkx->bx", torch.tensor(_MARKER_M), axes)
        box = root + torch.einsum("k,bkx->bx", torch.tensor(_BOX_M), axes)
        return root, box

    def _judge(self, marker: Tensor, box: Tensor, axes: Tensor, soft: Relaxation) -> Tensor:
        condition = self.condition
        frame, cells = self._axes[condition], self._cells[condition]
        strike = (self._velocity * self._strike[condition]).sum(1)
        depth = _depths(frame, cells, axes, box)
        inside = (depth > 0.0).all(2) & (self._age >= 0)
        alive = self._age >= _GROWING
        counts = alive & ~self._inside  # only coming in is a hit
        threshold, constrained = self._threshold[condition], self._constrained[condition] > 0.0
        fast = (strike > threshold) | ~constrained
        self._hit = inside & counts & fast[:, None]
        within: Tensor | float = 0.0
        if soft.stuck > 0.0:  # few practices pay for it
            stuck = inside & self._inside
            within = (stuck * (1.0 + depth.amin(2) / _NEAR_M)).sum(1)
        speed = torch.sigmoid((strike - threshold - _SPEED_MARGIN_MPS) / soft.speed_mps)
        speed = torch.where(constrained, speed, torch.ones(()))[:, None]
        overlap = torch.sigmoid((depth - _OVERLAP_MARGIN_M) / soft.overlap_m).prod(2)
        chance = counts * overlap * speed
        hits = (self.hit_values[condition] * self._left * chance).sum(1)
        still = self._left
        self._left = still * (1.0 - chance)
        self._inside = inside
        towards = torch.sigmoid((strike - threshold) / 0.5)
        towards = torch.where(constrained, towards, torch.ones(()))[:, None]
        around = torch.sigmoid(depth / _NEAR_M).prod(2)
        near = (counts * still.detach() * around * towards).sum(1)
        distance = (cells - marker[:, None]).norm(dim=2)
        far = (alive * (torch.exp(-10.0 * distance) - 1.0) / 10.0).sum(1)
        motion = self.motion
        unit = 2.0 * (motion.angles - self._low) / (self._high - self._low) - 1.0
        beyond = torch.relu(unit.abs() - 1.0).sum(1)
        wild = torch.relu(motion.speeds.abs() - 15.0).sum(1)
        return (
            10.0 * hits
            + soft.near * near
            + soft.distance * far
            - soft.stuck * within
            - soft.effort * motion.act.square().mean(1)
            - 0.5 * beyond
            - 0.02 * wild
        )


def _depths(frame: Tensor, cells: Tensor, axes: Tensor, box: Tensor) -> Tensor:
    """How deep the hammer's box is in the targets' (separating axes), m; all > 0 inside.

    Args:
        frame: (B, 3, 3) axes of the targets, as rows.
        cells: (B, C, 3) middles of their boxes.
        axes: (B, 3, 3) axes of the hammer.
        box: (B, 3) middle of its box.

    Returns:
        (B, C, 7): along the axes of the target and of the hammer, and the least along the nine
        directions across an edge of each. Without the last, 8 % more boxes seem to overlap, and
        without the hammer's axes 60 %.
    """
    hammer, target = torch.tensor(_HAMMER_HALF_M), torch.tensor(_TARGET_HALF_M)
    edges = torch.cross(frame[:, :, None], axes[:, None], dim=3).flatten(1, 2)  # (B, 9, 3)
    length = edges.norm(dim=2, keepdim=True)
    edges = edges / length.clamp(min=1e-3)
    directions = torch.cat([frame, axes, edges], 1)
    reach = ((directions @ frame.transpose(1, 2)).abs() * target).sum(2)
    reach = reach + ((directions @ axes.transpose(1, 2)).abs() * hammer).sum(2)
    apart = ((cells - box[:, None]) @ directions.transpose(1, 2)).abs()
    depths = reach[:, None] - apart  # (B, C, 15)
    parallel = (length[..., 0] < 1e-2)[:, None]  # no direction of its own
    across = torch.where(parallel, torch.ones(()), depths[..., 6:]).amin(2, keepdim=True)
    return torch.cat([depths[..., :6], across], 2)
