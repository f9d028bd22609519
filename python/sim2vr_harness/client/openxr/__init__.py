"""Unmodified OpenXR programs in lockstep: a runtime of our own inside them."""

import os
import shutil
from pathlib import Path

from sim2vr_harness.base import paths
from sim2vr_harness.client.base import AppClient
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.foreign import FRAME_RATE_HZ, VERTICAL_FOV_DEG
from sim2vr_harness.client.openxr.app import CAPABILITIES, OpenXRApp, config_of
from sim2vr_harness.client.openxr.display import Display
from sim2vr_harness.client.openxr.program import Launch
from sim2vr_harness.client.openxr.runtime_files import (
    CLOCK_LIBRARY,
    MODES_LIBRARY,
    find_library,
    find_runtime,
)
from sim2vr_harness.client.openxr.values import ProgramValues
from sim2vr_harness.client.transport import AppSource, AppsWanted, Transport, checked_options

__all__ = ["OPENXR", "OpenXRApp", "find_runtime"]

_TRUTHS = ("false", "true")
_CHOICES = {
    "gate": ("strict", "pipelined"),
    "virtual_clock": _TRUTHS,
    "xvfb": _TRUTHS,
    "ahead": ("auto", *_TRUTHS),
    "frame_rate_hz": (str(FRAME_RATE_HZ), "90"),
    "profile": ("oculus-touch", "valve-index", "htc-vive", "khr-simple"),
}
_PROFILES = {
    "oculus-touch": "/interaction_profiles/oculus/touch_controller",
    "valve-index": "/interaction_profiles/valve/index_controller",
    "htc-vive": "/interaction_profiles/htc/vive_controller",
    "khr-simple": "/interaction_profiles/khr/simple_controller",
}


class _Programs:
    """The source of the users' programs; they share a display."""

    def __init__(self, wanted: AppsWanted) -> None:
        self._wanted = wanted
        self._options = checked_options(wanted.place.options, _CHOICES)
        self._display: Display | None = None
        self._open = 0

    def __call__(self, index: int, log_dir: Path | None) -> AppClient:
        """The program of user ``index``; see :data:`AppSource`."""
        if log_dir is not None:
            raise AppRefused("logs: got a folder, but a program writes none, expected no --log")
        options, wanted = self._options, self._wanted
        app = OpenXRApp(
            wanted,
            self._launch(),
            pipelined=options["gate"] == "pipelined",
            ahead=options["ahead"],
            on_close=self._closed,
        )
        self._open += 1
        return app

    def _closed(self) -> None:
        self._open -= 1
        if self._open == 0 and self._display is not None:
            self._display.close()
            self._display = None

    def _launch(self) -> Launch:
        options, wanted = self._options, self._wanted
        place = wanted.place
        if place.executable is None:
            raise AppRefused("app.executable: got none, expected an OpenXR program")
        virtual = options["virtual_clock"] == "true"
        names = []
        if virtual or ProgramValues(self._wanted.values).of_lines:
            names.append(CLOCK_LIBRARY)
        if self._options["xvfb"] == "true":
            names.append(MODES_LIBRARY)
        found = {name: find_library(name) for name in names}
        for name, file in found.items():
            if file is None:
                raise AppRefused(
                    f"OpenXR programs: got no {name}, expected the package's own; run: "
                    f"{paths.rebuild_command()}"
                )
        preload = [file for file in found.values() if file is not None]
        environment = {
            "PYTHONUNBUFFERED": "1",
            "QT_FORCE_STDERR_LOGGING": "1",
            # Mesa's software drivers draw in the thread that asks: programs share the cores.
            "LP_NUM_THREADS": os.environ.get("LP_NUM_THREADS", "0"),
        }
        if options["xvfb"] == "true":
            if self._display is None or not self._display.running:
                self._display = Display(place.start_timeout_s)
            environment |= self._display.environment
        return Launch(
            command=[_found(place.executable), *place.arguments],
            manifest=find_runtime(),
            config=config_of(
                wanted,
                frame_rate_hz=int(options["frame_rate_hz"]),
                vertical_fov_deg=VERTICAL_FOV_DEG,
                pipelined=options["gate"] == "pipelined",
                profile=_PROFILES[options["profile"]],
            ),
            preload=preload,
            environment=environment,
            virtual_clock=virtual,
            depth=wanted.depth and wanted.renderer != "null",
            start_timeout_s=place.start_timeout_s,
            depth_unit_m=_unit_m(options.get("depth_unit_m")),
        )


def _unit_m(text: str | None) -> float | None:
    """Metres of one unit of depth, None: the engine's; raises :class:`AppRefused`."""
    if text is None:
        return None
    try:
        unit_m = float(text)
    except ValueError:
        unit_m = 0.0
    if not 1e-4 <= unit_m <= 10.0:
        raise AppRefused(
            f"app.transport_options.depth_unit_m: got {text!r}, expected a number from 0.0001 to 10"
        )
    return unit_m


def _found(program: str) -> str:
    """The path of a program that is named by its path or is on the PATH."""
    return program if "/" in program else (shutil.which(program) or program)


def _apps(wanted: AppsWanted) -> AppSource:
    return _Programs(wanted)


OPENXR = Transport(
    name="openxr",
    summary="an OpenXR program as it is, by a runtime of our own",
    apps=_apps,
    capabilities=CAPABILITIES,
    reads=frozenset({"executable", "arguments", "timeout_s", "start_timeout_s"}),
    options={
        "gate": "strict (default), or pipelined: for programs that wait for a frame early",
        "virtual_clock": "whether the program's clocks are virtual (default: false)",
        "xvfb": "whether to start an X server without a screen (default: false)",
        "ahead": "start the next round's program early: auto (default: if slow), true, false",
        "frame_rate_hz": "the display's: 72 (default) or 90",
        "depth_unit_m": "metres of one unit of the program's depth (default: 1, Qt's 0.005)",
        "profile": "controllers: oculus-touch (default), valve-index, htc-vive, khr-simple",
    },
    text_options=frozenset({"gate", "profile", "depth_unit_m", "frame_rate_hz", "ahead"}),
    users_per_connection=1,
    needs="executable",
    reports_reward=False,
)
