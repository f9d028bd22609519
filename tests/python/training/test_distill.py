"""The distilled recipe end to end, tiny, in the real game: what its stages leave behind."""

from pathlib import Path

import numpy as np
import pytest
import torch
from tiny_distill import config, train, weights

from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.dagger.dagger import TeacherExpert
from sim2vr_harness.training.run.stage import Report

REPORTS: list[Report] = []


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("distill") / "run"
    result, text = train(folder, report=REPORTS.append)
    assert not result.interrupted
    for stage in (1, 2, 3):
        assert f"Stage {stage} of 3" in text
    assert "easier than the game" not in " ".join(text.split())
    return folder


def test_every_row_of_every_stage_is_reported(whole: Path) -> None:
    stages = {report.stage: report.number for report in REPORTS}
    assert stages == {"imagined": 1, "student": 2, "ppo": 3}
    assert {report.stages for report in REPORTS} == {3}
    done = {name: [r.done for r in REPORTS if r.stage == name] for name in stages}
    assert done == {
        "imagined": [1, 2],
        "student": [16, 32, 48, 64, 80, 96],
        "ppo": [20, 40],
    }
    last = {report.stage: report for report in REPORTS}
    assert [(r.total, r.unit) for r in last.values()] == [
        (2, "cycles"),
        (96, "frames"),
        (40, "user steps"),
    ]
    assert last["imagined"].values["place_error_m"] > 0.0
    assert last["student"].values["student/imitation_error"] > 0.0
    assert last["ppo"].values["train/std"] > 0.0


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


def test_a_guide_says_what_muscles_shall_do_and_which_cells_have_targets(whole: Path) -> None:
    from sim2vr_harness.envs.simulation import Simulation

    settings = config()
    learned = whole / "imagined" / "policy.pt"
    with_pictures = Simulation(settings.env, 2)
    guide = TeacherExpert(learned, settings.teacher, with_pictures)
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
