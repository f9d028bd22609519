"""Apps of others that draw their own frames: what pages and OpenXR programs have in common."""

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sim2vr_harness.client.base import AppClient, AppReply, Float64Array, Int64Array, UInt8Array
from sim2vr_harness.client.devices import DevicePoses, HapticPulse
from sim2vr_harness.client.errors import AppError, AppRefused, AppUnsupported
from sim2vr_harness.client.poses import checked_rows, later_times, one_frame
from sim2vr_harness.client.runtime import checked_seed
from sim2vr_harness.client.transport import AppsWanted

FARTHEST_M = 10.0
"""Distance of which the depth channel's 255 is, as in our own runtime."""
VERTICAL_FOV_DEG = 90.0
FRAME_RATE_HZ = 72
"""Frame rate of the display that the app receives, Hz: that of the first Quest."""


class ForeignApp(AppClient):
    """An app whose state is its own: it cannot be saved, nor drawn from outside.

    Args:
        wanted: what is requested.
    """

    found_capabilities: ClassVar[frozenset[str]]
    _awaited: Any = None
    """Step that is in progress; falsy: none."""

    def __init__(self, wanted: AppsWanted) -> None:
        self._wanted = wanted
        self._options = dict(wanted.options)
        self._closed = self._playing = False
        self._left = ""
        self._last_ns = 0
        shape = (wanted.height, wanted.width, 4)
        self._image: UInt8Array = np.zeros((2, *shape) if wanted.eyes == 2 else shape, np.uint8)

    @property
    def capabilities(self) -> frozenset[str]:
        return self.found_capabilities

    @property
    def image(self) -> UInt8Array:
        return self._image

    def _require_open(self) -> None:
        if self._closed:
            raise RuntimeError("the app is closed; make a new one")

    def _checked_reset(
        self, seed: int, poses: DevicePoses, time_ns: int
    ) -> tuple[Float64Array, Float64Array]:
        """Return rows and inputs of a round's first frame; see :func:`checked_rows`."""
        self._require_open()
        checked_seed(seed)
        if time_ns != 0:
            raise AppUnsupported(f"time_ns: {self.kind}'s clock begins at 0 with each round")
        return checked_rows(one_frame(poses), 1)

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """Send the frames of a step to the app."""
        self._require_open()
        if not self._playing:
            raise AppError(f"step: {self._left or 'no round was started'}; call reset first")
        if self._awaited:
            raise AppError("step: the last one goes on; call finish_step first")
        times = later_times(times_ns, self._last_ns)
        rows, inputs = checked_rows(poses, len(times))
        self._last_ns = int(times[-1])
        self._send(times, rows, inputs, poses, range(len(times))[drawn])

    @abstractmethod
    def _send(
        self,
        times_ns: Int64Array,
        rows: Float64Array,
        inputs: Float64Array,
        poses: DevicePoses,
        drawn: int,
    ) -> None:
        """Send frames that were checked; sets what is awaited.

        Args:
            times_ns: (K,) game times.
            rows: (K, 3, 7), see :func:`~.poses.pose_rows`.
            inputs: (K, 2, INPUT_COUNT).
            poses: as they were given, of which tracked devices are read.
            drawn: 0 to K - 1.
        """

    def _require_step(self) -> None:
        if not self._awaited:
            raise AppError("finish_step: no step was started; call start_step first")

    def _ended_words(self, name: str, call: str, first: str) -> str:
        """Say how the app ended its session, by a call; ``first``: when that is at its start."""
        when = f"after {self._last_ns * 1e-9:.1f} s" if self._last_ns else first
        return f"{name}: {self.kind.replace('a ', 'the ')} ended its session ({call}) {when}"

    def _reply(self, haptics: tuple[HapticPulse, ...], values: dict[str, Any]) -> AppReply:
        return AppReply(
            reward=0.0,
            finished=not self._playing,
            time_feature=0.0,
            log={},
            haptics=haptics,
            values=values,
            left=self._left,
        )

    def close(self) -> None:
        self._closed = True


def refuse_logs(log_dir: Path | None, app: str) -> None:
    """Raise AppRefused for a folder of logs, which such apps do not write."""
    if log_dir is not None:
        raise AppRefused(f"logs: got a folder, but {app} writes none, expected no --log")
