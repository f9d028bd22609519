"""What an app can do beyond poses and pictures: the same over every transport that carries it."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import players
import pytest
import transports

from sim2vr_harness.client import (
    INPUT_COUNT,
    AppClient,
    AppReply,
    AppUnsupported,
    DevicePoses,
    HapticPulse,
    Observer,
    frame_time_ns,
    input_named,
)

ALONE, *OTHERS = transports.TRANSPORTS
BIG_BALL = {"ball_radius_m": 0.2}


def sweeper(frame: int) -> DevicePoses:
    """Both hands over where the sample's ball can be; the right trigger in every seventh frame."""
    x, y = -0.3 + 0.1 * (frame % 8), 0.9 + 0.1 * (frame // 8 % 5)
    inputs = np.zeros(INPUT_COUNT)
    inputs[input_named("right.trigger").column] = 0.75 if frame % 7 == 0 else 0.25
    inputs[input_named("right.a").column] = frame % 2
    hand = players.controller_at(np.array([x, y, 0.45]))
    left = players.controller_at(np.array([-x, y, 0.3]))
    return DevicePoses(players.HEAD, hand, left, inputs, np.zeros(INPUT_COUNT))


def at_rest(poses: DevicePoses) -> DevicePoses:
    return replace(poses, right_inputs=None, left_inputs=None)


def without_events(reply: AppReply) -> AppReply:
    return replace(reply, haptics=(), sounds=())


def played(app: AppClient, moments: Iterable[DevicePoses]) -> list[tuple[AppReply, bytes, int]]:
    rows = []
    for frame, poses in enumerate(moments):
        reply = (
            app.step(frame_time_ns(frame, 20), poses) if frame else app.reset(3, poses, BIG_BALL)
        )
        rows.append((reply, app.image.tobytes(), app.state_hash()))
    return rows


@pytest.fixture(params=OTHERS)
def transport(request: pytest.FixtureRequest) -> str:
    return request.param


def make(name: str, game: str, **settings: Any) -> AppClient:
    return transports.TRANSPORTS[name](game, **settings)


def test_inputs_there_and_events_back(transport: str) -> None:
    with make(ALONE, "sample") as near, make(transport, "sample") as far:
        carries = far.capabilities
        moments = [sweeper(frame) for frame in range(80)]
        if "inputs" not in carries:
            with pytest.raises(AppUnsupported, match=r"^inputs: "):
                far.reset(3, moments[0])
            moments = [at_rest(poses) for poses in moments]
        expected, found = played(near, moments), played(far, moments)
    pulses = [pulse for reply, _, _ in expected for pulse in reply.haptics]
    assert len(pulses) > 3
    assert set(pulses) == {HapticPulse("right", 0.5, 0.0, 0.02)}
    assert [sound.name for reply, _, _ in expected for sound in reply.sounds] == ["touch"] * len(
        pulses
    )
    if "haptics" not in carries:
        expected = [(without_events(r), image, state) for r, image, state in expected]
    assert found == expected


def test_head_requests(transport: str) -> None:
    with make(ALONE, "whacamole") as near, make(transport, "whacamole") as far:
        for condition, pitch_deg in (("low", -30.0), ("medium", None), ("high", 30.0)):
            options = {"condition": condition}
            wished = near.head_request(5, options)
            assert far.head_request(5, options) == wished
            if pitch_deg is not None:
                assert wished == pytest.approx(pitch_deg, abs=1e-4)
        assert far.head_request(5, {"head_request": False}) is None
        with pytest.raises(ValueError, match="unknown option"):
            far.head_request(5, {"nosuch": 1})
    with make(transport, "sample") as app:
        assert app.head_request(5) is None


def test_two_eyes(transport: str) -> None:
    eyes = {"eyes": 2, "ipd_m": 0.1, "width": 60, "height": 40}
    if transport == "protocol1":
        with pytest.raises(AppUnsupported, match=r"^two_eyes: "):
            make(transport, "sample", **eyes)
        return
    with make(ALONE, "sample", **eyes) as near, make(transport, "sample", **eyes) as far:
        assert far.image.shape == (2, 40, 60, 4)
        moments = [sweeper(frame) for frame in range(10)]
        assert played(far, moments) == played(near, moments)
        left, right = far.image
        assert (left != right).mean() > 0.01
        state = near.save()
        far.reset(9, moments[0])
        far.load(state)
        np.testing.assert_array_equal(far.image, near.image)


@pytest.mark.parametrize("name", transports.TRANSPORTS)
def test_an_observer_looks_from_anywhere(name: str) -> None:
    """From 1 m before the middle of a ball of 20 cm its front is 80 cm away."""
    with make(name, "sample") as app:
        app.reset(3, at_rest(sweeper(0)), BIG_BALL)
        if name == "protocol1":
            with pytest.raises(AppUnsupported, match=r"^observers: "):
                app.observe(())
            return
        (ball,) = app.scene().named("Ball")
        x, y, z = ball.pose[:3]
        place = (x, y, z - 1.0, 0.0, 0.0, 0.0, 1.0)
        app.observe([Observer(33, 33, place, 60.0), Observer(24, 16)])
        before, head = app.observed()
        assert before.depth_m is not None
        assert before.depth_m[16, 16] == pytest.approx(0.8, abs=0.005)
        assert np.isinf(before.depth_m[0]).all()
        np.testing.assert_array_equal(head.rgb, app.render_headset(24, 16)[..., :3])
        app.observe([Observer(33, 33, (*place[:3], 0.0, 0.0, 0.0, 2.0), 60.0)])
        with pytest.raises(ValueError, match="observer"):
            app.observed()


@pytest.mark.parametrize("drawn", [0, 1])
def test_any_frame_of_a_step_can_be_drawn(transport: str, drawn: int) -> None:
    moments = [at_rest(sweeper(frame)) for frame in (1, 2, 3)]
    poses = DevicePoses.stack(moments)
    times = np.array([frame_time_ns(frame, 60) for frame in (1, 2, 3)])
    with make(ALONE, "sample") as near, make(transport, "sample") as far:
        for app in (near, far):
            app.reset(3, moments[0], BIG_BALL)
        if transport == "protocol1":
            with pytest.raises(AppUnsupported, match=r"^frames: "):
                far.step_frames(times, poses, drawn)
            return
        one, other = (app.step_frames(times, poses, drawn) for app in (near, far))
        if "haptics" not in far.capabilities:
            one = without_events(one)
        assert one == other
        np.testing.assert_array_equal(far.image, near.image)
        assert far.state_hash() == near.state_hash()
