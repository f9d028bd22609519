"""The examples of other learners run as they are, where their package is installed."""

import importlib.util
import subprocess
import sys
from pathlib import Path

from parts import needs

EXAMPLES = Path(__file__).resolve().parents[3] / "docs/examples"


def run(name: str, *arguments: str, timeout_s: float = 300.0) -> str:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout_s,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_stable_baselines3(tmp_path: Path) -> None:
    file = tmp_path / "user.zip"
    out = run(
        "train_with_sb3.py", "--steps", "64", "--users", "2", "--n-steps", "32", "--out", str(file)
    )
    assert "| 64 " in out
    assert out.endswith(f"Written: {file}\n")
    assert file.is_file()


def test_one_file_in_the_manner_of_cleanrl() -> None:
    out = run("train_with_cleanrl.py", "--steps", "128", "--users", "2", "--n-steps", "32")
    assert [line.split(":")[0] for line in out.splitlines()] == ["step 64", "step 128"]


@needs("extras", importlib.util.find_spec("tree"), "no RLlib (pip install 'ray[rllib]')")
def test_rllib() -> None:
    out = run(
        *("train_with_rllib.py", "--iterations", "1", "--workers", "0", "--batch-size", "64"),
    )
    assert out.startswith("iteration 1")
