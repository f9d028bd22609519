from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from fake_simulation import FakeSimulation
from PIL import Image
from rich.console import Console

from sim2vr_harness.evaluation import pictures, video
from sim2vr_harness.evaluation.curves import curve, plot
from sim2vr_harness.evaluation.metrics import round_result
from sim2vr_harness.evaluation.rollouts import Job
from sim2vr_harness.evaluation.snapshot import parse_size, snapshot
from sim2vr_harness.evaluation.tables import results_table
from sim2vr_harness.training.errors import InputError


class FakeBody:
    """Stands in for the drawing of the body, which needs OpenGL."""

    def __init__(self, simulation: Any, width: int, height: int, fast: bool = False) -> None:
        self.size = height, width, 3

    def draw(self, index: int) -> np.ndarray:
        return np.full(self.size, 200, np.uint8)

    def close(self) -> None:
        pass


@pytest.fixture
def fake_body(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "BodyPainter", FakeBody)
    monkeypatch.setattr("sim2vr_harness.evaluation.snapshot.BodyPainter", FakeBody)


def simulation(config: Any = None, n: int = 2) -> FakeSimulation:
    settings = SimpleNamespace(action_frequency_hz=20, vision=SimpleNamespace(width=120, height=80))
    return FakeSimulation(settings, n)


def test_frames_hold_the_panels_side_by_side() -> None:
    panels = {
        "body": np.full((60, 60, 3), 200, np.uint8),
        "headset": np.full((60, 91, 3), 100, np.uint8),
    }
    frame = pictures.compose(panels, "medium", "Hits 3")
    assert frame.shape == (104, 158, 3), "header of 44, gap of 6, rounded up to even"
    assert (frame[100, 30] == 200).all()
    assert (frame[100, 120] == 100).all()
    assert frame[:44].max() > 200, "the header has text"


def test_score_text() -> None:
    log = {"Points": 3.0, "Misses": 1.0, "Contacts": 2.0}
    assert pictures.score_text(log, 4.55, 12.34) == (
        "Hits 3   Misses 1   Contacts 2   return 12.3   t  4.5 s"
    )
    assert pictures.score_text({}, 0.0, 0.0) == "return 0.0   t  0.0 s"


def size_of(file: Path) -> tuple[int, int]:
    with Image.open(file) as image:
        return image.size


def probe(file: Path) -> str:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(file)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


def test_films_are_h264_at_the_users_rate(fake_body: None, tmp_path: Path) -> None:
    filmer = video.RoundFilmer(tmp_path)
    users = simulation()
    filmer.started(users, [Job("medium", 0, 1), Job("medium", 1, 2)])
    infos = [{"log": {"Points": 1.0}}] * 2
    for _ in range(10):
        filmer.stepped(np.ones(2), infos)
    assert not (tmp_path / "medium_0.mp4").exists(), "under its name only when it is complete"
    done = round_result(condition="medium", episode=0, seed=1, steps=10, game_return=0.0,
                        effort=0.0, info={}, log={})  # fmt: skip
    filmer.ended(0, done)
    filmer.ended(1, done)
    filmer.close()
    assert filmer.files == [tmp_path / "medium_0.mp4"]
    assert list(tmp_path.iterdir()) == filmer.files
    assert imageio_ffmpeg.count_frames_and_secs(str(filmer.files[0])) == (10, 0.5)
    report = probe(filmer.files[0])
    for part in ("h264", "yuv420p", "1622x464", "20 fps"):
        assert part in report


def test_an_unfinished_film_is_deleted(fake_body: None, tmp_path: Path) -> None:
    filmer = video.RoundFilmer(tmp_path)
    filmer.started(simulation(), [Job("medium", 0, 1), Job("medium", 1, 2)])
    filmer.stepped(np.ones(2), [{}, {}])
    filmer.close()
    assert list(tmp_path.iterdir()) == []


def test_snapshot_writes_every_view(fake_body: None, tmp_path: Path) -> None:
    class Wide(FakeSimulation):
        """Takes the 32 actions of the real user."""

        def step(self, actions):
            return super().step(np.asarray(actions)[:, :3])

    def make(config: Any, n: int) -> FakeSimulation:
        return Wide(simulation().config, n)

    files = snapshot(tmp_path / "out", size=(64, 48), seconds=0.2, simulation=make)
    sizes = {file.stem: size_of(file) for file in files}
    for name in ("headset", "third_person", "recorder", "body"):
        assert sizes[name] == (64, 48)
    assert sizes["observation"] == (240, 80)
    assert sizes["overview"] == (3 * 64 + 2 * 6, 48 + 44)
    with pytest.raises(ValueError, match="condition: got 'nope'"):
        snapshot(tmp_path / "out", condition="nope", simulation=make)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="which is a file, expected a folder"):
        snapshot(tmp_path / "file", simulation=make)


def test_sizes() -> None:
    assert parse_size("640x480") == (640, 480)
    for text in ("640", "axb", "640x", "99999x10"):
        with pytest.raises(InputError, match=rf"^--size: got '{text}'"):
            parse_size(text)


def test_table() -> None:
    console = Console(width=80)
    summaries = {
        "medium": {"episodes": 2, "hits": 12.34, "hits_sd": 1.0, "hit_rate": 0.5, "return": -3.0},
        "high-medium-unconstrained": {"episodes": 2, "diverged": 1},
    }
    with console.capture() as capture:
        console.print(results_table(summaries, "Results"))
    text = capture.get()
    assert "12.3 ± 1.0" in text
    assert "0.500" in text
    assert "Diverged" in text
    assert max(len(line) for line in text.splitlines()) <= 80


def test_curves_of_a_distilled_run_show_its_stages(trained: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    (run / "teacher").mkdir()
    (run / "teacher" / "practice.jsonl").write_text(
        '{"step": 10, "imagined": [0.1, 0.3], "played": [NaN, NaN]}\n'
        '{"step": 20, "imagined": [0.5, 0.7], "played": [0.4, NaN]}\n'
    )
    (run / "student").mkdir()
    (run / "student" / "metrics.jsonl").write_text(
        '{"step": 5, "student/imitation_error": 0.4, "rollout/ep_hit_rate": 0.2}\n'
    )
    assert size_of(plot([trained, run], tmp_path / "curves.png")) == (1440, 1260)
    # A run that has not come to pixels yet has curves as well.
    (run / "metrics.jsonl").unlink()
    plot([run], tmp_path / "early.png")


def test_curves(trained: Path, tmp_path: Path) -> None:
    rows = [{"step": 1, "a": 2.0}, {"step": 2, "a": None}, {"step": 3}]
    assert curve(rows, "a") == ([1], [2.0])
    file = plot([trained, trained], tmp_path / "curves.png")
    assert size_of(file) == (1440, 840)
    with pytest.raises(InputError, match=r"ends in \.png"):
        plot([trained], tmp_path / "curves.txt")
    with pytest.raises(InputError, match=r"holds no config\.yaml"):
        plot([tmp_path], tmp_path / "curves.png")
