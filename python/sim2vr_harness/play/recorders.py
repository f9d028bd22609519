"""Watchers that keep rounds: the game's CSV logs, and sessions of what devices reported."""

import json
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.client import INPUT_COUNT, INPUTS
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round
from sim2vr_harness.sessions import AppIdentity, Controller, Session, SessionEvent
from sim2vr_harness.sessions.replay import counted_events

PERSON_FILE = "person.json"
"""Beside the logs of a round: the fields of the ``users.Person`` who played it."""

_ROUND = re.compile(r"(\d{4,})-.+")


class RoundLogs(Watcher):
    """A watcher that finds every round's log and, in the end, gives it the round's name.

    Apps number the rounds that they log and know nothing of jobs; which app plays which job depends
    on how many are played in parallel.

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
        """True if there are logs; games need not write any."""
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


# --- sessions -------------------------------------------------------------------------------------

_SIDES = {"left": "controller_left", "right": "controller_right"}


class SessionRecorder(Watcher):
    """Keeps a session per round, a frame per user step.

    Args:
        app: what is played.
    """

    def __init__(self, app: AppIdentity) -> None:
        self.sessions: list[Session] = []
        self._app = app
        self._simulation: Any = None
        self._rows: list[dict[str, NDArray[Any]]] = []
        self._logs: list[Sequence[Mapping[str, float]]] = []

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Begin anew."""
        self._simulation, self._rows, self._logs = simulation, [], []

    def stepped(self, reward: NDArray[Any], infos: Sequence[Mapping[str, Any]]) -> None:
        """Keep the devices' poses, the inputs and the app's numbers."""
        users = self._simulation.users
        rows = {name: pose_to_app(*users.device_poses(name)) for name in users.body.devices}
        if self._simulation.config.user.inputs:
            rows["inputs"] = np.array(self._simulation.actions.input_values)
        self._rows.append(rows)
        self._logs.append([info.get("log") or {} for info in infos])

    def ended(self, index: int, result: Round) -> None:
        """Make the session of user ``index``."""
        dt_s = self._simulation.users.dt
        poses = {
            name: np.stack([rows[name][index] for rows in self._rows]).astype(np.float64)
            for name in self._rows[0]
        }
        times_ns = np.rint(np.arange(1, len(self._rows) + 1) * dt_s * 1e9).astype(np.int64)
        hands = {side: self._controller(poses, side) for side in _SIDES}
        events: list[SessionEvent] = []
        before: Mapping[str, float] = {}
        for time_ns, logs in zip(times_ns.tolist(), self._logs, strict=True):
            events += counted_events(time_ns, before, logs[index])
            before = logs[index]
        self.sessions.append(
            Session(
                time_ns=times_ns,
                head=poses["headset"],
                left=hands["left"],
                right=hands["right"],
                events=tuple(events),
                app=replace(self._app, condition=result.condition),
                seed=result.seed,
                source="evaluation",
                person="" if result.person is None else str(result.person.get("index", "")),
            )
        )

    def _controller(self, poses: Mapping[str, NDArray[Any]], side: str) -> Controller | None:
        if _SIDES[side] not in poses:
            return None
        inputs = None
        names = list(self._simulation.config.user.inputs)
        for one in INPUTS:
            if one.hand == side and f"{side}.{one.name}" in names:
                inputs = (
                    np.zeros((len(poses["headset"]), INPUT_COUNT)) if inputs is None else inputs
                )
                inputs[:, one.column] = poses["inputs"][:, names.index(f"{side}.{one.name}")]
        return Controller(poses[_SIDES[side]], inputs=inputs)
