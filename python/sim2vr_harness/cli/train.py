"""``sim2vr-harness train``: from a configuration to a simulated user."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer
from rich.console import Console

from sim2vr_harness.base.requests import TrustedApp, argument, option
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.errors import INTERRUPTED
from sim2vr_harness.cli.options import TrainedPeople, known_configs
from sim2vr_harness.cli.progress import Share, say

if TYPE_CHECKING:
    from sim2vr_harness.runs.config import TrainingConfig
    from sim2vr_harness.training.run.trainer import TrainResult


@dataclass(frozen=True, kw_only=True)
class TrainRequest(TrainedPeople, TrustedApp, AppOptions):
    """What to train, and where to."""

    config: str | None = argument(
        "CONFIG",
        "A YAML file, or the name of a game (recipe: skills); with --resume, the run's folder.",
        None,
        names="configs",
    )
    set_: tuple[str, ...] = option(
        "Change the configuration: --set ppo.n_envs=4; may be repeated.", (), metavar="KEY=VALUE"
    )
    from_: str | None = option(
        "Instead of CONFIG: continue from a trained user, with the changes of --set.",
        metavar="USER",
        names="users",
    )
    timesteps: int | None = option(
        "Stop after this many user steps of the run's last stage.", shown="all of them"
    )
    out: Path | None = option("The run's folder.", shown="runs/NAME", place="folder to write")
    seed: int | None = option("Seed of the run; short for --set seed=SEED.")
    device: Literal["auto", "cpu", "cuda"] | None = option(
        "Device that trains: cpu, or cuda (NVIDIA).", shown="auto"
    )
    cores: int | None = option("Cores of this machine to use.", shown="all", least=1)
    resume: bool = option("Continue the run exactly.", False)
    overwrite: bool = option("Delete the run in the folder, and start again.", False)
    set_aside: bool = option(
        "With --resume: set unusable files aside, and continue from the last usable ones.", False
    )


def train(request: TrainRequest) -> int:
    """Train a simulated user; Ctrl-C saves, --resume continues exactly.

    Examples:
        sim2vr-harness train sample --people
        sim2vr-harness train --resume runs/sample
    """
    from sim2vr_harness.envs.resolved import ResolvedEnv
    from sim2vr_harness.play.environment import as_overrides
    from sim2vr_harness.play.users import doing_nothing_pays
    from sim2vr_harness.runs.trust import named_app, require_trust
    from sim2vr_harness.training.run import trainer

    remote = request.remote()
    # Refuse options that do not go together.
    from sim2vr_harness.base.errors import InputError

    if request.resume and request.overwrite:
        raise InputError("--overwrite", "it together with --resume", "one of them")
    if request.set_aside and not request.resume:
        raise InputError("--set-aside", "it without --resume", "it together with --resume")
    if request.from_ is not None and (request.config is not None or request.resume):
        other = "--resume" if request.config is None else "CONFIG"
        raise InputError("--from", f"it together with {other}", "one of them")
    if request.people is not None and (request.from_ is not None or request.resume):
        other = "--resume" if request.resume else "--from"
        raise InputError("--people", f"it together with {other}", "one of them")
    config, out = _run_or_file(request)
    overrides = [*request.set_]
    for key in ("seed", "device", "cores"):
        if (value := getattr(request, key)) is not None:
            overrides.append(f"{'env.' if key == 'cores' else ''}{key}={value}")
    overrides += as_overrides(remote)
    resume, people = request.resume, request.people is not None
    if request.from_ is None and not resume:
        config, overrides = _configuration(config, remote, overrides, people=people)
    settings = _settings(config, request.from_, out if resume else None, overrides)
    folder = out or Path("runs") / settings.name
    source = Path(request.from_ or config or folder)
    require_trust(settings.env, source, named=named_app(overrides), trust=request.trust_app)
    if not resume:
        env = ResolvedEnv(settings.env).with_task()
        settings = settings.model_copy(update={"env": env.config})
    settings = _of_people(settings, request.count()) if people else settings
    # The recipe skills plays these users itself.
    if not resume and settings.recipe != "skills" and (note := doing_nothing_pays(env)):
        say(f"note: {note}")
    result = trainer.train(
        settings,
        folder,
        timesteps=request.timesteps,
        resume=resume,
        overwrite=request.overwrite,
        set_aside=request.set_aside,
    )
    if not result.interrupted and settings.evaluation.episodes_after_training:
        from sim2vr_harness.evaluation.evaluate import evaluate
        from sim2vr_harness.evaluation.request import Request
        from sim2vr_harness.evaluation.tables import results_table

        assert result.checkpoint is not None
        training_request = Request(
            episodes=settings.evaluation.episodes_after_training, trust_app=True
        )  # it was trained with this moment
        with Share("Evaluating") as share:
            found = evaluate(result.checkpoint, training_request, on_progress=share.show)
        title = f"After {found.step:,} user steps"
        Console().print(results_table(found.summaries, found.facts, title))
    goes_on = result.step < settings.last_stage_steps
    _print_where_next(result, resumable=result.interrupted or goes_on)
    return INTERRUPTED if result.interrupted else 0


def _of_people(settings: TrainingConfig, count: int | None = None) -> TrainingConfig:
    """Return the settings with users who are persons.

    Raises:
        InputError: another recipe than ``skills``.
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.client import transport_named
    from sim2vr_harness.envs.config import FoveaConfig
    from sim2vr_harness.envs.people_preset import as_population
    from sim2vr_harness.perception.registry import SenseConfig

    if settings.recipe != "skills":
        raise InputError("--people", f"it with recipe {settings.recipe!r}", "recipe 'skills'")
    env = settings.env
    known = {sense.sense for sense in env.senses}
    names, vision = ["headset", "person"], env.vision
    if "fovea" in transport_named(env.app.transport).capabilities:
        vision = vision.model_copy(update={"fovea": FoveaConfig(gaze="moves")})
        names += ["fovea", "fovea_depth", "gaze"]
    else:
        say("note: participants see the headset's picture only, without a fovea around the gaze")
    more = [SenseConfig(sense=name) for name in names if name not in known]
    senses = (*env.senses, *more)
    update = {"user": as_population(env.user, count), "senses": senses, "vision": vision}
    skills = settings.skills.model_copy(update={"user": "person"})
    changed = settings.model_copy(update={"env": env.model_copy(update=update), "skills": skills})
    return type(settings).model_validate(changed.model_dump())


def _run_or_file(request: TrainRequest) -> tuple[str | None, Path | None]:
    """Return the configuration and the run's folder; CONFIG may be the folder to resume."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.runs.run_folder import RunFolder

    config, out = request.config, request.out
    if config is None or not RunFolder(config).exists:
        return config, out
    if not request.resume:
        expected = "a configuration file, or --resume with it to continue that run"
        raise InputError("CONFIG", f"{config!r}, the folder of a run", expected)
    if out is not None and out.resolve() != Path(config).resolve():
        raise InputError("--out", f"{str(out)!r}", f"{config!r} as well, or nothing")
    return None, Path(config)


def _configuration(
    config: str | None, app: Mapping[str, Any], overrides: list[str], *, people: bool
) -> tuple[str | None, list[str]]:
    """Return the configuration for a page, an app, a game or a file, and its overrides.

    With people a game counts before a configuration of its name.
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.client import list_games

    if config is None and ("page" in app or app.get("transport") == "openxr"):
        if "task" not in app:
            raise InputError("--task", "nothing", "what the app is worth: rules or FILE.py:CLASS")
        return "webxr", [*overrides, f"name={app['game']}"]
    if config is None and (app.get("executable") or app.get("connect")):
        return "skills", overrides
    if config is not None and ((people and config in list_games()) or _is_game(config)):
        return "skills", [f"env.app.game={config}", f"name={config}", *overrides]
    return config, overrides


def _settings(
    config: str | None, from_: str | None, run: Path | None, overrides: list[str]
) -> TrainingConfig:
    """Return the settings of a user that goes on, of a configuration or of a run to resume."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.policies.store import find_user
    from sim2vr_harness.runs.config import load_config
    from sim2vr_harness.runs.run_folder import RunFolder
    from sim2vr_harness.training.ppo.fine_tune import adapting

    if from_ is not None:
        return adapting(find_user(from_), from_, overrides)
    if config is not None:
        return load_config(config, overrides)
    if run is None:
        expected = "a configuration file, or --resume with the folder of a run"
        raise InputError("CONFIG", "nothing", expected)
    return RunFolder.open(run).load_config(overrides)


def _is_game(name: str) -> bool:
    """Whether this names a game of the runtime, and no configuration."""
    from sim2vr_harness.base import paths
    from sim2vr_harness.base.errors import InputError, closest
    from sim2vr_harness.client import list_games

    try:
        paths.config_path(name)
    except FileNotFoundError:
        names = [*list_games(), *known_configs("")]
        near = closest(name, names)
        if near in list_games() and near != name:
            expected = f"a file, or the name of a configuration or game (did you mean {near!r}?)"
            raise InputError("CONFIG", repr(name), expected) from None
        return name in list_games()
    return False


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
        ("learning curves", f"sim2vr-harness plot curves {run} --out {run}/curves.png"),
        ("TensorBoard", f"tensorboard --logdir {run}/tensorboard"),
    ]
    if resumable:
        lines.append(("train on", go_on))
    typer.echo("Where to look next:")
    for what, command in lines:
        typer.echo(f"  {what + ':':17}{command}")
