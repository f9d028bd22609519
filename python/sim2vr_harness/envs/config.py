"""What an environment is made of: the app, the user and what the user senses.

Every model forbids unknown keys and is immutable; the training configuration nests
:class:`EnvConfig` under ``env``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal

from pydantic import Field, model_validator

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.settings import Settings

_ADDRESS = re.compile(r"[^\s:/]+:([0-9]{1,5})")


def _medium() -> dict[str, OptionValue]:
    return {"condition": "medium"}


class EffortConfig(Settings):
    """Cost of muscular effort, subtracted from the game's reward in every user step."""

    model: Literal[
        "cumulative_fatigue_3ccr", "neural", "muscle_state", "consumed_endurance", "zero"
    ] = "cumulative_fatigue_3ccr"
    weight: float = Field(default=0.1, ge=0.0)
    """Reward per unit of the model's cost; 0.1 is the reference's value for Whac-A-Mole."""


class NoiseConfig(Settings):
    """Motor noise on the muscle controls (off in the reference)."""

    signal_dependent: Literal["white", "red"] | None = None
    """Noise that grows with the control: drawn afresh each step (white) or accumulating (red)."""
    constant: Literal["white", "red"] | None = None
    """Noise shared by all muscles, whatever their control."""


class UserConfig(Settings):
    """The simulated person."""

    model: str = "mobl_arms_wrist"
    skull_rotation_deg: float = Field(default=10.0, ge=-90.0, le=90.0)
    """Downward pitch of the skull and with it of the headset, degrees."""
    effort: EffortConfig = EffortConfig()
    noise: NoiseConfig = NoiseConfig()
    timestep_s: float | None = Field(default=None, gt=0.0)
    """Physics step; None takes the model's 2 ms. Coarser physics is for trainings only."""


class VisionConfig(Settings):
    """The headset image as the user sees it."""

    width: int = Field(default=120, ge=8, le=4096)
    height: int = Field(default=80, ge=8, le=4096)
    channels: tuple[Literal["red", "green", "blue", "depth"], ...] = ("green", "depth")
    buffer_s: float | None = Field(default=None, gt=0.0)
    """With a buffer, the image of this many seconds ago is stacked behind the newest one."""


class AppConfig(Settings):
    """The VR application in the loop."""

    game: str = "whacamole"
    options: dict[str, OptionValue] = Field(default_factory=_medium)
    """The game's options; each game validates its own (docs/games/)."""
    renderer: Literal["automatic", "egl", "osmesa", "null"] = "automatic"
    transport: Literal["in_process", "protocol1", "protocol2"] = "in_process"
    """Where the app runs: in this process, or outside, reached by SIM2VR's protocol (1) or by our
    faster one (2); see docs/remote_apps.md."""
    executable: str | None = None
    """The app to start for every user, for example a Unity build with the SIM2VR asset (protocol
    1); None starts our own sim2vr-app."""
    arguments: tuple[str, ...] = ()
    """Further arguments of the executable."""
    connect: str | None = None
    """``HOST:PORT`` of an app that runs already, instead of starting one."""
    timeout_s: float = Field(default=60.0, gt=0.0)
    """An app outside that does not answer for so long has failed and is started again."""
    start_timeout_s: float = Field(default=60.0, gt=0.0)
    """How long an app outside may take to start."""
    time_scale: int = Field(default=5, ge=1, le=100)
    """How many times faster than real time a Unity app may run at most."""
    processes: int = Field(default=0, ge=0)
    """Protocol 2: server processes that share the users; 0 takes one per core at most."""

    @model_validator(mode="after")
    def _consistent_transport(self) -> AppConfig:
        if self.connect is not None:
            match = _ADDRESS.fullmatch(self.connect)
            if match is None or not 0 < int(match.group(1)) < 65536:
                raise ValueError(
                    f"connect: got {self.connect!r}, expected HOST:PORT, such as localhost:5555"
                )
            if self.executable is not None or self.arguments:
                raise ValueError(
                    f"connect: got {self.connect!r} next to an executable or arguments, expected "
                    "one of the two: an app that runs already, or one to start"
                )
        for name in ("executable", "connect", "arguments"):
            if self.transport == "in_process" and getattr(self, name):
                raise ValueError(
                    f"transport: got 'in_process' together with {name}, expected 'protocol1' or "
                    "'protocol2'"
                )
        return self


class EnvConfig(Settings):
    """One simulated user in one app."""

    app: AppConfig = AppConfig()
    user: UserConfig = UserConfig()
    vision: VisionConfig = VisionConfig()
    action_frequency_hz: int = Field(default=20, ge=1, le=500)
    """User steps per second; one image each."""
    frames_per_step: int = Field(default=1, ge=1)
    """App frames per user step, each with the device poses of its own moment; the last one is
    drawn. Divides the physics steps of a user step (25 at 20 Hz: 1, 5 or 25). 1 is the reference:
    tracking at the action frequency; 5 at 20 Hz is tracking at 100 Hz."""
    max_episode_seconds: float = Field(default=1000.0, gt=0.0)
    """An episode that the game has not ended by then is truncated."""
    threads: int = Field(default=0, ge=0)
    """Physics threads of a vector of users; 0 takes every core."""


def with_condition(config: EnvConfig, condition: str | None) -> EnvConfig:
    """The configuration with another condition of the game; None leaves it."""
    if condition is None:
        return config
    return with_options(config, {"condition": condition})


def with_options(config: EnvConfig, options: Mapping[str, OptionValue]) -> EnvConfig:
    """The configuration with other options of the game; those not named stay."""
    merged = {**config.app.options, **options}
    app = AppConfig(**{**config.app.model_dump(), "options": merged})
    return config.model_copy(update={"app": app})
