"""Privileged observations of a teacher: its body and the game's state, delayed like its student's.

Delays of the student's senses, rounded up to whole user steps, apply to the teacher as well. A
teacher that observed the present would do what a student with delayed senses cannot. Proprioception
has its own, shorter delay. A student can compute its present body state from its recent actions (an
efference copy and a forward model: Wolpert, Ghahramani and Jordan 1995). So the teacher observes
that state, and the student learns to compute it.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.base.state import RowState
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.perception import StepContext
from sim2vr_harness.perception.sense import float_space
from sim2vr_harness.perception.wrappers import Ring
from sim2vr_harness.users import FEATURES, PeopleSettings

OBSERVATION = "teacher"


@dataclass(frozen=True)
class Lag:
    """Delays of a user's senses, in whole user steps.

    Attributes:
        game: of vision, until an object is recognised.
        body: of proprioception.
        actions: number of last user steps whose actions are observed.
        recognition: the part of ``game`` between an object's first image and its recognition.
    """

    game: int = 0
    body: int = 0
    actions: int = 0
    recognition: int = 0

    @staticmethod
    def of(env: EnvConfig, recognition: int = 0) -> Lag:
        """Return the delays of a configuration's senses; for people, those of the mean person.

        The present body counts as known if the user's own actions since it was sensed are observed.

        Args:
            env: the configuration.
            recognition: user steps between an object's first image and its recognition.
        """
        found = {sense.sense: sense for sense in env.senses}
        people = env.user.people or PeopleSettings()
        own_s = {
            "vision": people.visual_delay_s,
            "proprioception": people.proprioceptive_delay_s,
        }

        def steps(name: str) -> int:
            if name not in found:
                return 0
            given = found[name].delay_ms
            delay_s = own_s[name] if isinstance(given, str) else given / 1000.0
            return math.ceil(delay_s * env.action_frequency_hz - 1e-6)

        actions = found.get("actions")
        known = 0
        if actions is not None:
            known = max(1, round((actions.stack_s or 0.0) * env.action_frequency_hz))
        body = steps("proprioception")
        if known >= body:
            body = known = 0
        return Lag(steps("vision") + recognition, body, known, recognition)

    def reached(self, share: float) -> Lag:
        """Return the lag of senses that are on their way to being so late, by a share of it."""
        return replace(self, game=round(share * self.game), body=round(share * self.body))

    @property
    def none(self) -> bool:
        """Return whether nothing is delayed and no action is observed."""
        return self == Lag()

    @property
    def longest(self) -> int:
        """User steps back to the oldest observed state."""
        return max(self.game, self.body)


@dataclass(frozen=True)
class Layout:
    """Layout of an observation: columns of all numbers of a moment (the body's, then the game's).

    Attributes:
        names: of its entries.
        felt: columns with the delay of proprioception; numbers, or a tensor of them.
        seen: columns with the delay of vision, likewise.
        actions: number of last user steps whose actions follow, the newest first.
        lag: the delays.
    """

    names: tuple[str, ...]
    felt: Any
    seen: Any
    actions: int
    lag: Lag

    def assemble(
        self,
        at: Callable[[int], Any],
        did: Callable[[int], Any],
        join: Callable[[list[Any]], Any],
        pictured: Any = None,
    ) -> Any:
        """Return (B, F) observations.

        Args:
            at: number of user steps back -> (B, M) all numbers of that time.
            did: number of user steps back, from 1 -> (B, A) actions of that step.
            join: concatenates (B, .) arrays.
            pictured: (B, M) all numbers of the frame that is seen now; None: those of a whole
                number of user steps back, the lag.
        """
        if pictured is None:
            pictured = at(self.lag.game)
        parts = [at(self.lag.body)[:, self.felt], pictured[:, self.seen]]
        return join([*parts, *(did(back + 1) for back in range(self.actions))])


class PrivilegedSenses:
    """Privileged observations of the teachers of N users.

    Args:
        simulation: users whose apps run in this process. If senses are delayed, its states are
            recorded from its next reset on.
        hidden: patterns of names that are left out.
        felt: patterns of the game's numbers that proprioception also reports.
        lag: delays of the observations.
    """

    name = "teacher's knowledge"

    def __init__(
        self,
        simulation: Simulation,
        hidden: Sequence[str],
        *,
        felt: Sequence[str] = (),
        lag: Lag = Lag(),
    ) -> None:
        self._simulation = simulation
        self._batch: Any = simulation.apps[0].batch  # type: ignore[attr-defined]
        self.names: tuple[str, ...] = self._batch.privileged_names
        own = simulation.proprioception.names
        self._who = tuple(f"person {name}" for name in FEATURES) if simulation.people else ()
        self._own = len(own) + len(self._who)
        self.everything = (*own, *self._who, *self.names)
        """Names of all numbers of a moment: the body's, the person's, then the game's."""
        everything = self.everything
        shown = [i for i, name in enumerate(everything) if not _matches(name, hidden)]
        out_own = [i for i in shown if i < self._own]
        game = [i for i in shown if i >= self._own]
        tool = [i for i in game if lag.body != lag.game and _matches(everything[i], felt)]
        did = [
            f"{name}, {back} back"
            for back in range(1, lag.actions + 1)
            for name in self._simulation.actions.names
        ]
        self.layout = Layout(
            names=(
                *(everything[i] for i in out_own),
                *(f"felt {everything[i]}" for i in tool),
                *(everything[i] for i in game),
                *did,
            ),
            felt=(*out_own, *tool),
            seen=tuple(game),
            actions=lag.actions,
            lag=lag,
        )
        self.size = len(self.layout.names)
        self._lag = lag
        self._memory: _Memory | None = None
        if not lag.none:
            self._memory = _Memory(simulation, self._now, self._drawn, len(self.everything), lag)
            simulation.watch(self._memory)

    @property
    def space(self) -> spaces.Dict:
        """``{"teacher": (size,) float32}``."""
        return spaces.Dict({OBSERVATION: _numbers(self.size)})

    @property
    def observed_names(self) -> tuple[str, ...]:
        """A name for every entry of an observation."""
        return self.layout.names

    def be_late(self, share: float) -> None:
        """Set the teachers' delays to a share of their lag, 1 at first."""
        self.layout = replace(self.layout, lag=self._lag.reached(share))

    def values(self) -> NDArray[np.float32]:
        """(N, F) all present privileged numbers, a copy."""
        values: NDArray[np.float32] = self._batch.privileged.copy()
        return values

    def field(self, name: str) -> NDArray[np.float32]:
        """(N,) the present values of one privileged number, a copy."""
        values: NDArray[np.float32] = self._batch.privileged[:, self.names.index(name)].copy()
        return values

    def seen(self, name: str) -> NDArray[np.float32]:
        """Return a privileged number at the time of the image that is recognised now, (N,)."""
        if self._memory is None:
            return self.field(name)
        column = self._own + self.names.index(name)
        pictured = self._memory.pictured()
        if pictured is None:
            pictured = self._memory.at(self._lag.game)
        return pictured[:, column].copy()

    def observe(self) -> NDArray[np.float32]:
        """(N, size) float32, fresh."""
        memory, pictured = self._memory, None
        if memory is None:
            now = self._now()
            at, did = (lambda back: now), (lambda back: now)
        else:
            at, did = memory.at, memory.did
            if self.layout.lag == self._lag:
                pictured = memory.pictured()

        def join(parts: list[Any]) -> NDArray[np.float32]:
            return np.concatenate(parts, axis=1, dtype=np.float32)

        observed: NDArray[np.float32] = self.layout.assemble(at, did, join, pictured)
        return observed

    def _now(self) -> NDArray[np.float32]:
        """(N, M) all numbers of the present moment."""
        simulation = self._simulation
        parts = [simulation.proprioception.observe(simulation.users), self._batch.privileged]
        if self._who:
            parts.insert(1, simulation.person_features)
        return np.concatenate(parts, axis=1, dtype=np.float32)

    def _drawn(self, now: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, M) the same with the game's numbers of the frame that was drawn."""
        return np.concatenate([now[:, : self._own], self._batch.privileged_drawn], axis=1)


class _Memory(RowState):
    """The last states and actions of N users, recorded as a ``Sense``.

    A user with delayed vision sees a frame of some time within a user step (``Delayed``). The
    teacher observes the state in that same frame: with a state some hundredths of a second earlier
    or later, the teacher's actions would not follow from anything that the student sees.
    """

    _state = ("_moments", "_actions", "_pictured")

    name, pauses, frame = "teacher's memory", (), -1
    needs: str | None = None

    def __init__(
        self,
        simulation: Simulation,
        now: Callable[[], NDArray[np.float32]],
        drawn: Callable[[NDArray[np.float32]], NDArray[np.float32]],
        size: int,
        lag: Lag,
    ) -> None:
        self._recognition = lag.recognition
        self._now, self._drawn, self.space = now, drawn, _numbers(size)
        actions = _numbers(len(simulation.actions.names))
        self._moments = Ring(self.name, simulation.n, self.space, lag.longest)
        self._actions = Ring(self.name, simulation.n, actions, max(0, lag.actions - 1))
        self._pictured: Ring | None = None
        self._pictures = simulation.late_pictures
        if self._pictures is not None:
            back = self._pictures.longest_back + lag.recognition
            self._pictured = Ring(self.name, simulation.n, self.space, back)

    def reset(self, ids: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        for ring in (self._moments, self._actions, self._pictured):
            if ring is not None:
                ring.forget(ids)

    def sample(self, moment: StepContext, substep: int) -> None:
        """Do nothing: whole user steps are recorded."""

    def take(self, moment: StepContext, ids: NDArray[np.int64] | None) -> None:
        rows = slice(None) if ids is None else ids
        now = self._now()
        self._moments.push(now[rows], ids)
        self._actions.push(moment.actions[rows].astype(np.float32), ids)
        if self._pictured is not None:
            self._pictured.push(self._drawn(now)[rows], ids)

    def observe(self) -> NDArray[np.float32]:
        newest: NDArray[np.float32] = self._moments.newest()
        return newest

    def at(self, back: int) -> NDArray[np.float32]:
        """Return all numbers of a number of user steps ago, (N, M)."""
        values: NDArray[np.float32] = self._moments.ago(back)
        return values

    def pictured(self) -> NDArray[np.float32] | None:
        """Return all numbers of the recognised frames, (N, M); None if vision is undelayed."""
        if self._pictured is None or self._pictures is None:
            return None
        back = self._pictures.steps_back + self._recognition
        values: NDArray[np.float32] = self._pictured.ago(back)
        return values

    def did(self, back: int) -> NDArray[np.float32]:
        """Return the actions of the last user step (1), or of one before, (N, A)."""
        values: NDArray[np.float32] = self._actions.ago(back - 1)
        return values


def _numbers(size: int) -> spaces.Box[Any]:
    """Any float32 numbers."""
    limit = float(np.finfo(np.float32).max)
    return float_space(-limit, limit, size)


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)
