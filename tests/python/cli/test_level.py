"""``sim2vr-harness plot level``, with a game whose levels are made up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from sim2vr_harness.cli import level
from sim2vr_harness.cli.level import _read_option
from sim2vr_harness.cli.main import app
from sim2vr_harness.cli.motor import _changes
from sim2vr_harness.client import GameFacts, Timeline

ASKED: list[tuple[str, dict[str, Any], int]] = []


@pytest.fixture(autouse=True)
def games(monkeypatch: pytest.MonkeyPatch) -> None:
    def facts(name: str) -> GameFacts:
        return GameFacts(name, level_option="piece" if name == "piano" else None)

    def timeline(game: str, options: dict[str, Any], seed: int) -> Timeline:
        ASKED.append((game, options, seed))
        return Timeline("a level", 5.0, ("low",), (), (), {"boxes": 3, "length": "5.0 s"})

    ASKED.clear()
    monkeypatch.setattr(level, "list_games", lambda: {"organ": "", "piano": ""})
    monkeypatch.setattr(level, "describe_game", facts)
    monkeypatch.setattr(level, "describe_level", timeline)


def test_the_game_with_levels_is_found_and_told_the_options(tmp_path: Path) -> None:
    out = tmp_path / "level.png"
    arguments = [
        "plot",
        "level",
        "x.zip",
        "--difficulty",
        "Easy",
        "--set",
        "speed=2.5",
        "--seed",
        "4",
    ]
    result = CliRunner().invoke(app, [*arguments, "--out", str(out)])
    assert result.output == f"a level: boxes 3, length 5.0 s\nWritten: {out}\n"
    assert ASKED == [("piano", {"piece": "x.zip", "difficulty": "Easy", "speed": 2.5}, 4)]
    assert out.read_bytes().startswith(b"\x89PNG")


def test_the_facts_come_as_json() -> None:
    result = CliRunner().invoke(app, ["plot", "level", "x", "--json"])
    assert json.loads(result.output) == {"name": "a level", "boxes": 3, "length": "5.0 s"}


def test_a_game_without_levels_is_refused() -> None:
    result = CliRunner().invoke(app, ["plot", "level", "x", "--game", "organ"])
    assert str(result.exception) == "--game: got 'organ', expected a game with levels"


def test_whole_and_short_keys_of_set_are_the_same() -> None:
    assert _read_option("speed=2.5") == _read_option("env.app.options.speed=2.5") == ("speed", 2.5)
    assert _changes(["cycles=3"]) == _changes(["skills.motor_training.cycles=3"])


def test_an_option_without_value_is_refused() -> None:
    result = CliRunner().invoke(app, ["plot", "level", "x", "--set", "speed"])
    assert (
        str(result.exception)
        == "--set: got 'speed', expected NAME=VALUE or env.app.options.NAME=VALUE"
    )
