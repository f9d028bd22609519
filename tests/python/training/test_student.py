"""A student who imitates: on a stand-in whose best action shows in the observation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from fake_simulation import FakeSimulation

from sim2vr_harness.training.config import PolicyConfig
from sim2vr_harness.training.policy import UserPolicy
from sim2vr_harness.training.student import Student
from sim2vr_harness.training.student_config import StudentConfig

CONFIG = StudentConfig(
    n_envs=8,
    frames=8 * 8 * 30,
    rollout_steps=8,
    batch_size=64,
    teacher_rounds=1,
    learning_rate=3e-3,
    stagger_steps=8,
)


class HomingGuide:
    """Pushes back to the middle; the fact is whether the first picture element is bright."""

    glance_columns: tuple[tuple[int, ...], ...] = ()

    def actions(self, simulation: FakeSimulation) -> np.ndarray:
        return (-0.7 * simulation.place).astype(np.float32)

    def facts(self, simulation: FakeSimulation) -> np.ndarray:
        return (simulation.place[:, :1] > 0).astype(np.float32)

    def numbers(self, simulation: FakeSimulation) -> np.ndarray:
        return (2.0 * simulation.place[:, 1:]).astype(np.float32)

    def glances(self, simulation: FakeSimulation) -> np.ndarray:
        return np.zeros((simulation.n, 0, 3), np.float32)


def make(folder: Path, config: StudentConfig = CONFIG, seed: int = 1) -> Student:
    simulation = FakeSimulation(n=config.n_envs)
    torch.manual_seed(seed)
    sizes = PolicyConfig(vision_channels=(4,), vision_features=8, net_arch=(32,))
    policy = UserPolicy(
        simulation.observation_space, simulation.action_space, lambda _: 0.0, config=sizes
    )
    folder.mkdir(exist_ok=True)
    return Student(config, policy, simulation, HomingGuide(), folder, seed=seed)


def test_the_student_learns_what_the_teacher_would_do(tmp_path: Path) -> None:
    student = make(tmp_path)
    rows = []
    while not student.finished:
        rows.append(student.step())
    assert student.store.count == CONFIG.frames
    assert rows[0].teacher_share == 1.0
    assert rows[1].teacher_share == pytest.approx(0.6, abs=0.2)
    assert rows[-1].teacher_share < 0.2
    assert rows[-1].imitation_error < 0.3 * rows[0].imitation_error
    assert rows[-1].imitation_error < 0.08
    simulation = FakeSimulation(n=50)
    simulation.reset(seeds=range(50))
    wanted = HomingGuide().actions(simulation)
    error = np.sqrt(((student.act(simulation.observation()) - wanted) ** 2).mean())
    assert error < 0.1
    # Episodes count only where nobody helped.
    assert 0 < rows[-1].episodes < CONFIG.frames / 6
    assert rows[-1].means["ep_Points_mean"] > 0


def test_what_the_teacher_knows_is_told_too(tmp_path: Path) -> None:
    student = make(tmp_path, CONFIG.model_copy(update={"numbers_weight": 1.0}))
    rows = []
    while not student.finished:
        rows.append(student.step())
    # The mean is 0, so that this is what is left of the variance.
    assert rows[-1].numbers_error < 0.1 * rows[0].numbers_error
    assert rows[-1].imitation_error < 0.3 * rows[0].imitation_error


@pytest.mark.parametrize("kept", [None, 2], ids=["all frames", "the last rounds"])
def test_a_resumed_stage_is_the_same_to_the_bit(tmp_path: Path, kept: int | None) -> None:
    each = CONFIG.n_envs * CONFIG.rollout_steps
    few = {"kept_frames": kept * each, "checkpoint_rounds": 1} if kept else {}
    config = CONFIG.model_copy(update=few)
    whole = make(tmp_path / "whole", config)
    for _ in range(6):
        last = whole.step()
    parts = make(tmp_path / "parts", config)
    for _ in range(3):
        parts.step()
    state = parts.snapshot()
    parts.step()  # lost: its frames are in the file, and are written over
    resumed = make(tmp_path / "parts", config, seed=1)
    resumed.load_snapshot(state)
    assert resumed.round == 3
    for _ in range(3):
        again = resumed.step()
    assert again.imitation_error == last.imitation_error
    assert again.means == last.means
    for key, value in whole.policy.state_dict().items():
        assert torch.equal(value, resumed.policy.state_dict()[key]), key
    with pytest.raises(ValueError, match="got format 9, expected 3"):
        make(tmp_path / "new").load_snapshot({"header": '{"format": 9}'})


def test_labels_are_clipped_to_what_the_student_can_do(tmp_path: Path) -> None:
    student = make(tmp_path)
    student.guide.actions = lambda simulation: np.full((simulation.n, 3), 5.0, np.float32)  # type: ignore[method-assign]
    student.step()
    assert float(student.store.rows(np.arange(8))["label"].max()) == 1.0


def test_all_phases_of_a_round_are_seen_from_the_start(tmp_path: Path) -> None:
    student = make(tmp_path)
    student.step()
    first = student.store.rows(np.arange(8, 64))["stateful_information"].numpy().ravel()
    # Without the cuts all users would have the same phase, so 7 values at most.
    phases = [len(np.unique(first[k : k + 8])) for k in range(0, 56, 8)]
    assert max(phases) >= 3
