"""Figures and tables of a report: on its page and as files for papers."""

import contextlib
import csv
import re
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from sim2vr_harness.figures.figure import (
    Figure,
    Line,
    Panel,
)
from sim2vr_harness.figures.matplotlib_backend import write_stills
from sim2vr_harness.games.published import published_of
from sim2vr_harness.studies.report.source import ReportSource
from sim2vr_harness.studies.report.strategy import figures_of_strategy
from sim2vr_harness.studies.report.write import write_tables

NOBODY = published_of("strange")


def test_figures_are_files_for_papers_and_the_same_bytes_again(
    source: ReportSource, tmp_path: Path
) -> None:
    figures = list(figures_of_strategy(source, NOBODY))[:2]
    first = write_stills(figures, tmp_path / "a")
    again = write_stills(figures, tmp_path / "b")
    assert {file.suffix for file in first} == {".png", ".pdf"} and len(first) == 2 * len(figures)
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes() != b""


def _pdf_text(file: Path) -> bytes:
    """A PDF's objects with their streams inflated."""
    raw = file.read_bytes()
    found = [raw]
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", raw, re.S):
        with contextlib.suppress(zlib.error):
            found.append(zlib.decompressobj().decompress(stream))
    return b"\n".join(found)


def test_pdfs_have_true_type_fonts_and_the_width_of_columns(tmp_path: Path) -> None:
    line = Line("a", [0, 1], [0, 1], "#000000")
    narrow = Figure("narrow", "One", "", [Panel("", [line], "time (s)", "x", legend=True)])
    broad = Figure("broad", "Two", "", [Panel("", [line]), Panel("", [line])])
    write_stills([narrow, broad], tmp_path)
    for name, points in (("narrow", 252.0), ("broad", 518.4)):  # 3.5 and 7.2 inches
        text = _pdf_text(tmp_path / f"{name}.pdf")
        assert b"/CIDFontType2" in text and b"/Type3" not in text
        box = re.search(rb"/MediaBox \[ ?([\d. ]+?) ?\]", text)
        assert box is not None and float(box.group(1).split()[2]) == pytest.approx(points)


def test_tables_for_papers_have_all_digits_and_balanced_latex(
    source: ReportSource, tmp_path: Path
) -> None:
    result = {
        "measure": "sparks", "levels": ["a_b", "c"], "by": {}, "test": "paired-t", "n": 6,
        "p": 0.00255, "p_holm": 0.00766, "effect": -2.277, "effect_name": "d", "statistic": -5.5,
        "difference": {"mean": -0.137003, "low": -0.2, "high": -0.07},
    }  # fmt: skip
    files = list(write_tables(replace(source, comparisons=[result]), tmp_path))
    assert [file.name for file in files] == [
        *("table_measures.csv", "table_measures.tex", "table_tests.csv", "table_tests.tex")
    ]
    rows = list(csv.DictReader(files[2].read_text().splitlines()))
    assert (rows[0]["estimate"], rows[0]["p_holm"]) == ("-0.137003", "0.00766")
    means = {row["group"] for row in csv.DictReader(files[0].read_text().splitlines())}
    assert means == {group.label for group in source.groups}
    for file in (files[1], files[3]):
        text = file.read_text()
        assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 1
        body = text.partition(r"\toprule")[2].partition(r"\bottomrule")[0]
        columns = re.search(r"\{(l?r*)\}\n", text)
        assert columns is not None
        for line in body.replace("\\midrule\n", "").strip().splitlines():
            assert line.endswith(r" \\")
            assert len(re.findall(r"(?<!\\)&", line)) == len(columns.group(1)) - 1
    assert r"a\_b" in files[3].read_text() and "$-$0.1" in files[3].read_text()
