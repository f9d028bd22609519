"""Measures of motor layers, against numbers worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.training.motor_control.benchmark import (
    BenchmarkMovements,
    MotorMeasures,
    measure_layer,
)
from sim2vr_harness.training.motor_control.benchmark_figure import draw_measures
from sim2vr_harness.users import load_body


def aimed(
    distance_m: float, time_s: float, spread_m: float, count: int = 400
) -> BenchmarkMovements:
    """Hands that go ahead, and end as far on average, with such a standard deviation."""
    ends = np.zeros((count, 3))
    ends[:, 0] = distance_m + spread_m * np.where(np.arange(count) % 2, 1.0, -1.0)
    ends[:, 1] = 0.01  # beside the way: no part of the spread along it
    goal = np.tile([distance_m, 0.0, 0.0], (count, 1))
    nothing = np.full(count, np.nan)
    still = np.zeros((count, 3))
    times = np.full(count, time_s)
    return BenchmarkMovements(still, goal, still, times, ends, still, nothing, nothing, nothing)


def test_difficulties_are_iso_9241_s() -> None:
    """W = 4.133 spreads = 0.01 m; log2(0.31 / 0.01 + 1) = 5 bits, log2(0.07 / 0.01 + 1) = 3."""
    cells = {
        (0.31, 0.6): aimed(0.31, 0.6, 0.01 / 4.133),
        (0.07, 0.4): aimed(0.07, 0.4, 0.01 / 4.133),
    }
    measures = MotorMeasures({0.0: aimed(0.1, 0.5, 0.0)}, aimed(0.1, 0.4, 0.0), cells)
    bits, times = measures.difficulties()
    np.testing.assert_allclose(bits, [5.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(times, [0.6, 0.4])
    line = measures.fitts()
    assert line["b_s_per_bit"] == pytest.approx(0.1)
    assert line["a_s"] == pytest.approx(0.1)
    assert line["r2"] == pytest.approx(1.0)
    assert line["throughput_bits_per_s"] == pytest.approx((5.0 / 0.6 + 3.0 / 0.4) / 2)


def test_errors_are_those_of_end_points_and_velocities() -> None:
    one = aimed(0.2, 0.4, 0.03, count=4)
    np.testing.assert_allclose(one.error_m, np.hypot(0.03, 0.01))
    asked = BenchmarkMovements(**{**vars(one), "velocity": np.tile([3.0, 0.0, 0.0], (4, 1))})
    np.testing.assert_allclose(asked.speed_error_mps, 3.0)


def test_a_layer_that_has_learned_nothing_is_measured_and_drawn(tmp_path: Path) -> None:
    layer = MotorPolicy(load_body("mobl_arms_wrist"), 0.05, width=8).requires_grad_(False)
    first, again = (measure_layer(layer, bodies=16, threads=1, seed=2) for _ in range(2))
    numbers = first.summary()
    assert numbers == again.summary()
    assert numbers["reach_0cm_tool_error_m_median"] > 0.1  # nobody told the hand to come
    assert numbers["hold_effort_over_least"] > 0.0
    for goal in first.reaches[0.0].goal:  # within the arm's reach of the shoulder, before it
        assert goal[0] > 0.15
        assert np.linalg.norm(goal - [0.0, -0.17, 1.4]) < 1.0
    far = np.linalg.norm(first.aimed[0.4, 0.3].goal - first.aimed[0.4, 0.3].start, axis=1)
    assert np.median(np.abs(far - 0.4)) < 0.01
    assert draw_measures(first, "nothing learned", tmp_path / "layer.png").stat().st_size > 20_000
