"""``sim2vr-harness study``: from a YAML file to tables and comparisons."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.errors import InputError, counted, shown
from sim2vr_harness.base.requests import TrustedApp, argument, option
from sim2vr_harness.cli.options import Checked, CheckedRun

if TYPE_CHECKING:
    from sim2vr_harness.studies.data import StudyData


@dataclass(frozen=True, kw_only=True)
class StudyRequest(TrustedApp, Checked):
    """Which study to play, and how."""

    file: Path = argument("STUDY.yaml", "The study's file, or a folder of effects.")
    out: Path | None = option(
        "Its folder. What is done there is not done again.",
        shown="studies/NAME",
        place="folder to write",
    )
    user: str | None = option(
        "With a folder of effects: who plays, such as a run.",
        metavar="USER",
        shown="those that the files name",
        names="users",
    )
    jobs: int | None = option("Cells and trainings at a time.", shown="one per two cores")
    report: bool = option("Write report.html at the end.", True)
    ray: str | None = option(
        "Let a running Ray cluster do them, one core a task.", metavar="auto|ADDRESS"
    )
    storage: str | None = option(
        "With --ray: where machines that do not see the study's folder leave results, such as "
        "s3://BUCKET/STUDY.",
        metavar="URL",
    )
    replay_damaged: bool = option(
        "Play finished cells again whose files have changed since.", False
    )
    plan: bool = option(
        "Play nothing: check the study, and print how many persons or trainings its comparisons "
        "need, from the results in --out if it has been run.",
        False,
    )
    difference: tuple[str, ...] = option(
        "With --plan: a difference that is to be found; may be repeated.",
        (),
        metavar="MEASURE=VALUE",
    )


def study(request: StudyRequest) -> int:
    """Play a study: its cells, trainings, comparisons and report.

    A study that names a program, a page, an address or Python code starts nothing before you have
    agreed. --trust-app agrees, for the study and for the users and configurations that it names.

    Examples:
        sim2vr-harness study studies/placement_search.yaml --jobs 2
        sim2vr-harness study studies/effects --user runs/pointing
    """
    from sim2vr_harness.cli.studies import Shown
    from sim2vr_harness.evaluation.expectations import of_study
    from sim2vr_harness.studies import run_study

    file, checked = request.file, CheckedRun(request, "study")
    if file.is_dir():
        return _effects(request, asked=checked.asked)
    if request.user is not None:
        expected = "a folder of effects; a study names its users in fixed.user"
        raise InputError("--user", f"it with {file}", expected)
    if request.plan or request.difference:
        # Print what the study would play, and how many units differences need.
        from rich.console import Console

        from sim2vr_harness.cli.studies import plan_tables

        if not request.plan:
            raise InputError(
                "--difference", shown(request.difference[0]), "it together with --plan"
            )
        if checked.asked:
            raise InputError("--plan", "it together with --expect or --against", "one of them")
        how = (request.file, request.out, request.difference)
        for table in plan_tables(*how, trust_app=request.trust_app):
            Console().print(table)
        return 0
    with Shown() as progress:
        found = run_study(
            file,
            request.out,
            jobs=request.jobs,
            ray=request.ray,
            storage=request.storage,
            trust_app=request.trust_app,
            replay_damaged=request.replay_damaged,
            on_progress=progress.show,
            on_plan=checked.prepare if checked.asked else None,
        )
    _tell(found, request.report)
    return checked.status(lambda: of_study(found.data.statistics["summaries"]))


def _tell(found: Any, report: bool) -> None:
    """Print what was played, and write the report."""
    _print(found.data)
    done = f"{found.played} of {found.played + found.found} cells and trainings"
    typer.echo(f"Played: {done}\nWritten: {found.data.root}")
    if report:
        from sim2vr_harness.studies.report import write_report

        typer.echo(f"Written: {write_report(found.data.root).page}")


def _effects(request: StudyRequest, *, asked: bool) -> int:
    """Measure the published effects of a folder, and print them beside the user's."""
    from rich.console import Console
    from rich.table import Table

    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.cli.studies import Shown
    from sim2vr_harness.studies.effects import HEADER, load_effects, run_effects, score, table

    folder = request.file
    for name in ("plan", "difference", "ray", "storage", "replay_damaged"):
        if getattr(request, name):
            refused = f"--{name.replace('_', '-')}"
            raise InputError(refused, f"it with the folder {folder}", "a study's file")
    if asked:
        raise InputError("--expect, --against", f"it with the folder {folder}", "a study's file")
    load_effects(folder)
    out = request.out or Path("outputs") / folder.resolve().name
    with Shown() as progress, Share("Measuring reaches") as share:
        found = run_effects(
            folder,
            out,
            user=request.user,
            jobs=request.jobs,
            trust_app=request.trust_app,
            on_progress=progress.show,
            on_reaches=share.show,
        )
    shown = Table(*HEADER[:-1])
    for row in table(found):
        shown.add_row(*row[:-1])
    Console().print(shown)
    typer.echo(f"{score(found)}\nWritten: {out / 'effects.html'}")
    return 0


def _print(data: StudyData) -> None:
    """Print comparisons, and what users were not trained for."""
    from rich.console import Console

    from sim2vr_harness.cli.studies import comparison_table

    for table in comparison_table(data):
        Console().print(table)
    for line, cells in data.unpractised.items():
        typer.echo(f"note: not trained for: {line} ({counted(len(cells), 'cell')})", err=True)
