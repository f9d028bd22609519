"""One app of a connection that speaks protocol 2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from sim2vr_harness.client.base import (
    AppReply,
    Int64Array,
    OptionValue,
    ThirdPersonView,
    UInt8Array,
)
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.poses import frame_times
from sim2vr_harness.client.runtime import checked_seed
from sim2vr_harness.client.scene import AppScene
from sim2vr_harness.client.split_step import SplitStep

if TYPE_CHECKING:
    from sim2vr_harness.client.protocol2 import Protocol2Connection


class Protocol2App(SplitStep):
    """:class:`~sim2vr_harness.client.base.AppClient` for one app of a connection.

    Args:
        connection: shared with the connection's other apps.
        index: which of them, from 0.
    """

    def __init__(self, connection: Protocol2Connection, index: int = 0) -> None:
        if not 0 <= index < connection.apps:
            raise ValueError(f"index: got {index}, expected 0 to {connection.apps - 1}")
        self._connection: Protocol2Connection | None = connection
        self._index = index
        self._last_image: UInt8Array | None = None

    def _open(self) -> Protocol2Connection:
        if self._connection is None:
            raise RuntimeError("the app is closed; make a new one")
        return self._connection

    @property
    def renderer_description(self) -> str:
        connection = self._open()
        return f"{connection.renderer_description} (protocol 2, {connection.channel.app})"

    @property
    def capabilities(self) -> frozenset[str]:
        """See :class:`AppClient`; as the server has said."""
        return self._open().capabilities

    def head_request(
        self, seed: int, options: Mapping[str, OptionValue] | None = None
    ) -> float | None:
        return self._open().head_request(self._index, seed, options)

    @property
    def image(self) -> UInt8Array:
        """See :class:`AppClient`; read-only, in shared memory where the connection has it."""
        return self._open().images[self._index]

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        checked_seed(seed)
        return self._open().reset(self._index, seed, poses, options, time_ns)

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """See :class:`AppClient`; the last app of the connection to start sends them all."""
        self._open().start_step(self._index, frame_times(times_ns), poses, drawn)

    def finish_step(self) -> AppReply:
        return self._open().finish_step(self._index)

    def render_headset(self, width: int, height: int) -> UInt8Array:
        return self._open().render(self._index, "headset", width, height)

    def render_third_person(
        self, width: int, height: int, view: ThirdPersonView = "spectator"
    ) -> UInt8Array:
        return self._open().render(self._index, view, width, height)

    def scene(self) -> AppScene:
        return self._open().scene(self._index)

    def save(self) -> bytes:
        return self._open().save(self._index)

    def load(self, state: bytes) -> None:
        self._open().load(self._index, state)

    def state_hash(self) -> int:
        return self._open().state_hash(self._index)

    def close(self) -> None:
        """See :class:`AppClient`; the last open app of a connection ends the session."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.release()
