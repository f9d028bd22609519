"""``sim2vr-harness evaluate``: a user plays, and is measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sim2vr_harness.cli.app_options import as_overrides, with_app_options
from sim2vr_harness.cli.options import (
    AgainstOption,
    CheckedRun,
    DeterministicOption,
    EnvSetOption,
    ExpectOption,
    JsonOption,
    JunitOption,
    TrustOption,
    UserOption,
    known_users,
    print_json,
    print_written,
    who_plays,
    writable_folder,
)
from sim2vr_harness.cli.progress import Share, say

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.evaluate import Evaluation, Request
    from sim2vr_harness.policies.scripted import StepOutcome

_Run = Annotated[
    str | None,
    typer.Argument(
        autocompletion=known_users,
        metavar="RUN",
        help="A run's folder, a checkpoint, or pretrained:NAME; nothing with --user.",
    ),
]
_Condition = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="A condition of the game; may be repeated.",
        show_default="the run's evaluation.conditions, or those below",
    ),
]
_Episodes = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Rounds per condition, and person.",
        show_default="the run's evaluation.episodes: 10 unless set",
    ),
]
_People = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Let N people play who differ in size, strength, delays, noise and effort; means "
        "and deviations are then over people (docs/concepts/people.md).",
    ),
]
_Seed = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Seed of the people and of the first round, one more for each that follows.",
        show_default="the run's evaluation.seed: 1 unless set",
    ),
]
_Record = Annotated[
    bool, typer.Option("--record", help="Film the first round of every condition (MP4).")
]
_Log = Annotated[bool, typer.Option("--log", help="Keep the game's CSV logs, a folder per round.")]
_Steps = Annotated[
    bool,
    typer.Option(
        "--steps/--no-steps",
        help="Write tables of every user step and app frame beside those of episodes and events.",
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for files. Results are added to those that are there.",
        show_default="RUN/evaluation/step_N",
        callback=writable_folder,
    ),
]
_Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Begin with new results where there are others.")
]


@with_app_options
def evaluate(
    run: _Run = None,
    condition: _Condition = None,
    episodes: _Episodes = None,
    people: _People = None,
    seed: _Seed = None,
    deterministic: DeterministicOption = None,
    record: _Record = False,
    log: _Log = False,
    steps: _Steps = True,
    out: _Out = None,
    overwrite: _Overwrite = False,
    batch: Annotated[int, typer.Option(help="Rounds played in parallel at most.")] = 10,
    user: UserOption = None,
    trust_app: TrustOption = False,
    overrides: EnvSetOption = None,
    json: JsonOption = False,
    expect: ExpectOption = None,
    against: AgainstOption = None,
    junit: JunitOption = None,
    *,
    remote: dict[str, Any],
) -> int:
    """Let a trained user play, and measure what it does.

    Examples:
        sim2vr-harness evaluate pretrained:whacamole_constrained --condition easy
        sim2vr-harness evaluate runs/sample --episodes 20 --record
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation import evaluate as evaluation

    checked = CheckedRun(expect, against, junit, "evaluate")
    run, baseline = who_plays(run, user)
    # fmt: off
    request = evaluation.Request(
        conditions=condition, episodes=episodes, seed=seed, people=people,
        deterministic=deterministic, record=record, log=log, steps=steps, out=out, batch=batch,
        overwrite=overwrite, app=remote, overrides=overrides or (), trust_app=trust_app,
    )
    # fmt: on
    if baseline is not None:
        return _evaluate_baseline(baseline, request, json, checked)
    if run is None:
        raise InputError("RUN", "nothing", "a run's folder, or --user still or random")
    asked: Any = {"on_plan": checked.prepare, "on_note": lambda note: say(f"note: {note}")}
    with Share("Playing") as share:
        found = evaluation.evaluate(run, request, on_progress=share.show, **asked)
    return _print(found, request, json, checked)


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

    for option in ("people", "log", "deterministic"):
        if getattr(request, option):
            raise InputError(f"--{option}", "it together with --user", "one of them")
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
