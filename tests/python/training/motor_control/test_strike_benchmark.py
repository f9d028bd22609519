"""Measures of pushes, against paths whose passages are known."""

from __future__ import annotations

import numpy as np
import pytest

from sim2vr_harness.training.motor_control.strike_benchmark import _forward, passages


def test_passages_are_found_where_and_as_fast_as_they_are() -> None:
    """At 0.5 s and 1 m/s, 1 cm beside; at 0.6 m/s, 4 cm beside; and one that turns before."""
    t = np.arange(0.0, 1.2, 0.01)[:, None]
    x, y = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    tip = np.stack(
        [(t - 0.495) * x + 0.01 * y, 0.6 * (t - 0.495) * x - 0.04 * y, -0.1 - abs(t - 0.5) * x]
    )
    hand = tip * [0.9, 1.0, 1.0]
    found = passages(tip, hand, np.zeros((3, 3)), np.repeat(x, 3, 0))
    assert found.number.tolist() == [0, 1]
    assert found.time_s == pytest.approx([0.5, 0.5])
    assert found.beside_m == pytest.approx([0.01, 0.04])
    assert found.tip_mps == pytest.approx([1.0, 0.6])
    assert found.hand_mps == pytest.approx([0.9, 0.54])
    summary = found.summary()
    assert summary["strike_inside"] == summary["strike_inside_and_fast"] == 0.5
    assert summary["strike_first_hits"] == summary["strike_hits_in_1s"] == pytest.approx(1 / 3)
    assert summary["strike_time_s"] == pytest.approx(0.5)


def test_forward_is_the_turned_x_axis() -> None:
    """A quarter turn about z turns x to y; about y to minus z."""
    half = 0.5**0.5
    turned = np.array([[1.0, 0, 0, 0], [half, 0, 0, half], [half, 0, half, 0]])
    np.testing.assert_allclose(_forward(turned), [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-12)
