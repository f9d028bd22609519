"""The measures: 64 numbers of what a user does in a condition.

Lengths in m, times in s, angles in degrees. "Tool" is what strikes (Whac-A-Mole's hammer: the
middle of its face), "root" the point near the hand whose speed the game tests, depth the tool's
distance behind the plane of the targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from sim2vr_harness.games.behaviour import Behaviour

__all__ = ["FAMILIES", "MEASURES", "BehaviourMeasure", "MeasureContext", "measured", "measures_in"]


class MeasureContext(Enum):
    """Where a measure makes sense; a game's description says which rounds those are."""

    ALWAYS = "always"
    ONE_TARGET = "one target at a time"
    MANY_TARGETS = "more targets at a time"
    SPEED_RULE = "touches can be too slow"


@dataclass(frozen=True)
class BehaviourMeasure:
    """One number of a user in a condition.

    Attributes:
        name: key in results.
        family: what it belongs to.
        meaning: in a line.
        unit: of the number; empty for shares and ratios.
        where: rounds in which it is measured.
        sample: the single targets, hits or frames that it is of, where their distribution is
            compared as well.
    """

    name: str
    family: str
    meaning: str
    unit: str = ""
    where: MeasureContext = MeasureContext.ALWAYS
    sample: str | None = None


MEASURES = (
    BehaviourMeasure("hits", "performance", "hits per round"),
    BehaviourMeasure("hit_rate", "performance", "hits / (hits + misses)"),
    BehaviourMeasure(
        "cell_hit_rates",
        "performance",
        "hit rate of every cell; inside is the share of cells inside",
    ),
    BehaviourMeasure("worst_cell", "performance", "hit rate of the worst cell"),
    BehaviourMeasure(
        "contacts_per_hit",
        "performance",
        "touches too slow to count, per hit",
        where=MeasureContext.SPEED_RULE,
    ),
    BehaviourMeasure("tth_median", "timing", "spawn to hit, median", unit="s", sample="tth"),
    BehaviourMeasure("tth_p5", "timing", "spawn to hit, 5 %", unit="s"),
    BehaviourMeasure("tth_p95", "timing", "spawn to hit, 95 %", unit="s"),
    BehaviourMeasure("tth_iqr", "timing", "spawn to hit, interquartile range", unit="s"),
    BehaviourMeasure("fast_hits", "timing", "share of hits within 0.25 s of the spawn"),
    BehaviourMeasure("ihi_median", "timing", "hit to next hit, median", unit="s", sample="ihi"),
    BehaviourMeasure(
        "ihi_cv",
        "timing",
        "hit to next hit, robust coefficient of variation (IQR / 1.349 / median)",
    ),
    BehaviourMeasure(
        "vm_latency",
        "reaction",
        "visuomotor latency: spawn until the target's random place shows in the "
        "tool's velocity in the plane, 10 % of the peak",
        unit="s",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "vm_latency50",
        "reaction",
        "the same at 50 % of the peak",
        unit="s",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "rt_still",
        "reaction",
        "reaction time of targets that found the tool still (under 0.3 m/s for 0.1 s): "
        "spawn until it comes nearer at 0.2 m/s; median, of three or more",
        unit="s",
        where=MeasureContext.ONE_TARGET,
        sample="rt_still",
    ),
    BehaviourMeasure(
        "strike_early",
        "reaction",
        "share of hitting strikes that began before 0.1 s after the spawn",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "speed_at_spawn",
        "reaction",
        "tool's speed in the 50 ms before a spawn, median",
        unit="m/s",
        where=MeasureContext.ONE_TARGET,
        sample="speed_at_spawn",
    ),
    BehaviourMeasure(
        "forward_at_spawn",
        "reaction",
        "its velocity along the plane's normal, median; positive: toward the targets",
        unit="m/s",
        where=MeasureContext.ONE_TARGET,
        sample="forward_at_spawn",
    ),
    BehaviourMeasure(
        "still_at_spawn",
        "reaction",
        "share of spawns that found it slower than 0.3 m/s",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "strike_onset",
        "reaction",
        "spawn to the strike's onset (approach speed last under 20 % of its peak in the "
        "0.3 s before the hit), median",
        unit="s",
        where=MeasureContext.ONE_TARGET,
        sample="strike_onset",
    ),
    BehaviourMeasure(
        "strike_time",
        "reaction",
        "onset of the strike to the hit, median",
        unit="s",
        where=MeasureContext.ONE_TARGET,
        sample="strike_time",
    ),
    BehaviourMeasure(
        "fitts_slope",
        "reaction",
        "slope of time to hit over the distance in the plane at the spawn",
        unit="s/m",
        where=MeasureContext.ONE_TARGET,
    ),
    BehaviourMeasure(
        "hit_speed_game",
        "speed",
        "speed that the game logged with the hit, median; its filter depends on the frame rate",
        unit="m/s",
    ),
    BehaviourMeasure(
        "hit_speed",
        "speed",
        "speed of the tool's root over the 50 ms up to the last frame before the hit, median",
        unit="m/s",
        sample="hit_speed",
    ),
    BehaviourMeasure("hit_speed_p5", "speed", "the same, 5 %", unit="m/s"),
    BehaviourMeasure("hit_speed_p95", "speed", "the same, 95 %", unit="m/s"),
    BehaviourMeasure(
        "peak_speed",
        "speed",
        "tool's greatest speed within 0.5 s before each hit, median",
        unit="m/s",
        sample="peak_speed",
    ),
    BehaviourMeasure("peak_speed_cv", "speed", "its coefficient of variation"),
    BehaviourMeasure(
        "mean_speed", "speed", "tool's speed, mean of the round", unit="m/s", sample="speed"
    ),
    BehaviourMeasure("speed_p95", "speed", "tool's speed, 95 % of the round", unit="m/s"),
    BehaviourMeasure("slow_share", "speed", "share of time slower than 0.3 m/s"),
    BehaviourMeasure(
        "depth_median",
        "space",
        "tool behind the targets' plane, median of the round; negative: in front",
        unit="m",
        sample="depth",
    ),
    BehaviourMeasure("depth_p5", "space", "the same, 5 %", unit="m"),
    BehaviourMeasure("depth_p95", "space", "the same, 95 %", unit="m"),
    BehaviourMeasure(
        "retreat",
        "space",
        "smallest depth from one hit to the next (0.25 to 3 s), median",
        unit="m",
        sample="retreat",
    ),
    BehaviourMeasure(
        "depth_at_spawn",
        "space",
        "depth at the spawn, median",
        unit="m",
        where=MeasureContext.ONE_TARGET,
        sample="depth_at_spawn",
    ),
    BehaviourMeasure(
        "overshoot",
        "space",
        "largest depth within 0.2 s after a hit, median",
        unit="m",
        sample="overshoot",
    ),
    BehaviourMeasure("range_x", "space", "5 to 95 % range across", unit="m"),
    BehaviourMeasure("range_y", "space", "5 to 95 % range up and down, in the plane", unit="m"),
    BehaviourMeasure("path_per_hit", "space", "path of the tool per hit", unit="m"),
    BehaviourMeasure(
        "endpoint_error",
        "space",
        "distance in the plane to the target's middle where the tool is nearest to it "
        "around the hit, median",
        unit="m",
        sample="endpoint",
    ),
    BehaviourMeasure("endpoint_sd", "space", "spread of that, sqrt(var x + var y)", unit="m"),
    BehaviourMeasure(
        "peaks_per_hit", "smoothness", "peaks of speed (prominence 0.2 m/s or more) per hit"
    ),
    BehaviourMeasure(
        "sparc",
        "smoothness",
        "spectral arc length, hit to hit, median; 0 smooth, negative not",
        sample="sparc",
    ),
    BehaviourMeasure(
        "ldlj",
        "smoothness",
        "log dimensionless jerk, hit to hit, median; higher is smoother",
        sample="ldlj",
    ),
    BehaviourMeasure("rms_acc", "smoothness", "RMS acceleration of the tool", unit="m/s2"),
    BehaviourMeasure("hf_share", "smoothness", "share of the velocity's power above 4 Hz"),
    BehaviourMeasure(
        "ctrl_rot_p95",
        "rotation",
        "angle of the controller from its mean rotation, 95 %",
        unit="deg",
    ),
    BehaviourMeasure(
        "ctrl_rot_speed", "rotation", "angular speed of the controller, mean", unit="deg/s"
    ),
    BehaviourMeasure(
        "wrist_ratio", "rotation", "path of the tool / path of its root: flick of the wrist"
    ),
    BehaviourMeasure(
        "head_range", "head", "5 to 95 % range of the head, norm of the axes", unit="m"
    ),
    BehaviourMeasure("head_speed", "head", "speed of the head, mean", unit="m/s"),
    BehaviourMeasure(
        "head_rot_p95", "head", "angle of the head from its mean rotation, 95 %", unit="deg"
    ),
    BehaviourMeasure("head_rot_speed", "head", "angular speed of the head, mean", unit="deg/s"),
    BehaviourMeasure(
        "oldest_first",
        "strategy",
        "of two targets or more the oldest was hit: 0 as by chance, 1 always",
        where=MeasureContext.MANY_TARGETS,
    ),
    BehaviourMeasure(
        "nearest_first",
        "strategy",
        "the same of the nearest to where the tool was at the last hit",
        where=MeasureContext.MANY_TARGETS,
    ),
    BehaviourMeasure(
        "swings_per_hit",
        "strategy",
        "passages of the tool through the plane, away from the player, per hit",
        where=MeasureContext.SPEED_RULE,
    ),
    BehaviourMeasure(
        "swing_cv",
        "strategy",
        "robust coefficient of variation of the time between them",
        where=MeasureContext.SPEED_RULE,
    ),
    BehaviourMeasure(
        "choices_share",
        "strategy",
        "share of hits at which two targets or more were up",
        where=MeasureContext.MANY_TARGETS,
    ),
    BehaviourMeasure("d_hit_rate", "fatigue", "hit rate, second half - first half"),
    BehaviourMeasure("d_tth", "fatigue", "median time to hit, second half - first half", unit="s"),
    BehaviourMeasure("d_mean_speed", "fatigue", "mean speed, second half / first half - 1"),
    BehaviourMeasure("d_depth", "fatigue", "median depth, second half - first half", unit="m"),
    BehaviourMeasure("d_peak_speed", "fatigue", "median peak speed, second half / first half - 1"),
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
