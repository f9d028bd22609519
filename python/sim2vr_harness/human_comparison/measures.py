"""The measures: 64 numbers of what a user does in a condition.

Lengths in m, times in s, angles in degrees. "Tool" is what strikes (Whac-A-Mole's hammer: the
middle of its face), "root" the point near the hand whose speed the game tests, depth the tool's
distance behind the plane of the targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from sim2vr_harness.client import Measure
from sim2vr_harness.games.behaviour import Behaviour

__all__ = ["FAMILIES", "MEASURES", "BehaviourMeasure", "MeasureContext", "measured", "measures_in"]


class MeasureContext(Enum):
    """Where a measure makes sense; a game's description says which rounds those are."""

    ALWAYS = "always"
    ONE_TARGET = "one target at a time"
    MANY_TARGETS = "more targets at a time"
    SPEED_RULE = "touches can be too slow"


@dataclass(frozen=True, kw_only=True)
class BehaviourMeasure(Measure):
    """One number of a user in a condition; the label says in a line what it is.

    Attributes:
        family: what it belongs to.
        where: rounds in which it is measured.
        sample: the single targets, hits or frames that it is of, where their distribution is
            compared as well.
    """

    family: str
    where: MeasureContext = MeasureContext.ALWAYS
    sample: str | None = None


MEASURES = (
    BehaviourMeasure("hits", "hits per round", family="performance"),
    BehaviourMeasure("hit_rate", "hits / (hits + misses)", family="performance"),
    BehaviourMeasure(
        "cell_hit_rates",
        "hit rate of every cell; inside is the share of cells inside",
        family="performance",
    ),
    BehaviourMeasure("worst_cell", "hit rate of the worst cell", family="performance"),
    BehaviourMeasure(
        "contacts_per_hit",
        "touches too slow to count, per hit",
        family="performance",
        where=MeasureContext.SPEED_RULE,
    ),
    BehaviourMeasure("tth_median", "spawn to hit, median", family="timing", unit="s", sample="tth"),
    BehaviourMeasure("tth_p5", "spawn to hit, 5 %", family="timing", unit="s"),
    BehaviourMeasure("tth_p95", "spawn to hit, 95 %", family="timing", unit="s"),
    BehaviourMeasure("tth_iqr", "spawn to hit, interquartile range", family="timing", unit="s"),
    BehaviourMeasure("fast_hits", "share of hits within 0.25 s of the spawn", family="timing"),
    BehaviourMeasure(
        "ihi_median", "hit to next hit, median", family="timing", unit="s", sample="ihi"
    ),
    BehaviourMeasure(
        "ihi_cv",
        "hit to next hit, robust coefficient of variation (IQR / 1.349 / median)",
        family="timing",
    ),
    BehaviourMeasure(
        "vm_latency",
        "visuomotor latency: spawn until the target's random place shows in the "
        "tool's velocity in the plane, 10 % of the peak",
        family="reaction",
        unit="s",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "vm_latency50",
        "the same at 50 % of the peak",
        family="reaction",
        unit="s",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "rt_still",
        "reaction time of targets that found the tool still (under 0.3 m/s for 0.1 s): "
        "spawn until it comes nearer at 0.2 m/s; median, of three or more",
        family="reaction",
        unit="s",
        where=MeasureContext.ONE_TARGET,
        sample="rt_still",
    ),
    BehaviourMeasure(
        "strike_early",
        "share of hitting strikes that began before 0.1 s after the spawn",
        family="reaction",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "speed_at_spawn",
        "tool's speed in the 50 ms before a spawn, median",
        family="reaction",
        unit="m/s",
        where=MeasureContext.ONE_TARGET,
        sample="speed_at_spawn",
    ),
    BehaviourMeasure(
        "forward_at_spawn",
        "its velocity along the plane's normal, median; positive: toward the targets",
        family="reaction",
        unit="m/s",
        where=MeasureContext.ONE_TARGET,
        sample="forward_at_spawn",
    ),
    BehaviourMeasure(
        "still_at_spawn",
        "share of spawns that found it slower than 0.3 m/s",
        family="reaction",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "strike_onset",
        "spawn to the strike's onset (approach speed last under 20 % of its peak in the "
        "0.3 s before the hit), median",
        family="reaction",
        unit="s",
        where=MeasureContext.ONE_TARGET,
        sample="strike_onset",
    ),
    BehaviourMeasure(
        "strike_time",
        "onset of the strike to the hit, median",
        family="reaction",
        unit="s",
        where=MeasureContext.ONE_TARGET,
        sample="strike_time",
    ),
    BehaviourMeasure(
        "fitts_slope",
        "slope of time to hit over the distance in the plane at the spawn",
        family="reaction",
        unit="s/m",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "hit_speed_game",
        "speed that the game logged with the hit, median; its filter depends on the frame rate",
        family="speed",
        unit="m/s",
    ),
    BehaviourMeasure(
        "hit_speed",
        "speed of the tool's root over the 50 ms up to the last frame before the hit, median",
        family="speed",
        unit="m/s",
        sample="hit_speed",
    ),
    BehaviourMeasure("hit_speed_p5", "the same, 5 %", family="speed", unit="m/s"),
    BehaviourMeasure("hit_speed_p95", "the same, 95 %", family="speed", unit="m/s"),
    BehaviourMeasure(
        "peak_speed",
        "tool's greatest speed within 0.5 s before each hit, median",
        family="speed",
        unit="m/s",
        sample="peak_speed",
    ),
    BehaviourMeasure("peak_speed_cv", "its coefficient of variation", family="speed"),
    BehaviourMeasure(
        "mean_speed", "tool's speed, mean of the round", family="speed", unit="m/s", sample="speed"
    ),
    BehaviourMeasure("speed_p95", "tool's speed, 95 % of the round", family="speed", unit="m/s"),
    BehaviourMeasure("slow_share", "share of time slower than 0.3 m/s", family="speed"),
    BehaviourMeasure(
        "depth_median",
        "tool behind the targets' plane, median of the round; negative: in front",
        family="space",
        unit="m",
        sample="depth",
    ),
    BehaviourMeasure("depth_p5", "the same, 5 %", family="space", unit="m"),
    BehaviourMeasure("depth_p95", "the same, 95 %", family="space", unit="m"),
    BehaviourMeasure(
        "retreat",
        "smallest depth from one hit to the next (0.25 to 3 s), median",
        family="space",
        unit="m",
        sample="retreat",
    ),
    BehaviourMeasure(
        "depth_at_spawn",
        "depth at the spawn, median",
        family="space",
        unit="m",
        where=MeasureContext.ONE_TARGET,
        sample="depth_at_spawn",
    ),
    BehaviourMeasure(
        "overshoot",
        "largest depth within 0.2 s after a hit, median",
        family="space",
        unit="m",
        sample="overshoot",
    ),
    BehaviourMeasure("range_x", "5 to 95 % range across", family="space", unit="m"),
    BehaviourMeasure(
        "range_y", "5 to 95 % range up and down, in the plane", family="space", unit="m"
    ),
    BehaviourMeasure("path_per_hit", "path of the tool per hit", family="space", unit="m"),
    BehaviourMeasure(
        "endpoint_error",
        "distance in the plane to the target's middle where the tool is nearest to it "
        "around the hit, median",
        family="space",
        unit="m",
        sample="endpoint",
    ),
    BehaviourMeasure(
        "endpoint_sd", "spread of that, sqrt(var x + var y)", family="space", unit="m"
    ),
    BehaviourMeasure(
        "peaks_per_hit", "peaks of speed (prominence 0.2 m/s or more) per hit", family="smoothness"
    ),
    BehaviourMeasure(
        "sparc",
        "spectral arc length, hit to hit, median; 0 smooth, negative not",
        family="smoothness",
        sample="sparc",
    ),
    BehaviourMeasure(
        "ldlj",
        "log dimensionless jerk, hit to hit, median; higher is smoother",
        family="smoothness",
        sample="ldlj",
    ),
    BehaviourMeasure("rms_acc", "RMS acceleration of the tool", family="smoothness", unit="m/s2"),
    BehaviourMeasure("hf_share", "share of the velocity's power above 4 Hz", family="smoothness"),
    BehaviourMeasure(
        "ctrl_rot_p95",
        "angle of the controller from its mean rotation, 95 %",
        family="rotation",
        unit="deg",
    ),
    BehaviourMeasure(
        "ctrl_rot_speed", "angular speed of the controller, mean", family="rotation", unit="deg/s"
    ),
    BehaviourMeasure(
        "wrist_ratio", "path of the tool / path of its root: flick of the wrist", family="rotation"
    ),
    BehaviourMeasure(
        "head_range", "5 to 95 % range of the head, norm of the axes", family="head", unit="m"
    ),
    BehaviourMeasure("head_speed", "speed of the head, mean", family="head", unit="m/s"),
    BehaviourMeasure(
        "head_rot_p95", "angle of the head from its mean rotation, 95 %", family="head", unit="deg"
    ),
    BehaviourMeasure(
        "head_rot_speed", "angular speed of the head, mean", family="head", unit="deg/s"
    ),
    BehaviourMeasure(
        "oldest_first",
        "of two targets or more the oldest was hit: 0 as by chance, 1 always",
        family="strategy",
        where=MeasureContext.MANY_TARGETS,
    ),
    BehaviourMeasure(
        "nearest_first",
        "the same of the nearest to where the tool was at the last hit",
        family="strategy",
        where=MeasureContext.MANY_TARGETS,
    ),
    BehaviourMeasure(
        "swings_per_hit",
        "passages of the tool through the plane, away from the player, per hit",
        family="strategy",
        where=MeasureContext.SPEED_RULE,
    ),
    BehaviourMeasure(
        "swing_cv",
        "robust coefficient of variation of the time between them",
        family="strategy",
        where=MeasureContext.SPEED_RULE,
    ),
    BehaviourMeasure(
        "choices_share",
        "share of hits at which two targets or more were up",
        family="strategy",
        where=MeasureContext.MANY_TARGETS,
    ),
    BehaviourMeasure("d_hit_rate", "hit rate, second half - first half", family="fatigue"),
    BehaviourMeasure(
        "d_tth", "median time to hit, second half - first half", family="fatigue", unit="s"
    ),
    BehaviourMeasure("d_mean_speed", "mean speed, second half / first half - 1", family="fatigue"),
    BehaviourMeasure(
        "d_depth", "median depth, second half - first half", family="fatigue", unit="m"
    ),
    BehaviourMeasure(
        "d_peak_speed", "median peak speed, second half / first half - 1", family="fatigue"
    ),
)
"""In the order of the tables."""

FAMILIES = tuple(dict.fromkeys(measure.family for measure in MEASURES))


def measured(name: str) -> BehaviourMeasure:
    """The measure of that name; KeyError if there is none."""
    return _BY_NAME[name]


def measures_in(behaviour: Behaviour, group: str, condition: str) -> tuple[BehaviourMeasure, ...]:
    """The measures that make sense in a game's condition, in the order of the tables."""
    makes_sense = {
        MeasureContext.ALWAYS: True,
        MeasureContext.ONE_TARGET: condition in behaviour.one_target,
        MeasureContext.MANY_TARGETS: condition not in behaviour.one_target,
        MeasureContext.SPEED_RULE: group in behaviour.speed_rule,
    }
    return tuple(
        measure
        for measure in MEASURES
        if makes_sense[measure.where] and measure.name not in behaviour.without
    )


_BY_NAME = {measure.name: measure for measure in MEASURES}
