"""The game's CSV logs of evaluated rounds, in folders that are named by their round.

Apps number the rounds that they log and know nothing of jobs; which app plays which job depends on
how many are played in parallel.
"""

import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round

PERSON_FILE = "person.json"
"""Beside the logs of a round: the fields of the ``users.Person`` who played it."""

_ROUND = re.compile(r"(\d{4,})-.+")


class RoundLogs(Watcher):
    """A watcher that finds every round's log and, in the end, gives it the round's name.

    Args:
        root: Gets a folder, named by :attr:`Round.key`, for every round that was logged;
            where users are people, with who played in ``person.json``.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._playing: list[Path] = []
        self._found: dict[tuple[str, int], Path] = {}
        self._taken: set[Path] = set()
        for abandoned in root.glob(".playing*"):
            shutil.rmtree(abandoned)

    @property
    def any(self) -> bool:
        """Whether there are logs: games need not write any."""
        return self._root.is_dir() and next(self._root.iterdir(), None) is not None

    def folder(self) -> Path:
        """A folder for the logs of one more simulation."""
        self._playing.append(self._root / f".playing{len(self._playing)}")
        return self._playing[-1]

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Note the folders that the apps have begun: the newest of each."""
        for i, job in enumerate(jobs):
            rounds = [
                place
                for place in self._playing[-1].glob(f"user{i:03d}*/*")
                if _ROUND.fullmatch(place.name) and place not in self._taken
            ]
            if rounds:
                newest = max(rounds, key=lambda place: place.name)
                self._found[job.condition, job.seed] = newest
        self._taken |= {place for playing in self._playing for place in playing.glob("user*/*")}

    def settle(self, rounds: Sequence[Round], out: Path) -> list[Round]:
        """Move the logs to their places, once every simulation is closed.

        Logs of apps that lay them out otherwise stay in a folder per app.

        Returns:
            The rounds, with their ``log_folder`` relative to ``out``.
        """
        settled = []
        for result in rounds:
            place = self._found.get((result.condition, result.seed))
            if place is None or not place.is_dir():
                settled.append(result)
                continue
            folder = self._root / result.key
            _move(place, folder)
            if result.person is not None:
                content = json.dumps(result.person, indent=2) + "\n"
                write_atomically(folder / PERSON_FILE, content.encode())
            relative = folder.relative_to(out).as_posix()
            settled.append(replace(result, log_folder=relative))
        for playing in self._playing:
            if playing.is_dir() and not self._found:
                for own in playing.iterdir():
                    _move(own, self._root / own.name)
            shutil.rmtree(playing, ignore_errors=True)
        return settled


def _move(source: Path, target: Path) -> None:
    if target.exists():
        shutil.rmtree(target)
    source.replace(target)
