"""``sim2vr-harness study``: from a YAML file to tables and comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim2vr_harness.base.errors import InputError, counted, shown
from sim2vr_harness.cli.options import (
    AgainstOption,
    CheckedRun,
    ExpectOption,
    JunitOption,
    TrustOption,
    known_users,
    writable_folder,
)

if TYPE_CHECKING:
    from sim2vr_harness.studies.data import StudyData

_File = Annotated[
    Path, typer.Argument(metavar="STUDY.yaml", help="The study's file, or a folder of effects.")
]
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


_User = Annotated[
    str | None,
    typer.Option(
        autocompletion=known_users,
        metavar="USER",
        help="With a folder of effects: who plays, such as a run.",
        show_default="those that the files name",
    ),
]
_Plan = Annotated[
    bool,
    typer.Option(
        "--plan",
        help="Play nothing: check the study, and print how many persons or trainings its "
        "comparisons need, from the results in --out if it has been run.",
    ),
]
_Difference = Annotated[
    list[str] | None,
    typer.Option(
        "--difference",
        metavar="MEASURE=VALUE",
        help="With --plan: a difference that is to be found; may be repeated.",
    ),
]


def study(
    file: _File,
    out: _Out = None,
    user: _User = None,
    jobs: _Jobs = None,
    report: _Report = True,
    ray: _Ray = None,
    storage: _Storage = None,
    replay_damaged: _ReplayDamaged = False,
    plan: _Plan = False,
    difference: _Difference = None,
    trust_app: TrustOption = False,
    expect: ExpectOption = None,
    against: AgainstOption = None,
    junit: JunitOption = None,
) -> int:
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

    checked = CheckedRun(expect, against, junit, "study")
    if file.is_dir():
        unused = {"--plan": plan, "--difference": difference, "--ray": ray,
                  "--storage": storage, "--replay-damaged": replay_damaged,
                  "--expect, --against": checked.asked}  # fmt: skip
        return _effects(file, out, user, jobs, [name for name in unused if unused[name]], trust_app)
    _refuse_user(file, user)
    if plan or difference:
        return _show_plan(file, out, difference or (), checked, plan=plan, trust_app=trust_app)
    with Shown() as progress:
        # fmt: off
        found = run_study(
            file, out, jobs=jobs, ray=ray, storage=storage, trust_app=trust_app,
            replay_damaged=replay_damaged, on_progress=progress.show,
            on_plan=checked.prepare if checked.asked else None,
        )
        # fmt: on
    _tell(found, report)
    return checked.status(lambda: of_study(found.data.statistics["summaries"]))


def _refuse_user(file: Path, user: str | None) -> None:
    if user is not None:
        expected = "a folder of effects; a study names its users in fixed.user"
        raise InputError("--user", f"it with {file}", expected)


def _tell(found: Any, report: bool) -> None:
    """Print what was played, and write the report."""
    _print(found.data)
    done = f"{found.played} of {found.played + found.found} cells and trainings"
    typer.echo(f"Played: {done}\nWritten: {found.data.root}")
    if report:
        from sim2vr_harness.studies.report import write_report

        typer.echo(f"Written: {write_report(found.data.root).page}")


def _effects(
    folder: Path,
    out: Path | None,
    user: str | None,
    jobs: int | None,
    unused: Sequence[str],
    trust_app: bool,
) -> int:
    """Measure the published effects of a folder, and print them beside the user's."""
    from rich.console import Console
    from rich.table import Table

    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.cli.studies import Shown
    from sim2vr_harness.studies.effects import HEADER, load_effects, run_effects, score, table

    if unused:
        raise InputError(unused[0], f"it with the folder {folder}", "a study's file")
    load_effects(folder)
    out = out or Path("outputs") / folder.resolve().name
    with Shown() as progress, Share("Measuring reaches") as share:
        found = run_effects(
            folder, out, user=user, jobs=jobs, trust_app=trust_app,
            on_progress=progress.show, on_reaches=share.show,
        )  # fmt: skip
    shown = Table(*HEADER[:-1])
    for row in table(found):
        shown.add_row(*row[:-1])
    Console().print(shown)
    typer.echo(f"{score(found)}\nWritten: {out / 'effects.html'}")
    return 0


def _show_plan(
    file: Path,
    out: Path | None,
    difference: Sequence[str],
    checked: CheckedRun,
    *,
    plan: bool,
    trust_app: bool,
) -> int:
    """Print what the study would play, and how many units differences need."""
    from rich.console import Console

    from sim2vr_harness.cli.studies import plan_tables

    if not plan:
        raise InputError("--difference", shown(difference[0]), "it together with --plan")
    if checked.asked:
        raise InputError("--plan", "it together with --expect or --against", "one of them")
    for table in plan_tables(file, out, difference, trust_app=trust_app):
        Console().print(table)
    return 0


def _print(data: StudyData) -> None:
    """Print comparisons, and what users were not trained for."""
    from rich.console import Console

    from sim2vr_harness.cli.studies import comparison_table

    for table in comparison_table(data):
        Console().print(table)
    for line, cells in data.unpractised.items():
        typer.echo(f"note: not trained for: {line} ({counted(len(cells), 'cell')})", err=True)
