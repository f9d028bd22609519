import json
import lzma
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from fake_body import FakeBody
from fake_simulation import FakeSimulation
from PIL import Image
from rich.console import Console

from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import describe_game
from sim2vr_harness.envs import VisionConfig
from sim2vr_harness.evaluation.curves import curve, pack_curves, plot
from sim2vr_harness.evaluation.tables import results_table
from sim2vr_harness.play import film as pictures
from sim2vr_harness.play import film as video
from sim2vr_harness.play.player import Job
from sim2vr_harness.play.render import snapshot
from sim2vr_harness.play.round import round_result

WHACAMOLE = describe_game("whacamole")


@pytest.fixture
def fake_body(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "BodyPainter", FakeBody)
    monkeypatch.setattr("sim2vr_harness.play.render.BodyPainter", FakeBody)


def simulation(config: Any = None, n: int = 2) -> FakeSimulation:
    settings = SimpleNamespace(action_frequency_hz=20, vision=VisionConfig())
    return FakeSimulation(settings, n)


def size_of(file: Path) -> tuple[int, int]:
    with Image.open(file) as image:
        return image.size


def beside(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


def probe(file: Path) -> str:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(file)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


def test_films_are_h264_at_the_users_rate(fake_body: None, tmp_path: Path) -> None:
    filmer = video.RoundFilmer(tmp_path, WHACAMOLE)
    users = simulation()
    filmer.started(users, [Job("medium", 0, 1), Job("medium", 1, 2)])
    infos = [{"log": {"Points": 1.0}}] * 2
    for _ in range(10):
        filmer.stepped(np.ones(2), infos)
    assert not (tmp_path / "medium_0.mp4").exists(), "under its name only when it is complete"
    done = round_result(WHACAMOLE, condition="medium", episode=0, seed=1, steps=10, game_return=0.0,
                        effort=0.0, info={}, log={})  # fmt: skip
    filmer.ended(0, done)
    filmer.ended(1, done)
    filmer.close()
    assert filmer.files == [tmp_path / "medium_0.mp4"]
    assert beside(tmp_path) == {"medium_0.mp4", "medium_0.jpg", "medium_0.gif"}
    assert size_of(tmp_path / "medium_0.jpg") == (1196, 464)
    with Image.open(tmp_path / "medium_0.gif") as gif:
        # 10 pictures a second of a film of half a second, 800 pixels wide.
        assert (gif.size[0], gif.n_frames) == (800, 5)
    assert imageio_ffmpeg.count_frames_and_secs(str(filmer.files[0])) == (10, 0.5)
    report = probe(filmer.files[0])
    for part in ("h264", "yuv420p", "1196x464", "20 fps"):
        assert part in report
    # A film may be shorter than its round, and an unfinished one is deleted.
    for seconds, found in ((0.25, [(5, 0.25)]), (None, [])):
        folder = tmp_path / f"of {seconds}"
        filmer = video.RoundFilmer(folder, WHACAMOLE, seconds=seconds)
        filmer.started(users, [Job("medium", 0, 1), Job("medium", 1, 2)])
        for _ in range(10):
            filmer.stepped(np.ones(2), infos)
        if seconds is not None:
            filmer.ended(0, done)
        filmer.close()
        films = list(folder.glob("*.mp4"))
        assert len(list(folder.iterdir())) == 3 * len(films), "a poster and a GIF beside each"
        assert [imageio_ffmpeg.count_frames_and_secs(str(film)) for film in films] == found


def test_snapshot_writes_every_view(fake_body: None, tmp_path: Path) -> None:
    class Wide(FakeSimulation):
        """Takes the 32 actions of the real user."""

        resting_action = -np.ones(32, dtype=np.float32)

        def step(self, actions, resting=()):
            return super().step(np.asarray(actions)[:, :3])

    def make(config: Any, n: int) -> FakeSimulation:
        return Wide(simulation().config, n)

    files = snapshot(tmp_path / "out", size=(64, 48), seconds=0.2, simulation=make)
    sizes = {file.stem: size_of(file) for file in files}
    for name in ("headset", "third_person", "recorder", "body"):
        assert sizes[name] == (64, 48)
    assert sizes["observation"] == (240, 80)
    assert sizes["overview"] == (2 * 64 + 6, 48 + 44)
    with pytest.raises(ValueError, match="condition: got 'nope'"):
        snapshot(tmp_path / "out", condition="nope", simulation=make)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="which is a file, expected a folder"):
        snapshot(tmp_path / "file", simulation=make)


def printed(summaries: dict[str, Any], game: str, width: int = 80) -> str:
    console = Console(width=width)
    with console.capture() as capture:
        console.print(results_table(summaries, describe_game(game), "Results"))
    return capture.get()


def test_four_conditions_fit_80_columns() -> None:
    usual = {
        "episodes": 12, "hits": 142.3, "hits_sd": 12.1, "hit_rate": 0.512, "hit_rate_sd": 0.111,
        "hammer_depth_m": -0.123, "hammer_depth_m_sd": 0.012, "game_return": 1408.4,
        "game_return_sd": 124.0, "return": 1250.1, "return_sd": 120.1,
        "return_terms": {"rest": 1.0, "DistanceReward": -99.5, "effort": -159.4},
        "cell_hit_rates": [0.5] * 9,
    }  # fmt: skip
    names = ["low-medium-unconstrained", "medium", "high-medium", "random-easy-medium", "hard"]
    text = printed({name: usual for name in names}, "whacamole")
    lines = text.splitlines()
    assert max(len(line) for line in lines) <= 80
    row = next(line for line in lines if "Game's reward" in line)
    assert row.count("1408.4±124.0") == 4, "a row is not broken"
    assert "Mean ± SD over 12 rounds of this one user" in text
    assert sum("Per round" in line for line in lines) == 2, "the fifth has a table of its own"
    text = printed({"small": {"episodes": 1, "points": 3.0, "distance_m": 0.25}}, "sample")
    assert "Distance to the ball (m)" in text and "0.250" in text and "Hit" not in text


def lines_of(file: Path) -> int:
    """Lines of panels, 2.5 inches high each, in a picture of two columns of a paper."""
    width, height = size_of(file)
    assert width == 1440
    return height // 500


def test_curves_of_a_distilled_run_show_its_stages(trained: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    (run / "imagined").mkdir()
    (run / "imagined" / "cycles.jsonl").write_text(
        '{"step": 10, "imagined": [0.1, 0.3], "played": [NaN, NaN]}\n'
        '{"step": 20, "imagined": [0.5, 0.7], "played": [0.4, NaN]}\n'
    )
    (run / "student").mkdir()
    (run / "student" / "metrics.jsonl").write_text(
        '{"step": 5, "student/imitation_error": 0.4, "rollout/ep_hit_rate": 0.2}\n'
    )
    assert lines_of(plot([trained, run], tmp_path / "curves.png")) == 3
    # A run that has not come to pixels yet has curves as well; a packed user keeps its own.
    packed = shutil.copytree(
        paths.trained_users_dir() / "whacamole_constrained", tmp_path / "packed"
    )
    pack_curves(run, packed)
    assert lines_of(plot([str(packed)], tmp_path / "packed.png")) == 3
    rows = json.loads(lzma.decompress((packed / "curves.json.xz").read_bytes()))["rows"]
    assert [row["step"] for row in rows] == [60, 120]
    (run / "metrics.jsonl").unlink()
    plot([run], tmp_path / "early.png")


def test_curves(trained: Path, tmp_path: Path) -> None:
    rows = [{"step": 1, "a": 2.0}, {"step": 2, "a": None}, {"step": 3}]
    assert curve(rows, "a") == ([1], [2.0])
    file = plot([trained, trained], tmp_path / "curves.png")
    assert lines_of(file) == 2
    with pytest.raises(InputError, match=r"ends in \.png"):
        plot([trained], tmp_path / "curves.txt")
    with pytest.raises(InputError, match=r"holds no config\.yaml"):
        plot([tmp_path], tmp_path / "curves.png")
