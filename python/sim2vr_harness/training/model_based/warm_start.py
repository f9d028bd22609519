"""Teachers who begin with what another run's teacher knows: ``teacher.start``."""

from __future__ import annotations

from pathlib import Path

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.contract import contract, differences, worded
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder

__all__ = ["teacher_to_start_with"]

_EXPECTED = "the folder of a run whose teacher has learned in imagined rollouts"


def teacher_to_start_with(config: TrainingConfig, weights: Path) -> Path:
    """Return the file with the weights, and the statistics, of another run's teacher.

    Args:
        config: of the run that begins; says by ``teacher.start`` with whose.
        weights: where the stage of imagined rollouts leaves them in a run's folder.

    Raises:
        InputError: there is no such teacher, or it does not observe and act as this one.
    """
    start = config.teacher.start
    assert start is not None
    run = RunFolder(start)
    if not run.exists:
        raise InputError("teacher.start", f"{start!r}, which is no run", _EXPECTED)
    other, file = run.load_config(), run.path / weights
    if not file.is_file():
        got = f"{start!r}, whose teacher has not learned yet"
        raise InputError(
            "teacher.start", got, f"{_EXPECTED}: sim2vr-harness train --resume {start}"
        )
    found = differences(contract(config.env), contract(other.env))
    if found:
        own, its = worded(found)
        raise InputError("teacher.start", f"{start!r}, a user with {its}", own)
    for name in ("hidden_fields", "policy"):
        wanted, its_own = getattr(config.teacher, name), getattr(other.teacher, name)
        if wanted != its_own:
            got = f"{start!r}, a teacher with teacher.{name}: {its_own}"
            raise InputError("teacher.start", got, f"one with {wanted}")
    return file
