"""A trained user from Python, as the README has it."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sim2vr_harness
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.evaluation.playing import UserPolicy


@pytest.fixture(scope="module")
def policy() -> UserPolicy:
    return sim2vr_harness.load_user_policy("whacamole_constrained")


def seen_by_three(policy: UserPolicy) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {
        key: (
            rng.integers(0, 256, (3, *space.shape), dtype=np.uint8)
            if space.dtype == np.uint8
            else rng.uniform(-1, 1, (3, *space.shape)).astype(np.float32)
        )
        for key, space in policy.observation_space.spaces.items()
    }


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


@pytest.mark.parametrize("how", [copy.deepcopy, lambda user: pickle.loads(pickle.dumps(user))])
def test_a_copied_user_goes_on_with_the_same_random_numbers(
    policy: UserPolicy, how: Callable[[UserPolicy], UserPolicy]
) -> None:
    policy.seed(3)
    seen = seen_by_three(policy)
    policy.predict(seen)
    other = how(policy)
    for _ in range(2):
        assert np.array_equal(policy.predict(seen)[0], other.predict(seen)[0])
    with other.make_env("easy") as env:
        env.reset(seed=1)


def test_observations_of_many_users_are_taken_one_by_one(policy: UserPolicy) -> None:
    batch = seen_by_three(policy)
    actions, _ = policy.predict(batch, deterministic=True)
    assert actions.shape == (3, 32)
    alone, _ = policy.predict({key: rows[2] for key, rows in batch.items()}, deterministic=True)
    assert np.array_equal(actions[2], alone)
    assert not np.array_equal(actions[0], actions[1])


def test_another_environment_is_refused_with_every_difference(policy: UserPolicy) -> None:
    other = policy.config.model_copy(update={"action_frequency_hz": 10})
    with pytest.raises(
        InputError, match=r"action_frequency_hz 10.*expected action_frequency_hz 20"
    ):
        policy.make_env(config=other)


def test_an_unknown_user_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="RUN: got 'whacamole_constraint'"):
        sim2vr_harness.load_user_policy("whacamole_constraint")


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
    assert found.events["outcome"].isin(["hit", "miss"]).sum() <= len(found.events)
    again = sim2vr_harness.read_data(tmp_path)
    assert again.episodes.equals(found.episodes)
    assert not (tmp_path / ".logs").exists() and not (tmp_path / "logs").exists()
