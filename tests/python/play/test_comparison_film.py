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


def test_who_is_done_first_stands_still(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Brief(FakeSimulation):
        """A user whose rounds end with the third step, where ``brief`` says so."""

        def step(self, actions: Any, resting: Any = ()) -> Any:
            outcome = super().step(actions)
            self.count = getattr(self, "count", 0) + 1
            outcome.terminated = np.array([self.brief and self.count == 3])
            assert not (self.brief and self.count > 3)
            return outcome

    made: list[Brief] = []

    def make(config: Any, n: int) -> Brief:
        users = Brief(config, n)
        users.brief = not made  # type: ignore[attr-defined]
        made.append(users)
        return users

    film = film_comparison([trained] * 2, tmp_path / "a.mp4", seconds=0.3, simulation=make)
    assert len(frames(film)) == 6
    assert [users.count for users in made] == [3, 6]


def test_what_cannot_be_filmed(trained: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.mp4"
    for given, message in (
        ({"out": tmp_path / "a.gif"}, r"^--out: got '.*a.gif', expected .* ends in .mp4"),
        ({"runs": [trained] * 5}, r"^RUN: got 5 users, expected 1 to 4"),
        ({"seconds": 0.0}, r"^--seconds: got 0, expected more than 0"),
        ({"seed": -1}, r"^--seed: got -1, expected 0 to 2147483647"),
        ({"runs": ["pretrained:nobody"]}, r"^RUN: got 'pretrained:nobody', expected one of"),
        ({"condition": "hrad"}, r"^--condition: got 'hrad', expected .*'hard'"),
    ):
        asked: dict[str, Any] = {"runs": [trained], "out": out, **given}
        with pytest.raises(InputError, match=message):
            film_comparison(asked.pop("runs"), asked.pop("out"), simulation=FakeSimulation, **asked)
    assert list(tmp_path.iterdir()) == []
