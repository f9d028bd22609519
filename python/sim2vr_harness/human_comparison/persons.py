"""Measures of a round, and of a person's rounds in a condition.

A measure is a row of ``measures.py`` and a value that a function here returns by its name.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, welch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.fitts import (
    AimedPerson,
    AimedRound,
    aimed_person,
    aimed_round,
)
from sim2vr_harness.human_comparison.grid import (
    PERIOD_S,
    SETTLING_S,
    STILL_MPS,
    Found,
    Track,
    angle_deg,
    at,
)
from sim2vr_harness.human_comparison.measures import measures_in
from sim2vr_harness.human_comparison.reaction import Effect, effect_of, effects, reaction
from sim2vr_harness.human_comparison.rounds import PlayedRound, round_of
from sim2vr_harness.sessions import Session

FloatArray = NDArray[np.float64]
Cell = tuple[str, str]
"""Group and condition."""

_LEAST_STILL = 3
_LEAST_S = 3.0


@dataclass(frozen=True)
class RoundMeasures:
    """Measures of a round.

    Attributes:
        cell: its group and condition.
        person: the player.
        values: measure -> number, if it has one.
        samples: single targets, hits and frames.
        cells: (C, 2) hits and misses of every cell.
        effect: data from which the visuomotor latency is estimated; None if it is not measured.
        aimed: the movements of a round of aimed movements, in which nothing else is measured.
    """

    cell: Cell
    person: str
    values: Mapping[str, float]
    samples: Mapping[str, FloatArray]
    cells: FloatArray
    effect: Effect | None
    aimed: AimedRound | None = None


@dataclass(frozen=True)
class RecordedPerson:
    """Measures of one person in a condition: the mean over its rounds.

    Attributes:
        values: measure -> number, if it has one.
        samples: of all its rounds together.
        cell_rates: (C,) hit rate of every cell, NaN if no target appeared there.
        effect: of all its targets; None if it is not measured.
        rounds: number of rounds.
        further: numbers that are no measures of the game, such as misses.
        aimed: of all its aimed movements; None in other games.
    """

    name: str
    values: Mapping[str, float]
    samples: Mapping[str, FloatArray]
    cell_rates: FloatArray
    effect: Effect | None
    rounds: int
    further: Mapping[str, float] = field(default_factory=dict)
    aimed: AimedPerson | None = None


def measure_session(session: Session, behaviour: Behaviour, person: str) -> RoundMeasures | None:
    """Measure a session; None of a condition that is not compared.

    Raises:
        InputError: It is no round of the game, or too short.
    """
    if behaviour.aimed:
        cell = next(iter(behaviour.groups)), next(iter(behaviour.conditions))
        nothing = np.zeros((len(behaviour.places_m), 2))
        return RoundMeasures(cell, person, {}, {}, nothing, None, aimed_round(session))
    played = round_of(session, behaviour, person)
    return None if played is None else measure_round(played, behaviour)


def measure_round(played: PlayedRound, behaviour: Behaviour) -> RoundMeasures:
    """Measure a round.

    Raises:
        InputError: It is too short.
    """
    lasting = float(played.times_s[-1] - played.times_s[0]) if len(played.times_s) else 0.0
    if lasting < SETTLING_S + _LEAST_S:
        expected = f"at least {SETTLING_S + _LEAST_S:g} s of play"
        raise InputError(file_name(played.source), f"{lasting:.3g} s", expected)
    track = Track(played)
    found = [
        counts(track),
        timing(track),
        choices(track, behaviour.alive_after_s),
        speeds(track),
        space(track),
        smoothness(track),
        swings(track),
        rotations(track),
        head(track),
        hit_speeds(track),
        peaks(track),
        endpoints(track),
        between_hits(track),
    ]
    if behaviour.any_app:
        found.append(hands(track))
    effect = None
    if played.condition in behaviour.one_target:
        own, effect = reaction(track)
        found.append(own)
    targets, cells = played.targets, len(behaviour.places_m)
    counted = [
        np.bincount(targets.cell[part], minlength=cells) for part in (targets.hit, targets.missed)
    ]
    return RoundMeasures(
        cell=(played.group, played.condition),
        person=played.person,
        values={
            key: float(value)
            for values, _ in found
            for key, value in values.items()
            if math.isfinite(value)
        },
        samples={key: sample for _, samples in found for key, sample in samples.items()},
        cells=np.stack(counted, axis=1).astype(np.float64),
        effect=effect,
    )


def persons_of(
    rounds: Iterable[RoundMeasures], behaviour: Behaviour
) -> dict[Cell, tuple[RecordedPerson, ...]]:
    """Group rounds by condition and person; persons by name."""
    sorted_: dict[Cell, dict[str, list[RoundMeasures]]] = {}
    for each in rounds:
        sorted_.setdefault(each.cell, {}).setdefault(each.person, []).append(each)
    return {
        cell: tuple(_person(name, own, behaviour) for name, own in sorted(people.items()))
        for cell, people in sorted_.items()
    }


def _person(name: str, rounds: Sequence[RoundMeasures], behaviour: Behaviour) -> RecordedPerson:
    keys = dict.fromkeys(key for each in rounds for key in each.values)
    values = {
        key: float(np.mean([each.values[key] for each in rounds if key in each.values]))
        for key in keys
    }
    names = dict.fromkeys(key for each in rounds for key in each.samples)
    samples = {
        key: np.concatenate([each.samples[key] for each in rounds if key in each.samples])
        for key in names
    }
    parts = [each.effect for each in rounds if each.effect is not None]
    values |= effects(parts)
    if len(samples.get("rt_still", ())) >= _LEAST_STILL:
        values["rt_still"] = float(np.median(samples["rt_still"]))
    counts = np.sum([each.cells for each in rounds], axis=0)
    total = counts.sum(axis=1)
    rates = np.where(total > 0, counts[:, 0] / np.where(total > 0, total, 1.0), np.nan)
    if np.isfinite(rates).any():
        values["cell_hit_rates"] = float(np.nanmean(rates))
        values["worst_cell"] = float(np.nanmin(rates))
    movements = [each.aimed for each in rounds if each.aimed is not None]
    aimed = aimed_person(movements, name) if movements else None
    if aimed is not None:
        values |= aimed.values()
    chosen = {measure.name for measure in measures_in(behaviour, *rounds[0].cell)}
    return RecordedPerson(
        name=name,
        values={key: value for key, value in values.items() if key in chosen},
        samples=samples,
        cell_rates=rates,
        effect=effect_of(parts) if parts else None,
        rounds=len(rounds),
        further={key: values[key] for key in ("misses",) if key in values},
        aimed=aimed,
    )


# --- events, and the choice among targets ---------------------------------------------------------

_FAST_S = 0.25
_IQR_OF_NORMAL = 1.349


def robust_cv(values: FloatArray) -> float:
    """Interquartile range / 1.349 / median: the coefficient of variation of a normal sample."""
    if len(values) == 0:
        return math.nan
    low, middle, high = np.percentile(values, [25, 50, 75])
    return float((high - low) / _IQR_OF_NORMAL / middle)


def counts(track: Track) -> Found:
    """Hits, misses and contacts of the whole round."""
    played, targets = track.played, track.played.targets
    hits, misses = int(targets.hit.sum()), int(targets.missed.sum())
    first = targets.spawn_s < track.middle_s
    late = targets.spawn_s >= track.first_s
    rates = [
        _rate(int(targets.hit[part].sum()), int(targets.missed[part].sum()))
        for part in (first & late, ~first & late)
    ]
    return {
        "hits": float(hits),
        "misses": float(misses),
        "hit_rate": _rate(hits, misses),
        "contacts_per_hit": played.contacts / max(hits, 1),
        "d_hit_rate": rates[1] - rates[0],
    }, {}


def _rate(hits: int, misses: int) -> float:
    return hits / (hits + misses) if hits + misses else math.nan


def timing(track: Track) -> Found:
    """From spawns to hits, and from hit to hit."""
    targets, rows = track.played.targets, track.late_hits
    tth = targets.end_s[rows] - targets.spawn_s[rows]
    ihi = np.diff(targets.end_s[track.hits_after_settling])
    samples = {"tth": tth, "ihi": ihi}
    if len(tth) == 0:
        return {}, samples
    p5, p25, p50, p75, p95 = np.percentile(tth, [5, 25, 50, 75, 95])
    late = targets.spawn_s[rows] >= track.middle_s
    values = {
        "tth_median": p50,
        "tth_p5": p5,
        "tth_p95": p95,
        "tth_iqr": p75 - p25,
        "fast_hits": np.mean(tth <= _FAST_S),
        "d_tth": np.median(tth[late]) - np.median(tth[~late])
        if 0 < late.sum() < len(tth)
        else None,
        "ihi_median": np.median(ihi) if len(ihi) else None,
        "ihi_cv": robust_cv(ihi),
    }
    return {key: float(value) for key, value in values.items() if value is not None}, samples


def choices(track: Track, alive_after_s: float) -> Found:
    """Measure which target is selected while two or more are visible.

    The candidates have been visible for ``alive_after_s`` and are still visible at the time of the
    hit. The nearest is the one nearest to the tool's position at the hit before.

    Args:
        track: The round.
        alive_after_s: After this long a target can be hit.
    """
    played, targets = track.played, track.played.targets
    rows, rest = track.hits_after_settling, []
    places = at(played.times_s, played.tool_m[:, :2], targets.end_s[rows])
    for before, row in enumerate(rows[1:]):
        hit_s = targets.end_s[row]
        up = targets.spawn_s <= hit_s - alive_after_s
        up &= ~(targets.end_s < hit_s)  # NaN: still there when the round ends
        if up.sum() < 2 or not up[row]:
            continue
        far = np.linalg.norm(targets.place_m - places[before], axis=1)
        oldest = targets.spawn_s[row] <= targets.spawn_s[up].min()
        nearest = far[row] <= far[up].min()
        rest.append((oldest, nearest, 1.0 / up.sum()))
    hits = int(targets.hit.sum())
    values = {"choices_share": len(rest) / hits} if hits else {}
    if rest:
        oldest_share, nearest_share, chance = np.mean(np.array(rest, dtype=np.float64), axis=0)
        values["oldest_first"] = float((oldest_share - chance) / (1.0 - chance))
        values["nearest_first"] = float((nearest_share - chance) / (1.0 - chance))
    return values, {}


# --- movement of the tool, the hand and the head --------------------------------------------------

_PROMINENCE_MPS = 0.2
_FAST_SHAKING_HZ = 4.0
_MOVING_MPS, _MOVING_PART, _MOVING_STEPS = 0.1, 0.1, 2
"""A movement is faster, also than this part of the 95 % speed, for that many steps."""
_SEGMENT = 128
"""Velocities in a segment of the power spectrum (Welch), 6.4 s."""


def speeds(track: Track) -> Found:
    """Measure the speed of the tool."""
    speed = track.speed_mps
    late = track.between_s >= track.middle_s
    return {
        "mean_speed": float(speed.mean()),
        "speed_p95": float(np.percentile(speed, 95)),
        "slow_share": float(np.mean(speed < STILL_MPS)),
        "d_mean_speed": float(speed[late].mean() / speed[~late].mean() - 1.0),
    }, {"speed": speed}


def space(track: Track) -> Found:
    """Measure the positions of the tool and the length of its path."""
    tool = track.tool_m
    depth = tool[:, 2]
    p5, p50, p95 = np.percentile(depth, [5, 50, 95])
    low, high = np.percentile(tool[:, :2], [5, 95], axis=0)
    late = track.times_s >= track.middle_s
    path = track.speed_mps.sum() * PERIOD_S
    root = np.linalg.norm(np.diff(track.root_m(), axis=0), axis=1).sum()
    hits = len(track.hits_after_settling)
    return {
        "depth_median": float(p50),
        "depth_p5": float(p5),
        "depth_p95": float(p95),
        "d_depth": float(np.median(depth[late]) - np.median(depth[~late])),
        "range_x": float(high[0] - low[0]),
        "range_y": float(high[1] - low[1]),
        "path_per_hit": float(path / hits) if hits else math.nan,
        "wrist_ratio": float(path / root) if root > 0.0 else math.nan,
    }, {"depth": depth}


def smoothness(track: Track) -> Found:
    """Peaks, acceleration and fast shaking of the whole round; hit to hit see strikes."""
    velocity = track.velocity_mps
    acceleration = np.diff(velocity, axis=0) / PERIOD_S
    rate, power = welch(velocity, 1.0 / PERIOD_S, nperseg=min(_SEGMENT, len(velocity)), axis=0)
    power = power.sum(axis=1)
    hits = len(track.hits_after_settling)
    peaks = len(find_peaks(track.speed_mps, prominence=_PROMINENCE_MPS)[0])
    return {
        "peaks_per_hit": peaks / hits if hits else math.nan,
        "rms_acc": float(np.sqrt(np.mean(np.sum(acceleration**2, axis=1)))),
        "hf_share": float(power[rate > _FAST_SHAKING_HZ].sum() / power.sum())
        if power.sum() > 0.0
        else math.nan,
    }, {}


def swings(track: Track) -> Found:
    """Measure passages of the tool through the plane, away from the player."""
    depth, hits = track.tool_m[:, 2], len(track.hits_after_settling)
    through = np.flatnonzero((depth[:-1] < 0.0) & (depth[1:] >= 0.0))
    part = -depth[through] / (depth[through + 1] - depth[through])
    apart = np.diff(track.times_s[through] + part * PERIOD_S)
    return {
        "swings_per_hit": len(through) / hits if hits else math.nan,
        "swing_cv": robust_cv(apart),
    }, {}


def rotations(track: Track) -> Found:
    """Measure the rotation of the controller."""
    return _turning(track.turns(track.played.controller), "ctrl_rot"), {}


def head(track: Track) -> Found:
    """Measure the movement and the rotation of the head."""
    places = track.head_m()
    low, high = np.percentile(places, [5, 95], axis=0)
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return {
        "head_range": float(np.linalg.norm(high - low)),
        "head_speed": float(moved.mean() / PERIOD_S),
        **_turning(track.turns(track.played.head[:, 3:]), "head_rot"),
    }, {}


def hands(track: Track) -> Found:
    """Measure the hands of a session, without a description of its app."""
    played, velocity = track.played, track.velocity_mps
    minutes = len(velocity) * PERIOD_S / 60.0
    jerk = np.diff(velocity, 2, axis=0) / PERIOD_S**2
    low, high = np.percentile(track.tool_m[:, 2], [5, 95])
    away = np.linalg.norm(played.tool_m - (played.head[:, :3] - played.head[0, :3]), axis=1)
    fast_mps = max(_MOVING_MPS, _MOVING_PART * float(np.percentile(track.speed_mps, 95)))
    movements = _movements(track.speed_mps, fast_mps)
    times = np.array([PERIOD_S * (end - start) for start, end in movements])
    jerks = np.array([log_jerk(velocity[start:end]) for start, end in movements])
    values = {
        "duration": float(played.times_s[-1] - played.times_s[0]),
        "first_movement": _first_movement(played.times_s, played.tool_m),
        "movements_per_min": len(movements) / minutes,
        "top_speed": float(np.percentile(track.speed_mps, 99)),
        "path_per_min": float(track.speed_mps.sum() * PERIOD_S / minutes),
        "range_z": float(high - low),
        "reach_p95": float(np.percentile(away, 95)),
        "rms_jerk": float(np.sqrt(np.mean(np.sum(jerk**2, axis=1)))),
    }
    samples = {"movement_time": times, "movement_ldlj": jerks[np.isfinite(jerks)]}
    values |= {name: float(np.median(sample)) for name, sample in samples.items() if len(sample)}
    hand = track.speed_mps.sum() * PERIOD_S
    for name, points, unit in (
        ("wrist_share", played.ahead_m, hand),
        ("other_path_per_min", played.other_m, minutes),
    ):
        if points is not None and unit > 0.0:
            values[name] = float(_path_m(at(played.times_s, points, track.times_s)) / unit)
    return values, samples


def _path_m(points: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _movements(speed: FloatArray, fast_mps: float = _MOVING_MPS) -> list[tuple[int, int]]:
    """Return ranges of steps in which the hand is fast for long enough."""
    fast = np.concatenate([[False], speed > fast_mps, [False]])
    edges = np.flatnonzero(fast[1:] != fast[:-1]).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges if b - a >= _MOVING_STEPS]


def _first_movement(times_s: FloatArray, places: FloatArray) -> float:
    """Time of the first movement of the whole round; NaN: there is none."""
    grid = np.arange(times_s[0], times_s[-1], PERIOD_S)
    speed = np.linalg.norm(np.diff(at(times_s, places, grid), axis=0), axis=1) / PERIOD_S
    movements = _movements(speed)
    return movements[0][0] * PERIOD_S if movements else math.nan


def _turning(turns: FloatArray, name: str) -> dict[str, float]:
    """Angle from the mean rotation (95 %), degrees, and mean angular speed, degrees/s."""
    # The mean of unit quaternions whatever their signs: the first axis of their scatter.
    mean = np.linalg.eigh(turns.T @ turns)[1][:, -1]
    steps = angle_deg(turns[1:], turns[:-1])
    return {
        f"{name}_p95": float(np.percentile(angle_deg(turns, mean), 95)),
        f"{name}_speed": float(steps.mean() / PERIOD_S),
    }


# --- movement around every hit and between hits ---------------------------------------------------

_BEFORE_S = 0.5
_AFTER_S = 0.2
_SHORTEST_S, _LONGEST_S = 0.25, 3.0
"""From hit to hit, where the movement between is one: longer ones are pauses."""
_CLOSE_S = 0.1
_SAME_S = 1e-4
_PADDING = 4
_TOP_HZ, _LEAST_POWER = 10.0, 0.05


def hit_speeds(track: Track) -> Found:
    """Speed of the point that the game tests, over the 50 ms up to the last frame before the hit.

    A hit at the time of a frame belongs to the frame before, as its pose was tested. Frames at
    other rates than 20 Hz get the mean delay that frames at 20 Hz would have had, half the
    difference of the periods.
    """
    played, targets, rows = track.played, track.played.targets, track.late_hits
    logged = targets.logged_speed_mps[rows]
    logged = logged[np.isfinite(logged)]
    values: dict[str, float] = {}
    if len(logged):
        values["hit_speed_game"] = float(np.median(logged))
    if len(rows) == 0:
        return values, {"hit_speed": np.zeros(0)}
    times = played.times_s
    delay_s = max(0.0, (PERIOD_S - float(np.median(np.diff(times)))) / 2.0)
    last = np.searchsorted(times, targets.end_s[rows] - _SAME_S) - 1
    end_s = times[last.clip(0)] + delay_s
    moved = at(times, played.root_m, end_s) - at(times, played.root_m, end_s - PERIOD_S)
    speed = np.linalg.norm(moved, axis=1) / PERIOD_S
    for key, part in (("hit_speed", 50), ("hit_speed_p5", 5), ("hit_speed_p95", 95)):
        values[key] = float(np.percentile(speed, part))
    return values, {"hit_speed": speed}


def peaks(track: Track) -> Found:
    """Greatest speed before each hit, and how far the tool swings through after it."""
    targets, rows = track.played.targets, track.late_hits
    peak, peak_late, over = [], [], []
    for row in rows:
        hit_s = targets.end_s[row]
        speed = track.speed_mps[_within(track.between_s, hit_s - _BEFORE_S, hit_s)]
        depth = track.tool_m[_within(track.times_s, hit_s, hit_s + _AFTER_S), 2]
        if len(speed):
            peak.append(speed.max())
            peak_late.append(targets.spawn_s[row] >= track.middle_s)
        if len(depth):
            over.append(depth.max())
    top, late = np.array(peak), np.array(peak_late, dtype=np.bool_)
    values: dict[str, float] = {}
    if len(top):
        values["peak_speed"] = float(np.median(top))
        values["peak_speed_cv"] = float(top.std() / top.mean())
    if 0 < late.sum() < len(top):
        values["d_peak_speed"] = float(np.median(top[late]) / np.median(top[~late]) - 1.0)
    if over:
        values["overshoot"] = float(np.median(over))
    return values, {"peak_speed": top, "overshoot": np.array(over)}


def endpoints(track: Track) -> Found:
    """Measure the tool's position in the plane nearest to the target's middle, around each hit.

    It is the nearest point of the straight lines between the positions of the grid, within 0.1 s.
    """
    targets, rows, times = track.played.targets, track.late_hits, track.times_s
    off = []
    for row in rows:
        hit_s, middle = targets.end_s[row], np.append(targets.place_m[row], 0.0)
        low, high = max(hit_s - _CLOSE_S, times[0]), min(hit_s + _CLOSE_S, times[-1])
        inner = times[_within(times, low, high)]
        knots = at(times, track.tool_m, np.concatenate([[low], inner, [high]])) - middle
        off.append(_nearest(knots)[:2])
    if not off:
        return {}, {"endpoint": np.zeros(0)}
    apart = np.array(off)
    error = np.linalg.norm(apart, axis=1)
    return {
        "endpoint_error": float(np.median(error)),
        "endpoint_sd": float(np.sqrt(apart.var(axis=0).sum())),
    }, {"endpoint": error}


def _nearest(knots: FloatArray) -> FloatArray:
    """Return the point nearest to the origin on the straight lines between points (K, 3)."""
    start, step = knots[:-1], np.diff(knots, axis=0)
    length = np.sum(step**2, axis=1)
    part = -np.sum(start * step, axis=1) / np.where(length > 0.0, length, 1.0)
    points = start + part.clip(0.0, 1.0)[:, None] * step
    return np.asarray(points[np.argmin(np.sum(points**2, axis=1))])


def between_hits(track: Track) -> Found:
    """Retreat and smoothness from one hit to the next."""
    end_s = track.played.targets.end_s[track.hits_after_settling]
    retreat, arcs, jerks = [], [], []
    for before_s, hit_s in pairwise(end_s):
        if not _SHORTEST_S <= hit_s - before_s <= _LONGEST_S:
            continue
        retreat.append(track.tool_m[_within(track.times_s, before_s, hit_s, closed=True), 2].min())
        moving = _within(track.between_s, before_s, hit_s, closed=True)
        arcs.append(sparc(track.speed_mps[moving]))
        jerks.append(log_jerk(track.velocity_mps[moving]))
    samples = {"retreat": np.array(retreat), "sparc": np.array(arcs), "ldlj": np.array(jerks)}
    samples = {key: sample[np.isfinite(sample)] for key, sample in samples.items()}
    return {key: float(np.median(s)) for key, s in samples.items() if len(s)}, samples


def sparc(speed: FloatArray) -> float:
    """Spectral arc length of a movement: 0 smooth, more negative less.

    Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9: the length of the normalised
    spectrum of speed up to 10 Hz, as far as it is above 5 % of its greatest value.

    Args:
        speed: (N,) on the grid, m/s.
    """
    if len(speed) < 2 or not speed.any():
        return math.nan
    n = int(2 ** (math.ceil(math.log2(len(speed))) + _PADDING))
    rate = np.arange(n) / (n * PERIOD_S)
    size = np.abs(np.fft.fft(speed, n))
    size = size / size.max()
    low = rate <= _TOP_HZ
    rate, size = rate[low], size[low]
    above = np.flatnonzero(size >= _LEAST_POWER)
    rate, size = rate[above[0] : above[-1] + 1], size[above[0] : above[-1] + 1]
    if len(rate) < 2:
        return math.nan
    steps = np.hypot(np.diff(rate) / (rate[-1] - rate[0]), np.diff(size))
    return -float(steps.sum())


def log_jerk(velocity: FloatArray) -> float:
    """Log dimensionless jerk of a movement's velocity (N, 3); higher is smoother."""
    if len(velocity) < 4:
        return math.nan
    jerk = np.diff(velocity, 2, axis=0) / PERIOD_S**2
    lasting = (len(velocity) - 1) * PERIOD_S
    peak = float(np.linalg.norm(velocity, axis=1).max())
    total = float((jerk**2).sum() * PERIOD_S)
    if peak <= 0.0 or total <= 0.0:
        return math.nan
    return -math.log(lasting**3 / peak**2 * total)


def _within(times: FloatArray, low: float, high: float, *, closed: bool = True) -> slice:
    """Return the part of ascending times in [low, high]."""
    first = int(np.searchsorted(times, low, side="left"))
    return slice(first, int(np.searchsorted(times, high, side="right" if closed else "left")))
