"""``sim2vr-harness study``: from a YAML file to tables and comparisons."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.errors import InputError, counted, shown
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.requests import ChangedEnvironment, TrustedApp, argument, option
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import Checked, CheckedRun

if TYPE_CHECKING:
    from sim2vr_harness.client import GameFacts


@dataclass(frozen=True, kw_only=True)
class StudyRequest(TrustedApp, Checked, ChangedEnvironment, PageOptions):
    """Which study to play, and how."""

    file: Path | None = argument(
        "STUDY.yaml", "The study's file, or a folder of effects. Leave it out with --vary.", None
    )
    vary: tuple[str, ...] = option(
        "Compare these values of an option of the app, of a key such as "
        "env.user.noise.constant, of user or of condition; may be repeated.",
        (),
        metavar="NAME=A,B,...",
    )
    game: str | None = option("With --vary: the game.", metavar="NAME", names="games")
    people: int | None = option(
        "With --vary: virtual participants per cell.", metavar="N", shown="24", least=1
    )
    episodes: int | None = option(
        "With --vary: rounds per cell and participant.", metavar="N", shown="1", least=1
    )
    measure: tuple[str, ...] = option(
        "With --vary: what to compare; may be repeated.",
        (),
        metavar="NAME",
        shown="times, errors, score, load and endurance",
    )
    seed: int | None = option("With --vary: seed of the study.", metavar="N", shown="1")
    out: Path | None = option(
        "The study's folder. Finished cells in it are not played again.",
        shown="studies/NAME",
        place="folder to write",
    )
    user: str | None = option(
        "With --vary or a folder of effects: a trained user, or a script such as "
        "'press lit by ray', that plays.",
        metavar="USER",
        shown="those that the files name",
        names="players",
    )
    jobs: int | None = option(
        "Cells and trainings that run at a time.", shown="one per two cores, at least two"
    )
    report: bool = option("Write report.html and report.pdf at the end.", True)
    ray: str | None = option(
        "Play on a running Ray cluster, one core per task.", metavar="auto|ADDRESS"
    )
    storage: str | None = option(
        "With --ray: where machines that do not see the study's folder leave results, such as "
        "s3://BUCKET/STUDY.",
        metavar="URL",
    )
    replay_damaged: bool = option(
        "Play cells again whose files were changed after they finished.", False
    )
    plan: bool = option(
        "Play nothing: check the study, and print how many participants or trainings its "
        "comparisons need, from the results in --out if it has been run.",
        False,
    )
    difference: tuple[str, ...] = option(
        "With --plan: a difference that the study should find; may be repeated.",
        (),
        metavar="MEASURE=VALUE",
    )


def study(request: StudyRequest) -> int:
    """Compare designs: play every cell of a study, and write the report.

    With --vary the command writes the study's file. A file of someone else that names a program, a
    page, an address or Python code is played with --trust-app only.

    Examples:
        sim2vr-harness study --page menu --user "press lit" --vary size=0.04,0.06
        sim2vr-harness study studies/effects --user runs/pointing
    """
    from sim2vr_harness.cli.studies import Shown
    from sim2vr_harness.evaluation.expectations import of_study
    from sim2vr_harness.studies import run_study

    checked = CheckedRun(request, "study")
    file, jobs = request.file, request.jobs
    if file is None:
        from sim2vr_harness.base.cores import available

        # Many short rounds, and no training that wants several cores.
        file, jobs = _made(request), available() if jobs is None else jobs
    else:
        for name in ("vary", "overrides", "page", "game", "people", "episodes", "measure", "seed"):
            if getattr(request, name) not in (None, ()):
                field = "--set" if name == "overrides" else f"--{name}"
                raise InputError(field, f"it with {file}", "it with --vary alone; a file says all")
    if file.is_dir():
        return _effects(request, asked=checked.asked)
    if request.user is not None and request.file is not None:
        expected = "a folder of effects; a study names its users in fixed.user"
        raise InputError("--user", f"it with {file}", expected)
    if request.plan or request.difference:
        # Print what the study would play, and how many units differences need.
        from sim2vr_harness.cli.studies import plan_tables, print_tables

        if not request.plan:
            raise InputError(
                "--difference", shown(request.difference[0]), "it together with --plan"
            )
        if checked.asked:
            raise InputError("--plan", "it together with --expect or --against", "one of them")
        how = (file, request.out, request.difference)
        print_tables(plan_tables(*how, trust_app=request.trust_app))
        return 0
    with Shown() as progress:
        found = run_study(
            file,
            request.out,
            jobs=jobs,
            ray=request.ray,
            storage=request.storage,
            trust_app=request.trust_app,
            replay_damaged=request.replay_damaged,
            on_progress=progress.show,
            on_plan=checked.prepare if checked.asked else None,
        )
    _tell(found, request.report)
    return checked.status(lambda: of_study(found.data.statistics["summaries"]))


def _made(request: StudyRequest) -> Path:
    """Write the file of the study that the options mean, beside its folder, and return it."""
    import yaml

    from sim2vr_harness.play.users import SimulatedUser
    from sim2vr_harness.policies.scripted import is_script
    from sim2vr_harness.studies.config import parse_study

    if not request.vary:
        raise InputError("STUDY.yaml", "nothing", "a study's file, or --vary NAME=A,B")
    fixed, factors = _fixed(request), {}
    for text in request.vary:
        name, equals, values = text.partition("=")
        levels = [_value("--vary", value) for value in values.split(",") if value.strip()]
        if not equals or len(levels) < 2:
            raise InputError("--vary", repr(text), "NAME=A,B with two values or more")
        key = name if "." in name or name in ("user", "condition") else f"env.app.options.{name}"
        fixed.pop(key, None)
        factors[name.rpartition(".")[2]] = {"key": key, "levels": levels}
    users = [
        one for factor in factors.values() if factor["key"] == "user" for one in factor["levels"]
    ]
    who = str(users[0]) if users else request.user
    if who is None:
        raise InputError("--user", "nothing", "who plays, such as 'press lit by ray'")
    user = SimulatedUser.find(who)
    overrides = [f"{k}={json.dumps(v)}" for k, v in fixed.items() if k.startswith("env.")]
    facts = user.facts(user.env(None, overrides).facts)
    out = request.out or Path("studies") / Path(facts.name).stem
    study = {
        "name": "".join(c if c.isalnum() or c in "-_" else "_" for c in out.name),
        "title": f"Effects of {' and '.join(factors)} in {facts.name} on '{who}'",
        "fixed": fixed,
        "factors": factors,
        "people": request.people or 24,
        "episodes": request.episodes or 1,
        "seed": 1 if request.seed is None else request.seed,
        "measures": list(request.measure) or _measures(facts, scripted=is_script(who)),
        "comparisons": [{"factor": name, "by": []} for name in factors],
    }
    parse_study(study)
    file = out.parent / f"{out.name}.yaml"
    text = yaml.safe_dump(study, sort_keys=False, allow_unicode=True, width=100)
    failed = (out / "cells").is_dir() and not any((out / "cells").glob("[!.]*"))
    if not failed and file.exists() and file.read_text(encoding="utf-8") != text:
        expected = f"another --out, or: sim2vr-harness study {file} --out {out}"
        raise InputError("--out", f"{str(out)!r}, beside which {file} is another study", expected)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, text.encode())
    typer.echo(f"The study: {file}", err=True)
    return file


def _fixed(request: StudyRequest) -> dict[str, Any]:
    """Return what is the same in all cells of the study that the options mean."""
    from sim2vr_harness.envs.config import AppConfig
    from sim2vr_harness.runs.trust import remember

    app = request.remote()
    if request.page is not None and request.task is None:
        page = Path(app["page"])
        beside = (page if page.is_dir() else page.parent) / "task.yaml"
        app |= {"task": str(beside)} if beside.is_file() else {}
    if request.game is not None:
        app |= {"game": request.game}
    if app:
        remember(AppConfig(**app), Path())  # typed here, it needs no --trust-app in the file
    options = app.pop("options", {})
    fixed: dict[str, Any] = {} if request.user is None else {"user": request.user}
    fixed |= {f"env.app.{key}": value for key, value in app.items() if value is not None}
    fixed |= {f"env.app.options.{key}": value for key, value in options.items()}
    for change in request.overrides:
        key, equals, value = change.partition("=")
        if not equals:
            raise InputError("--set", repr(change), "KEY=VALUE")
        fixed[key.strip()] = _value("--set", value)
    return fixed


def _value(field: str, text: str) -> Any:
    import yaml

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(field, repr(text), "a value in YAML, without commas") from error


def _measures(facts: GameFacts, *, scripted: bool) -> list[str]:
    """Return times and errors of the app, else those of a script; score, load and endurance."""
    from sim2vr_harness.play.round import measures_of
    from sim2vr_harness.play.users import PERSON_MEASURES, SCRIPT_MEASURES

    own = [one for one in facts.scalars if one not in SCRIPT_MEASURES]
    time, misses = ([one.name] if scripted else [] for one in PERSON_MEASURES)
    wanted = [
        *([one.name for one in own if one.unit == "s"] or time),
        *([one.name for one in own if one.rate_with is not None] or misses),
        *([facts.score] if facts.score else []),
        "max_fatigued",
        "exertion.nicer_right",
    ]
    known = [one.name for one in measures_of(facts)]
    return [name for name in dict.fromkeys(wanted) if name in known]


def _tell(found: Any, report: bool) -> None:
    """Print comparisons, what users were not trained for and what was played; write the report."""
    from sim2vr_harness.cli.studies import comparison_table, print_tables

    print_tables(comparison_table(found.data))
    for line, cells in found.data.unpractised.items():
        typer.echo(f"note: not trained for: {line} ({counted(len(cells), 'cell')})", err=True)
    done = f"{found.played} of {found.played + found.found} cells and trainings"
    typer.echo(f"Played: {done}\nWritten: {found.data.root}")
    if report:
        from sim2vr_harness.studies.report import write_report

        written = write_report(found.data.root)
        pages = f"{written.page}{f', {written.pdf}' if written.pdf else ''}"
        typer.echo(f"Written: {pages}\n{written.answer}")


def _effects(request: StudyRequest, *, asked: bool) -> int:
    """Measure the published effects of a folder, and print them beside the user's."""
    from rich.console import Console
    from rich.table import Table

    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.cli.studies import Shown
    from sim2vr_harness.studies.effects import HEADER, load_effects, run_effects, score, table

    folder = request.file
    assert folder is not None  # else a study is made
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
