"""Everything that learns goes on from its state to the same bits, and its seed decides."""

import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import test_dagger
import test_delayed_teachers
import test_human_motor_training
import test_learner_numerics
import test_trainer
import test_training as skills
from short_cycles import short_cycles

from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.policies import attention_crops
from sim2vr_harness.runs.attention_config import AttentionCropConfig
from sim2vr_harness.runs.checkpoint import read_tensors, write_tensors
from sim2vr_harness.training.dagger import dagger
from sim2vr_harness.training.option_q_learning import q_learning

pytest.importorskip("sim2vr_harness._app_runtime")

ROUND = test_dagger.CONFIG.n_envs * test_dagger.ROLLOUT_STEPS


@pytest.fixture(autouse=True)
def small() -> Iterator[None]:
    """Little of everything."""
    rounds = {"rollout_steps": test_dagger.ROLLOUT_STEPS, "teacher_rounds": 1}
    student = replace(dagger.SETTINGS, **rounds, checkpoint_rounds=1)
    with ExitStack() as held:
        held.enter_context(short_cycles())
        held.enter_context(torch_threads(2))
        for module, settings in (
            (dagger, student),
            (q_learning, replace(q_learning.SETTINGS, batch_size=8)),
        ):
            held.enter_context(patch.object(module, "SETTINGS", settings))
        held.enter_context(patch.multiple(attention_crops, _VISION_PIXELS=8, _FEATURES=8))
        held.enter_context(skills.tiny_practice())
        yield


def student(folder: Path, crops: bool = False, **settings: object) -> Any:
    config = test_dagger.CONFIG.model_copy(update=settings)
    guide = test_dagger.GazingGuide() if crops else None
    one = {"attention_crops": AttentionCropConfig(count=1)} if crops else {}
    return test_dagger.make(folder, config, guide=guide, **one)


LEARNERS: dict[str, tuple[Callable[[Path], Any], int, int]] = {
    "Q-learning of persons": (lambda folder: skills.with_persons(folder, 8), 0, 3),
    "DAgger, last rounds kept": (lambda folder: student(folder, kept_frames=2 * ROUND), 3, 1),
    "DAgger, crops": (lambda folder: student(folder, True, numbers_weight=0.5), 2, 1),
    "imagined rollouts": (lambda _: test_delayed_teachers.rollouts(people={"seed": 1}), 1, 1),
    "motor policy": (lambda _: skills.motor_training(), 1, 1),
    "human motor policy": (lambda _: test_human_motor_training.trainer(), 1, 1),
}


def assert_same(one: Any, other: Any, where: str = "state") -> None:
    """Compare two states to the bit."""
    if isinstance(one, Mapping):
        assert list(one) == list(other), where
        for name, value in one.items():
            assert_same(value, other[name], f"{where}.{name}")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), where
        for i, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{where}[{i}]")
    elif where.endswith(".simulation.simulation") and int(one[0]) == pickle.PROTO[0]:
        assert_same(*(pickle.loads(np.asarray(each).tobytes()) for each in (one, other)), where)
    else:
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other), err_msg=where)


@pytest.mark.parametrize(("make", "before", "after"), LEARNERS.values(), ids=LEARNERS)
def test_a_learner_goes_on_from_its_state(
    make: Callable[[Path], Any], before: int, after: int, tmp_path: Path
) -> None:
    """Its state goes through a file, and a step that is lost comes after it."""
    whole = make(tmp_path / "whole")
    for _ in range(before + after):
        whole.step()
    expected = whole.state_dict()
    parts = make(tmp_path / "parts")
    for _ in range(before):
        parts.step()
    write_tensors(tmp_path / "state.pt", parts.state_dict())
    parts.step()  # lost
    again = make(tmp_path / "parts")
    again.load_state_dict(read_tensors(tmp_path / "state.pt", "a state"))
    for _ in range(after):
        again.step()
    assert_same(expected, again.state_dict())
    with pytest.raises(ValueError, match="got a state without"):
        again.load_state_dict({"something": 1})


def in_shards(folder: Path, stop: int, **how: Any) -> Any:
    ppo = test_learner_numerics.BIG | {"critic_learning_rate_factor": 5.0}
    network = {"net_arch": [16], "vision_features": 8, "proprioception_features": 8}
    policy = network | {"vision_precision": "bfloat16"}
    return test_trainer.run(folder, stop, test_trainer.tiny(ppo=ppo, policy=policy), **how)


def test_a_run_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    whole = in_shards(tmp_path / "whole", 1200)
    in_shards(tmp_path / "parts", 400)
    parts = in_shards(tmp_path / "parts", 1200, resume=True)
    test_trainer.assert_same_learner(whole.checkpoint, parts.checkpoint)
    rows = [test_trainer.rows_without_times(tmp_path / name) for name in ("whole", "parts")]
    assert_same(*rows)
