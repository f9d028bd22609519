"""The figures of replayed rounds, for people and for programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from sim2vr_harness.evaluation.replay.agreement import Agreement, agreement_of, as_json, pooled
from sim2vr_harness.evaluation.replay.replayer import Replay

_EVENTS = (
    "Targets",
    "Same\noutcome",
    "Hits\nrec/pred",
    "Misses\nrec/pred",
    "Contacts\nrec/pred",
    "First\ndifference",
)
_TIMES = (
    "Hit recall\n50/100 ms",
    "Precision\n50/100 ms",
    "Same\nstep",
    "|dt|\nms",
    "|dv| m/s\nmedian/p95",
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
        """Print the events of each round and of all, then how well hits agree in time and speed."""
        closed = any(replay.closed_loop for replay, _ in self._rounds)
        how = "seed and poses only" if closed else "spawns from the log, outcomes predicted"
        console.print(self._table(f"Replay: {how}", _EVENTS, _event_cells))
        console.print(self._table("When and how fast hits are", _TIMES, _time_cells))

    def _table(
        self, title: str, columns: Sequence[str], cells: Callable[[Agreement], list[str]]
    ) -> Table:
        table = Table(
            title=title,
            title_justify="left",
            title_style="bold",
            box=box.SIMPLE_HEAD,
            padding=(0, 0, 0, 1),
        )
        table.add_column("Round", overflow="fold")
        for heading in columns:
            table.add_column(heading, justify="right", no_wrap=True)
        for replay, part in self._rounds:
            table.add_row(replay.recording.name, *cells(part))
        table.add_section()
        groups = [("constrained", self._parts(True)), ("unconstrained", self._parts(False))]
        if all(parts for _, parts in groups):
            groups.append(("all", self._parts()))
        for name, parts in groups:
            if parts:
                table.add_row(name, *cells(pooled(parts)), style="bold")
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


def _event_cells(part: Agreement) -> list[str]:
    figures = as_json(part)
    counts = [
        f"{figures[f'{kind}_recorded']}/{figures[f'{kind}_predicted']}"
        for kind in ("hits", "misses", "contacts")
    ]
    outcome = _share(figures["outcome_agreement"])
    return [str(part.targets), outcome, *counts, _first_difference(part)]


def _first_difference(part: Agreement) -> str:
    if part.first_divergence_s is not None:
        return f"{part.first_divergence_s:.2f} s"
    different = part.rounds - part.identical_rounds
    return f"in {different} of {part.rounds}" if different else "none"


def _time_cells(part: Agreement) -> list[str]:
    figures = as_json(part)
    dt_s, dv, dv_p95 = (figures[key] for key in ("mean_abs_dt_s", "dv_median", "dv_p95"))
    return [
        f"{_share(figures['hit_recall_50ms'])}/{_share(figures['hit_recall_100ms'])}",
        f"{_share(figures['hit_precision_50ms'])}/{_share(figures['hit_precision_100ms'])}",
        _share(figures["same_step"]),
        "-" if dt_s is None else f"{1000 * dt_s:.3f}",
        "-" if dv is None else f"{dv:.4f}/{dv_p95:.4f}",
    ]


def _share(value: float | None) -> str:
    """Four digits without the zero in front; 1 only when it is exactly that."""
    if value is None:
        return "-"
    return f"{value:g}" if value in (0.0, 1.0) else f"{min(value, 0.9999):.4f}"[1:]
