"""Trainings that are killed and resumed leave the same bits, and the tool that says so can tell."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[3] / "tools/attack/kill_trainers.py"


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
