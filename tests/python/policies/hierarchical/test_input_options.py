"""Options with controller inputs: which there are, when fingers pull, where rays point."""

import copy
from contextlib import closing
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs import AppConfig, EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.evaluate import _another_ray
from sim2vr_harness.policies.hierarchical.action_selection import best_choices, choose
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid
from sim2vr_harness.policies.hierarchical.motor_policy import WIDTH_M, MotorPolicy, reachable_poses
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy
from sim2vr_harness.policies.hierarchical.options import (
    MOVES,
    PLACED,
    PLAIN,
    ROLES,
    ControllerInputs,
    option_set,
    with_inputs_at_rest,
)
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS, aim_of, off_ray, rays_of
from sim2vr_harness.policies.hierarchical.primitives import (
    PERSONS,
    OptionChoice,
    PrimitiveController,
)
from sim2vr_harness.policies.hierarchical.tool_detection import Tool, _judged, straight_tool
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import UserBatch, load_body
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay
from webxr_pages import CDN, ENGINES, NEEDS_BROWSER, NEEDS_ENGINES, PAGES

STEP_S = 0.05
RAY = np.array([0.5, 0.0, -np.sqrt(0.75)])
AHEAD = np.array([1.0, 0.0, 0.0])
ALONG_GRIP = torch.tensor([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
"""The laser of an A-Frame page without its model of the controller."""


@pytest.fixture(scope="module")
def layer() -> MotorPolicy:
    return motor_layer_for(load_body("mobl_arms_wrist"), STEP_S)


@cache
def poses(layer: MotorPolicy) -> torch.Tensor:
    return reachable_poses(layer, 1)


def controller(
    layer: MotorPolicy,
    *inputs: str,
    wanted: tuple[str, ...] | None = None,
    rays: torch.Tensor = AIM_RAYS,
):
    options = option_set(inputs, wanted)
    return PrimitiveController(layer, torch.zeros(1, 2, 3), poses(layer), options, rays=rays)


def test_options_follow_from_the_inputs() -> None:
    assert option_set([]) == PLAIN
    assert PLAIN.placed == MOVES
    trigger = option_set(["right.trigger"])
    assert trigger.placed == (*MOVES, "press", "point")
    assert trigger.free == ()
    assert option_set(["right.squeeze"]).placed == (*MOVES, "grab", "release", "pull")
    stick = option_set(["left.thumbstick_x", "left.y"])
    assert stick.placed == MOVES
    assert stick.free == ("turn left", "turn right", "second button")
    assert trigger.count(600) == 12 * 600 + 1
    assert stick.count(600) == 10 * 600 + 4


def test_options_can_be_limited_to_what_the_inputs_allow() -> None:
    only = option_set(["right.trigger"], ["point", "hold"])
    assert only.placed == ("point", "hold")
    assert only.favoured == (0, 1)
    with pytest.raises(InputError, match=r"skills\.options: got 'turn' with .*thumbstick_x"):
        option_set(["right.trigger"], ["touch", "turn"])


def test_values_of_a_network_have_a_place_for_every_choice() -> None:
    sight, options = DepthGrid(80, 120), option_set(["right.trigger", "right.thumbstick_x"])
    net = ActionValueMap(sight, 2, options)
    zeros = torch.zeros(3, 2, 3)
    pictures = torch.zeros(3, 8, 80, 120, dtype=torch.uint8)
    places = torch.zeros(3, 3, sight.rows, sight.columns)
    values = net(pictures, places, torch.zeros(3, 3), zeros, zeros)
    assert values.shape == (3, 2, 12 * sight.cells + 3)
    # Nothing is in sight: to rest and to turn are what is left.
    values = values - torch.arange(values.shape[-1]).float()
    nothing = torch.zeros(3, sight.cells, dtype=torch.bool)
    assert (best_choices(values, nothing, options) == options.rest(sight.cells)).all()


def test_fingers_let_go_of_what_they_do_not_use() -> None:
    names = ("right.trigger", "left.trigger", "right.thumbstick_x", "right.a")
    fingers = ControllerInputs(names, ("controller_right",))
    values = torch.zeros(1, 1, len(ROLES))
    assert fingers.actions(values).tolist() == [[-1.0, -1.0, 0.0, -1.0]]
    assert with_inputs_at_rest(np.ones((1, 2), np.float32), names).tolist() == [
        [1.0, 1.0, -1.0, -1.0, 0.0, -1.0]
    ]
    values[0, 0, ROLES.index("squeeze")] = 1.0  # the trigger does its work
    values[0, 0, ROLES.index("thumbstick_x")] = -1.0
    assert fingers.actions(values).tolist() == [[1.0, -1.0, -1.0, -1.0]]


def test_a_trigger_is_pulled_on_arrival_and_again_at_another_place(layer: MotorPolicy) -> None:
    """For 0.1 s; at the same place after 0.6 s, at another one after 0.1 s more."""
    primitives = controller(layer, "right.trigger")
    choice, place = OptionChoice(1, 1), torch.eye(4)[None, None]
    choice.move[:] = PLACED.index("press")
    choice.place[:] = choice.seen[:] = torch.tensor([0.3, 0.0, 0.0])
    pulls = lambda steps: [primitives.inputs(choice, place)[0, 0] > 0.0 for _ in range(steps)]  # noqa: E731
    assert not any(pulls(3))  # 30 cm away
    choice.place[:] = choice.seen[:] = torch.tensor([0.02, 0.0, 0.0])
    assert pulls(14) == [True] * 2 + [False] * 10 + [True] * 2
    choice.place[:] = choice.seen[:] = torch.tensor([-0.02, 0.06, 0.0])
    choice.place[:] = torch.zeros(3)
    assert pulls(4) == [False] * 2 + [True] * 2


def test_a_squeeze_stays_closed_until_it_is_released_at_a_place(layer: MotorPolicy) -> None:
    primitives = controller(layer, "right.squeeze")
    choice, place = OptionChoice(1, 1), torch.eye(4)[None, None].clone()

    def closed(move: str, x_m: float) -> bool:
        choice.move[:] = PLACED.index(move)
        choice.place[0, 0, 0] = x_m
        return bool(primitives.inputs(choice, place)[0, 0] > 0.0)

    assert not closed("touch", 0.0)
    assert not closed("grab", 0.2)
    assert closed("grab", 0.0)
    assert closed("touch", 0.4)  # carries it
    assert closed("release", 0.4)  # on the way
    place[0, 0, 0, 3] = 0.4
    assert not closed("release", 0.4)


def test_a_hand_that_pulls_closes_at_its_place_and_opens_30_cm_behind_it(
    layer: MotorPolicy,
) -> None:
    primitives = controller(layer, "right.squeeze")
    choice, place, head = OptionChoice(1, 1), torch.eye(4)[None, None].clone(), torch.zeros(1, 3)
    choice.move[:] = PLACED.index("pull")
    choice.place[:] = choice.seen[:] = torch.tensor([0.5, 0.0, 0.0])

    def step(x_m: float) -> tuple[bool, float]:
        """Whether the hand is closed at a place, and where it goes from there."""
        place[0, 0, 0, 3] = x_m
        goal = primitives.goals(choice, head, place, place).place
        return bool(primitives.inputs(choice, place)[0, 0] > 0.0), float(goal[0, 0, 0])

    assert step(0.2) == (False, pytest.approx(0.525))  # 2.5 cm deeper, as to touch
    assert step(0.49)[0]
    assert step(0.4) == (True, pytest.approx(0.19))
    choice.place[:] = choice.seen[:] = torch.tensor([0.3, 0.0, 0.0])  # what it holds has moved
    assert step(0.3) == (True, pytest.approx(0.19))
    assert not step(0.2)[0]
    assert step(0.2) == (False, pytest.approx(0.325))
    # Out of the body's reach, it opens after 1.2 s.
    closed = [step(0.3)[0] for _ in range(26)]
    assert closed == [True] * 24 + [False] + [True]


def test_hands_go_to_the_middle_of_a_thing_and_not_of_its_cell(layer: MotorPolicy) -> None:
    primitives, choice = controller(layer, "right.thumbstick_x"), OptionChoice(1, 1)
    cells = torch.tensor([0.4, -0.2, 1.2])[None, :, None, None].repeat(1, 1, 2, 2)
    middle = torch.tensor([0.41, -0.18, 1.21])
    aims = (middle[None, None], torch.tensor([[0.02]]))
    choose(choice, np.array([[2]]), cells, primitives, aims=aims)
    assert choice.move[0, 0] == MOVES.index("touch")
    assert choice.seen[0, 0].tolist() == pytest.approx(middle.tolist())
    assert choice.place[0, 0].tolist() == pytest.approx(middle.tolist())  # within reach
    place = torch.eye(4)[None, None]
    goals = primitives.goals(choice, torch.zeros(1, 3), place, place)
    assert float(goals.width) == pytest.approx(0.6 * 0.02)  # well inside
    choose(choice, np.array([[4 + 2]]), cells, primitives, aims=aims)
    pushed = primitives.goals(choice, torch.zeros(1, 3), place, place)
    assert choice.move[0, 0] == MOVES.index("push")
    assert float(pushed.width) == pytest.approx(WIDTH_M)  # what suits a push, whatever the thing


def test_hands_lift_off_or_go_straight(layer: MotorPolicy) -> None:
    """Of a place 40 cm ahead, from 20 cm beside it: to 5 cm before it, or 2.5 cm behind it."""
    hands = PrimitiveController(layer, torch.zeros(1, 2, 3), poses(layer))
    choice = OptionChoice(2, 1)
    choice.move[:] = MOVES.index("touch")
    choice.place[:] = choice.seen[:] = torch.tensor([0.4, 0.0, 0.0])
    place = torch.eye(4).repeat(2, 1, 1, 1)
    place[..., :3, 3] = torch.tensor([0.4, 0.2, 0.0])
    both = hands.goals(choice, torch.zeros(2, 3), place, place).place[:, 0, 0]
    assert both.tolist() == pytest.approx([0.35, 0.35])
    hands.lifts = torch.tensor([1.0, 0.0])[:, None, None]
    both = hands.goals(choice, torch.zeros(2, 3), place, place).place[:, 0, 0]
    assert both.tolist() == pytest.approx([0.35, 0.425])


def test_persons_push_with_the_hand(layer: MotorPolicy) -> None:
    """A tip 10 cm ahead is to pass 3 cm before a place 40 cm ahead: the hand itself at 27 cm."""
    tool = torch.tensor([0.1, 0.0, 0.0]).expand(1, 2, 3)
    hands = PrimitiveController(layer, tool, poses(layer), manner=PERSONS)
    choice = OptionChoice(1, 1)
    choice.move[:] = MOVES.index("push")
    choice.place[:] = choice.seen[:] = torch.tensor([0.4, 0.0, 0.0])
    place = torch.eye(4).expand(1, 1, 4, 4).clone()
    goals = hands.goals(choice, torch.tensor([[-0.3, 0.0, 0.0]]), place, place)
    assert goals.tip.abs().max() == 0.0
    assert goals.place[0, 0].tolist() == pytest.approx([0.27, 0.0, 0.0], abs=1e-6)
    assert goals.velocity[0, 0].tolist() == pytest.approx([PERSONS.push_mps, 0.0, 0.0], abs=1e-6)


def test_a_stick_is_pushed_while_the_hand_goes_on(layer: MotorPolicy) -> None:
    primitives = controller(layer, "right.thumbstick_x")
    choice, place = OptionChoice(1, 1), torch.eye(4)[None, None]
    places = torch.zeros(1, 3, 2, 2)
    choose(choice, np.array([[5]]), places, primitives)
    assert int(choice.move) == MOVES.index("push")
    choose(choice, np.array([[10 * 4 + 2]]), places, primitives)
    assert int(choice.move) == MOVES.index("push")
    turned = [float(primitives.inputs(choice, place)[0, 0]) for _ in range(3)]
    assert turned == [1.0, 1.0, 0.0]
    choose(choice, np.array([[10 * 4]]), places, primitives)
    assert int(choice.move) == -1


def test_the_aim_ray_is_the_page_s_and_the_runtime_s() -> None:
    place = torch.eye(4)
    place[:3, 3] = torch.tensor([0.0, 0.0, 1.0])
    assert aim_of(place).tolist() == pytest.approx(RAY.tolist())
    on = torch.tensor(RAY * 2.0 + [0.0, 0.1, 1.0]).float()
    beside, along = off_ray(place, on)
    assert float(beside) == pytest.approx(0.1, abs=1e-6)
    assert float(along) == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("rays", [AIM_RAYS, ALONG_GRIP], ids=["WebXR", "page"])
def test_a_ray_comes_to_a_place_within_a_degree_and_stays(
    layer: MotorPolicy, rays: torch.Tensor
) -> None:
    """A key of 6 cm at 1.5 m is 1.1 degrees to each side; rays were within 0.8 after 1 s."""
    body, n = layer.body, 6
    primitives = controller(layer, "right.trigger", rays=rays)
    bodies = UserBatch(body, n, threads=1, effort="zero")
    bodies.reset(range(n), [np.random.default_rng(i) for i in range(n)])
    choice = OptionChoice(n, 1)
    choice.move[:] = PLACED.index("point")
    grid = [[1.55, y, z] for y in (-0.4, -0.1, 0.2) for z in (0.9, 1.4)]
    choice.place[:, 0] = choice.seen[:, 0] = torch.tensor(grid)
    wrong, pulled = [], np.zeros(n)
    for _ in range(40):
        motion = layer.motion(bodies)
        placed = layer.places(*motion[:2])
        head = torch.from_numpy(bodies.device_poses("headset")[0]).float()
        goals = primitives.goals(choice, head, *placed)
        beside, along = off_ray(placed[0], choice.seen, rays)
        wrong.append(torch.rad2deg(torch.atan2(beside, along)).flatten())
        on = primitives.inputs(choice, placed[0])[:, 0] > 0.0
        started = on & (pulled == 0.0)
        assert (wrong[-1].numpy()[started] < 1.1).all()
        pulled += on
        bodies.step(layer.decide(motion, placed, goals))
    assert float(torch.stack(wrong[-15:]).max()) < 1.1
    assert float(wrong[-1].max()) < 0.3
    assert (pulled >= 4).all()  # twice within two seconds


@pytest.mark.parametrize(
    ("length_m", "way", "ray", "pointed", "is_tool"),
    [
        (0.3, RAY, RAY, True, True),
        (0.9, RAY, RAY, True, False),
        (0.9, RAY, RAY, False, True),
        (0.9, AHEAD, RAY, True, True),
        (0.9, AHEAD, AHEAD, True, False),
        (1.3, AHEAD, RAY, False, False),
    ],
)
def test_a_ray_is_no_tool(
    length_m: float, way: np.ndarray, ray: np.ndarray, pointed: bool, is_tool: bool
) -> None:
    found = Tool(np.outer(np.linspace(0.05, length_m, 40), way))
    judged = _judged(found, np.array([np.zeros(3), ray]), pointed=pointed)
    assert bool(judged.tip.any()) == is_tool
    assert ("a tool of" in judged.why) == is_tool
    assert is_tool or f"{100 * length_m:.0f} cm" in judged.why


def test_a_tool_of_a_given_length_goes_on_forward() -> None:
    tool = straight_tool(0.5)
    assert tool.tip[0] == pytest.approx(0.5 - 0.01 / 2, abs=0.003)
    assert not tool.tip[1:].any()


def test_a_hand_forgets_its_inputs_when_a_round_begins() -> None:
    choice = OptionChoice(2, 1)
    choice.closed[:] = 3
    choice.pulled[:] = 7
    before = copy.deepcopy(choice)
    choice.forget(np.array([1]))
    assert choice.closed.flatten().tolist() == [3, 0]
    assert choice.pulled.flatten().tolist() == [7, 0]
    assert torch.equal(before.move[0], choice.move[0])


def laser_page() -> EnvConfig:
    task = {
        "inputs": ["right.trigger"],
        "reward": {"expression": "app.clicks"},
        "values": {"clicks": "app.clicks"},
    }
    page = str(PAGES / "laser.html")
    app = AppConfig(transport="webxr", page=page, map={CDN: str(ENGINES)}, task=task)
    return ResolvedEnv(EnvConfig(app=app)).with_task().config


def clicks(simulation: Simulation, layer: MotorPolicy, rays: torch.Tensor) -> float:
    """Point at the page's box for two seconds; its clicks."""
    primitives = controller(layer, "right.trigger", rays=rays)
    choice = OptionChoice(1, 1)
    choice.move[:] = PLACED.index("point")
    choice.place[:, 0] = choice.seen[:, 0] = torch.tensor([1.0, -0.2, 1.2])
    simulation.reset(seeds=[1])
    for _ in range(40):
        motion = layer.motion(simulation.users)
        placed = layer.places(*motion[:2])
        head = torch.from_numpy(simulation.users.device_poses("headset")[0]).float()
        goals = primitives.goals(choice, head, *placed)
        body = layer.decide(motion, placed, goals)
        result = simulation.step(np.concatenate([body, primitives.inputs(choice, placed[0])], 1))
    return float(result.infos[0]["log"]["clicks"])


@NEEDS_BROWSER
@NEEDS_ENGINES
def test_hands_press_what_a_page_s_own_ray_is_on(layer: MotorPolicy) -> None:
    """Its laser lies along the grip's axis, 60 degrees from WebXR's ray, which hits nothing."""
    with closing(Simulation(laser_page())) as simulation, torch.inference_mode():
        rays = rays_of(simulation, layer.hands)
        torch.testing.assert_close(rays, ALONG_GRIP, rtol=0.0, atol=0.01)
        assert clicks(simulation, layer, rays) >= 2.0
        assert clicks(simulation, layer, AIM_RAYS) == 0.0


def test_a_run_keeps_the_ray_of_its_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its weights have it, an evaluation says when the page's has changed; games have none."""
    page, inputs = f"env.app.page={PAGES / 'laser.html'}", "env.user.inputs=[right.trigger]"
    config = load_config("skills", [page, "env.app.transport=webxr", inputs])
    policy = HierarchicalPolicy(config)
    policy.rays.copy_(ALONG_GRIP)
    again = HierarchicalPolicy(config)
    again.load_state_dict(policy.state_dict())
    assert torch.equal(again.primitives.rays, ALONG_GRIP)
    assert "rays" not in HierarchicalPolicy(load_config("skills", [inputs])).state_dict()
    users = SimpleNamespace(config=config.env)
    found = "sim2vr_harness.policies.hierarchical.pointing.own_ray"
    monkeypatch.setattr(found, lambda *_: DeviceRay(np.zeros(3), AHEAD))
    assert _another_ray(again, users) == ""
    monkeypatch.setattr(found, lambda *_: DeviceRay(np.zeros(3), RAY))
    words = "pointing with the page's ray of today, 60 degrees from that of its training"
    assert _another_ray(again, users) == words
