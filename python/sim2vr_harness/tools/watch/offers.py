"""Check what pages send against what the page offers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import msgspec
from msgspec import Meta

MAX_BYTES = 64 * 1024
"""Longest message; a page's longest is a camera, of less than 1 KiB."""
_UNIT_TOLERANCE = 0.01

_Number = Annotated[float, Meta(ge=-1e6, le=1e6)]  # excludes nan
_Pixels = Annotated[int, Meta(ge=0, le=65_536)]
_Text = Annotated[str, Meta(max_length=200)]
_Vector = tuple[_Number, _Number, _Number]
_Quaternion = tuple[_Number, _Number, _Number, _Number]


class Malformed(Exception):
    """Bytes that no page sends."""


class _Message(
    msgspec.Struct, tag_field="type", tag=lambda name: f"{name}Message", forbid_unknown_fields=True
):
    """What viser's page sends, by viser's names; it sends nothing else that this page offers."""


class ViewerCamera(_Message):
    """Where the camera of a page is."""

    wxyz: _Quaternion
    position: _Vector
    fov: _Number
    near: _Number
    far: _Number
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector


class _Updates(msgspec.Struct, forbid_unknown_fields=True):
    value: _Text | _Number


class GuiUpdate(_Message):
    """Another value of a button, a choice or a slider."""

    uuid: _Text
    updates: _Updates


class CommandTrigger(_Message):
    """A key was pressed."""

    uuid: _Text


class TransformControlsUpdate(_Message):
    """Arrows were dragged."""

    name: _Text
    wxyz: _Quaternion
    position: _Vector
    owner: _Text = ""


class TransformControlsDragStart(_Message):
    """A drag begins."""

    name: _Text
    owner: _Text = ""


class TransformControlsDragEnd(_Message):
    """A drag ends."""

    name: _Text
    owner: _Text = ""


_Sent = (
    ViewerCamera
    | GuiUpdate
    | CommandTrigger
    | TransformControlsUpdate
    | TransformControlsDragStart
    | TransformControlsDragEnd
)
_DECODER: msgspec.msgpack.Decoder[_Sent] = msgspec.msgpack.Decoder(_Sent)


class Offers:
    """Everything that a page offers to change, and whether a message keeps to it."""

    def __init__(self) -> None:
        self._values: dict[str, Callable[[Any], bool]] = {}
        self._commands: set[str] = set()
        self._arrows: set[str] = set()

    def choice(self, handle: Any, options: Iterable[str]) -> None:
        """Offer a choice among texts."""
        offered = frozenset(options)
        self._values[handle._impl.uuid] = lambda value: value in offered

    def number(self, handle: Any) -> None:
        """Offer a slider."""
        self._values[handle._impl.uuid] = lambda value: (
            isinstance(value, float) and handle.min <= value <= handle.max
        )

    def command(self, handle: Any) -> None:
        """Offer a key."""
        self._commands.add(handle._impl.uuid)

    def arrows(self, handle: Any) -> None:
        """Offer arrows to drag."""
        self._arrows.add(handle.name)

    def take(self, raw: bytes | str) -> bytes | None:
        """Return a message that may be handled, encoded anew; None if it may not.

        What is returned is what was checked, however the bytes could be read otherwise.

        Raises:
            Malformed: It is no message at all.
        """
        if isinstance(raw, str):
            raise Malformed("text instead of bytes")
        try:
            sent = _DECODER.decode(raw)
        except msgspec.ValidationError:
            return None
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            raise Malformed(str(error)) from error
        return msgspec.msgpack.encode(sent) if self._offered(sent) else None

    def _offered(self, sent: _Sent) -> bool:
        if isinstance(sent, ViewerCamera):
            return True
        if isinstance(sent, GuiUpdate):
            offered = self._values.get(sent.uuid)
            return offered is not None and offered(sent.updates.value)
        if isinstance(sent, CommandTrigger):
            return sent.uuid in self._commands
        if isinstance(sent, TransformControlsUpdate):
            turn = math.hypot(*sent.wxyz)
            if abs(turn - 1.0) > _UNIT_TOLERANCE:
                return False
        return sent.owner == "" and sent.name in self._arrows
