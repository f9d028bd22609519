"""``sim2vr-harness evaluate``: a user plays, and is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from sim2vr_harness.base.requests import argument
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.options import (
    AnyUser,
    Checked,
    CheckedRun,
    JsonOutput,
    print_json,
    print_written,
    who_plays,
)
from sim2vr_harness.cli.progress import Share, say
from sim2vr_harness.evaluation.request import Request

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.evaluate import Evaluation


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest(Request, AnyUser, JsonOutput, Checked, AppOptions):
    """Who plays, what, and what is kept of it."""

    run: str | None = argument(
        "RUN",
        "A run's folder, a checkpoint, or pretrained:NAME. Leave it out with --user.",
        None,
        names="users",
    )


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
    asked = replace(request, app=remote)
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
