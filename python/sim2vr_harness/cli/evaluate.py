"""``sim2vr-harness evaluate``: a user plays, and is measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sim2vr_harness.cli.app_options import with_app_options
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
    """Let a user play, and measure what it does.

    Examples:
        sim2vr-harness evaluate pretrained:whacamole_constrained --condition easy
        sim2vr-harness evaluate runs/sample --episodes 20 --record
        sim2vr-harness evaluate --user still --people 3 --set env.app.game=sample
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation import evaluate as evaluation

    checked = CheckedRun(expect, against, junit, "evaluate")
    run, baseline = who_plays(run, user)
    if run is None and baseline is None:
        raise InputError("RUN", "nothing", "a run's folder, or --user still or random")
    # fmt: off
    request = evaluation.Request(
        conditions=condition, episodes=episodes, seed=seed, people=people,
        deterministic=deterministic, record=record, log=log, steps=steps, out=out, batch=batch,
        overwrite=overwrite, app=remote, overrides=overrides or (), trust_app=trust_app,
    )
    # fmt: on
    asked: Any = {"on_plan": checked.prepare, "on_note": lambda note: say(f"note: {note}")}
    with Share("Playing") as share:
        found = evaluation.evaluate(run or str(baseline), request, on_progress=share.show, **asked)
    return _print(found, request, json, checked)


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
