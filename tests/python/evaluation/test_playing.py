"""A trained user from Python, as the README has it."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import sim2vr_harness
from sim2vr_harness.evaluation.playing import UserPolicy


@pytest.fixture(scope="module")
def policy() -> UserPolicy:
    return sim2vr_harness.load_user_policy("whacamole_constrained")


def test_a_shipped_user_plays_in_its_environment(policy: UserPolicy) -> None:
    with policy.make_env("easy") as env:
        observation, _ = env.reset(seed=1)
        policy.seed(1)
        actions = []
        for _ in range(5):
            action, state = policy.predict(observation)
            assert state is None
            assert env.action_space.contains(action)
            observation, _, terminated, truncated, info = env.step(action)
            actions.append(action)
        assert not (terminated or truncated)
        assert "Points" in info["log"]
        # Seeded as an evaluation's round with this seed, it does the same again.
        observation, _ = env.reset(seed=1)
        policy.seed(1)
        assert np.array_equal(policy.predict(observation)[0], actions[0])


def test_a_copied_user_goes_on_with_the_same_random_numbers(policy: UserPolicy) -> None:
    """Users of a batch are taken one by one."""
    policy.seed(3)
    rng = np.random.default_rng(1)
    batch = {
        key: rng.uniform(0, 1, (3, *space.shape)).astype(space.dtype)
        for key, space in policy.observation_space.spaces.items()
    }
    policy.predict(batch)
    other = pickle.loads(pickle.dumps(policy))
    assert np.array_equal(policy.predict(batch)[0], other.predict(batch)[0])
    actions, _ = other.predict(batch, deterministic=True)
    alone, _ = other.predict({key: rows[2] for key, rows in batch.items()}, deterministic=True)
    assert actions.shape == (3, 32)
    assert np.array_equal(actions[2], alone) and not np.array_equal(actions[0], actions[1])


def test_evaluate_takes_what_the_command_takes(tmp_path: Path) -> None:
    found = sim2vr_harness.evaluate(
        "whacamole_constrained",
        conditions=["easy"],
        episodes=1,
        out=str(tmp_path),
        overrides=["env.app.options.round_seconds=1.0"],
    )
    assert list(found.summaries) == ["easy"]
    assert (tmp_path / "results.json").is_file()
    assert found.rounds[0].steps == 21
    # And gives data frames.
    assert found.episodes["hits"].tolist() == [found.rounds[0].values["hits"]]
    assert len(found.steps) == 21 and len(found.frames) == 22
    assert sim2vr_harness.read_data(tmp_path).episodes.equals(found.episodes)
    assert not (tmp_path / ".logs").exists() and not (tmp_path / "logs").exists()
