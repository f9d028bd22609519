"""``sim2vr-harness train``: from a configuration to a simulated user."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from sim2vr_harness.cli.errors import INTERRUPTED
from sim2vr_harness.cli.options import SetOption, TrustOption, writable_folder
from sim2vr_harness.cli.progress import Share

if TYPE_CHECKING:
    from sim2vr_harness.training.run.trainer import TrainResult

__all__ = ["train"]


def train(
    config: Annotated[
        str | None,
        typer.Argument(
            metavar="[CONFIG]",
            help="A YAML file, or the name of a game (recipe: skills); with --resume, the run's "
            "folder.",
        ),
    ] = None,
    set_: SetOption = None,
    from_: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="USER",
            help="Instead of CONFIG: go on from a trained user, with what --set changes.",
        ),
    ] = None,
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
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.envs.games import with_task
    from sim2vr_harness.policies.store import find_user
    from sim2vr_harness.runs.config import load_config
    from sim2vr_harness.runs.run_folder import RunFolder
    from sim2vr_harness.runs.trust import named_app, require_trust
    from sim2vr_harness.training.ppo.fine_tune import adapting
    from sim2vr_harness.training.run import trainer

    if resume and overwrite:
        raise InputError("--overwrite", "it together with --resume", "one of them")
    if set_aside and not resume:
        raise InputError("--set-aside", "it without --resume", "it together with --resume")
    if from_ is not None and (config is not None or resume):
        other = "--resume" if config is None else "CONFIG"
        raise InputError("--from", f"it together with {other}", "one of them")
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
    from_nothing = from_ is None and not resume
    if config is None and page is not None and from_nothing:
        if task is None:
            raise InputError("--task", "nothing", "what the page is worth: rules or FILE.py:CLASS")
        config = "webxr"
        overrides.append(f"name={wanted['game']}")
    elif config is None and from_nothing and (app is not None or connect is not None):
        config = "skills"
    elif config is not None and from_nothing and _is_game(config):
        overrides = [f"env.app.game={config}", f"name={config}", *overrides]
        config = "skills"
    if from_ is None and config is None and (not resume or out is None):
        expected = "a configuration file, or --resume with the folder of a run"
        raise InputError("CONFIG", "nothing", expected)
    if from_ is not None:
        settings = adapting(find_user(from_), from_, overrides)
    elif config is None:
        assert out is not None
        settings = RunFolder.open(out).load_config(overrides)
    else:
        settings = load_config(config, overrides)
    folder = out or Path("runs") / settings.name
    source = Path(from_ or config or folder)
    require_trust(settings.env, source, named=named_app(overrides), trust=trust_app)
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
    goes_on = result.step < settings.total_timesteps and settings.policy_kind != "hierarchical"
    _print_where_next(result, resumable=result.interrupted or goes_on)
    return INTERRUPTED if result.interrupted else 0


def _is_game(name: str) -> bool:
    """Whether this names a game of the runtime, and no configuration."""
    from sim2vr_harness.base import paths
    from sim2vr_harness.client import list_games

    try:
        paths.config_path(name)
    except FileNotFoundError:
        return name in list_games()
    return False


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
