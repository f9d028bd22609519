"""Does imagined Beats play by the true game's rules? Both see the same users at the same time."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from sim2vr_harness.envs.config import AppConfig, EffortConfig, EnvConfig, UserConfig
from sim2vr_harness.games.beats import sabers, twin
from sim2vr_harness.games.beats.twin import EVENTS, FIELDS, points
from sim2vr_harness.training.config import apply_overrides
from sim2vr_harness.training.imagined import ImaginedRollouts
from sim2vr_harness.training.imagined.experience import Motion
from sim2vr_harness.training.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher_env import OBSERVATION, TeacherSimulation
from sim2vr_harness.training.teacher_policy import new_teacher

pytest.importorskip("sim2vr_harness._app_runtime")

USERS, STEPS = 12, 199
SMALL = (
    *(f"ppo.n_envs={USERS}", "ppo.n_steps=10", "ppo.batch_size=20", "policy.net_arch=[16]"),
    *("evaluate_rounds=0", "total_timesteps=120", "imagined.reward_scale=0.05"),
    *("imagined.cycles=2", "imagined.first_play_steps=30", "imagined.play_steps=10"),
    *("imagined.first_fit_minibatches=20", "imagined.fit_minibatches=20"),
    *("imagined.users=8", "imagined.updates=2", "imagined.critic_first_updates=0"),
    *("imagined.body_width=16", "imagined.critic_width=16", "imagined.gradient_limit=2.0"),
)
LOGGED = {
    "sliced": "AccumulatedCorrectSlices",
    "missed": "Misses",
    "wrong direction": "WrongDirection",
    "wrong hand": "WrongHand",
}


def rollouts() -> ImaginedRollouts:
    user = UserConfig(
        model="mobl_arms_bimanual_motor",
        skull_rotation_deg=0.0,
        effort=EffortConfig(model="neural", weight=0.01),
    )
    app = AppConfig(game="beats", options={"level": "first", "end_on_miss": False})
    env = EnvConfig(app=app, user=user, cores=1)
    settings = TeacherConfig.model_validate(apply_overrides({}, SMALL))
    simulation = TeacherSimulation(env, settings, seed=4)
    spaces = simulation.observation_space, simulation.action_space
    policy = new_teacher(*spaces, settings.policy, seed=1)
    return ImaginedRollouts(settings.imagined, policy, simulation, seed=4)


@pytest.fixture(scope="module")
def played() -> dict[str, Any]:
    """A round of everybody, moving about at random, in the true game and in the twin."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(twin, "_MOMENTS", tuple(np.linspace(0.0, 1.0, 41)[1:].tolist()))
        patched.setattr(sabers, "_ALONG_M", tuple(np.linspace(-0.5, 0.5, 51).tolist()))
        return play()


def play() -> dict[str, Any]:
    made = rollouts()
    made.step()
    sim = made.simulation
    users, game = made.imagine(USERS)
    game.sabers.fixed = made.game.sabers.fixed
    sim.reset(seeds=list(range(USERS)))
    sim._limit[:] = 10 * STEPS
    everyone = torch.arange(USERS)
    users.start(everyone, motion(made))
    columns = [sim.senses.names.index(name) for name in FIELDS]
    fields = torch.tensor(sim.senses.values()[:, columns], dtype=torch.float32)
    game.start(everyone, worn(made), fields, everyone)
    game.lane.begin(everyone)
    game.clear_counts()
    rng = np.random.default_rng(0)
    names = [*users.names, *game.names]
    observed = [names.index(name) for name in sim.senses.observed_names]
    soft = game.settings.relaxation(1.0)
    imagined, true, effort = [], [], []
    for _ in range(STEPS):
        actions = 0.2 * rng.standard_normal((USERS, 14))
        control = made.body.drives.control(users.motion.drives, torch.tensor(actions))
        result = sim.step(actions)
        users.motion = motion(made)
        torch.testing.assert_close(users.motion.drives, control.float(), atol=1e-5, rtol=0.0)
        users._control = control.float()
        effort.append((users.costs()[0].numpy(), result.effort_cost))
        place = worn(made)
        game.play(place, soft)
        seen = torch.cat([users.observe(), game.observe(place)], 1)
        imagined.append(seen[:, observed].numpy())
        true.append(sim.observation()[OBSERVATION])
    logs = [dict(log) for log in sim.simulation.logs]
    sim.close()
    return {
        "names": sim.senses.observed_names,
        "imagined": np.array(imagined),
        "true": np.array(true),
        "effort": np.array(effort),
        "events": dict(zip(EVENTS, game.events.tolist(), strict=True)),
        "logs": logs,
        "sabers": game.sabers.fixed,
        "limbs": made.body.accelerations,
    }


def motion(made: ImaginedRollouts) -> Motion:
    """What the true users do."""
    users = made.simulation.simulation.users
    joints, dofs = users.body.qpos_independent, users.body.qvel_independent
    parts = (users.qpos[:, joints], users.qvel[:, dofs], made.body.drives.of(users))
    tensors = [torch.tensor(part, dtype=torch.float32) for part in parts]
    return Motion(*tensors, torch.zeros(users.n, 0))


def worn(made: ImaginedRollouts) -> torch.Tensor:
    """(N, 3, 4, 4) where the true users' devices are, which the app is told."""
    users = made.simulation.simulation.users
    place = np.tile(np.eye(4), (USERS, 3, 1, 1))
    for k, device in enumerate(made.simulation.game.devices):
        positions, quaternions = users.device_poses(device)
        place[:, k, :3, 3] = positions
        for i, quaternion in enumerate(quaternions):
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, quaternion)
            place[i, k, :3, :3] = rotation.reshape(3, 3)
    return torch.tensor(place, dtype=torch.float32)


def test_blades_lie_on_the_grips_axis(played: dict[str, Any]) -> None:
    """From 8 cm in front of the grip on, straight ahead, as the game's page says."""
    expected = torch.tensor([[0.08, 0.0, 0.0], [1.0, 0.0, 0.0]]).expand(2, 2, 3)
    torch.testing.assert_close(played["sabers"], expected, atol=2e-3, rtol=0.0)


def test_what_happens_to_boxes_is_the_same(played: dict[str, Any]) -> None:
    """48 boxes; tested at four instants of a frame and three points of a blade, as trainings do, a
    fifth of those touched differ: what only grazes, at blades as fast as these."""
    true = {name: sum(log[key] for log in played["logs"]) for name, key in LOGGED.items()}
    assert sum(true.values()) == 4 * USERS
    assert true["wrong hand"] + true["wrong direction"] + true["sliced"] >= 16
    assert sum(abs(played["events"][name] - count) for name, count in true.items()) <= 4, true


def test_teachers_observe_the_same(played: dict[str, Any]) -> None:
    """Wherever both have the same boxes."""
    names = list(played["names"])
    wrong = np.abs(played["imagined"] - played["true"])
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


def test_effort_is_the_users_own(played: dict[str, Any]) -> None:
    imagined, true = played["effort"][:, 0], played["effort"][:, 1]
    assert float(true.mean()) > 0.01
    np.testing.assert_allclose(imagined, true, atol=1e-5, rtol=1e-4)


def test_both_arms_share_a_model_of_their_own(played: dict[str, Any]) -> None:
    (arms,) = played["limbs"]
    assert arms.joint_columns == list(range(14))
    assert arms.low.shape == (2, 7)


def test_scores_are_those_of_the_cuts(played: dict[str, Any]) -> None:
    """A round with one correct slice knows its speed and angle, and what they are worth."""
    single = [log for log in played["logs"] if log["AccumulatedCorrectSlices"] == 1.0]
    assert single
    for log in single:
        worth = points(torch.tensor(log["CutSpeed"]), torch.tensor(log["CutAngleError"]))
        assert log["Score"] == pytest.approx(float(worth), abs=0.51)
