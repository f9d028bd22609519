"""The page as people see it: in a browser, on a desk and on a telephone."""

import json
from pathlib import Path

from chromium import Page
from sim2vr_harness.figures.figure import INK, Figure, Line, Panel
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


def test_a_page_on_paper_has_stills_and_no_plots(strange_folder: Path) -> None:
    report = write_report(strange_folder, stills=False).page
    seen = "JSON.stringify(['.still', '.plot', 'nav', 'figure'].map(kind => [...document"
    seen += ".querySelectorAll(kind)].filter(e => e.getBoundingClientRect().height > 0).length))"
    with Page() as page:
        page.call("Emulation.setEmulatedMedia", media="print")
        page.open(report.as_uri(), 1280)
        page.wait_for("document.readyState === 'complete'")
        stills, plots, links, figures = json.loads(page.value(seen))
        assert stills == figures > 3 and plots == links == 0


def test_figures_are_drawn_whatever_their_names_are_and_as_dark_as_the_page(tmp_path: Path) -> None:
    # Names that look like markup; light text on a dark page; a range that is less than the data's.
    names, least = ("<!--<script>", "</script>"), (0.0, 0.0)
    panels = [Panel("", [Line(n, [1, 2], [1, 2], INK)], y_range=least) for n in names]
    figures, last = [Figure("a", "A", "", [each]) for each in panels], table(["<b>"], [["last<i>"]])
    (file,) = save_page(tmp_path / "page.html", "Names", "<i>", figures, [("<u>", [last])])
    with Page() as page:
        dark = [{"name": "prefers-color-scheme", "value": "dark"}]
        page.call("Emulation.setEmulatedMedia", features=dark)
        page.open(file.as_uri(), 1280)
        page.wait_for("window.reportState && reportState.drawn === 2")
        seen = "[...document.querySelectorAll('.plot')].map(f => [f.data[0].name, f.layout.yaxis])"
        shown = dict(json.loads(page.value(f"JSON.stringify({seen})")))
        assert tuple(shown) == names and all(y["range"][1] >= 2 for y in shown.values())
        assert page.value("document.querySelector('.answer').textContent") == "<i>"
        cells = page.value("document.querySelector('section').innerText").split()
        assert cells == ["<u>", "<b>", "last<i>"]
        tick = "getComputedStyle(document.querySelector('.xtick text')).fill"
        assert page.value(tick) == "rgb(230, 233, 237)"
        assert page.errors == []
