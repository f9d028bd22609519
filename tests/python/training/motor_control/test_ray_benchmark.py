"""Measures of rays: what is counted, and that the persons who ship have rays on their targets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.policies.hierarchical.motor_store import human_policy_for
from sim2vr_harness.training.motor_control import ray_benchmark
from sim2vr_harness.training.motor_control.human_benchmark import AimedMovements, HumanMeasures
from sim2vr_harness.training.motor_control.ray_benchmark import RayMeasures, measure_rays


def test_rays_are_on_target_within_half_its_width() -> None:
    """.3 + .4 s/bit in angles; of the last rays one in four is 10 degrees off, others 0.5."""
    cells, off = [], []
    for bits in (1.0, 2.0, 3.0):
        width = math.radians(2.0)
        end, ones = np.zeros((8, 3)), np.ones(8)
        times = 0.3 + 0.4 * bits + 1e-6 * np.arange(8)
        profile = np.tile([1.9, 0.4, 0.9, 1.0], (8, 1))
        distance = width * (2**bits - 1)
        way = np.tile([distance, 0.0, 0.0], (8, 1))
        cells.append(AimedMovements(distance, width, times, 0.2 * ones, end, way, profile, ones))
        off.append(np.radians(np.tile([10.0, 0.5, 0.5, 0.5], 2)))
    measures = RayMeasures(HumanMeasures(tuple(cells)), tuple(off))
    found = measures.summary()
    assert found["ray_fitts_slope_s_per_bit"] == pytest.approx(0.4, abs=1e-4)
    assert found["ray_fitts_intercept_s"] == pytest.approx(0.3, abs=1e-3)
    assert found["ray_error_rate"] == 0.0
    assert found["ray_on_target"] == pytest.approx(0.75)
    assert found["ray_stuck_rate"] == pytest.approx(0.25)
    assert found["ray_off_deg"] == pytest.approx(0.5)
    assert measures.rows()[1].startswith("2.00 bits (ray, 6 degrees, width 2.0 degrees): 1.10 s")


def test_persons_bring_their_rays_to_targets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six persons, 15 degrees to targets of 6: rays are there after 2 s, and most ended there."""
    monkeypatch.setattr(ray_benchmark, "DISTANCES_DEG", (5.0, 15.0))
    monkeypatch.setattr(ray_benchmark, "WIDTHS_DEG", (6.0,))
    user = as_population(UserConfig())
    policy = human_policy_for(user, 0.05)
    found = measure_rays(policy, user, persons=6, repeats=1, threads=1, seed=2)
    off, cells = np.concatenate(found.off_rad), found.movements.cells
    assert np.degrees([cell.distance_m for cell in cells]).tolist() == pytest.approx([5.0, 15.0])
    starts = np.degrees(np.linalg.norm(cells[1].way, axis=1))
    assert np.median(starts) == pytest.approx(15.0, abs=2.0)
    assert (np.degrees(off) < 3.0).mean() >= 0.8
    assert np.mean([cell.missed for cell in cells]) <= 0.4
