"""The benchmark's scenes: what they play depends on neither threads, transport nor company."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.bench import scenes
from sim2vr_harness.bench.scenes import EnvScene, Spec, open_scene, user_state
from sim2vr_harness.training.config import TrainingConfig, parse_config


@pytest.fixture(autouse=True)
def short_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes, "WARM_UP_STEPS", 12)


@pytest.fixture(scope="module")
def config() -> TrainingConfig:
    return parse_config({"env": {"vision": {"width": 32, "height": 24}}})


def hashes(spec: Spec) -> tuple[str | None, str | None]:
    with closing(open_scene(spec)) as scene:
        return scene.state_hash, scene.observation_hash


@pytest.mark.parametrize("name", ["physics", "game", "render", "env"])
def test_threads_do_not_matter(config: TrainingConfig, name: Any) -> None:
    found = {hashes(Spec(name, config, 3, threads)) for threads in (1, 2)}
    assert len(found) == 1
    ((state, observation),) = found
    assert state is not None
    assert len(state) == 16
    assert (observation is not None) == (name in ("render", "env"))


@pytest.mark.parametrize("name", ["game", "render", "env"])
def test_transports_do_not_matter(config: TrainingConfig, name: Any) -> None:
    kinds: list[Any] = ["in_process", "protocol1", "protocol2"]
    found = {hashes(Spec(name, config, 2, 1, kind)) for kind in kinds}
    assert len(found) == 1


def states(config: TrainingConfig, n: int) -> Iterator[bytes]:
    with closing(EnvScene(Spec("env", config, n, 2))) as scene:
        simulation: Any = scene.env.simulation
        yield from [user_state(simulation, i) for i in range(n)]


def test_company_does_not_matter(config: TrainingConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    # User 1 has short rounds of 0.3 s in both, so that an autoreset is part of the comparison.
    monkeypatch.setattr(scenes, "SHORT_ROUND_EVERY", 3)
    monkeypatch.setattr(scenes, "SHORT_ROUND_SECONDS", 0.3)
    assert list(states(config, 2)) == list(states(config, 5))[:2]


def test_a_change_of_the_game_changes_the_hash(config: TrainingConfig) -> None:
    app = config.env.app.model_copy(update={"options": {"condition": "easy"}})
    easy = config.model_copy(update={"env": config.env.model_copy(update={"app": app})})
    assert hashes(Spec("game", config, 2, 1))[0] != hashes(Spec("game", easy, 2, 1))[0]


def test_short_rounds_are_one_in_thirty(config: TrainingConfig) -> None:
    assert scenes.short_rounds(config.env, 14) == []
    assert scenes.short_rounds(config.env, 64) == [15, 45]


def test_actions_are_those_of_the_user() -> None:
    few, many = scenes.actions(2, 5), scenes.actions(4, 5)
    assert few.shape == (scenes.ACTIONS, 2, 5)
    assert np.array_equal(few, many[:, :2])
    assert not np.array_equal(many[:, 2], many[:, 3])
    assert np.abs(many).max() == 1.0


def test_a_digest_keeps_the_parts_apart() -> None:
    assert scenes.digest([b"ab", b"c"]) != scenes.digest([b"a", b"bc"])


def test_training_measures_whole_minibatches(config: TrainingConfig) -> None:
    from sim2vr_harness.bench.train import short_iteration

    # 64 users: 1,000 steps are 16 each, 1,024 in one minibatch; 4,000 are 63 each, in 4
    # minibatches 64 each, 4,096.
    one = short_iteration(config, 64, 1000).ppo
    assert (one.n_envs, one.n_steps, one.batch_size) == (64, 16, 1024)
    four = short_iteration(config, 64, 4000).ppo
    assert (four.n_envs, four.n_steps, four.batch_size) == (64, 64, 1024)


def test_the_reference_way_plays_the_same_rounds(config: TrainingConfig) -> None:
    from sim2vr_harness.training.errors import InputError

    env = Spec("env", config, 2, 1)
    reference = Spec("reference-way", config, 2, None, "protocol1")
    assert hashes(reference) == hashes(env)
    with pytest.raises(InputError, match="--n: got 129 with scene reference-way, expected at most"):
        open_scene(Spec("reference-way", config, 129, None, "protocol1"))
