"""What a study's file may say, and what is said of one that cannot be used."""

from typing import Any

import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.studies.config import cells_of, parse_study
from sim2vr_harness.studies.plan import plan_of

USER = "whacamole_constrained"
STUDY: dict[str, Any] = {
    "name": "placement",
    "fixed": {"user": USER, "env.app.options.round_seconds": 2.0},
    "factors": {
        "difficulty": {"key": "condition", "levels": ["easy", "hard"]},
        "life": {"key": "env.app.options.life_seconds", "levels": {"long": 1.0, "short": 0.5}},
    },
}


def study(**changes: Any) -> Any:
    return parse_study({**STUDY, **changes})


def test_all_combinations_of_levels() -> None:
    cells = cells_of(study())
    assert [cell.name for cell in cells] == [
        "difficulty=easy,life=long",
        "difficulty=easy,life=short",
        "difficulty=hard,life=long",
        "difficulty=hard,life=short",
    ]
    assert cells[3].settings == {
        "user": USER,
        "env.app.options.round_seconds": 2.0,
        "condition": "hard",
        "env.app.options.life_seconds": 0.5,
    }
    assert {cell.seed for cell in cells} == {1}, "paired seeds"
    assert len({cell.seed for cell in cells_of(study(seeds="own"))}) == 4


def test_too_many_cells_are_counted_not_made() -> None:
    """Ten factors of 1000 levels are 10**30 cells: only their lengths may be looked at."""
    factors = {f"f{i}": {"key": f"env.k{i}", "levels": list(range(1000))} for i in range(10)}
    with pytest.raises(InputError, match=r"factors: got 1000 x 1000 x .* cells, expected at most"):
        study(factors=factors)


def test_listed_cells_and_levels_that_set_several_keys() -> None:
    factors = {
        "version": {
            "levels": {
                "A": {"condition": "easy", "env.app.options.life_seconds": 1.0},
                "B": {"condition": "hard"},
            }
        },
        "noise": {"key": "env.user.noise.constant", "levels": {"none": None, "white": "white"}},
    }
    cells = cells_of(study(factors=factors, cells=[{"version": "B", "noise": "none"}]))
    assert [cell.settings for cell in cells] == [
        {**STUDY["fixed"], "condition": "hard", "env.user.noise.constant": None}
    ]
    assert cells[0].of("env.") == [
        "env.app.options.round_seconds=2.0",
        "env.user.noise.constant=null",
    ]


def test_contents_decide_about_hashes() -> None:
    plan = plan_of(study())
    keys = [task.key for task in plan.tasks]
    assert len(set(keys)) == 4
    # Another order, other names, other measures: the same cells.
    factors = dict(reversed(STUDY["factors"].items()))
    renamed = plan_of(study(name="other", factors=factors, measures=["hits"]))
    assert sorted(task.key for task in renamed.tasks) == sorted(keys)
    for change in ({"episodes": 3}, {"seed": 2}, {"people": 2}, {"deterministic": True}):
        assert not set(keys) & {task.key for task in plan_of(study(**change)).tasks}


DIFFICULTY = STUDY["factors"]["difficulty"]
COMPARED = {"factor": "difficulty"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"measures": ["hit"]}, "measures: got 'hit', expected one of hits, .*did you mean 'hits'"),
        ({"fixed": {"user": "whacamole_contrained"}}, "cell .*RUN: got 'whacamole_contrained'"),
        ({"fixed": {}}, "user: got neither user nor config, expected a trained user, or"),
        (
            {"factors": {"difficulty": {"key": "condition", "levels": ["easy", "esay"]}}},
            r"cell difficulty=esay: condition: got 'esay', expected .*did you mean 'easy'",
        ),
        (
            {"factors": {"difficulty": {"key": "conditon", "levels": ["easy"]}}},
            r"key: got 'conditon', expected one of user, .*did you mean 'condition'",
        ),
        (
            {"factors": {"a": DIFFICULTY, "b": DIFFICULTY}},
            r"factors\.b: got condition, which factors\.a sets as well, expected every key in one",
        ),
        (
            {"factors": {"a": {"key": "env.app.options.live_seconds", "levels": [1.0]}}},
            r"env\.app\.options: got unknown option 'live_seconds', .*did you mean 'life_seconds'",
        ),
        (
            {"factors": {"a": {"key": "training.seed", "levels": [1, 2]}}},
            r"training\.seed: got it together with a user, expected config instead of user",
        ),
        ({"episodes": 0}, "episodes: got 0, expected greater than or equal to 1"),
        ({"cells": [{"difficulty": "easy"}]}, r"cells\.0: got no life, expected a level of it"),
        (
            {"comparisons": [{"factor": "dificulty"}]},
            r"comparisons\.0: got 'dificulty', expected .*did you mean 'difficulty'",
        ),
        (
            {"comparisons": [{**COMPARED, "levels": ["easy"]}]},
            r"comparisons\.0\.levels: got 1, expected two",
        ),
    ],
)
def test_what_cannot_be_meant_is_said_in_a_sentence(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plan_of(study(**changes))


def test_text_of_a_study_reaches_its_key_as_it_is() -> None:
    for text in ("#go", "no", '[data-vr="1"]', "null", "5", " 'x' # y", "caf\u00e9 \U0001f3af"):
        key = "env.app.transport_options.enter"
        factors = {"button": {"key": key, "levels": {"one": text}}}
        (cell,) = cells_of(study(factors=factors))
        tree = apply_overrides({}, [one for one in cell.of("env.") if one.startswith(key)])
        assert tree["env"]["app"]["transport_options"] == {"enter": text}
