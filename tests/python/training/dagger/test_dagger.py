"""A student who imitates: on a stand-in whose best action shows in the observation."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from fake_simulation import FakeSimulation

from parts import needs
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.policies import attention_crops
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.runs.attention_config import AttentionCropConfig
from sim2vr_harness.runs.checkpoint import read_tensors, write_tensors
from sim2vr_harness.runs.config import PolicyConfig
from sim2vr_harness.runs.dagger_config import StudentConfig
from sim2vr_harness.training.dagger import dagger
from sim2vr_harness.training.dagger.dagger import Student

CONFIG = StudentConfig(
    n_envs=8,
    frames=8 * 8 * 30,
    batch_size=64,
    learning_rate=3e-3,
    stagger_steps=8,
)
ROLLOUT_STEPS = 8


@pytest.fixture(autouse=True)
def short_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"rollout_steps": ROLLOUT_STEPS, "teacher_rounds": 1, "checkpoint_rounds": 1}
    monkeypatch.setattr(dagger, "SETTINGS", replace(dagger.SETTINGS, **few))
    monkeypatch.setattr(attention_crops, "_VISION_PIXELS", 8)
    monkeypatch.setattr(attention_crops, "_FEATURES", 8)


class HomingGuide:
    """Pushes back to the middle; the fact is whether the first picture element is bright."""

    crop_columns: tuple[tuple[int, ...], ...] = ()

    def actions(self, simulation: FakeSimulation) -> np.ndarray:
        return (-0.7 * simulation.place).astype(np.float32)

    def facts(self, simulation: FakeSimulation) -> np.ndarray:
        return (simulation.place[:, :1] > 0).astype(np.float32)

    def numbers(self, simulation: FakeSimulation) -> np.ndarray:
        return (2.0 * simulation.place[:, 1:]).astype(np.float32)

    def crop_places(self, simulation: FakeSimulation) -> np.ndarray:
        return np.zeros((simulation.n, 0, 3), np.float32)


class GazingGuide(HomingGuide):
    """Says that the thing is in the upper left of the picture, and always alike."""

    crop_columns: tuple[tuple[int, ...], ...] = ((1,),)

    def crop_places(self, simulation: FakeSimulation) -> np.ndarray:
        return np.tile(np.array([-1.0, 0.5, 1.0], np.float32), (simulation.n, 1, 1))

    def numbers(self, simulation: FakeSimulation) -> np.ndarray:
        told = super().numbers(simulation)
        told[:, 1] = 1.5
        return told


def make(
    folder: Path,
    config: StudentConfig = CONFIG,
    seed: int = 1,
    guide: HomingGuide | None = None,
    device: str = "cpu",
    **policy_settings: Any,
) -> Student:
    simulation = FakeSimulation(n=config.n_envs)
    torch.manual_seed(seed)
    sizes = PolicyConfig(vision_channels=(4,), vision_features=8, net_arch=(32,), **policy_settings)
    policy = VisualActorCritic(
        simulation.observation_space, simulation.action_space, lambda _: 0.0, config=sizes
    )
    folder.mkdir(exist_ok=True)
    policy.to(device)
    return Student(config, policy, simulation, guide or HomingGuide(), folder, seed=seed)


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


def test_a_student_learns_where_to_look_and_what_is_there(tmp_path: Path) -> None:
    crops = AttentionCropConfig(count=1)
    config = CONFIG.model_copy(update={"numbers_weight": 0.5})

    def student(name: str) -> Student:
        return make(tmp_path / name, config, guide=GazingGuide(), attention_crops=crops)

    whole, rows = student("whole"), []
    for _ in range(12):
        rows.append(whole.step())
    assert rows[-1].crops_error < 0.2 * rows[0].crops_error
    assert rows[-1].reading_error < 0.2 * rows[0].reading_error
    extractor: Any = whole.policy.features_extractor
    where = extractor.attention_crops.where(
        torch.from_numpy(whole.simulation.observation()["vision"])
    )
    cell = where[:, 0, 0].argmax(1)
    assert (cell == 0).all()  # 16 x 24 pixels are two rows of three
    looked = where[torch.arange(whole.n), 0, 1:, cell].detach()
    # A pixel is 0.125; the pictures are noise.
    assert (looked - torch.tensor([-1.0, 0.5])).abs().mean() < 0.15


def test_more_crops_than_things_are_refused(tmp_path: Path) -> None:
    crops = AttentionCropConfig(count=2)
    with pytest.raises(InputError) as error:
        make(tmp_path, guide=GazingGuide(), attention_crops=crops)
    assert str(error.value).startswith("policy.attention_crops.count: got 2, expected at most 1")


@pytest.mark.gpu
@needs("gpu", torch.cuda.is_available(), "torch finds no GPU")
def test_a_student_learns_on_a_gpu_and_goes_on_there(tmp_path: Path) -> None:
    config = CONFIG.model_copy(update={"numbers_weight": 1.0})
    student = make(tmp_path / "whole", config, device="cuda")
    rows = [student.step() for _ in range(3)]
    file = tmp_path / "state.pt"
    write_tensors(file, student.state_dict())
    rows += [student.step() for _ in range(12)]
    assert all(weight.is_cuda for weight in student.policy.parameters())
    assert rows[-1].imitation_error < 0.5 * rows[0].imitation_error
    again = make(tmp_path / "whole", config, seed=5, device="cuda")
    again.load_state_dict(read_tensors(file, "a student"))
    assert again.store.count == 3 * config.n_envs * ROLLOUT_STEPS
    assert np.isfinite(again.step().imitation_error)
