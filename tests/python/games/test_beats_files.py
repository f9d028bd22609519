"""Maps as people have them: other encodings, and folders whose names are not UTF-8."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base.paths import app_executable, uri_unless_utf8
from sim2vr_harness.client import InProcessApp, describe_level
from sim2vr_harness.envs import (
    AppConfig,
    EffortConfig,
    EnvConfig,
    Simulation,
    UserConfig,
    VisionConfig,
)
from sim2vr_harness.games.beats.maps import MapBox
from sim2vr_harness.games.beats.maps import write_map as write_level
from sim2vr_harness.runs.config import apply_overrides

INFO = {
    "_version": "2.0.0",
    "_songName": "Käse",
    "_beatsPerMinute": 120,
    "_difficultyBeatmapSets": [
        {
            "_beatmapCharacteristicName": "Standard",
            "_difficultyBeatmaps": [{"_difficulty": "Hard", "_beatmapFilename": "H.dat"}],
        }
    ],
}
HARD = {"version": "3.0.0", "colorNotes": [{"b": 4, "x": 1}]}


def write_map(folder: Path, encoding: str = "utf-8") -> Path:
    folder.mkdir()
    (folder / "Info.dat").write_bytes(json.dumps(INFO, ensure_ascii=False).encode(encoding))
    (folder / "H.dat").write_text(json.dumps(HARD), encoding="utf-8")
    return folder


@pytest.fixture
def strange(tmp_path: Path) -> str:
    """Return the path of a map whose folder has a byte that is not UTF-8."""
    return str(write_map(tmp_path / os.fsdecode(b"M\xe4use")))


@pytest.mark.parametrize(
    ("encoding", "got"), [("latin-1", "text that is not UTF-8 at byte"), ("utf-16", "UTF-16")]
)
def test_a_map_in_another_encoding_is_named_and_so_is_what_was_expected(
    tmp_path: Path, encoding: str, got: str
) -> None:
    folder = write_map(tmp_path / "map", encoding)
    with pytest.raises(ValueError, match=got) as refused:
        describe_level("beats", {"level": str(folder)}, 1)
    assert str(refused.value).startswith(f"{folder}: Info.dat: got ")
    assert str(refused.value).endswith("expected a JSON object in UTF-8")


def test_the_text_of_an_error_survives_bytes_that_are_not_utf8(strange: str) -> None:
    Path(strange, "H.dat").write_text("{}")
    with pytest.raises(ValueError, match=r"M\ufffduse: H\.dat\.version: got none"):
        describe_level("beats", {"level": strange}, 1)
    options = json.dumps({"level": uri_unless_utf8(strange)})
    command = [app_executable(), "--play", "--game", "beats", "--options", options]
    ended = subprocess.run([*command, "--renderer", "null"], capture_output=True, check=False)
    assert ended.returncode == 2
    assert "M\ufffduse: H.dat.version: got none" in ended.stderr.decode("utf-8")


def test_a_level_in_a_folder_that_is_not_utf8_is_read_by_the_command_line(strange: str) -> None:
    value = apply_overrides({}, [f"env.app.options.level={strange}"])
    level = value["env"]["app"]["options"]["level"]
    assert level == f"file://{Path(strange).parent}/M%E4use"


@pytest.mark.parametrize("transport", ["in_process", "protocol2"])
def test_a_level_in_a_folder_that_is_not_utf8_is_played(transport: str, strange: str) -> None:
    options = {"level": uri_unless_utf8(strange)}
    app = AppConfig(game="beats", transport=transport, renderer="null", options=options)
    user = UserConfig(model="mobl_arms_bimanual_motor", effort=EffortConfig(model="zero"))
    vision = VisionConfig(width=12, height=8)
    simulation = Simulation(EnvConfig(app=app, user=user, vision=vision), 1)
    try:
        simulation.reset(seeds=[1])
        batch = simulation.step(np.zeros((1, simulation.action_space.shape[0])))
        assert batch.answered.all()
    finally:
        simulation.close()


def test_an_app_in_this_process_takes_such_a_path_as_it_is(strange: str) -> None:
    app = InProcessApp("beats", {"level": strange}, renderer="null", width=8, height=8)
    app.close()


def test_a_script_that_is_a_pipe_is_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for option in ("--script", "--log-file"):
        command = [app_executable(), "--play", "--renderer", "null", option, str(pipe)]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert ended.returncode == 2
        assert f"'{pipe}' (" in ended.stderr


def test_a_list_of_boxes_becomes_a_level(tmp_path: Path) -> None:
    boxes = [MapBox(2.5, 3, 2, "right", 5), MapBox(1.25, 0, 1, "left", 8)]
    folder = write_level(tmp_path / "two", boxes)
    level = describe_level("beats", {"level": str(folder)}, 1)
    assert [(item.time_s, item.lane, item.kind) for item in level.items] == [
        (1.25, 4, "left box"),
        (2.5, 11, "right box"),
    ]
    assert [item.arrow_deg for item in level.items] == [None, pytest.approx(45.0)]


def test_an_unknown_rule_is_named() -> None:
    with pytest.raises(ValueError, match=r"rules.*paper.*beat_saber"):
        InProcessApp("beats", {"rules": "original"}, renderer="null")
