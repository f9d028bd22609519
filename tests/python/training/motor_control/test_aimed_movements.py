"""Aimed movements of motor policies, against numbers worked out by hand."""

import numpy as np
import pytest

from sim2vr_harness.training.motor_control.aimed_movements import (
    AimedMovements,
    _profile,
)


def movements(distance_m: list[float], width_m: list[float], time_s: object) -> AimedMovements:
    """Ten movements in each cell that end in the middle of their targets, and profiles of 1.9."""
    cells = len(distance_m)
    ones = np.ones((cells, 10))
    way = np.zeros((cells, 10, 3))
    way[..., 0] = np.array(distance_m)[:, None]
    profile = np.tile([1.9, 0.4, 0.9, 1.0], (cells, 10, 1))
    times = np.array(time_s)[:, None] * ones
    nominal = np.array(distance_m), np.array(width_m)
    return AimedMovements(*nominal, times, ones, np.zeros_like(way), way, profile, ones)


def test_a_profile_s_measures_are_those_of_minimum_jerk() -> None:
    """Above 10 % of its peak, a minimum-jerk reach has peak over mean 1.57, and it is symmetric."""
    t = np.linspace(0.0, 1.0, 101)
    s = 10 * t**3 - 15 * t**4 + 6 * t**5
    way = np.concatenate([np.zeros(20), s, np.ones(20)]) - 1.0
    path = way[:, None] * [0.3, 0.0, 0.0]
    onset, profile, peak = _profile(path, len(path) - 1)
    assert onset == pytest.approx(28, abs=1)
    assert peak == pytest.approx(1.875 * 0.3, rel=0.01)
    assert profile.tolist() == pytest.approx([1.57, 0.5, 1.0, 1.0], abs=0.02)


@pytest.mark.parametrize("drift_mps", [-0.15, 0.15])
def test_a_hand_that_drifts_reacts_when_its_movement_begins(drift_mps: float) -> None:
    """The hand drifts along and across the way until the reach takes over after 0.2 s.

    A minimum-jerk reach of 30 cm in 0.6 s has 10 % of its peak (0.94 m/s) after 0.09 of its time,
    so the onset is at 0.2 s + 0.05 s, and its peak at .5 of what is above 10 %. The speed itself,
    whatever its direction, is above 10 % of the peak from the appearance on.
    """
    t = np.arange(0.01, 1.2, 0.01)
    part = np.clip((t - 0.2) / 0.6, 0.0, 1.0)
    speed = 30.0 * part**2 * (1.0 - part) ** 2 * 0.3 / 0.6
    fades = drift_mps * np.clip((0.8 - t) / 0.6, 0.0, 1.0)
    steps = np.stack([speed + fades, fades, np.zeros_like(t)], 1) * 0.01
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]) - [0.3, 0.0, 0.0]
    onset, profile, _ = _profile(path, len(path) - 1)
    assert 0.01 * onset == pytest.approx(0.25, abs=0.02)
    assert profile[1] == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize("width_m", [0.04, np.nan])
def test_throughput_is_that_of_the_effective_index(width_m: float) -> None:
    """End points +- .01 / 4.133 m along the way and a mean of .31 m: log2(32) = 5 bits in .5 s.

    The nominal index, of targets 4 cm wide, is log2(8.75) = 3.1 bits.
    """
    aimed = movements([0.31], [width_m], [0.5])
    aimed.end[0, :, 0] = 0.01 / 4.133 * np.tile([1.0, -1.0], 5)
    aimed.end[0, :, 2] = 0.03  # beside the way: no part of the spread along it
    assert aimed.effective == pytest.approx([5.0])
    assert aimed.summary()["throughput_bits_per_s"] == pytest.approx(10.0)
    assert aimed.difficulty == pytest.approx([5.0 if np.isnan(width_m) else np.log2(8.75)])
    error_m = np.hypot(0.01 / 4.133, 0.03)
    assert aimed.summary()["endpoint_error_m_median"] == pytest.approx(error_m)
    assert aimed.summary().get("error_rate", 1.0) == 1.0  # all are beside 4 cm


def test_fitts_law_is_found_in_movements_that_follow_it() -> None:
    """.1 + .2 s/bit at 1, 2 and 3 bits; a fifth ends 2 cm beside targets of 1 cm."""
    aimed = movements([0.01, 0.03, 0.07], [0.01] * 3, [0.3, 0.5, 0.7])
    aimed.time_s[:, 0] -= 1e-6
    aimed.end[:, ::5, 1] = 0.02
    found = aimed.summary()
    assert found["fitts_slope_s_per_bit"] == pytest.approx(0.2, abs=1e-4)
    assert found["fitts_intercept_s"] == pytest.approx(0.1, abs=1e-3)
    assert found["fitts_r2"] == pytest.approx(1.0)
    assert found["error_rate"] == pytest.approx(0.2)
    assert found["peak_over_mean"] == pytest.approx(1.9)
    assert found["peak_speed_0.03m_mps"] == 1.0
    aimed.time_s[0, :5], aimed.end[0, :5] = np.nan, np.nan  # movements that do not end
    assert aimed.summary()["unended_rate"] == pytest.approx(5 / 30)
