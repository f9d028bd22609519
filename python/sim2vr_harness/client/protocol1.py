"""Speak protocol 1 of SIM2VR's Unity asset: one JSON message per request.

docs/reference/protocol.md is the specification.

A Unity app is sent the reference's fields only. Our own server announces itself in its handshake
reply; then the fields that it understands beyond the reference's give a round the same bits as in
process: seed and options at a reset, exact times, all frames of a step, saved states and views.
"""

import base64
import io
import json
import math
import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import BaseModel, BeforeValidator, StrictBool, StrictStr, TypeAdapter

from sim2vr_harness.client.answers import (
    OBJECT,
    PITCH,
    BadReply,
    Binary32,
    bad_reply,
    checked,
    read,
)
from sim2vr_harness.client.base import (
    AppClient,
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
from sim2vr_harness.client.poses import check_finite, frame_times, pose_rows, require_devices
from sim2vr_harness.client.runtime import checked_seed

_CAPABILITIES = frozenset({"left_controller"})
"""Of an app that knows the reference's fields only."""
_OUR_CAPABILITIES = _CAPABILITIES | {"save", "views", "frames", "head_request"}


class Protocol1App(AppClient):
    """:class:`~sim2vr_harness.client.base.AppClient` over protocol 1.

    Makes the handshake, hence waits for an app that is still starting.

    With an app that knows the reference's fields only, rounds follow the reference: the app draws
    its own seeds, its clock runs on over all rounds, the reply to a reset carries an image and the
    time feature only, and of a step's frames the last one is shown. Its options are those it was
    started with.

    Args:
        channel: to the app; owned by this object from now on, its process too.
        width, height: of the app's image, pixels.
        frequency_hz: user steps per second.
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
        self.kind = f"{channel.app}, over protocol 1,"
        self._shape = (height, width, 4)
        self._frequency_hz = frequency_hz
        self._options = dict(options or {})
        self._image: UInt8Array = np.zeros(self._shape, dtype=np.uint8)
        self._seen = False  # whether the app has sent a picture of that size
        self._clock_s = 0.0  # of the last message, for apps of the reference
        self._round_s = 0.0  # where on that clock the round began
        self._doing = ""
        self._ending = False
        self._in_round = False
        try:
            checked_duration_s("start_timeout_s", start_timeout_s)
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
            reply, _ = self._receive(start_timeout_s)
        except BaseException:
            channel.abandon()
            raise
        self.server: str | None = reply.get("server")
        """Name and version of our own server; None for an app of the reference."""

    # --- what the app is ---------------------------------------------------------------------

    @property
    def renderer_description(self) -> str:
        return f"{self._channel.app} (protocol 1)"

    @property
    def capabilities(self) -> frozenset[str]:
        """Capabilities of the app; an app of the reference has only a left controller.

        An app of the reference turns the head itself.
        """
        return _OUR_CAPABILITIES if self._is_ours else _CAPABILITIES

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        wanted = {"seed": seed, "options": dict(options or {})}
        reply = self._extra("head_request", "the head's pitch", {"headRequest": wanted})
        with self._checking():
            return checked("headRequest", PITCH, reply.get("headRequest")).pitch_deg

    @property
    def _is_ours(self) -> bool:
        """True if the app is our own server, with its extensions of the protocol."""
        return self.server is not None

    @property
    def image(self) -> UInt8Array:
        """Headset image as of :attr:`AppClient.image`; a new read-only array per frame."""
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
        """Start a round and run its first frame, as :meth:`AppClient.reset`.

        An app of the reference draws its own seed. Options that differ from those it was started
        with are refused.
        """
        checked_seed(seed)
        require_devices(poses, self.capabilities, self._channel.app)
        rows = pose_rows(poses)
        if self._is_ours:
            state = self._state(time_ns, rows[-1]) | {"seed": seed, "options": dict(options or {})}
        else:
            for name, value in (options or {}).items():
                if name not in self._options or self._options[name] != value:
                    raise AppRefused(
                        f"option {name}: got {value!r}, but {self._channel.app} takes its options "
                        f"at its start only, expected {self._options.get(name, 'none')!r}"
                    )
            self._round_s = self._clock_s
            state = self._reference_state(0.0, rows[-1])
        state["reset"] = True
        self._send(state, "a reset")
        reply = self._finish()
        self._in_round = True
        # The reference drops these two of a reset's reply: a round begins with nothing earned.
        return reply if self._is_ours else AppReply(0.0, False, reply.time_feature, reply.log)

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """Send the message with the frames of a step."""
        times = frame_times(times_ns)
        if drawn not in (-1, len(times) - 1):
            raise AppUnsupported(
                f"frames: {self._channel.app} draws the last frame of a step, got drawn={drawn}"
            )
        require_devices(poses, self.capabilities, self._channel.app)
        rows = pose_rows(poses, len(times))
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
                    {"time_ns": int(time), **pose_fields(row)}
                    for time, row in zip(times, rows, strict=True)
                ]
        self._send(state, "a step")

    def finish_step(self) -> AppReply:
        """Wait for the reply to the step, and return it."""
        if self._channel.usable:
            raise AppError("finish_step: no step was started; call start_step first")
        ending = self._ending
        reply = self._finish()
        if not ending:
            return reply
        if not reply.finished:
            raise self._channel.give_up(
                ProtocolError(
                    f"{self._channel.app} was informed that the round is over (isFinished), and "
                    "its reply does not say so"
                )
            )
        # Whether the game would have ended it as well cannot be known.
        return AppReply(reply.reward, False, reply.time_feature, reply.log)

    def _state(self, time_ns: int, row: NDArray[np.float64]) -> dict[str, Any]:
        """The message to our own server; it takes the exact time."""
        return self._message(time_ns * 1e-9, row) | {"timeNs": time_ns}

    def _reference_state(self, seconds: float, row: NDArray[np.float64]) -> dict[str, Any]:
        """The message to an app whose clock is never reset: the reference's fields only."""
        self._clock_s = self._round_s + on_grid(seconds, self._frequency_hz)
        return self._message(self._clock_s, row)

    def _message(self, seconds: float, row: NDArray[np.float64]) -> dict[str, Any]:
        check_finite(row[None])
        return {
            **pose_fields(row),
            "currentTimestep": seconds,
            "nextTimestep": seconds + 1.0 / self._frequency_hz,
            "reset": False,
            "isFinished": False,
            "quitApplication": False,
        }

    # --- state and views ---------------------------------------------------------------------

    def save(self) -> bytes:
        reply = self._extra("save", "saving", {"save": True})
        with self._checking():
            return base64.b64decode(checked("state", _TEXT, reply.get("state")), validate=True)

    def load(self, state: bytes) -> None:
        reply = self._extra(
            "save", "loading", {"load": base64.b64encode(state).decode()}, image=True
        )
        with self._checking():
            self._image = decode_png(reply["image"], self._shape)

    def state_hash(self) -> int:
        reply = self._extra("save", "the hash", {"stateHash": True})
        with self._checking():
            return int(checked("stateHash", _TEXT, reply.get("stateHash")), 16)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        if not self._is_ours and (height, width, 4) == self._shape:
            return self._image.copy()
        return self._render("headset", width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        return self._render(view, width, height)

    def _render(self, view: str, width: int, height: int) -> UInt8Array:
        wanted = {"view": view, "width": width, "height": height}
        reply = self._extra("views", "drawing", {"render": wanted})
        with self._checking():
            return decode_png(bytes_in("render", reply.get("render")), (height, width, 4))

    def _without(self, capability: str) -> AppUnsupported:
        who = "protocol 2" if self._is_ours else "sim2vr-app"
        return AppUnsupported(f"{super()._without(capability)}; {who} has")

    def _extra(
        self, capability: str, doing: str, fields: dict[str, Any], image: bool = False
    ) -> dict[str, Any]:
        self.require(capability)
        self._send(fields, doing)
        reply, png = self._receive()
        return reply | ({"image": png} if image else {})

    # --- messages ----------------------------------------------------------------------------

    def _send(self, message: Mapping[str, Any], doing: str) -> None:
        self._doing = doing
        self._channel.send([json.dumps(message, separators=(",", ":")).encode()], doing)

    def _receive(self, timeout_s: float | None = None) -> tuple[dict[str, Any], bytes]:
        """The reply without its image, and the image's PNG bytes; raises the app's errors."""
        frames = self._channel.receive(self._doing, timeout_s)
        if len(frames) != 1:
            raise self._channel.malformed(
                f"got {len(frames)} message parts, expected 1", self._doing
            )
        with self._checking():
            reply, png = decode_reply(frames[0])
        if "error" in reply:
            error = reply["error"]
            code, message = "", str(error)
            if isinstance(error, dict):
                code, message = str(error.get("code", "")), str(error.get("message", ""))
            app_error = AppRefused(message) if code == "invalid_argument" else AppError(message)
            raise app_error
        return reply, png

    def _finish(self) -> AppReply:
        self._ending = False
        reply, png = self._receive()
        with self._checking():
            told = checked("the reply", _ANSWER, reply)
            result = AppReply(told.reward, told.isFinished, told.timeFeature, log_in(told.logDict))
            # The first picture shows whether the app and the user agree on its size.
            try:
                image = decode_png(png, self._shape)
            except OtherSize as error:
                if self._seen:
                    raise
                raise AppRefused(
                    f"vision.width, vision.height: got {self._shape[1]} x {self._shape[0]}, but "
                    f"{self._channel.app} sends images of {error.width} x {error.height}, "
                    f"expected the app's size (doctor: --size {error.width}x{error.height})"
                ) from error
            self._seen = True
            self._image = image
        self._in_round = not result.finished
        return result

    @contextmanager
    def _checking(self) -> Iterator[None]:
        """Give the app up when the block finds that its reply cannot be used."""
        try:
            yield
        except AppRefused:
            raise
        except ValueError as error:
            raise self._channel.malformed(error, self._doing) from error

    # --- the end -----------------------------------------------------------------------------

    def close(self) -> None:
        """Request the app to quit, and end its process."""
        self._channel.end([b'{"quitApplication":true}'])


# --- messages ------------------------------------------------------------------------------------

_IMAGE = re.compile(rb'"image"\s*:\s*\[')
_NAMES = (
    ("headsetPosition", "headsetRotation"),
    ("leftControllerPosition", "leftControllerRotation"),
    ("rightControllerPosition", "rightControllerRotation"),
)


class _Answer(BaseModel):
    """The fields of a reply to a reset or step, besides the image."""

    reward: Binary32
    isFinished: StrictBool
    timeFeature: Binary32
    logDict: StrictStr | None = None


_ANSWER, _TEXT = TypeAdapter(_Answer), TypeAdapter(StrictStr)
_LOG = TypeAdapter(
    dict[str, Annotated[float, BeforeValidator(lambda one: math.nan if one is None else one)]]
)
"""Unity's JSON has NaN and infinity as texts."""


def pose_fields(row: NDArray[np.float64]) -> dict[str, dict[str, float]]:
    """Return the fields of the device poses in a message."""
    fields = {}
    for (position, rotation), values in zip(_NAMES, row.tolist(), strict=True):
        x, y, z, qx, qy, qz, qw = values
        if position == _NAMES[1][0] and not any(values):
            qw = 1.0  # how the reference says that there is no left controller
        fields[position] = {"x": x, "y": y, "z": z}
        fields[rotation] = {"x": qx, "y": qy, "z": qz, "w": qw}
    return fields


def on_grid(seconds: float, frequency_hz: int) -> float:
    """Return the time, in whole periods where it is one to a microsecond."""
    periods = round(seconds * frequency_hz)
    return periods / frequency_hz if abs(seconds * frequency_hz - periods) < 1e-6 else seconds


class OtherSize(BadReply):
    """A picture of another size than expected."""

    def __init__(self, width: int, height: int, shape: tuple[int, int, int]) -> None:
        super().__init__(f"image: got {width} x {height} pixels, expected {shape[1]} x {shape[0]}")
        self.width, self.height = width, height


def bytes_in(what: str, answer: object) -> bytes:
    """Return the bytes of an array of numbers; raises :class:`BadReply`."""
    if not isinstance(answer, list):
        raise bad_reply(what, answer, "an array of bytes")
    try:
        return bytes(answer)
    except (TypeError, ValueError) as error:
        raise bad_reply(what, answer, f"an array of bytes ({error})") from error


def log_in(text: str | None) -> dict[str, float]:
    """Return the game's named numbers of logDict, a text that holds a JSON object.

    Raises:
        BadReply: it is another thing.
    """
    found = read("logDict", _LOG, text) if text and text.strip() != "null" else {}
    return numbers_of_log(list(found), list(found.values()))


def decode_reply(text: bytes) -> tuple[dict[str, Any], bytes]:
    """Split a reply into its fields without ``image``, and the bytes of the image.

    The image is an array of some thousand decimal numbers; reading it apart from the rest takes a
    third of the time that a JSON parser needs.

    Raises:
        BadReply: no JSON object, or an image that is no array of bytes.
    """
    match = _IMAGE.search(text)
    image = b""
    if match is not None:
        end = text.find(b"]", match.end())
        numbers = _byte_list(text[match.end() : end]) if end >= 0 else None
        if numbers is not None:
            image, text = numbers, text[: match.end()] + text[end:]
    reply = read("the reply", OBJECT, text)
    rest = reply.pop("image", None)
    return reply, bytes_in("image", rest) if rest else image


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


def decode_png(png: bytes, shape: tuple[int, int, int]) -> UInt8Array:
    """Return the (H, W, 4) RGBA picture of a PNG file's bytes.

    Raises:
        OtherSize: it has another size.
        BadReply: it is no such file.
    """
    try:
        with Image.open(io.BytesIO(png), formats=["PNG"]) as picture:
            if picture.mode != "RGBA":
                raise bad_reply("image", f"a PNG of mode {picture.mode}", "RGBA")
            if (picture.height, picture.width, 4) != shape:  # before any pixel is decoded
                raise OtherSize(picture.width, picture.height, shape)
            return np.asarray(picture)
    except BadReply:
        raise
    except (
        UnidentifiedImageError,
        Image.DecompressionBombError,
        Image.DecompressionBombWarning,
        OSError,
        SyntaxError,
        ValueError,
        struct.error,
    ) as error:
        raise BadReply(f"image: got {len(png)} bytes ({error}), expected a PNG file") from error
