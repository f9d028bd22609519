"""Progress of Q-learning: its report, and an estimate of the remaining time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

_LAST = 50
"""Decisions whose mean is taken."""


class Pace:
    """Adds up the time of all that is left of the stage.

    Exploring decisions are played, later ones are learned from too. Decisions that compare manners
    of hands come in between, those that compare durations of decisions after the last.

    Args:
        explored: decisions that are made before the learning begins.
        decisions: of the whole stage.
        compared: decisions that compare manners of hands.
        durations: user steps of each user that compare a duration of decisions, and that duration
            in user steps; one for each.
        hold: user steps of a decision of the stage.
        step_s: how long a user step of all users takes without deciding; 0: not known.
    """

    def __init__(
        self,
        explored: int,
        decisions: int,
        *,
        compared: int = 0,
        durations: Sequence[tuple[int, int]] = (),
        hold: int = 1,
        step_s: float = 0.0,
    ) -> None:
        self._explored, self._decisions = explored, decisions
        self.compared = compared
        self._durations, self._hold, self._step_s = durations, hold, step_s
        self._played: deque[float] = deque(maxlen=_LAST)
        self._learned: deque[float] = deque(maxlen=_LAST)
        self.update_s = 0.0
        """How long the learning of a decision takes, as far as none has been learned from."""

    def note(self, done: int, seconds: float) -> None:
        """Note how long the last decision took.

        Args:
            done: decisions made by then.
            seconds: of the last one.
        """
        (self._learned if done > self._explored + 1 else self._played).append(seconds)

    @property
    def decision_s(self) -> float:
        """How long a decision takes that is learned from."""
        if self._learned:
            return sum(self._learned) / len(self._learned)
        return self._played_s + self.update_s

    @property
    def _played_s(self) -> float:
        if not self._played:
            return max(0.0, self.decision_s - self.update_s) if self._learned else 0.0
        return sum(self._played) / len(self._played)

    def left_s(self, done: int) -> float:
        """Return how long it takes still when so many decisions are made."""
        exploring = max(0, min(self._explored, self._decisions) - done)
        learning = max(0, self._decisions - done - exploring)
        step_s = min(self._step_s, self._played_s / self._hold)
        deciding_s = self._played_s - self._hold * step_s
        end_s = sum(steps * (step_s + deciding_s / hold) for steps, hold in self._durations)
        alone = exploring + self.compared
        return alone * self._played_s + learning * self.decision_s + end_s


@dataclass(frozen=True)
class QLearningReport:
    """Progress of the Q-learning.

    Attributes:
        step: user steps of all users so far.
        reward: mean reward per minute, effort taken off, over the last ones.
        loss: of the values.
        explore: proportion of exploratory decisions.
    """

    step: int
    reward: float
    loss: float
    explore: float
