"""``sim2vr-harness study``: from a YAML file to tables and comparisons."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import TrustOption, writable_folder

__all__ = ["study"]


_Out = Annotated[
    Path | None,
    typer.Option(
        help="Its folder. What is done there is not done again.",
        show_default="studies/NAME",
        callback=writable_folder,
    ),
]
_Jobs = Annotated[
    int | None,
    typer.Option(help="Cells and trainings at a time.", show_default="one per two cores"),
]
_Report = Annotated[
    bool, typer.Option("--report/--no-report", help="Write report.html at the end.")
]
_Ray = Annotated[
    str | None,
    typer.Option(
        metavar="auto|ADDRESS", help="Let a running Ray cluster do them, one core a task."
    ),
]
_Storage = Annotated[
    str | None,
    typer.Option(
        metavar="URL",
        help="With --ray: where machines that do not see the study's folder leave results, "
        "such as s3://BUCKET/STUDY.",
    ),
]
_ReplayDamaged = Annotated[
    bool,
    typer.Option(
        "--replay-damaged", help="Play finished cells again whose files have changed since."
    ),
]


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="The study's file.")],
    out: _Out = None,
    jobs: _Jobs = None,
    report: _Report = True,
    ray: _Ray = None,
    storage: _Storage = None,
    replay_damaged: _ReplayDamaged = False,
    trust_app: TrustOption = False,
) -> None:
    """Play a study: its cells, trainings, comparisons and report.

    A study that names a program, a page, an address or Python code starts nothing before you have
    agreed. --trust-app agrees, for the study and for the users and configurations that it names.

    Examples:
        sim2vr-harness study studies/placement_search.yaml --jobs 2
        sim2vr-harness study studies/people_ablation.yaml --no-report
    """
    from rich.console import Console

    from sim2vr_harness.cli.studies import Shown, comparison_table
    from sim2vr_harness.studies import run_study

    with Shown() as shown:
        found = run_study(
            file,
            out,
            jobs=jobs,
            ray=ray,
            storage=storage,
            trust_app=trust_app,
            replay_damaged=replay_damaged,
            on_progress=shown.show,
        )
    for table in comparison_table(found.data):
        Console().print(table)
    typer.echo(f"Played: {found.played} of {found.played + found.found} cells and trainings")
    typer.echo(f"Written: {found.data.root}")
    if report:
        from sim2vr_harness.studies.report import write_report

        typer.echo(f"Written: {write_report(found.data.root).page}")
