"""The app in the loop: one interface, in-process transport; the only importer of the extension."""

from sim2vr_harness.client.base import (
    AppClient,
    AppReply,
    ClockSettings,
    DevicePoses,
    OptionValue,
)
from sim2vr_harness.client.in_process import (
    InProcessApp,
    frame_time_ns,
    gl_renderer,
    list_games,
    runtime_version,
)

__all__ = [
    "AppClient",
    "AppReply",
    "ClockSettings",
    "DevicePoses",
    "InProcessApp",
    "OptionValue",
    "frame_time_ns",
    "gl_renderer",
    "list_games",
    "runtime_version",
]
