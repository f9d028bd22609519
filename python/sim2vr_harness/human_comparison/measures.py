"""The measures: 64 numbers on a user's behaviour in a condition.

Lengths in m, times in s, angles in degrees. "Tool" is the point that strikes (Whac-A-Mole's hammer:
the middle of its face), "root" the point near the hand whose speed the game tests, depth the tool's
distance behind the plane of the targets.
"""

import math
from dataclasses import dataclass
from enum import Enum
from functools import partial

from sim2vr_harness.client import Measure
from sim2vr_harness.games.behaviour import Behaviour


class MeasureContext(Enum):
    """Rounds in which a measure is defined; a game's description names their kind."""

    ALWAYS = "always"
    ONE_TARGET = "one target at a time"
    MANY_TARGETS = "more targets at a time"
    SPEED_RULE = "touches can be too slow"


@dataclass(frozen=True, kw_only=True)
class BehaviourMeasure(Measure):
    """One number of a user in a condition; the label describes it in a line.

    Attributes:
        family: family of measures.
        where: rounds in which it is measured.
        sample: the single targets, hits or frames that it summarises, if their distribution is
            compared as well.
    """

    family: str
    where: MeasureContext = MeasureContext.ALWAYS
    sample: str | None = None


_reaction = partial(BehaviourMeasure, family="reaction", where=MeasureContext.ONE_TARGET)
_performance = partial(BehaviourMeasure, family="performance")
_timing = partial(BehaviourMeasure, family="timing")
_speed = partial(BehaviourMeasure, family="speed")
_space = partial(BehaviourMeasure, family="space")
_smoothness = partial(BehaviourMeasure, family="smoothness")
_rotation = partial(BehaviourMeasure, family="rotation")
_head = partial(BehaviourMeasure, family="head")
_strategy = partial(BehaviourMeasure, family="strategy")
_fatigue = partial(BehaviourMeasure, family="fatigue")
_aimed = partial(BehaviourMeasure, family="aimed movements")

NEGLIGIBLE = 1e-6
"""Differences below it (m, s, degrees, ...) are rounding errors of recordings, not of people."""


def plain(value: float, *, signed: bool = False) -> str:
    """Return a number with three significant digits, and never in powers of ten."""
    if abs(value) < NEGLIGIBLE:
        return "0"
    decimals = min(6, max(0, 2 - math.floor(math.log10(abs(value)))))
    text = f"{value:{'+' if signed else ''},.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


MEASURES = (
    _performance("hits", "hits per round"),
    _performance("hit_rate", "hits / (hits + misses)"),
    _performance("cell_hit_rates", "hit rate of every cell; inside is the share of cells inside"),
    _performance("worst_cell", "hit rate of the worst cell"),
    _performance(
        "contacts_per_hit", "touches too slow to count, per hit", where=MeasureContext.SPEED_RULE
    ),
    _timing("tth_median", "spawn to hit, median", unit="s", sample="tth"),
    _timing("tth_p5", "spawn to hit, 5 %", unit="s"),
    _timing("tth_p95", "spawn to hit, 95 %", unit="s"),
    _timing("tth_iqr", "spawn to hit, interquartile range", unit="s"),
    _timing("fast_hits", "share of hits within 0.25 s of the spawn"),
    _timing("ihi_median", "hit to next hit, median", unit="s", sample="ihi"),
    _timing("ihi_cv", "hit to next hit, robust coefficient of variation (IQR / 1.349 / median)"),
    _reaction(
        "vm_latency",
        "visuomotor latency: spawn until the target's random place shows in the "
        "tool's velocity in the plane, 10 % of the peak",
        unit="s",
    ),
    _reaction("vm_latency50", "the same at 50 % of the peak", unit="s"),
    _reaction(
        "rt_still",
        "reaction time of targets that found the tool still (under 0.3 m/s for 0.1 s): "
        "spawn until it comes nearer at 0.2 m/s; median, of three or more",
        unit="s",
        sample="rt_still",
    ),
    _reaction("strike_early", "share of hitting strikes that began before 0.1 s after the spawn"),
    _reaction(
        "speed_at_spawn",
        "tool's speed in the 50 ms before a spawn, median",
        unit="m/s",
        sample="speed_at_spawn",
    ),
    _reaction(
        "forward_at_spawn",
        "its velocity along the plane's normal, median; positive: toward the targets",
        unit="m/s",
        sample="forward_at_spawn",
    ),
    _reaction("still_at_spawn", "share of spawns that found it slower than 0.3 m/s"),
    _reaction(
        "strike_onset",
        "spawn to the strike's onset (approach speed last under 20 % of its peak in the "
        "0.3 s before the hit), median",
        unit="s",
        sample="strike_onset",
    ),
    _reaction(
        "strike_time", "onset of the strike to the hit, median", unit="s", sample="strike_time"
    ),
    _reaction(
        "fitts_slope",
        "slope of time to hit over the distance in the plane at the spawn",
        unit="s/m",
    ),
    _speed(
        "hit_speed_game",
        "speed that the game logged with the hit, median; its filter depends on the frame rate",
        unit="m/s",
    ),
    _speed(
        "hit_speed",
        "speed of the tool's root over the 50 ms up to the last frame before the hit, median",
        unit="m/s",
        sample="hit_speed",
    ),
    _speed("hit_speed_p5", "the same, 5 %", unit="m/s"),
    _speed("hit_speed_p95", "the same, 95 %", unit="m/s"),
    _speed(
        "peak_speed",
        "tool's greatest speed within 0.5 s before each hit, median",
        unit="m/s",
        sample="peak_speed",
    ),
    _speed("peak_speed_cv", "its coefficient of variation"),
    _speed("mean_speed", "tool's speed, mean of the round", unit="m/s", sample="speed"),
    _speed("speed_p95", "tool's speed, 95 % of the round", unit="m/s"),
    _speed("slow_share", "share of time slower than 0.3 m/s"),
    _space(
        "depth_median",
        "tool behind the targets' plane, median of the round; negative: in front",
        unit="m",
        sample="depth",
    ),
    _space("depth_p5", "the same, 5 %", unit="m"),
    _space("depth_p95", "the same, 95 %", unit="m"),
    _space(
        "retreat",
        "smallest depth from one hit to the next (0.25 to 3 s), median",
        unit="m",
        sample="retreat",
    ),
    _space(
        "depth_at_spawn",
        "depth at the spawn, median",
        unit="m",
        where=MeasureContext.ONE_TARGET,
        sample="depth_at_spawn",
    ),
    _space(
        "overshoot", "largest depth within 0.2 s after a hit, median", unit="m", sample="overshoot"
    ),
    _space("range_x", "5 to 95 % range across", unit="m"),
    _space("range_y", "5 to 95 % range up and down, in the plane", unit="m"),
    _space("path_per_hit", "path of the tool per hit", unit="m"),
    _space(
        "endpoint_error",
        "distance in the plane to the target's middle where the tool is nearest to it "
        "around the hit, median",
        unit="m",
        sample="endpoint",
    ),
    _space("endpoint_sd", "spread of that, sqrt(var x + var y)", unit="m"),
    _smoothness("peaks_per_hit", "peaks of speed (prominence 0.2 m/s or more) per hit"),
    _smoothness(
        "sparc", "spectral arc length, hit to hit, median; 0 smooth, negative not", sample="sparc"
    ),
    _smoothness(
        "ldlj", "log dimensionless jerk, hit to hit, median; higher is smoother", sample="ldlj"
    ),
    _smoothness("rms_acc", "RMS acceleration of the tool", unit="m/s2"),
    _smoothness("hf_share", "share of the velocity's power above 4 Hz"),
    _rotation("ctrl_rot_p95", "angle of the controller from its mean rotation, 95 %", unit="deg"),
    _rotation("ctrl_rot_speed", "angular speed of the controller, mean", unit="deg/s"),
    _rotation("wrist_ratio", "path of the tool / path of its root: flick of the wrist"),
    _head("head_range", "5 to 95 % range of the head, norm of the axes", unit="m"),
    _head("head_speed", "speed of the head, mean", unit="m/s"),
    _head("head_rot_p95", "angle of the head from its mean rotation, 95 %", unit="deg"),
    _head("head_rot_speed", "angular speed of the head, mean", unit="deg/s"),
    _strategy(
        "oldest_first",
        "of two targets or more the oldest was hit: 0 as by chance, 1 always",
        where=MeasureContext.MANY_TARGETS,
    ),
    _strategy(
        "nearest_first",
        "the same of the nearest to where the tool was at the last hit",
        where=MeasureContext.MANY_TARGETS,
    ),
    _strategy(
        "swings_per_hit",
        "passages of the tool through the plane, away from the player, per hit",
        where=MeasureContext.SPEED_RULE,
    ),
    _strategy(
        "swing_cv",
        "robust coefficient of variation of the time between them",
        where=MeasureContext.SPEED_RULE,
    ),
    _strategy(
        "choices_share",
        "share of hits at which two targets or more were up",
        where=MeasureContext.MANY_TARGETS,
    ),
    _fatigue("d_hit_rate", "hit rate, second half - first half"),
    _fatigue("d_tth", "median time to hit, second half - first half", unit="s"),
    _fatigue("d_mean_speed", "mean speed, second half / first half - 1"),
    _fatigue("d_depth", "median depth, second half - first half", unit="m"),
    _fatigue("d_peak_speed", "median peak speed, second half / first half - 1"),
)
"""In the order of the tables."""

SESSION_MEASURES = (
    _performance("duration", "from the first frame to the last", unit="s"),
    _performance("misses", "misses per round"),
    _timing(
        "first_movement",
        "start until the hand is faster than 0.1 m/s for 0.1 s",
        unit="s",
    ),
    _timing(
        "movement_time",
        "time of a movement, median: faster than 0.1 m/s and than 10 % of the 95 % speed, for "
        "0.1 s or longer",
        unit="s",
        sample="movement_time",
    ),
    _timing("movements_per_min", "such movements per minute", unit="1/min"),
    _speed("top_speed", "speed of the hand, 99 % of the round", unit="m/s"),
    _space("path_per_min", "path of the hand per minute", unit="m/min"),
    _space("other_path_per_min", "path of the other hand per minute", unit="m/min"),
    _space("range_z", "5 to 95 % range forward", unit="m"),
    _space("reach_p95", "distance of the hand from the head, 95 %", unit="m"),
    _smoothness("rms_jerk", "RMS jerk of the hand", unit="m/s3"),
    _smoothness(
        "movement_ldlj", "log dimensionless jerk of a movement, median", sample="movement_ldlj"
    ),
    _rotation(
        "wrist_share",
        "path of the point 0.3 m ahead on the ray / path of the hand: flick of the wrist",
    ),
)
"""Measures of sessions of any app, in addition to those above that need no plane of targets."""

AIMED_MEASURES = (
    _aimed("throughput", "throughput", unit="bits/s"),
    _aimed("aimed_time", "movement time", unit="s"),
    _aimed("fitts_a", "a of MT = a + b ID", unit="s"),
    _aimed("fitts_b", "b", unit="s/bit"),
    _aimed("fitts_r2", "R2"),
    _aimed("fitts_a_effective", "a, effective", unit="s"),
    _aimed("fitts_b_effective", "b, effective", unit="s/bit"),
    _aimed("fitts_r2_effective", "R2, effective"),
    _aimed("endpoint_spread", "endpoint spread along the task axis", unit="mm"),
    _aimed("submovements", "submovements"),
    _aimed("aimed_errors", "errors"),
    _aimed("timeouts", "time-outs"),
)
"""Of games of aimed movements, over all rounds of a person; see ``fitts.py``."""

FAMILIES = tuple(dict.fromkeys(measure.family for measure in (*MEASURES, *AIMED_MEASURES)))


def measured(name: str) -> BehaviourMeasure:
    """Return the measure of that name; KeyError if there is none."""
    return _BY_NAME[name]


def measures_in(behaviour: Behaviour, group: str, condition: str) -> tuple[BehaviourMeasure, ...]:
    """Return the measures that are defined in a game's condition, in the order of the tables."""
    if behaviour.aimed:
        return AIMED_MEASURES
    makes_sense = {
        MeasureContext.ALWAYS: True,
        MeasureContext.ONE_TARGET: condition in behaviour.one_target,
        MeasureContext.MANY_TARGETS: condition not in behaviour.one_target,
        MeasureContext.SPEED_RULE: group in behaviour.speed_rule,
    }
    return tuple(
        measure
        for measure in (*MEASURES, *(SESSION_MEASURES if behaviour.any_app else ()))
        if makes_sense[measure.where] and measure.name not in behaviour.without
    )


EVERY_MEASURE = (*MEASURES, *SESSION_MEASURES, *AIMED_MEASURES)

_BY_NAME = {measure.name: measure for measure in EVERY_MEASURE}
