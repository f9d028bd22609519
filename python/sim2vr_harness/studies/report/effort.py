"""Figures of the parts of the reward and of the effort."""

from collections.abc import Iterator

import numpy as np

from sim2vr_harness.figures.figure import GREY, Bars, Figure, Panel, colour_of
from sim2vr_harness.studies.report.numbers import known
from sim2vr_harness.studies.report.source import Group, ReportSource


def figures_of_effort(source: ReportSource) -> Iterator[Figure]:
    """Yield how the return splits into the game's terms and the cost of effort."""
    labels = [group.label for group in source.groups]
    parts = [_parts(source, group) for group in source.groups]
    names = list(dict.fromkeys(name for own in parts for name in own))
    if not names:
        return
    layers = [
        Bars(
            name,
            labels,
            [own.get(name) for own in parts],
            GREY if name == "effort" else colour_of(i),
        )
        for i, name in enumerate(names)
    ]
    panels = [Panel("What a round brought", layers, y_label="reward", stacked=True, legend=True)]
    shares = [effort_share(group) for group in source.groups]
    if any(share is not None for share in shares):
        bars = Bars("effort", labels, shares, GREY)
        panels.append(
            Panel("Effort cost against the game's reward", [bars], y_label="share of the reward")
        )
    before = [_exertion(group) for group in source.groups]
    weights = {w for g in source.groups for w in known(g.values("effort_weight"))}
    if len(weights) > 1 and any(value is not None for value in before):
        bars = Bars("effort", labels, before, GREY)
        panels.append(Panel("Effort before its weight", [bars], y_label="cost / weight"))
    text = (
        "Means over rounds. Gains are drawn upwards and costs downwards; they add up to the return."
        + (" Users paid for effort by different weights: compare it before its weight."
           if len(weights) > 1 else "")
    )  # fmt: skip
    yield Figure("effort", "Effort and reward", text, panels)


def effort_share(group: Group) -> float | None:
    """The mean cost of effort as a share of the mean reward of the game; None if there is none."""
    effort, game = known(group.values("effort")), known(group.values("game_return"))
    if not effort or not game or np.mean(game) <= 0:
        return None
    return float(np.mean(effort) / np.mean(game))


def _exertion(group: Group) -> float | None:
    effort, weight = known(group.values("effort")), known(group.values("effort_weight"))
    return float(np.mean(effort) / weight[0]) if effort and weight and weight[0] else None


def _parts(source: ReportSource, group: Group) -> dict[str, float]:
    """Name of a term -> its mean over rounds."""
    game, effort = known(group.values("game_return")), known(group.values("effort"))
    if not game or not effort:
        return {}
    columns = [name for name in group.columns("steps") if name.startswith("term_")]
    labels = {f"term_{t.log_key.lower()}": t.label for t in source.facts.reward_terms}
    sums: dict[str, list[float]] = {}
    for rows in group.moments("steps", columns):
        for column in columns:
            sums.setdefault(column, []).append(float(np.nansum(rows[column])))
    terms = {labels.get(column, column): float(np.mean(own)) for column, own in sums.items()}
    rest = float(np.mean(game)) - sum(terms.values())
    return {source.facts.reward_rest: rest, **terms, "effort": -float(np.mean(effort))}
