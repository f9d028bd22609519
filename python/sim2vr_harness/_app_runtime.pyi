"""
The sim2vr app runtime: headless VR apps in lockstep, in this process.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import os
import typing
__all__: list[str] = ['AppBatch', 'EngineError', 'FileError', 'InvalidArgument', 'RenderError', 'StateError', 'Unsupported', 'frame_time_ns', 'game_facts', 'game_options', 'game_timeline', 'gl_renderer', 'list_games', 'load_game_library', 'set_log_level']
class FileError(RuntimeError):
    pass
class EngineError(RuntimeError):
    pass
class StateError(EngineError):
    pass
class Unsupported(EngineError):
    pass
class RenderError(EngineError):
    pass
class InvalidArgument(ValueError):
    pass
class AppBatch:
    """
    N apps of one game, stepped together on threads; one app is a batch of one. Poses are float64 rows of 7: position x y z (m), rotation x y z w, app frame (left-handed, y up, z forward); inputs of a controller are rows of 13 (client/devices.py). M apps are chosen by their indices. Arrays of results are read-only views without copies: calls overwrite the rows of the apps they move; they stay valid memory after close(). The GIL is released while the apps work; one AppBatch must not be used from two threads at once, different ones may.
    """
    def __init__(self, *, game: str, options: str = '{}', apps: typing.SupportsInt | typing.SupportsIndex = 1, threads: typing.SupportsInt | typing.SupportsIndex = 1, width: typing.SupportsInt | typing.SupportsIndex = 120, height: typing.SupportsInt | typing.SupportsIndex = 80, eyes: typing.SupportsInt | typing.SupportsIndex = 1, ipd_m: typing.SupportsFloat | typing.SupportsIndex = 0.06400000303983688, renderer: str = 'automatic', share_renderer: bool = False, log_dirs: collections.abc.Sequence[str] = [], fixed_delta_time_s: typing.SupportsFloat | typing.SupportsIndex = 0.002, maximum_delta_time_s: typing.SupportsFloat | typing.SupportsIndex = 0.3333333333333333, fixed_step_tolerance_s: typing.SupportsFloat | typing.SupportsIndex = 0.0, vision_channels: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex] = [], fovea_width: typing.SupportsInt | typing.SupportsIndex = 0, fovea_height: typing.SupportsInt | typing.SupportsIndex = 0, fovea_pixel_m: typing.SupportsFloat | typing.SupportsIndex = 0.0) -> None:
        """
        options: JSON object. share_renderer: the first thread draws with the renderer that the process shares. log_dirs: root of each app's episode logs; [] for no logs. The times are those of TimeSettings in core/clock.hpp. vision_channels: what `vision` holds, 0 red, 1 green, 2 blue, 3 depth. fovea_*: size in pixels of `fovea`, 0: none, and width of a pixel at a depth of 1 m.
        """
    def close(self) -> None:
        """
        Frees the apps; later calls raise StateError.
        """
    def haptics(self, app: typing.SupportsInt | typing.SupportsIndex) -> list[tuple[str, float, float, int]]:
        """
        The pulses of one app: (hand, amplitude, frequency in Hz, duration in ns).
        """
    def head_requests(self, indices: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], seeds: typing.Annotated[numpy.typing.ArrayLike, numpy.uint32], options: str) -> numpy.typing.NDArray[numpy.float64]:
        """
        (M,) float64 pitch of the head, degrees up, that the rounds of these seeds wish for; NaN: no wish.
        """
    def load(self, app: typing.SupportsInt | typing.SupportsIndex, state: bytes) -> None:
        """
        Goes on from saved bytes; EngineError for damaged or foreign ones. The app's rows of images, vision, privileged and logs are its own again.
        """
    def render_from(self, app: typing.SupportsInt | typing.SupportsIndex, pose: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(7)"], vertical_fov_deg: typing.SupportsFloat | typing.SupportsIndex, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> tuple:
        """
        An app's last frame from a pose x y z, x y z w of its frame, without what stands for the player: (height, width, 4) uint8, and (height, width) float32 depth in m.
        """
    def render_view(self, app: typing.SupportsInt | typing.SupportsIndex, view: str, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.uint8]:
        """
        An app's last frame from 'headset', 'recorder' or 'spectator', (height, width, 4) uint8.
        """
    def reset(self, indices: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], seeds: typing.Annotated[numpy.typing.ArrayLike, numpy.uint32], options: str, head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, left_inputs: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_inputs: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, time_ns: typing.SupportsInt | typing.SupportsIndex = 0) -> None:
        """
        Starts rounds at time_ns: indices (M,), seeds (M,), poses (M, 7), inputs (M, 13). Errors name the first app that refused; the others have started.
        """
    def save(self, app: typing.SupportsInt | typing.SupportsIndex) -> bytes:
        """
        The whole state of one app as bytes, mid-round included.
        """
    def shown(self, app: typing.SupportsInt | typing.SupportsIndex) -> tuple[list[str], numpy.typing.NDArray[numpy.uint64], numpy.typing.NDArray[numpy.int32], numpy.typing.NDArray[numpy.int32], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.bool]]:
        """
        What an app's last frame holds and shows, K rows: paths, objects (K,), layers (K,), meshes (K,) with -1 for none, poses (K, 7), scales (K, 3), colours (K, 4) sRGB and alpha, unlit (K,).
        """
    def shown_mesh(self, app: typing.SupportsInt | typing.SupportsIndex, mesh: typing.SupportsInt | typing.SupportsIndex) -> tuple[str, numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint32]]:
        """
        A mesh that `shown` numbered: name, vertices (V, 3), triangles (T, 3), whose fronts are clockwise in the app's left-handed frame.
        """
    def sounds(self, app: typing.SupportsInt | typing.SupportsIndex) -> list[tuple[str, typing.Annotated[list[float], "FixedSize(3)"], float]]:
        """
        The sounds of one app: (name, position in m, gain).
        """
    def state_hash(self, app: typing.SupportsInt | typing.SupportsIndex) -> int:
        """
        64-bit hash of what save() would return.
        """
    def step(self, indices: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], times_ns: typing.Annotated[numpy.typing.ArrayLike, numpy.int64], head: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], left_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_controller: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, left_inputs: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, right_inputs: typing.Annotated[numpy.typing.ArrayLike, numpy.float64] | None = None, drawn: typing.SupportsInt | typing.SupportsIndex = -1) -> None:
        """
        One user step of K frames, of which `drawn` (-1: the last) is drawn: indices (M,), times_ns (M, K), poses (M, K, 7), inputs (M, K, 13). Errors as in reset.
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
    def fovea(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (N, height, width, 4) uint8 like images: windows around the gaze.
        """
    @property
    def fovea_depth(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (N, height, width) float32: depths of fovea, m.
        """
    @property
    def gaze(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (N, 2) float32, writable: middles of the next windows, right and up, m at a depth of 1 m.
        """
    @property
    def haptic_counts(self) -> numpy.typing.NDArray[numpy.int32]:
        """
        (N,) int32: haptic pulses of the last step or reset.
        """
    @property
    def images(self) -> numpy.typing.NDArray[numpy.uint8]:
        """
        (N, height, width, 4) uint8 RGBA headset images, row 0 = top, alpha = linear depth / far plane; with two eyes (N, 2, height, width, 4).
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
    def privileged_drawn(self) -> numpy.typing.NDArray[numpy.float32]:
        """
        (N, len(privileged_names)) float32 after the frame that is drawn.
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
    def sound_counts(self) -> numpy.typing.NDArray[numpy.int32]:
        """
        (N,) int32: sounds of the last step or reset.
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
        (N, eyes * channels, height, width) uint8: the vision_channels of images.
        """
def frame_time_ns(frame: typing.Annotated[numpy.typing.ArrayLike, numpy.int64], frame_rate_hz: typing.Annotated[numpy.typing.ArrayLike, numpy.int32]) -> typing.Any:
    """
    Times of frames in lockstep, ns: n times the largest binary32 below the period.
    """
def game_facts(name: str) -> str:
    """
    What a game publishes, as a JSON object: measures, conditions.
    """
def game_options(name: str) -> str:
    """
    A game's options as a JSON array: name, type, default, range.
    """
def game_timeline(name: str, options: str, seed: typing.SupportsInt | typing.SupportsIndex) -> str:
    """
    What comes when in a round of these options (a JSON object), as a JSON object.
    """
def gl_renderer(kind: str = 'automatic') -> str:
    """
    Starts a renderer ('automatic', 'egl', 'osmesa', 'null') and returns its description. RenderError says what was tried.
    """
def list_games() -> dict[str, str]:
    """
    Names of the games with their descriptions.
    """
def load_game_library(file: os.PathLike | str | bytes) -> list[str]:
    """
    Opens a shared library and adds its games; returns their names. Opening runs its code.
    """
def set_log_level(level: str) -> None:
    """
    'trace', 'debug', 'info', 'warning' (default), 'error' or 'off'.
    """
__version__: str = '0.3.0'
