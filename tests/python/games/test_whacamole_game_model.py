"""Imagined Whac-A-Mole by itself: users whose controllers stay where they are told to."""

import numpy as np
import pytest
import torch
from shapings import shaped

from sim2vr_harness.games.whacamole import settings as model_settings
from sim2vr_harness.games.whacamole.game import FIELDS, ImaginedWhacAMole, points
from sim2vr_harness.games.whacamole.rules import (
    AREA_M,
    BEHIND,
    FRAME_S,
    GROWING_FRAMES,
    STRIKE,
    UP,
    area_of,
)
from sim2vr_harness.games.whacamole.settings import GameModelSettings, Relaxation

SOFT = Relaxation(overlap_m=0.01, speed_mps=0.2, near=1.0, distance=1.0)
RULES = {"round.constrained": 1.0, "round.max_targets": 3.0, "round.strike_threshold_mps": 0.8}
PLACEMENTS = ("round.low", "round.mid", "round.high")
CONDITIONS = [RULES | {name: float(name == each) for name in PLACEMENTS} for each in PLACEMENTS]


def resting_game(
    n: int, settings: GameModelSettings | None = None, frames: int = 1
) -> tuple[ImaginedWhacAMole, torch.Tensor]:
    """N rounds, the conditions in turn, and the places of controllers that stay there."""
    settings = GameModelSettings() if settings is None else settings
    game = ImaginedWhacAMole(
        n, CONDITIONS, settings, step_s=0.05, seed=2, gamma=0.96, frames=frames
    )
    game._single[:] = False
    place = torch.eye(4).expand(n, 2, 4, 4)
    fields = torch.zeros(n, len(FIELDS))
    for i in range(n):
        for name, value in CONDITIONS[i % 3].items():
            fields[i, FIELDS.index(name)] = value
    game.start(torch.arange(n), place, fields, torch.full((n,), -1))
    return game, place


def test_the_area_is_where_options_put_it() -> None:
    still = area_of(0, {})
    assert (still.middle_m, still.strike) == (AREA_M[0], STRIKE[0])
    moved = area_of(1, {"condition": "medium", "area_height_m": 0.05, "area_tilt_deg": 90.0})
    assert moved.middle_m == (0.15, 0.05, 0.40)
    # Flat, its face up: behind is down, up in its plane is forward; it is struck down.
    np.testing.assert_allclose((moved.up, moved.behind), ((0, 0, 1), (0, -1, 0)), atol=1e-12)
    assert moved.strike == (0.0, -1.0, 0.0)
    for placement, tilt_deg in enumerate((45.0, 0.0, -45.0)):
        tilted = area_of(1, {"area_tilt_deg": tilt_deg})
        np.testing.assert_allclose(tilted.up, UP[placement], atol=1e-12)
        np.testing.assert_allclose(tilted.behind, BEHIND[placement], atol=1e-12)
        assert tilted.strike == STRIKE[placement]


def game_at_a_target(
    settings: GameModelSettings | None = None, frames: int = 1
) -> tuple[ImaginedWhacAMole, torch.Tensor]:
    """Four users whose hammers are in the middle target of the middle placement.

    The first comes in at 0.9 m/s, the second at 0.7 m/s, the third was inside already, and the
    fourth one's target is still growing.
    """
    game, place = resting_game(4, settings, frames)
    game.condition[:] = 1
    # The box is 5 cm along the handle's axis y from the marker, 1.4 mm from it across.
    game.hammer.fixed.zero_()
    game.hammer.fixed[12, :3] = game._cells[1, 4]
    game.hammer.fixed[12, 3:6] = torch.tensor([0.0, 0.0, 1.0])
    game.hammer.fixed[12, 6:] = torch.tensor([0.0, 1.0, 0.0])
    root, _ = points(*game.hammer(place))
    game._age[:], game._fading[:] = -1, 0
    game._age[:, 4] = torch.tensor([5, 5, 5, 0])
    game._ban_s[:] = 9.0
    # The velocity that is judged is half the last frame's and half of what it was.
    speeds = torch.tensor([0.9, 0.7, 0.9, 0.9])
    game._velocity = torch.zeros(4, 3)
    game._root = root.clone()
    game._root[:, 2] -= speeds * 2.0 * FRAME_S
    game._inside[2, 4] = True
    return game, place


def test_only_coming_in_fast_enough_is_a_hit() -> None:
    game, place = game_at_a_target()
    game.play(place[:, None], SOFT)
    assert game._inside[:, 4].tolist() == [True, True, True, True]
    assert game._hit[:, 4].tolist() == [True, False, False, False]
    game.play(place[:, None], SOFT)
    assert game._age[:, 4].tolist() == [-1, 7, 7, 2]
    assert game.counts[0, 1].tolist() == [0, 0, 0, 0, 1, 0, 0, 0, 0]
    game, place = game_at_a_target()
    game._age[:, 4] = GROWING_FRAMES - 1  # grown when it is hit
    game.play(place[:, None], SOFT)
    assert game._hit[:, 4].tolist() == [True, False, False, True]


def test_hits_may_be_looked_for_once_a_step() -> None:
    """The hammer rests, and then jumps 18 mm into the target: 1.8 m/s over 10 ms, half of it as the
    game filters it; 0.36 m/s over the step of 50 ms. The rule asks for 0.8. At the end of a step of
    a steady 0.9 m/s the game's filter has come to (1 - 1/32) of it."""
    for whole, hits in ((False, True), (True, False)):
        game, place = game_at_a_target(GameModelSettings(whole_steps=whole), frames=5)
        assert game.frames == (1 if whole else 5)
        there, _ = points(*game.hammer(place))
        game._root, game._velocity = there - torch.tensor([0.0, 0.0, 0.018]), torch.zeros(4, 3)
        game._age[:, 4], game._inside[:] = 5, False
        game.play(place[:, None].expand(-1, game.frames, -1, -1, -1), SOFT)
        assert game._hit[:, 4].tolist() == 4 * [hits]
    game, place = game_at_a_target(GameModelSettings(whole_steps=True), frames=5)
    there, _ = points(*game.hammer(place))
    game._root, game._velocity = there - torch.tensor([0.0, 0.0, 0.9 * FRAME_S]), torch.zeros(4, 3)
    game.play(place[:, None], SOFT)
    torch.testing.assert_close(game._velocity[:, 2], torch.full((4,), 0.9 * 31.0 / 32.0))


def test_a_true_hit_has_its_whole_worth_and_a_gradient() -> None:
    game, place = game_at_a_target()
    game.hammer.fixed.requires_grad_()
    soft = Relaxation(overlap_m=0.015, speed_mps=0.3, near=0.0, distance=0.0)
    worth = game.play(place[:, None], soft)
    assert game._hit[:, 4].tolist() == [True, False, False, False]
    assert worth[0].item() == pytest.approx(10.0)
    assert 0.0 < worth[1].item() < 10.0
    worth[0].backward()
    assert game.hammer.fixed.grad is not None
    assert game.hammer.fixed.grad[12, 2] != 0.0
    game, place = game_at_a_target()
    game.hit_values.fill_(3.0)
    assert game.play(place[:, None], soft)[0].item() == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("term", "aside_m", "turn_deg", "worth"),
    [
        # The collider is 1.4 mm beside the middle: exp(-0.5 * 0.07^2) = .998 of the share is left;
        # after 2 cm the other way exp(-0.5 * 0.93^2) = .649.
        ("centre", 0.0, 0.0, 1 - 0.5 * (1 - 0.998)),
        ("centre", 0.02, 0.0, 1 - 0.5 * (1 - 0.649)),
        # All of the share forward, half of it where the face goes at 60 degrees.
        ("face", 0.0, 60.0, 0.875),
        ("face", 0.0, 90.0, 0.75),
    ],
)
def test_hits_may_be_worth_more_in_the_middle_and_face_first(
    term: str, aside_m: float, turn_deg: float, worth: float
) -> None:
    rewards = []
    for share in (0.0, 0.5):
        game, place = game_at_a_target()
        turn, behind = np.radians(turn_deg), game._axes[1, 2]
        game.hammer.fixed[12, 1] -= aside_m
        game.hammer.fixed[12, 3:6] = np.cos(turn) * behind + np.sin(turn) * game._axes[1, 0]
        root, game._face = points(*game.hammer(place))
        game._root = root - 2.0 * FRAME_S * 0.9 * behind
        soft = Relaxation(0.01, 0.2, near=0.0, distance=0.0, **{term: share})
        rewards.append(game.play(place[:, None], soft)[0])
    assert float(rewards[1] / rewards[0]) == pytest.approx(worth, abs=5e-3)
    settings = shaped(model_settings, **{term: 0.6})
    shares = [getattr(settings.relaxation(done), term) for done in (0.0, 0.25, 0.5, 1.0)]
    assert shares == pytest.approx([0.0, 0.3, 0.6, 0.6])


def test_staying_in_a_target_costs_by_how_deep_the_hammer_is() -> None:
    rewards = []
    for dwell in (0.0, 1.0):
        game, place = game_at_a_target()
        soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=1.0, distance=1.0, dwell=dwell)
        rewards.append(torch.stack([game.play(place[:, None], soft) for _ in range(2)]))
    # Half sizes of 12.5 mm (target) and 50 mm (hammer), middles 47.8 mm apart: 14.7 mm deep, of 40.
    cost = 1.0 + (0.0125 + 0.050 - (0.0482 - 0.000401)) / 0.04
    expected = torch.tensor([[0.0, 0.0, cost, 0.0], [0.0, cost, cost, cost]])
    torch.testing.assert_close(rewards[0] - rewards[1], expected, atol=1e-4, rtol=0.0)


def test_a_stroke_starts_in_front_of_a_cell_and_is_in_it_when_it_is_due() -> None:
    """The hammer is in the middle of the cell, as it should be after 0.6 s. It goes through it at
    1.5 m/s from rest, with 11.25 m/s2 over 10 cm; so it should be 0.075 m less a / 2 * 0.05^2 in
    front of it 0.05 s before, 3 cm behind it 0.05 s later, and the whole way in front of it
    between strokes; 0.3 m are worth 1."""
    rewards = []
    for stroke in (0.0, 2.0):
        game, place = game_at_a_target()
        # 0.6, 0.55, 0.65 and 0.7 s after the step; the next stroke is at 1.0 s.
        game._age[:, 4] = torch.tensor([11, 10, 12, 13])
        soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=1.0, distance=1.0, stroke=stroke)
        rewards.append(game.play(place[:, None], soft))
    expected = 2.0 * (1.0 - torch.tensor([0.0, 0.0609, 0.03, 0.1]) / 0.3)
    torch.testing.assert_close(rewards[1] - rewards[0], expected, atol=2e-3, rtol=0.0)


def test_a_hit_may_be_worth_the_same_whenever_it_comes() -> None:
    """By hand: a discount of .96 a step of 50 ms is 20 ln(.96) = -.816 a second.

    What is worth exp(.816 age) then is, discounted to when the target came, the same at .3 s (frame
    6) and at .9 s (frame 18); it is worth 1 at .366 s, a third of a target's 1.098 s.
    """
    worth = []
    for age in (6, 18):
        rewards = []
        for patience in (0.0, 0.816):
            game, place = game_at_a_target(shaped(model_settings, delay_gain_per_s=patience))
            game._age[:, 4] = age - 1
            soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=0.0, distance=0.0)
            rewards.append(game.play(place[:, None], soft)[0])
        worth.append(float(rewards[1] / rewards[0]))
    assert worth == pytest.approx([0.948, 1.546], abs=2e-3)
    assert worth[0] * 0.96**6 == pytest.approx(worth[1] * 0.96**18, rel=2e-3)


def test_missed_cells_come_up_more_often_and_are_worth_more() -> None:
    game, _ = resting_game(3)
    game.counts[0], game.counts[1] = 10.0, 0.0
    game.counts[:, 2, 6] = torch.tensor([0.0, 10.0])
    game.adapt()
    assert game.spawn_weights[2, 6] > 2.0 * game.spawn_weights[2, 0]
    torch.testing.assert_close(game.spawn_weights.sum(1), torch.ones(3))
    # It fails 7.8 times as often as the mean, of which 3 count: worth 2 hits more, half of it now.
    expected = torch.ones(3, 9)
    expected[2, 6] = 2.0
    torch.testing.assert_close(game.hit_values, expected)
