"""Aimed movements of a motor policy: Fitts' law, errors and speed profiles.

Hands stay at a place, then a target appears. A human motor policy says itself when a movement is
over; a motor layer gets a movement time. Times count from the onset. A hand that stays still sways
at some cm/s, so speeds are those along the direction from the hand, as the target appears, to the
target. The baseline is that speed in the first 10 ms. The onset is the last time before the peak
when the speed is not above the baseline plus 10 % of the peak's height above it.

The policy receives the target at once, so the reaction is that of the hand alone, without the
delays of sight and recognition that a person has in an app.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import find_peaks

from sim2vr_harness.envs.config import UserConfig, motor_noise
from sim2vr_harness.policies.hierarchical.goal_sampler import LEAD_STEPS
from sim2vr_harness.policies.hierarchical.human_motor import HumanHands, HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals, MotorPolicy
from sim2vr_harness.statistics.fitts import effective_bits, fit_line
from sim2vr_harness.training.motor_control.people_training import Bodies
from sim2vr_harness.users import UserBatch

FloatArray = NDArray[np.float64]

DISTANCES_M, WIDTHS_M = (0.1, 0.2, 0.4), (0.02, 0.035, 0.06)
"""Nine indices of difficulty of human motor policies, 1.4 to 4.4 bits."""
TIMES_S = (0.2, 0.4, 0.8)
"""Movement times of motor layers at each distance."""
SAMPLE_S = 0.01
"""Interval at which paths are sampled."""
_SETTLE_S, _LONGEST_S, _REST_M = 0.8, 2.0, 0.03
_OF_PEAK = 0.1
_FRONT_M, _HEIGHTS_M = 0.2, (0.9, 1.5)
"""Positions of targets: distance in front of the body's axis, and heights for persons, m."""
_POOL, _AT_DISTANCE_M, _COMFORT = 3000, 0.01, 0.6
"""Postures that places are taken from, the tolerance of distances, and the part of the joints'
ranges that postures are drawn from: people reach from comfortable ones."""
_PROMINENCE = 0.1
"""Of speed peaks, of the highest one."""
_PROFILE = ("peak_over_mean", "time_of_peak", "straightness", "speed_peaks")


@dataclass(frozen=True)
class AimedMovements:
    """K movements in each of C cells: a distance and a width, or a distance and a time.

    Attributes:
        distance_m: (C,) from the start to the target.
        width_m: (C,) diameter of the target; NaN: movements end after a time.
        time_s: (C, K) from onset to end; NaN for movements that did not end or had no onset.
        reaction_s: (C, K) from the target's appearance to the onset; NaN where the speed is highest
            at the appearance.
        end: (C, K, 3) from the target to the hand at the end, m; NaN for movements without one.
        way: (C, K, 3) from the start to the target, m.
        profile: (C, K, 4) peak over mean speed along the direction to the target, time of that peak
            over duration, straightness, and number of its peaks, from onset to stop; NaN where
            there was no onset or no stop.
        peak_mps: (C, K) highest speed along the direction to the target.
    """

    distance_m: FloatArray
    width_m: FloatArray
    time_s: FloatArray
    reaction_s: FloatArray
    end: FloatArray
    way: FloatArray
    profile: FloatArray
    peak_mps: FloatArray

    @property
    def difficulty(self) -> FloatArray:
        """(C,) indices of difficulty, bits: effective ones where targets have no width."""
        nominal = np.log2(self.distance_m / self.width_m + 1.0)
        return np.where(np.isnan(nominal), self.effective, nominal)

    @property
    def effective(self) -> FloatArray:
        """(C,) effective indices of difficulty, bits; NaN without a spread."""
        ended = ~np.isnan(self.time_s)
        cells = zip(self.way, self.end, ended, strict=True)
        return np.array([effective_bits(way[now], end[now]) for way, end, now in cells])

    @property
    def missed(self) -> NDArray[np.bool_]:
        """(C, K) whether a movement ended outside the target, or did not end."""
        outside = np.linalg.norm(self.end, axis=2) > 0.5 * self.width_m[:, None]
        return np.asarray(outside | self.unended)

    @property
    def unended(self) -> NDArray[np.bool_]:
        """(C, K) whether a movement did not end."""
        return np.isnan(self.end[..., 0])

    @property
    def spread_m(self) -> FloatArray:
        """(C,) standard deviation of the end points, root mean square over three axes."""
        ended = zip(self.end, ~self.unended, strict=True)
        return np.array([np.sqrt(end[now].var(0).mean()) for end, now in ended])

    def of(self, rows: NDArray[np.int64]) -> AimedMovements:
        """Return the movements (K,) of every cell, by their numbers; they are ordered by person."""
        fields = dict(vars(self))
        for name in fields.keys() - {"distance_m", "width_m"}:
            fields[name] = fields[name][:, rows]
        return AimedMovements(**fields)

    def summary(self) -> dict[str, float]:
        """Return the measures by name with unit, without those that are not known."""
        times_s = np.nanmean(self.time_s, 1)
        line = fit_line(self.difficulty, times_s)
        profiles = self.profile.reshape(-1, 4)
        peaks = {
            f"peak_speed_{d:g}m_mps": float(self.peak_mps[self.distance_m == d].mean(1).mean())
            for d in sorted(set(self.distance_m))
        }
        off = np.linalg.norm(self.end, axis=2)
        nominal = not np.isnan(self.width_m).any()
        fast, slow = self._spread_by_speed() if nominal else (np.nan, np.nan)
        found = {
            "fitts_intercept_s": line.a_s if line else np.nan,
            "fitts_slope_s_per_bit": line.b_s_per_bit if line else np.nan,
            "fitts_r2": line.r2 if line else np.nan,
            "endpoint_error_m_median": float(np.nanmedian(off)),
            "endpoint_error_m_p90": float(np.nanquantile(off, 0.9)),
            "error_rate": float(self.missed.mean()) if nominal else np.nan,
            "unended_rate": float(self.unended.mean()),
            "throughput_bits_per_s": float(np.mean(self.effective / times_s)),
            **dict(zip(_PROFILE, np.nanmean(profiles, 0).tolist(), strict=True)),
            **peaks,
            "spread_fast_m": fast,
            "spread_slow_m": slow,
            "reaction_s": float(np.nanmedian(np.nanmedian(self.reaction_s, 1))),
        }
        return {name: value for name, value in found.items() if not np.isnan(value)}

    def rows(self) -> list[str]:
        """Return a line per cell, for people."""
        words = []
        for k, bits in enumerate(self.difficulty):
            nominal = not np.isnan(self.width_m[k])
            width = f", width {1000 * self.width_m[k]:.0f} mm" if nominal else ""
            missed = f"{self.missed[k].mean():.2f} missed, " if nominal else ""
            words.append(
                f"{bits:.2f} bits ({100 * self.distance_m[k]:.0f} cm{width}): "
                f"{np.nanmean(self.time_s[k]):.2f} s, {missed}end points spread "
                f"{1000 * self.spread_m[k]:.0f} mm"
            )
        return words

    def _spread_by_speed(self) -> tuple[float, float]:
        """End points' spread of the faster and the slower half of each cell, mean over cells, m."""
        fast, slow = [], []
        for distance_m, time_s, end in zip(self.distance_m, self.time_s, self.end, strict=True):
            ended = ~np.isnan(time_s)
            speed = distance_m / np.where(ended, time_s, np.inf)
            half = speed > np.median(speed[ended])
            fast.append(np.sqrt(end[ended & half].var(0).mean()))
            slow.append(np.sqrt(end[ended & ~half].var(0).mean()))
        return float(np.mean(fast)), float(np.mean(slow))


def measure_movements(
    policy: HumanMotorPolicy | MotorPolicy,
    user: UserConfig,
    *,
    persons: int = 12,
    repeats: int = 4,
    threads: int = 0,
    seed: int = 1,
    on_progress: Callable[[float], None] = lambda share: None,
) -> AimedMovements:
    """Measure aimed movements of persons that were not in the training, or of the average body.

    Args:
        policy: a human motor policy, or a motor layer, with which all bodies are the same.
        user: configuration, with people for a human motor policy.
        repeats: movements of each in each cell.
    """
    course: _Course
    if isinstance(policy, HumanMotorPolicy):
        course = _PeoplesCourse(policy, user, persons, repeats, threads, seed)
        cells = [(d, width, _LONGEST_S) for d in DISTANCES_M for width in WIDTHS_M]
    else:
        course = _LayersCourse(policy, user, persons * repeats, threads, seed)
        cells = [(d, np.nan, time_s) for d in DISTANCES_M for time_s in TIMES_S]
    found = []
    for cell in cells:
        found.append(course.aim(*cell))
        on_progress(len(found) / len(cells))
    return AimedMovements(*(np.array(values) for values in zip(*found, strict=True)))


class _Course:
    """N bodies that are given one target after the other, for their first hand."""

    def __init__(self, policy: HumanMotorPolicy | MotorPolicy, users: UserBatch, seed: int) -> None:
        self._policy, self._users, self._n = policy, users, users.n
        self._rng = np.random.default_rng([seed, 92])
        self._samples = round(policy.step_s / SAMPLE_S)

    # --- what a kind of policy does in its own way ---------------------------------------------

    def _reset(self, postures: Sequence[FloatArray] | None, seeds: NDArray[np.int64]) -> None:
        """Reset all bodies at rest in a posture; None: in that of the body."""
        raise NotImplementedError

    def _places(self, angles: torch.Tensor, i: int) -> torch.Tensor:
        """(P, H, 4, 4) where the hands of body i are in postures (P, J)."""
        raise NotImplementedError

    def _usable(self, places: FloatArray) -> NDArray[np.bool_]:
        """(P,) which places (P, 3) may be starts and targets."""
        return np.asarray(places[:, 0] > _FRONT_M)

    def _look(self, place: FloatArray) -> None:
        """Set the places (N, 3) of new targets."""

    def _act(
        self, place: FloatArray, width_m: float, left_s: float
    ) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
        """Return (N, A) actions towards places (N, 3), and (N,) True if the movement ends."""
        raise NotImplementedError

    # --- movements -----------------------------------------------------------------------------

    def aim(self, distance_m: float, width_m: float, longest_s: float) -> tuple[Any, ...]:
        """Move all bodies to a place, then to another one; return a cell of the movements."""
        start, goal = self._pairs(distance_m)
        self._look(start)
        for step in range(round(_SETTLE_S / self._policy.step_s)):
            self._step(start, _REST_M, _SETTLE_S - step * self._policy.step_s)
        distance = float(np.round(np.linalg.norm(goal - start, axis=1).mean(), 3))
        path, ended, end = self._follow(goal, width_m, longest_s)
        time_s, reaction_s = np.full((2, self._n), np.nan)
        profile, peak = np.full((self._n, 4), np.nan), np.full(self._n, np.nan)
        for i in range(self._n):
            last = ended[i] * self._samples if ended[i] > 0 else path.shape[1] - 1
            onset, profile[i], peak[i] = _profile(path[i], last)
            reaction_s[i] = onset * SAMPLE_S
            if ended[i] > 0:
                time_s[i] = last * SAMPLE_S - reaction_s[i]
        return distance, width_m, time_s, reaction_s, end, -path[:, 0], profile, peak

    def _at(self, place: FloatArray, sample: int = -1) -> FloatArray:
        """Return the vectors (N, 3) from targets to hands, at a sample of the last user step."""
        return self._users.device_poses(self._policy.hands[0], sample)[0] - place

    def _step(
        self, place: FloatArray, width_m: float, left_s: float
    ) -> tuple[NDArray[np.bool_], FloatArray]:
        """Advance by a step; return (N,) True if the movement ends, and (N, S, 3) positions."""
        actions, ends = self._act(place, width_m, left_s)
        self._users.step(actions, pose_samples=self._samples)
        return ends, np.stack([self._at(place, k) for k in range(self._samples)], 1)

    def _follow(
        self, place: FloatArray, width_m: float, longest_s: float
    ) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
        """Move all bodies to new targets until all have stopped.

        Args:
            place: (N, 3) m.
            width_m: diameter.
            longest_s: time after which it is over.

        Returns:
            (N, S, 3) paths from the targets, (N,) user steps until the end or -1, and (N, 3) where
            it was.
        """
        self._look(place)
        path, ended = [self._at(place)[:, None]], np.full(self._n, -1)
        end = np.full((self._n, 3), np.nan)
        steps = round(longest_s / self._policy.step_s)
        for step in range(steps):
            over, places = self._step(place, width_m, longest_s - step * self._policy.step_s)
            path.append(places)
            now = (ended < 0) & over
            ended[now] = step + 1
            end[now] = places[now, -1]
            if step > 4 and (ended >= 0).all() and step - ended.max() >= 4:
                break
        return np.concatenate(path, 1), ended, end

    def _pairs(self, distance_m: float) -> tuple[FloatArray, FloatArray]:
        """Return (N, 3) starts, with the bodies there, and targets at a distance from them."""
        low, high = self._users.body.joint_ranges.T
        rng, n = self._rng, self._n
        spread = rng.uniform(-_COMFORT, _COMFORT, (_POOL, len(low)))
        angles = 0.5 * (low + high) + 0.5 * spread * (high - low)
        pool = torch.from_numpy(angles).float()
        postures, goal = [], np.empty((n, 3))
        seeds = rng.integers(2**31, size=n)
        self._reset(None, seeds)
        for i in range(n):
            with torch.no_grad():
                places = self._places(pool, i)[:, 0, :3, 3].double().numpy()
            fit = np.flatnonzero(self._usable(places))
            first = rng.choice(fit)
            off = np.abs(np.linalg.norm(places[fit] - places[first], axis=1) - distance_m)
            near = np.flatnonzero(off < _AT_DISTANCE_M)
            second = fit[rng.choice(near)] if len(near) else fit[np.argmin(off)]
            postures.append(angles[first])
            way = places[second] - places[first]
            goal[i] = places[first] + distance_m * way / np.linalg.norm(way)
        self._reset(postures, seeds)
        return self._at(np.zeros((n, 3))), goal


class _PeoplesCourse(_Course):
    """Persons, each ``repeats`` times, that end their movements themselves."""

    _policy: HumanMotorPolicy

    def __init__(
        self,
        policy: HumanMotorPolicy,
        user: UserConfig,
        persons: int,
        repeats: int,
        threads: int,
        seed: int,
    ) -> None:
        self._bodies = bodies = Bodies(user, persons * repeats, policy.step_s, threads)
        super().__init__(policy, bodies.users, seed)
        self._persons = [
            bodies.people.sample(seed + 7919, k) for k in range(persons) for _ in range(repeats)
        ]
        generator = torch.Generator().manual_seed(seed + 93)
        self._seen = policy.perception(self._n, [generator] * self._n)
        self._hands = HumanHands(policy, self._n, self._seen)

    def _who(self) -> NDArray[np.float64]:
        """(N, P) the persons in numbers."""
        bodies: Any = self._bodies
        return self._policy.persons.of(bodies)

    def _reset(self, postures: Sequence[FloatArray] | None, seeds: NDArray[np.int64]) -> None:
        rngs = [np.random.default_rng(int(seed)) for seed in seeds]
        self._users.reset(np.arange(self._n), rngs, postures, self._persons)
        self._hands.forget(np.arange(self._n))

    def _places(self, angles: torch.Tensor, i: int) -> torch.Tensor:
        person = torch.from_numpy(self._who()[[i]]).float()
        return self._policy.forward_model.places(angles, person.expand(len(angles), -1))

    def _usable(self, places: FloatArray) -> NDArray[np.bool_]:
        level = (places[:, 2] > _HEIGHTS_M[0]) & (places[:, 2] < _HEIGHTS_M[1])
        return np.asarray(level & super()._usable(places))

    def _look(self, place: FloatArray) -> None:
        far = torch.from_numpy(np.linalg.norm(self._at(place), axis=1)).float()
        hands = len(self._policy.hands)
        self._seen.forget(torch.arange(self._n), far[:, None].expand(-1, hands))

    def _act(
        self, place: FloatArray, width_m: float, left_s: float
    ) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
        goals = MotorGoals.none(self._n, len(self._policy.hands))
        goals.active[:, 0] = 1.0
        goals.width[:, 0] = width_m
        goals.place[:, 0] = torch.from_numpy(place).float()
        now = self._hands.motion(self._users, self._who())
        actions, over = self._hands.act(now, goals)
        return actions, over[:, 0].numpy() > self._rng.random(self._n)


class _LayersCourse(_Course):
    """Bodies that are all the same, and whose hands shall arrive after a time."""

    _policy: MotorPolicy

    def __init__(
        self, policy: MotorPolicy, user: UserConfig, n: int, threads: int, seed: int
    ) -> None:
        substeps = round(policy.step_s / policy.body.timestep)
        noise = motor_noise(user.noise)
        users = UserBatch(
            policy.body, n, threads=threads, effort="zero", noise=noise, substeps=substeps
        )
        super().__init__(policy, users, seed)

    def _reset(self, postures: Sequence[FloatArray] | None, seeds: NDArray[np.int64]) -> None:
        rngs = [np.random.default_rng(int(seed)) for seed in seeds]
        self._users.reset(np.arange(self._n), rngs, postures)

    def _places(self, angles: torch.Tensor, i: int) -> torch.Tensor:
        return self._policy.places(angles, torch.zeros_like(angles))[0]

    def _act(
        self, place: FloatArray, width_m: float, left_s: float
    ) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
        step_s = self._policy.step_s
        goals = MotorGoals.none(self._n, len(self._policy.hands))
        goals.place[:, 0] = torch.from_numpy(place).float()
        goals.left_s[:, 0] = max(left_s, LEAD_STEPS * step_s)
        goals.active[:, 0] = 1.0
        return self._policy.act(self._users, goals), np.full(self._n, left_s < 1.5 * step_s)


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
