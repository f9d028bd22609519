"""Users who decide and leave the doing to their motor layer."""

import copy
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.progress import View
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.packing import pack_measured
from sim2vr_harness.evaluation.playing import load_user_policy
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy, require_senses
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.training.option_q_learning.q_learning import SETTINGS
from sim2vr_harness.training.option_q_learning.stage import best_hold
from sim2vr_harness.training.ppo.fine_tune import adapting
from sim2vr_harness.training.run.stage import Callbacks
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


@pytest.mark.parametrize("together", [1, USERS])
def test_an_episode_that_begins_anew_is_a_new_one(together: int) -> None:
    user, simulation = deciding(together), Simulation(config().env, USERS)
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


def test_a_user_goes_straight_to_what_it_touches_if_it_learned_so() -> None:
    user = HierarchicalPolicy(config())
    assert user.primitives.lifts.item() == 1.0
    user.lifts.fill_(0.0)
    again = HierarchicalPolicy(config())
    again.load_state_dict(user.state_dict())
    assert again.primitives.lifts.item() == 0.0


class Obedient:
    """Earns the more, the longer a decision is seen through."""

    def earned(self, hold: int, steps: int, *, on_step: Callable[[], None]) -> float:
        on_step()
        return float(hold if hold < 5 else -1)


def test_a_decision_is_seen_through_for_as_long_as_it_pays() -> None:
    said: list[str] = []
    shown: list[str] = []
    callbacks = SimpleNamespace(say=said.append, doing=lambda part: None)
    assert best_hold(Obedient(), 128, callbacks, shown.append) == 3  # type: ignore[arg-type]
    assert "1.00 for 1, 3.00 for 3, -1.00 for 5. The user's: 3." in said[0]
    assert shown == [f"measuring 3 durations of decisions, {number} of 3" for number in (1, 2, 3)]


SMALL = (
    "skills.q_learning.users=3",
    "skills.q_learning.user_steps=243",
    "skills.q_learning.try_steps=90",
    "skills.q_learning.explore_steps=100",
    "env.app.options.round_seconds=2",
)


SHOWN: list[tuple[float, float]] = []
"""Work that was done and that there is, at every update of the progress bar."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run, very small."""
    folder = tmp_path_factory.mktemp("runs") / "decider"
    show = Callbacks.show

    def noted(self: Callbacks, view: Callable[[], View], *, force: bool = False) -> None:
        SHOWN.append((view().done, self._stage.work))
        show(self, view, force=force)

    with patch.object(Callbacks, "show", noted):
        result = train(config(*SMALL), folder)
    assert not result.interrupted
    assert result.step == 243
    return folder


def test_the_progress_bar_counts_updates_and_comparisons(run: Path) -> None:
    """27 decisions of 9 user steps, 17 with an update; 2 manners of 5 s, 3 durations of 10 s.

    An update counts as 110 user steps, and there are 3 users at 20 Hz.
    """
    done, work = zip(*SHOWN, strict=True)
    assert min(work) == max(work) == pytest.approx(243 + 17 * 110 + 2 * 300 + 3 * 600)
    assert list(done) == sorted(done)
    assert done[-1] == pytest.approx(work[0])


def test_a_run_that_stops_on_the_way_goes_on_to_the_bit(run: Path, tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    first = train(config(*SMALL), parts, timesteps=100)
    assert (first.step, first.interrupted) == (108, False)  # 3 users, 3 steps a decision
    assert train(config(*SMALL), parts, timesteps=100, resume=True).step == 108
    assert evaluate(parts, Request(episodes=1, steps=False, out=tmp_path / "early")).summaries
    assert train(config(*SMALL), parts, resume=True).step == 243
    whole, both = (load_user_policy(each)._policy.state_dict() for each in (run, parts))  # type: ignore[union-attr]
    assert all(torch.equal(values, both[name]) for name, values in whole.items())


INPUTS = "env.user.inputs=[right.trigger, right.thumbstick_x]"


def test_a_user_with_inputs_works_them(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert train(config(*SMALL, INPUTS, "skills.tool=none"), folder).step == 243
    user = load_user_policy(folder)
    env = user.make_env()
    observation, _ = env.reset(seed=3)
    action, _ = user.predict(observation, None, np.array([True]))
    assert action.shape == env.action_space.shape == (user._policy.layer.drives.count + 2,)  # type: ignore[union-attr, operator]
    env.close()


def test_it_plays_at_the_end_of_a_run_alike_alone_and_beside_others(run: Path) -> None:
    found: list[Any] = [
        evaluate(run, Request(episodes=3, batch=batch, steps=False, out=run / f"by{batch}"))
        for batch in (1, 3)
    ]
    alone, beside = (each.summaries["medium"]["rounds"] for each in found)
    assert [row["return"] for row in alone] == [row["return"] for row in beside]


def test_it_remembers_what_it_decided_between_steps(run: Path) -> None:
    user = load_user_policy(run)
    # How long this one sees a decision through was found out, and may be a single step.
    user._policy.hold.fill_(HELD)  # type: ignore[operator, union-attr]
    env = user.make_env()
    observation, _ = env.reset(seed=3)
    state = None
    decided = []
    for step in range(2 * HELD):
        action, state = user.predict(observation, state, np.array([step == 0]))
        assert state is not None
        again, other = user.predict(observation, state)  # a step later: its own memory
        assert other is not state
        assert again.shape == action.shape
        decided.append((int(state[0].choice.move[0, 0]), state[0].choice.place[0, 0].tolist()))
        observation, *_ = env.step(action)
    env.close()
    assert decided[1:HELD] == [decided[0]] * (HELD - 1)
    assert decided[HELD:] == [decided[HELD]] * HELD
    assert state is not None
    assert state[0].left == 0


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


def test_what_it_cannot_decide_by_is_named(run: Path) -> None:
    senses = "env.senses=[{sense: vision, history_s: 0.2}, {sense: proprioception"
    for changes, field in (
        (["env.vision.channels=[green,depth]"], "env.vision"),
        ([senses + "}]", "env.user.head=reflex"], "env.user.head"),
        (["env.senses=[{sense: vision}, {sense: proprioception}]"], "env.senses"),
        ([senses + ", delay_ms: 50}]"], "env.senses"),
    ):
        with pytest.raises(InputError, match=field.replace(".", r"\.")):
            require_senses(config(*changes).env)
    require_senses(config("env.user.head=reflex").env)
    with pytest.raises(InputError, match="from senses to muscles"):
        adapting(find_user(run), str(run))
