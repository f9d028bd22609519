"""The extension module and what it can do without an app."""

from typing import Any

from sim2vr_harness.base.gl import prepare_process
from sim2vr_harness.client.base import Int64Array


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
