"""Writes BSOR as its description has it, for tests of the reader."""

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = ["bsor_bytes"]

OUTCOMES = {"good": 0, "bad": 1, "miss": 2, "bomb": 3}


def _text(text: str, length: int | None = None) -> bytes:
    content = text.encode()
    return struct.pack("<i", len(content) if length is None else length) + content


def bsor_bytes(
    times_s: Sequence[float],
    boxes: Sequence[Mapping[str, Any]],
    poses: np.ndarray | None = None,
    *,
    name: str = "player",
    modifiers: str = "",
    practice_speed: float = 0.0,
    count: int | None = None,
) -> bytes:
    """A replay; ``poses`` (T, 3, 7) of head, left, right."""
    out = struct.pack("<iBB", 0x442D3D69, 1, 0)
    for text in ("1", "1.29", "0", "76561", name, "steam", "OpenVR", "VIVE Pro 2", "Knuckles"):
        # Recorders count a name's characters of UTF-16 instead of its bytes.
        out += _text(text, len(text) if text == name else None)
    out += b"".join(map(_text, ("A" * 40, "song", "mapper", "Normal")))
    out += struct.pack("<i", 1234) + b"".join(map(_text, ("Standard", "Env", modifiers)))
    out += struct.pack("<fBf3f", 12.0, 0, 1.7, 0.0, 0.0, practice_speed)
    if poses is None:
        poses = np.zeros((len(times_s), 3, 7))
        poses[:, :, 1], poses[:, :, 6] = 1.5, 1.0
    out += struct.pack("<Bi", 1, len(times_s) if count is None else count)
    for time_s, pose in zip(times_s, poses, strict=True):
        out += struct.pack("<fi21f", time_s, 90, *pose.reshape(-1))
    out += struct.pack("<Bi", 2, len(boxes))
    return out + b"".join(map(_box, boxes)) + struct.pack("<BiBiBi", 3, 0, 4, 0, 5, 0)


def _box(box: Mapping[str, Any]) -> bytes:
    number = 30_000 + 1000 * box["column"] + 100 * box["row"] + 10 * box["colour"]
    number += box["direction"]
    outcome = OUTCOMES[box["outcome"]]
    out = struct.pack("<iffi", number, box["event_s"], box["event_s"] - 1.0, outcome)
    if outcome > 1:
        return out
    good = outcome == 0
    out += struct.pack("<4B", True, good, True, False)
    out += struct.pack("<f3fi", box["speed_mps"], 0.0, 1.0, 0.0, box["colour"])
    out += struct.pack("<2f", box["time_deviation_s"], box["direction_deviation_deg"])
    out += struct.pack("<6f", *box["cut"], 1.0, 0.0, 0.0)
    return out + struct.pack("<4f", box["distance_to_centre_m"], 0.0, box["before"], box["after"])
