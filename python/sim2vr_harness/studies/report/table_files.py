"""The tables of a report as files for papers: CSV, and LaTeX with booktabs."""

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from sim2vr_harness.base.files import naming
from sim2vr_harness.studies.report.numbers import summary_of, with_spread
from sim2vr_harness.studies.report.sentences import difference_words, p_words, place_of
from sim2vr_harness.studies.report.source import ReportSource

_SPECIAL = {
    **{letter: "\\" + letter for letter in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"$<$",
    ">": r"$>$",
    "±": r"$\pm$",
    "–": "--",
    "−": r"$-$",
    "×": r"$\times$",
}
_DIFFERENCE = ("estimate", "low", "high")

Rows = list[list[str]]


def write_tables(source: ReportSource, folder: Path) -> Iterator[Path]:
    """Write measures and tests as ``NAME.csv`` (all digits) and ``NAME.tex``; yield the files."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [["measure", "unit", "group", "mean", "sd", "n", "rounds"]]
    for measure in source.measures:
        for group in source.groups:
            found = summary_of(group, measure.name)
            if found is not None:
                measures_numbers = (found.mean, found.spread, found.n, found.rounds)
                rows.append(
                    [measure.name, measure.unit, group.label, *map(_text, measures_numbers)]
                )
    measures_rows = [["", *(group.label for group in source.groups)]]
    for measures_measure in source.measures:
        cells = [
            with_spread(
                summary_of(group, measures_measure.name), measures_measure, len(set(group.units))
            )
            for group in source.groups
        ]
        measures_rows.append([measures_measure.heading, *cells])
    tables = {"table_measures": (rows, measures_rows)}
    if source.comparisons:
        tests_numbers = ("statistic", "p", "p_holm", "effect")
        tests_rows = [
            [
                "measure",
                "compared",
                "within",
                "n",
                "test",
                *_DIFFERENCE,
                *tests_numbers,
                "effect_name",
            ]
        ]
        for one in source.comparisons:
            difference = dict(one.get("difference") or {})
            difference.setdefault("estimate", difference.get("mean"))
            tests_rows.append([
                str(one["measure"]),
                " - ".join(map(str, one.get("levels") or ())),
                place_of(one).strip(" ()"),
                _count(one["n"]),
                str(one["test"]),
                *(_text(difference.get(key)) for key in _DIFFERENCE),
                *(_text(one.get(key)) for key in tests_numbers),
                str(one.get("effect_name") or ""),
            ])  # fmt: skip
        tables["table_tests"] = (tests_rows, _shown_tests(source))
    for name, (numbers, shown) in tables.items():
        file = folder / f"{name}.csv"
        with naming(file), file.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows(numbers)
        yield file
        file = folder / f"{name}.tex"
        with naming(file):
            file.write_text(latex_table(shown[0], shown[1:]), encoding="utf-8")
        yield file


def latex_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a ``tabular`` with rules of the package booktabs; texts are escaped."""
    lines = [" & ".join(map(_escaped, row)) + r" \\" for row in (header, *rows)]
    return "\n".join([
        "% needs \\usepackage{booktabs}",
        rf"\begin{{tabular}}{{l{'r' * (len(header) - 1)}}}",
        r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule",
        r"\end{tabular}", "",
    ])  # fmt: skip


def _escaped(text: str) -> str:
    minus = re.sub(r"(?<!\w)-(?=\d)", "−", text)
    return "".join(_SPECIAL.get(letter, letter) for letter in minus)


def _shown_tests(source: ReportSource) -> Rows:
    rows = [["Measure", "Compared", "Difference [95 %]", "n", "Test", "p", "Effect size"]]
    for one in source.comparisons:
        measure = source.measure(str(one["measure"]))
        p = one.get("p") if one.get("p_holm") is None else one["p_holm"]
        rows.append([
            f"{measure.label if measure else one['measure']}{place_of(one)}",
            " – ".join(map(str, one.get("levels") or ())),
            difference_words(one, measure, "[]"),
            _count(one["n"]),
            str(one["test"]),
            "–" if p is None else p_words(p),
            "–" if one.get("effect") is None else f"{one['effect']:.2f}",
        ])  # fmt: skip
    return rows


def _count(n: int | Sequence[int]) -> str:
    return str(n) if isinstance(n, int) else "+".join(map(str, n))


def _text(value: float | None) -> str:
    return "" if value is None else repr(value)
