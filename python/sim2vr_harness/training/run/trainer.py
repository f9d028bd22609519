"""One training session: from a configuration, or a run to continue, to a saved user."""

import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import torch
from rich.console import Console

from sim2vr_harness.base.cores import torch_budget
from sim2vr_harness.base.errors import InputError, UnusableFile
from sim2vr_harness.base.file_lock import sole_training
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.envs.protocols import SimulationLike
from sim2vr_harness.runs.checkpoint import require_readable
from sim2vr_harness.runs.config import TrainingConfig, first_difference
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.runs.trust import remember
from sim2vr_harness.training.run.expected import plan_lines
from sim2vr_harness.training.run.loggers import require_wandb
from sim2vr_harness.training.run.memory import keep_freed_memory, require_memory
from sim2vr_harness.training.run.pipelines import MakeSimulation, Run, stages_of
from sim2vr_harness.training.run.stage import (
    Report,
    Stage,
    StageOutcome,
    remaining,
    run_stages,
    say_line,
)

__all__ = ["MakeSimulation", "TrainResult", "make_simulation", "train"]

CHANGEABLE = (
    *("name", "total_timesteps", "checkpoint", "evaluation", "wandb", "device", "env.cores"),
    *(
        f"env.app.{key}"
        for key in (
            *("transport", "executable", "arguments", "game_library", "connect", "processes"),
            *("timeout_s", "start_timeout_s", "time_scale"),
        )
    ),
)
"""Keys that a resumed run may change; any other would make it a different run."""


@dataclass(frozen=True)
class TrainResult:
    """How a session ended.

    Attributes:
        folder: The run's folder.
        checkpoint: The newest checkpoint: the trained user; None if the session was stopped before
            there is one.
        step: User steps of the last stage, taken in all sessions, as far as saved.
        interrupted: Whether it was stopped by Ctrl-C, SIGTERM or the ``stop`` callback.
        lost_steps: User steps of the unfinished iteration, which resuming takes again.
        seconds: Wall time of the session.
        stage: Name of the stage that the session ended in; empty if there was nothing to do.
        saved: What that stage has saved, for people; empty if it has not come so far.
    """

    folder: RunFolder
    checkpoint: Path | None
    step: int
    interrupted: bool
    lost_steps: int
    seconds: float
    stage: str = ""
    saved: str = ""


def make_simulation(config: TrainingConfig) -> SimulationLike:
    """Make the users and apps of ``config``; the default :data:`MakeSimulation`."""
    from sim2vr_harness.envs.simulation import Simulation

    return Simulation(config.env, config.ppo.n_envs)


def train(
    config: TrainingConfig,
    out: Path,
    *,
    timesteps: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    set_aside: bool = False,
    console: Console | None = None,
    report: Callable[[Report], None] | None = None,
    stop: Callable[[], bool] | None = None,
    simulation: MakeSimulation = make_simulation,
) -> TrainResult:
    """Train a simulated user until ``timesteps`` user steps are taken.

    Args:
        config: The configuration; with ``resume`` it must agree with the run's own.
        out: The run's folder.
        timesteps: Where this session stops, from the start of the run's last stage, rounded up to
            whole iterations; None: ``config.last_stage_steps``, over which schedules run anyway.
        resume: Continue the run in ``out``; one that has reached ``timesteps`` is left as it is.
        overwrite: Delete the run in ``out`` first.
        set_aside: With ``resume``: rename files that cannot be used (to ``NAME.aside``) and
            continue from the newest ones that can.
        console: Where to print; None prints to the standard error stream.
        report: Called with a :class:`.Report` after every cycle, round or iteration.
        stop: Asked at every step; once it returns True the training saves and ends, as after
            Ctrl-C. It may be called some thousand times a second.
        simulation: How to make the users of the last stage.

    Raises:
        InputError: An argument cannot be used; nothing has been written then.
        UnusableFile: With ``resume``: a file to continue from is damaged, or not finite.
        NotFinite: What is learned has become NaN or infinite; the moment before it is saved.
    """
    console = console or Console(stderr=True)
    until = config.last_stage_steps if timesteps is None else timesteps
    # Refuse settings that this machine cannot train with.
    if until < 1:
        raise InputError("--timesteps", str(until), "at least 1")
    if config.wandb.enabled:
        require_wandb()
    if config.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device", "'cuda', but torch finds no GPU", "'cpu' or 'auto'")
    people = config.env.user.people
    if people is not None and people.left_handed:
        expected = "0: left-handers are mirror images of those who learn; evaluate them"
        raise InputError("env.user.people.left_handed", f"{people.left_handed:g}", expected)
    require_memory(config)
    folder = RunFolder(out)
    if resume:
        if not folder.exists:
            resumable_expected = "a folder with a run in it"
            if folder.run_file.is_file():
                resumable_expected += (
                    "; a run that was killed before it began is begun again without --resume"
                )
            raise InputError(
                "--resume", f"{str(folder.path)!r}, which holds no run", resumable_expected
            )
        difference = first_difference(config, folder.load_config(), ignore=CHANGEABLE)
        if difference is not None:
            key, new, old = difference
            raise InputError(
                key,
                repr(new),
                f"{old!r} as in {folder.config_file}: a resumed run keeps its settings",
            )
    elif not overwrite:
        folder.require_free()
    keep_freed_memory()
    session = _Session(config, folder, until, simulation, resume, console, report, stop)
    with torch_threads(torch_budget(config.env.cores)):
        return session.train(overwrite=overwrite, set_aside=set_aside)


@dataclass(frozen=True)
class _Session:
    """A session of training in a run's folder; fields as the arguments of :func:`train`."""

    config: TrainingConfig
    folder: RunFolder
    until: int
    simulation: MakeSimulation
    resume: bool
    console: Console
    report: Callable[[Report], None] | None
    stop: Callable[[], bool] | None

    def train(self, *, overwrite: bool, set_aside: bool) -> TrainResult:
        """Hold the folder and run the stages, again after a file has been set aside."""
        began, folder = time.monotonic(), self.folder
        with ExitStack() as held:
            if folder.path.is_dir():
                held.enter_context(sole_training(folder.path, folder.lock_file))
            stages = self._stages(resumed=self.resume)
            opened = None if self.resume else self._create(stages[0], held, overwrite=overwrite)
            while True:
                try:
                    outcome = self._run(stages, opened)
                    break
                except UnusableFile as error:
                    if not set_aside:
                        raise _with_offer(error, folder) from error
                    aside = _aside(error.file)
                    error.file.rename(aside)
                    text = (
                        f"{error.file} cannot be used ({error.reason}); it is kept as {aside.name}."
                    )
                    self.console.print(text, highlight=False, markup=False, soft_wrap=True)
                    stages = self._stages(resumed=True)
        return _result(folder, stages, outcome, began)

    def _stages(self, *, resumed: bool) -> list[Stage]:
        return stages_of(
            Run(self.config, self.folder, self.until, self.simulation, resumed=resumed)
        )

    def _create(self, first: Stage, held: ExitStack, *, overwrite: bool) -> Stage:
        """Open the first stage, then create the folder; return the stage.

        A setting that cannot be used shows before a run that is there is deleted.
        """
        folder, config = self.folder, self.config
        say_line(self.console, f"Preparing {config.name} (recipe {config.recipe}) ...")
        try:
            first.open()
            if not folder.path.is_dir():
                held.enter_context(sole_training(folder.path, folder.lock_file))
            folder.create(self.config, overwrite)
        except BaseException:
            first.close()
            raise
        return first

    def _run(self, stages: Sequence[Stage], opened: Stage | None) -> StageOutcome:
        """Run the stages that are left, and note the session in the folder."""
        folder = self.folder
        if self.resume and not remaining(stages):
            require_readable(folder.latest_checkpoint())
            reached = f"{folder.path} has reached {stages[-1].saved}"
            self.console.print(f"Nothing to train: {reached}.")
            return StageOutcome()
        if self.resume:
            name, recipe = self.config.name, self.config.recipe
            say_line(self.console, f"Continuing {name} (recipe {recipe}) ...")
            folder.store_config(self.config)
        for line in plan_lines([stage for _, stage in remaining(stages)], self.config):
            say_line(self.console, line)
        remember(self.config.env.app, folder.path)
        folder.begin_session(start_step=folder.step)
        try:
            return run_stages(
                stages, folder, self.console, opened=opened, report=self.report, stop=self.stop
            )
        finally:
            if not folder.exists:  # the folder was removed meanwhile: no one else knows it
                folder.store_config(self.config)


def _with_offer(error: UnusableFile, folder: RunFolder) -> UnusableFile:
    """Return the error with the command that goes on all the same."""
    command = f"sim2vr-harness train --resume {shlex.quote(str(folder.path))} --set-aside"
    where = "from that one" if error.instead else "with what is left"
    offer = f"; to go on {where} and keep this file as {_aside(error.file).name}: {command}"
    changed = UnusableFile(error.file, error.reason, error.expected, error.instead)
    changed.args = (f"{changed}{offer}",)
    return changed


def _aside(file: Path) -> Path:
    """Return a name that is free, and that no stage looks for."""
    names = (f"{file.name}.aside{number or ''}" for number in count())
    return next(place for name in names if not (place := file.with_name(name)).exists())


def _result(
    folder: RunFolder, stages: Sequence[Stage], outcome: StageOutcome, began: float
) -> TrainResult:
    files = folder.checkpoints()
    interrupted = outcome.status != "finished"
    return TrainResult(
        folder=folder,
        checkpoint=files[-1] if files else None,
        step=folder.step,
        interrupted=interrupted,
        lost_steps=getattr(stages[-1], "lost_steps", 0) if interrupted else 0,
        seconds=time.monotonic() - began,
        stage=outcome.stage,
        saved=outcome.saved,
    )
