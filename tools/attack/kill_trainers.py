"""Kills trainings again and again, in every stage: what comes out must be the same bits.

A short run of each recipe is trained undisturbed. Then it is trained again with its process killed
(SIGKILL) at random moments, or at every single moment of writing (``--writes``: before, amid and
after each file and row), and resumed until it is finished. Weights, optimisers, environments,
random generators and logs (times left out) must equal the undisturbed run's, and no temporary file
may be left. Prints one JSON row per round; ends with status 0 when all were equal.

Run: python tools/attack/kill_trainers.py --rounds 20 --recipes distill ppo
"""

import argparse
import io
import json
import multiprocessing
import os
import random
import signal
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.training.dagger import dagger
from sim2vr_harness.training.motor_control import goal_task
from sim2vr_harness.training.option_q_learning import q_learning
from sim2vr_harness.training.run import trainer

SHARED = (
    *("device=cpu", "env.cores=1", "env.app.options.round_seconds=2.0", "ppo.n_envs=2"),
    *("ppo.n_steps=10", "ppo.batch_size=10", "ppo.n_epochs=1", "total_timesteps=60"),
    *("checkpoint.every_steps=20", "policy.net_arch=[16]"),
)
IMAGINED = ("cycles=3", "n_envs=4", "first_play_steps=30", "body_width=16", "users=8")
STUDENT = (
    *("policy.scale_proprioception=true", "ppo.critic_first_updates=1"),
    *("student.n_envs=2", "student.frames=96"),
    *("student.batch_size=16", "student.stagger_steps=20"),
)
DISTILL = (
    *("recipe=distill", *STUDENT),
    *(f"teacher.imagined.{setting}" for setting in IMAGINED),
    "teacher.curriculum.near_starts=0.0",
)
PRACTICE = ("cycles=3", "bodies=4", "width=16")
LOOKING = (  # the stage saves itself every 100 decisions
    *("users=2", "user_steps=1320", "try_steps=60", "explore_steps=200"),
)
SKILLS = (
    *("recipe=skills", *STUDENT),
    "env.action_frequency_hz=10",  # no motor layer ships for steps of 0.1 s: the run makes one
    "env.vision.channels=[red, green, blue, depth]",
    "env.senses=[{sense: vision, history_s: 0.2}, {sense: proprioception}, {sense: time}]",
    *(f"skills.motor_training.{setting}" for setting in PRACTICE),
    *(f"skills.q_learning.{setting}" for setting in LOOKING),
)
CONSTANTS: list[tuple[Any, dict[str, object]]] = [  # of the algorithms, as small
    (ImaginedConfig, {"play_steps": 10, "first_fit_minibatches": 20, "fit_minibatches": 20}),
    (ImaginedConfig, {"updates": 2, "critic_first_updates": 0}),
    (dagger, {"SETTINGS": replace(dagger.SETTINGS, rollout_steps=8, checkpoint_rounds=2)}),
    (goal_task, {"_FIRST_PLAY_STEPS": 12, "_BODY_WIDTH": 16, "_USERS": 8, "_WINDOW_STEPS": 4}),
    (goal_task._Cycles, {"play_steps": 6, "fit_minibatches": 20, "updates": 3}),
    (q_learning, {"SETTINGS": replace(q_learning.SETTINGS, batch_size=8)}),
]
SETTINGS = {
    "ppo": SHARED,
    "distill": (*SHARED, *DISTILL),
    "skills": (*SHARED, *SKILLS),
    "skills_decider": (*SHARED, *SKILLS, "skills.user=hierarchical"),
}
MOST_KILLS = 200
"""In one round; a run that is killed so often and not finished makes no progress."""


def config_of(recipe: str) -> TrainingConfig:
    """The short run of a recipe."""
    return load_config("whacamole_constrained", SETTINGS[recipe])


def session(config: TrainingConfig, run: Path, die_at: int | None = None) -> None:
    """Train or resume, in a process of its own; errors go to the standard error stream.

    Args:
        config: of the run.
        run: its folder.
        die_at: at which moment of writing to kill this process, from 0.
    """
    from rich.console import Console

    if die_at is not None:
        kill_while_writing(die_at)
    console = Console(file=io.StringIO())
    try:
        trainer.train(config, run, resume=(run / "config.yaml").is_file(), console=console)
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        os._exit(2)
    os._exit(0)


def kill_while_writing(die_at: int) -> None:
    """Let this process kill itself at a moment of writing, counted from 0."""
    left = die_at

    def moment() -> None:
        nonlocal left
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1

    replace, fsync, unlink = Path.replace, os.fsync, Path.unlink

    def sync(descriptor: int) -> None:
        size = os.fstat(descriptor).st_size
        if left == 0:
            os.ftruncate(descriptor, size // 2)
        moment()
        fsync(descriptor)

    def move(self: Path, target: Path) -> Path:
        moment()
        moved = replace(self, target)
        moment()
        return moved

    def delete(self: Path, missing_ok: bool = False) -> None:
        if self.exists():
            moment()
        unlink(self, missing_ok=missing_ok)

    def row(file: Path, content: Any) -> None:
        text = json.dumps(content) + "\n"
        with file.open("a", encoding="utf-8") as stream:
            stream.write(text[: len(text) // 2])
            stream.flush()
            moment()
            stream.write(text[len(text) // 2 :])
        moment()

    os.fsync, Path.replace, Path.unlink = sync, move, delete  # type: ignore[assignment,method-assign]
    for name, module in list(sys.modules.items()):
        if name.startswith("sim2vr_harness.training") and hasattr(module, "append_row"):
            module.append_row = row  # type: ignore[attr-defined]


def run_session(
    config: TrainingConfig, run: Path, kill_after_s: float | None = None, die_at: int | None = None
) -> int:
    """One session; returns its exit status, -9 when it was killed."""
    process = multiprocessing.get_context("fork").Process(
        target=session, args=(config, run, die_at), daemon=False
    )
    process.start()
    process.join(kill_after_s)
    if process.is_alive():
        process.kill()
        process.join()
    assert process.exitcode is not None
    return process.exitcode


# --- what must be equal -----------------------------------------------------------------------


def leaves(content: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Every value of nested mappings and lists, with its name; times and dates left out."""
    if isinstance(content, dict):
        for key, value in content.items():
            clock = key in ("cpu_seconds", "t") or "_seconds" in str(key)  # t: of an episode
            if not (clock or str(key).startswith("time")):
                yield from leaves(value, f"{name}.{key}")
    elif isinstance(content, (list, tuple)):
        for index, value in enumerate(content):
            yield from leaves(value, f"{name}[{index}]")
    elif isinstance(content, torch.Tensor):
        yield name, (tuple(content.shape), str(content.dtype), content.cpu().numpy().tobytes())
    elif isinstance(content, np.ndarray):
        yield name, (content.shape, str(content.dtype), content.tobytes())
    else:
        yield name, content if content == content else "nan"


def of_checkpoint(file: Path) -> Iterator[tuple[str, Any]]:
    """Everything in a checkpoint that a resumed run depends on."""
    with zipfile.ZipFile(file) as archive:
        for name in ("policy.pth", "policy.optimizer.pth"):
            content = torch.load(io.BytesIO(archive.read(name)), weights_only=True)
            yield from leaves(content, f"{file.name}/{name}")
        with np.load(io.BytesIO(archive.read("resume.npz"))) as arrays:
            for name in arrays.files:
                value = arrays[name]
                if name == "header":
                    yield from leaves(json.loads(value.tobytes()), f"{file.name}/header")
                else:
                    yield from leaves(value, f"{file.name}/{name}")


def traces(run: Path) -> dict[str, Any]:
    """Everything that a run leaves and that its seed decides, by name."""
    found: dict[str, Any] = {}
    for file in sorted(path for path in run.rglob("*") if path.is_file()):
        name = str(file.relative_to(run))
        if name in ("run.json", ".lock") or name.startswith("tensorboard/"):
            continue
        if file.suffix == ".zip":
            rows: Iterator[tuple[str, Any]] = of_checkpoint(file)
        elif file.suffix == ".pt":
            rows = leaves(torch.load(file, weights_only=True), "")
        elif file.suffix == ".jsonl":
            rows = leaves([json.loads(line) for line in file.read_text().splitlines()], "")
        else:
            rows = leaves(file.read_bytes(), "")
        found |= {f"{name}:{key}": value for key, value in rows}
    return found


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Names of what is not equal to the bit, or is in one only."""
    names = {*one, *other}
    missing = object()
    return sorted(name for name in names if one.get(name, missing) != other.get(name, missing))


# --- rounds -----------------------------------------------------------------------------------


def killed_round(
    config: TrainingConfig, run: Path, next_session: Callable[[int], int]
) -> tuple[int, int]:
    """Train a run to its end, however often it is killed; returns kills and the exit status."""
    for kills in range(MOST_KILLS):
        status = next_session(kills)
        if status != -signal.SIGKILL:
            return kills, status
    return MOST_KILLS, -signal.SIGKILL


def judge(name: str, run: Path, expected: dict[str, Any], kills: int, status: int) -> bool:
    """Print a round's row and return whether all was well."""
    different = differences(expected, traces(run)) if status == 0 else ["not finished"]
    left = [str(file) for file in run.rglob(".*.tmp")]
    row = {"round": name, "kills": kills, "exit_status": status, "left": left}
    print(json.dumps(row | {"different": different[:8]}), flush=True)
    return not different and not left


def check_random(recipe: str, folder: Path, rounds: int, whole: tuple[Any, float]) -> bool:
    """Rounds with kills at random moments."""
    config, (expected, seconds) = config_of(recipe), whole
    fine = True
    for number in range(rounds):
        run = folder / f"{recipe}-{number}"
        # Short ones hit the beginning again and again, long ones the last stages.
        most = seconds * random.choice((0.3, 0.6, 1.0))

        def next_session(kills: int, run: Path = run, most: float = most) -> int:
            return run_session(config, run, random.uniform(0.02, most * (1 + kills / 10)))

        kills, status = killed_round(config, run, next_session)
        fine &= judge(f"{recipe} {number}", run, expected, kills, status)
    return fine


def check_writes(
    recipe: str, folder: Path, whole: tuple[Any, float], first: int, every: int
) -> bool:
    """A round for every moment of writing: killed there once, then resumed to the end."""
    config, (expected, _) = config_of(recipe), whole
    fine, moment = True, first
    while True:
        run = folder / f"{recipe}-write-{moment}"
        status = run_session(config, run, die_at=moment)
        if status != -signal.SIGKILL:
            return fine and status == 0
        status = run_session(config, run)
        fine &= judge(f"{recipe} write {moment}", run, expected, 1, status)
        moment += every


def main() -> int:
    """Run the rounds of each recipe; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--recipes", nargs="+", default=list(SETTINGS), choices=list(SETTINGS))
    parser.add_argument("--writes", action="store_true", help="kill at every moment of writing")
    parser.add_argument("--first", type=int, default=0, help="the first such moment")
    parser.add_argument("--every", type=int, default=1, help="leave moments out")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    torch.set_num_threads(1)
    for owner, values in CONSTANTS:
        for constant, small in values.items():
            setattr(owner, constant, small)
    fine = True
    with tempfile.TemporaryDirectory() as place:
        for recipe in given.recipes:
            began = time.monotonic()
            status = run_session(config_of(recipe), Path(place) / recipe)
            if status != 0:
                sys.exit(f"{recipe}: the undisturbed run ended with status {status}")
            whole = traces(Path(place) / recipe), time.monotonic() - began
            print(json.dumps({"recipe": recipe, "seconds": round(whole[1], 1)}), flush=True)
            if given.writes:
                fine &= check_writes(recipe, Path(place), whole, given.first, given.every)
            else:
                fine &= check_random(recipe, Path(place), given.rounds, whole)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
