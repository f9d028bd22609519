"""Estimates of time: exploration is fast, learning is not, and something follows."""

from __future__ import annotations

import pytest

from sim2vr_harness.training.option_q_learning.pace import Pace


def test_what_is_left_is_exploration_learning_and_comparisons() -> None:
    """20 of 100 decisions explore in 0.1 s, 80 learn for 0.3 s more, 30 compare manners.

    A user step takes 0.02 s, deciding once in 3 steps the other 0.04 s. Each duration plays 60
    steps: 1.2 s, and 60, 20 or 12 decisions of 0.04 s.
    """
    durations = [(60, 1), (60, 3), (60, 5)]
    end_s = 3 * 1.2 + (60 + 20 + 12) * 0.04
    pace = Pace(20, 100, compared=30, durations=durations, hold=3, step_s=0.02)
    for done in range(1, 11):
        pace.note(done, 0.1)
    pace.update_s = 0.3
    assert pace.left_s(10) == pytest.approx(10 * 0.1 + 80 * 0.4 + 30 * 0.1 + end_s)
    # Learning beside playing is faster than one after the other.
    pace.compared = 0
    for done in range(22, 41):
        pace.note(done, 0.32)
    assert pace.left_s(40) == pytest.approx(60 * 0.32 + end_s)
    assert pace.left_s(100) == pytest.approx(end_s)


def test_a_resumed_stage_has_learned_from_the_first_decision_on() -> None:
    pace = Pace(explored=20, decisions=100)
    pace.note(50, 0.5)
    assert pace.left_s(50) == pytest.approx(25.0)
