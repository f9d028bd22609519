"""``sim2vr-harness reach``: what a user can reach."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim2vr_harness.cli.options import (
    ConditionsOption,
    EnvSetOption,
    ObjectsOption,
    TrustOption,
    finite,
    game_option,
    known_users,
    print_written,
    writable_folder,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.envs.config import EnvConfig
    from sim2vr_harness.tools.reach.measuring import Measured
    from sim2vr_harness.tools.reach.targets import Target
    from sim2vr_harness.users.kinematics.forward import Point

_User = Annotated[
    str,
    typer.Argument(
        autocompletion=known_users,
        metavar="USER",
        help="A body or its YAML file, a configuration, or a trained user.",
    ),
]
_Point = Annotated[
    str | None,
    typer.Option(
        metavar="PART",
        help="What is to get there: a device or part of the body, such as controller_right or "
        "hand.",
        show_default="the first controller",
    ),
]
_Tool = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="An object that the game puts in the hand, instead of --point."
    ),
]
_Target = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]X,Y,Z", help="A place, m to the right, up and ahead; may be repeated."
    ),
]
_Log = Annotated[
    list[Path] | None,
    typer.Option(metavar="PATH", help="Targets of a round's log (events.csv or its folder)."),
]
_Game = Annotated[
    str | None,
    game_option("Targets of a game that is run, no one playing."),
]
_People = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="Say of the game's places how many of N people reach them who differ."
    ),
]
_Seconds = Annotated[
    float, typer.Option(help="How long to look at each of three rounds.", callback=finite)
]
_Cell = Annotated[
    float,
    typer.Option(help="Edge of the cells that the room is divided into, m.", callback=finite),
]
_Out = Annotated[Path, typer.Option(help="Folder for the files.", callback=writable_folder)]


def reach(
    user: _User = "mobl_arms_wrist",
    point: _Point = None,
    tool: _Tool = None,
    target: _Target = None,
    log: _Log = None,
    game: _Game = None,
    condition: ConditionsOption = None,
    objects: ObjectsOption = None,
    people: _People = None,
    seconds: _Seconds = 10.0,
    cell: _Cell = 0.05,
    out: _Out = Path("reach"),
    film: Annotated[bool, typer.Option("--film/--no-film", help="Film it from all sides.")] = True,
    set_: EnvSetOption = None,
    trust_app: TrustOption = False,
) -> None:
    """Measure what a user can reach, and which targets lie within.

    Examples:
        sim2vr-harness reach mobl_arms_wrist --target shelf=0.3,1.6,0.5
        sim2vr-harness reach whacamole_constrained --game whacamole --condition easy
    """
    from sim2vr_harness.envs.config import body_of
    from sim2vr_harness.tools.reach.measuring import chosen_point, measure
    from sim2vr_harness.tools.reach.targets import given_target, logged_targets
    from sim2vr_harness.tools.users import environment_of

    of_game = bool(condition) or objects is not None
    _check_together(point, tool, game, seconds, of_game=of_game, people=people)
    targets = [given_target(text) for text in target or ()]
    targets += [one for path in log or () for one in logged_targets(path)]
    conditions: list[str | None] = [*condition] if condition else [None]
    environments = [
        environment_of(user, game=game, condition=name, overrides=set_ or (), trust_app=trust_app)
        for name in conditions
    ]
    where = chosen_point(body := body_of(environments[0].user), point)
    shares: dict[int, str] = {}
    if game is not None:
        if tool is not None:
            where = _in_hand(environments[0], tool)
        for environment, name in zip(environments, conditions, strict=True):
            places, words = _of_game(environment, name, where, objects, seconds, people)
            shares |= {len(targets) + i: text for i, text in enumerate(words)}
            targets += places
    say("Measuring the reach ...")
    found = measure(body, where, targets, cell_m=cell)
    _tell(found, shares)
    _write(found, out, film=film)


def _write(found: Measured, out: Path, *, film: bool) -> None:
    from sim2vr_harness.tools.reach.files import write

    say("Writing files" + (" and the film" if film else "") + " ...")
    print_written(write(found, out, film=film))


def _check_together(
    point: str | None,
    tool: str | None,
    game: str | None,
    seconds: float,
    *,
    of_game: bool,
    people: int | None,
) -> None:
    """Refuse options that do not go together; ``of_game``: some need a game."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.base.optional import needed

    needed("plotly", "studies", "reach")
    if tool is not None and (point is not None or game is None):
        wrong = "it together with --point" if point is not None else "it without --game"
        raise InputError("--tool", wrong, "it with --game and without --point")
    if game is None and of_game:
        raise InputError("--condition or --objects", "it without --game", "it with --game")
    if people is not None and game is None:
        raise InputError("--people", "it without --game", "it with --game")
    if not 0.0 < seconds <= 600.0:
        raise InputError("--seconds", f"{seconds:g}", "more than 0, at most 600")


def _of_game(
    environment: EnvConfig,
    condition: str | None,
    where: Point,
    objects: str | None,
    seconds: float,
    people: int | None,
) -> tuple[list[Target], list[str]]:
    """Return the places of a game's condition, and what is said of each of how many reach it."""
    from dataclasses import replace
    from functools import partial

    from sim2vr_harness.tools.reach.people import alike, people_reach

    look = partial(_look, objects=objects, seconds=seconds)
    places = look(alike(environment), None)
    words = []
    if people is not None:
        reached = people_reach(environment, where, places, people, look)
        words = [reached.words(i) for i in range(len(places))]
    return [replace(one, name=f"{condition or ''} {one.name}".strip()) for one in places], words


def _look(
    environment: EnvConfig, person: int | None, objects: str | None, seconds: float
) -> list[Target]:
    from sim2vr_harness.tools.reach.targets import seen_targets

    return seen_targets(environment, objects, seconds=seconds, person=person)


def _in_hand(environment: EnvConfig, tool: str) -> Point:
    from contextlib import closing

    from sim2vr_harness.envs.simulation import Simulation
    from sim2vr_harness.tools.reach.people import alike
    from sim2vr_harness.tools.reach.targets import tool_point

    with closing(Simulation(alike(environment), 1)) as users:
        users.reset(seeds=[1])
        return tool_point(users.apps[0].scene(), tool)


def _tell(found: Measured, shares: Mapping[int, str]) -> None:
    from sim2vr_harness.tools.reach.figures import caption
    from sim2vr_harness.tools.reach.page import margin_words

    typer.echo(caption(found))
    for name, low, high in zip(("right", "up", "ahead"), *found.extent_m, strict=True):
        typer.echo(f"  {name:5} {low:7.3f} to {high:6.3f} m")
    for i, (target, verdict) in enumerate(zip(found.targets, found.verdicts, strict=True)):
        words = f"; {shares[i]}" if i in shares else ""
        typer.echo(f"  {target.name}: {margin_words(verdict.margin_m)}{words}")
