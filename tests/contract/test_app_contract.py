"""What every game must keep, over every transport."""

from collections.abc import Callable

import numpy as np
import players
import pytest
from players import trace
from transports import TRANSPORTS, cases

from sim2vr_harness.client import AppClient, DevicePoses, InProcessApp, list_games


@pytest.fixture(params=cases(), ids=lambda case: f"{case[1]}-{case[0]}")
def case(request: pytest.FixtureRequest) -> tuple[Callable[..., AppClient], str]:
    """How an app is made, and its game."""
    return TRANSPORTS[request.param[0]], request.param[1]


def test_the_same_input_gives_the_same_bits(case) -> None:
    make_app, game = case
    with make_app(game) as one, make_app(game) as two:
        first = trace(one, players.wander)
        assert trace(two, players.wander) == first
        # Nor does it matter what the app did before; seeds matter.
        assert trace(one, players.wander, seed=2) != first
        assert trace(one, players.wander) == first


def test_a_saved_round_goes_on_to_the_bit_in_another_app(case) -> None:
    make_app, game = case
    with make_app(game) as one, make_app(game) as two:
        trace(one, players.wander, 25)
        saved = one.save()
        rest = trace(one, players.wander, 30, start=25)
        two.load(saved)
        assert two.save() == saved
        assert trace(two, players.wander, 30, start=25) == rest
        one.load(saved)
        assert trace(one, players.wander, 30, start=25) == rest


def test_images_are_alive_and_rewards_finite(case) -> None:
    make_app, game = case
    with make_app(game) as app:
        rows = trace(app, players.wander)
        images = {image for _, image, _ in rows}
        assert len(images) > 20, "the picture hardly changes while head and hand move"
        assert all(np.isfinite(reply.reward) for reply, _, _ in rows)
        assert all(-1.0 <= reply.time_feature <= 1.0 for reply, _, _ in rows)
        assert app.image.shape == (80, 120, 4)
        # Every channel carries something.
        assert all(int(np.ptp(app.image[..., channel])) > 0 for channel in range(4))


def test_bad_input_names_the_field_and_leaves_the_round_as_it_was(case) -> None:
    make_app, game = case
    with make_app(game) as app:
        trace(app, players.wander, 3)
        before = app.state_hash()
        good = players.wander(3)
        nan = DevicePoses(good.head, np.full(7, np.nan))
        long = DevicePoses(good.head * [1, 1, 1, 2, 2, 2, 2], good.right_controller)
        with pytest.raises(ValueError, match=r"right_controller.*got.*expected"):
            app.step(3 * players.FRAME_NS, nan)
        with pytest.raises(ValueError, match=r"head\.rotation.*expected"):
            app.step(3 * players.FRAME_NS, long)
        with pytest.raises(ValueError, match=r"time_ns.*backwards"):
            app.step(players.FRAME_NS, good)
        with pytest.raises(ValueError, match="unknown option 'conditon'"):
            app.reset(1, good, {"conditon": "easy"})
        assert app.state_hash() == before
        app.step(3 * players.FRAME_NS, good)


def test_calls_out_of_order_say_what_to_do(case) -> None:
    make_app, game = case
    app = make_app(game)
    with pytest.raises(RuntimeError, match="call reset first"):
        app.step(0, players.idle(0))
    with pytest.raises(RuntimeError, match="call reset first"):
        app.save()
    trace(app, players.idle, 2)
    image = app.image
    copy = image.copy()
    app.close()
    app.close()
    with pytest.raises(RuntimeError, match="closed"):
        app.step(2 * players.FRAME_NS, players.idle(2))
    # The view outlives the app.
    np.testing.assert_array_equal(image, copy)


def test_damaged_or_foreign_states_are_refused(case) -> None:
    make_app, game = case
    with make_app(game) as app:
        trace(app, players.wander, 10)
        saved = app.save()
        for damaged in (b"", saved[: len(saved) // 2], saved + b"x", b"\0" * len(saved)):
            with pytest.raises(RuntimeError, match="saved state"):
                app.load(damaged)
        app.load(saved)
        assert app.save() == saved
        other = next(name for name in sorted(list_games()) if name != game)
        with make_app(other) as foreign, pytest.raises(RuntimeError, match=game):
            foreign.load(saved)


@pytest.mark.parametrize("make_app", TRANSPORTS.values(), ids=TRANSPORTS)
def test_unknown_game_and_condition_name_the_nearest(make_app) -> None:
    with pytest.raises(ValueError, match=r"game.*'wackamole'.*did you mean 'whacamole'"):
        make_app("wackamole")
    with pytest.raises(ValueError, match=r"condition.*'meduim'.*did you mean 'medium'"):
        make_app("whacamole", {"condition": "meduim"})
    with pytest.raises(ValueError, match=r"image size|--width"):
        make_app("whacamole", width=0, height=80)


def test_whacamole_rewards_the_whacker_and_not_the_idle() -> None:
    with InProcessApp("whacamole", {"condition": "medium"}) as app:
        hits = trace(app, players.whacker, 600)[-1][0].log["Points"]
        idle_hits = trace(app, players.idle, 600)[-1][0].log["Points"]
    # 30 s of play; a strike of a random cell at the right time is not rare.
    assert hits >= 10
    assert idle_hits == 0
