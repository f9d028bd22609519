"""The page as people see it: in a browser, on a desk and on a telephone."""

import json
from pathlib import Path

from chromium import Page
from sim2vr_harness.figures.html import save_page, table
from sim2vr_harness.studies.report import write_report
from webxr_pages import NEEDS_BROWSER

pytestmark = NEEDS_BROWSER

CUT_OFF = """JSON.stringify([...document.querySelectorAll('.plot')].flatMap(plot => {
  const box = plot.getBoundingClientRect();
  return [...plot.querySelectorAll('text')]
    .filter(text => text.textContent.trim() && getComputedStyle(text).visibility !== 'hidden')
    .map(text => [text.textContent, text.getBoundingClientRect()])
    .filter(([, r]) => r.width > 0 && (r.left < box.left - 1 || r.right > box.right + 1
                                       || r.top < box.top - 1 || r.bottom > box.bottom + 1))
    .map(([text]) => plot.id + ': ' + text);
}))"""
"""Texts of figures that reach over the figure's edge."""


def test_every_figure_is_drawn_and_nothing_is_cut_off(strange_folder: Path) -> None:
    report = write_report(strange_folder, stills=False).page
    with Page() as page:
        for width in (1280, 390):
            page.open(report.as_uri(), width)
            page.wait_for("window.reportState && reportState.expected > 0")
            page.wait_for("reportState.drawn + reportState.errors.length >= reportState.expected")
            state = page.value("reportState")
            assert state["errors"] == [] and page.errors == []
            there = page.value("document.querySelectorAll('.plot .svg-container').length")
            assert state["drawn"] == state["expected"] == there
            assert page.value("document.documentElement.scrollWidth") <= width
            assert json.loads(page.value(CUT_OFF)) == []
        hidden = (  # a key hides and shows its lines
            "(() => { const key = document.querySelector('.keys button'); key.click(); "
            "const plot = key.closest('.panel').querySelector('.plot'); "
            "return plot.data.filter(t => t.visible === false).length; })()"
        )
        assert page.value(hidden) > 0
        assert page.value(hidden) == 0


def test_a_small_page_draws_figures_whatever_their_names_are(tmp_path: Path) -> None:
    """As ``audit`` writes them, with names that look like markup, in figures and in words."""
    from plotly import graph_objects as go

    names = ("<!--<script>", "</script>")
    figures = [go.Figure(go.Scatter(x=[1, 2], y=[1, 2], name=name)) for name in names]
    file = save_page(
        tmp_path / "page.html", "Names", ["first", *figures, table(["<b>"], [["last<i>"]])]
    )
    with Page() as page:
        page.open(file.as_uri(), 1280)
        page.wait_for("document.querySelectorAll('.figure .svg-container').length === 2")
        plots = "[...document.querySelectorAll('.js-plotly-plot')]"
        drawn = f"JSON.stringify({plots}.map(f => f.data[0].name))"
        assert json.loads(page.value(drawn)) == list(names)
        assert page.value("document.body.lastElementChild.textContent").split() == [
            "<b>",
            "last<i>",
        ]
        assert page.errors == []
