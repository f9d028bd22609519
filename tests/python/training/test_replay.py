"""The replay store: pictures in files, the last frames only where it has a slack."""

import copy
import errno
import os
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.training.replay import ReplayStore

SHAPES = {"vision": ((1, 2, 3), np.uint8), "label": ((2,), np.float32)}


def append(store: ReplayStore, frames: int) -> None:
    """Two at a time; everything in frame k is k."""
    for k in range(store.count, store.count + frames, 2):
        number = np.array([k, k + 1])
        picture = np.broadcast_to(number[:, None, None, None], (2, 1, 2, 3)).astype(np.uint8)
        label = np.broadcast_to(number[:, None], (2, 2)).astype(np.float32)
        store.append({"vision": picture, "label": label})


def test_a_store_that_goes_round_knows_the_last_frames(tmp_path: Path) -> None:
    store = ReplayStore(tmp_path / "frames.*.bin", 4, SHAPES, slack=2)
    append(store, 20)
    assert (store.first, store.count) == (16, 20)
    rows = store.rows(np.arange(16, 20))
    assert rows["vision"][:, 0, 0, 0].tolist() == [16, 17, 18, 19]
    assert rows["label"][:, 0].tolist() == [16.0, 17.0, 18.0, 19.0]
    assert (tmp_path / "frames.vision.bin").stat().st_size == 6 * 6


@pytest.mark.parametrize("later", [0, 2])
def test_a_stopped_store_goes_on_with_the_frames_of_its_state(tmp_path: Path, later: int) -> None:
    """What was written after the state was taken, in the slack, is not missed."""
    store = ReplayStore(tmp_path / "frames.*.bin", 4, SHAPES, slack=2)
    append(store, 14)
    state = copy.deepcopy(store.state_dict())
    append(store, later)
    again = ReplayStore(tmp_path / "frames.*.bin", 4, SHAPES, slack=2)
    again.load_state_dict(state)
    assert (again.first, again.count) == (10, 14)
    rows = again.rows(np.arange(10, 14))
    assert rows["vision"][:, 0, 1, 1].tolist() == [10, 11, 12, 13]
    assert rows["label"][:, 1].tolist() == [10.0, 11.0, 12.0, 13.0]


def test_frames_of_several_users_are_read_by_user_and_amended(tmp_path: Path) -> None:
    """A frame holds two users; rewards follow after the pictures."""
    shapes = {"vision": ((2, 1, 2, 3), np.uint8), "reward": ((2,), np.float32)}
    store = ReplayStore(tmp_path / "pictures.bin", 3, shapes)
    for k in range(3):
        vision = np.array([10 * k, 10 * k + 1], np.uint8).reshape(1, 2, 1, 1, 1)
        store.append({"vision": np.broadcast_to(vision, (1, 2, 1, 2, 3))})
        store.amend({"reward": np.array([[k, -k]], np.float32)})
    at = (np.array([2, 0, 1]), np.array([1, 0, 1]))
    assert store.read("vision", *at)[:, 0, 1, 2].tolist() == [21, 0, 11]
    assert store.read("reward", *at).tolist() == [-2.0, 0.0, -1.0]
    assert (tmp_path / "pictures.bin").stat().st_size == 3 * 2 * 6
    assert set(store.state_dict()) == {"count", "reward"}


def test_room_for_all_pictures_is_reserved_at_the_start(tmp_path: Path) -> None:
    """Also in a file that was made sparse before; else a full disk would end the process."""
    shapes = {"vision": ((64, 128, 128), np.uint8)}
    with open(tmp_path / "old.bin", "wb") as stream:
        stream.truncate(2**22)
    for name in ("new.bin", "old.bin"):
        ReplayStore(tmp_path / name, 4, shapes)
        assert (tmp_path / name).stat().st_blocks * 512 >= 4 * 2**20


def test_a_full_disk_is_named_with_the_room_that_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    shapes = {key: ((64, 128, 128), np.uint8) for key in ("left", "right")}
    with pytest.raises(InputError, match=r"left.bin: got a disk with .* expected 4.00 GiB for all"):
        ReplayStore(tmp_path / "*.bin", 2048, shapes)
    assert list(tmp_path.iterdir()) == []
