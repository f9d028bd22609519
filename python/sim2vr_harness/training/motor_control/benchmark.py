"""Benchmark of a motor policy: endpoint error, speed, effort and movement law.

Simulated bodies in MuJoCo start in any posture, reach a first place, and from there a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.policies.hierarchical.goal_sampler import LEAD_STEPS
from sim2vr_harness.policies.hierarchical.motor_goals import MOMENT_S, MotorGoals, tips
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.workspace import INSIDE, reachable_poses
from sim2vr_harness.users import UserBatch
from sim2vr_harness.users.kinematics.posture_controller import PostureController
from sim2vr_harness.users.noise import MotorNoiseSettings

FloatArray = NDArray[np.float64]

_SETTLE_S, _HOLD_S = 1.2, 0.6
_FRONT_M = 0.15
"""Goals are so far before the middle of the body, at least."""
_USUAL_MPS = 0.6
"""Reaches take their way at this speed on average, and no less than _LEAST_S."""
_LEAST_S = 0.4
_STRIKE_MPS = (0.5, 3.0)
_STRIKE_S = 0.45
_TOOLS_M = (0.0, 0.3)
FITTS_DISTANCES_M = (0.05, 0.1, 0.2, 0.4)
FITTS_TIMES_S = (0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
_AT_DISTANCE_M = 0.01
_HELD_BODIES = 64
_OF_NORMAL = 4.133
"""Widths of targets that 96 % of normally spread end points hit, in standard deviations
(ISO 9241-411: effective width)."""


@dataclass(frozen=True)
class BenchmarkMovements:
    """Goals that K hands were given from a place at which they were, and what became of them.

    Attributes:
        start: (K, 3) where the tips were, MuJoCo's world frame, m.
        goal: (K, 3) where they were to be.
        velocity: (K, 3) with which velocity, m/s; 0: to stop.
        time_s: (K,) in which time.
        end: (K, 3) where they were then.
        end_velocity: (K, 3) m/s.
        held_m: (K,) how far from the goal they were after holding it; NaN for strikes.
        effort: (K,) mean square of the drives while holding; NaN for strikes.
        least_effort: (K,) the least with which muscles could hold that posture; NaN where it was
            not worked out, and for bodies without muscles.
    """

    start: FloatArray
    goal: FloatArray
    velocity: FloatArray
    time_s: FloatArray
    end: FloatArray
    end_velocity: FloatArray
    held_m: FloatArray
    effort: FloatArray
    least_effort: FloatArray

    @property
    def error_m(self) -> FloatArray:
        """(K,) how far from their goals they were in time."""
        return np.asarray(np.linalg.norm(self.end - self.goal, axis=1))

    @property
    def speed_error_mps(self) -> FloatArray:
        """(K,) how far their velocities were from those requested."""
        return np.asarray(np.linalg.norm(self.end_velocity - self.velocity, axis=1))


@dataclass(frozen=True)
class MotorMeasures:
    """Measures of a motor layer.

    Attributes:
        reaches: hands that came to rest anywhere before the body, by the lengths of their tools, m.
        strikes: hands that went through a place at a speed, from nearby.
        aimed: hands that went a distance of FITTS_DISTANCES_M in a time of FITTS_TIMES_S, by both.
    """

    reaches: dict[float, BenchmarkMovements]
    strikes: BenchmarkMovements
    aimed: dict[tuple[float, float], BenchmarkMovements]

    def fitts(self) -> dict[str, float]:
        """Movement time by effective index of difficulty: a (s), b (s/bit), r2, throughput.

        End points' spread along the way, their mean distance and their times are taken as those of
        aimed movements (ISO 9241-411); throughput (bits/s) is the mean of index over time.
        """
        difficulty, time_s = self.difficulties()
        slope, start = np.polyfit(difficulty, time_s, 1)
        left = time_s - (start + slope * difficulty)
        r2 = 1.0 - left.var() / time_s.var()
        throughput = float((difficulty / time_s).mean())
        return {
            "a_s": float(start),
            "b_s_per_bit": float(slope),
            "r2": float(r2),
            "throughput_bits_per_s": throughput,
        }

    def difficulties(self) -> tuple[FloatArray, FloatArray]:
        """Effective indices (bits), and movement times (s), of the cells of ``aimed``."""
        found, times = [], []
        for one in self.aimed.values():
            found.append(effective_bits(one.goal - one.start, one.end - one.goal))
            times.append(one.time_s.mean())
        return np.array(found), np.array(times)

    def summary(self) -> dict[str, float]:
        """Medians and 90th percentiles of everything, by name with unit."""
        rows: dict[str, float] = {}
        for length, one in self.reaches.items():
            name = f"reach_{round(100 * length)}cm_tool"
            rows |= _two(f"{name}_error_m", one.error_m) | _two(f"{name}_held_m", one.held_m)
        hand = self.reaches[_TOOLS_M[0]]
        rows["hold_effort"] = float(np.nanmean(hand.effort))
        known = ~np.isnan(hand.least_effort)
        if known.any():
            rows["hold_effort_over_least"] = float(
                hand.effort[known].mean() / hand.least_effort[known].mean()
            )
        rows |= _two("strike_error_m", self.strikes.error_m)
        rows |= _two("strike_speed_error_mps", self.strikes.speed_error_mps)
        return rows | {f"fitts_{name}": value for name, value in self.fitts().items()}


def effective_bits(way: FloatArray, end: FloatArray) -> float:
    """Return the effective index of difficulty of movements, bits (ISO 9241-411).

    Args:
        way: (K, 3) from starts to targets.
        end: (K, 3) from targets to end points.
    """
    far = np.linalg.norm(way, axis=1)
    beyond = (end * way).sum(1) / far
    width = _OF_NORMAL * np.std(beyond)
    return float(np.log2((far + beyond).mean() / width + 1.0)) if width > 0.0 else np.nan


def _two(name: str, values: FloatArray) -> dict[str, float]:
    return {
        f"{name}_median": float(np.nanmedian(values)),
        f"{name}_p90": float(np.nanquantile(values, 0.9)),
    }


def measure_layer(
    layer: MotorPolicy,
    *,
    noise: MotorNoiseSettings | None = None,
    bodies: int = 256,
    threads: int = 0,
    seed: int = 1,
    on_progress: Callable[[float], None] = lambda share: None,
) -> MotorMeasures:
    """Measure a layer on its body; the last hand moves, the others rest.

    Args:
        layer: what to measure.
        noise: motor noise of the muscles; None: none.
        bodies: number of movements of each kind.
        threads: of the physics; 0: all.
        seed: of postures, places and noise.
        on_progress: told the share that is done.
    """
    course = _Course(layer, noise, bodies, threads, seed)
    total = len(_TOOLS_M) + 1 + len(FITTS_DISTANCES_M) * len(FITTS_TIMES_S)
    done = 0

    def over(aimed: BenchmarkMovements) -> BenchmarkMovements:
        nonlocal done
        done += 1
        on_progress(done / total)
        return aimed

    reaches = {length: over(course.reach(length)) for length in _TOOLS_M}
    strikes = over(course.strike())
    aimed = {
        (distance, time_s): over(course.aim(distance, time_s))
        for distance in FITTS_DISTANCES_M
        for time_s in FITTS_TIMES_S
    }
    return MotorMeasures(reaches, strikes, aimed)


class _Course:
    """Bodies with goals for their hands."""

    def __init__(
        self,
        layer: MotorPolicy,
        noise: MotorNoiseSettings | None,
        bodies: int,
        threads: int,
        seed: int,
    ) -> None:
        self._layer, self._n = layer, bodies
        substeps = round(layer.step_s / layer.body.timestep)
        self._users = UserBatch(
            layer.body, bodies, threads=threads, effort="zero", noise=noise, substeps=substeps
        )
        self._rng = np.random.default_rng([seed, 91])
        self._hand = len(layer.hands) - 1
        poses = reachable_poses(layer, seed)[:, self._hand]
        self._poses = poses[poses[:, 0, 3] > _FRONT_M]
        muscles = bool(layer.drives.muscles.size)
        self._reacher = PostureController(layer.body, layer.hands[self._hand]) if muscles else None

    def reach(self, tool_m: float) -> BenchmarkMovements:
        """To places anywhere, and stay."""
        tip = self._tip(tool_m)
        goal = self._anywhere(tip)
        start = self._settle(tip)
        far = np.linalg.norm(goal - start, axis=1)
        time_s = np.maximum(_LEAST_S, far / _USUAL_MPS)
        return self._go(tip, goal, np.zeros_like(goal), time_s, holds=True)

    def strike(self) -> BenchmarkMovements:
        """Through places nearby."""
        tip = self._tip(0.0)
        start = self._settle(tip)
        goal = self._at_distance(start, 0.1)
        way = self._rng.standard_normal(start.shape)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        velocity = self._rng.uniform(*_STRIKE_MPS, (self._n, 1)) * way
        return self._go(tip, goal, velocity, np.full(self._n, _STRIKE_S), holds=False)

    def aim(self, distance_m: float, time_s: float) -> BenchmarkMovements:
        """To places at a distance, in a time."""
        tip = self._tip(0.0)
        start = self._settle(tip)
        goal = self._at_distance(start, distance_m)
        times = np.full(self._n, time_s)
        return self._go(tip, goal, np.zeros_like(goal), times, holds=False)

    def _tip(self, ahead_m: float) -> Tensor:
        return torch.tensor([ahead_m, 0.0, 0.0]).expand(self._n, 1, 3)

    def _anywhere(self, tip: Tensor) -> FloatArray:
        rows = self._rng.integers(len(self._poses), size=self._n)
        return tips(self._poses[rows][:, None], tip)[:, 0].double().numpy()

    def _at_distance(self, start: FloatArray, distance_m: float) -> FloatArray:
        """(K, 3) places that can be reached, as far from the start, or nearly so."""
        places = self._poses[:, :3, 3].double().numpy()
        goal = np.empty_like(start)
        for i, here in enumerate(start):
            off = np.abs(np.linalg.norm(places - here, axis=1) - distance_m)
            fit = np.flatnonzero(off < _AT_DISTANCE_M)
            goal[i] = places[self._rng.choice(fit) if len(fit) else np.argmin(off)]
        return goal

    def _tips(self, tip: Tensor) -> tuple[FloatArray, FloatArray]:
        """(K, 3) places and velocities of the tips."""
        angles, speeds, _ = self._layer.motion(self._users)
        with torch.inference_mode():
            now, soon = self._layer.places(angles, speeds)
        here = tips(now[:, [self._hand]], tip)[:, 0]
        velocity = (tips(soon[:, [self._hand]], tip)[:, 0] - here) / MOMENT_S
        return here.double().numpy(), velocity.double().numpy()

    def _settle(self, tip: Tensor) -> FloatArray:
        """(K, 3) where tips are that came to a first place from any posture."""
        low, high = self._layer.body.joint_ranges.T
        spread = self._rng.uniform(-1.0, 1.0, (self._n, len(low)))
        postures = 0.5 * (low + high) + 0.5 * INSIDE * (high - low) * spread
        seeds = self._rng.integers(2**31, size=self._n)
        everyone = np.arange(self._n)
        self._users.reset(everyone, [np.random.default_rng(s) for s in seeds], list(postures))
        goal = self._anywhere(tip)
        steps = round(_SETTLE_S / self._layer.step_s)
        for step in range(steps):
            left = max(LEAD_STEPS * self._layer.step_s, 0.8 - step * self._layer.step_s)
            self._step(tip, goal, np.zeros_like(goal), np.full(self._n, left))
        return self._tips(tip)[0]

    def _step(
        self, tip: Tensor, goal: FloatArray, velocity: FloatArray, left_s: FloatArray
    ) -> None:
        goals = MotorGoals.none(self._n, len(self._layer.hands))
        hand = self._hand
        goals.tip[:, hand] = tip[:, 0]
        goals.place[:, hand] = torch.from_numpy(goal).float()
        goals.velocity[:, hand] = torch.from_numpy(velocity).float()
        goals.left_s[:, hand] = torch.from_numpy(left_s).float()
        goals.active[:, hand] = 1.0
        self._users.step(self._layer.act(self._users, goals))

    def _go(
        self,
        tip: Tensor,
        goal: FloatArray,
        velocity: FloatArray,
        time_s: FloatArray,
        *,
        holds: bool,
    ) -> BenchmarkMovements:
        step_s = self._layer.step_s
        start = self._tips(tip)[0]
        lasts = np.maximum(1, np.round(time_s / step_s)).astype(int)
        further = round(_HOLD_S / step_s) if holds else 0
        end, end_velocity = np.full_like(start, np.nan), np.full_like(start, np.nan)
        held, efforts = np.full(self._n, np.nan), np.zeros(self._n)
        counted = np.zeros(self._n)
        for step in range(int(lasts.max()) + further):
            left = (lasts - step) * step_s
            self._step(tip, goal, velocity, np.where(left > 0.0, left, LEAD_STEPS * step_s))
            here, moves = self._tips(tip)
            now = lasts == step + 1
            end[now], end_velocity[now] = here[now], moves[now]
            settled = lasts + further == step + 1
            if holds:
                held[settled] = np.linalg.norm(here - goal, axis=1)[settled]
                stays = (step >= lasts + further // 2) & (step < lasts + further)
                efforts[stays] += self._effort()[stays]
                counted[stays] += 1.0
        effort = efforts / np.where(counted > 0, counted, np.nan)
        least = self._least() if holds else np.full(self._n, np.nan)
        return BenchmarkMovements(
            start, goal, velocity, lasts * step_s, end, end_velocity, held, effort, least
        )

    def _effort(self) -> FloatArray:
        drives = self._layer.drives
        known = np.asarray(drives.of(self._users), dtype=np.float64)
        return np.asarray(np.square(known[:, drives.muscles] if self._reacher else known).mean(1))

    def _least(self) -> FloatArray:
        """(K,) of the first bodies, as they are now."""
        least = np.full(self._n, np.nan)
        if self._reacher is not None:
            for i in range(min(self._n, _HELD_BODIES)):
                least[i] = np.square(self._reacher.holding(self._users.qpos[i])).mean()
        return least
