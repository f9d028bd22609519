"""Imagined pointing by itself: tips that go where they are told to."""

from typing import Any

import pytest
import torch

from sim2vr_harness.games.imagined import ImaginedCondition
from sim2vr_harness.games.pointing.game import (
    FIELDS,
    ImaginedPointing,
    PointingTask,
    distance_reward,
)
from sim2vr_harness.games.pointing.settings import GameModelSettings, Relaxation

STEP_S = 0.05
SOFT = Relaxation(depth_m=0.004, aim_m=0.003, near=0.0, distance=0.0, error=1.0, behind=0.0)
HEAD = (0.0, 1.2, 0.1)
CENTER = (0.15, -0.10, 0.40)
# One block of three targets, 30 cm apart and 4 cm wide.
ONE: dict[str, Any] = {"targets": 3, "distances_m": [0.3], "widths_m": [0.04]}
"""The app's axes: x right, y up, z forward, m, from the head."""
TOP = (0.15, -0.10 + 0.173205, 0.40)
LOWER_LEFT = (0.0, -0.10 - 0.0866025, 0.40)


def condition(depth_m: float = 0.40, **options: Any) -> ImaginedCondition:
    start = {"round.side_m": 0.15, "round.height_m": -0.10, "round.depth_m": depth_m}
    return ImaginedCondition("made up", options or ONE, start)


def placed(*tips: Any) -> torch.Tensor:
    """(N, 2, 4, 4) of controllers whose styluses end in ``tips`` from the head, and headsets."""
    place = torch.eye(4).repeat(len(tips), 2, 1, 1)
    for i, tip in enumerate(tips):
        x, y, z = (a + b for a, b in zip(HEAD, tip, strict=True))
        place[i, 0, :3, 3] = torch.tensor([z - 0.10, -x, y])
        place[i, 1, :3, 3] = torch.tensor([HEAD[2], -HEAD[0], HEAD[1]])
    return place


def shifted(tip: Any, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> tuple[float, ...]:
    return (tip[0] + x, tip[1] + y, tip[2] + z)


def begun(place: torch.Tensor, *conditions: ImaginedCondition) -> ImaginedPointing:
    """Rounds at the first target of a block, with armed styluses."""
    n = len(place)
    game = ImaginedPointing(
        n, conditions or [condition()], GameModelSettings(), frame_s=STEP_S, seed=1
    )
    fields = torch.zeros(n, len(FIELDS))
    fields[:, :3] = torch.tensor(CENTER)
    fields[:, FIELDS.index("tip.armed")] = 1.0
    everyone = torch.arange(n)
    game.start(everyone, place, fields, everyone)
    game.block[:], game.trial[:], game._age_s[:] = 0, 0, 0.0
    return game


def played(game: ImaginedPointing, place: torch.Tensor, soft: Relaxation) -> torch.Tensor:
    """A user step of one frame."""
    return game.play(place[:, None], soft)


def test_targets_by_hand() -> None:
    task = PointingTask.of(ONE)
    assert [task.target_of(trial) for trial in range(4)] == [0, 2, 1, 0]
    expected = torch.tensor([[0.0, 0.173205, 0.0], [-0.15, -0.0866025, 0.0]])
    torch.testing.assert_close(task.centers()[0, :2], expected, atol=1e-5, rtol=0.0)
    nine = PointingTask.of({})
    assert [nine.target_of(trial) for trial in range(10)] == [0, 5, 1, 6, 2, 7, 3, 8, 4, 0]
    assert len(nine.blocks) == 9


def test_only_coming_through_the_plane_is_a_selection() -> None:
    """From 2 cm before the plane: to 2 cm behind it in the target, beside it, and not through."""
    before = [shifted(TOP, z=-0.02)] * 3
    game = begun(placed(*before))
    after = [shifted(TOP, z=0.02), shifted(TOP, x=0.06, z=0.02), shifted(TOP, z=-0.001)]
    played(game, placed(*after), SOFT)
    assert game.trial.tolist() == [1, 1, 0]
    assert game.counts[:, 0, 0].tolist() == [1.0, 1.0]
    far = distance_reward((torch.tensor(after) - torch.tensor([LOWER_LEFT] * 3)).norm(dim=1))
    near = distance_reward(torch.tensor(0.001))
    expected = torch.tensor([10.0 + far[0], -5.0 + far[1], near])
    torch.testing.assert_close(game.score, expected, atol=1e-4, rtol=0.0)


def test_the_tip_must_come_out_again() -> None:
    game = begun(placed(shifted(TOP, z=-0.02)), condition(**(ONE | {"rearm_m": 0.01})))
    selections = []
    for depth in (0.02, -0.009, 0.02, -0.011, 0.02):
        played(game, placed(shifted(LOWER_LEFT, z=depth)), SOFT)
        selections.append(float(game.counts.sum()))
    assert selections == [1.0, 1.0, 1.0, 1.0, 2.0]


def test_a_step_of_several_frames_is_judged_frame_by_frame() -> None:
    """A tap and the way out again in one user step: at its end the tip is where it began."""
    game = begun(placed(shifted(TOP, z=-0.02)))
    game._frame_s = STEP_S / 4
    depths = (-0.02, 0.02, -0.005, -0.02)
    places = torch.stack([placed(shifted(TOP, z=depth)) for depth in depths], 1)
    game.play(places, SOFT)
    assert game.counts[:, 0, 0].tolist() == [1.0, 0.0]
    assert bool(game._armed[0])
    # Two frames with the first target, and two with the next, which is up when it is hit.
    away = [0.02, *(float(torch.tensor([0.3, depth]).norm()) for depth in depths[1:])]
    distance = float(distance_reward(torch.tensor(away)).mean())
    assert float(game.score[0]) == pytest.approx(10.0 + distance, abs=1e-4)
    assert float(game._age_s[0]) == pytest.approx(STEP_S / 2)


def test_rewards_lead_to_the_target_and_through_it() -> None:
    """The nearer to the middle and the deeper, the better; out of the plane after a selection."""
    game = begun(placed(shifted(TOP, z=-0.02)))
    tip = torch.tensor(shifted(TOP, x=0.015, z=-0.005), requires_grad=True)

    def reward(armed: bool, behind: float) -> torch.Tensor:
        place = placed((0.0, 0.0, 0.0))
        x, y, z = (h + t for h, t in zip(HEAD, tip, strict=True))
        place[0, 0, :3, 3] = torch.stack([z - 0.10, -x, y])
        game._armed[:] = armed
        soft = Relaxation(
            depth_m=0.01, aim_m=0.01, near=0.0, distance=0.0, error=0.0, behind=behind
        )
        return played(game, place, soft).sum()

    (slope,) = torch.autograd.grad(reward(armed=True, behind=0.0), tip)
    assert slope[0] < 0.0  # it is to the right of the middle
    assert slope[2] > 0.0
    game.cut()
    (slope,) = torch.autograd.grad(reward(armed=False, behind=1.0), tip)
    assert slope[2] == pytest.approx(-1.0 / 0.02)


def test_a_target_pays_what_its_selection_is_worth_and_no_more() -> None:
    """However long the tip waits just before the plane, and whatever is paid ahead."""
    soft = Relaxation(depth_m=0.01, aim_m=0.003, near=1.0, distance=0.0, error=1.0, behind=0.0)
    # In the middle, and half-way between the target's edge and where 1 of 2 would be a hit.
    chance = float(torch.sigmoid(torch.tensor(0.02 / 0.003)))
    for beside, worth in ((0.0, 10.0 * chance - 5.0 * (1.0 - chance)), (0.02, 2.5), (0.1, -5.0)):
        game = begun(placed(shifted(TOP, z=-0.02)))
        paid = [
            float(played(game, placed(shifted(TOP, x=beside, z=-0.001)), soft)) for _ in range(9)
        ]
        assert paid[1:] == pytest.approx([0.0] * 8, abs=1e-5)
        paid.append(float(played(game, placed(shifted(TOP, x=beside, z=0.02)), soft)))
        assert sum(paid) == pytest.approx(worth, abs=2e-3)
