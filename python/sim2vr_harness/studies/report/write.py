"""Writes the report of an evaluation or a study: a page, and its figures for papers."""

from dataclasses import dataclass
from pathlib import Path

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.figures.matplotlib_backend import write_stills
from sim2vr_harness.games.published import published_of
from sim2vr_harness.studies.report.body import (
    body_pictures,
    body_with,
    figures_of_body,
    load_of,
    trained_users_of,
)
from sim2vr_harness.studies.report.effort import figures_of_effort
from sim2vr_harness.studies.report.media import examples_of
from sim2vr_harness.studies.report.methods import methods_of, played_by
from sim2vr_harness.studies.report.outcomes import figures_of_outcomes
from sim2vr_harness.studies.report.page import Content, page_of
from sim2vr_harness.studies.report.search import figures_of_search, search_sentences
from sim2vr_harness.studies.report.sentences import sentences_of
from sim2vr_harness.studies.report.source import read_source
from sim2vr_harness.studies.report.strategy import figures_of_strategy
from sim2vr_harness.studies.report.table_files import write_tables

PAGE = "report.html"
"""In the folder of the evaluation or study."""


@dataclass(frozen=True)
class StudyReport:
    """What was written.

    Attributes:
        page: The HTML file.
        figures: PNG and PDF files, and tables as CSV and LaTeX, in the folder ``figures`` beside
            ``report.html``, ``NAME_figures`` beside a page of another name.
    """

    page: Path
    figures: tuple[Path, ...]


def write_report(
    folder: str | Path, out: str | Path | None = None, *, stills: bool = True
) -> StudyReport:
    """Write the report of an evaluation or a study.

    Args:
        folder: Of the evaluation or the study.
        out: The HTML file; None: ``report.html`` in the folder.
        stills: Whether to write figures as PNG and PDF, too.

    Raises:
        InputError: There are no tables, or ``out`` is no HTML file.
    """
    page = Path(folder) / PAGE if out is None else Path(out)
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError("--out", repr(str(page)), "a file name that ends in .html")
    source = read_source(folder)
    duration_s = max(float(group.episodes["duration_s"].median()) for group in source.groups)
    # No one else has played what a search has made of the game.
    known = published_of(source.facts.name if source.search is None else "")
    published = known.beside_rounds_of(duration_s)
    loads = [load_of(group) for group in source.groups]
    body = body_with([own for _, _, own in trained_users_of(source)], loads)
    figures = [
        *figures_of_search(source),
        *figures_of_outcomes(source, published),
        *figures_of_body(source, loads, body),
        *figures_of_strategy(source, published),
        *figures_of_effort(source),
    ]
    users = played_by(source)
    content = Content(
        source,
        published,
        [*search_sentences(source), *sentences_of(source, published)],
        figures,
        body_pictures(source.groups, loads, body),
        examples_of(source.groups, source.root),
        users,
        methods_of(source, users),
    )
    write_atomically(page, page_of(content).encode())
    # Two reports in a folder do not share their figures.
    name = "figures" if page.name == PAGE else f"{page.stem}_figures"
    beside = page.with_name(name)
    drawn = [*write_stills(figures, beside), *write_tables(source, beside)] if stills else []
    return StudyReport(page, tuple(drawn))
