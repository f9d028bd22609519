"""``sim2vr-harness audit``: who can use an app, and how hard it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

from sim2vr_harness.base.requests import option
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import (
    ChangedEnvironment,
    CheckedRun,
    Expected,
    GameConditions,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.audit.population import Stance
    from sim2vr_harness.audit.targets import AuditTarget, How
    from sim2vr_harness.evaluation.expectations import Planned

_MOST_PEOPLE = 10_000
_TWO_HANDED = "mobl_arms_bimanual"
"""Looks at games that are played with both hands."""


@dataclass(frozen=True, kw_only=True)
class AuditRequest(GameConditions, Expected, ChangedEnvironment, PageOptions):
    """The targets of an audit, and its persons."""

    game: str | None = option(
        "Targets of a game, found by running it.", metavar="NAME", names="games"
    )
    objects: str | None = option(
        "Which of the game's objects are targets, with * and ?, by their names.",
        metavar="NAME",
        shown="those that come, go or move, and small ones",
    )
    targets: Path | None = option(
        "A list of targets: name, place or object, how, hold_s and more.",
        metavar="FILE.yaml",
        place="file to read",
    )
    session: Path | None = option(
        "Targets are where a recorded session's hands pressed a trigger or squeeze.",
        metavar="FILE",
        place="file to read",
    )
    how: str = option("What is done with a game's targets: touch or point.", "touch", metavar="HOW")
    seconds: float = option("How long to look at each round of the game, or at the page.", 10.0)
    people: int = option("Persons, 1 to 10,000.", 500, metavar="N")
    stance: str = option("Of the persons: seated or standing.", "seated", metavar="STANCE")
    pace: float = option("Uses of a target in a minute.", 20.0, metavar="N")
    operate: int = option("How many persons act it out.", 0, metavar="N")
    seed: int = option("Other persons for another seed.", 1)
    out: Path = option("Folder for the files.", Path("audit"), place="folder to write")


def audit(request: AuditRequest) -> int:
    """Say who can see, reach and hold an app's targets.

    Examples:
        sim2vr-harness audit --page shop.html --people 100
        sim2vr-harness audit --game whacamole --expect "reach.min >= 0.95"
    """
    from sim2vr_harness.audit.auditing import run
    from sim2vr_harness.audit.recorded import pressed_places
    from sim2vr_harness.audit.summary import estimates

    remote = request.remote()
    _check(request, remote)
    stance, how = cast("Stance", request.stance), cast("How", request.how)
    checked = CheckedRun(replace(request, expect=_with_group(request.expect)), "audit")
    listed = []
    if request.targets is not None or remote:
        listed += _listed(request.targets, remote, request.set_, request.seconds)
    if request.session is not None:
        listed += pressed_places(request.session)
    if checked.asked:
        checked.prepare(_planned(stance))
    if request.game is not None:
        for name in request.condition or (None,):
            listed += _of_game(request, request.game, name, how)
    title = request.game or _title(remote, request.targets or request.session)
    done = run(
        title,
        listed,
        people=request.people,
        seed=request.seed,
        stance=stance,
        pace=request.pace,
        operate=request.operate,
        say=say,
    )
    _tell(done, request.out)
    return checked.status(lambda: estimates(done))


def _title(settings: Mapping[str, Any], source: Path | None) -> str:
    """What an app without a game's name is called."""
    page = settings.get("page")
    title = _page_name(page) if page else settings.get("game")
    return title or (source.stem if source else "")


def _tell(done: Any, out: Path) -> None:
    """Print what was found, and write the report."""
    from sim2vr_harness.audit.report import findings, headline, unanswered, write
    from sim2vr_harness.audit.summary import plain

    values = plain(done)
    for sentence in (headline(values), *findings(values), unanswered(values)):
        if sentence:
            typer.echo(sentence)
    for file in write(done, out):
        typer.echo(f"Written: {file}")


def _page_name(page: str) -> str:
    """The file's name, or its folder's where that says more."""
    file = Path(page).resolve()
    return file.parent.name if file.name == "index.html" else file.name


def _check(request: AuditRequest, remote: Mapping[str, Any]) -> None:
    """Refuse options that are out of range or do not go together."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.base.optional import needed

    people, game = request.people, request.game
    if not 0.1 <= request.pace <= 120.0:
        raise InputError("--pace", f"{request.pace:g}", "0.1 to 120 uses in a minute")
    if not 0 <= request.operate <= people:
        expected = f"0 to the {people} persons of --people"
        raise InputError("--operate", str(request.operate), expected)
    needed("plotly", "studies", "audit")
    listed = request.targets is not None or request.session is not None
    if game is None and not listed and remote.get("page") is None:
        if remote:
            expected = "it with --targets FILE.yaml or --session, since a program lists no objects"
            raise InputError("--openxr", "a program without --targets", expected)
        raise InputError("--game, --page, --targets or --session", "none", "one of them")
    if game is not None and remote:
        raise InputError("--page or --openxr", "it together with --game", "one of them")
    if request.set_ and game is None and not remote:
        raise InputError("--set", "it without an app", "it with --game or --page")
    if game is None and (request.condition or request.objects is not None):
        raise InputError("--condition or --objects", "it without --game", "it with --game")
    for name, got, known in (
        ("--how", request.how, ("touch", "point")),
        ("--stance", request.stance, ("seated", "standing")),
    ):
        if got not in known:
            raise InputError(name, repr(got), " or ".join(known))
    if not 1 <= people <= _MOST_PEOPLE:
        raise InputError("--people", str(people), f"1 to {_MOST_PEOPLE:,}")
    if not 0 <= request.seed < 2**31:
        raise InputError("--seed", str(request.seed), f"0 to {2**31 - 1}")
    if not 0.0 < request.seconds <= 600.0:
        raise InputError("--seconds", f"{request.seconds:g}", "more than 0, at most 600")


def _with_group(expect: Sequence[str]) -> tuple[str, ...]:
    """Expectations without a group are about everyone."""
    from sim2vr_harness.audit.summary import EVERYONE
    from sim2vr_harness.evaluation.expectations import Expectation

    return tuple(
        text if Expectation.of(text).group is not None else f"{EVERYONE}: {text}" for text in expect
    )


def _planned(stance: Stance) -> Planned:
    from sim2vr_harness.audit.auditing import limitations_of
    from sim2vr_harness.audit.population import GROUPS
    from sim2vr_harness.audit.summary import EVERYONE, MEASURES
    from sim2vr_harness.evaluation.expectations import Planned

    limited = (each.name for each in limitations_of(stance))
    return Planned((EVERYONE, *GROUPS, *limited), MEASURES, ())


def _listed(
    targets: Path | None,
    remote: Mapping[str, Any],
    overrides: Sequence[str],
    seconds: float,
) -> list[AuditTarget]:
    """Return the targets of a file, those of objects located in the page, or the page's things."""
    from sim2vr_harness.audit.pages import find_things, located, things_as_targets
    from sim2vr_harness.audit.targets import read_targets
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation.environment import evaluation_env
    from sim2vr_harness.runs.config import TrainingConfig

    env = evaluation_env(TrainingConfig(), remote, overrides, source="--set") if remote else None
    if targets is not None:
        return located(read_targets(targets), env)
    if env is None:
        return []
    say(f"things of {env.app.page} ...")
    found = things_as_targets(find_things(env, seconds, say=say))
    if not found:
        expected = "objects that listen or react to a controller, or --targets FILE.yaml"
        raise InputError("--page", f"{env.app.page}, in which nothing is found", expected)
    return found


def _of_game(
    request: AuditRequest, game: str, condition: str | None, how: How
) -> list[AuditTarget]:
    from sim2vr_harness.audit.population import MODEL
    from sim2vr_harness.audit.targets import found_targets
    from sim2vr_harness.envs.games import game_facts
    from sim2vr_harness.tools.users import environment_of

    chosen = [f"env.app.game={game}", *request.set_]  # before the options, which are the game's
    env = environment_of(MODEL, condition=condition, overrides=chosen)
    if "controller_left" in game_facts(env.app).needs("right"):
        env = environment_of(_TWO_HANDED, condition=condition, overrides=chosen)
    say(f"targets of {game}{f', condition {condition}' if condition else ''} ...")
    found = found_targets(env, objects=request.objects, seconds=request.seconds, how=how)
    return [replace(each, name=f"{condition or ''} {each.name}".strip()) for each in found]
