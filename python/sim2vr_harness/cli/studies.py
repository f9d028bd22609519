"""Terminal output of studies: progress and results."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Literal

import typer
from rich import box
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from sim2vr_harness.base.errors import InputError, counted

if TYPE_CHECKING:
    from sim2vr_harness.studies import StudyData
    from sim2vr_harness.studies.runner import StudyProgress

_CONVINCING = 0.001
_MOST_BEST = 4
"""Trials that fit 80 columns beside the names of their numbers."""


class Shown:
    """A line on the standard error stream per task that has ended."""

    def __enter__(self) -> Shown:
        self._began = time.monotonic()
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def show(self, progress: StudyProgress) -> None:
        """Say how far the study is."""
        seconds = time.monotonic() - self._began
        what = progress.label or ("done before" if progress.done else "begins")
        failed = "" if progress.error is None else f" failed: {progress.error}"
        typer.echo(f"[{progress.done}/{progress.total}] {what}{failed} ({seconds:.0f} s)", err=True)


def print_tables(tables: Iterator[RenderableType]) -> None:
    """Print tables; one that is too wide for the terminal keeps its words whole."""
    wide = Console(width=1000)
    for table in tables:
        Console(width=max(Console().width, wide.measure(table).minimum)).print(table)


def comparison_table(data: StudyData) -> Iterator[RenderableType]:
    """Yield a table of means per condition, and one of the comparisons; of a search its best."""
    if "search" in data.about:
        yield from _best_of(data)
        return
    summaries, results = data.statistics["summaries"], data.statistics["results"]
    digits = _digits(summaries, data.about["measures"])
    if summaries:
        rows = []
        for row in summaries:
            decimals = digits[row["measure"]]
            rows.append([
                *map(str, row["levels"].values()),
                row["measure"],
                _of(str(row["n"]), row),
                _plain(row["mean"], decimals),
                _plain(row["sd"], decimals),
                _interval(row, decimals),
            ])  # fmt: skip
        names = [*summaries[0]["levels"], "measure", "n", "mean", "SD", "95 % interval"]
        yield _table(f"Mean and SD over units (unit: {summaries[0]['unit']})", names, rows)
    yield from _results_table(results, digits)
    for note in dict.fromkeys(_notes(summaries, results)):
        yield Text(f"note: {note}")


def plan_tables(
    file: Path, out: Path | None, differences: Sequence[str], *, trust_app: bool = False
) -> Iterator[RenderableType]:
    """Yield what a study would play, and how many units its comparisons need."""
    from sim2vr_harness.studies.comparisons import sample_sizes, wanted_differences
    from sim2vr_harness.studies.config import load_study
    from sim2vr_harness.studies.data import STUDY_FILE, open_study, unit_of
    from sim2vr_harness.studies.plan import plan_of

    study = load_study(file)
    if study.optimise is not None:
        raise InputError("--plan", "a study with optimise", "one with comparisons")
    plan = plan_of(study, folder=file.parent, trust_app=trust_app)
    root = Path("studies") / study.name if out is None else out
    earlier = open_study(root) if (root / STUDY_FILE).is_file() else None
    rounds = len(plan.cells) * study.episodes * (study.people or 1)
    counts = {"cell": len(plan.cells), "training": len(plan.trainings), "round": rounds}
    yield Text(", ".join(counted(count, what) for what, count in counts.items()))
    wanted = wanted_differences(differences, plan.measures)
    sizes = sample_sizes(study, plan.measures, earlier, wanted)
    if not sizes:
        yield Text("No comparison of units: there is no number of units to plan.")
        return
    unit = {"person": "participants", "user": "users"}.get(unit_of(study), unit_of(study))
    rows = [
        [
            " - ".join(map(str, one.levels)),
            one.measure,
            "-" if one.sd is None else f"{one.sd:.3g}",
            "-" if one.difference is None else f"{one.difference:.3g}",
            f"{one.standardised:.2f}",
            str(one.tests),
            str(one.units) if one.paired else f"{one.units} each",
        ]
        for one in sizes
    ]
    names = ("compared", "measure", "SD", "difference", "in SD", "tests", "n")
    yield _table(f"{unit.capitalize()} needed (power 0.8, p < 0.05)", names, rows)
    known = (
        "of the results in " + str(root) if earlier is not None else "unknown: no earlier results"
    )
    yield Text(f"SD: {known}. Tests: how many Holm's correction counts.")


def _best_of(data: StudyData) -> Iterator[RenderableType]:
    trials = data.trials
    best = trials[trials["chosen"]]
    kept = f"{int(trials['keeps_limits'].sum())} of {len(trials)} trials keep the limits"
    if not len(best):
        yield Text(f"Nothing was found: no trial of {len(trials)} keeps the limits.")
        return
    names = [
        name
        for name in trials.columns
        if name.startswith("parameter_") or name in data.about["search"]["measures"]
    ]
    digits = {str(one["name"]): int(one["digits"]) for one in data.about["measures"]}
    for first in range(0, len(best), _MOST_BEST):
        chosen = best.iloc[first : first + _MOST_BEST]
        rows = [
            [name.removeprefix("parameter_"), *(_value(v, digits.get(name)) for v in row)]
            for name, row in ((name, chosen[name]) for name in names)
        ]
        yield _table(f"The best; {kept}", ["trial", *map(str, chosen["trial"])], rows)


def _value(value: Any, decimals: int | None) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.4g}" if decimals is None else _plain(value, decimals)


def _results_table(
    results: list[dict[str, Any]], digits: Mapping[str, int]
) -> Iterator[RenderableType]:
    """Yield a table of comparisons per test, and a line on what the effect sizes are."""
    for test in dict.fromkeys(row["test"] for row in results):
        own = [one for row in results if row["test"] == test for one in _parts(row)]
        p = "p (Holm)" if any("p_holm" in one for one in own) else "p"
        names = ["measure", "compared", "n", "difference [95 %]", p, "effect"]
        yield _table(f"Comparisons ({test})", names, [_row(one, digits) for one in own])
        effects = dict.fromkeys(r["effect_name"] for r in own if r.get("effect") is not None)
        if effects:
            yield Text(f"Effect: {', '.join(effects)}.")


def _parts(result: dict[str, Any]) -> list[dict[str, Any]]:
    """A comparison; of a mixed model its effects, with the keys of comparisons."""
    effects = result.get("effects")
    if not effects:
        return [result]
    return [result | {"levels": [one["name"]], "difference": one} | one for one in effects[1:]]


def _row(row: dict[str, Any], digits: Mapping[str, int]) -> list[str]:
    decimals = digits.get(row["measure"], 3)
    n = row["n"] if isinstance(row["n"], int) else "+".join(map(str, row["n"]))
    sign = {"less": " < ", "greater": " > "}.get(row.get("alternative", ""), " - ")
    difference = row.get("difference") or {}
    p = row["p"] if row.get("p_holm") is None else row["p_holm"]
    levels = sign.join(map(str, row["levels"]))
    within = [f"in {name} {label}" for name, label in row["by"].items()]
    return [
        row["measure"],
        "\n".join([levels, *within]),
        _of(str(n), row),
        _with_interval(difference, decimals),
        "refused" if row["refused"] else (f"< {_CONVINCING}" if p < _CONVINCING else f"{p:.3f}"),
        _plain(row.get("effect"), 2),
    ]


def _of(n: str, row: Mapping[str, Any]) -> str:
    """n, and of how many where some have no value."""
    units = row.get("units")
    return n if units is None or n == str(units) or "+" in n else f"{n} of {units}"


def _table(title: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table without empty columns, whose cells are wrapped at spaces only."""
    table = Table(box=box.SIMPLE_HEAD, title=title, padding=(0, 1, 0, 0), pad_edge=False)
    filled = [k for k in range(len(names)) if any(row[k] not in ("", "-") for row in rows)]
    for k in filled:
        numbers = all(re.match(r"[-<\d](?!.* [-<>] )|$", row[k]) for row in rows)
        cells = [names[k], *(row[k] for row in rows)]
        width = max(len(word) for cell in cells for word in ([cell] if numbers else cell.split()))
        whole = width == max(map(len, cells))
        justify: Literal["right", "left"] = "right" if numbers else "left"
        table.add_column(names[k], justify=justify, no_wrap=whole, min_width=width)
    for row in rows:
        table.add_row(*(row[k] for k in filled))
    return table


def _digits(
    summaries: Sequence[Mapping[str, Any]], measures: Sequence[Mapping[str, Any]]
) -> dict[str, int]:
    """Measure -> decimals: two significant digits of its typical SD, or the game's own."""
    own = {str(one["name"]): int(one["digits"]) for one in measures}
    for name in dict.fromkeys(row["measure"] for row in summaries):
        rows = [row for row in summaries if row["measure"] == name and row["sd"] is not None]
        sds = [row["sd"] for row in rows if row["sd"] > 1e-9 * abs(row["mean"])]
        if sds:
            own[name] = min(6, max(0, 1 - math.floor(math.log10(median(sds)))))
        own.setdefault(name, 3)
    return own


def _plain(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{round(value, decimals) + 0.0:,.{decimals}f}"


def _with_interval(difference: Mapping[str, Any], decimals: int) -> str:
    """``-1.2 [-2.3, -0.2]``; an end that the test does not give is a dash."""
    value = difference.get("estimate", difference.get("mean"))
    if value is None:
        return "-"
    return f"{_plain(value, decimals)} {_interval(difference, decimals)}".rstrip()


def _interval(of: Mapping[str, Any], decimals: int) -> str:
    low, high = of.get("low"), of.get("high")
    if low is None and high is None:
        return ""
    return f"[{_plain(low, decimals)}, {_plain(high, decimals)}]"


def _notes(
    summaries: Sequence[Mapping[str, Any]], results: Sequence[Mapping[str, Any]]
) -> Iterator[str]:
    for row in summaries:
        place = ", ".join(map(str, row["levels"].values()))
        for text in row.get("notes", ()):
            yield f"{place}: {text}" if place else text
    told = [f"{note}" for row in summaries for note in row.get("notes", ())]
    for row in results:
        for text in (row["refused"], *str(row["note"] or "").split("; ")):
            # What the table of conditions has said already is not said again.
            if text and not any(text in note or note in text for note in told):
                yield text
