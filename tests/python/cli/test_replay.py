"""``sim2vr-harness replay`` on a small round of our own."""

import json
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from python.cli.calls import call

FIXTURE = Path(__file__).resolve().parents[2] / "data" / "whacamole_round"


def decoded(film: Path) -> np.ndarray:
    """(frames, height, width, 3)."""
    reader = imageio_ffmpeg.read_frames(str(film))
    width, height = next(reader)["size"]
    frames = [np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in reader]
    reader.close()
    return np.stack(frames)


def test_tables(capsys: Any) -> None:
    status, out, err = call(capsys, "replay", str(FIXTURE), "--closed")
    assert (status, err) == (0, "Replaying ...\n")
    assert "seed and poses only" in out
    events, times = (line.split() for line in out.splitlines() if "whacamole_round" in line)
    # 18 targets, all as recorded: 7 hits, 8 misses, 4 contacts.
    assert events == ["whacamole_round", "18", "1", "7/7", "8/8", "4/4", "none"]
    assert times == ["whacamole_round", "1/1", "1/1", "1", "0.000", "0.0000/0.0000"]


def test_unconstrained_makes_every_touch_a_hit(capsys: Any) -> None:
    found = json.loads(call(capsys, "replay", str(FIXTURE), "--unconstrained", "--json")[1])
    (one,) = found["rounds"]
    assert one["condition"] == "hard-unconstrained"
    # The four contacts were too slow for hits; now three targets fall to them, one of them earlier.
    assert one["contacts_predicted"] == 0
    assert one["hits_predicted"] > one["hits_recorded"]


def test_log_keeps_the_replayed_rounds_log(capsys: Any, tmp_path: Path) -> None:
    call(capsys, "replay", str(FIXTURE), "--closed", "--log", str(tmp_path / "logs"))
    (log,) = (tmp_path / "logs").rglob("states.csv")
    assert log.read_bytes() == (FIXTURE / "states.csv").read_bytes()


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # pipes of the decoder
def test_video(capsys: Any, tmp_path: Path) -> None:
    film = tmp_path / "films" / "round.mp4"
    status, out, _ = call(
        capsys, "replay", str(FIXTURE), "--video", str(film), "--size", "97x64", "--fps", "10"
    )
    assert status == 0
    assert f"Written: {film}" in out
    frames = decoded(film)
    # 6.05 s at 10 pictures a second; two views and the header, sizes made even for the codec.
    assert frames.shape[0] == 61
    assert frames.shape[1:] == (108, 200, 3)
    headset = frames[30, 50:108, :97].astype(float)
    assert headset.std() > 10  # not one colour
    assert abs(frames[10].astype(float) - frames[40].astype(float)).mean() > 0.5
