"""Users that count their substeps instead of moving, for senses that want numbers by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from sim2vr_harness.perception import Perception, Sense, Sensed, StepContext
from sim2vr_harness.perception.sense import float_space

SUBSTEPS, TIMESTEP_S = 25, 0.002


class FakeUsers:
    """N users whose only state is how many substeps they have made since their reset."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.substep = np.zeros(n)

    @property
    def time(self) -> np.ndarray:
        return self.substep * TIMESTEP_S


class World:
    """Plays steps and resets with senses in them, as the simulation does."""

    def __init__(self, n: int, *senses: Sense, pictures: tuple[int, ...] = (1, 2, 2)) -> None:
        self.users: Any = FakeUsers(n)
        self.heads = np.tile([0.0, 0, 0, 0, 0, 0, 1], (n, 1))
        self.moment = StepContext(
            users=self.users,
            pictures=np.zeros((n, *pictures), np.uint8),
            time_feature=np.zeros(n, np.float32),
            head_poses=lambda: self.heads,
            replied_s=np.zeros(n),
        )
        self.perception = Perception(senses)

    def reset(self, ids: list[int], seed: int = 1, **replied: Any) -> None:
        rows = np.array(ids)
        self.users.substep[rows] = 0
        self._reply(rows, replied)
        self.perception.reset(rows, seed + rows)
        self.perception.take(self.moment, None if len(ids) == self.users.n else rows)

    def step(self, ids: list[int] | None = None, **replied: Any) -> dict[str, np.ndarray]:
        """A step in which the users of ``ids`` are answered; returns the observation."""
        pauses = self.perception.pauses(self.moment)
        for substep in range(1, SUBSTEPS + 1):
            self.users.substep += 1
            if substep in pauses:
                pauses[substep]()
        rows = np.arange(self.users.n) if ids is None else np.array(ids)
        self._reply(rows, replied)
        self.perception.take(self.moment, None if ids is None else rows)
        return self.perception.observe()

    def _reply(self, rows: np.ndarray, replied: dict[str, Any]) -> None:
        self.moment.haptics = replied.get("haptics", {})
        self.moment.sounds = replied.get("sounds", {})
        self.moment.replied_s[rows] = self.users.time[rows]
        if "level" in replied:
            self.moment.pictures[rows] = replied["level"]


def clock(n: int = 1) -> Sensed:
    """A sense of one number: how many ms the user has lived."""
    return Sensed(
        "clock",
        float_space(-1e6, 1e6, 1),
        n,
        lambda moment, ids: moment.users.time[slice(None) if ids is None else ids, None] * 1000.0,
    )


def pulse(hand: str, amplitude: float, duration_s: float) -> Any:
    return SimpleNamespace(hand=hand, amplitude=amplitude, duration_s=duration_s, frequency_hz=0.0)


def sound(position_m: tuple[float, float, float], gain: float = 1.0) -> Any:
    return SimpleNamespace(name="knock", position_m=position_m, gain=gain)
