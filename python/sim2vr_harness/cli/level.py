"""``sim2vr-harness plot level``: what comes when in a level, as a picture and a few numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.paths import uri_unless_utf8
from sim2vr_harness.base.written_values import written_value
from sim2vr_harness.cli.options import (
    JsonOption,
    game_option,
    print_json,
    writable_file,
)
from sim2vr_harness.client import OptionValue, describe_game, describe_level, list_games

_Name = Annotated[
    str,
    typer.Argument(metavar="LEVEL", help="A level that comes with the game, or the file of one."),
]
_Game = Annotated[
    str | None,
    game_option("The game.", "the one with levels"),
]
_Difficulty = Annotated[str | None, typer.Option(metavar="NAME", help="Of a map with several.")]
_Characteristic = Annotated[str | None, typer.Option(metavar="NAME", help="Of a map with several.")]
_Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Another option of the game: --set env.app.options.NAME=VALUE, or NAME=VALUE; may "
        "be repeated.",
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option(metavar="FILE.png", help="Draw the level into this file.", callback=writable_file),
]


def level(
    name: _Name,
    game: _Game = None,
    difficulty: _Difficulty = None,
    characteristic: _Characteristic = None,
    set_: _Set = None,
    seed: Annotated[int, typer.Option(help="Of a level that is made of one.")] = 1,
    out: _Out = None,
    json: JsonOption = False,
) -> None:
    """Print what is in a level, and draw it over time.

    Examples:
        sim2vr-harness plot level generated --seed 7 --out level.png
        sim2vr-harness plot level generated --set boxes_per_second=1.5
    """
    from sim2vr_harness.figures.level_timeline import draw_timeline

    chosen, option = _game_with_levels(game)
    options: dict[str, OptionValue] = {option: uri_unless_utf8(name)}
    if difficulty is not None:
        options["difficulty"] = difficulty
    if characteristic is not None:
        options["characteristic"] = characteristic
    for given in set_ or []:
        key, value = _read_option(given)
        options[key] = value
    timeline = describe_level(chosen, options, seed)
    written = None if out is None else draw_timeline(timeline, out)
    if json:
        print_json({"name": timeline.name, **timeline.facts})
        return
    told = ", ".join(f"{label} {value}" for label, value in timeline.facts.items())
    typer.echo(f"{timeline.name}: {told}")
    if written is not None:
        typer.echo(f"Written: {written}")


def _game_with_levels(wanted: str | None) -> tuple[str, str]:
    """The game and its option that names the level."""
    names = [wanted] if wanted is not None else sorted(list_games())
    for name in names:
        option = describe_game(name).level_option
        if option is not None:
            return name, option
    raise InputError("--game", repr(wanted) if wanted else "none", "a game with levels")


def _read_option(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    name = key.strip().removeprefix("env.app.options.")
    if not equals or not name:
        raise InputError("--set", repr(text), "NAME=VALUE or env.app.options.NAME=VALUE")
    return name, written_value(uri_unless_utf8(value), OptionValue)
