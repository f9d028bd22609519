"""Maps as people have them: other encodings, and folders whose names are not UTF-8."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.client import describe_level
from sim2vr_harness.envs import (
    AppConfig,
    EffortConfig,
    EnvConfig,
    Simulation,
    UserConfig,
    VisionConfig,
)
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


@pytest.mark.parametrize("transport", ["in_process", "protocol2"])
def test_a_level_in_a_folder_that_is_not_utf8_is_played(transport: str, strange: str) -> None:
    value = apply_overrides({}, [f"env.app.options.level={strange}"])
    options = value["env"]["app"]["options"]
    assert options["level"] == f"file://{Path(strange).parent}/M%E4use"
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
