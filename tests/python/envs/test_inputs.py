"""Fingers on the controllers' inputs, and heads that answer what apps wish."""

from typing import Any

import numpy as np
import pytest
from fake_device_app import FakeDeviceApp

from sim2vr_harness.client import INPUT_COUNT, input_named
from sim2vr_harness.envs import AppConfig, EffortConfig, EnvConfig, Simulation, UserConfig
from sim2vr_harness.envs.actions import Actions

INPUTS = ("right.trigger", "right.thumbstick_x", "right.a")


def simulation_of(
    n: int = 1, frames: int = 1, user: dict[str, Any] | None = None, **app: Any
) -> tuple[Simulation, list[FakeDeviceApp]]:
    apps: list[FakeDeviceApp] = []

    def make(_config: EnvConfig, _index: int, _log_dir: Any) -> Any:
        apps.append(FakeDeviceApp(**app))
        return apps[-1]

    config = EnvConfig(
        app=AppConfig(options={}),
        vision={"width": 8, "height": 8},
        user=UserConfig(**({"inputs": INPUTS} if user is None else user)),
        frames_per_step=frames,
    )
    return Simulation(config, n, make_app=make), apps


def acted(*fingers: float) -> np.ndarray:
    return np.concatenate([np.zeros(32), fingers])[None]


def test_analogue_inputs_follow_the_action_and_buttons_have_hysteresis() -> None:
    hands = Actions(1, ("muscle",), INPUTS, 0.0, 0.05)
    assert hands.names == ("muscle", *INPUTS)
    assert hands.input_values.tolist() == [[0, 0, 0]]
    seen = []
    for action in (0.0, 0.33, 0.34, 0.0, -0.33, -0.34, 0.3, 1.0):
        body = hands.take(np.array([[0.5, action, action, action]]))
        assert body.tolist() == [[0.5]]
        seen.append(hands.input_values[0].tolist())
    trigger, stick, button = np.array(seen).T
    np.testing.assert_allclose(trigger, [0.5, 0.665, 0.67, 0.5, 0.335, 0.33, 0.65, 1.0])
    np.testing.assert_allclose(stick, [0.0, 0.33, 0.34, 0.0, -0.33, -0.34, 0.3, 1.0])
    assert button.tolist() == [0, 0, 1, 1, 1, 0, 0, 1]
    hands.reset(np.array([0]))
    assert hands.input_values.tolist() == [[0, 0, 0]]


def test_actions_are_clipped_and_checked_before_anything_moves() -> None:
    hands = Actions(2, ("muscle",), ("left.x",), 45.0, 0.2)
    hands.take(np.array([[0, 9.0, 0.5, -9.0]] * 2))
    assert hands.input_values.tolist() == [[1], [1]]
    assert hands.gaze_deg.tolist() == [[22.5, -45.0]] * 2
    for wrong, message in (
        (np.zeros((2, 3)), r"action: got shape \(2, 3\), expected \(2, 4\)"),
        (np.array([[0, -1, 0, 0], [0, -1, 0, np.nan]]), r"action\[1, 3\] \(gaze up\): got nan"),
    ):
        with pytest.raises(ValueError, match=message):
            hands.take(wrong)
        assert hands.input_values.tolist() == [[1], [1]]


def test_the_app_gets_rows_of_inputs_that_are_constant_within_a_step() -> None:
    simulation, apps = simulation_of(2, frames=5)
    assert simulation.action_space.shape == (35,)
    simulation.reset(seeds=[1, 2])
    assert apps[0].got[0].right_inputs is None  # at rest
    simulation.step(np.concatenate([acted(0.0, 0.5, 1.0), acted(-1.0, 0.0, -1.0)]))
    one, two = (app.got[1] for app in apps)
    assert one.left_inputs is None
    assert one.left_controller is None
    assert one.right_inputs.shape == (5, INPUT_COUNT)
    expected = np.zeros(INPUT_COUNT)
    expected[[input_named(name).column for name in INPUTS]] = [0.5, 0.5, 1.0]
    np.testing.assert_array_equal(one.right_inputs, [expected] * 5)
    assert not two.right_inputs.any()
    simulation.close()


def test_a_pressed_button_is_saved_and_let_go_by_a_reset() -> None:
    one, other = (simulation_of(1)[0] for _ in range(2))
    one.reset(seeds=[1])
    one.step(acted(-1.0, 0.0, 1.0))
    other.load_state_dict(one.state_dict())
    other.step(acted(-1.0, 0.0, 0.0))
    assert other.apps[0].got[-1].right_inputs[0, input_named("right.a").column] == 1.0
    other.reset()
    other.step(acted(-1.0, 0.0, 0.0))
    assert not other.apps[0].got[-1].right_inputs.any()
    one.close()
    other.close()


def test_fingers_are_free_unless_they_are_to_cost() -> None:
    costs = []
    for effort in (EffortConfig(), EffortConfig(finger_effort=0.01)):
        simulation, _ = simulation_of(1, user={"inputs": INPUTS, "effort": effort})
        simulation.reset(seeds=[1])
        costs.append(simulation.step(acted(0.0, -0.6, 1.0)).effort_cost[0])
        simulation.close()
    # The trigger half, the stick 0.6 to the left, the button.
    assert costs[1] - costs[0] == pytest.approx(0.01 * (0.5 + 0.6 + 1.0))


@pytest.mark.parametrize(
    ("user", "message"),
    [
        ({"inputs": ["right.triger"]}, "got 'right.triger', .* did you mean 'right.trigger'"),
        (
            {"inputs": ["left.x"]},
            "user.inputs: got 'left.x', expected .* headset, controller_right",
        ),
    ],
)
def test_wrong_hands_are_refused(user: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulation_of(1, user=user)


def test_the_head_answers_what_the_app_wishes() -> None:
    as_it_is, others = simulation_of(1, user={})
    wished, apps = simulation_of(1, user={}, head_pitch_deg=20.0)
    for simulation in (as_it_is, wished):
        simulation.reset(seeds=[4])
        simulation.step(np.zeros((1, 32)))
    for got in apps[0].got[:2]:
        # Pitch 20 degrees up about x (right) in the app's left-handed frame: -10 degrees of half.
        turn = got.head.reshape(-1, 7)[-1, 3:]
        turn = turn * np.sign(turn[3])  # q and -q are the same rotation
        np.testing.assert_allclose(
            turn, [-np.sin(np.radians(10)), 0, 0, np.cos(np.radians(10))], atol=1e-9
        )
    assert len(apps[0].asked) == 1  # once per round, with its seed, before it starts
    np.testing.assert_array_equal(apps[0].got[0].head[:3], others[0].got[0].head[:3])
    np.testing.assert_array_equal(wished.users.qpos, as_it_is.users.qpos)
    as_it_is.close()
    wished.close()
