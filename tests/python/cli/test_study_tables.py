"""The tables that ``study`` prints: nothing is cut, nothing is empty, digits follow the spread."""

from types import SimpleNamespace
from typing import Any

from rich.console import Console

from sim2vr_harness.cli.studies import comparison_table

_LONG = "fatigue.most_fatigued_shoulder_muscle_of_the_dominant_arm"


def _summary(level: str, measure: str, mean: float, sd: float | None) -> dict[str, Any]:
    ends = (None, None) if sd is None else (mean - 2 * sd, mean + 2 * sd)
    return {
        "levels": {"placement": level}, "measure": measure, "unit": "person", "n": 6,
        "mean": mean, "sd": sd, "low": ends[0], "high": ends[1],
    }  # fmt: skip


def _compared(
    measure: str, estimate: float, low: float, high: float, **more: Any
) -> dict[str, Any]:
    difference = {"mean": estimate, "estimate": estimate, "low": low, "high": high}
    return {
        "measure": measure, "levels": ["low", "high"], "by": {}, "test": "paired-t", "n": 6,
        "p": 0.0026, "p_holm": 0.0077, "effect": -2.277, "effect_name": "Cohen's d", "note": None,
        "alternative": "two-sided", "refused": None, "difference": difference, **more,
    }  # fmt: skip


def _printed(summaries: list[Any], results: list[Any], width: int = 80) -> str:
    measures = [{"name": "still", "digits": 3}]
    data: Any = SimpleNamespace(
        about={"measures": measures}, statistics={"summaries": summaries, "results": results}
    )
    console = Console(width=width)
    with console.capture() as capture:
        for part in comparison_table(data):
            console.print(part)
    return capture.get()


def test_differences_stand_with_their_interval_in_80_columns() -> None:
    summaries = [
        *(_summary(level, "hit_rate", 0.66879, 0.04919) for level in ("low", "high")),
        *(_summary(level, "effort", 16.6029, 6.9677) for level in ("low", "high")),
        *(_summary(level, _LONG, 0.0121, 0.00202) for level in ("low", "high")),
    ]
    results = [
        _compared("hit_rate", -0.13700, -0.20015, -0.07385),
        _compared("effort", -1.23815, -2.26877, -0.20752),
        _compared(_LONG, -0.0104, -0.0155, -0.0053),
    ]
    printed = _printed(summaries, results)
    assert max(map(len, printed.splitlines())) <= 80
    assert "-0.137 [-0.200, -0.074]" in printed and "-1.2 [-2.3, -0.2]" in printed
    assert "0.669" in printed and "0.6688" not in printed  # SD 0.049: three decimals
    assert "in game" not in printed and "…" not in printed
    assert "Comparisons (paired-t)" in printed and "Effect: Cohen's d." in printed
    for piece in ("fatigue.most_", "fatigued_", "shoulder_muscle_", "of_the_dominant_", "arm"):
        assert printed.count(piece) >= 3, piece  # two levels and a comparison


def test_a_spread_of_rounding_errors_gives_plain_numbers() -> None:
    printed = _printed([_summary("low", "still", 3.3310001, 9.59e-16)], [])
    assert "3.331" in printed and "e-16" not in printed and "0.000" in printed


def test_columns_appear_where_they_say_something() -> None:
    both = [
        _compared("effort", -1.0, -2.0, -0.5, by={"game": "easy"}),
        _compared("effort", -1.0, -2.0, -0.5, test="wilcoxon", by={"game": "hard"}, n=[6, 5]),
    ]
    printed = _printed([], both)
    assert "Comparisons (paired-t)" in printed and "Comparisons (wilcoxon)" in printed
    assert "in game easy" in printed and "6+5" in printed
    assert max(map(len, printed.splitlines())) <= 80
    refused = _compared("effort", 0.0, 0.0, 0.0, p=None, p_holm=None, effect=None, difference=None,
                        refused="n = 1: no p value")  # fmt: skip
    printed = _printed([], [refused])
    assert "refused" in printed and "effect" not in printed and "difference" not in printed
    assert "note: n = 1: no p value" in printed


def test_effects_of_a_mixed_model_have_a_row_each() -> None:
    effects = [
        {"name": name, "estimate": 0.25, "error": 0.1, "low": 0.05, "high": 0.45, "p": 0.014}
        for name in ("Intercept", "placement[high]", "placement[high]:game[hard]")
    ]
    printed = _printed([], [_compared("score", 0, 0, 0, test="mixed", effects=effects, p=None)])
    assert printed.count("0.250 [0.050, 0.450]") == 2 and "Intercept" not in printed
    assert max(map(len, printed.splitlines())) <= 80
