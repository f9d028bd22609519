"""Teachers of users whose senses are late and whose bodies differ: true and imagined."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch
from short_cycles import short_cycles

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.privileged import OBSERVATION, Lag, PrivilegedSenses
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.teacher import new_teacher
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.model_based.stage import GameTrainer, game_trainer
from sim2vr_harness.training.teacher.env import TeacherSimulation
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.person_features import ImaginedPersons

SENSES = (
    {"sense": "vision", "delay_ms": 200},
    {"sense": "proprioception", "delay_ms": 150},
    {"sense": "actions", "stack_s": 0.1},
)
SMALL = (
    *("imagined.n_envs=6", "curriculum.near_starts=0"),
    *("imagined.cycles=2", "imagined.first_play_steps=30", "imagined.users=8"),
    *("imagined.body_width=16", "imagined.critic_width=16", "imagined.near_starts=0"),
)


@pytest.fixture(autouse=True)
def short() -> Iterator[None]:
    with short_cycles():
        yield


def env(**user: object) -> EnvConfig:
    return EnvConfig.model_validate(
        {
            "app": AppConfig(options={"condition": "random"}),
            "cores": 1,
            "frames_per_step": 5,
            "senses": SENSES,
            "user": user,
        }
    )


def teachers(n: int = 3, *overrides: str, **user: object) -> TeacherSimulation:
    settings = TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))
    return TeacherSimulation(env(**user), settings, 3, n=n)


def rollouts(*overrides: str, **user: object) -> GameTrainer:
    simulation = teachers(6, *overrides, **user)
    policy = new_teacher(simulation.observation_space, simulation.action_space, seed=1)
    return game_trainer(simulation.teacher.imagined, policy, simulation, seed=4)


@pytest.mark.parametrize(
    ("senses", "lag"),
    [
        ((), Lag(0, 0, 0)),
        (SENSES, Lag(4, 3, 2)),
        (({"sense": "vision", "delay_ms": 110}, {"sense": "actions"}), Lag(3, 0, 0)),
        (({"sense": "vision", "delay_ms": "person"},), Lag(2, 0, 0)),
    ],
)
def test_how_late_a_teacher_knows(senses: tuple, lag: Lag) -> None:
    given = {"senses": senses} if senses else {}
    assert Lag.of(EnvConfig.model_validate({**given, "user": {"people": {}}})) == lag


def test_a_teacher_knows_the_past_and_what_it_has_done_since() -> None:
    with closing(teachers()) as sim:
        names = sim.senses.observed_names
        assert sim.observation_space[OBSERVATION].shape == (len(names),)
        seen, felt = names.index("hammer.x_m"), names.index("felt hammer.x_m")
        angle = names.index("elbow_flexion qpos")
        done = names.index(f"{sim.simulation.actions.names[0]}, 1 back")
        sim.reset(seeds=[1, 2, 3])
        joint = sim.simulation.proprioception.names.index("elbow_flexion qpos")

        def present() -> tuple[np.ndarray, np.ndarray]:
            body = sim.simulation.proprioception.observe(sim.simulation.users)
            return sim.senses.field("hammer.x_m"), body[:, joint]

        rng, history, actions = np.random.default_rng(1), [present()], [np.zeros((3, 32))]
        for step in range(1, 6):
            actions.append(rng.uniform(-1.0, 1.0, (3, 32)))
            sim.step(actions[-1])
            history.append(present())
            known = sim.observation()[OBSERVATION]
            np.testing.assert_array_equal(known[:, seen], history[max(0, step - 4)][0])
            np.testing.assert_array_equal(sim.senses.seen("hammer.x_m"), known[:, seen])
            np.testing.assert_array_equal(known[:, felt], history[max(0, step - 3)][0])
            np.testing.assert_array_equal(known[:, angle], history[max(0, step - 3)][1])
            np.testing.assert_allclose(known[:, done], actions[-1][:, 0], atol=1e-7)
            np.testing.assert_allclose(known[:, done + 32], actions[-2][:, 0], atol=1e-7)
        state, known = sim.state_dict(), sim.observation()[OBSERVATION]
        sim.reset([0, 1])
        fresh = sim.observation()[OBSERVATION]
        assert not fresh[:2, done:].any()
        assert fresh[2, done:].any()
        sim.load_state_dict(state)
        np.testing.assert_array_equal(sim.observation()[OBSERVATION], known)


@pytest.mark.parametrize(("vision", "recognition"), [(110, 0), (130, 2), ("person", 0)])
def test_who_labels_a_picture_knows_what_it_shows(vision: object, recognition: int) -> None:
    """Pictures are drawn in frames of 0.01 s, users act every 0.05 s: time tells how old one is."""
    users = {"people": {"visual_delay_s": 0.18}} if vision == "person" else {}
    settings = EnvConfig.model_validate(
        env(**users).model_dump()
        | {"senses": [{"sense": "vision", "delay_ms": vision}, {"sense": "proprioception"}]}
    )
    with closing(Simulation(settings, 4)) as sim:
        senses = PrivilegedSenses(sim, [], lag=Lag.of(settings, recognition))
        told = senses.observed_names.index("round.elapsed_s")
        sim.reset(seeds=[1, 2, 3, 4])
        for _ in range(20):
            sim.step(np.zeros((4, 32)))
        age_s = senses.field("round.elapsed_s") - senses.seen("round.elapsed_s")
        np.testing.assert_array_equal(senses.observe()[:, told], senses.seen("round.elapsed_s"))
        if vision == "person":
            delays = np.array([person.visual_delay_s for person in sim.users.persons])
            expected = np.ceil(delays / 0.01 - 1e-6) * 0.01
            assert len(np.unique(expected)) > 1
        else:
            expected = np.full(4, vision / 1000.0)
        np.testing.assert_allclose(age_s, expected + 0.05 * recognition, atol=1e-5)
        # A saved user goes on with what it knew.
        state = sim.state_dict()
        sim.step(np.zeros((4, 32)))
        after = senses.observe()
        sim.load_state_dict(state)
        sim.step(np.zeros((4, 32)))
        np.testing.assert_array_equal(senses.observe(), after)


def test_imagined_users_know_as_late_as_true_ones() -> None:
    """Moments by hand: what was four user steps ago is seen, what was three ago is felt."""
    made = rollouts()
    with closing(made.task.simulation):
        made.step()
        senses, users = made.task.senses, made.users
        names = made.task.simulation.senses.observed_names
        everyone = torch.arange(users.n)
        made._restart(everyone)
        x = [made.task.game.hammer(users.place)[0][:, 0]]
        acted = torch.linspace(-1.0, 1.0, users.n * users.actions).reshape(users.n, -1)
        for k in range(4):
            made.advance(acted / (k + 1), 0.0, error_share=0.0)
            x.append(made.task.game.hammer(users.place)[0][:, 0])
        known, now = senses.observe(), senses.present()
        seen, felt = names.index("hammer.x_m"), names.index("felt hammer.x_m")
        assert torch.equal(known[:, seen], x[0])
        assert torch.equal(known[:, felt], x[1])
        assert torch.equal(now[:, seen], x[4])
        assert torch.equal(known[:, -64:-32], acted / 4)
        assert torch.equal(known[:, -32:], acted / 3)
        made._restart(everyone[:2])
        again = senses.observe()
        assert not again[:2, -64:].any()
        assert torch.equal(again[2:], known[2:])


def test_senses_become_late_in_the_true_and_in_the_imagined_game() -> None:
    """After a cycle of the present, over two more: none, none, half and all of four user steps."""
    made = rollouts(
        "imagined.cycles=4", "imagined.undelayed_cycles=1", "imagined.delay_ramp_cycles=2"
    )
    with closing(made.task.simulation):
        seen = made.task.simulation.senses.observed_names.index("hammer.x_m")
        for late in (0, 0, 2, 4):
            made.step()
            made.task.simulation.reset(seeds=list(range(6)))
            history = [made.task.simulation.senses.field("hammer.x_m")]
            for _ in range(4):
                made.task.simulation.step(np.full((6, 32), 0.2))
                history.append(made.task.simulation.senses.field("hammer.x_m"))
            known = made.task.simulation.observation()[OBSERVATION][:, seen]
            np.testing.assert_array_equal(known, history[-1 - late])
            assert made.task.senses._layout.lag == made.task.simulation.senses.layout.lag


def test_effort_and_carrying_grow_to_what_they_cost() -> None:
    """Nothing, half and all of it in the first cycles; limits of joints cost as ever."""
    made = rollouts(
        "imagined.cycles=4",
        "imagined.effort=2",
        "imagined.movement_cost=0.5",
        "imagined.cost_ramp_cycles=2",
        "imagined.keep_best=true",
    )
    with closing(made.task.simulation):
        users = made.users
        for share in (0.0, 0.5, 1.0, 1.0):
            if share < 1.0:
                assert made._best is None  # what is done for less is no merit
            made.step()
            drives = torch.full_like(users.motion.drives, 0.5)
            beyond = users.motion.angles.clone()
            beyond[:, 0] += 10.0
            users.motion = replace(users.motion, drives=drives, angles=beyond)
            users._carried = torch.full((users.n,), 4.0)
            effort, limits, _ = users.costs()
            # 2 by the mean square of .5; 0.5 times 4 m^2/s^2.
            assert effort.tolist() == pytest.approx([2.0 * 0.25 * share] * users.n)
            users._carried = torch.zeros(users.n)
            ways = limits - users.costs()[1]
            assert ways.tolist() == pytest.approx([2.0 * share] * users.n, rel=1e-4)
            assert users.costs()[1].min() > 1.0
    assert made._best is not None


def test_a_tool_on_its_way_through_a_step_is_where_the_true_one_is() -> None:
    """Five app frames a step: the cubic between the ends against MuJoCo's own substeps."""
    made = rollouts()
    with closing(made.task.simulation):
        made.step()
        sim = made.task.simulation.simulation
        made.task.simulation.reset(seeds=list(range(6)))
        rng = np.random.default_rng(2)
        joints, dofs = sim.body.qpos_independent, sim.body.qvel_independent
        worst, moved = 0.0, 0.0
        for _ in range(8):
            before = (sim.users.qpos[:, joints], sim.users.qvel[:, dofs])
            made.task.simulation.step(rng.uniform(-0.6, 0.6, (6, 32)))
            after = (sim.users.qpos[:, joints], sim.users.qvel[:, dofs])
            ends = [
                type(made.users.motion)(
                    *(torch.tensor(v, dtype=torch.float32) for v in end),
                    torch.zeros(6, 32),
                    torch.zeros(6, 0),
                )
                for end in (before, after)
            ]
            made.users.n = 6
            made.users._before, made.users.motion = ends
            places = made.users.places(5)[:, :, 0, :3, 3].numpy()
            for k in range(5):
                true = sim.users.device_poses("controller_right", k)[0]
                worst = max(worst, float(np.abs(places[:, k] - true).max()))
            moved = max(moved, float(np.abs(places[:, -1] - places[:, 0]).max()))
        assert moved > 0.05
        assert worst < 0.008


PEOPLE = {"people": {"seed": 1}}


def test_chains_of_people_place_devices_as_their_own_bodies_do() -> None:
    with closing(teachers(6, **PEOPLE)) as sim:
        sim.reset(seeds=list(range(6)))
        users = sim.simulation.users
        persons = ImaginedPersons(sim.resolved)
        devices = ("controller_right", "headset")
        chains = Chains(sim.simulation.body, devices, persons.references)
        who = torch.tensor(persons.of(sim.simulation), dtype=torch.float32)
        assert who.shape == (6, persons.count)
        low, high = sim.simulation.body.joint_ranges.T
        angles = np.random.default_rng(1).uniform(low, high, (6, 7))
        places = chains(torch.tensor(angles, dtype=torch.float32), persons.sizes(who)).numpy()
        apart = []
        for i, each in enumerate(angles):
            body = users.who.body(i)
            data = mujoco.MjData(body.physics_model)
            data.qpos[:] = body.coupled_qpos(each)
            mujoco.mj_kinematics(body.physics_model, data)
            for device, place in zip(devices, places[i], strict=True):
                np.testing.assert_allclose(place[:3, 3], data.site(device).xpos, atol=5e-6)
                np.testing.assert_allclose(place[:3, :3].ravel(), data.site(device).xmat, atol=1e-5)
            apart.append(places[i, 1, 2, 3])
        assert np.ptp(apart) > 0.02  # heads at different heights
