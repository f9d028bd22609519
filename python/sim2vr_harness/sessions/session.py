"""A session: what the devices of one round reported, and what the app did in return.

Poses are in the app's frame (Unity: left-handed, x right, y up, z forward, origin on the floor):
position x y z in metres, rotation x y z w. The other frames are converted in ``frames.py`` only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import ClockSettings, DevicePoses, OptionValue, PageStart
from sim2vr_harness.sessions.frames import aim_of

FloatArray = NDArray[np.float64]
AppKind = Literal["game", "page", "app", "unknown"]
APP_KINDS: tuple[AppKind, ...] = ("game", "page", "app", "unknown")
SIDES: tuple[Literal["left", "right"], Literal["left", "right"]] = ("left", "right")
_FINGERS = ("index-finger", "middle-finger", "ring-finger", "pinky-finger")
_PHALANGES = ("metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")
JOINT_NAMES: tuple[str, ...] = (
    "wrist",
    *(f"thumb-{part}" for part in _PHALANGES if part != "phalanx-intermediate"),
    *(f"{finger}-{part}" for finger in _FINGERS for part in _PHALANGES),
)
"""WebXR's joints of a hand, in its order."""
JOINTS = len(JOINT_NAMES)


@dataclass(frozen=True)
class AppIdentity:
    """The app that was played.

    Attributes:
        kind: ``game`` (of this runtime), ``page`` (WebXR), ``app`` (another one) or ``unknown``.
        name: of the game, or the page's file or address without folders; empty: not known.
        condition: the game's condition; empty: its default, or not known.
        options: of the game, or the query of the page's address.
    """

    kind: AppKind = "unknown"
    name: str = ""
    condition: str = ""
    options: Mapping[str, OptionValue] = field(default_factory=dict)


@dataclass(frozen=True)
class Controller:
    """Recorded data of one hand's controller; rows of NaN while it was not tracked.

    Attributes:
        grip: (N, 7) grip poses.
        aim: (N, 7) aim poses; None: not recorded, see :meth:`ray`.
        inputs: (N, 13) in the columns of ``client.INPUTS``, 0 to 1, sticks -1 to 1; None: at rest.
        joints: (N, 25, 8) of :data:`JOINT_NAMES`: pose in the app's frame, and radius (m); None:
            no hand tracking.
    """

    grip: FloatArray
    aim: FloatArray | None = None
    inputs: FloatArray | None = None
    joints: FloatArray | None = None

    @property
    def tracked(self) -> NDArray[np.bool_]:
        """(N,) True in frames with a pose."""
        found: NDArray[np.bool_] = ~np.isnan(self.grip[:, 0])
        return found

    def ray(self) -> FloatArray:
        """(N, 7) poses of the ray, of a Touch controller where none was recorded."""
        return aim_of(self.grip) if self.aim is None else self.aim

    def map(self, change: Callable[[FloatArray], FloatArray]) -> Controller:
        """Return the controller with ``change`` applied to every array that is there."""
        arrays: dict[str, Any] = {
            name: None if array is None else change(array) for name, array in vars(self).items()
        }
        return Controller(**arrays)


@dataclass(frozen=True)
class SessionEvent:
    """Something that the app did.

    Attributes:
        time_ns: on the session's clock.
        kind: ``haptic``, ``sound``, ``value``, ``end``, or a name of the app's own, such as
            ``target_hit`` or ``box``.
        data: named numbers, texts, truths and lists of numbers.
    """

    time_ns: int
    kind: str
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Session:
    """One recorded round.

    Attributes:
        time_ns: (N,) int64 times of the frames, not falling; on the app's clock where it has one.
        head: (N, 7) poses of the head.
        left: the left controller; None: there was none.
        right: the right controller; None: there was none.
        events: in order of time.
        app: what was played.
        seed: of the round's random numbers, 32 bits; None: not known.
        clock: of the app, where it is not the usual one.
        headset: name of the headset; empty: not known.
        rate_hz: frames per second of its display; None: not known.
        source: name of the format that it was read from.
        person: a name for who played, without meaning outside the data set; empty: none.
        rounding_m: step to which the source rounds positions, m; 0: not rounded.
        page_start: what a page did before the first frame; None: not known.
        notes: what is odd about the file, a sentence each.
        objects: further things that a log tracked, such as a hammer's ``marker``: (N, 7) poses.
        path: file or folder that it was read from; None: of none.
    """

    time_ns: NDArray[np.int64]
    head: FloatArray
    left: Controller | None = None
    right: Controller | None = None
    events: tuple[SessionEvent, ...] = ()
    app: AppIdentity = AppIdentity()
    seed: int | None = None
    clock: ClockSettings | None = None
    headset: str = ""
    rate_hz: float | None = None
    source: str = "session"
    person: str = ""
    rounding_m: float = 0.0
    page_start: PageStart | None = None
    notes: tuple[str, ...] = ()
    objects: Mapping[str, FloatArray] = field(default_factory=dict)
    path: Path | None = None

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last."""
        return float(self.time_ns[-1] - self.time_ns[0]) * 1e-9

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames per second by the median of the intervals; None for a single frame."""
        intervals = np.diff(self.time_ns)
        intervals = intervals[intervals > 0]
        return 1e9 / float(np.median(intervals)) if len(intervals) else None

    @property
    def controllers(self) -> dict[str, Controller]:
        """Those that there are, by side."""
        found = {"left": self.left, "right": self.right}
        return {side: one for side, one in found.items() if one is not None}

    @property
    def name(self) -> str:
        """A short name for tables: of the file or folder; empty of neither."""
        if self.path is None:
            return ""
        if self.path.is_dir():
            return self.path.resolve().name
        if self.path.name.endswith("states.csv"):
            return self.path.stem.removesuffix("states").rstrip("_-. ")
        return self.path.name.split(".")[0]

    @property
    def folder(self) -> Path | None:
        """The folder that it was read from, which alone may hold files that it names."""
        return self.path if self.path is None or self.path.is_dir() else self.path.parent

    def frames(self, rows: Any) -> Session:
        """Return the session with some of its frames: a slice, or (M,) numbers of frames."""
        left, right = (
            None if one is None else one.map(lambda poses: poses[rows])
            for one in (self.left, self.right)
        )
        objects = {name: poses[rows] for name, poses in self.objects.items()}
        return replace(
            self,
            time_ns=self.time_ns[rows],
            head=self.head[rows],
            left=left,
            right=right,
            objects=objects,
        )

    def swapped(self) -> Session:
        """Return the session with the controllers in the other hands."""
        return replace(self, left=self.right, right=self.left)

    def devices(self) -> DevicePoses:
        """Return the devices of all frames as an app takes them.

        A controller keeps its last pose, inputs at rest, while it is not tracked; one that is not
        tracked at first has the first pose that it will have.
        """
        rows: dict[str, FloatArray] = {}
        for side, controller in self.controllers.items():
            if not controller.tracked.any():
                continue
            # (N,) index of the last tracked frame at each frame; before the first, the first.
            frames = np.arange(len(controller.tracked))
            known = np.maximum.accumulate(np.where(controller.tracked, frames, -1))
            found: NDArray[np.int64] = np.where(
                known < 0, int(np.argmax(controller.tracked)), known
            )
            rows[f"{side}_controller"] = controller.grip[found]
            if controller.inputs is not None:
                rows[f"{side}_inputs"] = np.nan_to_num(controller.inputs, nan=0.0)
        return DevicePoses(head=self.head, **rows)
