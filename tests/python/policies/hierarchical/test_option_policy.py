"""Users who decide and leave the doing to their motor layer."""

import copy
from pathlib import Path

import numpy as np
import pytest
import torch

from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.packing import pack_measured
from sim2vr_harness.evaluation.playing import load_user_policy
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.training.option_q_learning.q_learning import SETTINGS
from sim2vr_harness.training.run.trainer import train

CONFIGS = Path(__file__).resolve().parents[4] / "configs"
USERS, HELD = 3, SETTINGS.decide_steps


def config(*changes: str) -> TrainingConfig:
    given = (
        "env.app.game=whacamole",
        "env.app.options.condition=medium",
        "env.cores=1",
        "skills.user=hierarchical",
    )
    return load_config(CONFIGS / "skills.yaml", [*given, *changes])


def opinionated(sight: DepthGrid) -> ActionValueMap:
    """Values that differ: those of a new network are all 0."""
    torch.manual_seed(4)
    net = ActionValueMap(sight, 1)
    torch.nn.init.normal_(net.leave.weight)
    return net


def deciding(together: int = 1) -> HierarchicalPolicy:
    settings = config()
    user = HierarchicalPolicy(settings)
    user.layer.take(motor_layer_for(user.layer.body, 0.05).weights())
    user.values = opinionated(user.values.sight)
    user.tool.copy_(torch.tensor([[[0.083, -0.01, 0.002], [0.06, -0.01, 0.002]]]))
    user.hold.fill_(HELD)
    user.together = together
    return user


def test_users_do_the_same_alone_and_together() -> None:
    """To the bit, whatever their number; in one batch but for the last digits."""
    user, batch, simulation = deciding(), deciding(USERS), Simulation(config().env, USERS)
    simulation.reset(seeds=[5, 6, 7])
    memory, shared = user.begin(USERS), batch.begin(USERS)
    apart = [user.begin(1) for _ in range(USERS)]
    for _ in range(3 * HELD):
        seen = simulation.observation()
        actions = user.act(seen, memory, [None] * USERS)
        for i, own in enumerate(apart):
            alone = user.act({key: each[i : i + 1] for key, each in seen.items()}, own, [None])
            np.testing.assert_array_equal(alone[0], actions[i])
        np.testing.assert_allclose(
            batch.act(seen, shared, [None] * USERS), actions, rtol=0.0, atol=1e-4
        )
        simulation.step(actions)
    places = torch.cat([own.choice.place for own in memory])
    assert torch.allclose(shared[0].choice.place, places, atol=1e-4)
    assert len(places.unique(dim=0)) == USERS  # they did decide different things
    simulation.close()


def test_an_episode_that_begins_anew_is_a_new_one() -> None:
    user, simulation = deciding(USERS), Simulation(config().env, USERS)
    simulation.reset(seeds=[5, 6, 7])
    memory = user.begin(USERS)
    for _ in range(HELD + 1):
        simulation.step(user.act(simulation.observation(), memory, [None] * USERS))
    user.restart(memory, [1])
    fresh, before = user.begin(USERS), copy.deepcopy(memory)
    seen = simulation.observation()
    anew = user.act(seen, fresh, [None] * USERS)
    actions = user.act(seen, memory, [None] * USERS)
    np.testing.assert_array_equal(actions[1], anew[1])
    assert [int(n) for part in memory for n in part.age] == [HELD + 1, 0, HELD + 1]
    np.testing.assert_array_equal(user.act(seen, before, [None] * USERS), actions)
    simulation.close()


SMALL = (
    "skills.q_learning.users=3",
    "skills.q_learning.user_steps=243",
    "skills.q_learning.try_steps=90",
    "skills.q_learning.explore_steps=100",
    "env.app.options.round_seconds=2",
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run, very small."""
    folder = tmp_path_factory.mktemp("runs") / "decider"
    assert train(config(*SMALL), folder).step == 243
    return folder


@pytest.mark.slow
def test_it_is_packed_with_its_hands(run: Path, tmp_path: Path) -> None:
    card = pack_measured(
        run, "tiny", tmp_path / "tiny", conditions=["medium"], episodes=2, details={}
    )
    assert card["steps"] == 243
    packed = find_user(tmp_path / "tiny")
    assert packed.config.policy_kind == "hierarchical"
    observation, _ = load_user_policy(run).make_env().reset(seed=3)
    one, other = (
        load_user_policy(each).predict(observation)[0] for each in (run, tmp_path / "tiny")
    )
    np.testing.assert_allclose(one, other, atol=0.05)  # weights are rounded
