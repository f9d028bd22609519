"""``sim2vr-harness render film``: users of the same round, side by side."""

from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from fake_body import FakeBody
from fake_simulation import FakeSimulation

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.play import render as side_by_side
from sim2vr_harness.play.render import film_comparison


@pytest.fixture(autouse=True)
def fake_body(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_by_side, "BodyPainter", FakeBody)


def frames(film: Path) -> np.ndarray:
    """(frames, height, width, 3)."""
    reader = imageio_ffmpeg.read_frames(str(film))
    width, height = next(reader)["size"]
    found = [np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in reader]
    reader.close()
    return np.stack(found)


def test_users_stand_side_by_side(trained: Path, tmp_path: Path) -> None:
    shares: list[float] = []
    film = film_comparison(
        [trained, trained],
        tmp_path / "two.mp4",
        seconds=0.25,
        simulation=FakeSimulation,
        on_progress=shares.append,
    )
    assert {file.name for file in tmp_path.iterdir()} == {"two.mp4", "two.jpg", "two.gif"}
    pictures = frames(film)
    # Body and game, a line between them, the header above; 6 pixels between the users.
    assert pictures.shape == (5, 360 + 28 + 360 + 44, 2 * 480 + 6, 3)
    assert shares == [0.2, 0.4, 0.6, 0.8, 1.0]
    # The same policy with the same seed does the same.
    left, right = pictures[:, 80:, :480], pictures[:, 80:, 486:]
    assert np.abs(left.astype(int) - right).mean() < 0.5


def test_what_cannot_be_filmed(trained: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.mp4"
    for given, message in (
        ({"out": tmp_path / "a.gif"}, r"^--out: got '.*a.gif', expected .* ends in .mp4"),
        ({"runs": [trained] * 5}, r"^RUN: got 5 users, expected 1 to 4"),
        ({"seconds": 0.0}, r"^--seconds: got 0, expected more than 0"),
        ({"condition": "hrad"}, r"^--condition: got 'hrad', expected .*'hard'"),
    ):
        asked: dict[str, Any] = {"runs": [trained], "out": out, **given}
        with pytest.raises(InputError, match=message):
            film_comparison(asked.pop("runs"), asked.pop("out"), simulation=FakeSimulation, **asked)
    assert list(tmp_path.iterdir()) == []
