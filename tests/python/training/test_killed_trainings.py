"""Trainings that are killed and resumed leave the same bits, and the tool that says so can tell."""

import importlib.util
import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

TOOL = Path(__file__).parents[3] / "tools/attack/kill_trainers.py"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("kill_trainers", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def change_environment(file: Path) -> None:
    """Turn one bit of a checkpoint's environment."""
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    place = file.with_suffix(".npz")
    place.write_bytes(parts["resume.npz"])
    with np.load(place) as loaded:
        arrays = dict(loaded)
    place.unlink()
    arrays["environment.simulation"][-1] ^= 1
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            if name != "resume.npz":
                archive.writestr(name, content)
        with archive.open("resume.npz", "w") as stream:
            np.savez(stream, **arrays)


def test_what_differs_is_found(tool: ModuleType, trained: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    expected = tool.traces(trained)
    assert tool.differences(expected, tool.traces(run)) == []
    log = run / "metrics.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    rows[0]["time/update_seconds"] = 12345.0  # wall time differs in every session
    log.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert tool.differences(expected, tool.traces(run)) == []
    episode = {"r": 2.0, "l": 3, "t": 4.5}  # the last is wall time, too
    assert list(tool.leaves({"episodes": [episode]}, "")) == [
        (".episodes[0].r", 2.0),
        (".episodes[0].l", 3),
    ]
    rows[0]["train/loss"] += 1e-12
    log.write_text("".join(json.dumps(row) + "\n" for row in [*rows, rows[-1]]))
    found = tool.differences(expected, tool.traces(run))
    assert "metrics.jsonl:[0].train/loss" in found
    assert "metrics.jsonl:[2].step" in found, "a row twice"
    shutil.copy(trained / "metrics.jsonl", log)
    (checkpoint,) = (run / "checkpoints").iterdir()
    change_environment(checkpoint)
    name = f"checkpoints/{checkpoint.name}:{checkpoint.name}/environment.simulation"
    assert tool.differences(expected, tool.traces(run)) == [name]
    checkpoint.unlink()
    assert len(tool.differences(expected, tool.traces(run))) > 10


@pytest.mark.slow
@pytest.mark.parametrize(
    "how",
    [
        ("--recipes", "ppo", "distill", "skills", "--rounds", "1"),
        ("--recipes", "ppo", "--writes", "--first", "3", "--every", "12"),
    ],
)
def test_killed_and_resumed_to_the_same_bits(how: tuple[str, ...]) -> None:
    done = subprocess.run([sys.executable, TOOL, *how], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert sum(row.get("kills", 0) for row in rows) >= 2
