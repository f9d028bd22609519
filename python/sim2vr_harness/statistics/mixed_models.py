"""Mixed models with a random intercept and random slopes per unit, fitted to units' means."""

from collections.abc import Mapping, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy import stats

from sim2vr_harness.statistics.intervals import mean_interval


def mixed_model(
    episodes: Any, measure: str, factors: Mapping[str, str], levels: Sequence[Sequence[str]]
) -> dict[str, Any]:
    """Fit measure ~ factors and their interactions + (1 + the same | unit).

    Every effect is estimated within each unit, from the means of its rounds in the conditions, and
    tested by a t test over the units. So units may differ in how they respond to a condition, and
    p keeps its error rate for any number of units and rounds. A model that gives units an
    intercept of their own only rejects up to seven times too often then.

    Args:
        episodes: A row per round, with ``unit``.
        measure: The dependent variable.
        factors: Categorical predictors: name and column of ``episodes``.
        levels: Of each, in order; the first is what the others are compared with.

    Returns:
        ``formula``, ``groups`` (units with a value in every condition), ``left_out`` (the others),
        ``rounds`` and ``effects``: per fixed effect ``name``, ``estimate``, ``error``,
        ``statistic`` (t), ``df``, ``p``, ``low``, ``high`` (95 %); p is None where all units
        have the same effect.

    Raises:
        ValueError: Fewer than two units have a value in every condition.
    """
    known = episodes.dropna(subset=[measure])
    present = [
        [label for label in own if label in set(known[column])]
        for column, own in zip(factors.values(), levels, strict=True)
    ]
    cells = list(product(*present))
    columns = list(factors.values())
    means: dict[Any, dict[tuple[str, ...], float]] = {}
    for (unit, *cell), values in known.groupby(["unit", *columns])[measure]:
        means.setdefault(unit, {})[tuple(cell)] = float(values.mean())
    complete = [unit for unit, own in means.items() if all(cell in own for cell in cells)]
    if len(complete) < 2:
        raise ValueError(
            f"{len(complete)} of {episodes['unit'].nunique()} units have a value in every "
            "condition, and at least two are needed; where each condition has units of its own, "
            "use test: auto"
        )
    table = np.array([[means[unit][cell] for cell in cells] for unit in complete])
    effects = []
    first = tuple(own[0] for own in present)
    for cell in sorted(
        cells, key=lambda each: sum(one != other for one, other in zip(each, first, strict=True))
    ):
        varied = [k for k in range(len(cell)) if cell[k] != first[k]]
        each = np.zeros(len(complete))
        for count in range(len(varied) + 1):
            for chosen in combinations(varied, count):
                place = tuple(cell[k] if k in chosen else first[k] for k in range(len(cell)))
                each += (-1) ** (len(varied) - count) * table[:, cells.index(place)]
        name = ":".join(f"{list(factors)[k]}={cell[k]}" for k in varied)
        effects.append({"name": name or "Intercept", **_tested(each)})
    terms = " * ".join(factors) or "1"
    slopes = f"1 + {terms}" if factors else "1"
    used = known[known["unit"].isin(complete)]
    return {
        "formula": f"{measure} ~ {terms} + ({slopes} | unit)",
        "groups": len(complete),
        "left_out": sorted(set(map(str, episodes["unit"])) - set(map(str, complete))),
        "rounds": len(used),
        "effects": effects,
    }


def _tested(each: np.ndarray) -> dict[str, Any]:
    """An effect of every unit as an estimate with its t test."""
    n = len(each)
    estimate, error = float(each.mean()), float(np.std(each, ddof=1)) / np.sqrt(n)
    interval = mean_interval(each)
    assert interval is not None
    # Differences of equal numbers leave rounding errors, which are no spread to test against.
    varies = error > 1e-12 * max(1e-12, float(np.abs(each).max()))
    t = estimate / error if varies else None
    return {
        "estimate": estimate,
        "error": float(error),
        "statistic": t,
        "df": n - 1,
        "p": None if t is None else float(2.0 * stats.t.sf(abs(t), n - 1)),
        "low": interval[0],
        "high": interval[1],
    }
