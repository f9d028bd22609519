"""``sim2vr-harness compare``: what users do beside what people do."""

from __future__ import annotations

import json as jsonlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.progress import progress_of_part
from sim2vr_harness.cli.app_options import with_app_options
from sim2vr_harness.cli.options import (
    EnvSetOption,
    JsonOption,
    TrustOption,
    game_option,
    known_users,
    print_json,
    print_written,
    writable_folder,
)
from sim2vr_harness.cli.progress import Share

if TYPE_CHECKING:
    from sim2vr_harness.games.behaviour import Behaviour
    from sim2vr_harness.human_comparison.report import ComparisonReport
    from sim2vr_harness.human_comparison.sources import Plays, Source

_Users = Annotated[
    list[str],
    typer.Argument(
        autocompletion=known_users,
        metavar="USER...",
        help="A shipped user's name, a run's folder or checkpoint: it plays. Or the folder of "
        "an evaluation with logs, or of any logged rounds. Or a study (STUDY.yaml, or its "
        "folder): each of its users, trained and played first, if they are not yet. "
        "NAME=USER is called NAME in tables and figures. Beside sessions of any app: sessions, "
        "a trained user, or one without training such as 'touch NAME'.",
    ),
]
_People = Annotated[
    list[Path] | None,
    typer.Option(
        "--people",
        metavar="PATH",
        help="People's recorded rounds: packed with a manifest.json, or logs in a folder per "
        "person, or sessions of any app; may be repeated. Pointing needs none: figures are "
        "published.",
    ),
]
_Game = Annotated[
    str | None,
    game_option("The game.", "that of the first user"),
]
_Condition = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="A condition to play; may be repeated.",
        show_default="all compared, by the rules of the user's training",
    ),
]
_Group = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Play by the rules of a group of people (constrained, unconstrained), whatever "
        "the user was trained with; may be repeated.",
    ),
]
_Episodes = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Rounds per condition.",
        show_default="6; beside sessions 2",
        min=1,
    ),
]
_Persons = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Let N persons play who differ, --episodes rounds each, as in evaluate --people.",
    ),
]
_Out = Annotated[
    Path,
    typer.Option(
        help="Folder for played rounds, JSON, CSV and figures; rounds that are there are used "
        "again.",
        callback=writable_folder,
    ),
]
_Unconstrained = Annotated[
    bool,
    typer.Option(
        "--unconstrained", help="Every touch was a hit for people, though logs do not say."
    ),
]
_Figures = Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures.")]


@with_app_options
def compare(
    users: _Users,
    people: _People = None,
    game: _Game = None,
    condition: _Condition = None,
    group: _Group = None,
    episodes: _Episodes = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the first round.")] = 77,
    persons: _Persons = None,
    out: _Out = Path("comparison"),
    unconstrained: _Unconstrained = False,
    figures: _Figures = True,
    every: Annotated[bool, typer.Option("--every", help="Print every measure.")] = False,
    batch: Annotated[int, typer.Option(help="Rounds played in parallel at most.")] = 10,
    trust_app: TrustOption = False,
    overrides: EnvSetOption = None,
    json: JsonOption = False,
    *,
    remote: dict[str, Any],
) -> None:
    """Compare users with recorded people: measures, range, distance.

    Examples:
        sim2vr-harness compare whacamole_people --people recordings
        sim2vr-harness compare 'touch ball' --people round.jsonl --page game.html
    """
    users, told = _told_names(users)
    played = partial(_plays, out, seed, overrides, batch, persons, trust_app)
    shown = {"figures": figures, "every": every, "json": json}
    if remote or _are_sessions(people or [], game):
        how = played(episodes or 2, condition)
        _write(_beside_sessions(users, told, people or [], how, remote), out, **shown)
        return
    game = _game_of_users(users, game)
    plays = played(episodes or 6, _to_play(condition, group, game))
    if _is_aimed(users, game):
        _compare_aimed(users, told, game, people or [], plays, out, **shown)
        return
    report = _compared(users, told, game, people or [], plays, out, unconstrained=unconstrained)
    _write(report, out, **shown)


def _game_of_users(users: Sequence[str], game: str | None) -> str:
    """The game that was named, or that of the first user who says."""
    from sim2vr_harness.games.registry import behaviours
    from sim2vr_harness.human_comparison.sources import game_of

    others = (user for user in users if game is None and not _is_study(user))
    known = (found for user in others if (found := game_of(user)) is not None)
    return game or next(known, behaviours()[0])


def _is_aimed(users: Sequence[str], game: str) -> bool:
    """Whether the game is one of aimed movements, which studies are not compared in."""
    from sim2vr_harness.games.registry import aimed_games

    study = next(filter(_is_study, users), None)
    if game in aimed_games() and study is not None:
        raise InputError("USER", f"the study {study!r}", f"users of {game}, or logs")
    return game in aimed_games()


def _plays(
    out: Path,
    seed: int,
    overrides: list[str] | None,
    batch: int,
    persons: int | None,
    trust_app: bool,
    episodes: int,
    conditions: list[str] | None,
) -> Plays:
    from sim2vr_harness.human_comparison.sources import Plays

    # fmt: off
    return Plays(
        out=out / "rounds", episodes=episodes, seed=seed, overrides=overrides or (),
        conditions=conditions, batch=batch, persons=persons, trust_app=trust_app,
    )
    # fmt: on


def _are_sessions(people: Sequence[Path], game: str | None) -> bool:
    """Whether people's rounds are sessions in files, or logs of a game without measures of its own.

    Logs of the other games, and packed rounds, have more in them than sessions.
    """
    from sim2vr_harness.games.registry import aimed_games, behaviours
    from sim2vr_harness.human_comparison.session_sources import find_sessions
    from sim2vr_harness.sessions import read_session

    found = [each for path in people if path.exists() for each in find_sessions(path)]
    files = all(each.is_file() for each in found)
    if found and not files and game is None:
        game = read_session(next(each for each in found if each.is_dir())).app.name
    return bool(found) and (files or game not in (*behaviours(), *aimed_games()))


def _beside_sessions(
    users: Sequence[str],
    told: Mapping[str, str],
    people: Sequence[Path],
    plays: Plays,
    remote: Mapping[str, Any],
) -> ComparisonReport:
    """Compare users with people's sessions of any app."""
    from sim2vr_harness.human_comparison.session_sources import SessionPlays, compare_sessions

    if not people:
        raise InputError("--people", "none", "a session, or a folder of sessions")
    with Share("Comparing") as share:
        how = SessionPlays(plays, remote)
        report = compare_sessions(users, people, how, on_progress=share.show)
    sources = {user: [source] for user, source in zip(users, report.users, strict=True)}
    return replace(report, users=_renamed(users, sources, told))


def _compared(
    users: Sequence[str],
    told: Mapping[str, str],
    game: str,
    people: Sequence[Path],
    plays: Plays,
    out: Path,
    *,
    unconstrained: bool,
) -> ComparisonReport:
    """Measure people and users, those of studies last; users play first if they must."""
    from sim2vr_harness.games.registry import behaviour_of
    from sim2vr_harness.human_comparison.report import ComparisonReport
    from sim2vr_harness.human_comparison.sources import check_user, read_people, read_user

    behaviour = behaviour_of(game)
    if not people:
        raise InputError("--people", "none", "a folder of people's recorded rounds")
    sources: dict[str, list[Source]] = {}
    with Share("Comparing") as share:
        measured_people = read_people(people, behaviour, unconstrained=unconstrained)
        for user in users:
            if not _is_study(user):
                check_user(user, behaviour, plays, measured_people)
        for user in users:
            show = progress_of_part(share.show, len(sources), len(users))
            if not _is_study(user):
                sources[user] = [read_user(user, behaviour, plays, on_progress=show)]
    for user in users:
        if _is_study(user):
            sources[user] = _players(user, out, behaviour, plays)
    return ComparisonReport(behaviour, measured_people, _renamed(users, sources, told))


def _renamed(
    users: Sequence[str], sources: Mapping[str, list[Source]], told: Mapping[str, str]
) -> list[Source]:
    """Return the sources in the users' order, each with a name of its own."""
    read = [(user, source) for user in users for source in sources[user]]
    names = _names([(user, source.name) for user, source in read], dict(told))
    return [replace(source, name=name) for (_, source), name in zip(read, names, strict=True)]


def _write(report: ComparisonReport, out: Path, *, figures: bool, every: bool, json: bool) -> None:
    """Write the comparison's files, and print its tables or JSON."""
    from sim2vr_harness.human_comparison.figures import draw
    from sim2vr_harness.human_comparison.files import as_json, write_csv, write_json, write_page
    from sim2vr_harness.human_comparison.tables import SETTLING, missing_values, report_tables

    files = [write_json(report, out / "comparison.json"), *write_csv(report, out)]
    drawn = draw(report, out) if figures else []
    notes = (SETTLING, *missing_values(report))
    files += [*drawn, write_page(report, drawn, out / "comparison.html", notes)]
    if json:
        print_json(as_json(report))
        return
    Console().print(report_tables(report, every=every))
    print_written(files)


def _to_play(condition: list[str] | None, group: list[str] | None, game: str) -> list[str] | None:
    """The game's names of the conditions requested; None for those of the user's rules."""
    from sim2vr_harness.games.registry import aimed_games, behaviour_of

    if not group:
        return condition
    if condition:
        got = f"{shown(group)} beside --condition {shown(condition)}"
        raise InputError("--group", got, "one of the two: a group plays all that are compared")
    if game in aimed_games():
        raise InputError("--group", shown(group), f"none for {game}, whose people are no groups")
    behaviour = behaviour_of(game)
    for name in group:
        if name not in behaviour.groups:
            raise unknown_name("--group", name, behaviour.groups)
    return [name for each in dict.fromkeys(group) for name in behaviour.played(each)]


def _told_names(users: list[str]) -> tuple[list[str], dict[str, str]]:
    """Users without the names that stand before them, and those names."""
    told: dict[str, str] = {}
    found = []
    for given in users:
        name, equals, user = given.partition("=")
        named = bool(equals) and not Path(given).exists()
        if not named:
            name, user = "", given
        elif not (name.strip() and user):
            raise InputError("USER", f"'{given}'", "NAME=USER with both of them")
        elif name in told.values():
            raise InputError("USER", f"the name '{name}' twice", "a name for each user")
        if user in told or (named and (user in found or _is_study(user))):
            expected = "a user once, and no name for a study, whose users have theirs"
            raise InputError("USER", f"'{given}'", expected)
        if named:
            told[user] = name
        found.append(user)
    return found, told


def _names(users: Sequence[tuple[str, str]], told: Mapping[str, str]) -> list[str]:
    """What users are called: as was said, or by their own names, told apart by where they are from.

    Args:
        users: what was given, and the name that it has of its own; folders such as step_1000 are
            called alike.
        told: names that were said, by what was given.
    """
    own = [name for _, name in users]

    def called(user: str, name: str) -> str:
        if user in told:
            return told[user]
        if own.count(name) == 1:
            return name
        return user if Path(user).name == name else f"{user} {name}"

    return [called(user, name) for user, name in users]


def _is_study(user: str) -> bool:
    """Whether a USER is a study: its file, or its folder."""
    path = Path(user)
    return (path.suffix in (".yaml", ".yml") and path.is_file()) or (path / "study.json").is_file()


def _players(user: str, out: Path, behaviour: Behaviour, plays: Plays) -> list[Source]:
    """The users of a study, which is run first, or gone on with, if its file is given."""
    from sim2vr_harness.cli.studies import Shown
    from sim2vr_harness.human_comparison.sources import read_folders
    from sim2vr_harness.studies import read_study, run_study
    from sim2vr_harness.studies.config import load_study
    from sim2vr_harness.studies.players import players_of

    path = Path(user)
    if path.is_dir():
        data = read_study(path)
    else:
        study = load_study(path)
        if not study.logs:
            raise InputError(f"{user}: logs", "false", "true: what is compared is read from logs")
        with Shown() as shown:
            place = out / "studies" / study.name
            data = run_study(path, place, trust_app=plays.trust_app, on_progress=shown.show).data
    players = players_of(data)
    return [read_folders(name, folders, behaviour) for name, folders in players.items()]


def _compare_aimed(
    users: list[str],
    told: Mapping[str, str],
    game: str,
    people: list[Path],
    plays: Plays,
    out: Path,
    *,
    figures: bool,
    every: bool,
    json: bool,
) -> None:
    """Compare users of aimed movements: Fitts' law, throughput, end points, submovements."""
    from sim2vr_harness.base.files import write_atomically
    from sim2vr_harness.human_comparison.fitts.comparison import (
        AimedReport,
        aimed_json,
        aimed_tables,
    )
    from sim2vr_harness.human_comparison.fitts.figure import draw_fitts
    from sim2vr_harness.human_comparison.fitts.users import (
        AimedUser,
        read_aimed_people,
        read_aimed_user,
    )
    from sim2vr_harness.human_comparison.sources import trained_user

    with Share("Comparing") as share:
        recorded = read_aimed_people(people)
        for user in users:
            trained_user(user, game)
        found: list[AimedUser] = []
        for user in users:
            show = progress_of_part(share.show, len(found), len(users))
            found.append(read_aimed_user(user, game, plays, on_progress=show))
    names = _names([(user, each.name) for user, each in zip(users, found, strict=True)], told)
    found = [replace(each, name=name) for each, name in zip(found, names, strict=True)]
    report = AimedReport(found, recorded)
    text = jsonlib.dumps(aimed_json(report), indent=1)
    files = [out / "comparison.json"]
    write_atomically(files[0], (text + "\n").encode())
    if figures:
        drawn = [*found, *([] if recorded is None else [recorded])]
        files.append(draw_fitts(drawn, out / "movement_time.png"))
    if json:
        typer.echo(text)
        return
    Console().print(aimed_tables(report, every=every))
    print_written(files)
