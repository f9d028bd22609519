"""The store of what a student has seen: pictures in files, the last frames only if told so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.training.dagger.dataset import FrameStore

SHAPES = {"vision": ((1, 2, 3), np.uint8), "label": ((2,), np.float32)}


def append(store: FrameStore, frames: int) -> None:
    """Two at a time; everything in frame k is k."""
    for k in range(store.count, store.count + frames, 2):
        number = np.array([k, k + 1])
        picture = np.broadcast_to(number[:, None, None, None], (2, 1, 2, 3)).astype(np.uint8)
        label = np.broadcast_to(number[:, None], (2, 2)).astype(np.float32)
        store.append({"vision": picture, "label": label})


def test_a_store_that_keeps_all_knows_every_frame(tmp_path: Path) -> None:
    store = FrameStore(tmp_path, 8, SHAPES)
    append(store, 8)
    assert (store.first, store.count) == (0, 8)
    rows = store.rows(np.array([0, 3, 7]))
    assert rows["vision"][:, 0, 1, 2].tolist() == [0, 3, 7]
    assert rows["label"][:, 1].tolist() == [0.0, 3.0, 7.0]


def test_a_store_that_goes_round_knows_the_last_frames(tmp_path: Path) -> None:
    store = FrameStore(tmp_path, 4, SHAPES, slack=2)
    append(store, 20)
    assert (store.first, store.count) == (16, 20)
    rows = store.rows(np.arange(16, 20))
    assert rows["vision"][:, 0, 0, 0].tolist() == [16, 17, 18, 19]
    assert rows["label"][:, 0].tolist() == [16.0, 17.0, 18.0, 19.0]
    assert (tmp_path / "frames.vision.bin").stat().st_size == 6 * 6


@pytest.mark.parametrize("later", [0, 2])
def test_a_stopped_store_goes_on_with_the_frames_of_its_state(tmp_path: Path, later: int) -> None:
    """What was written after the state was taken, in the slack, is not missed."""
    store = FrameStore(tmp_path, 4, SHAPES, slack=2)
    append(store, 14)
    state = {key: value.copy() for key, value in store.state().items()}
    append(store, later)
    again = FrameStore(tmp_path, 4, SHAPES, slack=2)
    again.restore(14, state)
    assert (again.first, again.count) == (10, 14)
    rows = again.rows(np.arange(10, 14))
    assert rows["vision"][:, 0, 1, 1].tolist() == [10, 11, 12, 13]
    assert rows["label"][:, 1].tolist() == [10.0, 11.0, 12.0, 13.0]
