"""A few seconds of ``tools/attack/fuzz_files.py``: no reader fails on any file."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "tools" / "attack"))

import fuzz_files


@pytest.mark.parametrize("target", ["yaml", "override", "json", "arrays", "tensors", "packed"])
def test_no_input_breaks_a_reader(target: str, tmp_path: Path) -> None:
    counts, broken = fuzz_files.attack(60.0, 11, target, tmp_path, most=60)
    assert broken == []
    assert counts[target] == 60
    assert 0 < counts[f"{target} read"] < 60  # some are still valid, most are not


@pytest.mark.parametrize("target", ["config", "body", "card", "results", "manifest", "states"])
def test_no_file_breaks_its_reader(target: str, tmp_path: Path) -> None:
    counts, broken = fuzz_files.attack(60.0, 12, target, tmp_path, most=25)
    assert broken == []
    assert counts[target] == 25


def test_no_argument_breaks_a_command(tmp_path: Path) -> None:
    counts, broken = fuzz_files.attack(60.0, 13, "arguments", tmp_path, most=30)
    assert broken == []
    assert counts["arguments"] == 30
