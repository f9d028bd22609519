"""Wrappers of senses: delay, noise, history and stacking."""

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.special import ndtri

from sim2vr_harness.base.state import RowState
from sim2vr_harness.perception.sense import IntArray, Sense, StepContext, rows_of


class _Wrapper(RowState):
    """Passes everything on to the sense inside."""

    _state: ClassVar[tuple[str, ...]] = ("sense",)

    def __init__(self, sense: Sense) -> None:
        self.sense = sense
        self.name, self.space, self.needs = sense.name, sense.space, sense.needs

    @property
    def pauses(self) -> tuple[int, ...]:
        return self.sense.pauses

    @property
    def frame(self) -> int | IntArray:
        return self.sense.frame

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        self.sense.reset(ids, seeds)

    def sample(self, moment: StepContext, substep: int) -> None:
        self.sense.sample(moment, substep)


class Ring(RowState):
    """The last values of N users, a whole number of takes back.

    Args:
        name: of the sense, for errors.
        n: number of users N.
        space: of one value.
        back: how many takes back the oldest is that can be requested, at least 0.
    """

    _state = ("_values", "_newest", "_fresh")

    def __init__(self, name: str, n: int, space: spaces.Box[Any], back: int) -> None:
        self.name = name
        self.back = np.full(n, back)
        """(N,) age of the values of :meth:`oldest`, in takes; up to `back`."""
        self._length = back + 1
        self._values = np.zeros((n, back + 1, *space.shape), dtype=space.dtype)
        self._newest = np.zeros(n, dtype=np.int64)
        self._fresh = np.ones(n, dtype=bool)

    def forget(self, ids: IntArray) -> None:
        """Clear the history of these users; their next values fill it."""
        self._fresh[ids] = True

    def fresh(self, ids: IntArray | None) -> NDArray[np.bool_]:
        """Return (K,) True for users whose history is still empty."""
        return self._fresh[rows_of(ids)]

    def push(self, values: NDArray[Any], ids: IntArray | None) -> None:
        """Append (K, ...) values; the first one of a user fills its whole history."""
        rows = np.arange(len(self._newest)) if ids is None else ids
        self._newest[rows] = (self._newest[rows] + 1) % self._length
        self._values[rows, self._newest[rows]] = values
        first = self._fresh[rows]
        if first.any():
            self._values[rows[first]] = values[first][:, None]
            self._fresh[rows] = False

    def ago(self, takes: int | IntArray) -> NDArray[Any]:
        """(N, ...) what was so many takes ago, the same for all or (N,), a copy."""
        rows = (self._newest - takes) % self._length
        return self._values[np.arange(len(rows)), rows]

    def all(self) -> NDArray[Any]:
        """(N, back + 1, ...) a copy, the newest first."""
        order = (self._newest[:, None] - np.arange(self._length)) % self._length
        return self._values[np.arange(len(order))[:, None], order]

    def newest(self) -> NDArray[Any]:
        """(N, ...) a copy."""
        return self.ago(0)

    def oldest(self) -> NDArray[Any]:
        """(N, ...) a copy."""
        return self.ago(self.back)


@dataclass(frozen=True)
class OwnDelays:
    """Delays that differ from user to user.

    Attributes:
        now_s: returns (N,) the users' present ones; asked at resets.
        longest_s: none is longer.
    """

    now_s: Callable[[], NDArray[np.float64]]
    longest_s: float


class Delayed(_Wrapper):
    """A delay line: users observe the state of ``delay_ms`` ago, with a resolution of substeps.

    A sense of the body or of the app's events is sampled at the substep that lies ``delay_ms``
    before the end of a step. An image exists for app frames only: the newest one that is at least
    ``delay_ms`` old is rendered (``frames_per_step`` makes the grid finer). In the first
    ``delay_ms`` of an episode users observe its start.

    Args:
        sense: the sense to delay, which must not be delayed already.
        delay_ms: multiple of the physics step, above 0; or each user's own, at least 0, rounded up
            to the physics step.
        timestep_s: physics step.
        substeps: physics steps per user step.

    Raises:
        ValueError: a delay that cannot be kept, or a sense that is delayed already.
    """

    _state = ("sense", "_ring")

    def __init__(
        self, sense: Any, delay_ms: float | OwnDelays, *, timestep_s: float, substeps: int
    ) -> None:
        super().__init__(sense)
        if sense.pauses or not isinstance(sense.frame, int) or sense.frame != -1:
            raise ValueError(f"delay_ms: got a sense {sense.name!r} that is delayed already")
        self._own = delay_ms if isinstance(delay_ms, OwnDelays) else None
        if isinstance(delay_ms, OwnDelays):
            longest = _substeps_of(delay_ms.longest_s, timestep_s)
        else:
            longest = round(delay_ms / (1000.0 * timestep_s))
            if longest < 1 or abs(longest * timestep_s * 1000.0 - delay_ms) > 1e-6:
                raise ValueError(
                    f"delay_ms: got {delay_ms}, expected a multiple of the physics step, "
                    f"{1000.0 * timestep_s:g} ms, above 0"
                )
        self._timestep_s, self._substeps = timestep_s, substeps
        self._grid: int = getattr(sense, "frame_grid", 0)
        n = len(sense.observe())
        back, substep = delay_plan(longest, substeps, max(self._grid, 1))
        self._ring, self._longest_back = Ring(sense.name, n, sense.space, back), back
        self._substep = np.full(n, substep)
        self._sampled = np.zeros((n, *sense.space.shape), dtype=sense.space.dtype)

    @property
    def pauses(self) -> tuple[int, ...]:
        return () if self._grid else tuple(np.unique(self._substep[self._substep > 0]).tolist())

    @property
    def frame(self) -> int | IntArray:
        if not self._grid:
            return -1
        frames = self._substep // self._grid - 1
        return int(frames[0]) if (frames == frames[0]).all() else frames

    @property
    def of_pictures(self) -> bool:
        """True for senses of images, which exist for app frames only."""
        return self._grid > 0

    @property
    def steps_back(self) -> IntArray:
        """(N,) age of the observation in user steps.

        The age is lower than the delay if the observation was sampled within a step.
        """
        return self._ring.back.copy()

    @property
    def longest_back(self) -> int:
        """Largest age of an observation, in user steps."""
        return self._longest_back

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        super().reset(ids, seeds)
        self._ring.forget(ids)
        self._plan(ids.tolist())

    def _plan(self, ids: Sequence[int]) -> None:
        """Sets up these users' own delays."""
        if self._own is None:
            return
        delays_s = self._own.now_s()
        for i in ids:
            delay = _substeps_of(float(delays_s[i]), self._timestep_s)
            plan = delay_plan(delay, self._substeps, max(self._grid, 1))
            self._ring.back[i], self._substep[i] = plan

    def sample(self, moment: StepContext, substep: int) -> None:
        if (self._substep == substep).all():
            self.sense.take(moment, None)
            self._sampled = self.sense.observe()
            return
        ids = np.flatnonzero(self._substep == substep)
        self.sense.take(moment, ids)
        self._sampled[ids] = self.sense.observe()[ids]

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        if not self.pauses:
            self.sense.take(moment, ids)
            self._ring.push(self.sense.observe()[rows_of(ids)], ids)
            return
        # What was not looked at within the step is now: by those who begin, or whose delay is a
        # whole number of steps.
        now = self._ring.fresh(ids) | (self._substep[rows_of(ids)] == 0)
        if now.any():
            new = np.flatnonzero(now) if ids is None else ids[now]
            self.sense.take(moment, new)
            self._sampled[new] = self.sense.observe()[new]
        self._ring.push(self._sampled[rows_of(ids)], ids)

    def observe(self) -> NDArray[Any]:
        return self._ring.oldest()

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restore the state of user i, and set its delay to that of its current person."""
        super().load_state_dict(i, state)
        self._plan([i])


def _substeps_of(delay_s: float, timestep_s: float) -> int:
    """Return a delay in physics steps, rounded up."""
    return math.ceil(delay_s / timestep_s - 1e-6)


def delay_plan(delay: int, substeps: int, grid: int) -> tuple[int, int]:
    """Return the sampling plan for observations that are ``delay`` substeps old.

    On a grid they are up to one grid step older.

    Args:
        delay: substeps, at least 0.
        substeps: substeps per user step.
        grid: samples are possible at the multiples of this within a step.

    Returns:
        The number of samples by which the observation lies back, and the substep of every step at
        whose end to sample; 0: at the step's end.
    """
    rounded = -(-delay // grid) * grid
    steps = -(-rounded // substeps)
    substep = steps * substeps - rounded
    return (steps - 1, substep) if substep else (steps, 0)


class Noisy(_Wrapper):
    """Adds Gaussian noise to a sense, independent for each number and each user step.

    Every user has a random stream of its own, from the seed of its round and the sense's name.

    Args:
        sense: what is disturbed.
        level: standard deviation, in the unit of the sense; of bytes (pictures) the share of the
            full scale, 255. Bytes are rounded and stay within 0 to 255, other numbers within the
            sense's space. The noise of bytes is drawn from the 65,536 quantiles of the normal
            distribution in the middle of equal shares, up to 4.2 deviations: a third of the time.

    Raises:
        ValueError: the level is not above 0.
    """

    _state = ("sense", "_values", "_streams")

    def __init__(self, sense: Sense, level: float) -> None:
        super().__init__(sense)
        if not (np.isfinite(level) and level > 0.0):
            raise ValueError(f"noise: got {level}, expected a finite number above 0")
        self.level = level
        shares = (np.arange(65_536) + 0.5) / 65_536
        deviations = np.clip(np.rint(level * 255.0 * ndtri(shares)), -255, 255)
        self._quantiles = deviations.astype(np.int16)
        self._values = sense.observe()
        self._streams = [np.random.default_rng(i) for i in range(len(self._values))]

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        super().reset(ids, seeds)
        word = zlib.crc32(self.name.encode())
        for i, seed in zip(ids.tolist(), seeds.tolist(), strict=True):
            self._streams[i] = np.random.default_rng([seed, word])

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        self.sense.take(moment, ids)
        clean = self.sense.observe()
        shape, is_bytes = clean.shape[1:], clean.dtype == np.uint8
        for i in range(len(clean)) if ids is None else ids.tolist():
            if is_bytes:
                ranks = self._streams[i].integers(0, len(self._quantiles), shape, dtype=np.uint16)
                noisy = np.take(self._quantiles, ranks)
                noisy += clean[i]
                self._values[i] = np.clip(noisy, 0, 255, out=noisy)
            else:
                drawn = self._streams[i].standard_normal(shape, dtype=np.float32)
                drawn = clean[i] + np.float32(self.level) * drawn
                self._values[i] = np.clip(drawn, self.space.low, self.space.high)

    def observe(self) -> NDArray[Any]:
        return self._values.copy()


class _Remembering(_Wrapper):
    """A sense with a memory of whole user steps."""

    _state = ("sense", "_ring")

    def __init__(self, sense: Sense, steps: int) -> None:
        super().__init__(sense)
        self._ring = Ring(sense.name, len(sense.observe()), sense.space, steps)

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        super().reset(ids, seeds)
        self._ring.forget(ids)

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        self.sense.take(moment, ids)
        self._ring.push(self.sense.observe()[rows_of(ids)], ids)


def _times(space: spaces.Box[Any], count: int) -> spaces.Box[Any]:
    """Return the space of ``count`` values, concatenated on the first axis."""
    return spaces.Box(
        np.concatenate([space.low] * count),
        np.concatenate([space.high] * count),
        dtype=space.dtype.type,
    )


def _steps(name: str, seconds: float, step_seconds: float, least: int) -> int:
    # Rounded, not truncated, since 0.15 / 0.05 is a hair below 3 in floating point.
    steps = round(seconds / step_seconds)
    if steps < least or abs(steps * step_seconds - seconds) > 1e-6:
        raise ValueError(
            f"{name}: got {seconds}, expected a multiple of the user step, "
            f"{step_seconds:g} s, above {step_seconds * (least - 1):g}"
        )
    return steps


class History(_Remembering):
    """The newest values, and behind them (first axis) those of each of ``seconds`` before.

    With one time the reference's stack of "newest and oldest": its Beats user has 0.2 s, that is 5
    pictures at 20 Hz of which the policy sees two. After a reset the first values are all.

    Args:
        sense: what is remembered.
        seconds: one time, or several, each above the one before it; multiples of the user step,
            above 0.
        step_seconds: duration of a user step.

    Raises:
        ValueError: a time is no multiple of the step, or not above the one before it.
    """

    def __init__(
        self, sense: Sense, seconds: float | Sequence[float], *, step_seconds: float
    ) -> None:
        times = (seconds,) if isinstance(seconds, (int, float)) else tuple(seconds)
        steps = [_steps("history_s", time, step_seconds, 1) for time in times]
        if not steps or any(later <= one for one, later in pairwise(steps)):
            raise ValueError(
                f"history_s: got {list(times)}, expected times that grow, at least one"
            )
        super().__init__(sense, steps[-1])
        self._steps = (0, *steps)
        self.space = _times(sense.space, len(self._steps))

    def observe(self) -> NDArray[Any]:
        return np.concatenate([self._ring.ago(steps) for steps in self._steps], axis=1)


class Stacked(_Remembering):
    """The values of the last ``seconds``, one behind the other (first axis), the newest first.

    After a reset all of them are the first value.

    Args:
        sense: what is remembered.
        seconds: multiple of the user step, above one step.
        step_seconds: duration of a user step.

    Raises:
        ValueError: the time is no multiple of the step.
    """

    def __init__(self, sense: Sense, seconds: float, *, step_seconds: float) -> None:
        steps = _steps("stack_s", seconds, step_seconds, 2)
        super().__init__(sense, steps - 1)
        self.space = _times(sense.space, steps)

    def observe(self) -> NDArray[Any]:
        values = self._ring.all()
        return values.reshape(len(values), -1, *values.shape[3:])
