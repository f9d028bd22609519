"""``sim2vr-harness reach``: what a user can reach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.options import (
    ChangedEnvironment,
    GameConditions,
    TrustedApp,
    print_written,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.envs.config import EnvConfig
    from sim2vr_harness.tools.reach.measuring import Measured
    from sim2vr_harness.tools.reach.targets import Target
    from sim2vr_harness.users.kinematics.forward import Point


@dataclass(frozen=True, kw_only=True)
class ReachRequest(GameConditions, ChangedEnvironment, TrustedApp):
    """Who reaches, and for what."""

    user: str = argument(
        "USER",
        "A body or its YAML file, a configuration, or a trained user.",
        "mobl_arms_wrist",
        names="users",
    )
    point: str | None = option(
        "What is to get there: a device or part of the body, such as controller_right or hand.",
        metavar="PART",
        shown="the first controller",
    )
    tool: str | None = option(
        "An object that the game puts in the hand, instead of --point.", metavar="NAME"
    )
    target: tuple[str, ...] = option(
        "A place, m to the right, up and ahead; may be repeated.", (), metavar="[NAME=]X,Y,Z"
    )
    log: tuple[Path, ...] = option(
        "Targets of a round's log (events.csv or its folder).", (), metavar="PATH"
    )
    game: str | None = option(
        "Targets of a game that is run, no one playing.", metavar="NAME", names="games"
    )
    objects: str | None = option(
        "Which of the game's objects are targets, with * and ?.",
        metavar="NAME",
        shown="those that come, go or move",
    )
    people: int | None = option(
        "Say of the game's places how many of N people reach them who differ.", metavar="N"
    )
    seconds: float = option("How long to look at each of three rounds.", 10.0)
    cell: float = option("Edge of the cells that the room is divided into, m.", 0.05)
    out: Path = option("Folder for the files.", Path("reach"), place="folder to write")
    film: bool = option("Film it from all sides.", True)


def reach(request: ReachRequest) -> None:
    """Measure what a user can reach, and which targets lie within.

    Examples:
        sim2vr-harness reach mobl_arms_wrist --target shelf=0.3,1.6,0.5
        sim2vr-harness reach whacamole_constrained --game whacamole --condition easy
    """
    from sim2vr_harness.envs.config import body_of
    from sim2vr_harness.tools.reach.files import write
    from sim2vr_harness.tools.reach.measuring import chosen_point, measure
    from sim2vr_harness.tools.reach.targets import given_target, logged_targets
    from sim2vr_harness.tools.users import environment_of

    user, game = request.user, request.game
    _check_together(request)
    targets = [given_target(text) for text in request.target]
    targets += [one for path in request.log for one in logged_targets(path)]
    conditions: list[str | None] = [*request.condition] or [None]
    how: Any = {"overrides": request.set_, "trust_app": request.trust_app}
    environments = [environment_of(user, game=game, condition=c, **how) for c in conditions]
    where = chosen_point(body := body_of(environments[0].user), request.point)
    shares: dict[int, str] = {}
    if game is not None:
        if request.tool is not None:
            where = _in_hand(environments[0], request.tool)
        for environment, name in zip(environments, conditions, strict=True):
            places, words = _of_game(
                environment, name, where, request.objects, request.seconds, request.people
            )
            shares |= {len(targets) + i: text for i, text in enumerate(words)}
            targets += places
    say("Measuring the reach ...")
    found = measure(body, where, targets, cell_m=request.cell)
    _tell(found, shares)
    say("Writing files" + (" and the film" if request.film else "") + " ...")
    print_written(write(found, request.out, film=request.film))


def _check_together(request: ReachRequest) -> None:
    """Refuse options that do not go together."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.base.optional import needed

    needed("plotly", "studies", "reach")
    game = request.game
    if request.tool is not None and (request.point is not None or game is None):
        wrong = "it together with --point" if request.point is not None else "it without --game"
        raise InputError("--tool", wrong, "it with --game and without --point")
    if game is None and (request.condition or request.objects is not None):
        raise InputError("--condition or --objects", "it without --game", "it with --game")
    if request.people is not None and game is None:
        raise InputError("--people", "it without --game", "it with --game")
    if not 0.0 < request.seconds <= 600.0:
        raise InputError("--seconds", f"{request.seconds:g}", "more than 0, at most 600")


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
