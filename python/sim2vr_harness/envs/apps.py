"""Apps of a configuration's users, made by the configured transport."""

from collections.abc import Callable
from pathlib import Path

from sim2vr_harness.base.cores import budget
from sim2vr_harness.client import (
    AppClient,
    AppPlace,
    AppsWanted,
    AppUnsupported,
    GameFacts,
    Transport,
    list_transports,
    transport_named,
)
from sim2vr_harness.client.tasks import Task, TaskedApp, load_task
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.late_hands import app_options

AppFactory = Callable[[EnvConfig, int, Path | None], AppClient]
"""Makes the app of user i: (config, i, log folder) -> client. It is called again for a user whose
app has failed and was closed."""

IPD_M = 0.064
"""Pupil distance of users without an own one."""


def apps_wanted(
    config: EnvConfig, n: int, ipd_m: float = IPD_M, task: Task | None = None
) -> AppsWanted:
    """Return the request to the transport.

    Args:
        ipd_m: the users' pupil distance.
        task: task that judges the apps, if any.
    """
    vision = config.vision
    eye = vision.fovea
    return AppsWanted(
        n=n,
        game=config.app.game,
        options=app_options(config.app.options),
        width=vision.width,
        height=vision.height,
        eyes=vision.eyes,
        fovea=(0, 0, 0.0) if eye is None else (eye.width, eye.height, vision.fovea_pixel_m),
        ipd_m=ipd_m,
        depth="depth" in config.vision.channels,
        renderer=config.app.renderer,
        frequency_hz=config.action_frequency_hz,
        threads=budget(config.cores),
        place=_place(config.app),
        values={} if task is None else dict(task.values),
        page_reset=None if task is None else task.page_reset,
    )


def _place(app: AppConfig) -> AppPlace:
    return AppPlace(
        executable=app.executable,
        arguments=app.arguments,
        connect=app.connect,
        timeout_s=app.timeout_s,
        start_timeout_s=app.start_timeout_s,
        time_scale=app.time_scale,
        processes=app.processes,
        page=app.page,
        map=app.map,
        browser=app.browser,
        options=app.transport_options,
    )


def app_factory(config: EnvConfig, n: int, ipd_m: float = IPD_M) -> AppFactory:
    """Return the factory for ``config.app.transport``.

    Args:
        ipd_m: the users' pupil distance.

    Raises:
        ValueError: the settings do not support that many users.
        AppUnsupported: the users need a capability that the transport lacks.
    """
    transport = transport_named(config.app.transport)
    _require(transport, "two_eyes", config.vision.eyes == 2, "vision.eyes: got 2")
    _require(transport, "fovea", config.vision.fovea is not None, "vision.fovea: got one")
    _require(
        transport,
        "inputs",
        bool(config.user.inputs),
        f"user.inputs: got {', '.join(config.user.inputs)}",
    )
    if not judged(config.app):
        source = transport.apps(apps_wanted(config, n, ipd_m))
        return lambda _config, index, log_dir: source(index, log_dir)
    source = transport.apps(apps_wanted(config, n, ipd_m, load_task(config.app.task)))
    return lambda _config, index, log_dir: TaskedApp(
        source(index, log_dir), load_task(config.app.task)
    )


def judged(app: AppConfig) -> bool:
    """Return whether a task defines the reward; always true if the transport reports none."""
    return app.task is not None or not transport_named(app.transport).reports_reward


def _require(transport: Transport, capability: str, wanted: bool, got: str) -> None:
    """Reject a capability that this transport does not support, before anything is started."""
    if wanted and capability not in transport.capabilities:
        able = [repr(one.name) for one in list_transports() if capability in one.capabilities]
        raise AppUnsupported(
            f"{capability}: {got}, which the transport {transport.name!r} cannot carry, expected "
            f"{' or '.join(able)}"
        )


def knows_options(app: AppConfig) -> bool:
    """Return whether the app accepts game options at every reset, as our runtime does.

    Other SIM2VR apps accept them at their start, as arguments. For an app that is already running
    elsewhere the answer is unknown, and False is returned.
    """
    return transport_named(app.transport).knows_options(_place(app))


def facts_told(app: AppConfig) -> GameFacts | None:
    """The reply of an app outside about its game; None where it does not say.

    Raises:
        RuntimeError: it runs already, as is written, and does not answer.
    """
    return transport_named(app.transport).facts(_place(app), app.game)
