"""Configuration of an environment: the app, the user and its senses.

Every model forbids unknown keys and is immutable; the training configuration nests
:class:`EnvConfig` under ``env``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from sim2vr_harness.base.settings import Settings, Weight
from sim2vr_harness.client import list_transports, transport_named
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.client.devices import INPUT_NAMES
from sim2vr_harness.client.tasks import TaskRules
from sim2vr_harness.perception.registry import SenseConfig, check_list
from sim2vr_harness.users import (
    FATIGUE_PRESETS,
    EffortName,
    FatiguePreset,
    PeopleSettings,
    Physique,
    Population,
    ResetOptions,
    effort_options,
)
from sim2vr_harness.users.bodies.options import PhysicsStep
from sim2vr_harness.users.head_reflex import HeadMotion
from sim2vr_harness.users.noise import MotorNoiseSettings

__all__ = [
    "DEFAULT_SENSES",
    "AppConfig",
    "EffortConfig",
    "EnvConfig",
    "FoveaConfig",
    "NoiseConfig",
    "SenseConfig",
    "UserConfig",
    "VisionConfig",
    "page_name",
    "with_options",
]

_LONGEST_ADDRESS = 106
_ADDRESS = re.compile(r"[^\s:/]+:([0-9]{1,5})")


Rate = Annotated[float, Field(ge=0.0, le=1e4)]


class EffortConfig(Settings):
    """Cost of muscular effort, subtracted from the game's reward in every user step."""

    model: EffortName = "cumulative_fatigue_3ccr"
    """The effort model (docs/reference/bodies.md)."""
    weight: Weight | None = None
    """Reward per unit of the model's cost; None: the model's own: 0.1 for cumulative_fatigue_3ccr,
    the reference's value for Whac-A-Mole."""
    preset: FatiguePreset = "reference"
    """cumulative_fatigue_3ccr: published values of ``r``, ``fatigue`` and ``recovery``. With
    ``shoulder`` endurance is that of people's shoulders, ``reference`` has the SIM2VR paper's
    values (docs/reference/exertion.md)."""
    r: Rate | None = None
    """The same model: how many times faster units recover while the load is met; None: 7.5, or
    15 with the preset ``shoulder``."""
    fatigue: Rate | None = None
    """The same model: rate at which active units tire, 1/s; None: 0.0146, ``shoulder`` 0.0182."""
    recovery: Rate | None = None
    """The same model: rate at which tired units recover, 1/s; None: 0.0022, ``shoulder``
    0.00168."""
    development: Rate | None = None
    """The same model: gain with which force is built up, 1/s; 10."""
    relaxation: Rate | None = None
    """The same model: gain with which force is released, 1/s; 10."""
    finger_effort: Weight = 0.0
    """Reward that each input held by a finger costs per user step, times how far it is held from
    rest (a pressed button: 1). 0: fingers are free."""

    @model_validator(mode="after")
    def _options_of_the_model(self) -> EffortConfig:
        known = effort_options(self.model)
        # A weight beside zero is that of the configuration before the model was changed.
        wrong = [name for name in self._given() if name not in (*known, "weight")]
        if wrong:
            raise ValueError(
                f"{wrong[0]}: got {getattr(self, wrong[0])} for {self.model}, expected "
                f"{'one of ' + ', '.join(known) if known else 'no options'}"
            )
        if self.preset != "reference" and "fatigue" not in known:
            raise ValueError(
                f"preset: got {self.preset} for {self.model}, expected cumulative_fatigue_3ccr"
            )
        return self

    def _given(self) -> dict[str, float]:
        return {
            name: value
            for name, value in self.model_dump(exclude={"model", "preset", "finger_effort"}).items()
            if value is not None
        }

    def options(self) -> dict[str, float]:
        """Return the options that are set, as arguments of `make_effort`."""
        known = effort_options(self.model)
        usual = {} if self.preset == "reference" else FATIGUE_PRESETS[self.preset]
        return {k: value for k, value in {**usual, **self._given()}.items() if k in known}


class NoiseConfig(Settings):
    """Motor noise on the muscle controls (off in the reference)."""

    signal_dependent: Literal["white", "red"] | None = None
    """Noise that grows with the control: independent in each step (white) or accumulating (red)."""
    constant: Literal["white", "red"] | None = None
    """Noise shared by all muscles, whatever their control."""
    signal_dependent_level: Weight = 0.103
    """Standard deviation per unit of control."""
    constant_level: Weight = 0.185
    """Standard deviation, in units of control."""


class UserConfig(Settings):
    """The simulated person."""

    model: str = "mobl_arms_wrist"
    """The body: a name (`sim2vr_harness.users.list_bodies()`) or a YAML file
    (docs/reference/bodies.md)."""
    person: Physique = Physique()
    """Differences between the person and the one that the body was measured on."""
    people: PeopleSettings | None = None
    """Population of virtual participants, sampled in every episode; None: all users are average."""
    skull_rotation_deg: float = Field(default=10.0, ge=-90.0, le=90.0)
    """Downward pitch of the skull and with it of the headset, degrees."""
    head: HeadMotion = "fixed"
    """Head motion of bodies without a neck: with ``reflex`` the headset follows the hand and sways,
    as people's heads do (docs/concepts/people.md)."""
    torso: bool = False
    """True: trunk and neck move, with six additional motors (docs/reference/bodies.md)."""
    reset: ResetOptions = ResetOptions()
    """Differences from the body's own way to start episodes."""
    effort: EffortConfig = EffortConfig()
    """The effort model, whose cost is subtracted from the reward."""
    noise: NoiseConfig = NoiseConfig()
    """Motor noise on the controls."""
    timestep_s: PhysicsStep | None = None
    """Physics step, 0.0001 to 0.02 s; None: the model's 2 ms. Coarser physics is for training
    only."""
    devices: tuple[str, ...] | None = None
    """Devices that the user wears: headset, controller_right, controller_left; None: all that the
    body supports. Their positions on the body are in docs/reference/bodies.md."""
    inputs: tuple[str, ...] = ()
    """Inputs of the controllers that the fingers work, such as right.trigger and left.x: one more
    action each, after those of the body."""

    @field_validator("inputs")
    @classmethod
    def _known_inputs(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name not in INPUT_NAMES:
                close = difflib.get_close_matches(name, INPUT_NAMES, n=1, cutoff=0.4)
                hint = f"; did you mean {close[0]!r}?" if close else ""
                raise ValueError(f"got {name!r}, expected any of {', '.join(INPUT_NAMES)}{hint}")
            if names.count(name) > 1:
                raise ValueError(f"got {name!r} twice, expected each input once")
        return names

    @model_validator(mode="after")
    def _people_with_a_physique(self) -> UserConfig:
        people_of(self)
        return self

    @model_validator(mode="before")
    @classmethod
    def _file_alone(cls, value: object) -> object:
        return {"model": value} if isinstance(value, str) else value


def motor_noise(config: NoiseConfig) -> MotorNoiseSettings | None:
    """Return the motor noise settings; None: no noise."""
    if config.signal_dependent is None and config.constant is None:
        return None
    return MotorNoiseSettings(**config.model_dump())


def people_of(config: UserConfig) -> Population | None:
    """Return the population of the users, None if they are all average.

    Raises:
        ValueError: ``person`` sets a property that the population samples.
    """
    return None if config.people is None else Population(config.people, config.person)


class FoveaConfig(Settings):
    """A second, narrow picture around the gaze, in more detail (docs/reference/senses.md).

    The defaults are a window of 17 degrees; at arm's length, 0.7 m, a pixel is 3 mm wide.
    """

    width: int = Field(default=72, ge=8, le=1024)
    """Width, pixels."""
    height: int = Field(default=72, ge=8, le=1024)
    """Height, pixels."""
    magnification: float = Field(default=6.0, ge=1.0, le=100.0)
    """Pixels of the headset image, on a plane across the view, per pixel of this one."""
    gaze: Literal["ahead", "moves"] = "ahead"
    """``moves``: two more actions, the last ones, direct it: right and up."""
    gaze_range_deg: float = Field(default=45.0, ge=0.1, le=55.0)
    """Rotation of the eyes from straight ahead, to every side, for an action of 1; people's turn by
    40 to 55 degrees (Guitton and Volle 1987)."""


class VisionConfig(Settings):
    """The headset image as the user sees it."""

    width: int = Field(default=120, ge=8, le=4096)
    """Width of the observed image, pixels."""
    height: int = Field(default=80, ge=8, le=4096)
    """Height of the observed image, pixels."""
    channels: tuple[Literal["red", "green", "blue", "depth"], ...] = ("green", "depth")
    """Channels of the observed image."""
    eyes: Literal[1, 2] = 1
    """2: a picture for each eye; the channels of the left one come first."""
    fovea: FoveaConfig | None = None
    """Off by default. The senses ``fovea`` and ``fovea_depth`` observe it. ``train --people`` sets
    it where the app can draw it."""

    @property
    def fovea_pixel_m(self) -> float:
        """Width of a pixel of the fovea at a depth of 1 m."""
        assert self.fovea is not None
        return 2.0 / (self.height * self.fovea.magnification)


DEFAULT_SENSES = tuple(SenseConfig(sense=name) for name in ("vision", "proprioception", "time"))
"""Those of the reference."""


class AppConfig(Settings):
    """The VR application in the loop."""

    game: str = "whacamole"
    """Name of the game or app; ``sim2vr-harness games`` lists those that are built in."""
    options: dict[str, OptionValue] = Field(default_factory=dict)
    """The game's options; each game has defaults and validates its own (docs/reference/games/).
    ``hand_lag_s``, of every app: by how much it sees hands late, s."""
    renderer: Literal["automatic", "egl", "osmesa", "null"] = "automatic"
    """Renderer of the images: a GPU (``egl``), the CPU (``osmesa``), or none (``null``), which is
    also what users without training have who are not filmed: they do not look."""
    transport: str = "in_process"
    """Connection to the app: in this process, or to an app outside by SIM2VR's protocol
    (protocol1), by our faster one (protocol2), or by another transport of the table; see
    docs/reference/apps.md."""
    transport_options: dict[str, OptionValue] = Field(default_factory=dict)
    """Settings of a custom transport in addition to the settings below."""
    executable: str | None = None
    """The app to start for every user, for example a Unity build with the SIM2VR asset (protocol
    1), or an OpenXR program (openxr); None starts our own sim2vr-app."""
    arguments: tuple[str, ...] = ()
    """Further arguments of the executable."""
    game_library: str | None = None
    """A shared library of games (docs/guide/own_game.md) that this process and the sim2vr-apps
    that it starts open."""
    connect: str | None = None
    """``HOST:PORT`` of an app that runs already, or a ZeroMQ endpoint such as ``ipc:///tmp/app``,
    instead of starting one."""
    timeout_s: float = Field(default=60.0, ge=0.001, le=86_400.0)
    """Longest time without an answer from an app outside, s; after it the app has failed and is
    started again."""
    start_timeout_s: float = Field(default=60.0, ge=0.001, le=86_400.0)
    """Longest time that an app outside may need to start, s."""
    time_scale: int = Field(default=5, ge=1, le=100)
    """Highest speed of a Unity app, as a multiple of real time."""
    processes: int = Field(default=0, ge=0, le=1024)
    """Protocol 2: server processes that share the users; 0: at most one per core."""
    page: str | None = None
    """WebXR (docs/reference/webxr.md): a page in HTML, a folder with an index.html, or an address
    below one of ``map``."""
    map: dict[str, str] = Field(default_factory=dict)
    """WebXR: beginning of an address -> local folder (or a whole address -> local file) that pages
    load from instead; all other addresses are refused."""
    browser: str | None = None
    """WebXR: the browser that shows pages; None: an installed Chromium."""
    task: TaskRules | str | None = None
    """Reward of the app, if the app does not publish one or another reward is wanted: rules, a YAML
    file of them, or ``FILE.py:CLASS`` (docs/reference/webxr.md). Works with every transport."""

    @model_validator(mode="before")
    @classmethod
    def _named_after_its_page(cls, given: Any) -> Any:
        """Name a page's game after the page, an OpenXR program's after the program."""
        if not isinstance(given, dict):
            return given
        if isinstance(given.get("page"), str):
            return {"game": page_name(given["page"]), **given}
        if given.get("transport") == "openxr" and isinstance(given.get("executable"), str):
            words = [given["executable"], *map(str, given.get("arguments") or ())]
            return {"game": program_name(words), **given}
        return given

    @model_validator(mode="after")
    def _consistent_transport(self) -> AppConfig:
        if self.connect is not None:
            match = _ADDRESS.fullmatch(self.connect)
            port = match is not None and 0 < int(match.group(1)) < 65536
            if not port and not self.connect.startswith("ipc://"):
                raise ValueError(
                    f"connect: got {self.connect!r}, expected HOST:PORT, such as localhost:5555"
                )
            if len(self.connect.encode()) > _LONGEST_ADDRESS:
                raise ValueError(
                    f"connect: got an address of {len(self.connect.encode()):,} bytes, expected at "
                    f"most {_LONGEST_ADDRESS}, as many as the name of a socket can have"
                )
            if self.executable is not None or self.arguments or self.game_library is not None:
                raise ValueError(
                    f"connect: got {self.connect!r} next to an executable, arguments or a "
                    "game_library, expected one of the two: an app that runs already, or one to "
                    "start"
                )
        transport = transport_named(self.transport)
        if transport.needs and getattr(self, transport.needs) is None:
            what = {"page": "a page in HTML", "executable": "an OpenXR program"}
            expected = what.get(transport.needs, "one")
            raise ValueError(
                f"{transport.needs}: got none for {self.transport!r}, expected {expected}"
            )
        for name in ("executable", "connect", "arguments", "page", "map", "browser"):
            if getattr(self, name) and name not in transport.reads:
                readers = [repr(one.name) for one in list_transports() if name in one.reads]
                raise ValueError(
                    f"transport: got {self.transport!r} together with {name}, expected "
                    f"{' or '.join(readers)}"
                )
        for name in self.transport_options:
            if name not in transport.options:
                known = ", ".join(map(repr, transport.options)) or "none"
                near = difflib.get_close_matches(name, transport.options, n=1)
                raise ValueError(
                    f"transport_options: got {name!r} for {self.transport!r}, expected {known}"
                    + (f"; did you mean {near[0]!r}?" if near else "")
                )
        return self


def page_name(page: str) -> str:
    """Return the name of the app that a page is: its file's name, or its folder's for an index."""
    parts = [part for part in re.split(r"[/\\\\]", page.partition("?")[0]) if part not in ("", ".")]
    last = parts[-1] if parts else "page"
    stem = re.sub(r"\.html?$", "", last, flags=re.IGNORECASE)
    if stem == "index" and len(parts) > 1:
        stem = parts[-2]
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", stem).strip("_.-") or "page"


def program_name(command: Sequence[str]) -> str:
    """Return the name of the app that a command starts: its script, or the program itself."""
    scripts = [word for word in command[1:] if word.endswith((".py", ".qml"))]
    return page_name((scripts or [command[0]])[0].removesuffix(".py").removesuffix(".qml"))


class EnvConfig(Settings):
    """One simulated user in one app."""

    app: AppConfig = AppConfig()
    """The app, and how it runs."""
    user: UserConfig = UserConfig()
    """The simulated user's body, effort and motor noise."""
    vision: VisionConfig = VisionConfig()
    """Rendering and sampling of the headset's image. :attr:`senses` sets whether the user perceives
    it, with which delay and noise."""
    senses: tuple[SenseConfig, ...] = Field(default=DEFAULT_SENSES, min_length=1)
    """Senses of the user: each is one entry of the observation."""
    action_frequency_hz: int = Field(default=20, ge=1, le=500)
    """User steps per second; one image each."""
    frames_per_step: int = Field(default=1, ge=1, le=10_000)
    """App frames per user step, each with the device poses of its own moment; the last one is
    drawn. Divides the physics steps of a user step (25 at 20 Hz: 1, 5 or 25). 1 is the reference:
    tracking at the action frequency; 5 at 20 Hz is tracking at 100 Hz."""
    max_episode_seconds: float = Field(default=1000.0, gt=0.0, le=1e6)
    """An episode that the game has not ended by then is truncated."""
    cores: int = Field(default=0, ge=0, le=4096)
    """Cores that physics, apps and torch may use; 0: every core that this process may run on.
    Results are identical for any number."""
    shards: Literal["auto"] | Annotated[int, Field(ge=1, le=256)] = "auto"
    """Processes among which the users of a vector environment or a training stage are divided, at
    most one per user. ``auto``: one per four cores and eight users, at least one. Results are
    identical for any number. One process plays all users where something reads their bodies or apps
    (evaluations, films, logs, privileged teachers) and where the app runs already (``connect``)."""

    @field_validator("senses")
    @classmethod
    def _known_senses(cls, senses: tuple[SenseConfig, ...]) -> tuple[SenseConfig, ...]:
        check_list(senses)
        return senses

    def sense(self, kind: str) -> SenseConfig | None:
        """Return the first of this kind among :attr:`senses`, None if there is none."""
        return next((sense for sense in self.senses if sense.sense == kind), None)

    @property
    def gaze_moves(self) -> bool:
        """Return whether two of the actions direct the gaze."""
        return self.gaze_range_deg > 0.0

    @property
    def gaze_range_deg(self) -> float:
        """Return the rotation range of the eyes, degrees; 0: they do not move."""
        eyes = self.vision.fovea
        return 0.0 if eyes is None or eyes.gaze == "ahead" else eyes.gaze_range_deg


def with_options(config: EnvConfig, options: Mapping[str, OptionValue]) -> EnvConfig:
    """Return the configuration with other options of the game; those not named stay."""
    merged = {**config.app.options, **options}
    app = AppConfig(**{**config.app.model_dump(), "options": merged})
    return config.model_copy(update={"app": app})
