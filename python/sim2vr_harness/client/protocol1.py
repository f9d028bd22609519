"""Speak protocol 1 of SIM2VR's Unity asset: one JSON message per request.

docs/reference/protocol.md is the specification.

A Unity app is sent the reference's fields only. Our own server announces itself in its handshake
reply; then the fields that it understands beyond the reference's give a round the same bits as in
process: seed and options at a reset, exact times, all frames of a step, saved states and views.
"""

import base64
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.answers import (
    LARGEST,
    number_in,
    truth_in,
)
from sim2vr_harness.client.base import (
    AppClient,
    AppReply,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.client.channel import Channel, checked_duration_s
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import AppError, AppRefused, AppUnsupported, ProtocolError
from sim2vr_harness.client.poses import (
    check_finite,
    frame_times,
    pose_rows,
    require_devices,
)
from sim2vr_harness.client.protocol1_wire import (
    OtherSize,
    bytes_in,
    decode_png,
    decode_reply,
    field_in,
    log_in,
    on_grid,
    pose_fields,
)
from sim2vr_harness.client.runtime import checked_seed

QUIT_S = 2.0
"""How long an app may take to acknowledge the end of the session."""

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
            self._abandon()
            raise
        self.server: str | None = reply.get("server")
        """Name and version of our own server; None for an app of the reference."""

    # --- what the app is ---------------------------------------------------------------------

    @property
    def renderer_description(self) -> str:
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
        wanted = {"seed": seed, "options": dict(options or {})}
        reply = self._extra("head_request", "the head's pitch", {"headRequest": wanted})
        with self._checking():
            pitch_deg = field_in(reply, "headRequest", dict).get("pitch_deg")
            return None if pitch_deg is None else number_in("pitch_deg", pitch_deg)

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
        checked_seed(seed)
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

    def _require_same_options(self, options: Mapping[str, OptionValue]) -> None:
        for name, value in options.items():
            if name not in self._options or self._options[name] != value:
                raise AppRefused(
                    f"option {name}: got {value!r}, but {self._channel.app} takes its options at "
                    f"its start only, expected {self._options.get(name, 'none')!r}"
                )

    # --- state and views ---------------------------------------------------------------------

    def save(self) -> bytes:
        reply = self._extra("save", "saving", {"save": True})
        with self._checking():
            return base64.b64decode(field_in(reply, "state", str), validate=True)

    def load(self, state: bytes) -> None:
        reply = self._extra(
            "save", "loading", {"load": base64.b64encode(state).decode()}, image=True
        )
        with self._checking():
            self._image = decode_png(reply["image"], self._shape)

    def state_hash(self) -> int:
        reply = self._extra("save", "the hash", {"stateHash": True})
        with self._checking():
            return int(field_in(reply, "stateHash", str), 16)

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
            raise self._malformed(f"got {len(frames)} message parts, expected 1")
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
            result = AppReply(
                reward=number_in("reward", reply.get("reward"), LARGEST),
                finished=truth_in("isFinished", reply.get("isFinished")),
                time_feature=number_in("timeFeature", reply.get("timeFeature"), LARGEST),
                log=log_in(reply.get("logDict", "{}")),
            )
            # The app's picture; the first one shows whether the app and the user agree on its
            # size.
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
            raise self._malformed(str(error)) from error

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
