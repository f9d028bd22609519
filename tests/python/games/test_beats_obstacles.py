"""Mines and walls of imagined Beats against the true game's: both see the same users."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from beats_both import USERS, Played, play

from sim2vr_harness.games.beats import game_model
from sim2vr_harness.games.beats.game import Beats
from sim2vr_harness.games.beats.game_model import EVENTS
from sim2vr_harness.games.beats.settings import Relaxation

# No box is in the way. A touch costs 1; a mine's from 1 cm on.
HARD = Relaxation(contact_m=1e-3, speed_mps=0.2, angle_deg=15.0, near=0.0, error=1.0, hazard=1.0)
COUNTED = ("MineHits", "WallHits", "MinesAvoided")
MINES_S = np.arange(1.0, 9.5, 0.25)
WALLS_S = np.arange(1.0, 9.0, 0.7)


def write_map(folder: Path) -> Path:
    """A level of one mine after the other and of walls to lean from and to duck under.

    60 beats a minute, so a beat is a second; 5 m/s.
    """
    rng = np.random.default_rng(5)
    cells = rng.integers([4, 3], size=(len(MINES_S), 2)).tolist()
    mines = [{"b": float(t), "x": x, "y": y} for t, (x, y) in zip(MINES_S, cells, strict=True)]
    kinds = ((0, 0, 2, 5), (2, 0, 2, 5), (0, 2, 4, 3))
    walls = [
        dict(zip("bdxywh", (float(t), 0.3, *kinds[k % 3]), strict=True))
        for k, t in enumerate(WALLS_S)
    ]
    box = {"b": 9.9, "x": 0, "y": 0, "c": 0, "d": 8, "a": 0}
    level = {"version": "3.2.0", "colorNotes": [box], "bombNotes": mines, "obstacles": walls}
    folder.mkdir()
    (folder / "Hard.dat").write_text(json.dumps(level))
    beatmap = {
        "_difficulty": "Hard",
        "_difficultyRank": 5,
        "_beatmapFilename": "Hard.dat",
        "_noteJumpMovementSpeed": 5,
        "_noteJumpStartBeatOffset": 0,
    }
    sets = [{"_beatmapCharacteristicName": "Standard", "_difficultyBeatmaps": [beatmap]}]
    info = {"_version": "2.0.0", "_songName": "Obstacles", "_beatsPerMinute": 60}
    (folder / "Info.dat").write_text(json.dumps({**info, "_difficultyBeatmapSets": sets}))
    return folder


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """A round of everybody, arms, trunk and neck moving about at random."""
    level = write_map(tmp_path_factory.mktemp("beats") / "obstacles")
    options = {"level": str(level), "end_on_miss": False}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(game_model, "_MOMENTS", tuple(np.linspace(0.0, 1.0, 41)[1:].tolist()))
        # No condition has this level.
        patched.setattr(Beats, "options", lambda self, condition, weights=None: options)
        return play(options, torso=True, soft=HARD, counted=COUNTED)


def so_far(played: Played, event: str) -> np.ndarray:
    """(STEPS,) how often it has happened in the model."""
    return played.events[:, EVENTS.index(event)]


def test_touched_mines_and_walls_are_the_same(played: Played) -> None:
    """Between frames the model's blades turn nearly as the true ones: what grazes may differ.

    The true game also looks between two frames, and at a sphere instead of the head's cube.
    """
    hits, walls, avoided = played.counts.T
    assert 30 < hits[-1] < USERS * len(MINES_S) / 2
    assert np.abs(so_far(played, "mines") - hits).max() <= 4
    assert np.abs(so_far(played, "avoided") - avoided).max() <= 4
    assert hits[-1] + avoided[-1] == USERS * len(MINES_S)
    passed = USERS * len(WALLS_S)
    assert 0.1 * passed < walls[-1] < 0.9 * passed
    assert np.abs(so_far(played, "walls") - walls).max() <= 0.05 * walls[-1]


def test_what_is_told_of_mines_and_walls_is_the_same(played: Played) -> None:
    """Wherever both tell of the same: who looks to the floor does not see what comes."""
    names = list(played.names)
    wrong = np.abs(played.imagined - played.true)
    for kind, most, when in (("mine", 3, "time_s"), ("wall", 2, "start_s")):
        present = [names.index(f"{kind}{i}.present") for i in range(most)]
        times = [names.index(f"{kind}{i}.{when}") for i in range(most)]
        assert (played.true[:, :, present].sum(-1) > 0).mean() > 0.8
        same = (wrong[:, :, present] == 0.0).all(-1) & (wrong[:, :, times] < 0.03).all(-1)
        assert same.mean() > 0.9, kind
        for i, name in enumerate(names):
            if name.startswith(kind):
                assert float(wrong[:, :, i][same].max()) < 0.005, name


def test_blades_lie_on_the_grips_axis_and_effort_is_the_users_own(played: Played) -> None:
    """From 8 cm in front of the grip on, straight ahead, as the game's page says."""
    expected = torch.tensor([[0.08, 0.0, 0.0], [1.0, 0.0, 0.0]]).expand(2, 2, 3)
    torch.testing.assert_close(played.sabers, expected, atol=2e-3, rtol=0.0)
    imagined, true = played.effort[:, 0], played.effort[:, 1]
    assert float(true.mean()) > 0.01
    np.testing.assert_allclose(imagined, true, atol=1e-5, rtol=1e-4)
