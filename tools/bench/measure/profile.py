"""Profile of a training: time of its stages and of their parts."""

from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.run.trainer import train

_CYCLES, _UPDATES, _PLAY_STEPS, _FITS, _FRAMES = 2, 20, 100, 200, 8192
_TRIES, _USER_STEPS = 1_000, 12_000
"""User steps of Q-learning: at random, and in all."""


def short_run(config: TrainingConfig) -> TrainingConfig:
    """Return the recipe with stages of a few cycles, rounds and one iteration.

    Raises:
        InputError: a recipe with stages that cannot be shortened.
    """
    if config.recipe not in ("ppo", "distill", "skills"):
        raise InputError("--profile", f"a recipe {config.recipe!r}", "ppo, distill or skills")
    teacher, student, ppo = config.teacher, config.student, config.ppo
    imagined = teacher.imagined
    few = {
        "cycles": min(imagined.cycles, _CYCLES),
        "updates": min(imagined.updates, _UPDATES),
        "first_play_steps": min(imagined.first_play_steps, _PLAY_STEPS),
        "first_fit_minibatches": min(imagined.first_fit_minibatches, _FITS),
    }
    imagined = imagined.model_copy(update=few)
    skills, learning = config.skills, config.skills.q_learning
    motor = skills.motor_training
    tries = {
        "try_steps": min(learning.try_steps, _TRIES),
        "user_steps": min(learning.user_steps, _USER_STEPS),
    }
    options = {
        "motor_training": motor.model_copy(update={"cycles": min(motor.cycles, _CYCLES)}),
        "q_learning": learning.model_copy(update=tries),
    }
    changes = {
        "total_timesteps": ppo.n_envs * ppo.n_steps,
        "skills": skills.model_copy(update=options),
        "teacher": teacher.model_copy(update={"imagined": imagined}),
        "student": student.model_copy(update={"frames": min(student.frames, _FRAMES)}),
    }
    return config.model_copy(update=changes)


def profile_lines(config: TrainingConfig) -> list[str]:
    """Train for a short time in a folder that is deleted, and return the table of its parts."""
    with TemporaryDirectory(prefix="sim2vr-profile-") as folder:
        result = train(short_run(config), Path(folder) / "run", console=Console(quiet=True))
        lines = stage_lines(result.folder)
    return [*lines, "Stopped: what follows is missing."] if result.interrupted else lines


def stage_lines(run: RunFolder) -> list[str]:
    """Return a table of the wall time and the processor time of a run's stages and their parts."""
    known = run.metadata()
    seconds, parts = known.get("stage_seconds", {}), known.get("stage_parts", {})
    lines = [f"{'stage':28}{'wall':>10}{'processor':>12}{'cores':>8}"]
    for stage, whole in seconds.items():
        of_stage = parts.get(stage, {})
        cpu = sum(part["cpu_seconds"] for part in of_stage.values())
        lines.append(_line(stage, whole, cpu))
        lines += [
            _line(f"  {name}", part["seconds"], part["cpu_seconds"])
            for name, part in of_stage.items()
        ]
    return lines


def _line(name: str, seconds: float, cpu_seconds: float) -> str:
    cores = cpu_seconds / seconds if seconds else 0.0
    return f"{name:28}{seconds:8.1f} s{cpu_seconds:10.1f} s{cores:8.2f}"
