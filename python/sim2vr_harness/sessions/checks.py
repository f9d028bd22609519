"""Checks of frames and events that a file holds, whatever its format."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, printable, shown
from sim2vr_harness.sessions.session import (
    AppIdentity,
    Controller,
    FloatArray,
    Session,
    SessionEvent,
)

MOST_FRAMES = 1_000_000
"""Largest number of frames, more than two hours at 120 Hz."""
MOST_EVENTS = 1_000_000
LATEST_NS = 10**18
"""Latest time of a frame, about 31 years."""
LONGEST_S = 4 * 3600.0
"""A round; measures and tracking resample all of it."""
_FARTHEST_M = 100.0
_QUATERNION_TOLERANCE = 0.02
"""Rotations of at most three decimals are this far from length 1; they are normalised."""
_LONG_GAP_S = 0.5
_RATE_TOLERANCE = 0.2
_SWAPPED_PROPORTION = 0.9
_APART_M = 0.05


def checked(session: Session, source: str) -> Session:
    """Return the session with rotations of length 1 and notes on what is odd.

    Args:
        session: As a format's reader has it.
        source: The file, for the error.

    Raises:
        InputError: No frame, too many, or a time, pose, input or event that cannot be one.
    """
    count = len(session)
    if not 1 <= count <= MOST_FRAMES:
        raise InputError(source, f"{count:,} frames", f"1 to {MOST_FRAMES:,} frames")
    _check_times(session.time_ns, source, "frame")
    check_duration(np.asarray(session.time_ns * 1e-9, dtype=np.float64), source)
    head = _poses(session.head, count, source, "head", required=True)
    left, right = (
        None if one is None else _controller(one, count, source, side)
        for side, one in (("left", session.left), ("right", session.right))
    )
    for name, rows in session.objects.items():
        if rows.shape != (count, 7) or not np.isfinite(rows).all():
            wrong = int(np.argmin(np.isfinite(rows).reshape(len(rows), -1).all(axis=1)))
            got = f"{name} of shape {rows.shape}, or not finite"
            raise InputError(f"{source}, frame {wrong}", got, f"({count}, 7) finite numbers")
    events = _events(session.events, source)
    app = AppIdentity(
        session.app.kind,
        printable(session.app.name),
        printable(session.app.condition),
        {key: _plain(value) for key, value in session.app.options.items()},
    )
    done = replace(
        session,
        head=head,
        left=left,
        right=right,
        events=events,
        app=app,
        headset=printable(session.headset),
        person=printable(session.person),
    )
    return replace(done, notes=(*map(printable, session.notes), *_notes(done)))


def _plain(value: Any) -> Any:
    """Return a value; a text with its control characters escaped, which a terminal would act on."""
    return printable(value) if isinstance(value, str) else value


def _check_times(times: NDArray[np.int64], source: str, what: str) -> None:
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        i = int(back[0])
        got = f"the time {times[i + 1] * 1e-9:.9g} s after {times[i] * 1e-9:.9g} s"
        raise InputError(f"{source}, {what} {i + 1}", got, "times that do not go backwards")
    if len(times) and not 0 <= times[0] <= times[-1] <= LATEST_NS:
        got = f"times from {times[0] * 1e-9:.9g} to {times[-1] * 1e-9:.9g} s"
        raise InputError(source, got, "0 to 1e9 s")


def check_duration(times_s: FloatArray, source: str) -> None:
    """Check that a round is no longer than :data:`LONGEST_S`.

    Args:
        times_s: (N,) rising; N of 2 or more, or 0.
        source: the file, for the error.

    Raises:
        InputError: it is; says where the longest gap lies.
    """
    if len(times_s) and times_s[-1] - times_s[0] > LONGEST_S:
        i = int(np.argmax(np.diff(times_s)))
        gap = f"the longest gap is from {times_s[i]:.9g} to {times_s[i + 1]:.9g} s"
        got = f"a round of {times_s[-1] - times_s[0]:.6g} s ({gap})"
        raise InputError(source, got, f"at most {LONGEST_S:g} s; times are in seconds")


def _controller(one: Controller, count: int, source: str, side: str) -> Controller | None:
    grip = _poses(one.grip, count, source, f"{side} grip")
    if np.isnan(grip[:, 0]).all():
        return None
    aim = None if one.aim is None else _poses(one.aim, count, source, f"{side} aim")
    joints = one.joints
    if joints is not None:
        flat = np.ascontiguousarray(joints[..., :7]).reshape(-1, 7)
        poses = _poses(flat, len(flat), source, f"{side} joints").reshape(*joints.shape[:2], 7)
        joints = np.concatenate([poses, joints[..., 7:]], axis=-1)
    if one.inputs is not None:
        known = ~np.isnan(one.inputs).all(axis=1)
        wrong = known & ~(np.abs(one.inputs) <= 1.0).all(axis=1)
        if wrong.any():
            i = int(np.flatnonzero(wrong)[0])
            got = shown(one.inputs[i].tolist(), 60)
            raise InputError(f"{source}, frame {i}, {side} inputs", got, "numbers from -1 to 1")
    return Controller(grip, aim, one.inputs, joints)


def _poses(
    poses: FloatArray, count: int, source: str, device: str, *, required: bool = False
) -> FloatArray:
    """Poses with rotations of length 1; whole rows of NaN stay where a device may be away."""
    if poses.shape != (count, 7):
        raise InputError(source, f"{device} of shape {poses.shape}", f"({count}, 7)")
    missing = np.isnan(poses).all(axis=1)
    if required and missing.any():
        i = int(np.flatnonzero(missing)[0])
        raise InputError(f"{source}, frame {i}", f"no pose of the {device}", "one in every frame")
    wrong = ~missing & ~np.isfinite(poses).all(axis=1)
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        got = shown(poses[i].tolist(), 80)
        raise InputError(f"{source}, frame {i}, {device}", got, "seven finite numbers")
    length = np.linalg.norm(poses[:, 3:], axis=1)
    wrong = ~missing & ~(np.abs(length - 1.0) <= _QUATERNION_TOLERANCE)
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        got = f"a rotation of length {length[i]:.3g}"
        raise InputError(f"{source}, frame {i}, {device}", got, "a quaternion x y z w of length 1")
    far = ~missing & (np.abs(poses[:, :3]) > _FARTHEST_M).any(axis=1)
    if far.any():
        i = int(np.flatnonzero(far)[0])
        got = f"a position of {shown(poses[i, :3].tolist(), 60)}"
        raise InputError(
            f"{source}, frame {i}, {device}",
            got,
            f"metres, each at most {_FARTHEST_M:g}",
        )
    unit = poses.copy()
    # A rotation that is exact to rounding keeps its bits.
    rough = ~missing & (np.abs(length - 1.0) > 1e-6)
    unit[rough, 3:] /= length[rough, None]
    return unit


def _events(events: Sequence[SessionEvent], source: str) -> tuple[SessionEvent, ...]:
    if len(events) > MOST_EVENTS:
        got = f"{len(events):,} events"
        raise InputError(source, got, f"at most {MOST_EVENTS:,}")
    ordered = sorted(events, key=lambda event: event.time_ns)  # stable
    _check_times(np.array([event.time_ns for event in ordered], dtype=np.int64), source, "event")
    return tuple(
        SessionEvent(
            event.time_ns,
            printable(event.kind),
            {printable(key): _plain(value) for key, value in event.data.items()},
        )
        for event in ordered
    )


def _notes(session: Session) -> list[str]:
    notes = []
    rate = session.frame_rate_hz
    if rate and session.rate_hz and abs(rate / session.rate_hz - 1.0) > _RATE_TOLERANCE:
        notes.append(
            f"frames come at {rate:.4g} Hz; the file names a display of {session.rate_hz:.4g} Hz"
        )
    gaps = np.diff(session.time_ns) * 1e-9
    if len(gaps) and gaps.max() > _LONG_GAP_S:
        i = int(np.argmax(gaps))
        notes.append(f"a gap of {gaps[i]:.3g} s lies between frames {i} and {i + 1}")
    for side in ("left", "right"):
        one = session.controllers.get(side)
        if one is None:
            notes.append(f"there is no {side} controller")
        elif not one.tracked.all():
            away = f"{int((~one.tracked).sum()):,} of {len(session):,} frames"
            notes.append(f"the {side} controller is not tracked in {away}")
    if session.left is None or session.right is None:
        look_swapped = False
    else:
        x, y, z, w = session.head[:, 3:].T
        right = np.stack(
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)], axis=1
        )
        apart = np.sum((session.right.grip[:, :3] - session.left.grip[:, :3]) * right, axis=1)
        apart = apart[np.isfinite(apart)]
        look_swapped = bool(len(apart) and np.mean(apart < -_APART_M) > _SWAPPED_PROPORTION)
    if look_swapped:
        notes.append("the controllers look swapped: the left one is right of the right one")
    return notes
