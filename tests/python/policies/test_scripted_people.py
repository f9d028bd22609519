"""Scripts that persons carry out: reaction, Fitts' law, exclusion, and studies of them."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.evaluation.evaluate import Evaluation, Request, evaluate
from sim2vr_harness.policies.hierarchical.human_motor import RECOGNITION_S
from sim2vr_harness.policies.scripted.hand import head_angles

PANEL = ("env.app.game=panel", "env.app.renderer=null")
LIT = "press lit by ray"


def play(user: str, *changes: str, people: int = 2, **request: Any) -> Evaluation:
    overrides = [*PANEL, "env.app.options.round_seconds=4", *changes]
    return evaluate(user, Request(people=people, episodes=1, overrides=overrides, **request))


@pytest.fixture(scope="module")
def sizes() -> dict[float, Evaluation]:
    """Three persons, buttons of 3 and 16 cm at 1.5 m: 1.1 and 6.1 degrees."""
    seconds = "env.app.options.round_seconds=8"
    return {
        size: play(LIT, seconds, f"env.app.options.button_m={size}", people=3)
        for size in (0.03, 0.16)
    }


def test_small_targets_take_longer_and_are_missed_more(sizes: dict[float, Evaluation]) -> None:
    small, large = (found.summaries["keypad"] for found in sizes.values())
    assert small["step_time"] > large["step_time"] + 0.05
    assert small["step_misses"] > large["step_misses"]
    assert small["hits"] < large["hits"]
    assert small["persons"] == large["persons"] == 3
    # The lit button is within 15 degrees of straight ahead; heads follow hands and sway a little.
    for heads in (small, large):
        assert 0.0 < heads["gaze_eccentricity"] < 30.0
        assert abs(heads["head_flexion"]) < 30.0


def test_nobody_acts_before_the_own_delay_and_recognition(sizes: dict[float, Evaluation]) -> None:
    for result in sizes[0.16].rounds:
        assert result.person is not None
        least_s = result.person["visual_delay_s"] + RECOGNITION_S
        times = [step.time_s for step in result.script if step.time_s is not None]
        assert len(times) > 4, "the script begins again when it is done"
        assert min(times) >= least_s
        # A target that is missed first counts longer in the game than the last step at it.
        assert result.values["mean_selection_time_s"] == pytest.approx(
            float(np.mean(times)), abs=0.11
        )


@pytest.mark.parametrize(
    ("turned_deg", "place", "expected"),
    [
        ((10.0, 0.0), (2.0, 0.0, 1.2), (10.0, 0.0, 10.0)),  # nods, the place is level
        ((0.0, -20.0), (2.0, 0.0, 1.2), (0.0, 20.0, 20.0)),  # turns to the right
        ((0.0, 0.0), (1.0, 1.0, 1.2), (0.0, 0.0, 45.0)),
    ],
)
def test_what_neck_and_eyes_have_to_turn(
    turned_deg: tuple[float, float], place: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    """About y, which is to the left, by the first, or about z by the second; MuJoCo's world."""
    nod, turn = np.radians(turned_deg) / 2.0
    quat = np.array([np.cos(nod) * np.cos(turn), 0.0, np.sin(nod), np.sin(turn)])
    poses = np.array([[0.0, 0.0, 1.2]]), quat[None]
    users = SimpleNamespace(device_poses=lambda device: poses)
    assert head_angles(users, 0, np.array(place)) == pytest.approx(expected, abs=1e-6)


def test_the_same_seed_has_the_same_bits_whoever_plays_beside() -> None:
    short = "env.app.options.round_seconds=3"
    alone, together = (play(LIT, short, people=2, seed=5, batch=batch) for batch in (1, 2))
    assert [one.as_dict() for one in alone.rounds] == [one.as_dict() for one in together.rounds]
    other = play(LIT, short, people=2, seed=6)
    assert [one.values for one in other.rounds] != [one.values for one in alone.rounds]


@pytest.mark.parametrize(
    ("place", "able", "unable", "why"),
    [
        # 1.45 and 2.0 m tall, who differ in nothing else of their size.
        ("0.1 1.15 0.56", "person.stature_m=2.0", "person.stature_m=1.45", "out of reach"),
        # Arms with a tenth of the forces that lift them.
        ("0.1 1.3 0.45", "person.strength=1.28", "person.strength=0.12", "came as near as"),
    ],
)
def test_the_short_and_the_weak_are_excluded_with_the_reason(
    place: str, able: str, unable: str, why: str
) -> None:
    alike = "env.user.people.vary=[visual_delay_s]"
    seconds = "env.app.options.round_seconds=6"
    for who, excluded in ((able, False), (unable, True)):
        found = play(f"touch {place}", f"env.user.{who}", alike, seconds)
        for result in found.rounds:
            assert (why in result.excluded) == excluded, result.script
            assert (result.values["max_fatigued"] is None) == excluded
            assert (result.values["steps_done"] == 0.0) == excluded
        assert (found.summaries["keypad"]["step_time"] is None) == excluded


def test_a_ball_that_jumps_away_when_it_is_touched_is_no_miss() -> None:
    """A point of the game is a touch; the ball is elsewhere when the step ends."""
    found = play("touch Ball", "env.app.game=sample", people=2)
    for result in found.rounds:
        touched = [step for step in result.script if "Points" in step.changed]
        assert len(touched) > 1
        assert not [step.step for step in touched if step.missed]


def test_an_entry_is_repeated_until_a_number_changes(tmp_path: Path) -> None:
    script = tmp_path / "script.yaml"
    script.write_text("- {do: press 3 1 1.5 by ray, until: Errors}\n- {do: point lit}\n")
    played = play(str(script), "env.app.options.round_seconds=6", people=1)
    (steps,) = (one.script for one in played.rounds)
    assert [step.step.split()[0] for step in steps[:2]] == ["press", "point"]
    script.write_text("- {do: press lit, until: Erors}\n")
    with pytest.raises(InputError, match=r"until: got 'Erors', expected .*did you mean 'Errors'"):
        play(str(script), people=1)


def test_a_question_in_one_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["study", "--game", "panel", "--user", "touch 0.1 1.1 0.9", "--people", "2"]
    words += ["--vary", "button_m=0.05,0.2", "--out", str(out), "--jobs", "1"]
    words += ["--set", "env.app.options.round_seconds=5.5"]
    with pytest.raises(SystemExit) as done:
        main(words)
    assert not done.value.code
    told = capsys.readouterr().out.replace("\n", " ")
    assert "2 of 2 can do no step and are excluded (person 0: the hand came" in told
    assert "out of reach" in (out / "report.html").read_text()
    assert "people: 2" in (tmp_path / "out.yaml").read_text()
    assert json.loads((out / "study.json").read_text())["study"]["fixed"]["user"] == words[4]
    with pytest.raises(SystemExit):  # the file repeats the study
        main(["study", str(tmp_path / "out.yaml"), "--out", str(out), "--jobs", "1"])
    assert "Played: 0 of 2" in capsys.readouterr().out
    for failed in (False, True):  # other options replace it if there is no finished cell
        for cell in (out / "cells").iterdir() if failed else ():
            cell.rename(cell.with_name(f".{cell.name}"))
        with pytest.raises(SystemExit):
            main([*words, "--seed", "5", "--plan"])
        assert ("seed: 5" in (tmp_path / "out.yaml").read_text()) == failed


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ([], "STUDY.yaml: got nothing"),
        (["--vary", "button_m=0.1,0.2"], "--user: got nothing"),
        (["--vary", "button_m=0.1", "--user", LIT], "two values or more"),
        (["--vary", "button_m=0.1,0.2", "--user", "pres lit"], "did you mean 'press'"),
        (["a.yaml", "--vary", "button_m=0.1,0.2"], "--vary: got it with a.yaml"),
        (["a.yaml", "--seed", "0"], "--seed: got it with a.yaml"),
    ],
)
def test_studies_that_are_refused(
    words: list[str], error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    game = [] if "a.yaml" in words else ["--game", "panel", "--out", str(tmp_path / "out")]
    with pytest.raises(SystemExit):
        main(["study", *words, *game])
    assert error in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
