"""``teacher.start``: a teacher goes on with what another run's teacher knows."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from tiny_distill import config, train

from sim2vr_harness.base.errors import InputError, UnusableFile
from sim2vr_harness.training.model_based.stage import ImaginedStage

pytest.importorskip("sim2vr_harness._app_runtime")

OTHER_RULE = "env.app.options.condition=easy-unconstrained"


@pytest.fixture(scope="module")
def teacher(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a teacher."""
    folder = tmp_path_factory.mktemp("start") / "first"
    train(folder)
    return folder


def _weights(folder: Path) -> dict[str, torch.Tensor]:
    return torch.load(folder / "imagined" / "policy.pt", weights_only=True)


def _goes_on(folder: Path, *settings: str, **how: Any) -> dict[str, torch.Tensor]:
    """What its imagined rollouts leave behind."""
    train(folder, *settings, **how)
    return _weights(folder)


def test_it_begins_with_the_others_weights_and_learns_from_the_second_cycle_on(
    teacher: Path, tmp_path: Path
) -> None:
    theirs = _weights(teacher)
    learns = ["teacher.imagined.average_updates=0", OTHER_RULE, "seed=5"]
    start = f"teacher.start={teacher}"
    once = _goes_on(tmp_path / "once", start, *learns, "teacher.imagined.cycles=1")
    assert all(torch.equal(value, theirs[key]) for key, value in once.items())
    twice = _goes_on(tmp_path / "twice", start, *learns, "teacher.imagined.cycles=2")
    moved = {key for key, value in twice.items() if not torch.equal(value, theirs[key])}
    assert moved and all("policy_net" in key or "action_net" in key for key in moved)
    alone = _goes_on(tmp_path / "alone", *learns)
    assert not all(torch.equal(value, alone[key]) for key, value in twice.items())


def test_a_run_says_whose_teacher_it_begins_with_and_goes_on_without_it(
    teacher: Path, tmp_path: Path
) -> None:
    lent = tmp_path / "lent"
    shutil.copytree(teacher, lent)
    result, text = train(tmp_path / "run", f"teacher.start={lent}")
    assert not result.interrupted
    assert "It begins with the teacher of" in " ".join(text.split())
    shutil.rmtree(lent)
    stage = ImaginedStage(
        config(f"teacher.start={lent}"), tmp_path / "run" / "imagined", resumed=True
    )
    stage.open()  # its own teacher is there: the other is not asked for
    stage.close()


def test_it_begins_so_in_the_place_of_a_run_that_is_there(teacher: Path, tmp_path: Path) -> None:
    there = tmp_path / "run"
    shutil.copytree(teacher, there)
    torch.save({"nobody's": torch.zeros(1)}, there / "imagined" / "policy.pt")
    before = (there / "imagined" / "policy.pt").read_bytes()
    with pytest.raises(InputError, match="no run"):
        _goes_on(there, f"teacher.start={tmp_path / 'nowhere'}", overwrite=True)
    assert (there / "imagined" / "policy.pt").read_bytes() == before
    one = ["teacher.imagined.average_updates=0", "teacher.imagined.cycles=1"]
    found = _goes_on(there, f"teacher.start={teacher}", *one, overwrite=True)
    theirs = _weights(teacher)
    assert all(torch.equal(value, theirs[key]) for key, value in found.items())


@pytest.mark.parametrize(
    ("settings", "field", "got"),
    [
        (["teacher.policy.net_arch=[8]"], "teacher.start", "teacher.policy"),
        (["teacher.hidden_fields=[next*]"], "teacher.start", "teacher.hidden_fields"),
        (["env.action_frequency_hz=20", "env.vision.width=60"], "teacher.start", "a user with"),
    ],
)
def test_another_kind_of_teacher_is_refused(
    teacher: Path, tmp_path: Path, settings: list[str], field: str, got: str
) -> None:
    with pytest.raises(InputError) as error:
        _goes_on(tmp_path / "run", f"teacher.start={teacher}", *settings)
    assert error.value.field == field and got in error.value.got
    assert not any(tmp_path.iterdir())


def test_no_teacher_to_begin_with_is_said(teacher: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run"):
        _goes_on(tmp_path / "run", f"teacher.start={tmp_path / 'nowhere'}")
    early = tmp_path / "early"
    shutil.copytree(teacher, early)
    (early / "imagined" / "policy.pt").write_bytes(b"nothing")
    with pytest.raises(UnusableFile):
        _goes_on(tmp_path / "run", f"teacher.start={early}")
    (early / "imagined" / "policy.pt").unlink()
    with pytest.raises(InputError, match="has not learned yet"):
        _goes_on(tmp_path / "run", f"teacher.start={early}")
    with pytest.raises(InputError, match="got 0 with start"):
        config(f"teacher.start={teacher}", "teacher.imagined.cycles=0")
