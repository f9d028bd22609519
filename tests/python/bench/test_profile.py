"""Profile of a recipe: every stage is there, in a short time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.bench.profile import short_run, stage_lines
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.runs.run_folder import RunFolder


def test_a_shortened_recipe_has_all_stages_and_is_never_longer() -> None:
    short = short_run(load_config("whacamole_constrained_distill", ["student.frames=4096"]))
    assert short.teacher.imagined.cycles == 2
    assert short.student.frames == 4096
    assert short.total_timesteps == short.ppo.n_envs * short.ppo.n_steps
    learning = short_run(
        load_config("skills", ["skills.q_learning.try_steps=500"])
    ).skills.q_learning
    assert (learning.try_steps, learning.user_steps) == (500, 12_000)
    with pytest.raises(InputError, match="'sac'"):
        short_run(load_config("sample_sac", []))


def test_the_table_has_busy_cores(tmp_path: Path) -> None:
    parts = {"playing": {"seconds": 4.0, "cpu_seconds": 6.0}}
    known = {"sessions": [], "stage_seconds": {"ppo": 5.0}, "stage_parts": {"ppo": parts}}
    (tmp_path / "run.json").write_text(json.dumps(known))
    whole, playing = (line.split() for line in stage_lines(RunFolder(tmp_path))[1:])
    assert whole == ["ppo", "5.0", "s", "6.0", "s", "1.20"]
    assert playing == ["playing", "4.0", "s", "6.0", "s", "1.50"]
