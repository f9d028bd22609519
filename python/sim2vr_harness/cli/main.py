"""``sim2vr-harness``: train, evaluate and look at simulated users.

Commands only read options and print; what they do lives in the rooms that they call, and those
are imported when a command runs, so that ``--help`` is quick.
"""

from __future__ import annotations

import json as jsonlib
import shlex
import sys
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sim2vr_harness import __version__
from sim2vr_harness.cli import (
    bench,
    chart,
    compare,
    export,
    film,
    fitts,
    games,
    level,
    reach,
    rewards,
    study,
    users,
    watch,
)
from sim2vr_harness.cli import report as report_command
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
from sim2vr_harness.cli.errors import INTERRUPTED, report
from sim2vr_harness.cli.games import HelpWithGames
from sim2vr_harness.cli.options import (
    SetOption,
    TrustOption,
    finite,
    writable_file,
    writable_folder,
)
from sim2vr_harness.cli.progress import Share
from sim2vr_harness.cores import settle_torch

if TYPE_CHECKING:
    from sim2vr_harness.training.trainer import TrainResult

__all__ = ["app", "main"]

app = typer.Typer(
    name="sim2vr-harness",
    help="Train and evaluate simulated users of VR applications.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

app.add_typer(users.app, name="users")
app.command("games")(games.games)
app.command("level")(level.level)
app.command("fitts")(fitts.fitts)
app.command("export")(export.export)
app.command("study")(study.study)
app.command("report")(report_command.report)

RunArgument = Annotated[
    str,
    typer.Argument(metavar="RUN", help="A run's folder, a checkpoint, or pretrained:NAME."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object, nothing else.")]
EnvSetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change the environment: --set env.user.noise.constant=white.",
    ),
]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sim2vr-harness {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version and exit."
        ),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks of errors.")] = False,
) -> None:
    """Train and evaluate simulated users of VR applications."""


@app.command()
def train(
    config: Annotated[
        str | None,
        typer.Argument(metavar="[CONFIG]", help="A YAML file; with --resume, the run's folder."),
    ] = None,
    set_: SetOption = None,
    timesteps: Annotated[
        int | None,
        typer.Option(help="Stop after this many user steps, counted from the run's start."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The run's folder; runs/NAME by default.", callback=writable_folder),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Short for --set seed=SEED.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run exactly.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Delete the run that is there.")
    ] = False,
    set_aside: Annotated[
        bool,
        typer.Option(
            "--set-aside",
            help="With --resume: put files that cannot be used aside, go on from the last good "
            "ones.",
        ),
    ] = False,
    app: AppOption = None,
    app_arg: AppArgOption = None,
    connect: ConnectOption = None,
    protocol: ProtocolOption = None,
    page: PageOption = None,
    map_: MapOption = None,
    task: TaskOption = None,
    browser: BrowserOption = None,
    trust_app: TrustOption = False,
) -> int:
    """Train a simulated user; Ctrl-C saves, --resume continues exactly."""
    from sim2vr_harness.envs.games import with_task
    from sim2vr_harness.errors import InputError
    from sim2vr_harness.training import trainer
    from sim2vr_harness.training.config import load_config
    from sim2vr_harness.training.run_folder import RunFolder
    from sim2vr_harness.training.trust import named_app, require_trust

    if resume and overwrite:
        raise InputError("--overwrite", "it together with --resume", "one of them")
    if set_aside and not resume:
        raise InputError("--set-aside", "it without --resume", "it together with --resume")
    if config is not None and RunFolder(config).exists:
        if not resume:
            expected = "a configuration file, or --resume with it to continue that run"
            raise InputError("CONFIG", f"{config!r}, the folder of a run", expected)
        if out is not None and out.resolve() != Path(config).resolve():
            raise InputError("--out", f"{str(out)!r}", f"{config!r} as well, or nothing")
        out = Path(config)
        config = None
    overrides = [*(set_ or []), *([] if seed is None else [f"seed={seed}"])]
    wanted = app_settings(app, app_arg, connect, protocol, page, map_, task, browser)
    overrides += as_overrides(wanted)
    if config is None and page is not None and not resume:
        if task is None:
            raise InputError("--task", "nothing", "what the page is worth: rules or FILE.py:CLASS")
        config = "webxr"
        overrides.append(f"name={wanted['game']}")
    if config is None and (not resume or out is None):
        expected = "a configuration file, or --resume with the folder of a run"
        raise InputError("CONFIG", "nothing", expected)
    if config is None:
        assert out is not None
        settings = RunFolder.open(out).load_config(overrides)
    else:
        settings = load_config(config, overrides)
    folder = out or Path("runs") / settings.name
    source = folder if config is None else Path(config)
    require_trust(settings.env.app, source, named=named_app(overrides), trust=trust_app)
    if not resume:
        settings = settings.model_copy(update={"env": with_task(settings.env)})
    result = trainer.train(
        settings,
        folder,
        timesteps=timesteps,
        resume=resume,
        overwrite=overwrite,
        set_aside=set_aside,
    )
    if not result.interrupted and settings.evaluation.episodes_after_training:
        _evaluate_after_training(result, settings.evaluation.episodes_after_training)
    _print_where_next(result, resumable=result.step < settings.total_timesteps)
    return INTERRUPTED if result.interrupted else 0


def _evaluate_after_training(result: TrainResult, episodes: int) -> None:
    from sim2vr_harness.evaluation.evaluate import Request, evaluate
    from sim2vr_harness.evaluation.tables import results_table

    assert result.checkpoint is not None
    request = Request(episodes=episodes, trust_app=True)  # it was trained with this moment
    with Share("Evaluating") as share:
        found = evaluate(result.checkpoint, request, on_progress=share.show)
    title = f"After {found.step:,} user steps"
    Console().print(results_table(found.summaries, found.facts, title))


def _print_where_next(result: TrainResult, resumable: bool) -> None:
    run = shlex.quote(str(result.folder.path))
    if result.interrupted:
        saved = f"; saved: {result.saved}" if result.saved else ", which will begin again"
        lost = f" ({result.lost_steps:,} steps of an unfinished iteration will be repeated)"
        typer.echo(f"Stopped in stage {result.stage!r}{saved}{lost if result.lost_steps else ''}.")
    go_on = f"sim2vr-harness train --resume {run}"
    if result.checkpoint is None:
        typer.echo(f"Go on with: {go_on}")
        return
    typer.echo(f"Saved user: {result.checkpoint}")
    lines = [
        ("watch it play", f"sim2vr-harness evaluate {run} --record"),
        ("learning curves", f"sim2vr-harness curves {run} --out {run}/curves.png"),
        ("TensorBoard", f"tensorboard --logdir {run}/tensorboard"),
    ]
    if resumable:
        lines.append(("train on", go_on))
    typer.echo("Where to look next:")
    for what, command in lines:
        typer.echo(f"  {what + ':':17}{command}")


@app.command(cls=HelpWithGames)
def evaluate(
    run: Annotated[
        str | None,
        typer.Argument(
            metavar="[RUN]",
            help="A run's folder, a checkpoint, or pretrained:NAME; nothing with --user.",
        ),
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A condition of the game; may be repeated. Without, the run's "
            "evaluation.conditions, or else those below.",
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Rounds per condition, and person. Without, the run's evaluation.episodes: 10 "
            "unless set.",
        ),
    ] = None,
    people: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Let N people play who differ in size, strength, delays, noise and effort; means "
            "and deviations are then over people (docs/people.md).",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Seed of the people and of the first round, one more for each that follows. "
            "Without, the run's evaluation.seed: 1 unless set.",
        ),
    ] = None,
    deterministic: Annotated[
        bool | None,
        typer.Option(
            "--deterministic/--stochastic", help="Take the policy's mean, or sample (default)."
        ),
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Film the first round of every condition (MP4).")
    ] = False,
    log: Annotated[
        bool, typer.Option("--log", help="Keep the game's CSV logs, a folder per round.")
    ] = False,
    steps: Annotated[
        bool,
        typer.Option(
            "--steps/--no-steps",
            help="Write tables of every user step and app frame beside those of episodes and "
            "events (default).",
        ),
    ] = True,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for files; RUN/evaluation/step_N by default. Results are added to those "
            "that are there.",
            callback=writable_folder,
        ),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Begin with new results where there are others.")
    ] = False,
    batch: Annotated[int, typer.Option(help="Rounds played side by side at most.")] = 10,
    app: AppOption = None,
    app_arg: AppArgOption = None,
    connect: ConnectOption = None,
    protocol: ProtocolOption = None,
    page: PageOption = None,
    map_: MapOption = None,
    task: TaskOption = None,
    browser: BrowserOption = None,
    user: Annotated[
        str | None,
        typer.Option(
            metavar="WHO",
            help="Instead of a trained user, for a first look: still, random, or 'reach NAME', who "
            "moves the hand to the object of that name.",
        ),
    ] = None,
    trust_app: TrustOption = False,
    overrides: EnvSetOption = None,
    json: JsonOption = False,
) -> None:
    """Let a trained user play, and measure what it does."""
    from sim2vr_harness.errors import InputError
    from sim2vr_harness.evaluation.evaluate import Request
    from sim2vr_harness.evaluation.evaluate import evaluate as evaluate_run
    from sim2vr_harness.evaluation.practised import words_of_change
    from sim2vr_harness.evaluation.tables import results_table

    remote = app_settings(app, app_arg, connect, protocol, page, map_, task, browser)
    if user is not None:
        if run is not None:
            raise InputError("--user", f"it together with {run!r}", "one of them")
        _first_look(user, remote, overrides or [], episodes, seed, record, out, overwrite, json)
        return
    if run is None:
        expected = "a run's folder, or --user still or random for somebody untrained"
        raise InputError("RUN", "nothing", expected)
    request = Request(
        conditions=condition,
        episodes=episodes,
        seed=seed,
        people=people,
        deterministic=deterministic,
        record=record,
        log=log,
        steps=steps,
        out=out,
        overwrite=overwrite,
        batch=batch,
        app=remote,
        overrides=overrides or (),
        trust_app=trust_app,
    )
    with Share("Playing") as share:
        found = evaluate_run(run, request, on_progress=share.show)
    for line in found.unpractised:
        typer.echo(f"note: this user never practised {line}", err=True)
    for line in found.unread[:1]:
        more = f" (and {len(found.unread) - 1} more)" if found.unread[1:] else ""
        typer.echo(f"note: not in the tables: {line}{more}", err=True)
    if json:
        _print_json(found.summaries)
        return
    how = "deterministic" if _first(found.summaries)["deterministic"] else "stochastic"
    title = f"After {found.step:,} user steps, {how} actions"
    for override in overrides or ():
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
    from sim2vr_harness.training.config import load_config

    config = load_config("webxr", [*overrides, *as_overrides(app)])
    with Share("Playing") as share:
        found = look(
            with_task(config.env),
            user,
            episodes=2 if episodes is None else episodes,
            seed=1 if seed is None else seed,
            record=record,
            out=out,
            overwrite=overwrite,
            on_progress=share.show,
        )
    for problem in found.problems:
        typer.echo(f"note: the task: {problem}", err=True)
    if json:
        _print_json(dict(found.summaries))
        return
    title = f"A user who has learned nothing ({user})"
    Console().print(results_table(found.summaries, found.facts, title))
    for file in found.files:
        typer.echo(f"Written: {file}")


def _first(summaries: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return next(iter(summaries.values()))


@app.command()
def replay(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH...",
            help="Recorded rounds: folders with states.csv and events.csv, packed .npz rounds with "
            "their manifest.json, or folders above such.",
        ),
    ],
    closed: Annotated[
        bool, typer.Option("--closed", help="Seed and poses only: spawns are predicted as well.")
    ] = False,
    unconstrained: Annotated[
        bool,
        typer.Option("--unconstrained", help="Every touch was a hit, though the logs do not say."),
    ] = False,
    fixed_step: Annotated[
        float | None,
        typer.Option(
            help="Period of the recording's fixed steps, s; worked out by default.", callback=finite
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help="Keep the replayed rounds' own logs in this folder.", callback=writable_folder
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.mp4",
            help="Film the player's view and the game from outside.",
            callback=writable_file,
        ),
    ] = None,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of each view in the film.")] = "640x480",
    fps: Annotated[
        float, typer.Option(help="Pictures per second of the film.", callback=finite)
    ] = 30.0,
    json: JsonOption = False,
) -> None:
    """Play recorded rounds again and compare every event with the recording."""
    from sim2vr_harness.errors import InputError
    from sim2vr_harness.evaluation.replay.film import ReplayFilm
    from sim2vr_harness.evaluation.replay.recordings import read_recordings
    from sim2vr_harness.evaluation.replay.replayer import Replay, replay_all
    from sim2vr_harness.evaluation.replay.report import ReplayReport
    from sim2vr_harness.evaluation.snapshot import parse_size

    if fixed_step is not None and not 1e-4 <= fixed_step <= 1.0:
        raise InputError("--fixed-step", f"{fixed_step:g}", "a period from 0.0001 to 1 s")
    recordings = read_recordings(paths, unconstrained=unconstrained)
    replays: list[Replay] = []
    with Share("Replaying") as share:
        film = None
        if video is not None:
            film = ReplayFilm(
                video,
                parse_size(size, (4096, 4096)),
                fps,
                on_progress=lambda part: share.show((len(replays) + part) / len(recordings)),
            )
        for done in replay_all(
            recordings, closed_loop=closed, fixed_step_s=fixed_step, log_dir=log, film=film
        ):
            replays.append(done)
            share.show(len(replays) / len(recordings))
    found = ReplayReport(replays)
    if json:
        _print_json(found.as_json())
        return
    found.print(Console())
    for file in film.files if film else []:
        typer.echo(f"Written: {file}")


@app.command()
def curves(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN...", help="Folders of runs, or packed users with curves."),
    ],
    out: Annotated[
        Path, typer.Option(help="The PNG file to write.", callback=writable_file)
    ] = Path("curves.png"),
) -> None:
    """Draw the learning curves of one or more runs."""
    from sim2vr_harness.evaluation.curves import plot

    typer.echo(f"Written: {plot(runs, out)}")


@app.command()
def snapshot(
    game: Annotated[
        str | None, typer.Option(metavar="NAME", help="The game; without, the user's.")
    ] = None,
    condition: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The game's condition; without, its default."),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the pictures.", callback=writable_folder)
    ] = Path("snapshot"),
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of the pictures.")] = "640x480",
    seconds: Annotated[
        float, typer.Option(help="How many seconds to play first.", callback=finite)
    ] = 2.0,
    seed: Annotated[int, typer.Option(help="Seed of the round.")] = 1,
    run: Annotated[
        str | None, typer.Option(help="A trained user; without, the arm moves at random.")
    ] = None,
    page: PageOption = None,
    map_: MapOption = None,
    task: TaskOption = None,
    browser: BrowserOption = None,
    trust_app: TrustOption = False,
) -> None:
    """Write pictures of a game: headset view, third person and body.

    The body is drawn by MuJoCo without a display; MUJOCO_GL=egl or osmesa chooses how.
    """
    from sim2vr_harness.evaluation import snapshot as pictures

    files = pictures.snapshot(
        out,
        game=game,
        condition=condition,
        size=pictures.parse_size(size),
        seconds=seconds,
        seed=seed,
        run=run,
        app=app_settings(page=page, mapped=map_, task=task, browser=browser),
        trust_app=trust_app,
    )
    for file in files:
        typer.echo(f"Written: {file}")


app.command("compare")(compare.compare)
app.command("chart")(chart.chart)
app.command("film")(film.film)
app.command("bench")(bench.bench)
app.command("reach")(reach.reach)
app.command("rewards")(rewards.rewards)
app.command("watch")(watch.watch)


@app.command()
def doctor(json: JsonOption = False) -> int:
    """Check what is installed, what is missing, and how to mend it."""
    from sim2vr_harness.cli.doctor import run_doctor

    return run_doctor(json=json)


def _print_json(content: dict[str, Any]) -> None:
    sys.stdout.write(jsonlib.dumps(content, indent=2) + "\n")


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    settle_torch()  # before anything loads torch
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names of files need not be UTF-8
            stream.reconfigure(errors="backslashreplace")
    given = sys.argv[1:] if arguments is None else arguments
    debug = "--debug" in given
    given = [argument for argument in given if argument != "--debug"] or ["--help"]
    command = partial(app, given, prog_name="sim2vr-harness", standalone_mode=False)
    sys.exit(report(command, given, debug))


if __name__ == "__main__":
    main()
