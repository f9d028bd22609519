"""What an environment is made of: the app, the user and what the user senses.

Every model forbids unknown keys and is immutable; the training configuration nests
:class:`EnvConfig` under ``env``.
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from sim2vr_harness.client.base import OptionValue


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class EffortConfig(_Settings):
    """Cost of muscular effort, subtracted from the game's reward in every user step."""

    model: Literal[
        "cumulative_fatigue_3ccr", "neural", "muscle_state", "consumed_endurance", "zero"
    ] = "cumulative_fatigue_3ccr"
    weight: float = Field(default=0.1, ge=0.0)
    """Reward per unit of the model's cost; 0.1 is the reference's value for Whac-A-Mole."""


class NoiseConfig(_Settings):
    """Motor noise on the muscle controls (off in the reference)."""

    signal_dependent: Literal["white", "red"] | None = None
    """Noise that grows with the control: drawn afresh each step (white) or accumulating (red)."""
    constant: Literal["white", "red"] | None = None
    """Noise shared by all muscles, whatever their control."""


class UserConfig(_Settings):
    """The simulated person."""

    model: str = "mobl_arms_wrist"
    skull_rotation_deg: float = Field(default=10.0, ge=-90.0, le=90.0)
    """Downward pitch of the skull and with it of the headset, degrees."""
    effort: EffortConfig = EffortConfig()
    noise: NoiseConfig = NoiseConfig()


class VisionConfig(_Settings):
    """The headset image as the user sees it."""

    width: int = Field(default=120, ge=8, le=4096)
    height: int = Field(default=80, ge=8, le=4096)
    channels: tuple[Literal["red", "green", "blue", "depth"], ...] = ("green", "depth")
    buffer_s: float | None = Field(default=None, gt=0.0)
    """With a buffer, the image of this many seconds ago is stacked behind the newest one."""


class AppConfig(_Settings):
    """The VR application in the loop."""

    game: str = "whacamole"
    options: dict[str, OptionValue] = {"condition": "medium"}
    """The game's options; each game validates its own (docs/games/)."""
    renderer: Literal["automatic", "egl", "osmesa", "null"] = "automatic"


class EnvConfig(_Settings):
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
