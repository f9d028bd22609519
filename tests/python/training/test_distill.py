"""The distilled recipe end to end, tiny, in the real game: stages, folders, resume."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from sim2vr_harness.training import distill, trainer
from sim2vr_harness.training.config import TrainingConfig, load_config
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.run_folder import RunFolder
from sim2vr_harness.training.student import Student

pytest.importorskip("sim2vr_harness._app_runtime")

SETTINGS = [
    "recipe=distill",
    "device=cpu",
    "env.app.options.round_seconds=2.0",
    "policy.scale_proprioception=true",
    "teacher.total_timesteps=64",
    "teacher.coarse_until_step=0",
    "teacher.imagination.cycles=1",
    "teacher.imagination.first_play_steps=30",
    "teacher.imagination.first_fit_minibatches=20",
    "teacher.imagination.users=8",
    "teacher.imagination.updates=2",
    "teacher.imagination.critic_first_updates=0",
    "teacher.ppo.n_envs=4",
    "teacher.ppo.n_steps=8",
    "teacher.ppo.batch_size=16",
    "teacher.ppo.n_epochs=1",
    "teacher.ppo.critic_first_iterations=1",
    "teacher.aids.near_starts={start: 0.0, end: 0.0}",
    "teacher.evaluate_rounds=0",
    "student.n_envs=2",
    "student.frames=96",
    "student.rollout_steps=8",
    "student.batch_size=16",
    "student.checkpoint_rounds=2",
    "student.stagger_steps=20",
    "ppo.n_envs=2",
    "ppo.n_steps=10",
    "ppo.batch_size=10",
    "ppo.n_epochs=1",
    "ppo.value_warmup_iterations=1",
    "total_timesteps=40",
    "checkpoint.every_steps=20",
]


def config(*settings: str) -> TrainingConfig:
    return load_config("whacamole_constrained", [*SETTINGS, *settings])


def train(folder: Path, *settings: str, **how: bool) -> tuple[trainer.TrainResult, str]:
    text = io.StringIO()
    console = Console(file=text, width=200)
    return trainer.train(config(*settings), folder, console=console, **how), text.getvalue()


def weights(path: Path) -> dict[str, torch.Tensor]:
    with zipfile.ZipFile(path) as archive:
        return torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("distill") / "run"
    result, text = train(folder)
    assert not result.interrupted
    for stage in (1, 2, 3):
        assert f"Stage {stage} of 3" in text
    return folder


def test_all_stages_leave_their_traces(whole: Path) -> None:
    run = RunFolder.open(whole)
    assert run.latest_checkpoint().stem == "step_000000040"
    assert set(run.metadata()["stage_seconds"]) == {"teacher", "student"}
    rows = [
        json.loads(row) for row in (whole / "student" / "metrics.jsonl").read_text().splitlines()
    ]
    assert [row["step"] for row in rows] == [16, 32, 48, 64, 80, 96]
    assert all(np.isfinite(row["student/imitation_error"]) for row in rows)
    left = sorted(file.name for file in (whole / "student").iterdir())
    assert left == ["metrics.jsonl", "policy.pt"]
    assert list((whole / "teacher" / "checkpoints").glob("*.zip"))


def test_fine_tuning_begins_with_the_student_and_with_its_critic(whole: Path) -> None:
    student = torch.load(whole / "student" / "policy.pt", weights_only=True)
    first, second = (weights(file) for file in RunFolder.open(whole).checkpoints()[-2:])
    same = [key for key, value in student.items() if torch.equal(value, first[key])]
    moved = sorted(student.keys() - set(same))
    assert moved
    assert all("critic" in key or key.startswith("value_net") for key in moved)
    assert not torch.equal(first["action_net.weight"], second["action_net.weight"])
    scaling = [key for key in student if key.endswith("scaling.std")]
    assert scaling
    assert (student[scaling[0]] != 1.0).any()


@pytest.mark.parametrize(("options", "most"), [({}, 3), ({"condition": "easy"}, 1)])
def test_a_student_may_have_game_options_of_its_own(
    options: dict[str, str], most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    discard = Student.discard

    def noting(self: Student) -> None:
        seen.append(self.store.rows(np.arange(self.store.count))["facts"].sum(1))
        discard(self)

    monkeypatch.setattr(Student, "discard", noting)
    train(tmp_path / "run", f"student.app_options={json.dumps(options)}")
    assert seen[0].max() == most


def test_a_stopped_student_goes_on_to_the_same_end(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    step, rounds = Student.step, []

    def stopping(self: Student):
        rounds.append(self.round)
        if len(rounds) == 4:
            raise KeyboardInterrupt
        return step(self)

    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(Student, "step", stopping)
        result, _ = train(folder)
    assert result.interrupted
    assert result.checkpoint is None
    with pytest.raises(InputError, match="no checkpoint yet"):
        RunFolder.open(folder).latest_checkpoint()
    result, text = train(folder, resume=True)
    assert "Continuing with 32 frames" in text
    assert not result.interrupted
    one, other = (weights(RunFolder.open(run).latest_checkpoint()) for run in (whole, folder))
    assert [key for key in one if not torch.equal(one[key], other[key])] == []


def test_a_guide_says_what_muscles_shall_do_and_which_cells_have_targets(whole: Path) -> None:
    from sim2vr_harness.envs.simulation import Simulation

    settings = config()
    checkpoint = RunFolder(whole / "teacher").latest_checkpoint()
    with_pictures = Simulation(settings.env, 2)
    guide = distill.TeacherGuide(checkpoint, settings.teacher, with_pictures)
    with_pictures.reset(seeds=[1, 2])
    seen = set()
    for _ in range(30):
        actions, facts = guide.actions(with_pictures), guide.facts(with_pictures)
        assert actions.shape == (2, 32)
        assert np.abs(actions).max() <= 1.0
        assert facts.shape == (2, 9)
        seen |= set(np.unique(facts))
        with_pictures.step(actions)
    assert seen == {0.0, 1.0}
    mean, std = guide.proprioception_scale(with_pictures)
    assert mean.shape == std.shape == (56,)
    with_pictures.close()


def test_a_game_without_privileged_numbers_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"recipe: got 'distill' for the game 'sample'.*ppo"):
        train(
            tmp_path / "run",
            "env.app.game=sample",
            "env.app.options={}",
            "evaluation.conditions=[standard]",
        )
