"""Nothing of a study knows its game: shipped users of Beats, for half a second each."""

from pathlib import Path

import imageio_ffmpeg

import sim2vr_harness


def test_a_study_of_beats(tmp_path: Path) -> None:
    found = sim2vr_harness.run_study(
        {
            "name": "effort",
            "fixed": {"condition": "first", "env.max_episode_seconds": 0.5},
            "factors": {
                "effort": {
                    "key": "user",
                    "levels": {"lazy": "beats_first_lazy", "eager": "beats_first_medium"},
                }
            },
            "episodes": 1,
            "film_seconds": 0.2,
            "measures": ["hand_travel_m", "slice_rate"],
            "comparisons": [{"factor": "effort", "measures": ["hand_travel_m"]}],
        },
        tmp_path,
        jobs=1,
    )
    data = found.data
    assert data.about["game"] == "beats" and data.about["score"] == "slice_rate"
    assert [measure["unit"] for measure in data.about["measures"]] == ["", "m"]
    assert data.episodes["user"].tolist() == ["beats_first_lazy", "beats_first_medium"]
    steps = data.steps("effort=eager")
    assert len(steps) == 10 and {"left_x_m", "right_x_m", "game_left_on"} <= set(steps.columns)
    assert data.events["log_kind"].tolist() == ["left box"] * 2, "the first one has come"
    assert data.events["outcome"].isna().all(), "and is under way"
    films = sorted(tmp_path.glob("cells/*/first_0.mp4"))
    assert [imageio_ffmpeg.count_frames_and_secs(str(film))[0] for film in films] == [4, 4]
    # Two users, one of each kind.
    (result,) = data.statistics["results"]
    assert result["n"] == [1, 1] and result["p"] is None
    assert result["refused"].startswith("n = 1: one unit shows no variation")
    lazy, eager = result["means"]
    assert result["difference"]["mean"] == lazy - eager
