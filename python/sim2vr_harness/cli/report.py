"""``sim2vr-harness report``: an evaluation or a study as a page for people."""

from dataclasses import dataclass
from pathlib import Path

import typer

from sim2vr_harness.base.requests import argument, option


@dataclass(frozen=True, kw_only=True)
class ReportRequest:
    """What to write a report of."""

    folder: Path = argument("FOLDER", "Folder of an evaluation or of a study.")
    out: Path | None = option(
        "The page. Figures go to figures beside it, or to FILE_figures beside a page of another "
        "name.",
        metavar="FILE.html",
        shown="FOLDER/report.html",
        place="file to write",
    )
    figures: bool = option(
        "Write page and figures as PDF, figures as PNG, tables as CSV and LaTeX.", True
    )


def report(request: ReportRequest) -> None:
    """Write a report of an evaluation or a study.

    It is one HTML file that opens offline, and a PDF, with figures as PNG and PDF beside it.

    Examples:
        sim2vr-harness report studies/my_study
        sim2vr-harness report runs/sample/evaluation/step_1000000 --out sample.html
    """
    from sim2vr_harness.studies.report import write_report

    found = write_report(request.folder, request.out, stills=request.figures)
    typer.echo(found.answer)
    for page in filter(None, (found.page, found.pdf)):
        typer.echo(f"Written: {page}")
    if found.figures:
        typer.echo(f"Written: {found.figures[0].parent} ({len(found.figures)} files)")
