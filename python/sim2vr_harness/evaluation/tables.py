"""Results as a table for people."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.table import Table

__all__ = ["cell", "results_table"]

_ROWS: tuple[tuple[str, str, int], ...] = (
    ("hits", "Hits", 1),
    ("misses", "Misses", 1),
    ("contacts", "Contacts (too slow)", 1),
    ("hit_rate", "Hit rate", 3),
    ("hit_speed_mps", "Hitting speed (m/s)", 2),
    ("hammer_depth_m", "Hammer depth (m)", 3),
    ("max_fatigued", "Fatigue (max. MUs)", 3),
    ("action_change", "Change of actions", 3),
    ("effort", "Effort", 1),
    ("game_return", "Game return", 1),
    ("return", "Return", 1),
)


def results_table(summaries: Mapping[str, Mapping[str, Any]], title: str) -> Table:
    """Return a table of means and standard deviations over rounds, one column per condition.

    Args:
        summaries: condition -> :func:`~sim2vr_harness.evaluation.metrics.summarise`.
        title: Shown above the table.
    """
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    table.add_column("Per round", no_wrap=True)
    for condition in summaries:
        table.add_column(condition, justify="right", overflow="fold")
    table.add_row("Rounds", *(str(summary["episodes"]) for summary in summaries.values()))
    for key, heading, digits in _ROWS:
        cells = [
            cell(summary.get(key), summary.get(f"{key}_sd"), digits)
            for summary in summaries.values()
        ]
        table.add_row(heading, *cells)
    terms = list(
        dict.fromkeys(term for s in summaries.values() for term in s.get("return_terms", {}))
    )
    for term in terms if len(terms) > 2 else ():
        values = (summary.get("return_terms", {}).get(term) for summary in summaries.values())
        table.add_row(f"  + {_words(term)}", *(cell(value, None, 1) for value in values))
    if any(summary.get("cell_hit_rates", []) for summary in summaries.values()):
        rows = [_lowest(summary.get("cell_hit_rates", [])) for summary in summaries.values()]
        table.add_row("Lowest cell's hit rate", *rows)
    for key, heading in (("diverged", "Diverged"), ("app_failed", "App failed (not counted)")):
        counts = [summary.get(key, 0) for summary in summaries.values()]
        if any(counts):
            table.add_row(heading, *map(str, counts))
    return table


def _words(name: str) -> str:
    """DistanceReward -> distance."""
    parts = re.findall(r"[A-Z][a-z]+", name)
    return " ".join(part.lower() for part in parts if part != "Reward") or name


def _lowest(rates: Sequence[float | None]) -> str:
    known = [(rate, cell) for cell, rate in enumerate(rates) if rate is not None]
    if not known:
        return "-"
    rate, cell = min(known)
    return f"{rate:.2f} (cell {cell})"


def cell(value: float | None, deviation: float | None, digits: int) -> str:
    """A number, with its deviation where there is one; "-" for none."""
    if value is None:
        return "-"
    spread = "" if deviation is None else f" ± {deviation:.{digits}f}"
    return f"{value:.{digits}f}{spread}"
