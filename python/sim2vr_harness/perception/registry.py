"""The senses and wrappers by name, and the perception of N users that is made of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import Field, field_validator

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.base.settings import Settings, Weight
from sim2vr_harness.perception.events import Haptics, Hearing
from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.perception.sense import (
    IntArray,
    Sense,
    Sensed,
    StepContext,
    float_space,
    rows_of,
)
from sim2vr_harness.perception.vision import fovea, vision
from sim2vr_harness.perception.wrappers import Delayed, History, Noisy, OwnDelays, Stacked
from sim2vr_harness.users import FEATURES


@dataclass(frozen=True)
class Surroundings:
    """Properties of users and apps that the construction of senses needs.

    Attributes:
        n: number of users N.
        proprioception: proprioception of the body.
        timestep_s: physics step.
        substeps: physics steps per user step.
        frames_per_step: app frames per user step.
        channels: channels of the images, see
            :data:`~sim2vr_harness.perception.vision.CHANNELS`.
        eyes: 1 or 2.
        height: height of the images, pixels.
        width: width of the images, pixels.
        fovea: height and width of the pictures around the gaze, pixels; None: there are none.
        inputs: names of the inputs that the fingers operate, in the order of the actions.
        gaze_range_deg: largest angle of the eyes from straight ahead; 0: fixed eyes.
        actions: number of actions per user step.
        head_moves: True if a reflex moves the heads.
        person_delays: name of a person's delay -> each user's own; empty: users are not
            people who differ.
    """

    n: int
    proprioception: Proprioception
    timestep_s: float
    substeps: int
    frames_per_step: int
    channels: tuple[str, ...]
    eyes: int
    height: int
    width: int
    fovea: tuple[int, int] | None = None
    inputs: tuple[str, ...] = ()
    gaze_range_deg: float = 0.0
    actions: int = 0
    head_moves: bool = False
    person_delays: Mapping[str, OwnDelays] = field(default_factory=dict)

    @property
    def frame_grid(self) -> int:
        """Physics steps between app frames."""
        return self.substeps // self.frames_per_step

    @property
    def step_seconds(self) -> float:
        """Duration of a user step."""
        return self.substeps * self.timestep_s


_LONGEST_S = 60.0
"""Largest time span of ``history_s`` and ``stack_s``."""

DelayMs = Annotated[float, Field(ge=0.0, le=60_000.0)]
AgoS = Annotated[float, Field(gt=0.0, le=_LONGEST_S)]


class SenseConfig(Settings):
    """A sense of the user with its delay, noise and stacking (docs/reference/senses.md)."""

    sense: str
    """Kind of sense: vision, fovea, fovea_depth, proprioception, time, haptics, sound, fingers,
    gaze, actions, head or person."""
    name: str | None = Field(default=None, min_length=1)
    """Its key in the observation; None: the kind, of ``time`` stateful_information."""
    delay_ms: DelayMs | Literal["person"] = 0.0
    """Observation delay, a multiple of the physics step. Images exist for app frames only: the
    newest one that is at least this old is observed; see ``frames_per_step``. ``person``: the delay
    of the user's person (``env.user.people``)."""
    noise: Weight = 0.0
    """Standard deviation of Gaussian noise on the sense, in its own unit; for images, as a
    proportion of the full scale."""
    history_s: AgoS | tuple[AgoS, ...] | None = None
    """Time before the newest observation, s, of an older one that is stacked behind it: a multiple
    of the user step, or several in increasing order, such as [0.25, 0.5]."""
    stack_s: AgoS | None = None
    """Time span, s, whose observations are all stacked, the newest first: a multiple of the user
    step. 0.2 at 20 Hz stacks the last four."""

    @field_validator("history_s", mode="before")
    @classmethod
    def _one_time_or_several(cls, given: Any) -> Any:
        times = given if isinstance(given, list | tuple) else (given,)
        if given is not None and not all(_is_time(time) for time in times):
            expected = f"seconds above 0, up to {_LONGEST_S:g}, or a list of such that grow"
            raise ValueError(f"got {given!r}, expected {expected}")
        return given


def _is_time(given: Any) -> bool:
    is_number = isinstance(given, int | float) and not isinstance(given, bool)
    return is_number and 0.0 < given <= _LONGEST_S


@dataclass(frozen=True)
class SenseKind:
    """A kind of sense that a configuration can request.

    Attributes:
        key: key in the observation unless it is renamed.
        description: one line for readers.
        make: (key, surroundings) -> the sense.
        person_delay: name of the person's delay for ``delay_ms: person``; None: not available.
    """

    key: str
    description: str
    make: Callable[[str, Surroundings], Sense]
    person_delay: str | None = None


def _vision(name: str, around: Surroundings) -> Sense:
    return vision(
        name,
        around.n,
        channels=around.channels,
        eyes=around.eyes,
        height=around.height,
        width=around.width,
        frame_grid=around.frame_grid,
    )


def _proprioception(name: str, around: Surroundings) -> Sense:
    sense = around.proprioception
    space = sense.observation_space
    return Sensed(name, space, around.n, lambda now, ids: sense.observe(now.users)[rows_of(ids)])


def _numbers(
    size: Callable[[Surroundings], int],
    look: Callable[[StepContext, Surroundings], NDArray[Any]],
    limit: float = 1.0,
    needed: tuple[str, str] | None = None,
) -> Callable[[str, Surroundings], Sense]:
    """Return what makes a sense of numbers that are a function of the moment.

    Args:
        size: how many there are.
        look: returns all users' values, (N, size).
        limit: values are within plus and minus this.
        needed: a field of the surroundings that must be set, and what is said where it is not.
    """

    def make(name: str, around: Surroundings) -> Sense:
        if needed is not None and not getattr(around, needed[0]):
            raise ValueError(f"senses: got {needed[1]}")
        space = float_space(-limit, limit, size(around))
        return Sensed(name, space, around.n, lambda now, ids: look(now, around)[rows_of(ids)])

    return make


_ROOM_M = 1000.0
"""Largest distance of a headset from the origin, m."""
_HEAD_UNITS = np.array([0.1, 0.1, 0.1, 0.02, 0.02])
"""Units of the sense ``head``, rad and m, about two standard deviations each."""

_SEEN, _FELT = "visual_delay_s", "proprioceptive_delay_s"

_FLOAT_MAX = float(np.finfo(np.float32).max)
_FINGERS = "inputs", "'fingers', expected user.inputs for them to work"
_GAZE = "gaze_range_deg", "'gaze', expected vision.fovea with gaze: moves"
_HEAD = "head_moves", "'head', expected user.head: reflex for it to move"

SENSES: dict[str, SenseKind] = {
    "vision": SenseKind("vision", "the headset's picture", _vision, _SEEN),
    "fovea": SenseKind(
        "fovea",
        "the picture around the gaze, in detail",
        lambda name, around: fovea(
            name, around.n, around.channels, around.fovea, around.frame_grid
        ),
        _SEEN,
    ),
    "fovea_depth": SenseKind(
        "fovea_depth",
        "its depth in metres",
        lambda name, around: fovea(name, around.n, None, around.fovea, around.frame_grid),
        _SEEN,
    ),
    "proprioception": SenseKind("proprioception", "the own body", _proprioception, _FELT),
    "time": SenseKind(
        "stateful_information",
        "where in the round the app is, as it says",
        _numbers(lambda around: 1, lambda now, _: np.clip(now.time_feature, -1.0, 1.0)[:, None]),
    ),
    "haptics": SenseKind(
        "haptics",
        "vibrations of the controllers",
        lambda name, around: Haptics(name, around.n),
        _FELT,
    ),
    "sound": SenseKind(
        "sound", "loudness at both ears", lambda name, around: Hearing(name, around.n)
    ),
    "fingers": SenseKind(
        "fingers",
        "how far the fingers press their inputs",
        _numbers(lambda around: len(around.inputs), lambda now, _: now.inputs, needed=_FINGERS),
        _FELT,
    ),
    "gaze": SenseKind(
        "gaze",
        "where in the head the eyes look",
        _numbers(
            lambda around: 2, lambda now, around: now.gaze_deg / around.gaze_range_deg, needed=_GAZE
        ),
        _FELT,
    ),
    "actions": SenseKind(
        "actions",
        "what the user did last (an efference copy)",
        _numbers(lambda around: around.actions, lambda now, _: now.actions),
    ),
    "head": SenseKind(
        "head",
        "how far a reflex has moved the head",
        _numbers(
            lambda around: 5,
            lambda now, _: np.clip(now.users.head_offsets / _HEAD_UNITS, -10.0, 10.0),
            10.0,
            _HEAD,
        ),
        _SEEN,
    ),
    "headset": SenseKind(
        "headset",
        "where the headset says that it is: x y z, w x y z",
        _numbers(
            lambda around: 7,
            lambda now, _: np.concatenate(now.users.device_poses("headset"), axis=1),
            _ROOM_M,
        ),
    ),
    "person": SenseKind(
        "person",
        "who the user is: stature, strength, delays",
        _numbers(
            lambda around: len(FEATURES), lambda now, _: now.users.person_features, _FLOAT_MAX
        ),
    ),
}
"""Every sense by the name that configurations use."""

WRAPPERS: dict[str, str] = {
    "delay_ms": "a delay line, in ms",
    "noise": "Gaussian noise, a standard deviation",
    "history_s": "the newest and, behind it, what was so many seconds before; one time or several",
    "stack_s": "all user steps of the last so many seconds, the newest first",
}
"""Wrappers that apply to any sense: setting -> description."""


def make_sense(settings: SenseConfig, around: Surroundings) -> Sense:
    """The sense and what is wrapped around it: delay, then noise, then history or stack.

    Raises:
        ValueError: an unknown sense, or a setting that cannot be used; names it.
    """
    kind = SENSES.get(settings.sense)
    if kind is None:
        raise unknown_name("sense", settings.sense, SENSES)
    sense = kind.make(settings.name or kind.key, around)
    try:
        if settings.delay_ms:
            delay: float | OwnDelays
            if settings.delay_ms != "person":
                delay = settings.delay_ms
            else:
                if kind.person_delay is None:
                    late = ", ".join(name for name, other in SENSES.items() if other.person_delay)
                    raise ValueError(f"delay_ms: got 'person', which {late} have; expected ms")
                if not around.person_delays:
                    expected = "user.people for users to be persons"
                    raise ValueError(f"delay_ms: got 'person', expected {expected}")
                delay = around.person_delays[kind.person_delay]
            sense = Delayed(sense, delay, timestep_s=around.timestep_s, substeps=around.substeps)
        if settings.noise:
            sense = Noisy(sense, settings.noise)
        if settings.history_s is not None:
            sense = History(sense, settings.history_s, step_seconds=around.step_seconds)
        if settings.stack_s is not None:
            sense = Stacked(sense, settings.stack_s, step_seconds=around.step_seconds)
    except ValueError as error:
        raise ValueError(f"senses, {settings.sense}: {error}") from None
    return sense


def check_list(senses: Sequence[SenseConfig]) -> None:
    """Raises ValueError for unknown senses, two of a name, and two pictures."""
    keys: list[str] = []
    for settings in senses:
        if settings.sense not in SENSES:
            raise unknown_name("sense", settings.sense, SENSES)
        keys.append(settings.name or SENSES[settings.sense].key)
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(
                f"senses: got two with the name {key!r}, expected each once (name: renames one)"
            )
    if [settings.sense for settings in senses].count("vision") > 1:
        raise ValueError(
            "senses: got 'vision' twice, expected it once: an app draws one picture per step"
        )


class Perception:
    """The senses of N users.

    Args:
        senses: with different names.
    """

    def __init__(self, senses: Sequence[Sense]) -> None:
        self.senses = tuple(senses)
        self._watching: list[Sense] = []
        self.space = spaces.Dict({sense.name: sense.space for sense in senses})

    @property
    def drawn_frame(self) -> int | IntArray:
        """App frame of a step to render, -1: the last one; (N,) if users differ."""
        for sense in self.senses:
            if not isinstance(sense.frame, int) or sense.frame != -1:
                return sense.frame
        return -1

    @property
    def late_pictures(self) -> Delayed | None:
        """Delay line of the images; None if no image is delayed."""
        for sense in self.senses:
            inner: Any = sense
            while inner is not None:
                if isinstance(inner, Delayed) and inner.of_pictures:
                    return inner
                inner = getattr(inner, "sense", None)
        return None

    def watch(self, sense: Sense) -> None:
        """Add a sense that is updated with the users' senses, but is not part of the observation.

        Args:
            sense: a sense without pauses; its state is saved and restored with the users'.
        """
        self._watching.append(sense)

    @property
    def _all(self) -> tuple[Sense, ...]:
        return (*self.senses, *self._watching)

    @property
    def needs(self) -> dict[str, str]:
        """Capabilities that the apps need -> the sense that is constant without."""
        return {sense.needs: sense.name for sense in self.senses if sense.needs is not None}

    def pauses(self, moment: StepContext) -> dict[int, Callable[[], None]]:
        """Return the callback for every substep at which a sense has to be sampled."""
        paused: dict[int, list[Sense]] = {}
        for sense in self.senses:
            for substep in sense.pauses:
                paused.setdefault(substep, []).append(sense)

        def call(senses: Sequence[Sense], substep: int) -> Callable[[], None]:
            def sample() -> None:
                for sense in senses:
                    sense.sample(moment, substep)

            return sample

        return {substep: call(senses, substep) for substep, senses in paused.items()}

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """Clear the past of these users; see :meth:`Sense.reset`."""
        for sense in self._all:
            sense.reset(ids, seeds)

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        """Update all senses at the end of a step or a reset; see :meth:`Sense.take`."""
        for sense in self._all:
            sense.take(moment, ids)

    def observe(self) -> dict[str, NDArray[Any]]:
        """Return the observation as new arrays, first axis N."""
        return {sense.name: sense.observe() for sense in self.senses}

    def state_dict(self, i: int) -> dict[str, Any]:
        """Return the complete state of user i's senses."""
        return {sense.name: sense.state_dict(i) for sense in self._all}

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restores what :meth:`state_dict` returned.

        Raises:
            ValueError: the state is of other senses.
        """
        expected = [sense.name for sense in self._all]
        if sorted(state) != sorted(expected):
            raise ValueError(f"state: got the senses {sorted(state)}, expected {sorted(expected)}")
        for sense in self._all:
            sense.load_state_dict(i, state[sense.name])
