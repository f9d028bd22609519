from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sim2vr_harness.perception import HeadsetVision


def _images(*levels: int) -> np.ndarray:
    """One flat RGBA picture per user, with channel c at level + c."""
    flat = np.array(levels, dtype=np.uint8)[:, None, None, None] + np.arange(4, dtype=np.uint8)
    return np.broadcast_to(flat, (len(levels), 80, 120, 4)).copy()


def _levels(seen: np.ndarray) -> list[list[int]]:
    assert (seen == seen[:, :, :1, :1]).all()
    return seen[:, :, 0, 0].tolist()


def test_channels_are_picked_in_order() -> None:
    vision = HeadsetVision(("green", "depth"), n=2)
    seen = vision.observe(_images(10, 20))
    assert seen.shape == (2, 2, 80, 120)
    assert seen.dtype == np.uint8
    assert seen.flags.c_contiguous
    assert _levels(seen) == [[11, 13], [21, 23]]
    assert vision.observation_space.shape == (2, 80, 120)
    assert vision.observation_space.contains(seen[0])
    assert _levels(HeadsetVision(("blue", "red")).observe(_images(0))) == [[2, 0]]


def test_rows_and_columns_keep_their_place() -> None:
    images = np.zeros((1, 80, 120, 4), np.uint8)
    images[0, 3, 7, 3] = 200  # depth at row 3 from the top, column 7
    seen = HeadsetVision(("depth",)).observe(images)
    assert seen[0, 0, 3, 7] == 200
    assert seen.sum() == 200


def test_buffer_holds_newest_then_oldest() -> None:
    vision = HeadsetVision(("red",), 0.2)
    assert vision.frames == 5
    assert vision.observation_space.shape == (2, 80, 120)
    pairs = [_levels(vision.observe(_images(k)))[0] for k in range(10, 18)]
    # The first picture fills the buffer; from the fifth on, the old one is 4 steps = 0.2 s old.
    assert pairs == [[10, 10], [11, 10], [12, 10], [13, 10], [14, 10], [15, 11], [16, 12], [17, 13]]


def test_reset_refills_one_users_buffer() -> None:
    vision = HeadsetVision(("red",), 0.1, n=2)
    for k in range(5):
        vision.observe(_images(k, 100 + k))
    vision.reset([1])
    assert _levels(vision.observe(_images(5, 50))) == [[5, 3], [50, 50]]
    assert _levels(vision.observe(_images(60), ids=[1])) == [[60, 50]]
    assert _levels(vision.observe(_images(6, 70))) == [[6, 4], [70, 50]]


def test_save_and_restore() -> None:
    vision, other = (HeadsetVision(("red",), 0.1, n=2) for _ in range(2))
    for k in range(4):
        vision.observe(_images(k, 100 + k))
    other.set_state(0, vision.get_state(1))
    assert _levels(other.observe(_images(9), ids=[0])) == [[9, 102]]
    with pytest.raises(ValueError, match="vision state buffer: got shape"):
        other.set_state(0, HeadsetVision(("red",), 0.2).get_state(0))


@pytest.mark.parametrize("buffer_seconds", [None, 0.1])
def test_observations_share_no_memory(buffer_seconds: float | None) -> None:
    vision = HeadsetVision(("red", "green", "blue", "depth"), buffer_seconds)
    images = _images(1)
    first = vision.observe(images)
    images[:] = 99
    second = vision.observe(images)
    assert _levels(first)[0][:4] == [1, 2, 3, 4]
    assert not np.shares_memory(first, second)
    assert not np.shares_memory(second, images)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"channels": ("grene",)}, "channels: got 'grene', expected some of red, green"),
        ({"channels": ()}, r"channels: got \(\), expected each at most once, at least 1"),
        ({"channels": ("red", "red")}, "channels: got .* expected each at most once"),
        ({"buffer_seconds": 0.12}, "buffer_seconds: got 0.12, expected None or a multiple"),
        ({"buffer_seconds": 0.0}, "buffer_seconds: got 0.0"),
        ({"step_seconds": 0.0}, "step_seconds: got 0.0"),
        ({"n": 0}, "n: got 0, expected a whole number"),
    ],
)
def test_wrong_settings(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        HeadsetVision(**settings)


def test_wrong_images() -> None:
    vision = HeadsetVision(n=2)
    with pytest.raises(ValueError, match=r"images: got uint8 \(1, 80, 120, 4\), expected uint8"):
        vision.observe(_images(1))
    with pytest.raises(ValueError, match=r"images: got float64"):
        vision.observe(_images(1, 2).astype(float))
    with pytest.raises(ValueError, match="ids: got 2, expected 0 to 1"):
        vision.observe(_images(1), ids=[2])
