"""Fatigue per muscle and body part: who crosses what, names, and numbers by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from python.users.references import load_reference
from sim2vr_harness.client import describe_game
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.play.exertion import fatigue_groups
from sim2vr_harness.play.fatigue import (
    full_name,
)
from sim2vr_harness.play.round import round_result, summarise
from sim2vr_harness.users import load_body

WRIST = ["ECRL", "ECRB", "ECU", "FCR", "FCU", "PL"]


def crossing(*joints: int) -> list[str]:
    """Muscles with a recorded moment arm at one of the joints (tests/data/mobl_arms)."""
    facts = load_reference("validation")
    arms = np.abs([posture["moment_arm_m"] for posture in facts["postures"]]).max(axis=0)
    rows = (arms[:, list(joints)] > 1e-5).any(axis=1)
    return [muscle for muscle, crosses in zip(facts["muscles"], rows, strict=True) if crosses]


@pytest.mark.parametrize("name", ["mobl_arms_wrist", "myoarm_r"])
def test_groups_follow_from_moment_arms(name: str) -> None:
    groups = fatigue_groups(load_body(name, appearance=False))
    found = {part: [groups.muscles[i] for i in rows] for part, rows in groups.parts.items()}
    # Of the joints elevation plane, elevation, rotation, elbow, pro-supination, deviation, flexion.
    assert found == {
        "shoulder": crossing(0, 1, 2),
        "elbow": crossing(3),
        "forearm": crossing(4),
        "wrist": crossing(5, 6),
    }
    assert found["wrist"] == WRIST


def test_two_arms_have_parts_of_both_and_of_each() -> None:
    groups = fatigue_groups(load_body("mobl_arms_bimanual", appearance=False))
    wrist = {part: [groups.muscles[i] for i in groups.parts[part]] for part in groups.parts}
    right, left = ([f"{muscle}{side}" for muscle in WRIST] for side in ("_r", "_l"))
    assert (wrist["wrist_r"], wrist["wrist_l"]) == (right, left)
    assert wrist["wrist"] == [*right, *left]


def test_values_and_means_by_hand() -> None:
    groups = fatigue_groups(load_body("mobl_arms_wrist", appearance=False))
    worst = np.arange(32) / 100.0
    values = groups.values(worst)
    assert values["fatigue.DELT1"] == 0.0 and values["fatigue.PQ"] == 0.31
    # ECRL, ECRB, ECU, FCR, FCU, PL are muscles 24 to 29.
    assert values["fatigue.wrist"] == pytest.approx(0.265)
    assert full_name("DELT1_r") == "deltoid anterior, right"
    assert full_name("biceps_r") == "biceps_r", "of an unknown body"
    told = {"condition": "easy", "steps": 1, "game_return": 0.0, "effort": 0.0, "log": {}}
    rounds = [
        replace(
            round_result(describe_game("whacamole"), **told, episode=k, seed=k, info={}),
            fatigue_parts=groups.part_names,
        ).with_values(groups.values(worst * factor))
        for k, factor in enumerate((1.0, 2.0))
    ]
    summary = summarise(rounds, describe_game("whacamole"))
    assert summary["fatigue.PQ"] == pytest.approx(0.465)
    assert summary["fatigue.wrist_sd"] == pytest.approx(0.265 / np.sqrt(2.0))
    assert summary["fatigue_parts"] == [
        *("fatigue.shoulder", "fatigue.elbow", "fatigue.forearm", "fatigue.wrist")
    ]


def test_an_evaluation_measures_and_prints_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    user = "pretrained:whacamole_constrained"
    short = ("env.app.options.round_seconds=3",)
    request = Request(conditions=["easy"], episodes=1, overrides=short, out=tmp_path)
    found = evaluate(user, request)
    (played,) = found.rounds
    muscles = [f"fatigue.{name}" for name in load_body("mobl_arms_wrist").muscles]
    of_muscles = [played.values[name] for name in muscles]
    assert np.mean(of_muscles) == pytest.approx(played.values["max_fatigued"])
    # The table of steps has the same, as binary32.
    last = found.data.steps().iloc[-1]
    assert last["most_fatigued_ANC"] == pytest.approx(played.values["fatigue.ANC"], rel=1e-6)
    row = found.episodes.iloc[0]
    assert row["fatigue.shoulder"] == played.values["fatigue.shoulder"] > 0.0
    told = found.data.dictionary.set_index("column")["description"]
    assert told["fatigue.ANC"] == "Fatigue of anconeus"
