"""``sim2vr-harness compare``: what users do beside what people do."""

from __future__ import annotations

import json as jsonlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.progress import progress_of_part
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.options import (
    ChangedEnvironment,
    JsonOutput,
    TrustedApp,
    print_json,
    print_written,
)
from sim2vr_harness.cli.progress import Share

if TYPE_CHECKING:
    from sim2vr_harness.games.behaviour import Behaviour
    from sim2vr_harness.human_comparison.report import ComparisonReport
    from sim2vr_harness.human_comparison.sources import Plays, Source


@dataclass(frozen=True, kw_only=True)
class CompareRequest(ChangedEnvironment, TrustedApp, JsonOutput, AppOptions):
    """Users, recorded people, and what is played to compare them."""

    users: tuple[str, ...] = argument(
        "USER...",
        "A shipped user's name, a run's folder or checkpoint: it plays. Or the folder of an "
        "evaluation with logs, or of any logged rounds. Or a study (STUDY.yaml, or its folder): "
        "each of its users, trained and played first, if they are not yet. NAME=USER is called "
        "NAME in tables and figures. Beside sessions of any app: sessions, a trained user, or one "
        "without training such as 'touch NAME'.",
        names="users",
    )
    recordings: tuple[Path, ...] = option(
        "People's recorded rounds: packed with a manifest.json, or logs in a folder per person, or "
        "sessions of any app; may be repeated. Pointing needs none: figures are published.",
        (),
        metavar="PATH",
    )
    game: str | None = option(
        "The game.", metavar="NAME", shown="that of the first user", names="games"
    )
    condition: tuple[str, ...] = option(
        "A condition to play; may be repeated.",
        (),
        metavar="NAME",
        shown="all compared, by the rules of the user's training",
    )
    group: tuple[str, ...] = option(
        "Play by the rules of a group of people (constrained, unconstrained), whatever the user "
        "was trained with; may be repeated.",
        (),
        metavar="NAME",
    )
    episodes: int | None = option(
        "Rounds per condition.", metavar="N", shown="6; beside sessions 2", least=1
    )
    seed: int = option("Seed of the first round.", 77, metavar="N")
    people: int | None = option(
        "Let N people play who differ, --episodes rounds each, as in evaluate --people.",
        metavar="N",
    )
    out: Path = option(
        "Folder for played rounds, JSON, CSV and figures; rounds that are there are used again.",
        Path("comparison"),
        place="folder to write",
    )
    unconstrained: bool = option("Every touch was a hit for people, though logs do not say.", False)
    figures: bool = option("Draw the figures.", True)
    every: bool = option("Print every measure.", False)
    batch: int = option("Rounds played in parallel at most.", 10)


def compare(request: CompareRequest) -> None:
    """Compare users with recorded people: measures, range, distance.

    Examples:
        sim2vr-harness compare whacamole_people --recordings recordings
        sim2vr-harness compare 'touch ball' --recordings round.jsonl --page game.html
    """
    remote, people, out = request.remote(), request.recordings, request.out
    users, told = _told_names(request.users)
    shown = {"figures": request.figures, "every": request.every, "json": request.json}
    if remote or _are_sessions(people, request.game):
        plays = _plays(request, request.episodes or 2, request.condition or None)
        _write(_beside_sessions(users, told, people, plays, remote), out, **shown)
        return
    game = _game_of_users(users, request.game)
    plays = _plays(request, request.episodes or 6, _to_play(request.condition, request.group, game))
    if _is_aimed(users, game):
        _compare_aimed(users, told, game, people, plays, out, **shown)
        return
    free = request.unconstrained
    report = _compared(users, told, game, people, plays, out, unconstrained=free)
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


def _plays(request: CompareRequest, episodes: int, conditions: Sequence[str] | None) -> Plays:
    from sim2vr_harness.human_comparison.sources import Plays

    return Plays(
        out=request.out / "rounds",
        episodes=episodes,
        seed=request.seed,
        overrides=request.set_,
        conditions=conditions,
        batch=request.batch,
        persons=request.people,
        trust_app=request.trust_app,
    )


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
        raise InputError("--recordings", "none", "a session, or a folder of sessions")
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
        raise InputError("--recordings", "none", "a folder of people's recorded rounds")
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


def _to_play(condition: Sequence[str], group: Sequence[str], game: str) -> Sequence[str] | None:
    """The game's names of the conditions requested; None for those of the user's rules."""
    from sim2vr_harness.games.registry import aimed_games, behaviour_of

    if not group:
        return condition or None
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


def _told_names(users: Sequence[str]) -> tuple[list[str], dict[str, str]]:
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
    users: Sequence[str],
    told: Mapping[str, str],
    game: str,
    people: Sequence[Path],
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
