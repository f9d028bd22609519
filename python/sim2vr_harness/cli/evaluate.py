"""``sim2vr-harness evaluate``: a user plays, and is measured."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sim2vr_harness.cli.app_options import (
    AppArgOption,
    AppOption,
    BrowserOption,
    ConnectOption,
    MapOption,
    PageOption,
    ProtocolOption,
    TaskOption,
    app_settings,
    as_overrides,
)
from sim2vr_harness.cli.options import (
    EnvSetOption,
    JsonOption,
    TrustOption,
    print_json,
    writable_folder,
)
from sim2vr_harness.cli.progress import Share

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.evaluate import Evaluation, Request

__all__ = ["evaluate"]


_Run = Annotated[
    str | None,
    typer.Argument(
        metavar="RUN",
        help="A run's folder, a checkpoint, or pretrained:NAME; nothing with --user.",
    ),
]
_Condition = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="A condition of the game; may be repeated. Without, the run's "
        "evaluation.conditions, or else those below.",
    ),
]
_Episodes = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Rounds per condition, and person. Without, the run's evaluation.episodes: 10 "
        "unless set.",
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
        help="Seed of the people and of the first round, one more for each that follows. "
        "Without, the run's evaluation.seed: 1 unless set.",
    ),
]
_Deterministic = Annotated[
    bool | None,
    typer.Option(
        "--deterministic/--stochastic",
        help="Take the policy's mean, or sample. Without, the user's own evaluation.deterministic.",
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
        help="Write tables of every user step and app frame beside those of episodes and "
        "events (default).",
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for files; RUN/evaluation/step_N by default. Results are added to those "
        "that are there.",
        callback=writable_folder,
    ),
]
_Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Begin with new results where there are others.")
]
_User = Annotated[
    str | None,
    typer.Option(
        metavar="WHO",
        help="Instead of a trained user, for a first look: still, random, or 'reach NAME', who "
        "moves the hand to the object of that name.",
    ),
]


def evaluate(
    run: _Run = None,
    condition: _Condition = None,
    episodes: _Episodes = None,
    people: _People = None,
    seed: _Seed = None,
    deterministic: _Deterministic = None,
    record: _Record = False,
    log: _Log = False,
    steps: _Steps = True,
    out: _Out = None,
    overwrite: _Overwrite = False,
    batch: Annotated[int, typer.Option(help="Rounds played side by side at most.")] = 10,
    app: AppOption = None,
    app_arg: AppArgOption = None,
    connect: ConnectOption = None,
    protocol: ProtocolOption = None,
    page: PageOption = None,
    map_: MapOption = None,
    task: TaskOption = None,
    browser: BrowserOption = None,
    user: _User = None,
    trust_app: TrustOption = False,
    overrides: EnvSetOption = None,
    json: JsonOption = False,
) -> None:
    """Let a trained user play, and measure what it does.

    Examples:
        sim2vr-harness evaluate pretrained:whacamole_constrained --condition easy
        sim2vr-harness evaluate runs/sample --episodes 20 --record
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation.evaluate import Request
    from sim2vr_harness.evaluation.evaluate import evaluate as evaluate_run

    remote = app_settings(app, app_arg, connect, protocol, page, map_, task, browser)
    if user is not None:
        if run is not None:
            raise InputError("--user", f"it together with {run!r}", "one of them")
        for option, given in (
            ("--people", people),
            ("--log", log),
            ("--deterministic", deterministic),
        ):
            if given:
                raise InputError(option, "it together with --user", "one of them")
        _first_look(
            user,
            remote,
            overrides or [],
            condition or (),
            episodes,
            seed,
            record,
            out,
            overwrite,
            json,
        )
        return
    if run is None:
        expected = "a run's folder, or --user still or random for somebody untrained"
        raise InputError("RUN", "nothing", expected)
    # fmt: off
    request = Request(
        conditions=condition, episodes=episodes, seed=seed, people=people,
        deterministic=deterministic, record=record, log=log, steps=steps, out=out,
        overwrite=overwrite, batch=batch, app=remote, overrides=overrides or (),
        trust_app=trust_app,
    )
    # fmt: on
    with Share("Playing") as share:
        found = evaluate_run(run, request, on_progress=share.show)
    _print(found, request, json)


def _print(found: Evaluation, request: Request, json: bool) -> None:
    """Print notes, the table or JSON, and the files."""
    from sim2vr_harness.evaluation.tables import results_table
    from sim2vr_harness.evaluation.training_distribution import words_of_change

    for line in found.unpractised:
        typer.echo(f"note: this user never practised {line}", err=True)
    for line in found.unread[:1]:
        more = f" (and {len(found.unread) - 1} more)" if found.unread[1:] else ""
        typer.echo(f"note: not in the tables: {line}{more}", err=True)
    if json:
        print_json(found.summaries)
        return
    how = "deterministic" if _first(found.summaries)["deterministic"] else "stochastic"
    title = f"After {found.step:,} user steps, {how} actions"
    for override in request.overrides:
        key, _, value = override.partition("=")
        title += f"\nWith {words_of_change(key.strip(), value.strip())}"
    Console().print(results_table(found.summaries, found.facts, title))
    typer.echo(f"Evaluated: {found.checkpoint}")
    for file in found.files:
        typer.echo(f"Written: {file}")


def _first_look(
    user: str,
    app: dict[str, Any],
    overrides: list[str],
    conditions: Sequence[str],
    episodes: int | None,
    seed: int | None,
    record: bool,
    out: Path | None,
    overwrite: bool,
    json: bool,
) -> None:
    from sim2vr_harness.envs.games import with_task
    from sim2vr_harness.evaluation.first_look import look
    from sim2vr_harness.evaluation.tables import results_table
    from sim2vr_harness.runs.config import load_config

    config = load_config("webxr", [*overrides, *as_overrides(app)])
    with Share("Playing") as share:
        found = look(
            with_task(config.env),
            user,
            conditions=conditions,
            episodes=2 if episodes is None else episodes,
            seed=1 if seed is None else seed,
            record=record,
            out=out,
            overwrite=overwrite,
            on_progress=share.show,
        )
    for problem in found.problems:
        typer.echo(f"note: {problem}", err=True)
    if json:
        print_json(dict(found.summaries))
        return
    title = f"A user who has learned nothing ({user})"
    Console().print(results_table(found.summaries, found.facts, title))
    for file in found.files:
        typer.echo(f"Written: {file}")


def _first(summaries: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return next(iter(summaries.values()))
