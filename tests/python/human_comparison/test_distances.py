"""Distances by hand."""

import numpy as np
import pytest

from sim2vr_harness.statistics.distances import (
    MOST,
    distance,
    inside,
    kolmogorov,
    typical,
    wasserstein,
    wasserstein_ratio,
)


def test_range_and_distance() -> None:
    people = [1.0, 2.0, 3.0]
    assert typical(people) == pytest.approx((1.5 + 0.0 + 1.5) / 3)
    assert distance(5.0, people) == pytest.approx(3.0)
    assert distance(100.0, people) == MOST
    assert distance(2.0, people) == 0.0
    assert distance(2.0, [1.0, 1.0]) == MOST, "people agree"
    assert inside(3.0, people)
    assert not inside(3.01, people)


def test_samples_weigh_persons_alike() -> None:
    short, long = np.zeros(2), np.ones(200)
    assert wasserstein([short, long], [np.zeros(1)]) == pytest.approx(0.5)
    assert kolmogorov([short, long], [np.zeros(1)]) == pytest.approx(0.5)
    assert kolmogorov([np.arange(4.0)], [np.arange(4.0)]) == pytest.approx(0.0)


def test_ratio_is_in_units_of_a_person() -> None:
    people = [np.array([0.0]), np.array([1.0]), np.array([2.0])]
    # A person's distance to the pooled others: 1.5, 1 and 1.5; the user's to all: 4.
    assert wasserstein_ratio([np.array([5.0])], people) == pytest.approx(4.0 / (4.0 / 3.0))
    same = [np.array([1.0]), np.array([1.0])]
    assert wasserstein_ratio([np.array([1.0])], same) == 0.0
    assert wasserstein_ratio([np.array([2.0])], same) == MOST
