"""The app in the loop: one interface, in this process or outside.

The only importer of the extension module and of ZeroMQ.
"""

from sim2vr_harness.client.base import (
    AppClient,
    AppReply,
    ClockSettings,
    DevicePoses,
    OptionValue,
)
from sim2vr_harness.client.channel import Channel
from sim2vr_harness.client.errors import (
    APP_FAILURES,
    AppDied,
    AppError,
    AppRefused,
    AppTimeout,
    AppUnsupported,
    ProtocolError,
)
from sim2vr_harness.client.in_process import (
    InProcessApp,
    frame_time_ns,
    frame_times_ns,
    gl_renderer,
    list_games,
    runtime_version,
)
from sim2vr_harness.client.in_process_batch import InProcessBatch, InProcessBatchApp
from sim2vr_harness.client.launch import (
    StartingApp,
    connect,
    is_sim2vr_app,
    sim2vr_arguments,
    start_sim2vr_app,
    start_unity_app,
    unity_arguments,
)
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.protocol1 import Protocol1App
from sim2vr_harness.client.protocol2 import Protocol2App, Protocol2Connection

__all__ = [
    "APP_FAILURES",
    "AppClient",
    "AppDied",
    "AppError",
    "AppProcess",
    "AppRefused",
    "AppReply",
    "AppTimeout",
    "AppUnsupported",
    "Channel",
    "ClockSettings",
    "DevicePoses",
    "InProcessApp",
    "InProcessBatch",
    "InProcessBatchApp",
    "OptionValue",
    "Protocol1App",
    "Protocol2App",
    "Protocol2Connection",
    "ProtocolError",
    "StartingApp",
    "connect",
    "frame_time_ns",
    "frame_times_ns",
    "gl_renderer",
    "is_sim2vr_app",
    "list_games",
    "runtime_version",
    "sim2vr_arguments",
    "start_sim2vr_app",
    "start_unity_app",
    "unity_arguments",
]
