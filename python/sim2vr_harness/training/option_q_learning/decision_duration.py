"""For how long decisions are seen through: candidates play, and the best is taken."""

from __future__ import annotations

import time

from sim2vr_harness.training.option_q_learning.q_learning import DECIDE_STEPS, OptionQLearning
from sim2vr_harness.training.run.progress import View
from sim2vr_harness.training.run.stage import Callbacks

_CANDIDATES, _PLAY_S = (1, 3, 5), 128.0
"""Candidate user steps for which a choice is kept, and seconds of play of all users together that
compare them: 4 to 10 of each."""


def durations() -> list[int]:
    """Return the candidates, user steps."""
    return sorted({*_CANDIDATES, DECIDE_STEPS})


def duration_steps(users: int, steps_per_s: float) -> int:
    """Return user steps of each user that compare durations of decisions: more of few users."""
    return max(1, round(min(max(4.0, _PLAY_S / users), 10.0) * steps_per_s))


def best_duration(learner: OptionQLearning, callbacks: Callbacks) -> int:
    """Return for how many user steps it pays to see decisions through."""
    callbacks.doing("durations of decisions")
    began, taken = time.monotonic(), learner.step_count
    steps = duration_steps(learner.n, learner.simulation.config.action_frequency_hz)
    candidates = durations()
    count, earned = len(candidates), {}
    for number, hold in enumerate(candidates):

        def show(share: float, done: int = number) -> None:
            doing = f"measuring {count} durations of decisions, {done + 1} of {count}"
            _show_end(callbacks, taken, doing, (done + share) / count, began)

        earned[hold] = learner.earned(hold, steps, on_progress=show)
    best = max(candidates, key=lambda hold: earned[hold])
    found = ", ".join(f"{earned[hold]:.2f} for {hold}" for hold in candidates)
    callbacks.say(
        f"Reward per minute by how many user steps a decision is seen through: {found}. "
        f"The user's: {best}."
    )
    return best


def _show_end(callbacks: Callbacks, taken: int, doing: str, share: float, began: float) -> None:
    """Show how far the measurement at the end of the stage is, a line at its beginning."""
    left = (time.monotonic() - began) * (1.0 - share) / share if share > 0.0 else None
    callbacks.show(lambda: View(taken, doing, left), force=share == 0.0)
