"""Imagined bodies of all kinds: muscles, motors and both, one arm, two arms, a trunk that moves."""

import numpy as np
import pytest
import torch
from true_users import motion_of

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.users import Body, UserBatch, load_body
from sim2vr_harness.users.noise import MotorNoiseSettings
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.body_dynamics import BodyModel, fit_body
from sim2vr_harness.world_models.effort import imagined_effort, volume_shares
from sim2vr_harness.world_models.gradient_clipping import limited, within
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import Motion, TransitionStore

MOTORS, MUSCLES, WRIST = "mobl_arms_bimanual_motor", "mobl_arms_bimanual", "mobl_arms_wrist"
BODIES = ((WRIST, False), (MOTORS, False), (MOTORS, True), (MUSCLES, True))


def body_of(name: str, torso: bool) -> Body:
    return load_body(name, torso=True) if torso else load_body(name)


@pytest.mark.parametrize(("name", "torso"), BODIES)
def test_actions_do_to_drives_what_they_do_to_the_true_ones(name: str, torso: bool) -> None:
    users = UserBatch(body_of(name, torso), 4, threads=1, effort="neural")
    drives = ActuatorState(users.body)
    assert drives.count == users.action_size
    assert len(drives.muscles) + len(drives.motors) == drives.count
    rng = np.random.default_rng(1)
    for _ in range(3):
        before = torch.tensor(drives.of(users))
        actions = rng.uniform(-1.4, 1.4, (4, drives.count))
        users.step(actions)
        control = drives.control(before, torch.tensor(actions)).numpy()
        np.testing.assert_allclose(control, drives.controls(users), atol=1e-9)
        after = drives.of(users)[:, drives.motors]
        np.testing.assert_allclose(after, control[:, drives.motors], atol=1e-9)


def test_a_motor_s_target_by_hand() -> None:
    """m <- 0.1 m + 0.9 clip(m + a, 0, 1): 0.5 and 0.2 make 0.68; beyond the range 0.95."""
    drives = ActuatorState(load_body(MOTORS))
    actions = torch.zeros(1, 14)
    actions[0, :2] = torch.tensor([0.2, 3.0])
    control = drives.control(torch.full((1, 14), 0.5), actions)
    assert control[0, :3].tolist() == pytest.approx([0.68, 0.95, 0.5])


def test_a_body_model_that_knows_nothing_does_not_run_away() -> None:
    body = load_body(MOTORS, torso=True)
    torch.manual_seed(2)
    model = BodyModel(body, ("headset",), 0.05, width=16)
    for parameter in model.parameters():
        parameter.data *= 20.0
    motion = Motion(*(torch.zeros(4, size) for size in (20, 20, 20, 0)))
    low, high = torch.tensor(body.joint_ranges.T.copy())
    for _ in range(20):
        motion = model(motion, torch.rand(4, 20))
        assert motion.speeds.abs().max() <= 40.0
        assert ((motion.angles >= low - 0.301) & (motion.angles <= high + 0.301)).all()


@pytest.mark.parametrize("effort", ["neural", "muscle_state", "zero"])
def test_efforts_of_the_present_alone_are_the_true_ones(effort: str) -> None:
    users = UserBatch(load_body(MUSCLES), 3, threads=1, effort=effort)
    drives = ActuatorState(users.body)
    imagined = imagined_effort(users.effort, drives, otherwise=9.0)
    users.step(np.random.default_rng(2).uniform(-0.5, 0.5, (3, drives.count)))
    after = torch.tensor(drives.of(users), dtype=torch.float32)
    control = torch.tensor(drives.controls(users), dtype=torch.float32)
    np.testing.assert_allclose(imagined(after, control).numpy(), users.effort_cost, rtol=1e-5)


def test_an_effort_that_remembers_is_the_mean_square_of_activations() -> None:
    users = UserBatch(load_body(WRIST), 1, threads=1)
    cost = imagined_effort(users.effort, ActuatorState(users.body), otherwise=0.5)
    act = torch.zeros(1, 32)
    act[0, 0] = 0.8
    assert float(cost(act, act)) == pytest.approx(0.5 * 0.8**2 / 32)


def test_muscles_may_count_by_their_volume() -> None:
    """Of the middle deltoid 1103.5 N x 15.62 cm (muscles.csv), of an extensor 252.5 N x 8.67 cm.

    Lengths are ranges, which are the same share of the optimal length in all muscles.
    """
    body = load_body(WRIST)
    shares = volume_shares(body)
    assert float(shares.mean()) == pytest.approx(1.0)
    muscles = list(body.muscles)
    model = body.physics_model
    deltoid, extensor = muscles.index("DELT2"), muscles.index("ECRB")
    assert float(shares[deltoid] / shares[extensor]) == pytest.approx(7.876, abs=0.01)
    users = UserBatch(body, 1, threads=1)
    cost = imagined_effort(users.effort, ActuatorState(body), otherwise=0.5, shares=shares)
    act = torch.zeros(1, model.nu)
    act[0, extensor] = 0.8
    assert float(cost(act, act)) == pytest.approx(0.5 * 0.8**2 / 32 * float(shares[extensor]))


def test_a_single_user_s_gradient_is_bounded() -> None:
    values = torch.ones(3, 2, requires_grad=True)
    doubled = limited(2.0 * values, 1.0)
    (doubled * torch.tensor([[0.3, 0.4], [3.0, 4.0], [torch.inf, 0.0]])).sum().backward()
    expected = torch.tensor([[0.6, 0.8], [1.2, 1.6], [0.0, 0.0]])
    torch.testing.assert_close(values.grad, expected)


def test_gradients_lead_back_into_a_range_but_not_out_of_it() -> None:
    values = torch.tensor([-0.5, -0.5, 0.5, 1.5, 1.5], requires_grad=True)
    clamped = within(values, 0.0, 1.0)
    assert clamped.tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]
    # A loss that goes down where the values go up, down, up, up and down.
    (clamped * torch.tensor([-1.0, 1.0, -1.0, -1.0, 1.0])).sum().backward()
    assert values.grad.tolist() == [-1.0, 0.0, -1.0, 0.0, 1.0]


def test_aims_beyond_a_motor_s_range_by_hand() -> None:
    """0.9 + 0.3 is 0.2 too much, 0.1 - 0.4 is 0.3 too little: 0.04 + 0.09."""
    drives = ActuatorState(load_body(MOTORS))
    at, actions = torch.full((1, 14), 0.5), torch.zeros(1, 14)
    at[0, :2], actions[0, :2] = torch.tensor([0.9, 0.1]), torch.tensor([0.3, -0.4])
    assert float(drives.beyond(at, actions)) == pytest.approx(0.13)


def test_drifting_away_from_rest_costs_by_hand() -> None:
    """Two of 14 motors are 0.3 and 0.4 away: 2 * (0.09 + 0.16) / 14."""
    body = load_body(MOTORS)
    model = BodyModel(body, ("headset",), 0.05, width=4)
    free = torch.zeros(1)
    users = ImaginedUsers(body, model, 1, effort=lambda drives, control: free, activation_cost=2.0)
    users.rest = torch.linspace(0.2, 0.5, 14)
    drives = users.rest.clone()[None]
    drives[0, 3] += 0.3
    drives[0, 9] -= 0.4
    users.start(
        torch.arange(1),
        Motion(free.new_zeros(1, 14), free.new_zeros(1, 14), drives, free[:, None][:, :0]),
    )
    effort, limits, wild = users.costs()
    assert float(limits) == pytest.approx(2.0 * 0.25 / 14)
    assert (float(effort), float(wild)) == (0.0, 0.0)


def test_abrupt_commands_cost_by_hand() -> None:
    """Muscles at 0.5 and 0.2 are asked for 1 and, no less than there is, 0: 3 * (0.25 + 0.04) / 32.

    It is what is asked for that costs, before motor noise, and leads back to the action.
    """
    body = load_body("mobl_arms_wrist")
    model = BodyModel(body, ("headset",), 0.05, width=4)
    free, count = torch.zeros(1), len(body.action_names)
    noisy = MotorNoiseSettings(constant="white", constant_level=0.3)
    users = ImaginedUsers(
        body, model, 1, effort=lambda drives, control: free, noise=noisy, action_rate_cost=3.0
    )
    joints = torch.zeros(1, len(body.independent_joints))
    drives = torch.full((1, count), 0.4)
    drives[0, 3], drives[0, 9] = 0.5, 0.2
    users.start(torch.arange(1), Motion(joints, joints, drives, free[:, None][:, :0]))
    actions = torch.zeros(1, count)
    actions[0, 3], actions[0, 9] = 0.5, -0.7
    actions.requires_grad_(True)
    users.step(actions, error_share=0.0)
    limits = users.costs()[1]
    still = ImaginedUsers(body, model, 1, effort=lambda drives, control: free)
    still.motion = users.motion
    cost = limits - still.costs()[1]
    assert count == 32
    assert float(cost.detach()) == pytest.approx(3.0 * 0.29 / 32, abs=1e-6)
    cost.sum().backward()
    assert actions.grad is not None
    assert float(actions.grad[0, 3]) == pytest.approx(3.0 * 2.0 * 0.5 / 32, abs=1e-6)


def test_carrying_a_hand_costs_by_the_square_of_its_speed_not_a_head() -> None:
    """The way of a step that the body's own places tell; over 0.05 s, times 0.5."""
    body = load_body("mobl_arms_wrist")
    model = BodyModel(body, ("headset", "controller_right"), 0.05, width=4)
    free, count, joints = torch.zeros(1), len(body.action_names), len(body.independent_joints)
    users = ImaginedUsers(body, model, 1, effort=lambda drives, control: free, movement_cost=0.5)
    angles = torch.from_numpy(body.joint_ranges.mean(1))[None].float()
    for speeds in (torch.zeros(1, joints), torch.linspace(-2.0, 2.0, joints)[None]):
        start = Motion(angles, speeds, torch.full((1, count), 0.2), free[:, None][:, :0])
        users.start(torch.arange(1), start)
        begun = users.place[0, :, :3, 3].clone()
        users.step(torch.zeros(1, count), error_share=0.0)
        way = (users.place[0, :, :3, 3] - begun).norm(dim=-1).detach()
        free_of_it = ImaginedUsers(body, model, 1, effort=lambda drives, control: free)
        free_of_it.motion = users.motion
        cost = users.costs()[1] - free_of_it.costs()[1]
        assert float(cost.detach()) == pytest.approx(0.5 * (float(way[1]) / 0.05) ** 2, rel=1e-3)
    assert float(way[1]) > 0.02
    assert float(way[0]) == pytest.approx(0.0, abs=1e-6)
    bare = BodyModel(body, ("headset",), 0.05, width=4)
    with pytest.raises(InputError, match=r"movement_cost: got 0.5, where hands hold nothing"):
        ImaginedUsers(body, bare, 1, effort=lambda drives, control: free, movement_cost=0.5)


def test_motors_rest_where_they_come_back_to_and_muscles_slack() -> None:
    for name, rest in ((MOTORS, 0.4), ("mobl_arms_wrist", 0.15)):
        body = load_body(name)
        model = BodyModel(body, ("headset",), 0.05, width=4)
        users = ImaginedUsers(body, model, 1, effort=lambda drives, control: torch.zeros(1))
        count = len(users.rest)
        users.rest_as(torch.tensor([[0.3], [0.5]]).expand(2, count))
        assert users.rest.tolist() == pytest.approx([rest] * count)


def test_two_arms_learn_what_motors_did() -> None:
    """After 15 s of eight users both controllers' places after a step are known to a third."""
    users = UserBatch(load_body(MOTORS), 8, threads=1, effort="zero")
    torch.manual_seed(1)
    body = BodyModel(users.body, ("controller_left", "controller_right"), 0.05, width=48)
    rng, rows = np.random.default_rng(3), []
    for step in range(300):
        if step % 20 == 0:
            users.reset(range(8), [np.random.default_rng([step, i]) for i in range(8)])
        before = motion_of(users, body.drives)
        users.step(0.1 * rng.standard_normal((8, 14)))
        after = motion_of(users, body.drives)
        rows.append(TransitionStore(before, after.drives, after, torch.zeros(8, 0)))
    steps = TransitionStore.joined(rows)
    body.scale_by(steps)
    fit = fit_body(body, steps, minibatches=250, learning_rate=4e-3, batch_size=512)
    assert fit["drives"] == pytest.approx(0.0, abs=1e-6)
    assert fit["moved_m"] > 0.03
    assert fit["place_m"] < fit["moved_m"] / 3.0
