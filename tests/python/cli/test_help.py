"""``--help``: groups, whole lines, and examples."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer.main
from PIL import Image

from python.cli.calls import call
from sim2vr_harness.cli.main import app


def shown_commands() -> list[tuple[str, Any]]:
    """Every command and group that is listed, with the words that call it."""
    found: list[tuple[str, Any]] = []
    waiting: list[tuple[str, Any]] = [("", typer.main.get_command(app))]
    while waiting:
        words, command = waiting.pop()
        found.append((words, command))
        below = getattr(command, "commands", {}).items()
        waiting += [(f"{words} {name}".strip(), each) for name, each in below if not each.hidden]
    return found


@pytest.mark.parametrize(("words", "command"), shown_commands(), ids=lambda each: str(each)[:30])
def test_help_ends_with_two_examples(capsys: Any, words: str, command: Any) -> None:
    out = call(capsys, *words.split(), "--help")[1]
    lines = out.rstrip().splitlines()
    assert lines[-3] == "Examples:"
    assert [line.strip() for line in lines[-2:]] == list(command.examples)
    assert lines[-2] != lines[-1]
    for example in command.examples:
        assert f"{example} ".startswith(f"sim2vr-harness {words} ".replace("  ", " "))


def test_a_game_lists_measures_and_options(capsys: Any) -> None:
    """Numbers of TouchTheBall::configure and its facts, in sample.cpp."""
    out = call(capsys, "games", "sample")[1]
    rows = [line.split() for line in out.splitlines()]
    assert ["ball_radius_m", "number", "0.05", "0.01", "to", "0.2"] in rows
    assert ["round_seconds", "number", "20.0", "1", "to", "600"] in rows
    assert any(row[:5] == ["Distance", "to", "the", "ball", "distance_m"] for row in rows)
    whacamole = json.loads(call(capsys, "games", "whacamole", "--json")[1])[0]
    assert whacamole["score"] == "hit_rate"
    options = {option["name"]: option for option in whacamole["options"]}
    assert options["hand"]["choices"] == ["right", "left"]
    assert options["adaptive"]["type"] == "bool"
    assert options["spawn_times"]["default"] == []
    assert {"easy", "medium"} < set(options["condition"]["choices"])


def test_a_snapshot_takes_user_and_set(tmp_path: Path, capsys: Any) -> None:
    """With --set the images have another size; without --user the idle baseline plays."""
    found = []
    small = ("--set", "env.vision.width=60", "--set", "env.vision.height=40", "--user", "random")
    for out, more in ((tmp_path / "plain", ()), (tmp_path / "small", small)):
        command = ("render", "snapshot", "--seconds", "0.2", "--size", "64x48")
        assert call(capsys, *command, "--out", str(out), *more)[0] == 0
        with Image.open(out / "observation.png") as image:
            found.append(((out / "body.png").read_bytes(), image.size))
    (plain, large), (random, tiny) = found
    assert (large, tiny) == ((240, 80), (120, 40))
    assert plain != random
