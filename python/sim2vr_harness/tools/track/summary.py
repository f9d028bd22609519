"""Summary of motion tracking: sentences and rows of tables."""

import numpy as np

from sim2vr_harness.tools.track.postures import REACHED_M
from sim2vr_harness.tools.track.registration import STANDING_M, head_height_m
from sim2vr_harness.tools.track.tracking import Tracked

_CUT_SHORT_M = 0.05
"""Hands that are farther off in one of twenty steps miss what is struck at."""


def facts_of(one: Tracked) -> list[str]:
    """Who followed what, how it was placed, and effort and fatigue."""
    first, last = one.followed.passes[0], len(one.followed.passes)
    lines = [
        f"{one.path.name}: {one.path.duration_s:.1f} s, followed by {one.body.name} "
        f"({_size(one)}), {last} {'goes' if last > 1 else 'go'}"
    ]
    if last > 1:
        lines.append(
            f"  motor layer alone: median {1e3 * first.median_m:.0f} mm, 95 % "
            f"{1e3 * first.most_m:.0f} mm; with planned muscles, below"
        )
    lines += [f"  {note}" for note in one.placement.notes]
    summary = one.summary()
    fatigue = (
        "" if one.fatigued is None else f", {100 * one.fatigued:.1f} % of motor units fatigued"
    )
    lines.append(
        f"  effort {summary['effort']:.2f} ({summary['effort_per_s']:.3f} per s), mean activation "
        f"{_mean(one.followed.activations):.3f}{fatigue}"
    )
    # Hands whose fastest strokes the body does not follow (docs/reference/tools.md, "Track").
    helps = []
    if not one.settings.refined:
        helps.append("without --no-refine")
    if one.muscles:
        helps.append("--set env.user.person.strength=1.5")
    mending = f"; closer, perhaps, {' or '.join(helps)} (docs/reference/tools.md)" if helps else ""
    cut_short = [
        f"{hand.hand.removeprefix('controller_')} hand: one step in twenty is more than "
        f"{1e3 * hand.reachable_most_m:.0f} mm off within reach. Its fastest strokes are cut "
        f"short, and the load of those moments is underestimated{mending}"
        for hand in one.hands
        if hand.reachable_most_m is not None and hand.reachable_most_m > _CUT_SHORT_M
    ]
    return lines + [f"  {note}" for note in cut_short]


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else 0.0


def _size(one: Tracked) -> str:
    if one.estimated:
        return f"cut to {one.stature_m:.2f} m, estimated from the head's height while standing"
    if one.stature_m is not None:
        return f"cut to {one.stature_m:.2f} m"
    height = head_height_m(one.path)
    if height is not None and height < STANDING_M:
        return f"own size: a head at {height:.2f} m, sitting, tells no stature; --stature does"
    return "own size"


def hand_rows(one: Tracked) -> list[list[str]]:
    """Head and rows: errors, and how much is beyond reach."""
    head = [
        "hand",
        "median",
        "95 %",
        f"beyond reach by > {1e3 * REACHED_M:.0f} mm",
        "median within reach",
        "95 % within reach",
    ]
    return [
        head,
        *(
            [
                hand.hand.removeprefix("controller_"),
                f"{1e3 * hand.median_m:.1f}",
                f"{1e3 * hand.most_m:.1f}",
                f"{100 * hand.unreachable:.1f} %",
                _mm(hand.reachable_median_m),
                _mm(hand.reachable_most_m),
            ]
            for hand in one.hands
        ),
    ]


def muscle_rows(one: Tracked, most: int) -> list[list[str]]:
    """Head and rows: activation and fatigue of the most active muscles."""
    return [
        ["muscle", "mean activation", "95 % below", "fatigued at the end"],
        *(
            [
                load.muscle,
                f"{load.mean:.3f}",
                f"{load.most:.3f}",
                "-" if load.fatigued is None else f"{100 * load.fatigued:.1f} %",
            ]
            for load in one.muscles[:most]
        ),
    ]


def outcome_rows(one: Tracked) -> list[list[str]]:
    """Head and rows: the round by who played."""
    names = {
        "person": "the person",
        "tracked": "the body's hand, turned as the person's",
        "tracked pose": "the body's hand, turned as it is",
    }
    return [
        ["who", "targets", "hits", "misses", "too slow", "hit rate"],
        *(
            [
                names.get(who, who),
                *(str(n) for n in (found.targets, found.hits, found.misses, found.contacts)),
                "-" if found.hit_rate is None else f"{found.hit_rate:.3f}",
            ]
            for who, found in one.outcomes.items()
        ),
    ]


def _mm(value_m: float | None) -> str:
    return "-" if value_m is None else f"{1e3 * value_m:.1f}"
