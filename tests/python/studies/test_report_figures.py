"""Figures and tables of a report: on its page and as files for papers."""

import contextlib
import csv
import re
import warnings
import zlib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from sim2vr_harness.client import Measure
from sim2vr_harness.figures import matplotlib_backend
from sim2vr_harness.figures.figure import (
    Bars,
    Figure,
    Heat,
    Line,
    Panel,
    Points,
    colour_of,
    keys_of,
)
from sim2vr_harness.figures.matplotlib_backend import write_stills
from sim2vr_harness.figures.plotly_backend import plotly_of
from sim2vr_harness.games.published import published_of
from sim2vr_harness.studies.report import write
from sim2vr_harness.studies.report.body import _view_of
from sim2vr_harness.studies.report.source import Group, ReportSource
from sim2vr_harness.studies.report.strategy import figures_of_strategy
from sim2vr_harness.studies.report.write import figures_of_outcomes, write_tables
from sim2vr_harness.users import load_body
from sim2vr_harness.users.rendering import OrbitView

NOBODY = published_of("strange")


def test_many_groups_have_names_below_and_colours_of_their_own(tmp_path: Path) -> None:
    names = [f"group {i}" for i in range(15)]
    lines = [Line(name, [0, 1], [0, i], colour_of(i)) for i, name in enumerate(names)]
    bars = Panel("", [Bars("share", names, [0.5] * 15, "#000000")])
    panel = Panel("", lines, legend=True)
    assert len({colour for _, colour in keys_of(panel)}) == 15
    assert bars.crowded and not panel.crowded
    layout = plotly_of(bars)["layout"]
    assert layout["yaxis"]["ticktext"] == names and layout["height"] > 15 * 30, "a line for each"
    numbers = plotly_of(Panel("", [Bars("share", ["0.001", "0.05"], [0.5, 0.5], "#000000")]))
    assert numbers["layout"]["xaxis"]["type"] == "category", "no axis of numbers"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_stills([Figure("many", "Many", "", [panel, bars])], tmp_path)
    with Image.open(tmp_path / "many.png") as many:
        write_stills(
            [Figure("few", "Few", "", [Panel("", lines[:3], legend=True), bars])], tmp_path
        )
        with Image.open(tmp_path / "few.png") as few:
            assert many.height > few.height, "the names have lines of their own"


def test_figures_are_files_for_papers_and_the_same_bytes_again(
    source: ReportSource, tmp_path: Path
) -> None:
    figures = list(figures_of_strategy(source, NOBODY))
    first = write_stills(figures, tmp_path / "a")
    again = write_stills(figures, tmp_path / "b")
    assert {file.suffix for file in first} == {".png", ".pdf"} and len(first) == 2 * len(figures)
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes() != b""


def test_numbers_in_cells_stand_out() -> None:
    """Black on what is pale, white on what is dark (WCAG contrast 4.2 or more of both)."""
    heat = Heat([[0.0, 0.6, 1.0, None]], list("abcd"), ["r"], 0.0, 1.0)
    pale, dark = plotly_of(Panel("", [heat]))["data"]
    assert (pale["text"], pale["textfont"]) == ([["0.00", "0.60", "", ""]], {"color": "#000"})
    assert (dark["text"], dark["textfont"]) == ([["", "", "1.00", ""]], {"color": "#fff"})


def test_a_raised_hand_is_in_the_picture() -> None:
    """The picture's upper edge lies above the hand, the lower one where it was."""
    body = load_body("mobl_arms_wrist")
    own = np.array(body.model.qpos0, dtype=np.float64)
    assert _view_of(body, [own]) == "arm"
    raised = own.copy()
    raised[body.model.joint("shoulder_elv").qposadr[0]] = np.radians(120.0)
    view = _view_of(body, [own, raised])
    assert isinstance(view, OrbitView)
    data = mujoco.MjData(body.model)
    data.qpos[:] = raised
    mujoco.mj_kinematics(body.model, data)
    half = view.distance_m * np.tan(np.radians(body.model.vis.global_.fovy / 2))
    assert view.towards_m[2] + half > data.xpos[:, 2].max() + 0.1
    assert view.towards_m[2] - half == pytest.approx(0.39)


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


def test_every_mark_has_a_legend_and_nothing_is_cut(source: ReportSource) -> None:
    (measures,) = [f for f in figures_of_outcomes(source, NOBODY) if f.key == "measures"]
    drawn = matplotlib_backend._drawn(measures)
    (legend,) = drawn.legends
    named = [text.get_text() for text in legend.get_texts()]
    assert "round" in named and any(name.startswith("mean") for name in named)
    points = Points("a", [0, 1], [0.9, 0.5], "#000000", spread=[0.4, 0.1], key="mean ± SD")
    ticks = ["a long name", "another long name"]
    figure = Figure("cut", "", "", [Panel("", [points], ticks=ticks, y_range=(0.0, 1.0))])
    (axes,) = matplotlib_backend._drawn(figure).axes
    assert axes.get_ylim()[0] == 0.0 and axes.get_ylim()[1] >= 1.3
    labels = axes.get_xticklabels()
    assert all(label.get_rotation() == 0.0 for label in labels)
    many = Panel("", [Bars("share", [f"group {i}" for i in range(15)], [0.5] * 15, "#000000")])
    (axes,) = matplotlib_backend._drawn(Figure("many", "", "", [many])).axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == [f"group {i}" for i in range(15)]


def test_values_of_one_person_are_joined() -> None:
    episodes = pd.DataFrame({"unit": ["p1", "p2"], "score": [1.0, 3.0]})
    groups = [Group(name, "u", "c", episodes, episodes, ()) for name in ("a", "b")]
    lines = write._pairs(groups, Measure("score", "Score"))
    assert [list(line.y) for line in lines] == [[1.0, 1.0], [3.0, 3.0]]
    assert [list(line.x) for line in lines] == [[-0.125, 0.875], [0.125, 1.125]]
    other = Group("b", "u", "c", episodes.assign(unit=["q1", "q2"]), episodes, ())
    assert write._pairs([groups[0], other], Measure("score", "Score")) == []


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
        lines = [line for line in body.strip().splitlines() if line != r"\midrule"]
        for line in lines:
            assert line.endswith(r" \\") and not line.endswith(r"\\\\")
            assert len(re.findall(r"(?<!\\)&", line)) == len(columns.group(1)) - 1
            assert line.count("$") % 2 == 0 and line.count("{") == line.count("}")
    assert r"a\_b" in files[3].read_text() and "$-$0.1" in files[3].read_text()
