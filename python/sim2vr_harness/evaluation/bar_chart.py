"""Bar chart of several users' measures, from their evaluations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError, counted, shown, unknown_name
from sim2vr_harness.base.files import file_name, read_json
from sim2vr_harness.client import GameFacts, Measure, facts_of_outside
from sim2vr_harness.evaluation.fatigue import fatigue_measures
from sim2vr_harness.evaluation.metrics import measures_of
from sim2vr_harness.figures.figure import INK, Bars, Figure, Layer, Panel, Points, colour_of
from sim2vr_harness.figures.matplotlib_backend import write_figure

EXERTION = Measure(
    "exertion",
    "Effort before its weight",
    better="lower",
    description="The effort cost divided by its weight: comparable between users of other weights",
)
"""Worked out here: users who were trained with other weights have other costs for the same."""

_EXPECTED = "results of an evaluation: its folder, its results.json or what --json printed"


@dataclass(frozen=True)
class _Result:
    """One user in one condition."""

    user: str
    facts: GameFacts
    summary: dict[str, Any]

    def value(self, measure: Measure) -> float | None:
        """Mean over the rounds."""
        return self._of(self.summary, measure)

    def rounds(self, measure: Measure) -> list[float]:
        """Every round's, where there is one."""
        rows = self.summary.get("rounds")
        found = [self._of(row, measure) for row in rows if isinstance(row, dict)] if rows else []
        return [value for value in found if value is not None]

    def _of(self, row: dict[str, Any], measure: Measure) -> float | None:
        if measure.name != EXERTION.name:
            return _number(row.get(measure.name))
        effort, weight = _number(row.get("effort")), _number(self.summary.get("effort_weight"))
        return None if effort is None or not weight else effort / weight


def chart(
    results: Sequence[str | Path],
    out: Path,
    *,
    condition: str | None = None,
    measures: Sequence[str] = (),
) -> Path:
    """Draw measures of several users into a PNG or PDF file: a panel per measure, a bar per user.

    Bars are means over rounds, dots the rounds.

    Args:
        results: Folders or files of evaluations, in the order of the bars.
        out: The file to write.
        condition: The game's condition; None takes the only one that all of them have.
        measures: Names, as in the results; ``exertion`` is the effort before its weight. Without
            any: the game's headlines, and ``exertion``.

    Raises:
        InputError: A file cannot be used, lacks the condition or a measure, or
            ``out`` is neither PNG nor PDF.
    """
    read = [_read(Path(path)) for path in results]
    chosen = _condition(read, condition)
    found = [_result(Path(path), one[chosen]) for path, one in zip(results, read, strict=True)]
    shown_measures = _measures(found, measures)
    for path, result in zip(results, found, strict=True):
        for measure in shown_measures:
            if result.value(measure) is None:
                got = f"{measure.name!r}, of which {str(path)!r} has none"
                old = measure is EXERTION and "effort_weight" not in result.summary
                expected = "a new evaluation, which keeps the effort's weight" if old else "another"
                raise InputError("--measure", got, expected)
    return write_figure(_figure(found, shown_measures, chosen), out)


def _read(path: Path) -> dict[str, dict[str, Any]]:
    """Condition -> summary."""
    file = path / "results.json" if path.is_dir() else path
    if not file.is_file():
        raise InputError("RESULTS", repr(str(path)), _EXPECTED)
    content = read_json(file, _EXPECTED)
    for name, summary in content.items():
        if not isinstance(summary, dict) or not isinstance(summary.get("user"), str):
            raise InputError(file_name(file), f"{shown(name)} of {shown(summary, 40)}", _EXPECTED)
    return content


def _condition(read: Sequence[dict[str, Any]], wanted: str | None) -> str:
    common = [name for name in read[0] if all(name in one for one in read)]
    if wanted is not None:
        if wanted not in common:
            every = sorted({name for one in read for name in one})
            if wanted in every:
                raise InputError(
                    "--condition", f"{wanted!r}, which not all of them have", "another"
                )
            raise unknown_name("--condition", wanted, every)
        return wanted
    if len(common) != 1:
        got = f"none, and {len(common)} that all of them have"
        expected = "one of " + ", ".join(common) if common else "results of a common condition"
        raise InputError("--condition", got, expected)
    return common[0]


def _result(path: Path, summary: dict[str, Any]) -> _Result:
    game = summary.get("game")
    if not isinstance(game, str):
        raise InputError(
            "RESULTS", f"{str(path)!r}, which does not say of what game", "a new evaluation"
        )
    return _Result(summary["user"], facts_of_outside(game), summary)


def _measures(found: Sequence[_Result], names: Sequence[str]) -> list[Measure]:
    facts = found[0].facts
    if any(result.facts.name != facts.name for result in found):
        games = ", ".join(dict.fromkeys(result.facts.name for result in found))
        raise InputError("RESULTS", f"rounds of {games}", "rounds of one game")
    fatigue = fatigue_measures(key for key in found[0].summary if not key.endswith("_sd"))
    known = {measure.name: measure for measure in (*measures_of(facts), EXERTION, *fatigue)}
    if not names:
        return [*facts.headlines, EXERTION]
    for name in names:
        if name not in known:
            raise unknown_name("--measure", name, list(known))
    return [known[name] for name in dict.fromkeys(names)]


def _number(value: Any) -> float | None:
    if isinstance(value, (int, float)) and abs(value) < 1e100:
        return float(value)
    return None


def _figure(found: Sequence[_Result], measures: Sequence[Measure], condition: str) -> Figure:
    names = [result.user for result in found]
    panels = []
    for measure in measures:
        # One series; the names of users are below their bars.
        means = Bars("mean over rounds", names, [r.value(measure) for r in found], colour_of(5))
        layers: list[Layer] = [means]
        for place, result in enumerate(found):
            rounds = result.rounds(measure)
            # Beside each other, in their order, so that equal ones are visible.
            beside = [place + 0.5 * ((k + 0.5) / len(rounds) - 0.5) for k in range(len(rounds))]
            layers.append(Points(f"{result.user}, rounds", beside, rounds, INK, 3, key="round"))
        panels.append(Panel(measure.label, layers, y_label=measure.unit, legend=True))
    counts = {result.summary.get("episodes") for result in found}
    rounds_told = f", {counted(counts.pop() or 0, 'round')} each" if len(counts) == 1 else ""
    return Figure("chart", f"{found[0].facts.name} {condition}{rounds_told}", "", panels)
