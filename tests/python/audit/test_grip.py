"""Grip, by hand; and what the report says an app did."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.audit.grip import can_grip, grip_share, grip_time
from sim2vr_harness.audit.judging import judge
from sim2vr_harness.audit.pages import FoundThing, Way, things_as_targets
from sim2vr_harness.audit.population import LIMITATIONS, NONE, Limitation, Subject, draw
from sim2vr_harness.audit.reaching import Crowd
from sim2vr_harness.audit.remedies import GOAL, remedy
from sim2vr_harness.audit.report import unanswered
from sim2vr_harness.audit.summary import cause
from sim2vr_harness.audit.targets import Target, read_targets
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.users.exertion import Strength


@pytest.fixture(scope="module")
def subjects() -> list[Subject]:
    return draw(6, 1)


def lever(**more: Any) -> Target:
    return Target("lever", np.array([0.2, 1.0, 0.4]), how="grab", **more)


def test_a_load_takes_grip_by_friction(subjects: list[Subject]) -> None:
    # 10 kg between two surfaces of friction .5 need 98.1 N a side, 137.3 N with the margin. A man's
    # median is 51 kg, 500.3 N; a woman's 31 kg, 304.1 N.
    man = replace(subjects[0], strength=Strength(man=True))
    woman = replace(subjects[0], strength=Strength(man=False))
    heavy = lever(load_kg=10.0)
    assert grip_share(man, heavy, NONE) == pytest.approx(0.2745, abs=1e-4)
    assert grip_share(woman, heavy, NONE) == pytest.approx(0.4516, abs=1e-4)
    weak = next(each for each in LIMITATIONS if each.name == "strength: 50 %")
    assert grip_share(woman, heavy, weak) == pytest.approx(0.9032, abs=1e-4)
    assert grip_share(man, lever(grip_n=50.03), NONE) == pytest.approx(0.1, abs=1e-4)
    assert grip_share(man, lever(), NONE) == 0.0


def test_half_the_strength_lasts_as_published() -> None:
    # 33.55 x .5^-1.61 = 33.55 x 3.0525 s.
    assert float(grip_time(0.5)) == pytest.approx(102.4, abs=0.1)
    assert can_grip([0.0, 0.5, 0.5, 1.01], 100.0).tolist() == [True, True, True, False]
    assert not can_grip(0.5, 103.0)


def test_a_hard_grip_is_named_with_its_remedy(subjects: list[Subject]) -> None:
    crowd, hard = Crowd(subjects, "seated", NONE), lever(grip_n=900.0)
    judged = judge(crowd, [hard], NONE)
    assert judged.reached.all()
    assert {cause(judged, hard, i, 0) for i in range(6)} == {"grip too weak"}
    found = remedy(crowd, hard, judged, 0)
    assert found.shift_m is None
    assert found.grip_n is not None
    eased = judge(crowd, [replace(hard, grip_n=found.grip_n)], NONE)
    assert eased.usable.mean() >= GOAL
    weak = Limitation("weak", strength=0.3)
    tired = judge(Crowd(subjects, "seated", weak), [replace(hard, grip_n=150.0)], weak)
    assert tired.held.sum() < judge(crowd, [replace(hard, grip_n=150.0)], NONE).held.sum()


def test_only_what_is_grabbed_takes_grip(tmp_path: Path) -> None:
    file = tmp_path / "t.yaml"
    file.write_text("targets: [{name: a, place: [0, 1, 0], how: touch, grip_n: 20}]")
    with pytest.raises(InputError, match="grip_n with how: touch, expected how: grab"):
        read_targets(file)


def test_the_report_says_which_things_did_not_react() -> None:
    place, half = np.zeros(3), (0.1, 0.1, 0.1)
    key = FoundThing("key", "point", place, half, False, True, ("changes", "vibrates"))
    key.way = Way("point", "left", "trigger")
    stone = FoundThing("stone", "touch", place, half, False, True, obstacle="gone")
    targets = things_as_targets([key, stone])
    assert targets[0].in_app == "point + left trigger: changes, vibrates"
    rows = [{"name": t.name, "in_app": t.in_app, "app_reacts": t.reacts} for t in targets]
    said = unanswered({"targets": rows})
    assert said.startswith("The app reacts to 1 of 2 targets when they are operated.")
    assert "stone (gone)" in said
    assert unanswered({"targets": rows[:1]}) == ""
