"""``sim2vr-harness evaluate``: a user plays, and is measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import AppOptions, as_overrides
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
    from sim2vr_harness.policies.scripted import StepOutcome


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
    """Let a trained user play, and measure what it does.

    Examples:
        sim2vr-harness evaluate pretrained:whacamole_constrained --condition easy
        sim2vr-harness evaluate runs/sample --episodes 20 --record
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation import evaluate as evaluation

    remote = request.remote()
    checked = CheckedRun(request, "evaluate")
    run, baseline = who_plays(request.run, request.user)
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
    if baseline is not None:
        return _evaluate_baseline(baseline, asked, request.json, checked)
    if run is None:
        raise InputError("RUN", "nothing", "a run's folder, or --user still or random")
    with Share("Playing") as share:
        found = evaluation.evaluate(
            run,
            asked,
            on_progress=share.show,
            on_plan=checked.prepare,
            on_note=lambda note: say(f"note: {note}"),
        )
    return _print(found, asked, request.json, checked)


def _print(found: Evaluation, request: Request, json: bool, checked: CheckedRun) -> int:
    """Print notes, the table or JSON, and the files."""
    from sim2vr_harness.evaluation.tables import results_table
    from sim2vr_harness.evaluation.training_distribution import words_of_change

    for line in found.unpractised:
        typer.echo(f"note: not trained for: {line}", err=True)
    for line in found.unread[:1]:
        more = f" (and {len(found.unread) - 1} more)" if found.unread[1:] else ""
        typer.echo(f"note: not in the tables: {line}{more}", err=True)
    if json:
        print_json(found.summaries)
        return _status(checked, found.summaries)
    how = "deterministic" if _first(found.summaries)["deterministic"] else "stochastic"
    title = f"After {found.step:,} user steps, {how} actions"
    for override in request.overrides:
        key, _, value = override.partition("=")
        title += f"\nWith {words_of_change(key.strip(), value.strip())}"
    Console().print(results_table(found.summaries, found.facts, title))
    typer.echo(f"Evaluated: {found.checkpoint}")
    print_written(found.files)
    return _status(checked, found.summaries)


def _evaluate_baseline(user: str, request: Request, json: bool, checked: CheckedRun) -> int:
    """Let a baseline play, and measure it; its files go to ``--out`` only."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.envs.games import without_training
    from sim2vr_harness.evaluation.conditions import named_options
    from sim2vr_harness.evaluation.scripted_baseline import evaluate_baseline
    from sim2vr_harness.evaluation.tables import results_table
    from sim2vr_harness.runs.config import load_config

    for name in ("people", "log", "deterministic"):
        if getattr(request, name):
            raise InputError(f"--{name}", "it together with --user", "one of them")
    config = load_config("webxr", [*request.overrides, *as_overrides(dict(request.app or {}))])
    with Share("Playing") as share:
        found = evaluate_baseline(
            without_training(config.env, request.overrides),
            user,
            conditions=request.conditions or (),
            named=named_options(config.env, list(request.overrides)),
            episodes=2 if request.episodes is None else request.episodes,
            seed=1 if request.seed is None else request.seed,
            record=request.record,
            out=None if request.out is None else Path(request.out),
            overwrite=request.overwrite,
            on_progress=share.show,
            on_plan=checked.prepare,
        )
    for problem in found.problems:
        typer.echo(f"note: {problem}", err=True)
    if json:
        print_json(dict(found.summaries))
        return _status(checked, found.summaries)
    Console().print(results_table(found.summaries, found.facts, f"A user without training: {user}"))
    _print_steps(found.steps)
    print_written(found.files)
    return _status(checked, found.summaries)


def _print_steps(rounds: list[list[StepOutcome]]) -> None:
    """Print what the steps of a script did, of every round."""
    for number, steps in enumerate(rounds, start=1):
        if len(rounds) > 1:
            typer.echo(f"Round {number}:")
        for k, step in enumerate(steps, start=1):
            typer.echo(f"{k}. {step.words}")


def _status(checked: CheckedRun, summaries: Mapping[str, dict[str, Any]]) -> int:
    from sim2vr_harness.evaluation.expectations import of_evaluation

    return checked.status(lambda: of_evaluation(summaries))


def _first(summaries: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return next(iter(summaries.values()))
