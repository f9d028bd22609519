"""Base class of tasks, which reward apps that report no reward."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sim2vr_harness.client.base import AppValue, Float64Array, UInt8Array
from sim2vr_harness.client.devices import DevicePoses, HapticPulse, SoundEvent
from sim2vr_harness.client.games import Measure, RewardTerm

DEVICES = ("head", "left_controller", "right_controller")
"""What a moment knows the pose of."""


@dataclass(frozen=True)
class TaskMoment:
    """What a task receives after a user step, or at the start of a round.

    Attributes:
        time_s: since the round began.
        step_s: since the moment before; 0 at the start.
        poses: of the devices at the end of the step, (7,) each: position x y z (m), rotation
            x y z w, app frame (left-handed, x right, y up, z forward, origin on the floor).
        haptics: vibrations that the app requested in the step.
        sounds: that began in it.
        values: what the app answers for :attr:`Task.values`: numbers, truths, or places x y z
            (m, app frame); None: it has none now.
        log: the app's own named numbers; a page has none.
        app_reward: what the app itself rewards the step with; a page 0.
        app_finished: whether the app itself says that the round is over.
        picture: (H, W, 4) uint8, with two eyes (2, H, W, 4): colour, and linear depth / 10 m. A
            view of the app's, overwritten by the next step.
    """

    time_s: float
    step_s: float
    poses: DevicePoses
    haptics: tuple[HapticPulse, ...] = ()
    sounds: tuple[SoundEvent, ...] = ()
    values: Mapping[str, AppValue] = field(default_factory=dict)
    log: Mapping[str, float] = field(default_factory=dict)
    app_reward: float = 0.0
    app_finished: bool = False
    picture: UInt8Array = field(default_factory=lambda: np.zeros((1, 1, 4), np.uint8))

    def number(self, name: str, default: float = 0.0) -> float:
        """Return a value as a number, ``default`` where the app has none.

        Raises:
            KeyError: no value of that name was requested.
            TypeError: it is a place.
        """
        value = self.values[name]
        if isinstance(value, tuple):
            raise TypeError(f"{name} is a place, expected a number")
        return default if value is None else float(value)

    def place(self, name: str) -> Float64Array:
        """Return a value that is a place, (3,) x y z in m, app frame.

        Raises:
            KeyError: no value of that name was requested.
            TypeError: it is a number.
        """
        value = self.values[name]
        if not isinstance(value, tuple):
            raise TypeError(f"{name} is {value!r}, expected a place x y z")
        return np.array(value, dtype=np.float64)

    def position(self, device: str) -> Float64Array:
        """Return where a device of :data:`DEVICES` is, (3,) x y z in m, app frame.

        Raises:
            ValueError: there is no such device, or the user has none; names it.
        """
        pose = getattr(self.poses, device) if device in DEVICES else None
        if pose is None:
            raise ValueError(f"device: got {device!r}, expected one of {', '.join(DEVICES)} in use")
        found: Float64Array = np.asarray(pose, dtype=np.float64)[:3]
        return found


@dataclass(frozen=True)
class Outcome:
    """What a task makes of a user step.

    Attributes:
        reward: of the step, before effort is subtracted.
        finished: whether the round is over.
        time_feature: where in the round it is, -1 to 1; None: by :attr:`Task.round_seconds`.
        log: named numbers of the round so far and of the step, beside those of the values.
    """

    reward: float
    finished: bool = False
    time_feature: float | None = None
    log: Mapping[str, float] = field(default_factory=dict)


class Task:
    """Base of tasks; an instance judges the rounds of one user, one after the other.

    What a round depends on is set in :meth:`reset`: a task learns of every round's start, and its
    outcomes may depend on nothing but the moments since.

    Attributes:
        description: in a line.
        values: name -> expression that is read from the app after every step. Of a page, one in
            JavaScript: ``window.app.score``, ``locate("ball")`` for the place of an object by its
            name. Of other apps the name of a number in their log.
        measures: what tables show of a round; their keys are those of the log.
        score: name of the measure by which users are compared.
        round_seconds: a round is over by then.
        devices: controllers without which it cannot be played: ``controller_right``, ...
        inputs: of the controllers, that fingers work unless the configuration says otherwise:
            ``right.trigger``, ...
        reward_terms: parts of the reward that the log has.
        page_reset: expression by which a page begins a round; None: it is loaded anew.
    """

    description: str = ""
    values: Mapping[str, str] = {}
    measures: tuple[Measure, ...] = ()
    score: str | None = None
    round_seconds: float = 60.0
    devices: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    reward_terms: tuple[RewardTerm, ...] = ()
    page_reset: str | None = None

    def reset(self, moment: TaskMoment, seed: int) -> None:
        """Begin a round.

        Args:
            moment: the first one.
            seed: of the round.
        """

    def step(self, moment: TaskMoment) -> Outcome:
        """Judge a user step."""
        return Outcome(0.0)
