"""The fields of protocol 1's messages, written and read (docs/reference/protocol.md)."""

import io
import math
import re
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from sim2vr_harness.client.answers import BadReply, bad_reply, object_in, text_in
from sim2vr_harness.client.base import UInt8Array, numbers_of_log

_IMAGE = re.compile(rb'"image"\s*:\s*\[')
_NAMES = (
    ("headsetPosition", "headsetRotation"),
    ("leftControllerPosition", "leftControllerRotation"),
    ("rightControllerPosition", "rightControllerRotation"),
)


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


def field_in(reply: dict[str, Any], name: str, kind: type) -> Any:
    """Return a reply's field of that type; raises :class:`BadReply`."""
    value = reply.get(name)
    if not isinstance(value, kind):
        raise bad_reply(name, value, f"a {kind.__name__}")
    return value


def bytes_in(what: str, answer: object) -> bytes:
    """Return the bytes of an array of numbers; raises :class:`BadReply`."""
    if not isinstance(answer, list):
        raise bad_reply(what, answer, "an array of bytes")
    try:
        return bytes(answer)
    except (TypeError, ValueError) as error:
        raise bad_reply(what, answer, f"an array of bytes ({error})") from error


def log_in(text: Any) -> dict[str, float]:
    """Return the game's named numbers of logDict, a text that holds a JSON object.

    Raises:
        BadReply: it is another thing.
    """
    if not isinstance(text, (str, type(None))):
        raise bad_reply("logDict", text, "a text that holds a JSON object")
    found = object_in("logDict", text) if text and text.strip() != "null" else {}
    return numbers_of_log(list(found), [_log_number(*entry) for entry in found.items()])


def _log_number(name: str, value: object) -> float:
    """A number of logDict; Unity's JSON has NaN and infinity as texts."""
    if value is None:
        return math.nan
    try:
        return float(value)  # type: ignore[arg-type]
    except (OverflowError, TypeError, ValueError) as error:
        raise bad_reply(f"logDict, {text_in('name', name)}", value, "a number") from error


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
    reply = object_in("the reply", text)
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
