"""Aimed movements of a human motor policy: Fitts' law, errors and speed profiles.

Simulated persons stay at a place, then a target appears. The policy itself says when a movement
is over. Times count from the onset. A hand that stays still sways at some cm/s, so speeds are those
along the direction from the hand, as the target appears, to the target. The baseline is that speed
in the first 10 ms. The onset is the last time before the peak when the speed is not above the
baseline plus 10 % of the peak's height above it.

The policy receives the target at once, so the reaction is that of the hand alone, without the
delays of sight and recognition that a person has in an app.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import find_peaks

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.human_motor import HumanHands, HumanMotorPolicy
from sim2vr_harness.training.motor_control.benchmark import effective_bits
from sim2vr_harness.training.motor_control.person_course import (
    SAMPLE_S,
    FloatArray,
    PersonCourse,
    one_by_one,
)

DISTANCES_M, WIDTHS_M = (0.1, 0.2, 0.4), (0.02, 0.035, 0.06)
"""Nine indices of difficulty, 1.4 to 4.4 bits."""
_SETTLE_S, _LONGEST_S, _REST_M = 0.8, 2.0, 0.03
_OF_PEAK = 0.1
_FRONT_M, _HEIGHTS_M = 0.2, (0.9, 1.5)
"""Places of targets: so far before the body's axis, and so high."""
_POOL, _AT_DISTANCE_M, _COMFORT = 3000, 0.01, 0.6
"""Postures that places are taken from, the tolerance of distances, and the part of the joints'
ranges that postures are drawn from: people reach from comfortable ones."""
_PROMINENCE = 0.1
"""Of speed peaks, of the highest one."""


@dataclass(frozen=True)
class AimedMovements:
    """K movements to targets at a distance, of a width.

    Attributes:
        distance_m: from the start to the target.
        width_m: diameter of the target.
        time_s: (K,) from onset to end; NaN for movements that were not ended or had no onset.
        reaction_s: (K,) from the target's appearance to the onset; NaN where the speed is highest
            at the appearance.
        end: (K, 3) from the target to the hand at the end, m.
        way: (K, 3) from the start to the target, m.
        profile: (K, 4) peak over mean speed along the direction to the target, time of that peak
            over duration, straightness, and number of its peaks, from onset to stop; NaN where
            there was no onset or no stop.
        peak_mps: (K,) highest speed along the direction to the target.
    """

    distance_m: float
    width_m: float
    time_s: FloatArray
    reaction_s: FloatArray
    end: FloatArray
    way: FloatArray
    profile: FloatArray
    peak_mps: FloatArray

    @property
    def difficulty(self) -> float:
        """Index of difficulty, bits."""
        return float(np.log2(self.distance_m / self.width_m + 1.0))

    @property
    def throughput(self) -> float:
        """Effective index of difficulty over mean movement time, bits/s; NaN without a spread."""
        ended = ~np.isnan(self.time_s)
        return effective_bits(self.way[ended], self.end[ended]) / float(np.nanmean(self.time_s))

    @property
    def missed(self) -> NDArray[np.bool_]:
        """(K,) whether a movement ended outside the target, or did not end."""
        missed: NDArray[np.bool_] = np.linalg.norm(self.end, axis=1) > 0.5 * self.width_m
        return missed | self.unended

    @property
    def unended(self) -> NDArray[np.bool_]:
        """(K,) whether a movement did not end."""
        return np.isnan(self.end[:, 0])

    def of(self, rows: NDArray[np.int64]) -> AimedMovements:
        """Return movements (K,), by their numbers."""
        names = ("time_s", "reaction_s", "end", "way", "profile", "peak_mps")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def spread_m(self) -> float:
        """Standard deviation of the end points, root mean square over three axes."""
        ended = ~self.unended
        return float(np.sqrt(self.end[ended].var(0).mean()))


@dataclass(frozen=True)
class HumanMeasures:
    """Aimed movements of all nine indices of difficulty."""

    cells: tuple[AimedMovements, ...]

    def of(self, rows: NDArray[np.int64]) -> HumanMeasures:
        """Return the measures of some movements of every cell, ordered by person."""
        return HumanMeasures(tuple(cell.of(rows) for cell in self.cells))

    def summary(self) -> dict[str, float]:
        """Return the measures by name with unit."""
        cells = self.cells
        difficulty = np.array([cell.difficulty for cell in cells])
        time_s = np.array([np.nanmean(cell.time_s) for cell in cells])
        slope, start = np.polyfit(difficulty, time_s, 1)
        left = time_s - (start + slope * difficulty)
        profiles = np.concatenate([cell.profile for cell in cells])
        names = ("peak_over_mean", "time_of_peak", "straightness", "speed_peaks")
        by_distance = {
            d: float(np.mean([cell.peak_mps.mean() for cell in cells if cell.distance_m == d]))
            for d in sorted({cell.distance_m for cell in cells})
        }
        fast, slow = self._spread_by_speed()
        return {
            "fitts_intercept_s": float(start),
            "fitts_slope_s_per_bit": float(slope),
            "fitts_r2": float(1.0 - left.var() / time_s.var()),
            "error_rate": float(np.mean([cell.missed.mean() for cell in cells])),
            "unended_rate": float(np.mean([cell.unended.mean() for cell in cells])),
            "throughput_bits_per_s": float(np.mean([cell.throughput for cell in cells])),
            **dict(zip(names, np.nanmean(profiles, 0).tolist(), strict=True)),
            **{f"peak_speed_{d:g}m_mps": value for d, value in by_distance.items()},
            "spread_fast_m": fast,
            "spread_slow_m": slow,
            "reaction_s": float(np.nanmedian([np.nanmedian(cell.reaction_s) for cell in cells])),
        }

    def rows(self) -> list[str]:
        """Return a line per index of difficulty, for people."""
        return [
            f"{cell.difficulty:.2f} bits ({100 * cell.distance_m:.0f} cm, width "
            f"{1000 * cell.width_m:.0f} mm): {np.nanmean(cell.time_s):.2f} s, "
            f"{cell.missed.mean():.2f} missed, end points spread {1000 * cell.spread_m:.0f} mm"
            for cell in self.cells
        ]

    def _spread_by_speed(self) -> tuple[float, float]:
        """End points' spread of the faster and the slower half of each cell, mean over cells, m."""
        fast, slow = [], []
        for cell in self.cells:
            ended = ~np.isnan(cell.time_s)
            speed = cell.distance_m / np.where(ended, cell.time_s, np.inf)
            half = speed > np.median(speed[ended])
            fast.append(np.sqrt(cell.end[ended & half].var(0).mean()))
            slow.append(np.sqrt(cell.end[ended & ~half].var(0).mean()))
        return float(np.mean(fast)), float(np.mean(slow))


def measure_people(
    policy: HumanMotorPolicy,
    user: UserConfig,
    *,
    persons: int = 12,
    repeats: int = 4,
    threads: int = 0,
    seed: int = 1,
    on_progress: Callable[[float], None] = lambda share: None,
) -> HumanMeasures:
    """Measure aimed movements of persons that no training has had.

    Args:
        policy: what moves them.
        user: configuration with people.
        persons: number of persons.
        repeats: movements of each to each index of difficulty.
        threads: of the physics; 0: all.
        seed: of persons, places and noise.
        on_progress: receives the proportion that is done.
    """
    course = _Reaches(policy, user, persons, repeats, threads, seed)
    cells = [partial(course.aim, d, width) for d in DISTANCES_M for width in WIDTHS_M]
    return HumanMeasures(tuple(one_by_one(cells, on_progress)))


class AimedCourse(PersonCourse):
    """Persons that are given one target after the other, and end their movements themselves."""

    def __init__(self, *course: Any) -> None:
        super().__init__(*course)
        generator = torch.Generator().manual_seed(self._seed + 93)
        self._seen = self._policy.perception(self._n, generator)
        self._hands = HumanHands(self._policy, self._n, self._seen)

    def _wanted(self, place: FloatArray, width_m: float) -> HumanGoals:
        """Return the goals of this user step, of targets at places (N, 3)."""
        goals = HumanGoals.none(self._n, len(self._policy.hands))
        goals.active[:, self._hand] = 1.0
        goals.width[:, self._hand] = width_m
        goals.place = self._of_hand(place)
        return goals

    def _at(self, place: FloatArray, sample: int = -1) -> FloatArray:
        """(N, 3) where hands are from targets, at a sample of the last user step."""
        return self._poses(sample)[0] - place

    def _settle(self, place: FloatArray, width_m: float, time_s: float) -> None:
        """Let everyone come to rest at places (N, 3)."""
        self._look(place)
        for _ in range(round(time_s / self._policy.step_s)):
            self._step(place, width_m)

    def _follow(
        self, place: FloatArray, width_m: float, *, whole: bool = False
    ) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
        """Let everyone move to targets, which appear now.

        Args:
            place: (N, 3) m.
            width_m: diameter.
            whole: whether all of the longest time is measured; else until all have stopped.

        Returns:
            (N, S, 3) paths from the targets, (N,) user steps until the end or -1, and (N, 3) where
            it was.
        """
        self._look(place)
        path, ended = [self._at(place)[:, None]], np.full(self._n, -1)
        end = np.full((self._n, 3), np.nan)
        for step in range(round(_LONGEST_S / self._policy.step_s)):
            over, places = self._step(place, width_m)
            path.append(places)
            now = (ended < 0) & over
            ended[now] = step + 1
            end[now] = places[now, -1]
            if not whole and step > 4 and (ended >= 0).all() and step - ended.max() >= 4:
                break
        return np.concatenate(path, 1), ended, end

    def _look(self, place: FloatArray) -> None:
        """Let places (N, 3) be those of new targets."""
        far = self._far(place)
        self._seen.forget(torch.arange(self._n), far[:, None].expand(-1, len(self._policy.hands)))

    def _far(self, place: FloatArray) -> torch.Tensor:
        """(N,) how far hands are from targets, as the policy in space sees it."""
        return torch.from_numpy(np.linalg.norm(self._at(place), axis=1)).float()

    def _step(self, place: FloatArray, width_m: float) -> tuple[NDArray[np.bool_], FloatArray]:
        """Advance by a user step: (N,) who ends the movement, and (N, S, 3) where hands were."""
        now = self._hands.motion(self._bodies.users, self._who())
        actions, over = self._hands.act(now, self._wanted(place, width_m))
        self._bodies.users.step(actions, pose_samples=self._samples)
        places = np.stack([self._at(place, k) for k in range(self._samples)], 1)
        ends: NDArray[np.bool_] = over[:, self._hand].numpy() > self._rng.random(self._n)
        return ends, places

    def _measured(
        self,
        followed: tuple[FloatArray, NDArray[np.int64], FloatArray],
        distance: float,
        width: float,
    ) -> AimedMovements:
        path, ended, end = followed
        time_s, reaction_s = np.full((2, self._n), np.nan)
        profile, peak = np.full((self._n, 4), np.nan), np.full(self._n, np.nan)
        for i in range(self._n):
            last = ended[i] * self._samples if ended[i] > 0 else path.shape[1] - 1
            onset, profile[i], peak[i] = _profile(path[i], last)
            reaction_s[i] = onset * SAMPLE_S
            if ended[i] > 0:
                time_s[i] = last * SAMPLE_S - reaction_s[i]
        return AimedMovements(distance, width, time_s, reaction_s, end, -path[:, 0], profile, peak)


class _Reaches(AimedCourse):
    """Persons that reach."""

    stream = 92

    def aim(self, distance_m: float, width_m: float) -> AimedMovements:
        """Let everyone settle at a place, and aim at another one."""
        start, goal = self._pairs(distance_m)
        self._settle(start, _REST_M, _SETTLE_S)
        distance = float(np.round(np.linalg.norm(goal - start, axis=1).mean(), 3))
        return self._measured(self._follow(goal, width_m), distance, width_m)

    def _pairs(self, distance_m: float) -> tuple[FloatArray, FloatArray]:
        """(K, 3) starts, with everyone's posture there, and targets at a distance from them."""
        low, high = self._bodies.body.joint_ranges.T
        rng, n = self._rng, self._n
        spread = rng.uniform(-_COMFORT, _COMFORT, (_POOL, len(low)))
        angles = 0.5 * (low + high) + 0.5 * spread * (high - low)
        pool = torch.from_numpy(angles).float()
        postures, goal = [], np.empty((n, 3))
        seeds = rng.integers(2**31, size=n)
        self._reset(None, seeds)
        persons = torch.from_numpy(self._who()).float()
        for i in range(n):
            with torch.no_grad():
                model = self._policy.forward_model
                placed = model.places(pool, persons[[i]].expand(_POOL, -1))
            places = placed[:, self._hand, :3, 3].double().numpy()
            level = (places[:, 2] > _HEIGHTS_M[0]) & (places[:, 2] < _HEIGHTS_M[1])
            fit = np.flatnonzero(level & (places[:, 0] > _FRONT_M))
            first = rng.choice(fit)
            off = np.abs(np.linalg.norm(places[fit] - places[first], axis=1) - distance_m)
            near = np.flatnonzero(off < _AT_DISTANCE_M)
            second = fit[rng.choice(near)] if len(near) else fit[np.argmin(off)]
            postures.append(angles[first])
            way = places[second] - places[first]
            goal[i] = places[first] + distance_m * way / np.linalg.norm(way)
        self._reset(postures, seeds)
        self._hands.forget(np.arange(n))
        return self._poses()[0], goal


def _profile(path: FloatArray, last: int) -> tuple[float, FloatArray, float]:
    """Onset, measures of the profile from onset to stop, and peak of a movement's speed.

    Args:
        path: (S, 3) from the target, which appears at the first sample, m.
        last: sample at which the movement ends.

    Returns:
        The onset in samples, NaN where there is none; measures (4,); and the peak, m/s.
    """
    moved = np.diff(path, axis=0) / SAMPLE_S
    speed = moved @ -path[0] / np.linalg.norm(path[0])
    top = int(np.argmax(speed[:last]))
    peak = float(speed[top])
    baseline = float(speed[0])
    below = np.flatnonzero(speed[:top] <= baseline + _OF_PEAK * (peak - baseline))
    if not len(below):
        return np.nan, np.full(4, np.nan), peak
    onset = int(below[-1]) + 1
    after = np.flatnonzero(speed[top:] < _OF_PEAK * peak)
    if not len(after):
        return onset, np.full(4, np.nan), peak
    stop = top + int(after[0])
    part = speed[onset:stop]
    length = np.linalg.norm(moved[onset:stop], axis=1).sum() * SAMPLE_S
    straight = np.linalg.norm(path[stop] - path[onset]) / max(length, 1e-9)
    peaks = len(find_peaks(part, prominence=_PROMINENCE * peak)[0])
    lasts = max(stop - onset, 1)
    values = [peak / part.mean(), (top - onset + 0.5) / lasts, straight, max(peaks, 1)]
    return onset, np.array(values), peak
