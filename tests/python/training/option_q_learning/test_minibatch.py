"""Preferred decisions, and what they weigh."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.runs.option_config import SkillsConfig
from sim2vr_harness.training.option_q_learning.q_learning import ValueLearner, draw_decisions
from sim2vr_harness.training.option_q_learning.stage import best_vigour


def test_a_quarter_came_before_a_reward_and_weighs_less() -> None:
    """One of 2 users is rewarded after the 12th of 20 decisions: 3 of 18 x 2 led to it.

    Preferred draws take each with 1/3, all draws alike with 1/36: with a quarter of them, it is
    3/4 + 1/4 x 12 = 15/4 times as likely as without. All others are 3/4 times as likely.
    """
    rewarded = np.zeros((20, 2), bool)
    rewarded[11, 1] = True
    rows, users, weights = draw_decisions(rewarded, 4000, np.random.default_rng(3))
    assert set(rows[:1000]) == {9, 10, 11} and set(users[:1000]) == {1}
    assert np.bincount(rows[1000:], minlength=18) == pytest.approx(np.full(18, 3000 / 18), abs=50)
    led = (users == 1) & np.isin(rows, [9, 10, 11])
    assert weights[led] == pytest.approx(4 / 15) and weights[~led] == pytest.approx(4 / 3)
    assert weights.mean() == pytest.approx(1.0, abs=0.02)


def test_a_round_that_is_cut_off_is_worth_what_would_follow() -> None:
    """Rewards 1, 2, 4 at a discount of .85: 1 + 1.7 + 2.89 = 5.59, and .85^3 of the value."""
    ends = [
        "goes on",
        "over after two",
        "cut in the third",
        "cut in the second",
        "cut in the first",
    ]
    over, cut = np.zeros((2, 4, len(ends)), bool)
    over[1, 1] = over[2, 2] = over[1, 3] = over[0, 4] = True
    cut[2, 2] = cut[1, 3] = cut[0, 4] = True
    reward = np.tile(np.array([[1.0], [2.0], [4.0], [8.0]], np.float32), (1, len(ends)))
    kept = {"over": over, "cut": cut, "reward": reward}
    learner: Any = SimpleNamespace(
        decisions=SimpleNamespace(read=lambda name, *at: kept[name][at]), scale=1.0
    )
    users = np.arange(len(ends))
    total, weight, last, known = ValueLearner.returns(learner, np.zeros_like(users), users)
    np.testing.assert_allclose(total[:4], [5.59, 2.7, 2.7, 1.0], rtol=1e-6)
    np.testing.assert_allclose(weight[:4], [0.614125, 0.0, 0.7225, 0.85], rtol=1e-6)
    assert last[[0, 2, 3]].tolist() == [3, 2, 1]
    assert known.tolist() == [True, True, True, True, False]


def test_the_best_vigour_is_the_top_of_a_parabola_by_its_logarithm() -> None:
    """100 - 3 (log2 v - 3)^2 has its top at 8, log2 v + 5 rises to the largest."""
    vigours = (1.0, 2.0, 16.0, 32.0)
    assert best_vigour({v: 100 - 3 * (np.log2(v) - 3) ** 2 for v in vigours}) == pytest.approx(8.0)
    assert best_vigour({v: np.log2(v) ** 2 for v in vigours}) == 32.0
    assert best_vigour({v: 9 - 3 * (np.log2(v) - 7) ** 2 for v in vigours}) == pytest.approx(32.0)


@pytest.mark.parametrize(
    ("user", "instruction", "weight"),
    [
        ("person", "fast", 1.0),
        ("person", "balanced", 2.25),
        ("person", "accurate", 2.25**2),
        ("hierarchical", "accurate", 1.0),
    ],
)
def test_the_instruction_says_how_much_losses_weigh(
    user: str, instruction: str, weight: float
) -> None:
    assert SkillsConfig(user=user, instruction=instruction).loss_weight == weight
