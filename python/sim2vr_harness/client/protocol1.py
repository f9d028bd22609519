"""Speak protocol 1 of SIM2VR's Unity asset: one JSON message per request.

docs/reference/protocol.md is the specification.

A Unity app is sent the reference's fields only. Our own server announces itself in its handshake
reply; then the fields that it understands beyond the reference's give a round the same bits as in
process: seed and options at a reset, exact times, all frames of a step, saved states and views.
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from sim2vr_harness.client.base import (
    AppReply,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
    numbers_of_log,
)
from sim2vr_harness.client.channel import Channel, checked_duration_s
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import AppError, AppRefused, AppUnsupported, ProtocolError
from sim2vr_harness.client.poses import (
    check_finite,
    frame_times,
    one_frame,
    pose_rows,
    require_devices,
)
from sim2vr_harness.client.scene import AppScene

__all__ = ["Protocol1App", "decode_reply"]

QUIT_S = 2.0
"""How long an app may take to acknowledge the end of the session."""

_CAPABILITIES = frozenset({"left_controller"})
"""Of an app that knows the reference's fields only."""
_OUR_CAPABILITIES = _CAPABILITIES | {"save", "views", "frames", "head_request"}
_IMAGE = re.compile(rb'"image"\s*:\s*\[')
_NAMES = (
    ("headsetPosition", "headsetRotation"),
    ("leftControllerPosition", "leftControllerRotation"),
    ("rightControllerPosition", "rightControllerRotation"),
)


class Protocol1App:
    """:class:`~sim2vr_harness.client.base.AppClient` over protocol 1.

    Makes the handshake, hence waits for an app that is still starting.

    With an app that knows the reference's fields only, rounds follow the reference: the app draws
    its own seeds, its clock runs on over all rounds, the reply to a reset carries an image and the
    time feature only, and of a step's frames the last one is shown. Its options are those it was
    started with.

    Args:
        channel: to the app; owned by this object from now on, its process too.
        width: of the app's image, pixels.
        height: of the app's image, pixels.
        frequency_hz: user steps per second.
        fixed_delta_time_s: the app's fixed step.
        time_scale: how many times faster than real time a Unity app may run at most.
        options: what the app was started with.
        start_timeout_s: how long the app may take to start.

    Raises:
        AppRefused: the app does not take the handshake.
        AppTimeout, AppDied, ProtocolError: there is no such app.
        ValueError: ``start_timeout_s`` is no time to wait.
    """

    def __init__(
        self,
        channel: Channel,
        *,
        width: int = 120,
        height: int = 80,
        frequency_hz: int = 20,
        fixed_delta_time_s: float = 0.002,
        time_scale: int = 5,
        options: Mapping[str, OptionValue] | None = None,
        start_timeout_s: float = 60.0,
    ) -> None:
        self._channel = channel
        self._shape = (height, width, 4)
        self._frequency_hz = frequency_hz
        self._options = dict(options or {})
        self._image: UInt8Array = np.zeros(self._shape, dtype=np.uint8)
        self._clock_s = 0.0  # of the last message, for apps of the reference
        self._round_s = 0.0  # where on that clock the round began
        self._doing = ""
        self._ending = False
        self._in_round = False
        try:
            checked_duration_s("start_timeout_s", start_timeout_s)
            reply = self._handshake(fixed_delta_time_s, time_scale, start_timeout_s)
        except BaseException:
            self._abandon()
            raise
        self.server: str | None = reply.get("server")
        """Name and version of our own server; None for an app of the reference."""

    def _handshake(
        self, fixed_delta_time_s: float, time_scale: int, timeout_s: float
    ) -> dict[str, Any]:
        message = {
            "timestep": fixed_delta_time_s,
            "sampleFrequency": self._frequency_hz,
            "timeScale": time_scale,
            # For our own server; a Unity app skips what it does not know.
            "frameTime": "current",
            "clock": "round",
            "headRotation": "device",
        }
        self._send(message, "the handshake")
        reply, _ = self._receive(timeout_s)
        return reply

    # --- what the app is ---------------------------------------------------------------------

    @property
    def renderer_description(self) -> str:
        """See :class:`AppClient`."""
        return f"{self._channel.app} (protocol 1)"

    @property
    def capabilities(self) -> frozenset[str]:
        """See :class:`AppClient`; in an app of the reference a left controller, and that is all.

        Such an app turns the head itself.
        """
        return _OUR_CAPABILITIES if self._is_ours else _CAPABILITIES

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        """See :class:`AppClient`."""
        wanted = {"seed": seed, "options": dict(options or {})}
        reply = self._extra("head_request", "the head's pitch", {"headRequest": wanted})
        pitch_deg = self._field(reply, "headRequest", dict).get("pitch_deg")
        return None if pitch_deg is None else float(pitch_deg)

    @property
    def _is_ours(self) -> bool:
        """Whether the app is our own server, with its extensions of the protocol."""
        return self.server is not None

    @property
    def image(self) -> UInt8Array:
        """See :class:`AppClient`; here every frame has an array of its own, read-only."""
        return self._image

    # --- rounds ------------------------------------------------------------------------------

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """See :class:`AppClient`.

        An app of the reference draws its own seed. Options that differ from those it was started
        with are refused.
        """
        if not 0 <= seed < 2**32:
            raise ValueError(f"seed: got {seed}, expected an integer from 0 to 2**32 - 1")
        require_devices(poses, self.capabilities, self._channel.app)
        rows = pose_rows(poses)
        if self._is_ours:
            state = self._state(time_ns, rows[-1]) | {"seed": seed, "options": dict(options or {})}
        else:
            self._require_same_options(options or {})
            self._round_s = self._clock_s
            state = self._reference_state(0.0, rows[-1])
        state["reset"] = True
        self._send(state, "a reset")
        reply = self._finish()
        self._in_round = True
        # The reference drops these two of a reset's reply: a round begins with nothing earned.
        return reply if self._is_ours else AppReply(0.0, False, reply.time_feature, reply.log)

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        """See :class:`AppClient`."""
        self.start_step(np.array([time_ns], dtype=np.int64), one_frame(poses))
        return self.finish_step()

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1) -> AppReply:
        """See :class:`AppClient`; the last frame is drawn, and no other can be."""
        self.start_step(times_ns, poses, drawn)
        return self.finish_step()

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """See :class:`AppClient`; sends the message."""
        times = frame_times(times_ns)
        if drawn not in (-1, len(times) - 1):
            raise AppUnsupported(
                f"frames: {self._channel.app} draws the last frame of a step, got drawn={drawn}"
            )
        require_devices(poses, self.capabilities, self._channel.app)
        self._start(times, pose_rows(poses, len(times)), last)

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`; waits for the reply."""
        if self._channel.usable:
            raise AppError("finish_step: no step was started; call start_step first")
        ending = self._ending
        reply = self._finish()
        if not ending:
            return reply
        if not reply.finished:
            raise self._channel.give_up(
                ProtocolError(
                    f"{self._channel.app} was told that the round is over (isFinished), and its "
                    "reply does not say so"
                )
            )
        # Whether the game would have ended it as well cannot be known.
        return AppReply(reply.reward, False, reply.time_feature, reply.log)

    def _start(self, times: Int64Array, rows: NDArray[np.float64], last: bool) -> None:
        if not self._in_round and not self._is_ours:
            raise AppError("step: no round was started; call reset first")
        if not self._is_ours:
            state = self._reference_state(int(times[-1]) * 1e-9, rows[-1])
            state["isFinished"] = self._ending = last
        else:
            state = self._state(int(times[-1]), rows[-1])
            if len(times) > 1:
                check_finite(rows)
                state["frames"] = [
                    {"time_ns": int(time), **_pose_fields(row)}
                    for time, row in zip(times, rows, strict=True)
                ]
        self._send(state, "a step")

    def _state(self, time_ns: int, row: NDArray[np.float64]) -> dict[str, Any]:
        """The message to our own server; it takes the exact time."""
        return self._message(time_ns * 1e-9, row) | {"timeNs": time_ns}

    def _reference_state(self, seconds: float, row: NDArray[np.float64]) -> dict[str, Any]:
        """The message to an app whose clock is never reset: the reference's fields only."""
        self._clock_s = self._round_s + _on_grid(seconds, self._frequency_hz)
        return self._message(self._clock_s, row)

    def _message(self, seconds: float, row: NDArray[np.float64]) -> dict[str, Any]:
        check_finite(row[None])
        return {
            **_pose_fields(row),
            "currentTimestep": seconds,
            "nextTimestep": seconds + 1.0 / self._frequency_hz,
            "reset": False,
            "isFinished": False,
            "quitApplication": False,
        }

    def _require_same_options(self, options: Mapping[str, OptionValue]) -> None:
        for name, value in options.items():
            if name not in self._options or self._options[name] != value:
                raise AppRefused(
                    f"option {name}: got {value!r}, but {self._channel.app} takes its options at "
                    f"its start only, expected {self._options.get(name, 'none')!r}"
                )

    # --- state and views ---------------------------------------------------------------------

    def scene(self) -> AppScene:
        """See :class:`AppClient`; this protocol has no word for it."""
        raise AppUnsupported(
            f"scene: {self._channel.app} speaks protocol 1, which has no word for its scene; "
            "protocol 2 has"
        )

    def save(self) -> bytes:
        """See :class:`AppClient`."""
        reply = self._extra("save", "saving", {"save": True})
        return base64.b64decode(self._field(reply, "state", str))

    def load(self, state: bytes) -> None:
        """See :class:`AppClient`."""
        reply = self._extra(
            "save", "loading", {"load": base64.b64encode(state).decode()}, image=True
        )
        self._image = self._decoded(reply["image"])

    def state_hash(self) -> int:
        """See :class:`AppClient`."""
        reply = self._extra("save", "the hash", {"stateHash": True})
        return int(self._field(reply, "stateHash", str), 16)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        """See :class:`AppClient`; an app of the reference has its own size only."""
        if not self._is_ours and (height, width, 4) == self._shape:
            return self._image.copy()
        return self._render("headset", width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        """See :class:`AppClient`."""
        return self._render(view, width, height)

    def _render(self, view: str, width: int, height: int) -> UInt8Array:
        wanted = {"view": view, "width": width, "height": height}
        reply = self._extra("views", "drawing", {"render": wanted})
        png = bytes(self._field(reply, "render", list))
        return self._checked(_decode_png(png), (height, width, 4))

    def _extra(
        self, capability: str, doing: str, fields: dict[str, Any], image: bool = False
    ) -> dict[str, Any]:
        if capability not in self.capabilities:
            raise AppUnsupported(
                f"{capability}: {self._channel.app} speaks the reference's protocol, which has no "
                f"word for {doing}; sim2vr-app can do it"
            )
        self._send(fields, doing)
        reply, png = self._receive()
        return reply | ({"image": png} if image else {})

    def _field(self, reply: dict[str, Any], name: str, kind: type) -> Any:
        value = reply.get(name)
        if not isinstance(value, kind):
            raise self._malformed(f"{name}: got {type(value).__name__}, expected {kind.__name__}")
        return value

    # --- messages ----------------------------------------------------------------------------

    def _send(self, message: Mapping[str, Any], doing: str) -> None:
        self._doing = doing
        self._channel.send([json.dumps(message, separators=(",", ":")).encode()], doing)

    def _receive(self, timeout_s: float | None = None) -> tuple[dict[str, Any], bytes]:
        """The reply without its image, and the image's PNG bytes; raises the app's errors."""
        frames = self._channel.receive(self._doing, timeout_s)
        if len(frames) != 1:
            raise self._malformed(f"got {len(frames)} message parts, expected 1")
        try:
            reply, png = decode_reply(frames[0])
        except ValueError as error:
            raise self._malformed(str(error)) from error
        if "error" in reply:
            raise _app_error(reply["error"])
        return reply, png

    def _finish(self) -> AppReply:
        self._ending = False
        reply, png = self._receive()
        try:
            result = AppReply(
                reward=float(reply["reward"]),
                finished=bool(reply["isFinished"]),
                time_feature=float(reply["timeFeature"]),
                log=_log(reply.get("logDict", "{}")),
            )
            if not (math.isfinite(result.reward) and math.isfinite(result.time_feature)):
                raise ValueError("a reward or time feature that is not finite")
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise self._malformed(f"{type(error).__name__}: {error}") from error
        self._image = self._decoded(png)
        self._in_round = not result.finished
        return result

    def _decoded(self, png: bytes) -> UInt8Array:
        try:
            image = _decode_png(png)
        except ValueError as error:
            raise self._malformed(str(error)) from error
        return self._checked(image, self._shape)

    def _checked(self, image: UInt8Array, shape: tuple[int, int, int]) -> UInt8Array:
        if image.shape != shape:
            raise AppRefused(
                f"vision.width, vision.height: got {shape[1]} x {shape[0]}, but "
                f"{self._channel.app} sends images of {image.shape[1]} x {image.shape[0]}, "
                f"expected the app's size (doctor: --size {image.shape[1]}x{image.shape[0]})"
            )
        return image

    def _malformed(self, what: str) -> Exception:
        return self._channel.give_up(
            ProtocolError(f"{self._channel.app} answered {self._doing} with another thing: {what}")
        )

    # --- the end -----------------------------------------------------------------------------

    def close(self) -> None:
        """See :class:`AppClient`; tells the app to quit and ends the process it came from."""
        if self._channel.usable:
            with suppress(AppError):
                self._channel.request([b'{"quitApplication":true}'], "the end", QUIT_S)
            self._channel.close()
            if self._channel.process is not None:
                self._channel.process.stop()
        self._abandon()

    def _abandon(self) -> None:
        self._channel.close()
        if self._channel.process is not None:
            self._channel.process.kill()

    def __enter__(self) -> Protocol1App:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _pose_fields(row: NDArray[np.float64]) -> dict[str, dict[str, float]]:
    fields = {}
    for (position, rotation), values in zip(_NAMES, row.tolist(), strict=True):
        x, y, z, qx, qy, qz, qw = values
        if position == _NAMES[1][0] and not any(values):
            qw = 1.0  # how the reference says that there is no left controller
        fields[position] = {"x": x, "y": y, "z": z}
        fields[rotation] = {"x": qx, "y": qy, "z": qz, "w": qw}
    return fields


def _on_grid(seconds: float, frequency_hz: int) -> float:
    """The time in whole periods where it is one to a microsecond, as the reference sends it."""
    periods = round(seconds * frequency_hz)
    return periods / frequency_hz if abs(seconds * frequency_hz - periods) < 1e-6 else seconds


def _log(text: Any) -> dict[str, float]:
    """The game's named numbers out of logDict, a string that holds a JSON object."""
    found = (json.loads(text) if text else None) or {}
    values = [math.nan if value is None else float(value) for value in found.values()]
    return numbers_of_log(list(found), values)


def _app_error(error: Any) -> Exception:
    code, message = "", str(error)
    if isinstance(error, dict):
        code, message = str(error.get("code", "")), str(error.get("message", ""))
    return AppRefused(message) if code == "invalid_argument" else AppError(message)


def decode_reply(text: bytes) -> tuple[dict[str, Any], bytes]:
    """Splits a reply into its fields without ``image``, and the bytes of the image.

    The image is an array of some thousand decimal numbers; reading it apart from the rest takes a
    third of the time that a JSON parser needs.

    Raises:
        ValueError: no JSON object, or an image that is no array of bytes.
    """
    match = _IMAGE.search(text)
    image = b""
    if match is not None:
        end = text.find(b"]", match.end())
        numbers = _byte_list(text[match.end() : end]) if end >= 0 else None
        if numbers is not None:
            image, text = numbers, text[: match.end()] + text[end:]
    try:
        reply = json.loads(text)
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ValueError(f"{error} in {text[:60]!r}") from error
    if not isinstance(reply, dict):
        raise ValueError(f"got {type(reply).__name__}, expected a JSON object")
    rest = reply.pop("image", None)
    if rest:
        try:
            image = bytes(rest)
        except (TypeError, ValueError) as error:
            raise ValueError(f"image: {error}, expected an array of bytes") from error
    return reply, image


def _byte_list(text: bytes) -> bytes | None:
    """``b"137,80,7"`` as the three bytes; None if it is anything else."""
    codes = np.frombuffer(text, dtype=np.uint8)
    if len(codes) == 0:
        return b""
    commas = codes == ord(",")
    digits = codes - np.uint8(ord("0"))
    if not (commas | (digits <= 9)).all():
        return None
    ends = np.append(np.flatnonzero(commas), len(codes))
    lengths = np.diff(ends, prepend=-1) - 1
    if lengths.min() < 1 or lengths.max() > 3:
        return None
    values = digits[ends - 1].astype(np.uint16)
    for place, factor in ((2, 10), (3, 100)):
        longer = np.flatnonzero(lengths >= place)
        values[longer] += factor * digits[ends[longer] - place].astype(np.uint16)
    return values.astype(np.uint8).tobytes() if values.max() <= 255 else None


def _decode_png(png: bytes) -> UInt8Array:
    """(H, W, 4) RGBA of a PNG file's bytes; ValueError for anything else."""
    try:
        with Image.open(io.BytesIO(png), formats=["PNG"]) as picture:
            if picture.mode != "RGBA":
                raise ValueError(f"image: got a PNG of mode {picture.mode}, expected RGBA")
            return np.asarray(picture)
    except (
        UnidentifiedImageError,
        Image.DecompressionBombError,
        Image.DecompressionBombWarning,
        OSError,
        SyntaxError,
    ) as error:
        raise ValueError(f"image: got {len(png)} bytes ({error}), expected a PNG file") from error
