"""Everything that N users perceive: a list of senses, one entry of the observation each."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.perception.sense import IntArray, Sense, StepContext
from sim2vr_harness.perception.wrappers import Delayed


class Perception:
    """The senses of N users.

    Args:
        senses: with different names.
    """

    def __init__(self, senses: Sequence[Sense]) -> None:
        self.senses = tuple(senses)
        self._watching: list[Sense] = []
        self.space = spaces.Dict({sense.name: sense.space for sense in senses})

    @property
    def drawn_frame(self) -> int | IntArray:
        """Which of a step's app frames is to be drawn; -1 the last; (N,) where users differ."""
        for sense in self.senses:
            if not isinstance(sense.frame, int) or sense.frame != -1:
                return sense.frame
        return -1

    @property
    def late_pictures(self) -> Delayed | None:
        """The delay line of what is seen; None where no picture is late."""
        for sense in self.senses:
            inner: Any = sense
            while inner is not None:
                if isinstance(inner, Delayed) and inner.of_pictures:
                    return inner
                inner = getattr(inner, "sense", None)
        return None

    def watch(self, sense: Sense) -> None:
        """Let someone beside the users take in what they go through; no part of the observation.

        Args:
            sense: takes whole steps; its past is saved and restored with the users'.
        """
        self._watching.append(sense)

    @property
    def _all(self) -> tuple[Sense, ...]:
        return (*self.senses, *self._watching)

    @property
    def needs(self) -> dict[str, str]:
        """Capabilities that the apps need -> the sense that stays still without."""
        return {sense.needs: sense.name for sense in self.senses if sense.needs is not None}

    def pauses(self, moment: StepContext) -> dict[int, Callable[[], None]]:
        """For every substep at which something is to be sensed, what to call there."""
        paused: dict[int, list[Sense]] = {}
        for sense in self.senses:
            for substep in sense.pauses:
                paused.setdefault(substep, []).append(sense)

        def call(senses: Sequence[Sense], substep: int) -> Callable[[], None]:
            def sample() -> None:
                for sense in senses:
                    sense.sample(moment, substep)

            return sample

        return {substep: call(senses, substep) for substep, senses in paused.items()}

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """Forgets the past of these users; see :meth:`Sense.reset`."""
        for sense in self._all:
            sense.reset(ids, seeds)

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        """Takes in the end of a step or a reset; see :meth:`Sense.take`."""
        for sense in self._all:
            sense.take(moment, ids)

    def observe(self) -> dict[str, NDArray[Any]]:
        """The observation: fresh arrays, first axis N."""
        return {sense.name: sense.observe() for sense in self.senses}

    def state_dict(self, i: int) -> dict[str, Any]:
        """Everything that user i's future perception depends on."""
        return {sense.name: sense.state_dict(i) for sense in self._all}

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restores what :meth:`state_dict` returned.

        Raises:
            ValueError: the state is of other senses.
        """
        expected = [sense.name for sense in self._all]
        if sorted(state) != sorted(expected):
            raise ValueError(f"state: got the senses {sorted(state)}, expected {sorted(expected)}")
        for sense in self._all:
            sense.load_state_dict(i, state[sense.name])
