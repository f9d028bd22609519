"""Options with controller inputs: which there are, when fingers pull, where rays point."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from sim2vr_harness.evaluation.evaluate import _another_ray
from sim2vr_harness.policies.hierarchical.action_selection import choose
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
)
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS
from sim2vr_harness.policies.hierarchical.primitives import (
    PERSONS,
    OptionChoice,
    PrimitiveController,
)
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import load_body
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay
from webxr_pages import PAGES

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


def test_fingers_let_go_of_what_they_do_not_use() -> None:
    names = ("right.trigger", "left.trigger", "right.thumbstick_x", "right.a")
    fingers = ControllerInputs(names, ("controller_right",))
    values = torch.zeros(1, 1, len(ROLES))
    assert fingers.actions(values).tolist() == [[-1.0, -1.0, 0.0, -1.0]]
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


def test_hands_go_to_the_middle_of_a_thing_and_not_of_its_cell(layer: MotorPolicy) -> None:
    primitives, choice = controller(layer, "right.thumbstick_x"), OptionChoice(1, 1)
    cells = torch.tensor([0.4, -0.2, 1.2])[None, :, None, None].repeat(1, 1, 2, 2)
    middle = torch.tensor([0.41, -0.18, 1.21])
    aims = (middle[None, None], torch.tensor([[0.02]]), torch.zeros(1, 1, 3))
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


def test_a_strike_meets_what_comes_and_waits_for_it_at_its_run_up(layer: MotorPolicy) -> None:
    """A thing 3.7 m ahead, seen .2 s ago, comes at 4 m/s: it is in reach in .55 to .65 s.

    Hands reach the points of a line from 0.7 to 0.3 m here. The hand goes to where the thing will
    be in the middle of it, first 0.4 m before, against the direction of the strike.
    """
    line = torch.eye(4).repeat(41, 1, 1, 1)
    line[:, 0, 0, 3], line[:, 0, 1, 3] = torch.linspace(0.3, 0.7, 41), -0.2
    options = option_set((), None)
    primitives = PrimitiveController(layer, torch.zeros(1, 2, 3), line, options)
    choice, cell = OptionChoice(1, 1), torch.zeros(1, 3, 1, 1)
    there = torch.tensor([[[3.7, -0.2, 0.0]]])
    aims = (there, torch.full((1, 1), 0.1), torch.tensor([[[-4.0, 0.0, 0.0]]]))
    left = np.array([[MOVES.index("left")]])
    choose(choice, left, cell, primitives, aims=aims, late_s=torch.tensor([0.2]))
    assert choice.place[0, 0].tolist() == pytest.approx([0.5, -0.2, 0.0], abs=1e-5)
    assert float(choice.due_s) == pytest.approx(3.2 / 4.0 - 0.2)
    # Then it is not seen to come, where it was to be: the hand still meets it.
    place, head = line[:1], torch.zeros(1, 3)
    waits = primitives.goals(choice, head, place, place)
    for _ in range(6):
        strikes = primitives.goals(choice, head, place, place)
        now = torch.tensor([[[0.5 + 4.0 * float(choice.due_s), -0.2, 0.0]]])
        hidden = (now, aims[1], torch.zeros(1, 1, 3))
        choose(choice, left, cell, primitives, aims=hidden, late_s=torch.tensor([0.0]))
    assert waits.velocity.abs().max() == 0.0 and waits.due_s.isnan().all()
    assert waits.place[0, 0].tolist() == pytest.approx([0.5, -0.6, 0.0], abs=1e-5)
    assert strikes.place[0, 0].tolist() == pytest.approx([0.5, -0.2, 0.0], abs=1e-5)
    assert strikes.velocity[0, 0].tolist() == pytest.approx([0.0, 2.0, 0.0], abs=1e-5)
    assert float(strikes.due_s) == pytest.approx(0.3) == float(strikes.left_s)
    # Another thing, which does not come, is struck at once.
    far = (torch.tensor([[[0.4, -0.2, 0.0]]]), aims[1], torch.zeros(1, 1, 3))
    choose(choice, left, cell, primitives, aims=far)
    assert choice.due_s.isnan().all() and float(choice.place[0, 0, 0]) == pytest.approx(0.4)


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
    found = "sim2vr_harness.policies.hierarchical.pointing.own_ray"
    monkeypatch.setattr(found, lambda *_: DeviceRay(np.zeros(3), RAY))
    said = _another_ray(again, SimpleNamespace(config=config.env))
    assert "60 degrees from that of its training" in said


@pytest.mark.parametrize(("lifts", "passages"), [(1.0, [1, 2]), (0.0, [1, 1])])
def test_hands_that_lift_off_tap_once_and_again_after_a_pause(
    layer: MotorPolicy, lifts: float, passages: list[int]
) -> None:
    """A hand goes halfway to its goal in every user step; the surface is 0.4 m ahead."""
    still = PrimitiveController(
        layer, torch.zeros(1, 2, 3), poses(layer), manner=PERSONS, rays=AIM_RAYS
    )
    still.lifts = torch.full((1, 1, 1), lifts)
    choice, target = OptionChoice(1, 1), torch.tensor([0.4, 0.0, 1.2])
    choice.move[:] = MOVES.index("touch")
    choice.seen[:] = choice.place[:] = target
    choice.width[:] = 0.03
    head, hand = torch.tensor([[0.0, 0.0, 1.2]]), torch.eye(4)[None, None].clone()
    hand[..., :3, 3] = torch.tensor([0.3, 0.2, 1.1])
    x = [0.3]
    for _ in range(40):  # a tap takes about 0.5 s here, the pause 0.6 s
        goal = still.goals(choice, head, hand, hand).place
        hand[..., :3, 3] += 0.5 * (goal - hand[..., :3, 3])
        x.append(float(hand[0, 0, 0, 3]))
        if x[-2] <= 0.4 < x[-1]:
            assert float((hand[0, 0, :3, 3] - target)[1:].norm()) < 0.015
    behind = np.diff(np.array(x) > 0.4, prepend=False)
    assert [int(behind[:n].sum() + 1) // 2 for n in (20, 40)] == passages
