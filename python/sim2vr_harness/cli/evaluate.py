"""``sim2vr-harness evaluate``: a user plays, and is measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.options import (
    ActionMode,
    AnyUser,
    ChangedEnvironment,
    Checked,
    CheckedRun,
    JsonOutput,
    TrustedApp,
    print_json,
    print_written,
    who_plays,
)
from sim2vr_harness.cli.progress import Share, say

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.evaluate import Evaluation, Request


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest(
    ActionMode, AnyUser, ChangedEnvironment, TrustedApp, JsonOutput, Checked, AppOptions
):
    """Who plays, what, and what is kept of it."""

    run: str | None = argument(
        "RUN",
        "A run's folder, a checkpoint, or pretrained:NAME; nothing with --user.",
        None,
        names="users",
    )
    condition: tuple[str, ...] = option(
        "A condition of the game; may be repeated.",
        (),
        metavar="NAME",
        shown="the run's evaluation.conditions, or those below",
    )
    episodes: int | None = option(
        "Rounds per condition, and person.",
        metavar="N",
        shown="the run's evaluation.episodes: 10 unless set",
    )
    people: int | None = option(
        "Let N people play who differ in size, strength, delays, noise and effort; means and "
        "deviations are then over people (docs/concepts/people.md).",
        metavar="N",
    )
    seed: int | None = option(
        "Seed of the people and of the first round, one more for each that follows.",
        metavar="N",
        shown="the run's evaluation.seed: 1 unless set",
    )
    record: bool = option("Film the first round of every condition (MP4).", False)
    log: bool = option("Keep the game's CSV logs, a folder per round.", False)
    steps: bool = option(
        "Write tables of every user step and app frame beside those of episodes and events.", True
    )
    out: Path | None = option(
        "Folder for files. Results are added to those that are there.",
        shown="RUN/evaluation/step_N",
        place="folder to write",
    )
    overwrite: bool = option("Begin with new results where there are others.", False)
    batch: int = option("Rounds played in parallel at most.", 10)


def evaluate(request: EvaluateRequest) -> int:
    """Let a user play, and measure what it does.

    Examples:
        sim2vr-harness evaluate pretrained:whacamole_constrained --condition easy
        sim2vr-harness evaluate --user still --people 3 --set env.app.game=sample
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation import evaluate as evaluation

    remote = request.remote()
    checked = CheckedRun(request, "evaluate")
    run, baseline = who_plays(request.run, request.user)
    if run is None and baseline is None:
        raise InputError("RUN", "nothing", "a run's folder, or --user still or random")
    asked = evaluation.Request(
        conditions=request.condition or None,
        episodes=request.episodes,
        seed=request.seed,
        people=request.people,
        deterministic=request.deterministic,
        record=request.record,
        log=request.log,
        steps=request.steps,
        out=request.out,
        batch=request.batch,
        overwrite=request.overwrite,
        app=remote,
        overrides=request.set_,
        trust_app=request.trust_app,
    )
    with Share("Playing") as share:
        found = evaluation.evaluate(
            run or str(baseline),
            asked,
            on_progress=share.show,
            on_plan=checked.prepare,
            on_note=lambda note: say(f"note: {note}"),
        )
    return _print(found, asked, request.json, checked)


def _print(found: Evaluation, request: Request, json: bool, checked: CheckedRun) -> int:
    """Print notes, the table or JSON, and the files."""
    from sim2vr_harness.evaluation.expectations import of_evaluation
    from sim2vr_harness.evaluation.tables import results_table
    from sim2vr_harness.evaluation.training_distribution import words_of_change

    for line in found.unpractised:
        typer.echo(f"note: not trained for: {line}", err=True)
    for line in found.problems:
        typer.echo(f"note: {line}", err=True)
    for line in found.unread[:1]:
        more = f" (and {len(found.unread) - 1} more)" if found.unread[1:] else ""
        typer.echo(f"note: not in the tables: {line}{more}", err=True)
    if json:
        print_json(found.summaries)
        return checked.status(lambda: of_evaluation(found.summaries))
    how = "deterministic" if next(iter(found.summaries.values()))["deterministic"] else "stochastic"
    title = f"After {found.step:,} user steps, {how} actions"
    trained = found.user.trained
    if trained is None:
        title = f"A user without training: {found.user.name}"
    for override in request.overrides if trained is not None else ():
        key, _, value = override.partition("=")
        title += f"\nWith {words_of_change(key.strip(), value.strip())}"
    Console().print(results_table(found.summaries, found.facts, title))
    scripts = [result.script for result in found.rounds if result.script]
    for number, steps in enumerate(scripts, start=1):
        if len(scripts) > 1:
            typer.echo(f"Round {number}:")
        for k, step in enumerate(steps, start=1):
            typer.echo(f"{k}. {step.words}")
    if trained is not None:
        typer.echo(f"Evaluated: {trained.source}")
    print_written(found.files)
    return checked.status(lambda: of_evaluation(found.summaries))
