"""Sessions of simulated users: a watcher that keeps what devices reported and what the app did."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import INPUT_COUNT, INPUTS
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round
from sim2vr_harness.sessions import AppIdentity, Controller, Session, SessionEvent
from sim2vr_harness.sessions.replay import counted_events

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
        self.sessions.append(
            Session(
                time_ns=times_ns,
                head=poses["headset"],
                left=hands["left"],
                right=hands["right"],
                events=self._events(index, times_ns),
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

    def _events(self, index: int, times_ns: NDArray[np.int64]) -> tuple[SessionEvent, ...]:
        events: list[SessionEvent] = []
        before: Mapping[str, float] = {}
        for time_ns, logs in zip(times_ns.tolist(), self._logs, strict=True):
            events += counted_events(time_ns, before, logs[index])
            before = logs[index]
        return tuple(events)
