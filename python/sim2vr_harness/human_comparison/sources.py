"""Sources of rounds: recorded people, recorded users, and users who play now.

Every round is a session: of a log, a packed round or a file of any other format. Users play into a
folder, from which their rounds are read like those of people.
"""

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from sim2vr_harness.base.errors import InputError, shown, unknown_name
from sim2vr_harness.base.files import file_name, read_bytes, read_json, write_atomically
from sim2vr_harness.base.progress import progress_of_part
from sim2vr_harness.client import describe_game
from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.evaluation.request import Plays, Request
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.games.registry import behaviour_of, behaviours
from sim2vr_harness.human_comparison.persons import (
    Cell,
    RecordedPerson,
    RoundMeasures,
    measure_session,
    persons_of,
)
from sim2vr_harness.human_comparison.rounds import (
    behaviour_of_sessions,
    has_targets,
    name_of_condition,
)
from sim2vr_harness.play.recorders import SessionRecorder
from sim2vr_harness.play.users import SimulatedUser
from sim2vr_harness.policies.scripted.steps import is_script, read_steps
from sim2vr_harness.policies.store import TrainedUser, find_user, is_packed
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.sessions import (
    AppIdentity,
    Session,
    find_sessions,
    read_session,
    read_sessions,
    write_session,
)
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.whacamole import is_recorded_round, without_constraint

_RESULTS, _PLAYED, _SESSIONS = "results.json", "played.json", "sessions"
_EXPECTED_RESULTS = "results of an evaluation: conditions with their rounds"
_BASELINES = ("still", "random")


@dataclass(frozen=True)
class Source:
    """A user or people, measured.

    Attributes:
        name: for tables.
        persons: by condition.
        fatigue: condition -> person -> the rounds' mean over the muscles of the largest share of
            fatigued motor units; empty where logs have none.
    """

    name: str
    persons: Mapping[Cell, Sequence[RecordedPerson]]
    fatigue: Mapping[Cell, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Recorded:
    """A session and its player.

    Attributes:
        person: the player.
        session: the round.
        fatigued: mean over the muscles of the largest proportion of fatigued motor units; None:
            unknown.
    """

    person: str
    session: Session
    fatigued: float | None = None


# --- comparing -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sources:
    """Measured people and users.

    Attributes:
        behaviour: description of the game, or of an app without one.
        people: recorded people, with whose range users are compared; empty if none were recorded.
        users: by the argument for each.
    """

    behaviour: Behaviour
    people: Source
    users: Mapping[str, Source]


def read_sources(
    users: Sequence[str],
    people: Sequence[Path],
    plays: Plays,
    *,
    game: str | None = None,
    groups: Sequence[str] = (),
    unconstrained: bool = False,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Sources:
    """Read people's sessions and measure users for comparison, which play first if necessary.

    Args:
        users: trained users, sessions or folders of them; with sessions of an app without a
            description also users without training.
        people: sessions or folders of them.
        plays: settings of the users' play, into a folder of the user's name in ``out``; existing
            rounds are used again. ``episodes``: 6 unless set, with sessions of any app 2;
            ``conditions``: all compared ones of the user's groups, with sessions the people's.
        game: name of the game; None: that of people's logs, or of the first user that names one.
        groups: of people, by whose rules users play.
        unconstrained: True: every touch was a hit for people, which their logs do not state.
        on_progress: Called with the proportion of the work done.

    Raises:
        InputError: a round cannot be measured, or a user cannot play. As far as possible this is
            checked before a user plays.
    """
    recorded = [each for path in people for each in read_people(path, unconstrained=unconstrained)]
    behaviour = _described(users, recorded, game, plays)
    if not recorded and (behaviour is None or behaviour.least_people):
        expected = "people's recorded rounds: sessions, or their folders"
        raise InputError("--recordings", "none", expected)
    plays = _with_groups(plays, groups, behaviour)
    plays = replace(plays, episodes=plays.episodes or (2 if behaviour is None else 6))
    ready = {user: read_user(Path(user)) for user in users if _is_recorded(user)}
    names = {user: Path(user).resolve().name for user in ready}
    if behaviour is None:
        recorded = [_with_condition(each, plays.conditions) for each in recorded]
    measured = None if behaviour is None else measured_people(recorded, behaviour)
    _check(users, ready, recorded, measured, behaviour, plays)
    app = dict(plays.app)
    for number, user in enumerate(users):
        if user not in ready:
            show = progress_of_part(on_progress, number, len(users) + (behaviour is None))
            folder, own = _play(user, recorded, behaviour, plays, show)
            ready[user], app = read_user(folder), app or own
            names[user] = user if _is_untrained(user) else folder.name
    if behaviour is None:
        # Sessions with the events that the app's task names, by a replay where they lack them.
        found = []
        for targets_each in recorded:
            if app.get("task") is None or has_targets(targets_each.session):
                found.append(targets_each)
                continue
            again = replay_session(targets_each.session, app=app, on_progress=on_progress).session
            found.append(
                replace(targets_each, session=replace(targets_each.session, events=again.events))
            )
        recorded = found
        every = [each.session for own in (recorded, *ready.values()) for each in own]
        behaviour = behaviour_of_sessions(_name(recorded, app), every)
    return Sources(
        behaviour,
        measured or measured_people(recorded, behaviour),
        {user: measured_user(names[user], ready[user], behaviour) for user in users},
    )


def _with_groups(plays: Plays, groups: Sequence[str], behaviour: Behaviour | None) -> Plays:
    """Add the conditions of groups of people."""
    if not groups:
        return plays
    if plays.conditions:
        got = f"{shown(list(groups))} beside --condition {shown(list(plays.conditions))}"
        raise InputError("--group", got, "one of the two: a group plays all that are compared")
    if behaviour is None or behaviour.aimed:
        game = "sessions of any app" if behaviour is None else behaviour.game
        raise InputError("--group", shown(list(groups)), f"none for {game}, without groups")
    for name in groups:
        if name not in behaviour.groups:
            raise unknown_name("--group", name, behaviour.groups)
    names = [name for each in dict.fromkeys(groups) for name in behaviour.played(each)]
    return replace(plays, conditions=names)


def _described(
    users: Sequence[str], recorded: Sequence[Recorded], game: str | None, plays: Plays
) -> Behaviour | None:
    """Return the description of the game; None for sessions of any app.

    Logs and packed rounds of a described game have more in them than other sessions.
    """
    if plays.app:
        return None
    if recorded:
        paths = [each.session.path or Path() for each in recorded]
        logs = [path.is_dir() or path.suffix in (".csv", ".npz") for path in paths]
        first = next((each.session for each, log in zip(recorded, logs, strict=True) if log), None)
        game = game or ("" if first is None else first.app.name)
        return behaviour_of(game) if first is not None and game in behaviours() else None
    known = (found for user in users if game is None and (found := game_of(user)) is not None)
    return behaviour_of(game or next(known, behaviours()[0]))


def _check(
    users: Sequence[str],
    ready: Mapping[str, Sequence[Recorded]],
    recorded: Sequence[Recorded],
    people: Source | None,
    behaviour: Behaviour | None,
    plays: Plays,
) -> None:
    """Check all conditions of a comparison that can be checked before users play."""
    if behaviour is None:
        every = [*recorded, *(each for own in ready.values() for each in own)]
        known = behaviour_of_sessions(_name(recorded, plays.app), [e.session for e in every])
        conditions = {name_of_condition(each.session) for each in recorded}
        for each in every:
            measure_session(each.session, known, each.person)
        games = {each.session.app.name for each in recorded if each.session.app.kind == "game"}
    else:
        games = {behaviour.game}
    for user in users:
        if user in ready:
            if behaviour is None:
                played = {name_of_condition(each.session) for each in ready[user]}
                _require_common(f"{user!r}, who played", played, conditions)
        elif behaviour is None and _is_untrained(user):
            if is_script(user):
                read_steps(user)
        else:
            app = find_user(user, code=True).config.env.app
            if games and not plays.app and app.game not in games:
                got, expected = f"{user!r}, who plays {app.game}", ", ".join(sorted(games))
                raise InputError("USER", got, f"a user of {expected}")
            if behaviour is not None and people is not None and not behaviour.aimed:
                names = plays.conditions or _conditions(find_user(user, code=True), behaviour)
                cells = {cell for name in names if (cell := behaviour.recognise(name)) is not None}
                if not cells & {*people.persons}:
                    theirs = {" ".join(cell) for cell in people.persons}
                    _require_common(f"{user!r}, who plays", names, theirs)
    for name in games if behaviour is None else ():
        facts = _condition_names(name)
        for wanted in plays.conditions:
            if facts and wanted not in facts:
                raise unknown_name("--condition", wanted, facts)


def _require_common(who: str, played: Iterable[str], people: Iterable[str]) -> None:
    if not {*played} & {*people}:
        expected = f"a condition of people's: {', '.join(sorted(people))}"
        raise InputError("USER", f"{who} {', '.join(played)}", expected)


def _condition_names(game: str) -> list[str]:
    return [each.name for each in describe_game(game).conditions]


def _with_condition(each: Recorded, conditions: Sequence[str]) -> Recorded:
    """Return a game's recording with its condition: its own, or the only one that was named.

    Raises:
        InputError: Neither says which condition was played.
    """
    app = each.session.app
    if app.kind != "game" or not app.name or app.condition:
        return each
    if len(conditions) != 1:
        names = _condition_names(app.name)
        if not names:
            return each
        path = each.session.path or Path()
        raise InputError(
            "--recordings",
            f"{path.name}, which does not say which condition of {app.name} was played",
            f"--condition NAME, one of {', '.join(names)}; or the condition in the recording: "
            f'"condition": "{names[0]}" beside the name of the app in its first line',
        )
    named = replace(app, condition=conditions[0])
    return replace(each, session=replace(each.session, app=named))


def _name(played: Sequence[Recorded], app: Mapping[str, Any]) -> str:
    named = [each.session.app.name for each in played if each.session.app.name]
    return str(app.get("game") or next(iter(named), "app"))


# --- reading -------------------------------------------------------------------------------------


def read_people(path: Path, *, unconstrained: bool = False) -> list[Recorded]:
    """Read people's sessions in a file or folder.

    A session names its player. For a log, the player is the name of the folder above the round's
    folder; for another file, its own name, or that of its folder below ``path``.

    Raises:
        InputError: there is no session, or one is damaged.
    """
    found = read_sessions(path, "--recordings")
    if unconstrained:
        found = [without_constraint(e) if is_recorded_round(e) else e for e in found]
    return [Recorded(_person(each, path, None), each) for each in found]


def read_user(folder: Path) -> list[Recorded]:
    """Read a user's sessions: of an evaluation with logs, or at or below a place.

    Raises:
        InputError: there is no session, one is damaged, or an evaluation has no logs.
    """
    results = folder / _RESULTS
    if not results.is_file() or (folder / _SESSIONS).is_dir():
        found = read_sessions(folder / _SESSIONS if results.is_file() else folder, "USER")
        return [Recorded(_person(each, folder, folder.resolve().name), each) for each in found]
    content = read_json(results, _EXPECTED_RESULTS)
    rows: list[Any] = []
    for summary in content.values() if isinstance(content, dict) else [content]:
        own = summary.get("rounds") if isinstance(summary, dict) else None
        if not isinstance(own, list) or not all(isinstance(row, dict) for row in own):
            raise InputError(file_name(results), shown(summary, 40), _EXPECTED_RESULTS)
        rows += own
    recorded = []
    for row in rows:
        place = row.get("log_folder")
        if not isinstance(place, str) or not (folder / place / "states.csv").is_file():
            expected = "logs of every round: sim2vr-harness evaluate --log"
            raise InputError("USER", f"{str(folder)!r}, which has rounds without", expected)
        person = folder.resolve().name if row.get("person") is None else str(row["person"])
        tired = row.get("max_fatigued")
        fatigued = float(tired) if isinstance(tired, (int, float)) else None
        recorded.append(Recorded(person, read_session(folder / place), fatigued))
    return recorded


def _person(session: Session, root: Path, user: str | None) -> str:
    path = session.path or root
    if session.person:
        return session.person
    if path.is_dir() or path.suffix in (".csv", ".npz"):
        above = path.resolve().parent
        if above.name == "logs" and above != root.resolve():
            above = above.parent
        return user or above.name
    own = path.parent.resolve() not in (root.resolve(), root.resolve().parent)
    return path.parent.name if own else session.name


def measured_people(recorded: Sequence[Recorded], behaviour: Behaviour) -> Source:
    """Measure people.

    Raises:
        InputError: no round is of the game, or no condition has as many persons as it needs.
    """
    found = _measured(recorded, behaviour, "--recordings")
    if found and behaviour.least_people > 1 and max(map(len, found.persons.values())) < 2:
        name = next(iter(found.persons.values()))[0].name
        expected = "at least two, for a range; with own logs a folder per person"
        raise InputError("--recordings", f"one person ({name})", expected)
    return replace(found, name="people")


def measured_user(name: str, recorded: Sequence[Recorded], behaviour: Behaviour) -> Source:
    """Measure a user; see :func:`measured_people`."""
    return replace(_measured(recorded, behaviour, "USER"), name=name)


def _measured(recorded: Sequence[Recorded], behaviour: Behaviour, option: str) -> Source:
    rounds: list[RoundMeasures] = []
    tired: dict[Cell, dict[str, list[float]]] = {}
    for each in recorded:
        measured = measure_session(each.session, behaviour, each.person)
        if measured is None:
            continue
        rounds.append(measured)
        if each.fatigued is not None:
            own = tired.setdefault(measured.cell, {}).setdefault(each.person, [])
            own.append(each.fatigued)
    if recorded and not rounds:
        names = [name for group in behaviour.groups for name in behaviour.played(group)]
        conditions = sorted({each.session.app.condition for each in recorded})
        place = str((recorded[0].session.path or Path()).parent)
        got = f"{place!r} with conditions {shown(conditions, 60)}"
        raise InputError(option, got, f"rounds of {behaviour.game}: {', '.join(names)}")
    fatigue = {
        cell: {person: sum(values) / len(values) for person, values in own.items()}
        for cell, own in tired.items()
    }
    return Source("", persons_of(rounds, behaviour), fatigue)


def read_folders(name: str, folders: Sequence[Path], behaviour: Behaviour) -> Source:
    """Measure a user with rounds in several folders, such as the cells of a study.

    Args:
        folders: Of logs, each of other conditions.

    Raises:
        InputError: A folder has no rounds of the game, or two have the same condition.
    """
    persons: dict[Cell, Sequence[RecordedPerson]] = {}
    fatigue: dict[Cell, Mapping[str, float]] = {}
    for folder in folders:
        recorded = read_user(folder)
        own_name = folder.resolve().name  # of a user who is no particular person
        recorded = [replace(e, person=name) if e.person == own_name else e for e in recorded]
        own = measured_user(name, recorded, behaviour)
        for cell in own.persons:
            if cell in persons:
                got = f"{name!r}, who played {' '.join(cell)} in several cells"
                raise InputError("USER", got, "each condition once, but for the study's factors")
        persons |= own.persons
        fatigue |= own.fatigue
    return Source(name, persons, fatigue)


def game_of(user: str) -> str | None:
    """Return the game that a user plays, or has played; None if logs do not name it."""
    if not _is_recorded(user):
        game: str = find_user(user, code=True).config.env.app.game
        return game
    results = Path(user) / _RESULTS
    if not results.is_file():
        return None
    found = read_json(results, _EXPECTED_RESULTS)
    summaries = found.values() if isinstance(found, dict) else ()
    games = [summary.get("game") for summary in summaries if isinstance(summary, dict)]
    return next((name for name in games if isinstance(name, str)), None)


def _is_recorded(user: str) -> bool:
    """Return whether a user is given by its rounds, not by its weights."""
    path = Path(user)
    if path.is_dir():
        return not (is_packed(user) or RunFolder(path).exists)
    return path.exists() and bool(find_sessions(path))


# --- playing -------------------------------------------------------------------------------------


def _is_untrained(user: str) -> bool:
    return user in _BASELINES or is_script(user)


def _play(
    user: str,
    recorded: Sequence[Recorded],
    behaviour: Behaviour | None,
    plays: Plays,
    on_progress: Callable[[float], None],
) -> tuple[Path, dict[str, Any]]:
    """Play a user's rounds, unless the same ones exist already.

    Returns:
        Their folder, and the settings of the app for a replay; empty for a game of this runtime,
        which sessions name.
    """
    games = [each.session for each in recorded if each.session.app.kind == "game"]
    conditions = list(plays.conditions or dict.fromkeys(map(name_of_condition, games)))
    who, app = SimulatedUser.find(user), dict(plays.app)
    weights = None
    if who.trained is not None:
        weights = hashlib.sha256(read_bytes(who.trained.source, "weights of a user")).hexdigest()
        if behaviour is not None:
            conditions = list(plays.conditions or _conditions(who.trained, behaviour))
    elif games and not app:
        app = {"game": games[0].app.name, "transport": "in_process"}
    app_config = who.env(app, plays.overrides, trust_app=plays.trust_app).config.app
    played_in = {**app_config.model_dump(exclude={"task", "transport_options"})}
    settings_of_app = {} if app_config.transport == "in_process" else played_in
    if settings_of_app or app_config.task is not None:
        settings_of_app = {**settings_of_app, "task": app_config.task}
    assert plays.out is not None
    folder = plays.out / re.sub(r"[^\w.=-]+", "_", who.name)
    told = {
        "weights": weights,
        "conditions": conditions,
        "episodes": plays.episodes,
        "seed": plays.seed,
        "persons": plays.people,
        "overrides": list(plays.overrides),
        "app": dict(plays.app),
    }
    mark = folder / _PLAYED
    if mark.is_file() and read_json(mark, "what was played, in JSON") == told:
        return folder, settings_of_app
    mark.unlink(missing_ok=True)
    shutil.rmtree(folder / _SESSIONS, ignore_errors=True)
    kind: Literal["page", "game", "app"] = "page" if app_config.page else "app"
    if kind == "app" and app_config.transport == "in_process":
        kind = "game"
    identity = AppIdentity(kind, app_config.game, "", dict(app_config.options))
    recorder = SessionRecorder(identity)
    local = app_config.page is None and app_config.transport == "in_process"
    request = Request(
        **{each.name: getattr(plays, each.name) for each in fields(Plays)}
        | {"conditions": conditions, "app": app, "out": folder},
        log=behaviour is not None or (local and who.trained is not None),
        steps=False,
        overwrite=True,
        watchers=[] if behaviour is not None else [recorder],
    )
    evaluate(user, request, on_progress=on_progress)
    if behaviour is None and not (folder / "logs").is_dir():
        for number, each in enumerate(recorder.sessions):
            session = replace(each, person=each.person or folder.name)
            write_session(session, folder / _SESSIONS / f"{number:04d}.jsonl")
    write_atomically(mark, (json.dumps(told, indent=2) + "\n").encode())
    return folder, settings_of_app


def _conditions(known: TrainedUser, behaviour: Behaviour) -> list[str]:
    """All compared conditions of the groups that a user was trained or is evaluated in."""
    app = known.config.env.app
    names = [*(known.config.evaluation.conditions or known.env.facts.evaluated)]
    if behaviour.aimed:
        return names
    condition = app.options.get("condition")
    groups = {behaviour.group_of(str(name)) for name in (*names, condition) if name is not None}
    return [
        name for group in behaviour.groups if group in groups for name in behaviour.played(group)
    ]
