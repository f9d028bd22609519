"""The figures of replayed rounds, for people and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from sim2vr_harness.evaluation.replay.agreement import Agreement, agreement_of, as_json, pooled
from sim2vr_harness.evaluation.replay.replayer import Replay

__all__ = ["ReplayReport"]

_COLUMNS = (
    "Round",
    "Targets",
    "Same\noutcome",
    "Hit recall\n50/100 ms",
    "Precision\n50/100 ms",
    "Same\nstep",
    "|dt|\nms",
    "|dv| m/s\nmedian/p95",
    "Hits\nrec/pred",
    "Misses\nrec/pred",
    "Contacts\nrec/pred",
    "First\ndifference",
)


class ReplayReport:
    """Collects replays and words what they show."""

    def __init__(self, replays: Sequence[Replay]) -> None:
        self._rounds = [(replay, agreement_of(replay)) for replay in replays]

    def as_json(self) -> dict[str, Any]:
        """``rounds`` (a list) and ``total`` (all rounds, and ``constrained``/``unconstrained``)."""
        rounds = [
            {
                "name": replay.recording.name,
                "source": str(replay.recording.source),
                "condition": replay.recording.condition,
                "constrained": replay.recording.constrained,
                "closed_loop": replay.closed_loop,
                **as_json(part),
                "identical": part.identical_rounds == 1,
                "first_divergence_s": part.first_divergence_s,
            }
            for replay, part in self._rounds
        ]
        total = {
            **(_total(self._parts()) or {}),
            "constrained": _total(self._parts(constrained=True)),
            "unconstrained": _total(self._parts(constrained=False)),
        }
        return {"rounds": rounds, "total": total}

    def print(self, console: Console) -> None:
        """Print a line per round, then the totals; lines are longer than a narrow terminal's."""
        table = self._table()
        wide = console.options.update(max_width=1000)
        console.width = max(console.width, Measurement.get(console, wide, table).maximum)
        console.print(table)

    def _table(self) -> Table:
        closed = any(replay.closed_loop for replay, _ in self._rounds)
        how = "seed and poses only" if closed else "spawns from the log, outcomes predicted"
        table = Table(
            title=f"Replay: {how}",
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            padding=(0, 0, 0, 1),
        )
        for i, heading in enumerate(_COLUMNS):
            table.add_column(heading, justify="left" if i == 0 else "right", no_wrap=True)
        for replay, part in self._rounds:
            diverged = part.first_divergence_s
            table.add_row(
                replay.recording.name,
                *_cells(part),
                "none" if diverged is None else f"{diverged:.2f} s",
            )
        table.add_section()
        groups = [("constrained", self._parts(True)), ("unconstrained", self._parts(False))]
        if all(parts for _, parts in groups):
            groups.append(("all", self._parts()))
        for name, parts in groups:
            if parts:
                total = pooled(parts)
                none = f"none in {total.identical_rounds}/{total.rounds}"
                table.add_row(name, *_cells(total), none, style="bold")
        return table

    def _parts(self, constrained: bool | None = None) -> list[Agreement]:
        return [
            part
            for replay, part in self._rounds
            if constrained in (None, replay.recording.constrained)
        ]


def _total(parts: Sequence[Agreement]) -> dict[str, Any] | None:
    if not parts:
        return None
    total = pooled(parts)
    return {
        "rounds": total.rounds,
        **as_json(total),
        "identical": total.identical,
        "identical_rounds": total.identical_rounds,
    }


def _cells(part: Agreement) -> list[str]:
    figures = as_json(part)
    dt_s, dv, dv_p95 = (figures[key] for key in ("mean_abs_dt_s", "dv_median", "dv_p95"))
    return [
        str(part.targets),
        _share(figures["outcome_agreement"]),
        f"{_share(figures['hit_recall_50ms'])}/{_share(figures['hit_recall_100ms'])}",
        f"{_share(figures['hit_precision_50ms'])}/{_share(figures['hit_precision_100ms'])}",
        _share(figures["same_step"]),
        "-" if dt_s is None else f"{1000 * dt_s:.3f}",
        "-" if dv is None else f"{dv:.4f}/{dv_p95:.4f}",
        *(
            f"{figures[f'{kind}_recorded']}/{figures[f'{kind}_predicted']}"
            for kind in ("hits", "misses", "contacts")
        ),
    ]


def _share(value: float | None) -> str:
    """Four digits without the zero in front; 1 only when it is exactly that."""
    if value is None:
        return "-"
    return f"{value:g}" if value in (0.0, 1.0) else f"{min(value, 0.9999):.4f}"[1:]
