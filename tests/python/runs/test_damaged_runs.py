"""What is saved is finite, what is damaged is named and kept, and one training works at a time."""

import io
import os
import re
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
import torch
from fake_simulation import FakeSimulation
from test_trainer import ITERATION, assert_same_learner, rows_without_times, run

from sim2vr_harness.base.errors import InputError, UnusableFile
from sim2vr_harness.base.file_lock import sweep
from sim2vr_harness.base.finite import NotFinite
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs import checkpoint
from sim2vr_harness.runs.run_folder import RunFolder

NAN = float("nan")


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in (folder / "checkpoints").iterdir())


class Spoilt:
    """Makes a number of the learner NaN after so many updates."""

    def __init__(self, patch: pytest.MonkeyPatch, after: int, where: str) -> None:
        original = torch.optim.Adam.step
        calls = 0

        def step(optimizer: torch.optim.Adam, *args: Any) -> Any:
            nonlocal calls
            calls += 1
            done = original(optimizer, *args)
            if calls == after:
                weight = optimizer.param_groups[0]["params"][0]
                if where == "weight":
                    weight.data[0] = NAN
                else:
                    optimizer.state[weight]["exp_avg"][0] = NAN
            return done

        patch.setattr(torch.optim.Adam, "step", step)


@pytest.mark.parametrize(
    ("after", "where", "what"),
    [
        # 8 minibatches an update.
        (3 * 8, "weight", r"policy\.\S+ is not finite after 180 user steps"),
        (3 * 8, "moment", r"optimizer\.state\.0\.exp_avg is not finite after 180 user steps"),
    ],
)
def test_weights_that_are_not_finite_are_never_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int, where: str, what: str
) -> None:
    whole, folder = run(tmp_path / "whole", 4 * ITERATION), tmp_path / "run"
    good = r".*, and none of it was saved; the last good one is .*step_000000120\.zip$"
    with monkeypatch.context() as patch:
        Spoilt(patch, after, where)
        with pytest.raises(NotFinite, match=what + good) as stopped:
            run(folder, 4 * ITERATION)
    assert len(str(stopped.value)) < 400
    assert names(folder)[-1] == "step_000000120.zip"
    assert RunFolder(folder).metadata()["sessions"][-1]["status"] == "failed"
    # What went astray is gone: the run goes on as if nothing had been.
    last = run(folder, 4 * ITERATION, resume=True)
    assert_same_learner(whole.checkpoint, last.checkpoint)
    assert rows_without_times(tmp_path / "whole") == rows_without_times(folder)


# --- damaged files ----------------------------------------------------------------------------


def rewrite(file: Path, member: str, change: Any) -> None:
    """Write a checkpoint again with one member changed."""
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    parts[member] = change(parts[member])
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)


def tensors(change: Any) -> Any:
    def changed(content: bytes) -> bytes:
        loaded = torch.load(io.BytesIO(content), weights_only=True)
        change(loaded)
        stream = io.BytesIO()
        torch.save(loaded, stream)
        return stream.getvalue()

    return changed


def all_nan(weights: dict[str, torch.Tensor]) -> None:
    for key in weights:
        weights[key] = torch.full_like(weights[key], NAN)


def narrower(weights: dict[str, torch.Tensor]) -> None:
    weights["log_std"] = torch.zeros(2)


def other_moment(optimizer: dict[str, Any]) -> None:
    optimizer["state"][0]["exp_avg"] = torch.zeros(5)


DAMAGE = {
    "cut off": (
        lambda file: os.truncate(file, file.stat().st_size // 2),
        "zip archive|an archive without",
    ),
    "a program": (
        lambda file: rewrite(file, "policy.pth", lambda _: b"cos\nsystem\n(S'touch pwned'\ntR."),
        "no tensors of torch, or damaged ones",
    ),
    "not finite": (
        lambda file: rewrite(file, "policy.pth", tensors(all_nan)),
        r"policy\.\S+ is not finite",
    ),
    "shapes": (
        lambda file: rewrite(file, "policy.pth", tensors(narrower)),
        r"whose network differs: log_std of shape \(2,\), expected \(3,\)",
    ),
    "moments": (
        lambda file: rewrite(file, "policy.optimizer.pth", tensors(other_moment)),
        r"exp_avg of the optimiser of shape \(5,\), expected",
    ),
    "not readable": (lambda file: (file.unlink(), file.mkdir()), "a folder"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_newest_checkpoint_that_cannot_be_used(tmp_path: Path, kind: str) -> None:
    whole, folder = run(tmp_path / "whole", 4 * ITERATION), tmp_path / "a run"
    run(folder, 2 * ITERATION)
    newest = run(folder, 3 * ITERATION, resume=True).checkpoint
    damage, reason = DAMAGE[kind]
    damage(newest)
    before = newest.read_bytes() if newest.is_file() else b""
    with pytest.raises(UnusableFile) as refused:
        run(folder, 4 * ITERATION, resume=True)
    said = str(refused.value)
    assert said.startswith(f"RUN: got '{newest}' (")
    assert re.search(reason, said, re.IGNORECASE), said
    assert said.endswith(f"sim2vr-harness train --resume '{folder}' --set-aside")
    assert refused.value.instead == folder / "checkpoints/step_000000120.zip"
    assert newest.exists(), "nothing is deleted"
    # As it says.
    last = run(folder, 4 * ITERATION, resume=True, set_aside=True)
    assert_same_learner(whole.checkpoint, last.checkpoint)
    assert rows_without_times(tmp_path / "whole") == rows_without_times(folder)
    kept = folder / "checkpoints/step_000000180.zip.aside"
    assert (kept.read_bytes() if kept.is_file() else b"") == before
    assert not list(Path().glob("pwned"))


def test_a_user_of_a_damaged_checkpoint_is_refused_and_another_offered(tmp_path: Path) -> None:
    run(tmp_path / "run", ITERATION)
    result = run(tmp_path / "run", 2 * ITERATION, resume=True)
    rewrite(result.checkpoint, "policy.pth", tensors(all_nan))
    from sim2vr_harness.policies.registry import load_policy

    user, senses = find_user(tmp_path / "run"), FakeSimulation()
    with pytest.raises(
        UnusableFile, match=r"not finite\).*; the last good one is '.*step_000000060\.zip'$"
    ):
        load_policy(user, senses.observation_space, senses.action_space)


# --- leftovers, and others at work ------------------------------------------------------------


def test_only_dead_trainings_leftovers_are_swept(tmp_path: Path) -> None:
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    dead = ended.pid
    stage = tmp_path / "student"
    stage.mkdir()
    left = [tmp_path / f".run.json.{dead}.tmp", stage / f".state.pt.{dead}.tmp"]
    own = tmp_path / f".config.yaml.{os.getpid()}.tmp"  # of an earlier process of this number
    kept = [tmp_path / f".a.zip.{child.pid}.tmp", tmp_path / ".notes.tmp", tmp_path / "b.1.tmp"]
    for file in [*left, own, *kept]:
        file.write_text("")
    assert sorted(sweep(tmp_path)) == sorted([*left, own])
    assert all(file.exists() for file in kept)
    child.communicate(b"\n")


def test_two_trainings_in_one_folder(tmp_path: Path) -> None:
    folder = RunFolder(run(tmp_path / "run", ITERATION).folder.path)
    link = tmp_path / "link"
    link.symlink_to(folder.path)
    code = (
        "import sys; from pathlib import Path\n"
        "from sim2vr_harness.base.file_lock import sole_training\n"
        "with sole_training(Path(sys.argv[1]), Path(sys.argv[1]) / '.lock'):\n"
        "    print(flush=True); input()\n"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(folder.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert holder.stdout is not None
    holder.stdout.readline()
    for path, how in [
        (folder.path, {"resume": True}),
        (link, {"resume": True}),
        (folder.path, {"overwrite": True}),
    ]:
        before = (folder.path / "run.json").read_bytes()
        with pytest.raises(InputError, match="in which another training is running"):
            run(path, 2 * ITERATION, **how)
        assert (folder.path / "run.json").read_bytes() == before
    holder.kill()  # the lock goes with its process, however it ends
    holder.communicate()
    assert run(link, 2 * ITERATION, resume=True).step == 2 * ITERATION


def test_a_full_disk_stops_with_the_file_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, folder = run(tmp_path / "whole", 3 * ITERATION), tmp_path / "run"
    run(folder, ITERATION)
    fsync = os.fsync

    def full(descriptor: int) -> None:
        if "step_000000120" in os.readlink(f"/proc/self/fd/{descriptor}"):
            raise OSError(28, "No space left on device")
        fsync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left") as stopped:
            run(folder, 3 * ITERATION, resume=True)
    assert str(stopped.value.filename).endswith("step_000000120.zip")
    assert names(folder) == ["step_000000060.zip"]
    last = run(folder, 3 * ITERATION, resume=True)
    assert_same_learner(whole.checkpoint, last.checkpoint)
    assert rows_without_times(tmp_path / "whole") == rows_without_times(folder)


def test_signals_wait_while_torch_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Torch calls back into Python: an exception there was another one, or the process's end.
    whole, folder = run(tmp_path / "whole", 3 * ITERATION), tmp_path / "run"
    save, saved = torch.save, []

    class Impatient(io.BytesIO):
        def write(self, part: Any) -> int:
            if len(saved) == 2:
                os.kill(os.getpid(), signal.SIGTERM)  # at every single call
            return super().write(part)

    def saving(content: Any, file: Any, *more: Any, **how: Any) -> None:
        saved.append(file)
        stream = Impatient()
        save(content, stream, *more, **how)
        file.write(stream.getvalue())

    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", saving)
        result = run(folder, 3 * ITERATION)
    assert (result.interrupted, result.step) == (True, 2 * ITERATION)
    assert RunFolder(folder).metadata()["sessions"][-1]["status"] == "interrupted"
    checkpoint.require_readable(result.checkpoint)
    last = run(folder, 3 * ITERATION, resume=True)
    assert_same_learner(whole.checkpoint, last.checkpoint)
