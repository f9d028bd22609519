"""Whole steps of apps whose step has two halves."""

from abc import ABC, abstractmethod
from typing import Self

import numpy as np

from sim2vr_harness.client.base import AppReply, Int64Array
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.poses import one_frame


class SplitStep(ABC):
    """An :class:`~sim2vr_harness.client.base.AppClient` by the halves of its steps."""

    @abstractmethod
    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """See :class:`~sim2vr_harness.client.base.AppClient`."""

    @abstractmethod
    def finish_step(self) -> AppReply:
        """See :class:`~sim2vr_harness.client.base.AppClient`."""

    @abstractmethod
    def close(self) -> None:
        """See :class:`~sim2vr_harness.client.base.AppClient`."""

    def step(self, time_ns: int, poses: DevicePoses) -> AppReply:
        """See :class:`~sim2vr_harness.client.base.AppClient`."""
        return self.step_frames(np.array([time_ns], dtype=np.int64), one_frame(poses))

    def step_frames(self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1) -> AppReply:
        """See :class:`~sim2vr_harness.client.base.AppClient`."""
        self.start_step(times_ns, poses, drawn)
        return self.finish_step()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
