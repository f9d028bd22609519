"""Sessions to compare: those of files and folders, and those of users who play now."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.envs.config import AppConfig
from sim2vr_harness.envs.games import game_facts, with_task
from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.evaluation.scripted_baseline import evaluate_baseline
from sim2vr_harness.evaluation.session_recorder import SessionRecorder
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.app_sessions import (
    behaviour_of_sessions,
    has_targets,
    measure_session,
    name_of_condition,
)
from sim2vr_harness.human_comparison.persons import persons_of
from sim2vr_harness.human_comparison.report import ComparisonReport
from sim2vr_harness.human_comparison.sources import Plays, Source
from sim2vr_harness.policies.scripted.steps import is_script, read_steps
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.sessions import AppIdentity, Session, read_session
from sim2vr_harness.sessions.formats import is_session
from sim2vr_harness.sessions.replay import replay_session

_BASELINES = ("still", "random")
_LOG = "states.csv"
_ENDINGS = (".jsonl", ".jsonl.gz", ".bsor")
"""Of sessions in folders, which hold other files, too; a single file may be of any format."""


@dataclass(frozen=True)
class _Played:
    """A session, whose it is and where it is from."""

    person: str
    source: Path
    session: Session


@dataclass(frozen=True)
class SessionPlays:
    """How users play beside recorded sessions.

    Attributes:
        plays: rounds, seed and so on.
        remote: settings of ``env.app`` for a page or another app; empty: the user's own.
    """

    plays: Plays
    remote: Mapping[str, Any]


def find_sessions(path: Path) -> list[Path]:
    """Return the sessions at or below a place: files of any format, and folders of logs."""
    if path.is_dir() and (path / _LOG).is_file():
        return [path]
    if path.is_dir():
        below = [] if (path / "manifest.json").is_file() else sorted(path.iterdir())
        known = (each for each in below if each.is_dir() or each.name.endswith(_ENDINGS))
        return [found for each in known for found in find_sessions(each)]
    return [path] if is_session(path) else []


def compare_sessions(
    users: Sequence[str],
    people: Sequence[Path],
    how: SessionPlays,
    *,
    on_progress: Callable[[float], None] = lambda share: None,
) -> ComparisonReport:
    """Measure people's sessions and users beside them; users play first if they must.

    Args:
        users: sessions or folders of them, trained users, or those without training.
        people: sessions or folders of them.
        how: users play, and in which app.
        on_progress: Called with the share of the work done.

    Raises:
        InputError: there is no session, or a user cannot play the app.
    """
    recorded = [each for path in people for each in _read(path, "--recordings")]
    recorded = [_with_condition(each, how.plays.conditions) for each in recorded]
    ready = {
        user: _read(Path(user), "USER")
        for user in users
        if Path(user).exists() and find_sessions(Path(user))
    }
    _check(users, recorded, ready, how)
    sources: dict[str, list[_Played]] = {}
    app = dict(how.remote)
    for number, user in enumerate(users):

        def show(part: float, done: int = number) -> None:
            on_progress((done + part) / (len(users) + 1))

        if user in ready:
            sources[user] = ready[user]
        else:
            sources[user], own = _play(user, recorded, how, show)
            app = app or own
    recorded = replayed_sessions(recorded, app, on_progress)
    everything = [
        each.session for each in (*recorded, *(p for own in sources.values() for p in own))
    ]
    behaviour = behaviour_of_sessions(_name(recorded, app), everything)
    return ComparisonReport(
        behaviour,
        _measured("people", recorded, behaviour),
        [_measured(user, own, behaviour) for user, own in sources.items()],
    )


def _with_condition(each: _Played, conditions: Sequence[str] | None) -> _Played:
    """A game's recording with its condition: its own, or the only one that was named.

    Raises:
        InputError: Neither says which condition was played.
    """
    app = each.session.app
    if app.kind != "game" or app.condition:
        return each
    if conditions is None or len(conditions) != 1:
        names = [condition.name for condition in game_facts(AppConfig(game=app.name)).conditions]
        if not names:
            return each
        raise InputError(
            "--recordings",
            f"{each.source.name}, which does not say which condition of {app.name} was played",
            f"--condition NAME, one of {', '.join(names)}; or the condition in the recording: "
            f'"condition": "{names[0]}" beside the name of the app in its first line',
        )
    named = replace(app, condition=conditions[0])
    return replace(each, session=replace(each.session, app=named))


def _check(
    users: Sequence[str],
    recorded: Sequence[_Played],
    ready: Mapping[str, Sequence[_Played]],
    how: SessionPlays,
) -> None:
    """Refuse before anything is played what would be refused after it.

    Raises:
        InputError: A recording cannot be measured, a user cannot be found or plays another game,
            or a condition does not exist.
    """
    everything = [*recorded, *(each for own in ready.values() for each in own)]
    behaviour = behaviour_of_sessions(_name(recorded, how.remote), [e.session for e in everything])
    for each in everything:
        measure_session(each.session, behaviour, each.person, each.source)
    conditions = {name_of_condition(each.session) for each in recorded}
    for user, own in ready.items():
        played = {name_of_condition(each.session) for each in own}
        if not played & conditions:
            got = f"{user!r}, who played {', '.join(sorted(played))}"
            expected = f"a condition of people's: {', '.join(sorted(conditions))}"
            raise InputError("USER", got, expected)
    games = {each.session.app.name for each in recorded if each.session.app.kind == "game"}
    for user in users:
        if user in ready or user in _BASELINES:
            continue
        if is_script(user):
            read_steps(user)
            continue
        app = find_user(user, code=True).config.env.app
        if games and not how.remote and app.game not in games:
            got = f"{user!r}, who plays {app.game}"
            raise InputError("USER", got, f"a user of {', '.join(sorted(games))}")
    for game in games:
        known = [condition.name for condition in game_facts(AppConfig(game=game)).conditions]
        for name in how.plays.conditions or ():
            if known and name not in known:
                raise unknown_name("--condition", name, known)


def replayed_sessions(
    played: Sequence[_Played], app: Mapping[str, Any], on_progress: Callable[[float], None]
) -> list[_Played]:
    """Return sessions with the events that the app's task names, by a replay where they lack them.

    Args:
        played: as recorded.
        app: settings of ``env.app``; without a task nothing is replayed.
        on_progress: Called with the share of the work done.
    """
    found = []
    for each in played:
        if app.get("task") is None or has_targets(each.session):
            found.append(each)
            continue
        again = replay_session(each.session, app=app, on_progress=on_progress).session
        session = replace(each.session, events=again.events)
        found.append(replace(each, session=session))
    return found


def _read(path: Path, option: str) -> list[_Played]:
    files = find_sessions(path) if path.exists() else []
    if not files:
        raise InputError(option, repr(str(path)), "a session, or a folder of sessions")
    found = []
    for file in files:
        session = read_session(file)
        below = file.parent.resolve() not in (path.resolve(), path.resolve().parent)
        own = file.parent.name if below else file.name.split(".")[0]
        found.append(_Played(session.person or own, file, session))
    return found


def _name(played: Sequence[_Played], app: Mapping[str, Any]) -> str:
    named = [each.session.app.name for each in played if each.session.app.name]
    return str(app.get("game") or next(iter(named), "app"))


def _measured(name: str, played: Sequence[_Played], behaviour: Behaviour) -> Source:
    rounds = [measure_session(each.session, behaviour, each.person, each.source) for each in played]
    return Source(name, persons_of(rounds, behaviour))


# --- playing -------------------------------------------------------------------------------------


def _play(
    user: str,
    recorded: Sequence[_Played],
    how: SessionPlays,
    on_progress: Callable[[float], None],
) -> tuple[list[_Played], dict[str, Any]]:
    """Let a user play; return its sessions, and the settings of the app."""
    plays = how.plays
    games = [each.session for each in recorded if each.session.app.kind == "game"]
    conditions = plays.conditions or list(dict.fromkeys(map(name_of_condition, games))) or None
    untrained = user in _BASELINES or is_script(user)
    if untrained:
        own = dict(how.remote)
        if games and not own:
            own = {"game": games[0].app.name, "transport": "in_process"}
        settings = (f"env.app.{key}={json.dumps(value)}" for key, value in own.items())
        overrides = [*plays.overrides, *settings]
        env = with_task(load_config("webxr", overrides).env)
    else:
        env = find_user(user, code=True).config.env
        env = with_task(env.model_copy(update={"app": _with(env.app, how.remote)}))
    recorder = SessionRecorder(_identity(env.app))
    name = user.replace("/", "_").replace(" ", "_")
    if untrained:
        evaluate_baseline(
            env,
            user,
            conditions=conditions or (),
            episodes=plays.episodes,
            seed=plays.seed,
            watchers=[recorder],
            on_progress=on_progress,
        )
    else:
        logged = env.app.page is None and env.app.transport == "in_process"
        request = plays.request(
            plays.out / name,
            conditions=conditions,
            log=logged,
            app=dict(how.remote),
            watchers=[recorder],
        )
        evaluate(user, request, on_progress=on_progress)
        if logged and (plays.out / name / "logs").is_dir():
            return _read(plays.out / name / "logs", "USER"), _settings(env.app)
    rounds = [_Played(each.person or name, plays.out / name, each) for each in recorder.sessions]
    return rounds, _settings(env.app)


def _with(app: AppConfig, remote: Mapping[str, Any]) -> AppConfig:
    return AppConfig.model_validate({**app.model_dump(exclude_unset=True), **remote})


def _identity(app: AppConfig) -> AppIdentity:
    kind = "page" if app.page else "game" if app.transport == "in_process" else "app"
    return AppIdentity(kind, app.game, "", dict(app.options))  # type: ignore[arg-type]


def _settings(app: AppConfig) -> dict[str, Any]:
    """The app as a replay takes it; nothing of a game of this runtime, which sessions name."""
    if app.transport == "in_process":
        return {} if app.task is None else {"task": app.task}
    return {**app.model_dump(exclude={"task", "transport_options"}), "task": app.task}
