"""The app in the loop: one interface, in this process or outside.

The only importer of the extension module and of ZeroMQ.
"""

from sim2vr_harness.client.base import (
    CAPABILITIES,
    AppClient,
    AppReply,
    ClockSettings,
    OptionValue,
)
from sim2vr_harness.client.channel import Channel
from sim2vr_harness.client.devices import (
    INPUT_COUNT,
    INPUT_NAMES,
    INPUTS,
    DevicePoses,
    HapticPulse,
    Input,
    SoundEvent,
    input_named,
)
from sim2vr_harness.client.errors import (
    APP_FAILURES,
    AppDied,
    AppError,
    AppRefused,
    AppTimeout,
    AppUnsupported,
    ProtocolError,
)
from sim2vr_harness.client.games import (
    Condition,
    GameFacts,
    GameOption,
    ItemOutcome,
    LoggedItem,
    Measure,
    RewardTerm,
    Timeline,
    TimelineItem,
    describe_game,
    describe_level,
    facts_of_outside,
    list_options,
    load_game_library,
)
from sim2vr_harness.client.in_process import InProcessApp, InProcessBatch, InProcessBatchApp
from sim2vr_harness.client.launch import (
    StartingApp,
    connect,
    is_sim2vr_app,
    sim2vr_arguments,
    start_sim2vr_app,
    start_unity_app,
    unity_arguments,
)
from sim2vr_harness.client.openxr.app import OpenXRApp
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.protocol1 import Protocol1App
from sim2vr_harness.client.protocol2 import Protocol2App, Protocol2Connection
from sim2vr_harness.client.runtime import (
    frame_time_ns,
    frame_times_ns,
    gl_renderer,
    list_games,
    runtime_version,
)
from sim2vr_harness.client.scene import PLAYER_LAYER, AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.tasks import (
    Outcome,
    Task,
    TaskedApp,
    TaskMoment,
    TaskRules,
    check_task,
    load_task,
)
from sim2vr_harness.client.transport import AppPlace, AppSource, AppsWanted, PageStart, Transport
from sim2vr_harness.client.transports import (
    AppTrial,
    list_transports,
    register_transport,
    transport_named,
    try_app,
)
from sim2vr_harness.client.webxr.app import WebXRApp

__all__ = [
    "APP_FAILURES",
    "CAPABILITIES",
    "INPUTS",
    "INPUT_COUNT",
    "INPUT_NAMES",
    "PLAYER_LAYER",
    "AppClient",
    "AppDied",
    "AppError",
    "AppPlace",
    "AppProcess",
    "AppRefused",
    "AppReply",
    "AppScene",
    "AppSource",
    "AppTimeout",
    "AppTrial",
    "AppUnsupported",
    "AppsWanted",
    "Channel",
    "ClockSettings",
    "Condition",
    "DevicePoses",
    "GameFacts",
    "GameOption",
    "HapticPulse",
    "InProcessApp",
    "InProcessBatch",
    "InProcessBatchApp",
    "Input",
    "ItemOutcome",
    "LoggedItem",
    "Measure",
    "OpenXRApp",
    "OptionValue",
    "Outcome",
    "PageStart",
    "Protocol1App",
    "Protocol2App",
    "Protocol2Connection",
    "ProtocolError",
    "RewardTerm",
    "SceneMesh",
    "SceneObject",
    "SoundEvent",
    "StartingApp",
    "Task",
    "TaskMoment",
    "TaskRules",
    "TaskedApp",
    "Timeline",
    "TimelineItem",
    "Transport",
    "WebXRApp",
    "check_task",
    "connect",
    "describe_game",
    "describe_level",
    "facts_of_outside",
    "frame_time_ns",
    "frame_times_ns",
    "gl_renderer",
    "input_named",
    "is_sim2vr_app",
    "list_games",
    "list_options",
    "list_transports",
    "load_game_library",
    "load_task",
    "register_transport",
    "runtime_version",
    "sim2vr_arguments",
    "start_sim2vr_app",
    "start_unity_app",
    "transport_named",
    "try_app",
    "unity_arguments",
]
