"""Sources of rounds: recordings, folders of logs, evaluations, and new episodes."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_bytes, read_json, write_atomically
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.replay.recordings import Recording, read_recordings
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.persons import (
    Cell,
    RecordedPerson,
    RoundMeasures,
    measure_round,
    persons_of,
)
from sim2vr_harness.human_comparison.rounds import round_of
from sim2vr_harness.policies.store import TrainedUser, find_user, is_packed
from sim2vr_harness.runs.run_folder import RunFolder

_RESULTS, _PLAYED, _PERSON = "results.json", "played.json", "person.json"
_EXPECTED_RESULTS = "results of an evaluation: conditions with their rounds"


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
class Plays:
    """How a user plays who has not played yet.

    Attributes:
        out: rounds go to a folder of the user's name in it, and are used again.
        episodes: rounds per condition.
        seed: of the first round.
        overrides: ``env.KEY=VALUE``, what is different from the training's environment.
        conditions: the game's names; None takes all compared ones of the user's groups.
        batch: rounds in parallel at most.
        persons: how many persons, who differ, play ``episodes`` rounds per condition each; None for
            the user alone.
        trust_app: whether the program that the user names as its app may be started.
    """

    out: Path
    episodes: int = 6
    seed: int = 77
    overrides: Sequence[str] = ()
    conditions: Sequence[str] | None = None
    batch: int = 10
    persons: int | None = None
    trust_app: bool = False

    def request(self, folder: Path, **more: Any) -> Request:
        """Return the evaluation that plays into a folder, anew, without tables of steps."""
        return Request(
            **{"conditions": self.conditions, "log": True, **more},
            episodes=self.episodes,
            seed=self.seed,
            steps=False,
            out=folder,
            overwrite=True,
            batch=self.batch,
            people=self.persons,
            overrides=tuple(self.overrides),
            trust_app=self.trust_app,
        )


def read_people(
    folders: Sequence[Path], behaviour: Behaviour, *, unconstrained: bool = False
) -> Source:
    """Measure people's recordings.

    Who played is what the recording says, or the name of the folder that a round's folder is in.

    Args:
        folders: Of recorded rounds, in the forms that ``sim2vr-harness replay`` takes.
        behaviour: Of the game.
        unconstrained: Every touch was a hit, though the logs do not say.

    Raises:
        InputError: A folder has no rounds of the game, or no group has two persons.
    """
    rounds: list[RoundMeasures] = []
    for folder in folders:
        if not folder.exists():
            raise InputError("--recordings", repr(str(folder)), "a folder that exists")
        found = _read(folder, "--recordings", unconstrained=unconstrained)
        rounds += _measured(found, behaviour, partial(_whose, root=folder), folder)
    persons = persons_of(rounds, behaviour)
    most = max(len(each) for each in persons.values())
    if most < 2:
        name = next(iter(persons.values()))[0].name
        expected = "at least two, for a range; with own logs a folder per person"
        raise InputError("--recordings", f"one person ({name})", expected)
    return Source("people", persons)


def read_user(
    user: str,
    behaviour: Behaviour,
    plays: Plays,
    *,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Source:
    """Measure a user: of a folder with logs, or one that plays now.

    Args:
        user: A user's name, a run's folder or checkpoint; or the folder of an evaluation with
            logs, or of any rounds.
        behaviour: Of the game.
        plays: How it plays, if it has to.
        on_progress: Called with the share of the work done.

    Raises:
        InputError: It is none of them, or its rounds are not of the game.
    """
    known = trained_user(user, behaviour.game)
    if known is None:
        return _of_folder(Path(user), behaviour)
    conditions = plays.conditions or _conditions(known, behaviour)
    folder = play_now(user, known, conditions, plays, on_progress)
    return _of_folder(folder, behaviour, name=folder.name)


def check_user(user: str, behaviour: Behaviour, plays: Plays, people: Source) -> None:
    """Refuse a user before anything is played.

    Raises:
        InputError: There is no such user, it plays another game, or no condition that people have
            played.
    """
    known = trained_user(user, behaviour.game)
    if known is None:
        return
    conditions = list(plays.conditions or _conditions(known, behaviour))
    if not {behaviour.recognise(name) for name in conditions} & {*people.persons}:
        theirs = ", ".join(sorted(" ".join(cell) for cell in people.persons))
        got = f"{user!r}, who plays {', '.join(conditions)}"
        raise InputError("USER", got, f"a condition of people's: {theirs}")


def trained_user(user: str, game: str) -> TrainedUser | None:
    """A user that can play; None of a folder of logs.

    Raises:
        InputError: There is no such user, or it plays another game.
    """
    if _is_folder_of_logs(user):
        return None
    known = find_user(user, code=True)
    plays = known.config.env.app.game
    if plays != game:
        raise InputError("USER", f"{user!r}, who plays {plays}", f"a user of {game}")
    return known


def game_of(user: str) -> str | None:
    """The game that a user plays, or has played; None of logs that do not say."""
    if not _is_folder_of_logs(user):
        game: str = find_user(user, code=True).config.env.app.game
        return game
    results = Path(user) / _RESULTS
    if not results.is_file():
        return None
    found = read_json(results, _EXPECTED_RESULTS)
    summaries = found.values() if isinstance(found, dict) else ()
    games = [summary.get("game") for summary in summaries if isinstance(summary, dict)]
    return next((name for name in games if isinstance(name, str)), None)


def _is_folder_of_logs(user: str) -> bool:
    path = Path(user)
    return path.is_dir() and not (is_packed(user) or RunFolder(path).exists)


def read_folders(name: str, folders: Sequence[Path], behaviour: Behaviour) -> Source:
    """Measure a user whose rounds are in several folders, such as the cells of a study.

    Args:
        name: Of the user.
        folders: Of logs, each of other conditions.
        behaviour: Of the game.

    Raises:
        InputError: A folder has no rounds of the game, or two have the same condition.
    """
    persons: dict[Cell, Sequence[RecordedPerson]] = {}
    fatigue: dict[Cell, Mapping[str, float]] = {}
    for folder in folders:
        own = _of_folder(folder, behaviour, name)
        for cell in own.persons:
            if cell in persons:
                got = f"{name!r}, who played {' '.join(cell)} in several cells"
                raise InputError("USER", got, "each condition once, but for the study's factors")
        persons |= own.persons
        fatigue |= own.fatigue
    return Source(name, persons, fatigue)


# --- folders --------------------------------------------------------------------------------------


def _of_folder(folder: Path, behaviour: Behaviour, name: str | None = None) -> Source:
    name = name or folder.resolve().name
    if (folder / _RESULTS).is_file():
        return _of_evaluation(folder, behaviour, name)
    found = _read(folder, "USER")
    rounds = _measured(
        found, behaviour, lambda played: person_beside(played.source) or name, folder
    )
    return Source(name, persons_of(rounds, behaviour))


@dataclass(frozen=True)
class LoggedRound:
    """A round of an evaluation.

    Attributes:
        person: who played; the user's name where it is no particular person.
        folder: of its logs.
        row: what the evaluation says of it.
    """

    person: str
    folder: Path
    row: Mapping[str, Any]


def logged_rounds(folder: Path, name: str) -> list[LoggedRound]:
    """The rounds of an evaluation that was logged; none of a folder that is no evaluation.

    Raises:
        InputError: Its results cannot be read, or a round has no log.
    """
    if not (folder / _RESULTS).is_file():
        return []
    results = read_json(folder / _RESULTS, _EXPECTED_RESULTS)
    if not isinstance(results, dict):
        raise InputError(file_name(folder / _RESULTS), shown(results, 40), _EXPECTED_RESULTS)
    found = []
    for summary in results.values():
        for row in _rows(folder, summary):
            place = row.get("log_folder")
            if not isinstance(place, str) or not (folder / place / "states.csv").is_file():
                expected = "logs of every round: sim2vr-harness evaluate --log"
                raise InputError("USER", f"{str(folder)!r}, which has rounds without", expected)
            person = name if row.get("person") is None else str(row["person"])
            found.append(LoggedRound(person, folder / place, row))
    return found


def _of_evaluation(folder: Path, behaviour: Behaviour, name: str) -> Source:
    """An evaluation's logs, with whose they are and how tiring they were from its results."""
    rounds: list[RoundMeasures] = []
    tired: dict[Cell, dict[str, list[float]]] = {}
    for logged in logged_rounds(folder, name):
        own = [
            measure_round(played, behaviour)
            for recording in read_recordings([logged.folder])
            if (played := round_of(recording, behaviour, logged.person)) is not None
        ]
        rounds += own
        fatigued = logged.row.get("max_fatigued")
        if isinstance(fatigued, (int, float)):
            for each in own:
                tired.setdefault(each.cell, {}).setdefault(logged.person, []).append(
                    float(fatigued)
                )
    if not rounds:
        conditions = list(read_json(folder / _RESULTS, _EXPECTED_RESULTS))
        raise _no_rounds("USER", folder, behaviour, conditions)
    fatigue = {
        cell: {person: sum(values) / len(values) for person, values in own.items()}
        for cell, own in tired.items()
    }
    return Source(name, persons_of(rounds, behaviour), fatigue)


def _rows(folder: Path, summary: Any) -> list[dict[str, Any]]:
    rows = summary.get("rounds") if isinstance(summary, dict) else None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(file_name(folder / _RESULTS), shown(summary, 40), _EXPECTED_RESULTS)
    return rows


def _read(folder: Path, option: str, *, unconstrained: bool = False) -> list[Recording]:
    try:
        return read_recordings([folder], unconstrained=unconstrained)
    except InputError as error:
        if error.field != "PATH":
            raise
        raise InputError(option, error.got, error.expected) from error


def _measured(
    found: Sequence[Recording],
    behaviour: Behaviour,
    whose: Callable[[Recording], str],
    folder: Path,
) -> list[RoundMeasures]:
    rounds = [
        measure_round(played, behaviour)
        for recording in found
        if (played := round_of(recording, behaviour, whose(recording))) is not None
    ]
    if not rounds:
        conditions = sorted({recording.condition for recording in found})
        raise _no_rounds("PATH", folder, behaviour, conditions)
    return rounds


def _no_rounds(
    option: str, folder: Path, behaviour: Behaviour, conditions: Sequence[str]
) -> InputError:
    names = [name for group in behaviour.groups for name in behaviour.played(group)]
    got = f"{str(folder)!r} with conditions {shown(list(conditions), 60)}"
    return InputError(option, got, f"rounds of {behaviour.game}: {', '.join(names)}")


def _whose(recording: Recording, root: Path) -> str:
    """The person beside a round's log, or the name of the folder that the round's folder is in."""
    known = person_beside(recording.source)
    if known is not None:
        return known
    above = recording.source.resolve().parent
    if above.name == "logs" and above != root.resolve():
        above = above.parent
    return above.name


def person_beside(folder: Path) -> str | None:
    """Who played a round that ``evaluate --people --log`` has logged into a folder."""
    file = folder / _PERSON
    if not file.is_file():
        return None
    index = read_json(file, "a person's fields").get("index")
    return None if index is None else str(index)


# --- playing --------------------------------------------------------------------------------------


def play_now(
    user: str,
    known: TrainedUser,
    conditions: Sequence[str],
    plays: Plays,
    on_progress: Callable[[float], None],
) -> Path:
    """Return the folder of a user's rounds, which are played unless the same ones are there.

    Args:
        user: As it was named.
        known: The same.
        conditions: The game's names.
        plays: How.
        on_progress: Called with the share of the work done.
    """
    told = {
        "weights": hashlib.sha256(read_bytes(known.source, "weights of a user")).hexdigest(),
        "conditions": list(conditions),
        "episodes": plays.episodes,
        "seed": plays.seed,
        "persons": plays.persons,
        "overrides": list(plays.overrides),
    }
    folder = plays.out / _folder_name(user, known)
    mark = folder / _PLAYED
    if mark.is_file() and read_json(mark, "what was played, in JSON") == told:
        return folder
    mark.unlink(missing_ok=True)
    request = plays.request(folder, conditions=list(conditions))
    evaluate(user, request, on_progress=on_progress)
    write_atomically(mark, (json.dumps(told, indent=2) + "\n").encode())
    return folder


def _conditions(known: TrainedUser, behaviour: Behaviour) -> list[str]:
    """All compared conditions of the groups that a user was trained or is evaluated in."""
    app = known.config.env.app
    names = [*(known.config.evaluation.conditions or game_facts(app).evaluated)]
    condition = app.options.get("condition")
    groups = {behaviour.group_of(str(name)) for name in (*names, condition) if name is not None}
    return [
        name for group in behaviour.groups if group in groups for name in behaviour.played(group)
    ]


def _folder_name(user: str, known: TrainedUser) -> str:
    name = known.card.get("name")
    if name is None:
        name = f"{known.source.resolve().parents[1].name}_{known.source.stem}"
    return re.sub(r"[^\w.=-]+", "_", str(name))
