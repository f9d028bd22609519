"""``sim2vr-harness report``: an evaluation or a study as a page for people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import writable_file


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Of an evaluation or of a study.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html",
            help="The page. Figures go to figures beside it, or to FILE_figures beside a page of "
            "another name.",
            show_default="FOLDER/report.html",
            callback=writable_file,
        ),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option(
            "--figures/--no-figures",
            help="Write figures as PNG and PDF, and tables as CSV and LaTeX.",
        ),
    ] = True,
) -> None:
    """Write a report of an evaluation or a study.

    It is one HTML file that opens offline, with figures as PNG and PDF beside it.

    Examples:
        sim2vr-harness report studies/my_study
        sim2vr-harness report runs/sample/evaluation/step_1000000 --out sample.html
    """
    from sim2vr_harness.studies.report import write_report

    found = write_report(folder, out, stills=figures)
    typer.echo(f"Written: {found.page}")
    if found.figures:
        typer.echo(f"Written: {found.figures[0].parent} ({len(found.figures)} files)")
