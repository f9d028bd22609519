"""What a training says at its start: devices, times, and cores that are not free."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim2vr_harness.base import cores
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.training.run import trainer

NAMES = ("imagined", "student", "ppo")
STAGES: list[Any] = [SimpleNamespace(name=name) for name in NAMES]


def test_the_recipe_takes_about_what_was_measured_on_two_cores() -> None:
    name, steps = "whacamole_constrained_distill", "total_timesteps=245_760"
    config = load_config(name, ["device=cpu", steps])
    whole = sum(trainer.expected_seconds(each, config, 2.0, 1.0) or 0.0 for each in NAMES)
    assert whole / 60.0 == pytest.approx(19.8, rel=0.2)  # with the evaluation
    half = load_config(name, ["device=cpu", steps, "student.frames=128_000"])
    student = [trainer.expected_seconds("student", each, 2.0, 1.0) for each in (half, config)]
    assert student[1] == pytest.approx(2.0 * student[0])  # type: ignore[operator]
    assert trainer.expected_seconds("q_learning", config, 2.0, 1.0) is None


def test_devices_are_those_that_the_stages_ask_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trainer, "get_device", lambda name: SimpleNamespace(type="cuda"))
    whacamole = load_config("whacamole_constrained_distill", [])
    assert [trainer.device_of(name, whacamole) for name in NAMES] == [
        "cuda",
        "cuda",
        "cuda",
    ]
    pointing = load_config("pointing", [])
    assert trainer.device_of("imagined", pointing) == "cpu"  # its game model reads values
    lines = trainer.plan_lines(STAGES, whacamole)
    assert "imagined on the GPU, about" in lines[-2]


@pytest.mark.parametrize(
    ("machine", "load", "noted"),
    # On 16 cores, of which this process has four, others have room beside it.
    [(4, 0.4, False), (4, 3.0, True), (16, 12.0, False), (16, 15.0, True)],
)
def test_cores_that_are_not_free_are_noted(
    machine: int, load: float, noted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cores.os, "getloadavg", lambda: (load, load, load))
    monkeypatch.setattr(cores.os, "cpu_count", lambda: machine)
    monkeypatch.setattr(cores, "available", lambda: 4)
    lines = trainer.plan_lines(STAGES, load_config("whacamole_constrained_distill", []))
    assert lines[0].startswith("Note: 4 cores are requested and about 1 are free") == noted
    assert lines[-1].endswith(" on 1 cores." if noted else " on 4 cores.")
