"""Figures of outcomes: measures by group beside people's, and places of the outcomes."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import counted
from sim2vr_harness.client import Measure
from sim2vr_harness.figures.figure import (
    GREY,
    Bars,
    Figure,
    Heat,
    Layer,
    Line,
    Panel,
    Points,
    Ranges,
    colour_of,
)
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.numbers import known, summary_of
from sim2vr_harness.studies.report.source import Group, ReportSource

_MOST_POINTS = 400
"""Of items in a panel; more would only cover each other."""
_MOST_COUNTS = 6
"""Most counts that are listed one by one."""
_SPREAD = 0.5
"""Of a group's rounds, in the distance of two groups."""


def figures_of_outcomes(source: ReportSource, published: Published) -> Iterator[Figure]:
    """Yield the figures of measures, grids, places and outcomes that these data allow."""
    panels = [
        _measure_panel(source.groups, measure, published)
        for measure in source.measures
        if any(any(known(group.values(measure.name))) for group in source.groups)
    ]
    if panels:
        people = " Grey: the range of the people, and their mean (diamond)." if _people(
            source, published
        ) else ""  # fmt: skip
        yield Figure(
            "measures",
            "Measures",
            "Small dots are rounds, large ones means over them, or over persons." + people,
            panels,
        )
    for grid in source.grids:
        yield _grid(source.groups, grid, published)
    yield from _places(source.groups)
    if any(group.events["outcome"].notna().any() for group in source.groups):
        yield _outcomes(source.groups)


def _people(source: ReportSource, published: Published) -> bool:
    return any(
        published.people_in(group.condition, measure.name)
        for group in source.groups
        for measure in source.measures
    )


def _measure_panel(groups: Sequence[Group], measure: Measure, published: Published) -> Panel:
    layers: list[Layer] = []
    people = [published.people_in(group.condition, measure.name) for group in groups]
    places = [place for place, values in enumerate(people) if values]
    if places:
        lows, highs = ([f(people[i]) for i in places] for f in (min, max))
        means = [float(np.mean(people[i])) for i in places]
        texts = [
            f"{len(people[i])} people: {mean:.{measure.digits}f}, "
            f"{low:.{measure.digits}f} to {high:.{measure.digits}f}"
            for i, mean, low, high in zip(places, means, lows, highs, strict=True)
        ]
        layers.append(Ranges("people's range", places, lows, highs, text=texts))
        layers.append(
            Points(
                "people's mean",
                places,
                means,
                "#6b7075",
                9,
                "diamond",
                text=texts,
                key="people's mean",
            )
        )
    layers += _pairs(groups, measure)
    several = any(len(set(group.units)) > 1 for group in groups)
    over = "persons or users" if several else "rounds"
    for place, group in enumerate(groups):
        colour = colour_of(place)
        values = known(group.values(measure.name))
        beside = [place + _SPREAD * ((k + 0.5) / len(values) - 0.5) for k in range(len(values))]
        layers.append(Points(f"{group.label}, rounds", beside, values, colour, 4, key="round"))
        found = summary_of(group, measure.name)
        if found is not None:
            text = (
                f"{group.label}: {found.mean:.{measure.digits}f}, {counted(found.rounds, 'round')}"
            )
            layers.append(
                Points(group.label, [place], [found.mean], colour, 11, text=[text],
                       spread=None if found.spread is None else [found.spread],
                       key="mean" if found.spread is None else f"mean ± SD over {over}")
            )  # fmt: skip
    return Panel(
        measure.label, layers, y_label=measure.unit, ticks=[group.label for group in groups]
    )


def _pairs(groups: Sequence[Group], measure: Measure) -> list[Layer]:
    """A thin line per person or user through its rounds in all groups, where n is above 1."""
    lines: dict[str, tuple[list[float], list[float]]] = {}
    for place, group in enumerate(groups):
        values = group.values(measure.name)
        own = [(u, v) for u, v in zip(group.units, values, strict=True) if v is not None]
        for unit in dict.fromkeys(unit for unit, _ in own):
            rounds = [k for k, (other, _) in enumerate(own) if other == unit]
            x, y = lines.setdefault(unit, ([], []))
            middle = (float(np.mean(rounds)) + 0.5) / len(own) - 0.5
            x.append(place + _SPREAD * middle)
            y.append(float(np.mean([own[k][1] for k in rounds])))
    paired = [(unit, *line) for unit, line in lines.items() if len(line[0]) == len(groups)]
    if len(groups) < 2 or len(paired) < 2:
        return []
    return [Line(unit, x, y, GREY, width=0.6, key="same person or user") for unit, x, y in paired]


def _grid(groups: Sequence[Group], grid: Measure, published: Published) -> Figure:
    assert grid.grid is not None
    rows, columns = grid.grid
    tables: list[tuple[str, list[float | None]]] = []
    for group in groups:
        means = [known(group.values(f"{grid.name}_{i}")) for i in range(rows * columns)]
        tables.append((group.label, [float(np.mean(v)) if v else None for v in means]))
    theirs: dict[str, list[float | None]] = {}
    for group in groups:
        people = published.grid_of(group.condition, grid.name)
        if people is not None and len(people) == rows * columns:
            theirs.setdefault(f"people, {published.people_s_name(group.condition)}", list(people))
    values = known([value for _, table in (*tables, *theirs.items()) for value in table])
    low, high = 0.0, 1.0
    if values and max(values) > 1.0:
        low, high = min(values), max(values)
    panels = [
        Panel(
            title,
            [
                Heat(
                    [table[row * columns : (row + 1) * columns] for row in range(rows)],
                    _sides(columns, ("left", "middle", "right")),
                    _sides(rows, ("top", "middle", "bottom")),
                    low,
                    high,
                )
            ],
        )
        for title, table in (*tables, *theirs.items())
    ]
    caption = "As the player sees it; mean over rounds. Darker: higher."
    return Figure(f"grid_{grid.name}", grid.heading, caption, panels)


def _sides(count: int, three: tuple[str, str, str]) -> list[str]:
    return list(three) if count == 3 else [str(i + 1) for i in range(count)]


def _places(groups: Sequence[Group]) -> Iterator[Figure]:
    """Items in the plane that faces the player, where they lie at more than a few places."""
    panels = []
    for group in groups:
        rows = group.events.dropna(subset=["x_m", "y_m", "success"])
        if len(rows) < 2 or rows["cell"].notna().any():
            continue
        rows = rows.iloc[:: -(-len(rows) // _MOST_POINTS)]
        good = rows[rows["success"].astype(bool)]
        bad = rows[~rows["success"].astype(bool)]
        layers = [
            Points(name, list(part["x_m"]), list(part["y_m"]), colour, 7, symbol)
            for name, part, colour, symbol in (
                ("reached", good, "#009e73", "circle"), ("not", bad, "#d55e00", "x"),
            )
            if len(part)
        ]  # fmt: skip
        labels = ("right (m)", "up (m)")
        panels.append(Panel(group.label, layers, *labels, square=True, legend=True))
    if panels:
        text = "Where items were when they were decided, as the game's log has it."
        yield Figure("places", "Reach: which items were reached", text, panels)


def _outcomes(groups: Sequence[Group]) -> Figure:
    """How items ended, in shares."""
    panels = []
    names = list(dict.fromkeys(name for g in groups for name in g.events["item"].dropna()))
    for name in names:
        own = [group.events[group.events["item"] == name] for group in groups]
        ends = list(dict.fromkeys(end for rows in own for end in rows["outcome"].dropna()))
        if not ends:
            continue
        layers = [
            Bars(
                end,
                [group.label for group in groups],
                [
                    float((rows["outcome"] == end).sum() / max(1, rows["outcome"].notna().sum()))
                    for rows in own
                ],
                colour,
            )
            for end, colour in _coloured(own, ends)
        ]
        numbers = [int(rows["outcome"].notna().sum()) for rows in own]
        counts = ", ".join(map(str, numbers))
        if len(numbers) > _MOST_COUNTS:
            counts = f"{min(numbers)} to {max(numbers)} in each"
        panels.append(
            Panel(f"{_several(name)} ({counts})", layers, y_label="proportion", stacked=True,
                  legend=True, y_range=(0.0, 1.02))
        )  # fmt: skip
    text = "Proportion of each outcome among the items that had one; titles have their numbers."
    return Figure("outcomes", "Outcomes of items", text, panels)


def _several(name: str) -> str:
    """``target`` -> ``Targets``, ``box`` -> ``Boxes``."""
    return f"{name.capitalize()}{'es' if name.endswith(('s', 'x', 'z', 'ch', 'sh')) else 's'}"


def _coloured(own: Sequence[Any], ends: Sequence[str]) -> list[tuple[str, str]]:
    """Outcomes with colours, successes first: these are green and blue."""
    good = [
        end
        for end in ends
        if any(rows[rows["outcome"] == end]["success"].astype(bool).any() for rows in own)
    ]
    bad = [end for end in ends if end not in good]
    wins, losses = ("#009e73", "#0072b2", "#56b4e9"), ("#d5d9de", "#d55e00", "#e69f00", "#cc79a7")
    return [
        *((end, wins[i % len(wins)]) for i, end in enumerate(good)),
        *((end, losses[i % len(losses)]) for i, end in enumerate(bad)),
    ]
