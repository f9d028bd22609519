"""How a study is shown on the terminal: how far it is, and what came out."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from sim2vr_harness.studies import StudyData
    from sim2vr_harness.studies.runner import StudyProgress

__all__ = ["Shown", "comparison_table"]

_CONVINCING = 0.001


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


def comparison_table(data: StudyData) -> Iterator[RenderableType]:
    """Yield a table of means per condition, and one of the comparisons; of a search its best."""
    if "search" in data.about:
        yield from _best_of(data)
        return
    found = data.statistics
    if found["summaries"]:
        yield _summary_table(found["summaries"])
    if found["results"]:
        yield _results_table(found["results"])
        for note in dict.fromkeys(_notes(found["results"])):
            yield Text(f"note: {note}")


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
    table = Table(box=box.SIMPLE, title=f"The best; {kept}")
    for name in ("trial", *names):
        table.add_column(name.removeprefix("parameter_"), justify="right")
    for _, row in best.iterrows():
        values = [row[name] for name in names]
        table.add_row(
            str(row["trial"]),
            *(value if isinstance(value, str) else f"{value:.4g}" for value in values),
        )
    yield table


def _summary_table(summaries: list[dict[str, Any]]) -> Table:
    unit, first = summaries[0]["unit"], summaries[0]
    table = Table(box=box.SIMPLE, title=f"Mean ± SD over units (unit: {unit}), 95 % interval")
    for name in first["levels"]:
        table.add_column(name)
    for name in ("measure", "n", "mean", "95 %"):
        table.add_column(name, justify="left" if name == "measure" else "right")
    for row in summaries:
        sd = "" if row["sd"] is None else f" ± {row['sd']:.3g}"
        mean = "-" if row["mean"] is None else f"{row['mean']:.4g}{sd}"
        interval = "-" if row["low"] is None else f"{row['low']:.4g} to {row['high']:.4g}"
        table.add_row(*row["levels"].values(), row["measure"], str(row["n"]), mean, interval)
    return table


def _results_table(results: list[dict[str, Any]]) -> Table:
    table = Table(box=box.SIMPLE, title="Comparisons")
    for name in ("measure", "levels", "within", "test", "n", "p", "p (Holm)", "effect"):
        table.add_column(name)
    for row in results:
        n = row["n"] if isinstance(row["n"], int) else "+".join(map(str, row["n"]))
        within = ", ".join(row["by"].values())
        if row["test"] == "mixed":
            p = "refused" if row["refused"] else _of_effects(row["effects"])
            table.add_row(row["measure"], ", ".join(row["levels"]), within, "mixed", str(n), p)
            continue
        effect = "-" if row["effect"] is None else f"{row['effect']:+.2f}"
        p = "refused" if row["refused"] else _p(row["p"])
        holm = _p(row["p_holm"]) if "p_holm" in row else "-"
        sign = {"less": " < ", "greater": " > "}.get(row["alternative"], ", ")
        table.add_row(
            row["measure"], sign.join(row["levels"]), within, row["test"], str(n), p, holm, effect
        )
    return table


def _of_effects(effects: list[dict[str, Any]]) -> str:
    return "; ".join(f"{one['name']} {_p(one['p'])}" for one in effects[1:])


def _p(p: float) -> str:
    return f"< {_CONVINCING}" if p < _CONVINCING else f"{p:.3f}"


def _notes(results: list[dict[str, Any]]) -> Iterator[str]:
    for row in results:
        for text in (row["refused"], row["note"]):
            if text:
                yield text
