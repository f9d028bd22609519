"""Interface of VR apps, whatever the transport."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.paths import uri_unless_utf8
from sim2vr_harness.client.devices import (
    DevicePoses,
    Float64Array,
    HapticPulse,
    Int64Array,
    SoundEvent,
)
from sim2vr_harness.client.errors import AppUnsupported
from sim2vr_harness.client.poses import one_frame
from sim2vr_harness.client.scene import AppScene, Observed, Observer

__all__ = [
    "CAPABILITIES",
    "AppClient",
    "AppReply",
    "AppValue",
    "ClockSettings",
    "DevicePoses",
    "Float32Array",
    "Float64Array",
    "HapticPulse",
    "Int64Array",
    "OptionValue",
    "SoundEvent",
    "ThirdPersonView",
    "UInt8Array",
    "plain_options",
]

OptionValue = bool | int | float | str | list[float]
AppValue = bool | int | float | tuple[float, float, float] | None
"""Of an app's expression: a number, a truth, or a place x y z, metres, in the app's frame."""
UInt8Array = NDArray[np.uint8]
Float32Array = NDArray[np.float32]

ThirdPersonView = Literal["recorder", "spectator"]


@dataclass(frozen=True)
class ClockSettings:
    """The app's clock."""

    fixed_delta_time_s: float = 0.002
    """Period of the fixed steps (game physics), used as the nearest binary32, as in Unity."""
    maximum_delta_time_s: float = 1.0 / 3.0
    """A longer frame advances the game by this much only."""
    fixed_step_tolerance_s: float = 0.0
    """A fixed step belongs to the first frame at or after it, give or take this; rounded frame
    times of a recording need 1e-5."""


@dataclass(frozen=True)
class AppReply:
    """The app's answer to one frame."""

    reward: float
    finished: bool
    time_feature: float
    """Game-defined, Whac-A-Mole: 2 * elapsed / round length - 1."""
    log: dict[str, float]
    """Named numbers of the round so far and of this step, without those that the round has not."""
    haptics: tuple[HapticPulse, ...] = ()
    """Vibrations that the frames of this step or reset requested, in order."""
    sounds: tuple[SoundEvent, ...] = ()
    """Sounds that began in them, in order."""
    values: Mapping[str, AppValue] = field(default_factory=dict)
    """Values of the expressions of :attr:`AppsWanted.values` after the step."""
    left: str = ""
    """Name and action of the app if it ended VR by itself, and with it the round; "": it did
    not."""


def plain_options(options: Mapping[str, OptionValue] | None) -> dict[str, OptionValue]:
    """Return a game's options as JSON can hold them, with paths that are not UTF-8 as URIs."""
    return {
        name: uri_unless_utf8(value) if isinstance(value, str) else value
        for name, value in (options or {}).items()
    }


def numbers_of_log(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    """Return an app's named numbers, without those that are not finite.

    NaN stands for one that the round does not have.

    Raises:
        ValueError: not as many values as names.
    """
    return {name: value for name, value in zip(names, values, strict=True) if math.isfinite(value)}


CAPABILITIES: dict[str, str] = {
    "save": "save, load and state_hash",
    "views": "pictures of the last frame in any size, from outside too",
    "frames": "several frames in a step, of which any one is drawn",
    "inputs": "triggers, thumbsticks and buttons of the controllers",
    "left_controller": "a left controller",
    "haptics": "vibrations of the controllers come back",
    "sounds": "sounds come back",
    "head_request": "says before a round how the head shall be held",
    "two_eyes": "a picture for each eye",
    "privileged": "numbers behind the picture, for teachers",
    "scene": "the scene's objects: where they are, their shapes and colours",
    "observers": "draws further views in the steps to come, with their depth",
    "fovea": "a second, narrow picture around the gaze, with its depth in metres",
}
"""Capabilities that an app may have, with their meaning; see :attr:`AppClient.capabilities`."""


class AppClient(ABC):
    """One app in lockstep: it moves only when told to.

    What only apps of some kinds can do refuses by itself: a client says what it is
    (:attr:`kind`) and writes the methods of its :attr:`capabilities`.
    """

    kind = "the app"
    """Name of the app's kind in errors."""
    gaze: Float32Array = np.zeros(2, np.float32)
    """(2,) middle of :attr:`fovea` in the next drawn frame, right and up, m at a depth of 1 m."""
    _observers: tuple[Observer, ...] = ()

    @property
    @abstractmethod
    def renderer_description(self) -> str:
        """The GL renderer in use, for example ``EGL surfaceless: llvmpipe ...``."""

    @property
    @abstractmethod
    def image(self) -> UInt8Array:
        """Headset image of the drawn frame, (H, W, 4) RGBA; alpha is linear depth / far plane.

        With two eyes (2, H, W, 4): left, right. A view of the app's buffer: overwritten by the next
        reset or step, so copy what must last.
        """

    @property
    def fovea(self) -> tuple[UInt8Array, Float32Array]:
        """Picture around the gaze, (h, w, 4) RGBA, and its depth, (h, w) m, of the drawn frame."""
        raise self._without("fovea")

    @abstractmethod
    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """Starts a round and runs its first frame.

        Args:
            seed: 32-bit seed; the round is a function of it and the input alone.
            poses: device poses at the start.
            options: game options of this and later rounds, on top of those given before.
            time_ns: game time of the first frame; not 0 where a recording's clock is kept.

        Raises:
            ValueError: names the option or pose that cannot be used, got and expected.
        """

    def play(
        self,
        seed: int,
        frames: Iterable[tuple[int, DevicePoses]],
        options: Mapping[str, OptionValue] | None = None,
    ) -> Iterator[AppReply]:
        """Play a round without a body: start it, and run frames until their end or the round's.

        Args:
            seed: of the round.
            frames: game time, ns, and devices of each frame; taken as they are needed.
            options: as of :meth:`reset`.

        Yields:
            The app's reply to every frame.
        """
        for number, (time_ns, poses) in enumerate(frames):
            if number == 0:
                reply = self.reset(seed, poses, options, time_ns=time_ns)
            else:
                reply = self.step(time_ns, poses)
            yield reply
            if reply.finished:
                return

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        """Runs one frame at game time ``time_ns`` and renders it.

        Raises:
            ValueError: a pose is not finite, a rotation not normalised, the time runs backwards.
            RuntimeError: no round was started or the app is closed.
        """
        return self.step_frames(np.array([time_ns], dtype=np.int64), one_frame(poses))

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1) -> AppReply:
        """One user step of K frames, of which one is drawn.

        The reward is the frames' sum; when the round ends before the last frame, the rest are
        not run. Which frame is drawn changes nothing but :attr:`image`.

        Args:
            times_ns: (K,) int64 game times, ascending.
            poses: of K frames, (K, ...).
            drawn: 0 to K - 1, or -1 for the last frame.

        Raises:
            ValueError, RuntimeError: as :meth:`step`; then no frame was run.
        """
        self.start_step(times_ns, poses, drawn)
        return self.finish_step()

    @abstractmethod
    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """First half of :meth:`step_frames`, so that several apps can work at the same time.

        An app in this process runs the frames here; one outside is sent them. Apps that share a
        connection are sent theirs together, as soon as each of them has its own.

        Args:
            times_ns: (K,) int64 game times, ascending.
            poses: of K frames, (K, ...).
            drawn: as in :meth:`step_frames`.
            last: the user ends the round after this step (a time limit); an app of the reference
                is informed, for the others the next reset says it.

        Raises:
            ValueError, RuntimeError: as :meth:`step`, here or in :meth:`finish_step`.
        """

    @abstractmethod
    def finish_step(self) -> AppReply:
        """Second half: the reply to :meth:`start_step`; then :attr:`image` is the new one."""

    @property
    @abstractmethod
    def capabilities(self) -> frozenset[str]:
        """Names of :data:`CAPABILITIES` that the app has.

        What needs one that is missing raises AppUnsupported, which names it.
        """

    def require(self, capability: str) -> None:
        """Raise AppUnsupported unless the app has it, one of :data:`CAPABILITIES`."""
        if capability not in self.capabilities:
            raise self._without(capability)

    def _without(self, capability: str) -> AppUnsupported:
        return AppUnsupported(
            f"{capability}: {self.kind} does not have this capability ({CAPABILITIES[capability]})"
        )

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        """The head's pitch, degrees up, that the app wishes for in a round; None: no wish.

        Starts and moves nothing: it is asked before :meth:`reset`, so that the user's body can
        answer with the poses given there.

        Args:
            seed: of the round that would begin.
            options: as in :meth:`reset`.

        Raises:
            ValueError: an option that cannot be used.
        """
        return None

    def render_headset(self, width: int, height: int) -> UInt8Array:
        """The headset view of the last frame at another size, (height, width, 4) RGBA.

        From between the eyes, however many the app was made with.
        """
        if self.image.shape == (height, width, 4):
            return self.image.copy()
        raise self._without("views")

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        """A third-person view of the last frame, (height, width, 4) RGBA."""
        raise self._without("views")

    def scene(self) -> AppScene:
        """Return the objects and meshes of the last frame's scene, app frame.

        Raises:
            RuntimeError: no round was started.
        """
        raise self._without("scene")

    def observe(self, observers: Sequence[Observer]) -> None:
        """Draw these views as well, at the latest from the next step on; none: only the user's."""
        self.require("observers")
        self._observers = tuple(observers)

    def observed(self) -> tuple[Observed, ...]:
        """Return the observers' pictures of the last frame; empty if the app drew none."""
        self.require("observers")
        found = []
        for one in self._observers:
            if one.pose is None:
                found.append(Observed(self.render_headset(one.width, one.height)[..., :3], None))
                continue
            rgba, depth_m = self._render_from(one)
            # The renderer's limit is the same as nothing.
            nothing = rgba[..., 3] == 255
            found.append(Observed(rgba[..., :3], np.where(nothing, np.inf, depth_m)))
        return tuple(found)

    def _render_from(self, observer: Observer) -> tuple[UInt8Array, Float32Array]:
        """Return the last frame from elsewhere, (h, w, 4) with depth as alpha, and depths, m."""
        raise self._without("observers")

    def save(self) -> bytes:
        """The whole app state, mid-round included."""
        raise self._without("save")

    def load(self, state: bytes) -> None:
        """Continues from :meth:`save` of an app with the same game and options.

        Raises:
            RuntimeError: the bytes are damaged or belong to another game or version.
        """
        raise self._without("save")

    def state_hash(self) -> int:
        """64-bit hash of the state; equal states have equal hashes."""
        raise self._without("save")

    @abstractmethod
    def close(self) -> None:
        """Ends the app; idempotent. Later calls raise RuntimeError."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
