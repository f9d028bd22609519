"""The app inside this process: the C++ runtime through its extension module."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sim2vr_harness.client.base import (
    AppReply,
    ClockSettings,
    DevicePoses,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.gl import prepare_process


def checked_seed(seed: int) -> int:
    """The seed; ValueError when it has more than 32 bits."""
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed: got {seed}, expected an integer from 0 to 2**32 - 1")
    return seed


def load_runtime() -> Any:
    """The extension module; RuntimeError says how to build it."""
    prepare_process()
    try:
        from sim2vr_harness import _app_runtime
    except ImportError as error:
        raise RuntimeError(
            "the extension module sim2vr_harness._app_runtime cannot be loaded "
            f"({error}); build it with 'make setup' or 'pip install .'"
        ) from error
    return _app_runtime


def runtime_version() -> str:
    """Version of the C++ runtime."""
    return str(load_runtime().__version__)


def gl_renderer(kind: str = "automatic") -> str:
    """Starts a renderer and returns its description; RuntimeError says what was tried."""
    return str(load_runtime().gl_renderer(kind))


def list_games() -> dict[str, str]:
    """Names of the games the runtime can play, with their descriptions."""
    return dict(load_runtime().list_games())


def frame_time_ns(frame: int, frame_rate_hz: int) -> int:
    """Time of a frame in lockstep, ns after the reset.

    n times the largest binary32 below the frame period (20 Hz: n * 0.049999997 s), where the
    reference's recorded frames lie: a hair below the grid of fixed steps, so that no game time is
    a tie which binary32 rounding would decide.
    """
    return int(load_runtime().frame_time_ns(frame, frame_rate_hz))


def frame_times_ns(frames: Int64Array, frame_rate_hz: int) -> Int64Array:
    """:func:`frame_time_ns` of many frames, of any shape."""
    times: Int64Array = load_runtime().frame_time_ns(frames, frame_rate_hz)
    return times


class InProcessApp:
    """:class:`~sim2vr_harness.client.base.AppClient` over the extension module.

    Args:
        game: name of the game (:func:`list_games`).
        options: the game's options.
        width: of the headset image, pixels.
        height: of the headset image, pixels.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``.
        log_dir: folder for ``states.csv`` and ``events.csv`` of every round, or None.
        clock: fixed step and tolerances of the app's clock.

    Raises:
        ValueError: unknown game or option, unusable size; names the field, got and expected.
        RuntimeError: no renderer can be started.
    """

    def __init__(
        self,
        game: str,
        options: Mapping[str, OptionValue] | None = None,
        *,
        width: int = 120,
        height: int = 80,
        renderer: str = "automatic",
        log_dir: Path | None = None,
        clock: ClockSettings | None = None,
    ) -> None:
        self._reply: AppReply | None = None
        self._app: Any = load_runtime().App(
            game=game,
            options=json.dumps(dict(options or {})),
            width=width,
            height=height,
            renderer=renderer,
            log_dir="" if log_dir is None else str(log_dir),
            **asdict(clock or ClockSettings()),
        )

    def _open(self) -> Any:
        if self._app is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._app

    @property
    def renderer_description(self) -> str:
        """See :class:`AppClient`."""
        return str(self._open().renderer_description)

    @property
    def image(self) -> UInt8Array:
        """See :class:`AppClient`; keeps the app's memory alive as long as the view lives."""
        view: UInt8Array = self._open().image
        return view

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """See :class:`AppClient`."""
        return AppReply(
            *self._open().reset(
                checked_seed(seed),
                json.dumps(dict(options or {})),
                poses.head,
                poses.left_controller,
                poses.right_controller,
                time_ns,
            )
        )

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        return AppReply(
            *self._open().step(time_ns, poses.head, poses.left_controller, poses.right_controller)
        )

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        return AppReply(
            *self._open().step_frames(
                times_ns, poses.head, poses.left_controller, poses.right_controller
            )
        )

    def start_step(self, times_ns: Int64Array, poses: DevicePoses, *, last: bool = False) -> None:
        """See :class:`AppClient`; runs the frames."""
        self._reply = self.step_frames(times_ns, poses)

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`."""
        reply, self._reply = self._reply, None
        if reply is None:
            raise RuntimeError("finish_step: no step was started; call start_step first")
        return reply

    @property
    def capabilities(self) -> frozenset[str]:
        """See :class:`AppClient`; all that the game has."""
        return frozenset(self._open().capabilities)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        """See :class:`AppClient`."""
        image: UInt8Array = self._open().render_view("headset", width, height)
        return image

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        """See :class:`AppClient`."""
        image: UInt8Array = self._open().render_view(view, width, height)
        return image

    def save(self) -> bytes:
        """See :class:`AppClient`."""
        return bytes(self._open().save())

    def load(self, state: bytes) -> None:
        """See :class:`AppClient`."""
        self._open().load(state)

    def state_hash(self) -> int:
        """See :class:`AppClient`."""
        return int(self._open().state_hash())

    def close(self) -> None:
        """See :class:`AppClient`."""
        if self._app is not None:
            self._app.close()
            self._app = None

    def __enter__(self) -> InProcessApp:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
