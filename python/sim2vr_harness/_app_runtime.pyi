"""
The sim2vr app runtime: headless VR apps in lockstep, in this process.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing
__all__: list[str] = ['App', 'AppBatch', 'EngineError', 'InvalidArgument', 'RenderError', 'StateError', 'frame_time_ns', 'gl_renderer', 'list_games', 'set_log_level']
class EngineError(RuntimeError):
    pass
class StateError(EngineError):
    pass
class RenderError(EngineError):
    pass
class InvalidArgument(ValueError):
    pass
class App:
    """
    One VR app in lockstep. Poses are arrays of 7 float64: position x y z (m), rotation x y z w, app frame (left-handed, y up, z forward). The GIL is released while the app works; one App must not be used from two threads at once, different Apps may.
    """
    def __init__(self, *, game: str, options: str = '{}', width: typing.SupportsInt | typing.SupportsIndex = 120, height: typing.SupportsInt | typing.SupportsIndex = 80, renderer: str = 'automatic', log_dir: str = '', fixed_delta_time_s: typing.SupportsFloat | typing.SupportsIndex = 0.002, maximum_delta_time_s: typing.SupportsFloat | typing.SupportsIndex = 0.3333333333333333, fixed_step_tolerance_s: typing.SupportsFloat | typing.SupportsIndex = 0.0) -> None:
        """
        options: JSON object. log_dir: root of the episode logs, '' for none. The times are those of TimeSettings in core/clock.hpp.
        """
    def close(self) -> None:
        """
        Frees the app; later calls raise StateError.
        """
    def load(self, state: bytes) -> None:
        """
        Goes on from saved bytes; EngineError for damaged or foreign ones.
        """
    def render_view(self, view: str, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.uint8]:
        """
        The last frame from 'headset', 'recorder' or 'spectator', (height, width, 4) uint8.
        """
    def reset(self, seed: typing.SupportsInt | typing.SupportsIndex, options: str, head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, time_ns: typing.SupportsInt | typing.SupportsIndex = 0) -> tuple[float, bool, float, dict[str, float]]:
        """
        Starts a round with its first frame at time_ns; returns (reward, finished, time feature, log).
        """
    def save(self) -> bytes:
        """
        The whole app state as bytes, mid-round included.
        """
    def set_buttons(self, hand: str, trigger: typing.SupportsFloat | typing.SupportsIndex = 0.0, squeeze: typing.SupportsFloat | typing.SupportsIndex = 0.0, thumbstick: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex] = (0.0, 0.0), lower: bool = False, upper: bool = False, menu: bool = False) -> None:
        """
        Inputs of the hand 'left' (lower X, upper Y) or 'right' (lower A, upper B) from the next frame on.
        """
    def state_hash(self) -> int:
        """
        64-bit hash of what save() would return.
        """
    def step(self, time_ns: typing.SupportsInt | typing.SupportsIndex, head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None) -> tuple[float, bool, float, dict[str, float]]:
        """
        Runs one frame; returns (reward, finished, time feature, log).
        """
    def step_frames(self, times_ns: typing.Annotated[numpy.typing.ArrayLike, numpy.int64], head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None) -> tuple[float, bool, float, dict[str, float]]:
        """
        One user step of K frames, the last one rendered: times_ns (K,) int64, poses (K, 7); returns (summed reward, finished, time feature, log).
        """
    @property
    def capabilities(self) -> list[str]:
        """
        Names of what it can do.
        """
    @property
    def image(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (height, width, 4) uint8 RGBA headset image of the last frame, row 0 = top, alpha = linear depth / far plane. A read-only view of the app's buffer without a copy: it is overwritten by reset, step and load, and stays valid memory after close().
        """
    @property
    def renderer_description(self) -> str:
        ...
class AppBatch:
    """
    N apps of one game, stepped together on threads. Poses are float64 rows of 7 as of App; M apps are chosen by their indices. Arrays of results are read-only views without copies: calls overwrite the rows of the apps they move; they stay valid memory after close(). The GIL is released while the apps work.
    """
    def __init__(self, *, game: str, options: str = '{}', apps: typing.SupportsInt | typing.SupportsIndex, threads: typing.SupportsInt | typing.SupportsIndex = 1, width: typing.SupportsInt | typing.SupportsIndex = 120, height: typing.SupportsInt | typing.SupportsIndex = 80, renderer: str = 'automatic', log_dir: str = '', fixed_delta_time_s: typing.SupportsFloat | typing.SupportsIndex = 0.002, vision_channels: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex] = []) -> None:
        """
        options: JSON object. log_dir: app 7 logs to user007 below it; '' for no logs. vision_channels: what `vision` holds, 0 red, 1 green, 2 blue, 3 depth.
        """
    def close(self) -> None:
        """
        Frees the apps; later calls raise StateError.
        """
    def load(self, app: typing.SupportsInt | typing.SupportsIndex, state: bytes) -> None:
        """
        As App.load, of one app; its rows of images, vision, privileged and logs are its own again.
        """
    def render_view(self, app: typing.SupportsInt | typing.SupportsIndex, view: str, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.uint8]:
        """
        As App.render_view, of one app.
        """
    def reset(self, indices: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], seeds: typing.Annotated[numpy.typing.ArrayLike, numpy.uint32], options: str, head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, time_ns: typing.SupportsInt | typing.SupportsIndex = 0) -> None:
        """
        Starts rounds at time_ns: indices (M,), seeds (M,), poses (M, 7). Errors name the first app that refused; the others have started.
        """
    def save(self, app: typing.SupportsInt | typing.SupportsIndex) -> bytes:
        """
        As App.save, of one app.
        """
    def state_hash(self, app: typing.SupportsInt | typing.SupportsIndex) -> int:
        """
        As App.state_hash, of one app.
        """
    def step(self, indices: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], times_ns: typing.Annotated[numpy.typing.ArrayLike, numpy.int64], head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None) -> None:
        """
        One user step of K frames: indices (M,), times_ns (M, K), poses (M, K, 7). Errors as in reset.
        """
    @property
    def capabilities(self) -> list[str]:
        """
        Names of what the apps can do.
        """
    @property
    def finished(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (N,) uint8.
        """
    @property
    def images(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (N, height, width, 4) uint8 RGBA.
        """
    @property
    def log_names(self) -> list[str]:
        """
        Names of the log's columns; empty before the first reset.
        """
    @property
    def logs(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        (N, len(log_names)) float64.
        """
    @property
    def privileged(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (N, len(privileged_names)) float32 after the last frame.
        """
    @property
    def privileged_names(self) -> list[str]:
        """
        Names of the privileged numbers' columns; none for a game without.
        """
    @property
    def renderer_description(self) -> str:
        ...
    @property
    def rewards(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (N,) float32 of the last step.
        """
    @property
    def threads(self) -> int:
        """
        Threads in use.
        """
    @property
    def time_features(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (N,) float32.
        """
    @property
    def vision(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (N, channels, height, width) uint8: the vision_channels of images.
        """
def frame_time_ns(frame: typing.Annotated[numpy.typing.ArrayLike, numpy.int64], frame_rate_hz: typing.Annotated[numpy.typing.ArrayLike, numpy.int32]) -> typing.Any:
    """
    Times of frames in lockstep, ns: n times the largest binary32 below the period.
    """
def gl_renderer(kind: str = 'automatic') -> str:
    """
    Starts a renderer ('automatic', 'egl', 'osmesa', 'null') and returns its description. RenderError says what was tried.
    """
def list_games() -> dict[str, str]:
    """
    Names of the games with their descriptions.
    """
def set_log_level(level: str) -> None:
    """
    'trace', 'debug', 'info', 'warning' (default), 'error' or 'off'.
    """
__version__: str = '0.1.0'
