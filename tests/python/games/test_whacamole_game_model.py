"""Imagined Whac-A-Mole by itself: users whose controllers stay where they are told to."""

import numpy as np
import pytest
import torch
from shapings import shaped

from sim2vr_harness.games import imagined_game
from sim2vr_harness.games.whacamole import game as whacamole
from sim2vr_harness.games.whacamole import settings as model_settings
from sim2vr_harness.games.whacamole.game import FIELDS, ImaginedWhacAMole, points
from sim2vr_harness.games.whacamole.rules import AREA_M, BEHIND, FRAME_S, STRIKE, UP, area_of
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


def test_what_a_log_says_by_cell() -> None:
    game = imagined_game("whacamole")
    assert game is not None
    outcomes = game.outcomes({"hitsTarget4": 3.0, "missesTarget8": 2.0, "Points": 3.0})
    assert outcomes.shape == (2, game.cells)
    assert outcomes[0].tolist() == [0, 0, 0, 0, 3, 0, 0, 0, 0]
    assert outcomes[1].tolist() == [0, 0, 0, 0, 0, 0, 0, 0, 2]


def test_another_duration_of_a_step_is_refused() -> None:
    with pytest.raises(ValueError, match="action_frequency_hz: got 40, expected 20"):
        ImaginedWhacAMole(1, CONDITIONS, GameModelSettings(), step_s=0.025, seed=1, gamma=0.96)


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
    options = [{"area_height_m": 0.1}, {}, {"area_distance_m": 0.2}]
    both = [
        ImaginedWhacAMole(
            3, CONDITIONS, GameModelSettings(), step_s=0.05, seed=2, gamma=0.96, options=given
        )
        for given in (None, options)
    ]
    shift = (both[1]._cells - both[0]._cells).numpy()
    np.testing.assert_allclose(shift[0], np.tile((0.0, 0.4, 0.0), (9, 1)), atol=1e-6)
    np.testing.assert_array_equal(shift[1], 0.0)
    np.testing.assert_allclose(shift[2], np.tile((0.0, 0.0, -0.1), (9, 1)), atol=1e-6)


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


def test_a_hammer_that_hovers_is_worth_no_more_at_more_frames() -> None:
    worth = []
    for frames in (1, 5):
        game, place = game_at_a_target(frames=frames)
        game.hammer.fixed[12, 2] -= 0.045  # the target's radius is 2.5 cm, half the head's 2
        root, _ = points(*game.hammer(place))
        game._root, game._velocity = root, torch.tensor([0.0, 0.0, 0.6]).expand(4, 3)
        game._age[:, 4], game._inside[:] = 5, False
        held = place[:, None].expand(-1, frames, -1, -1, -1)
        soft = Relaxation(overlap_m=0.015, speed_mps=0.3, near=0.0, distance=0.0)
        worth.append(game.play(held, soft)[0])
        assert not game._hit.any()
    assert worth[0] > 1e-3
    assert worth[1] == pytest.approx(worth[0])


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


def test_a_stroke_starts_in_front_of_a_cell_and_is_in_it_when_it_is_due(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The hammer is in the middle of the cell, as it should be after 0.6 s. It goes through it at
    1.5 m/s from rest, with 11.25 m/s2 over 10 cm and 3.75 m/s2 over 30 cm; so it should be 0.075 m
    less a / 2 * 0.05^2 in front of it 0.05 s before, 3 cm behind it 0.05 s later, and the whole way
    in front of it between strokes; 0.3 m are worth 1."""
    for run_up_m, off in ((0.1, [0.0, 0.0609, 0.03, 0.1]), (0.3, [0.0, 0.0703, 0.03, 0.2813])):
        monkeypatch.setattr(whacamole, "RUN_UP_M", run_up_m)
        rewards = []
        for stroke in (0.0, 2.0):
            game, place = game_at_a_target()
            # 0.6, 0.55, 0.65 and 0.7 s after the step; the next stroke is at 1.0 s.
            game._age[:, 4] = torch.tensor([11, 10, 12, 13])
            soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=1.0, distance=1.0, stroke=stroke)
            rewards.append(game.play(place[:, None], soft))
        expected = 2.0 * (1.0 - torch.tensor(off) / 0.3)
        torch.testing.assert_close(rewards[1] - rewards[0], expected, atol=2e-3, rtol=0.0)
    shown = GameModelSettings(stroke_reward=2.0)
    assert [shown.relaxation(done).stroke for done in (0.25, 0.5)] == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize(("before_m", "cost"), [(0.0, 1.1), (0.06, 0.5), (-0.2, 2.0), (0.2, 0.0)])
def test_being_in_the_plane_away_from_targets_costs(before_m: float, cost: float) -> None:
    """The hammer is in the middle of a cell, whose volume is 1 cm behind the plane, or before it:
    nothing at a target, the whole cost with none, and with one in the next cell, 12.5 cm away."""
    rewards = []
    for plane in (0.0, 2.0):
        game, place = game_at_a_target()
        game._age[:] = -1
        game._age[0, 4], game._age[1, 3] = 5, 5
        game._ban_s[:] = 9.0
        game.hammer.fixed[12, 2] -= before_m
        soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=0.0, distance=0.0, plane=plane)
        rewards.append(game.play(place[:, None], soft))
    expected = -2.0 * cost * torch.tensor([0.0, 1.0, 1.0, 1.0])
    torch.testing.assert_close(rewards[1] - rewards[0], expected, atol=1e-2, rtol=0.0)


def test_going_towards_targets_that_cannot_have_been_seen_costs() -> None:
    """By hand, at v m/s: nothing before a target that is there for 0.15 s (frame 3); all of v
    before one that is there for 0.1 s, or none; 1 - exp(-2) = .865 of it with one in the next cell,
    twice the 6.25 cm of half a cell away. Going away from the targets is free."""
    for speed, going in ((1.5, 1.0), (-1.5, 0.0)):
        rewards = []
        for blind in (0.0, 2.0):
            game, place = game_at_a_target()
            root = points(*game.hammer(place))[0]
            game._velocity = speed * game._strike[game.condition]
            game._root = root - FRAME_S * game._velocity
            game._age[:] = -1
            # A frame passes before it is judged.
            game._age[0, 4], game._age[1, 4], game._age[3, 3] = 2, 1, 2
            game._ban_s[:] = 9.0
            soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=0.0, distance=0.0, blind=blind)
            rewards.append(game.play(place[:, None], soft))
        expected = -2.0 * 1.5 * going * torch.tensor([0.0, 1.0, 1.0, 0.865])
        torch.testing.assert_close(rewards[1] - rewards[0], expected, atol=0.02, rtol=0.0)
    settings = shaped(model_settings, blind=2.0)
    shares = [settings.relaxation(done).blind for done in (0.0, 0.25, 0.5, 1.0)]
    assert shares == pytest.approx([0.0, 1.0, 2.0, 2.0])


def test_hits_may_be_worth_more_in_the_middle() -> None:
    """The collider is 1.4 mm beside the middle: exp(-0.5 * 0.07^2) = .998 of the share is left.

    After 2 cm the other way it is exp(-0.5 * 0.93^2) = .649.
    """
    worth = []
    for aside_m in (0.0, 0.02):
        rewards = []
        for share in (0.0, 0.5):
            game, place = game_at_a_target()
            game.hammer.fixed[12, :3] -= aside_m * torch.tensor([0.0, 1.0, 0.0])
            game._root[:, 1] -= aside_m
            soft = Relaxation(0.01, 0.2, near=0.0, distance=0.0, centre=share)
            rewards.append(game.play(place[:, None], soft)[0])
        worth.append(float(rewards[1] / rewards[0]))
    assert worth == pytest.approx([1 - 0.5 * (1 - 0.998), 1 - 0.5 * (1 - 0.649)], abs=0.005)


def test_a_learner_aims_before_it_aims_at_the_middle() -> None:
    settings = shaped(model_settings, centre=0.6)
    shares = [settings.relaxation(done).centre for done in (0.0, 0.25, 0.5, 1.0)]
    assert shares == pytest.approx([0.0, 0.3, 0.6, 0.6])


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


def test_what_a_hit_is_worth_is_a_setting() -> None:
    rewards = []
    for worth in (10.0, 30.0):
        game, place = game_at_a_target(shaped(model_settings, hit_reward=worth))
        soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=0.0, distance=0.0)
        rewards.append(float(game.play(place[:, None], soft)[0]))
    assert rewards == pytest.approx([10.0, 30.0], rel=1e-5)


@pytest.mark.parametrize(
    ("until_s", "later"),
    [(0.4, (1.0609**4, 0.0, 0.0)), (1.098, (1.0609**17, 1.0609**13, 1.0609))],
)
def test_what_a_hit_takes_away_is_a_later_one(until_s: float, later: tuple[float, ...]) -> None:
    """By hand: 18 of 20 targets are hit, 8 of them worth a half for being at the rim: 14 of 20.

    What is worth exp(2 age) is worth exp(.1) more with every frame; .96 is left by the discount:
    1.0609 times as much. From frame 4 it is best to wait until .4 s (frame 8), and
    after that not at all; or from any frame to the end (frame 21), after which there is nothing.
    """
    game, _ = resting_game(3, shaped(model_settings, delay_gain_per_s=2.0, delay_until_s=until_s))
    game._earned[1] = 14.0
    game.counts[:, 1, 4] = torch.tensor([18.0, 2.0])
    game.adapt()  # a half is believed
    got = game._foregone[1, [4, 8, 20, 21]] / (0.5 * 0.7)
    np.testing.assert_allclose(got, [*later, 0.0], rtol=3e-3)
    assert game._foregone[0].abs().max() == 0.0


def test_who_counts_what_comes_later_less_has_less_to_wait_for() -> None:
    """By hand: what is worth .5 more in the fourth frame is worth .94^4 of that to who discounts.

    exp(2 * .2 s) = 1.492 times as much with nothing taken off, 1.165 with .94 a step.
    """
    settings = shaped(model_settings, delay_gain_per_s=2.0, delay_until_s=0.4)
    for gamma, worth in ((1.0, 1.492), (0.94, 1.165)):
        game = ImaginedWhacAMole(3, CONDITIONS, settings, step_s=0.05, seed=2, gamma=gamma)
        game._earned[1] = 1.0
        game.counts[0, 1, 4] = 1.0
        game.adapt()
        assert game._foregone[1, 4].item() / 0.5 == pytest.approx(worth, rel=1e-3)


def test_what_a_hit_takes_away_counts_against_its_gradient_alone() -> None:
    """The first user hits: its reward is what it was, its gradient .4 of it if .6 is taken away.

    The others hit nothing (too slow, inside already, still growing), and learn what they did.
    """
    gradients, rewards = [], []
    for share in (0.0, 0.5, 1.0):
        soft = Relaxation(0.01, 0.2, near=0.0, distance=0.0, foregone=share)
        game, place = game_at_a_target()
        game._foregone[:] = 0.6
        where_from = game._root.requires_grad_()
        reward = game.play(place[:, None], soft)
        reward.sum().backward()
        assert where_from.grad is not None
        gradients.append(where_from.grad)
        rewards.append(reward.detach())
    torch.testing.assert_close(rewards[1:], [rewards[0]] * 2)
    assert gradients[0][:2].norm(dim=1).min() > 0.1
    for share, gradient in zip((0.5, 1.0), gradients[1:], strict=True):
        torch.testing.assert_close(gradient[0], (1.0 - 0.6 * share) * gradients[0][0])
        torch.testing.assert_close(gradient[1:], gradients[0][1:])
    settings = shaped(model_settings, foregone=0.8)
    shares = [settings.relaxation(done).foregone for done in (0.0, 0.25, 0.5, 1.0)]
    assert shares == pytest.approx([0.0, 0.4, 0.8, 0.8])


def test_true_rounds_count_what_hits_were_worth() -> None:
    """The first user hits at once, the others stay in targets that are lost after 22 frames."""
    for share, worth in ((0.0, 1.0), (0.5, 0.5 + 0.5 * 0.998)):
        game, place = game_at_a_target()
        soft = Relaxation(0.01, 0.2, near=0.0, distance=0.0, centre=share)
        for _ in range(30):
            game.play(place[:, None], soft)
        assert game.counts[0].sum() == 1
        np.testing.assert_allclose(game._earned, [0.0, worth, 0.0], atol=1e-3)
        game.clear_counts()
        assert game._earned.abs().max() == 0.0


def test_hits_may_be_worth_more_where_the_face_goes_first() -> None:
    """Of a share of .5: all of it forward, cos 60 deg leaves 1 - .25 * .5, sideways 1 - .25."""
    worth = []
    for angle_deg in (0.0, 60.0, 90.0):
        rewards = []
        for share in (0.0, 0.5):
            game, place = game_at_a_target()
            turn = np.radians(angle_deg)
            behind = game._axes[1, 2]
            face = np.cos(turn) * behind + np.sin(turn) * game._axes[1, 0]
            game.hammer.fixed[12, 3:6] = face
            root, game._face = points(*game.hammer(place))  # the box is elsewhere, still inside
            game._root = root - 2.0 * FRAME_S * 0.9 * behind
            soft = Relaxation(0.01, 0.2, near=0.0, distance=0.0, face=share)
            rewards.append(game.play(place[:, None], soft)[0])
            assert bool(game._hit[0, 4]) == (float(rewards[-1]) > 1.0)
        worth.append(float(rewards[1] / rewards[0]))
    assert worth == pytest.approx([1.0, 0.875, 0.75], abs=1e-4)
    settings = shaped(model_settings, face=0.6)
    shares = [settings.relaxation(done).face for done in (0.0, 0.25, 0.5, 1.0)]
    assert shares == pytest.approx([0.0, 0.3, 0.6, 0.6])


def test_hits_may_be_worth_more_where_what_hits_is_fast() -> None:
    """Of a share of .5: at 1.5 m/s a half is left, at 3 and 6 m/s all, going away nothing.

    What the game judges, the hammer near the hand, is the same in all of them.
    """
    soft = Relaxation(overlap_m=0.01, speed_mps=0.2, near=0.0, distance=0.0)
    for speed, worth in ((1.5, 0.75), (3.0, 1.0), (6.0, 1.0), (-1.0, 0.5)):
        rewards = []
        for share in (0.0, 0.5):
            game, place = game_at_a_target(GameModelSettings(impact_speed_weight=share))
            face = points(*game.hammer(place))[1]
            game._face = face - 0.05 * speed * game._strike[game.condition]
            rewards.append(game.play(place[:, None], soft)[0])
        assert float(rewards[0]) > 1.0
        assert float(rewards[1] / rewards[0]) == pytest.approx(worth, abs=1e-4)


def test_hits_are_worth_what_their_cells_say() -> None:
    rewards = []
    for value in (0.0, 1.0, 3.0):
        game, place = game_at_a_target()
        game.hit_values.fill_(value)
        rewards.append(game.play(place[:, None], SOFT))
    assert rewards[1][0] - rewards[0][0] > 1.0
    torch.testing.assert_close(
        rewards[2] - rewards[0], 3.0 * (rewards[1] - rewards[0]), atol=1e-4, rtol=1e-4
    )


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


def test_rewards_are_soft_at_first_and_nearly_the_game_s_from_the_middle_on() -> None:
    settings = GameModelSettings()
    first, quarter, half = (settings.relaxation(done) for done in (0.0, 0.25, 0.5))
    assert (first.overlap_m, first.speed_mps, first.near, first.distance) == (0.015, 0.3, 3.0, 7.0)
    assert (half.overlap_m, half.speed_mps, half.near, half.distance) == (0.004, 0.08, 0.2, 1.0)
    assert settings.relaxation(1.0) == half
    assert quarter.near == pytest.approx(1.6)


def test_a_saved_game_goes_on_to_the_same_bits() -> None:
    game, place = resting_game(12)
    for _ in range(5):
        game.play(place[:, None], SOFT)
    state = game.state_dict()
    after = [game.play(place[:, None], SOFT) for _ in range(20)]
    other, _ = resting_game(12)
    other.load_state_dict(state)
    assert all(torch.equal(value, other.play(place[:, None], SOFT)) for value in after)
