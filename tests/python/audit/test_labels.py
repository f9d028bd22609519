"""Labels of the audit's view in space."""

from __future__ import annotations

import numpy as np
import pytest

from sim2vr_harness.audit.report import VIEWS, labels_of, screen


def test_places_apart_have_their_names() -> None:
    places = np.array([[-1.0, 1.0, 0.5], [1.0, 1.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 0.5]])
    assert labels_of(places, ["a", "b", "c", "d"]) == ["a", "b", "c", "d"]


def test_close_places_share_a_label() -> None:
    keys = np.array([[0.01 * k, 1.0, 0.5] for k in range(9)])
    places = np.vstack([keys, [[-1.0, 1.5, 1.0]]])
    found = labels_of(places, [*(f"key {k + 1}" for k in range(9)), "door"])
    assert found == ["key 1 and 8 more", *[""] * 8, "door"]


@pytest.mark.parametrize("view", VIEWS)
def test_no_labels_overlap(view: tuple[float, float]) -> None:
    places = np.random.default_rng(3).uniform([-1, 0, 0], [1, 2, 1], (40, 3))
    labels = labels_of(places, [f"target {k}" for k in range(40)])
    shown = [k for k, label in enumerate(labels) if label]
    assert 3 < len(shown) < 40
    seen = screen(places, *view) / np.ptp(places, axis=0).max()
    for i in shown:
        for j in shown[: shown.index(i)]:
            gap = np.abs(seen[i] - seen[j])
            letters = (len(labels[i]) + len(labels[j])) / 2
            assert gap[0] >= 0.02 * letters or gap[1] >= 0.05


def test_a_camera_in_front_sees_right_and_up() -> None:
    places = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert screen(places, -90.0, 0.0) == pytest.approx(
        np.array([[1, 0], [0, 1], [0, 0]]), abs=1e-12
    )
    assert screen(places, 0.0, 0.0)[2] == pytest.approx([1.0, 0.0])
