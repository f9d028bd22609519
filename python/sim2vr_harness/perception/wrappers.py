"""What can be done to any sense: delay it, disturb it, remember how it was."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.special import ndtri

from sim2vr_harness.perception.sense import IntArray, Moment, Sense, restore, rows_of

__all__ = ["Delayed", "History", "Noisy", "Ring", "Stacked"]


class _Wrapper:
    """Passes everything on to the sense inside."""

    def __init__(self, sense: Sense) -> None:
        self.sense = sense
        self.name, self.space, self.needs = sense.name, sense.space, sense.needs
        self.pause, self.frame = sense.pause, sense.frame

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """See :class:`Sense`."""
        self.sense.reset(ids, seeds)

    def glimpse(self, moment: Moment) -> None:
        """See :class:`Sense`."""
        self.sense.glimpse(moment)

    def get_state(self, i: int) -> dict[str, Any]:
        """See :class:`Sense`."""
        return {"sense": self.sense.get_state(i)}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """See :class:`Sense`."""
        self.sense.set_state(i, state["sense"])


class Ring:
    """The last values of N users, a whole number of takes back.

    Args:
        name: of the sense, for errors.
        n: number of users N.
        space: of one value.
        back: how many takes back the oldest is, at least 0.
    """

    def __init__(self, name: str, n: int, space: spaces.Box[Any], back: int) -> None:
        self._name, self._back = name, back
        self._values = np.zeros((n, back + 1, *space.shape), dtype=space.dtype)
        self._newest = np.zeros(n, dtype=np.int64)
        self._fresh = np.ones(n, dtype=bool)

    def forget(self, ids: IntArray) -> None:
        """Let what these users take next be their whole past."""
        self._fresh[ids] = True

    def fresh(self, ids: IntArray | None) -> NDArray[np.bool_]:
        """(K,) which of these users have a past to be filled."""
        return self._fresh[rows_of(ids)]

    def push(self, values: NDArray[Any], ids: IntArray | None) -> None:
        """Takes (K, ...) values in; the first one of a user fills its whole past."""
        rows = np.arange(len(self._newest)) if ids is None else ids
        self._newest[rows] = (self._newest[rows] + 1) % (self._back + 1)
        self._values[rows, self._newest[rows]] = values
        first = self._fresh[rows]
        if first.any():
            self._values[rows[first]] = values[first][:, None]
            self._fresh[rows] = False

    def back(self, takes: int) -> NDArray[Any]:
        """(N, ...) what was so many takes ago, a copy."""
        rows = (self._newest - takes) % (self._back + 1)
        return self._values[np.arange(len(rows)), rows]

    def all(self) -> NDArray[Any]:
        """(N, back + 1, ...) a copy, the newest first."""
        order = (self._newest[:, None] - np.arange(self._back + 1)) % (self._back + 1)
        return self._values[np.arange(len(order))[:, None], order]

    def newest(self) -> NDArray[Any]:
        """(N, ...) a copy."""
        return self.back(0)

    def oldest(self) -> NDArray[Any]:
        """(N, ...) a copy."""
        return self.back(self._back)

    def get_state(self, i: int) -> dict[str, Any]:
        """Copies of user i's past."""
        return {
            "values": self._values[i].copy(),
            "newest": np.array(self._newest[i]),
            "fresh": np.array(self._fresh[i]),
        }

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """Restores what :meth:`get_state` returned."""
        restore(self._name, self._values, i, state["values"])
        self._newest[i] = int(state["newest"])
        self._fresh[i] = bool(state["fresh"])


class Delayed(_Wrapper):
    """A delay line: what a user perceives is what was ``delay_ms`` ago, also between user steps.

    A sense of the body or of the app's events is taken in at the very substep that lies
    ``delay_ms`` before the end of a step. A picture exists for app frames only: the one that was on
    show then, that is the youngest that is not younger, is drawn (``frames_per_step`` makes the
    grid finer). Before the first ``delay_ms`` of an episode are over, all is as at its start.

    Args:
        sense: what is delayed; no delayed one itself.
        delay_ms: multiple of the physics step, above 0.
        timestep_s: physics step.
        substeps: physics steps per user step.

    Raises:
        ValueError: a delay that cannot be kept, or a sense that is delayed already.
    """

    def __init__(self, sense: Any, delay_ms: float, *, timestep_s: float, substeps: int) -> None:
        super().__init__(sense)
        if sense.pause or sense.frame != -1:
            raise ValueError(f"delay_ms: got a sense {sense.name!r} that is delayed already")
        delay = round(delay_ms / (1000.0 * timestep_s))
        if delay < 1 or abs(delay * timestep_s * 1000.0 - delay_ms) > 1e-6:
            raise ValueError(
                f"delay_ms: got {delay_ms}, expected a multiple of the physics step, "
                f"{1000.0 * timestep_s:g} ms, above 0"
            )
        grid: int = getattr(sense, "frame_grid", 0)
        back, self._substep = delay_plan(delay, substeps, max(grid, 1))
        if grid:
            self.frame = self._substep // grid - 1
        else:
            self.pause = self._substep
        n = len(sense.observe())
        self._ring = Ring(sense.name, n, sense.space, back)
        self._glimpsed = np.zeros((n, *sense.space.shape), dtype=sense.space.dtype)

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """See :class:`Sense`."""
        super().reset(ids, seeds)
        self._ring.forget(ids)

    def glimpse(self, moment: Moment) -> None:
        """See :class:`Sense`."""
        self.sense.take(moment, None)
        self._glimpsed = self.sense.observe()

    def take(self, moment: Moment, ids: IntArray | None) -> None:
        """See :class:`Sense`."""
        if not self.pause:
            self.sense.take(moment, ids)
            self._ring.push(self.sense.observe()[rows_of(ids)], ids)
            return
        fresh = self._ring.fresh(ids)
        if fresh.any():
            new = np.flatnonzero(fresh) if ids is None else ids[fresh]
            self.sense.take(moment, new)
            self._glimpsed[new] = self.sense.observe()[new]
        self._ring.push(self._glimpsed[rows_of(ids)], ids)

    def observe(self) -> NDArray[Any]:
        """See :class:`Sense`."""
        return self._ring.oldest()

    def get_state(self, i: int) -> dict[str, Any]:
        """See :class:`Sense`."""
        return super().get_state(i) | {"line": self._ring.get_state(i)}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """See :class:`Sense`."""
        super().set_state(i, state)
        self._ring.set_state(i, state["line"])


def delay_plan(delay: int, substeps: int, grid: int) -> tuple[int, int]:
    """When to look so that what is seen is ``delay`` substeps old, or up to a grid's step older.

    Args:
        delay: substeps, above 0.
        substeps: per user step.
        grid: looks are possible at the multiples of this within a step.

    Returns:
        How many looks back the one to be perceived is, and at the end of which substep of every
        step to look; 0: at the step's end.
    """
    rounded = -(-delay // grid) * grid
    steps = -(-rounded // substeps)
    substep = steps * substeps - rounded
    return (steps - 1, substep) if substep else (steps, 0)


class Noisy(_Wrapper):
    """Adds Gaussian noise to what is sensed, drawn afresh for each number in each user step.

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
        """See :class:`Sense`."""
        super().reset(ids, seeds)
        word = zlib.crc32(self.name.encode())
        for i, seed in zip(ids.tolist(), seeds.tolist(), strict=True):
            self._streams[i] = np.random.default_rng([seed, word])

    def take(self, moment: Moment, ids: IntArray | None) -> None:
        """See :class:`Sense`."""
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
        """See :class:`Sense`."""
        return self._values.copy()

    def get_state(self, i: int) -> dict[str, Any]:
        """See :class:`Sense`."""
        stream = json.dumps(self._streams[i].bit_generator.state).encode()
        return super().get_state(i) | {"values": self._values[i].copy(), "stream": stream}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """See :class:`Sense`."""
        super().set_state(i, state)
        restore(self.name, self._values, i, state["values"])
        self._streams[i].bit_generator.state = json.loads(bytes(state["stream"]))


class _Remembering(_Wrapper):
    """A sense with a memory of whole user steps."""

    def __init__(self, sense: Sense, steps: int) -> None:
        super().__init__(sense)
        self._ring = Ring(sense.name, len(sense.observe()), sense.space, steps)

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """See :class:`Sense`."""
        super().reset(ids, seeds)
        self._ring.forget(ids)

    def take(self, moment: Moment, ids: IntArray | None) -> None:
        """See :class:`Sense`."""
        self.sense.take(moment, ids)
        self._ring.push(self.sense.observe()[rows_of(ids)], ids)

    def get_state(self, i: int) -> dict[str, Any]:
        """See :class:`Sense`."""
        return super().get_state(i) | {"memory": self._ring.get_state(i)}

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """See :class:`Sense`."""
        super().set_state(i, state)
        self._ring.set_state(i, state["memory"])


def _times(space: spaces.Box[Any], count: int) -> spaces.Box[Any]:
    """Of ``count`` values, one behind the other on the first axis."""
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
    """The newest values, and behind them (first axis) those of ``seconds`` before.

    The reference's stack of "newest and oldest": its Beats user has 0.2 s, that is 5 pictures at
    20 Hz of which the policy sees two. After a reset the first values are both.

    Args:
        sense: what is remembered.
        seconds: multiple of the user step, above 0.
        step_seconds: duration of a user step.

    Raises:
        ValueError: the time is no multiple of the step.
    """

    def __init__(self, sense: Sense, seconds: float, *, step_seconds: float) -> None:
        super().__init__(sense, _steps("history_s", seconds, step_seconds, 1))
        self.space = _times(sense.space, 2)

    def observe(self) -> NDArray[Any]:
        """See :class:`Sense`."""
        return np.concatenate([self._ring.newest(), self._ring.oldest()], axis=1)


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
        """See :class:`Sense`."""
        values = self._ring.all()
        return values.reshape(len(values), -1, *values.shape[3:])
