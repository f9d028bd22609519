"""Does imagined Beats play by the true game's rules? Both see the same users at the same time."""

import numpy as np
import pytest
import torch
from beats_both import USERS, Played, play

from sim2vr_harness.games.beats import game_model
from sim2vr_harness.games.beats.game_model import points

LOGGED = {
    "sliced": "AccumulatedCorrectSlices",
    "missed": "Misses",
    "wrong direction": "WrongDirection",
    "wrong hand": "WrongHand",
}


@pytest.fixture(scope="module")
def played() -> Played:
    """A round of everybody, moving about at random, in the true game and in the model."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(game_model, "_MOMENTS", tuple(np.linspace(0.0, 1.0, 41)[1:].tolist()))
        patched.setattr(game_model, "_ALONG_M", tuple(np.linspace(-0.5, 0.5, 51).tolist()))
        return play({"level": "first"})


def test_blades_lie_on_the_grips_axis(played: Played) -> None:
    """From 8 cm in front of the grip on, straight ahead, as the game's page says."""
    expected = torch.tensor([[0.08, 0.0, 0.0], [1.0, 0.0, 0.0]]).expand(2, 2, 3)
    torch.testing.assert_close(played.sabers, expected, atol=2e-3, rtol=0.0)


def test_what_happens_to_boxes_is_the_same(played: Played) -> None:
    """48 boxes; tested at four instants of a frame and three points of a blade, as trainings do, a
    fifth of those touched differ: what only grazes, at blades as fast as these."""
    true = {name: sum(log[key] for log in played.logs) for name, key in LOGGED.items()}
    assert sum(true.values()) == 4 * USERS
    assert true["wrong hand"] + true["wrong direction"] + true["sliced"] >= 16
    assert sum(abs(played.happened[name] - count) for name, count in true.items()) <= 4, true


def test_teachers_observe_the_same(played: Played) -> None:
    """Wherever both have the same boxes."""
    names = list(played.names)
    wrong = np.abs(played.imagined - played.true)
    boxes = [
        i for i, name in enumerate(names) if name[:4] in ("left", "righ") and name[-2:] != "on"
    ]
    told = [i for i in boxes if "0." in names[i] or "1." in names[i]]
    alike = (wrong[:, :, [i for i in told if names[i].endswith("present")]] == 0).all(-1)
    assert alike.mean() > 0.98
    for i, name in enumerate(names):
        worst = float(wrong[:, :, i][alike].max())
        tolerance = 0.05 if "tip_v" in name else 0.005
        assert worst < tolerance, f"{name}: {worst}"


def test_effort_is_the_users_own(played: Played) -> None:
    imagined, true = played.effort[:, 0], played.effort[:, 1]
    assert float(true.mean()) > 0.01
    np.testing.assert_allclose(imagined, true, atol=1e-5, rtol=1e-4)


def test_both_arms_share_a_model_of_their_own(played: Played) -> None:
    (arms,) = played.limbs
    assert arms.joint_columns == list(range(14))
    assert arms.low.shape == (2, 7)


def test_scores_are_those_of_the_cuts(played: Played) -> None:
    """A round with one correct slice knows its speed and angle, and what they are worth."""
    single = [log for log in played.logs if log["AccumulatedCorrectSlices"] == 1.0]
    assert single
    for log in single:
        worth = points(torch.tensor(log["CutSpeed"]), torch.tensor(log["CutAngleError"]))
        assert log["Score"] == pytest.approx(float(worth), abs=0.51)
