"""The senses and wrappers by name, and how a user's perception is made of them."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from sim2vr_harness.base.settings import Settings, Weight
from sim2vr_harness.perception.foveation import Foveation
from sim2vr_harness.perception.haptics import Haptics
from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.perception.sense import (
    IntArray,
    Sense,
    Sensed,
    StepContext,
    float_space,
    rows_of,
)
from sim2vr_harness.perception.sound import Hearing
from sim2vr_harness.perception.vision import fovea, vision
from sim2vr_harness.perception.wrappers import Delayed, History, Noisy, OwnDelays, Stacked
from sim2vr_harness.users import FEATURES


@dataclass(frozen=True)
class Surroundings:
    """What senses are made for.

    Attributes:
        n: number of users N.
        proprioception: what the body reports of itself.
        timestep_s: physics step.
        substeps: physics steps per user step.
        frames_per_step: app frames per user step.
        channels: of the pictures, see :data:`~sim2vr_harness.perception.vision.CHANNELS`.
        eyes: 1 or 2.
        height: of the pictures, pixels.
        width: of the pictures, pixels.
        foveation: how their resolution falls, or None.
        zoom: how many times as wide and as high they are drawn.
        inputs: names of the inputs that the fingers work, in the order of the actions.
        gaze_range_deg: how far from straight ahead the eyes turn; 0: they do not.
        actions: how many actions a user step has.
        head_moves: whether a reflex moves the heads.
        person_delays: what a person's delays are called -> each user's own; empty: users are not
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
    foveation: Foveation | None = None
    zoom: int = 1
    inputs: tuple[str, ...] = ()
    gaze_range_deg: float = 0.0
    actions: int = 0
    head_moves: bool = False
    person_delays: Mapping[str, OwnDelays] = field(default_factory=dict)

    @property
    def step_seconds(self) -> float:
        """Duration of a user step."""
        return self.substeps * self.timestep_s


_LONGEST_S = 60.0
"""How long ago something may be that is remembered."""

DelayMs = Annotated[float, Field(ge=0.0, le=60_000.0)]
AgoS = Annotated[float, Field(gt=0.0, le=_LONGEST_S)]


class SenseConfig(Settings):
    """One of the user's senses, and what is wrapped around it (docs/reference/senses.md)."""

    sense: str
    """Which: vision, fovea, proprioception, time, haptics, sound, fingers, gaze, actions, head or
    person."""
    name: str | None = Field(default=None, min_length=1)
    """Its key in the observation; None: vision, fovea, proprioception, stateful_information
    (time), haptics, sound, fingers, gaze, actions, head, person."""
    delay_ms: DelayMs | Literal["person"] = 0.0
    """How late it is perceived: a multiple of the physics step. Pictures, which exist for app
    frames only, are the youngest that are not younger; see ``frames_per_step``. ``person``: as late
    as the person that the user is (``env.user.people``) sees or feels."""
    noise: Weight = 0.0
    """Standard deviation of noise on it, in its own unit; of a picture, in parts of the full
    scale."""
    history_s: AgoS | tuple[AgoS, ...] | None = None
    """Stacks behind the newest what was so many seconds before: a multiple of the user step, or
    several that grow, as [0.25, 0.5]."""
    stack_s: AgoS | None = None
    """Stacks everything of the last so many seconds, the newest first: a multiple of the user step.
    0.2 at 20 Hz is the last four."""

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
    """A sense that can be requested.

    Attributes:
        key: in the observation unless it is renamed.
        description: one line for people.
        make: (key, surroundings) -> the sense.
        person_delay: which of a person's delays ``delay_ms: person`` means; None: of none.
    """

    key: str
    description: str
    make: Callable[[str, Surroundings], Sense]
    person_delay: str | None = None


def _vision(name: str, around: Surroundings) -> Sense:
    return vision(name, around.n, **_pictures(around), foveation=around.foveation)


def _fovea(name: str, around: Surroundings) -> Sense:
    return fovea(name, around.n, **_pictures(around))


def _pictures(around: Surroundings) -> dict[str, Any]:
    """What senses of pictures receive of them."""
    return {
        "channels": around.channels,
        "eyes": around.eyes,
        "height": around.height,
        "width": around.width,
        "frame_grid": around.substeps // around.frames_per_step,
        "zoom": around.zoom,
    }


def _proprioception(name: str, around: Surroundings) -> Sense:
    sense = around.proprioception

    def look(moment: StepContext, ids: IntArray | None) -> NDArray[np.float32]:
        return sense.observe(moment.users)[rows_of(ids)]

    return Sensed(name, sense.observation_space, around.n, look)


def _time(name: str, around: Surroundings) -> Sense:
    def look(moment: StepContext, ids: IntArray | None) -> NDArray[np.float32]:
        return np.clip(moment.time_feature[rows_of(ids)], -1.0, 1.0)[:, None]

    return Sensed(name, float_space(-1.0, 1.0, 1), around.n, look)


def _fingers(name: str, around: Surroundings) -> Sense:
    if not around.inputs:
        raise ValueError("senses: got 'fingers', expected user.inputs for them to work")

    def look(moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        return moment.inputs[rows_of(ids)]

    return Sensed(name, float_space(-1.0, 1.0, len(around.inputs)), around.n, look)


def _gaze(name: str, around: Surroundings) -> Sense:
    if not around.gaze_range_deg:
        raise ValueError("senses: got 'gaze', expected vision.foveation with gaze: moves")

    def look(moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        return moment.gaze_deg[rows_of(ids)] / around.gaze_range_deg

    return Sensed(name, float_space(-1.0, 1.0, 2), around.n, look)


def _actions(name: str, around: Surroundings) -> Sense:
    def look(moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        return moment.actions[rows_of(ids)]

    return Sensed(name, float_space(-1.0, 1.0, around.actions), around.n, look)


def _haptics(name: str, around: Surroundings) -> Sense:
    return Haptics(name, around.n)


def _sound(name: str, around: Surroundings) -> Sense:
    return Hearing(name, around.n)


def _head(name: str, around: Surroundings) -> Sense:
    if not around.head_moves:
        raise ValueError("senses: got 'head', expected user.head: reflex for it to move")

    def look(moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        return np.clip(moment.users.head_offsets[rows_of(ids)] / _HEAD_UNITS, -10.0, 10.0)

    return Sensed(name, float_space(-10.0, 10.0, 5), around.n, look)


def _headset(name: str, around: Surroundings) -> Sense:
    def look(moment: StepContext, ids: IntArray | None) -> NDArray[Any]:
        placed = np.concatenate(moment.users.device_poses("headset"), axis=1)
        return placed[rows_of(ids)]

    return Sensed(name, float_space(-_ROOM_M, _ROOM_M, 7), around.n, look)


def _person(name: str, around: Surroundings) -> Sense:
    def look(moment: StepContext, ids: IntArray | None) -> NDArray[np.float32]:
        return moment.users.person_features[rows_of(ids)]

    limit = float(np.finfo(np.float32).max)
    return Sensed(name, float_space(-limit, limit, len(FEATURES)), around.n, look)


_ROOM_M = 1000.0
"""Farthest that a headset says to be from the origin, m."""
_HEAD_UNITS = np.array([0.1, 0.1, 0.1, 0.02, 0.02])
"""Of the sense ``head``, rad and m: about two deviations each."""

_SEEN, _FELT = "visual_delay_s", "proprioceptive_delay_s"

SENSES: dict[str, SenseKind] = {
    "vision": SenseKind("vision", "the headset's picture", _vision, _SEEN),
    "fovea": SenseKind("fovea", "the middle of the picture, in detail", _fovea, _SEEN),
    "proprioception": SenseKind("proprioception", "the own body", _proprioception, _FELT),
    "time": SenseKind("stateful_information", "where in the round the app is, as it says", _time),
    "haptics": SenseKind("haptics", "vibrations of the controllers", _haptics, _FELT),
    "sound": SenseKind("sound", "loudness at both ears", _sound),
    "fingers": SenseKind("fingers", "how far the fingers press their inputs", _fingers, _FELT),
    "gaze": SenseKind("gaze", "where in the head the eyes look", _gaze, _FELT),
    "actions": SenseKind("actions", "what the user did last (an efference copy)", _actions),
    "head": SenseKind("head", "how far a reflex has moved the head", _head, _SEEN),
    "headset": SenseKind("headset", "where the headset says that it is: x y z, w x y z", _headset),
    "person": SenseKind("person", "who the user is: stature, strength, delays", _person),
}
"""Every sense by the name that configurations use."""

WRAPPERS: dict[str, str] = {
    "delay_ms": "a delay line, in ms",
    "noise": "Gaussian noise, a standard deviation",
    "history_s": "the newest and, behind it, what was so many seconds before; one time or several",
    "stack_s": "all user steps of the last so many seconds, the newest first",
}
"""What can be done to any sense: its setting and what that is."""


def make_sense(settings: SenseConfig, around: Surroundings) -> Sense:
    """The sense and what is wrapped around it: delay, then noise, then history or stack.

    Raises:
        ValueError: an unknown sense, or a setting that cannot be used; names it.
    """
    kind = SENSES.get(settings.sense)
    if kind is None:
        raise ValueError(unknown_sense(settings.sense))
    sense = kind.make(settings.name or kind.key, around)
    try:
        if settings.delay_ms:
            delay: float | OwnDelays
            if settings.delay_ms != "person":
                delay = settings.delay_ms
            else:
                if kind.person_delay is None:
                    late = [name for name, other in SENSES.items() if other.person_delay]
                    raise ValueError(
                        f"delay_ms: got 'person', which {', '.join(late)} have; expected ms"
                    )
                if not around.person_delays:
                    raise ValueError(
                        "delay_ms: got 'person', expected user.people for users to be persons"
                    )
                delay = around.person_delays[kind.person_delay]
            sense = Delayed(
                sense,
                delay,
                timestep_s=around.timestep_s,
                substeps=around.substeps,
            )
        if settings.noise:
            sense = Noisy(sense, settings.noise)
        if settings.history_s is not None:
            sense = History(sense, settings.history_s, step_seconds=around.step_seconds)
        if settings.stack_s is not None:
            sense = Stacked(sense, settings.stack_s, step_seconds=around.step_seconds)
    except ValueError as error:
        raise ValueError(f"senses, {settings.sense}: {error}") from None
    return sense


def unknown_sense(got: str) -> str:
    """Words the error for a sense that is none."""
    close = difflib.get_close_matches(got, SENSES, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"sense: got {got!r}, expected one of {', '.join(SENSES)}{hint}"


def check_list(senses: Sequence[SenseConfig]) -> None:
    """Raises ValueError for unknown senses, two of a name, and two pictures."""
    keys: list[str] = []
    for settings in senses:
        if settings.sense not in SENSES:
            raise ValueError(unknown_sense(settings.sense))
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
