"""``sim2vr-harness audit``: who can use an app, and how hard it is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sim2vr_harness.cli.app_options import with_page_options
from sim2vr_harness.cli.options import (
    CheckedRun,
    ConditionsOption,
    EnvSetOption,
    ExpectOption,
    JunitOption,
    finite,
    known_games,
    readable_file,
    writable_folder,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.audit.population import Stance
    from sim2vr_harness.audit.targets import AuditTarget, How
    from sim2vr_harness.evaluation.expectations import Planned

_MOST_PEOPLE = 10_000
_TWO_HANDED = "mobl_arms_bimanual"
"""Looks at games that are played with both hands."""

_Game = Annotated[
    str | None,
    typer.Option(
        autocompletion=known_games, metavar="NAME", help="Targets of a game, found by running it."
    ),
]
_Objects = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Which of the game's objects are targets, with * and ?, by their names.",
        show_default="those that come, go or move, and small ones",
    ),
]
_Targets = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.yaml",
        help="A list of targets: name, place or object, how, hold_s and more.",
        callback=readable_file,
    ),
]
_How = Annotated[
    str, typer.Option(metavar="HOW", help="What is done with a game's targets: touch or point.")
]
_Seconds = Annotated[
    float,
    typer.Option(
        help="How long to look at each round of the game, or at the page.", callback=finite
    ),
]
_People = Annotated[int, typer.Option(metavar="N", help="Persons, 1 to 10,000.")]
_Stance = Annotated[str, typer.Option(metavar="STANCE", help="Of the persons: seated or standing.")]
_Pace = Annotated[
    float, typer.Option(metavar="N", help="Uses of a target in a minute.", callback=finite)
]
_Operate = Annotated[int, typer.Option(metavar="N", help="How many persons act it out.")]
_Session = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Targets are where a recorded session's hands pressed a trigger or squeeze.",
        callback=readable_file,
    ),
]
_Seed = Annotated[int, typer.Option(help="Other persons for another seed.")]
_Out = Annotated[Path, typer.Option(help="Folder for the files.", callback=writable_folder)]


@with_page_options
def audit(
    game: _Game = None,
    condition: ConditionsOption = None,
    objects: _Objects = None,
    targets: _Targets = None,
    session: _Session = None,
    how: _How = "touch",
    seconds: _Seconds = 10.0,
    people: _People = 500,
    stance: _Stance = "seated",
    pace: _Pace = 20.0,
    operate: _Operate = 0,
    seed: _Seed = 1,
    out: _Out = Path("audit"),
    expect: ExpectOption = None,
    junit: JunitOption = None,
    overrides: EnvSetOption = None,
    remote: Mapping[str, Any] | None = None,
) -> int:
    """Say who can see, reach and hold an app's targets.

    Examples:
        sim2vr-harness audit --page shop.html --people 100
        sim2vr-harness audit --game whacamole --expect "reach.min >= 0.95"
    """
    from sim2vr_harness.audit.auditing import run
    from sim2vr_harness.audit.recorded import pressed_places
    from sim2vr_harness.audit.summary import estimates

    _check_use(pace, operate, people)
    numbers = seconds, people, seed
    _check(game, condition, objects, targets or session, remote, overrides, how, numbers, stance)
    checked = CheckedRun(_with_group(expect), None, junit, "audit")
    listed = (
        _listed(targets, remote, overrides or [], seconds) if targets is not None or remote else []
    )
    listed += [] if session is None else pressed_places(session)
    if checked.asked:
        checked.prepare(_planned(cast("Stance", stance)))
    if game is not None:
        names: list[str | None] = [*condition] if condition else [None]
        for name in names:
            listed += _of_game(game, name, overrides or [], objects, seconds, cast("How", how))
    title = game or _title(remote or {}, targets or session)
    # fmt: off
    done = run(
        title, listed, people=people, seed=seed, stance=cast("Stance", stance), pace=pace,
        operate=operate, say=say,
    )
    # fmt: on
    _tell(done, out)
    return checked.status(lambda: estimates(done))


def _check_use(pace: float, operate: int, people: int) -> None:
    """Refuse numbers that no audit can use."""
    from sim2vr_harness.base.errors import InputError

    if not 0.1 <= pace <= 120.0:
        raise InputError("--pace", f"{pace:g}", "0.1 to 120 uses in a minute")
    if not 0 <= operate <= people:
        raise InputError("--operate", str(operate), f"0 to the {people} persons of --people")


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


def _check(
    game: str | None,
    condition: list[str] | None,
    objects: str | None,
    targets: Path | None,
    remote: Mapping[str, Any] | None,
    overrides: list[str] | None,
    how: str,
    numbers: tuple[float, int, int],
    stance: str,
) -> None:
    """Refuse options that are out of range or do not go together."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.base.optional import needed

    needed("plotly", "studies", "audit")
    seconds, people, seed = numbers
    page = (remote or {}).get("page")
    if game is None and targets is None and page is None:
        if remote:
            expected = "it with --targets FILE.yaml or --session, since a program lists no objects"
            raise InputError("--openxr", "a program without --targets", expected)
        raise InputError("--game, --page, --targets or --session", "none", "one of them")
    if game is not None and remote:
        raise InputError("--page or --openxr", "it together with --game", "one of them")
    if overrides and game is None and not remote:
        raise InputError("--set", "it without an app", "it with --game or --page")
    if game is None and (condition or objects is not None):
        raise InputError("--condition or --objects", "it without --game", "it with --game")
    for option, got, known in (
        ("--how", how, ("touch", "point")),
        ("--stance", stance, ("seated", "standing")),
    ):
        if got not in known:
            raise InputError(option, repr(got), " or ".join(known))
    if not 1 <= people <= _MOST_PEOPLE:
        raise InputError("--people", str(people), f"1 to {_MOST_PEOPLE:,}")
    if not 0 <= seed < 2**31:
        raise InputError("--seed", str(seed), f"0 to {2**31 - 1}")
    if not 0.0 < seconds <= 600.0:
        raise InputError("--seconds", f"{seconds:g}", "more than 0, at most 600")


def _with_group(expect: list[str] | None) -> list[str] | None:
    """Expectations without a group are about everyone."""
    from sim2vr_harness.audit.summary import EVERYONE
    from sim2vr_harness.evaluation.expectations import Expectation

    return [
        text if Expectation.of(text).group is not None else f"{EVERYONE}: {text}"
        for text in expect or ()
    ] or None


def _planned(stance: Stance) -> Planned:
    from sim2vr_harness.audit.auditing import limitations_of
    from sim2vr_harness.audit.population import GROUPS
    from sim2vr_harness.audit.summary import EVERYONE, MEASURES
    from sim2vr_harness.evaluation.expectations import Planned

    limited = (each.name for each in limitations_of(stance))
    return Planned((EVERYONE, *GROUPS, *limited), MEASURES, ())


def _listed(
    targets: Path | None,
    remote: Mapping[str, Any] | None,
    overrides: list[str],
    seconds: float,
) -> list[AuditTarget]:
    """Return the targets of a file, those of objects located in the page, or the page's things."""
    from sim2vr_harness.audit.pages import find_things, located, things_as_targets
    from sim2vr_harness.audit.targets import read_targets
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.play.environment import evaluation_env
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
    game: str,
    condition: str | None,
    overrides: list[str],
    objects: str | None,
    seconds: float,
    how: How,
) -> list[AuditTarget]:
    from dataclasses import replace

    from sim2vr_harness.audit.population import MODEL
    from sim2vr_harness.audit.targets import found_targets
    from sim2vr_harness.envs.games import game_facts
    from sim2vr_harness.tools.users import environment_of

    chosen = [f"env.app.game={game}", *overrides]  # before the options, which are the game's
    env = environment_of(MODEL, condition=condition, overrides=chosen)
    if "controller_left" in game_facts(env.app).needs("right"):
        env = environment_of(_TWO_HANDED, condition=condition, overrides=chosen)
    say(f"targets of {game}{f', condition {condition}' if condition else ''} ...")
    found = found_targets(env, objects=objects, seconds=seconds, how=how)
    return [replace(each, name=f"{condition or ''} {each.name}".strip()) for each in found]
