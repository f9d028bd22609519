"""Scripted users: words and files, inputs, and what they do on a page and in a game."""

import json
import re
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.envs import AppConfig, EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.evaluate import Evaluation, Request, evaluate
from sim2vr_harness.play.users import baseline_reward, doing_nothing_pays
from sim2vr_harness.policies.scripted import parse_step, read_steps, with_inputs
from webxr_pages import CDN, ENGINES, NEEDS_BROWSER, NEEDS_ENGINES, PAGES

KEYPAD = str(PAGES / "keypad.html")
TASK: dict[str, Any] = {
    "seconds": 6.0,
    "reward": {"expression": "app.right"},
    "values": {"wrong": "app.wrong", "air": "app.air", "taken": "app.taken"},
}


def script(folder: Path, text: str) -> str:
    file = folder / "script.yaml"
    file.write_text(text)
    return str(file)


def test_steps_in_words() -> None:
    touch = parse_step("touch red button", "--user")
    assert (touch.kind, touch.place, touch.by) == ("touch", "red button", "touch")
    assert parse_step("reach 0.1 -1 2e0", "--user").place == (0.1, -1.0, 2.0)
    assert parse_step("point key1", "--user").by == "ray"
    assert parse_step("press key1", "--user").by is None
    pressed = parse_step("press stand by me by ray", "--user")
    assert (pressed.place, pressed.by) == ("stand by me", "ray")
    grabbed = parse_step("grab way to go to 0.1 1 0.3", "--user")
    assert (grabbed.place, grabbed.to) == ("way to go", (0.1, 1.0, 0.3))


def test_a_script_repeats_its_steps(tmp_path: Path) -> None:
    text = "- touch a\n- {do: [press b, point c], repeats: 3, seconds: 2, hand: left}\n"
    steps = read_steps(script(tmp_path, text))
    assert [one.place for one in steps] == ["a", *["b", "c"] * 3]
    assert [one.seconds for one in steps] == [5.0, *[2.0] * 6]
    assert {one.hand for one in steps[1:]} == {"left"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- touch\n", r"script\.yaml: 1: got 'touch', expected touch NAME"),
        ("- touch a\n- {do: touch b, repeat: 2}\n", r"2\.repeat: got an unknown key"),
        ("- {do: press b, input: trigga}\n", r"1\.input: got 'trigga', expected one of trigger"),
        ("- {do: press b, input: x, hand: right}\n", r"1\.input: got 'x' of the right hand"),
    ],
)
def test_files_of_another_form(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_steps(script(tmp_path, text))


@pytest.mark.parametrize(
    ("task", "user", "inputs"),
    [
        ({}, "press a", ("right.trigger",)),
        ({}, "grab a to b", ("right.trigger", "right.squeeze")),
        ({"inputs": ["right.trigger", "right.a"]}, "grab a to b", ("right.trigger", "right.a")),
        ({"devices": ["controller_left"]}, "press a", ("left.trigger",)),
    ],
)
def test_a_script_adds_the_inputs_that_it_works(
    task: dict[str, Any], user: str, inputs: tuple[str, ...]
) -> None:
    app = AppConfig(transport="webxr", page=KEYPAD, task={"seconds": 1.0, **task})
    found = with_inputs(ResolvedEnv(EnvConfig(app=app)).with_task(), user)
    assert found.config.user.inputs == inputs


def play(user: str, episodes: int = 1, **app: Any) -> Evaluation:
    return evaluate(user, Request(app=app, episodes=episodes))


def played(user: str, **task: Any) -> Evaluation:
    return play(user, transport="webxr", page=KEYPAD, task={**TASK, **task})


@NEEDS_BROWSER
def test_lit_keys_are_pressed_by_ray(tmp_path: Path) -> None:
    """Of 16 cm at 1.5 m: half a key is 3 degrees."""
    found = played(script(tmp_path, "- {do: press lit, repeats: 3}\n"))
    (steps,) = (one.script for one in found.rounds)
    assert [step.by for step in steps] == ["ray"] * 3, "1.5 m are out of reach"
    assert all(step.done and step.angle_deg is not None and step.angle_deg < 1.0 for step in steps)
    assert [step.changed for step in steps] == [{"right": (k, k + 1.0)} for k in range(3)]
    summary = found.summaries["standard"]
    assert (summary["right"], summary["wrong"], summary["air"]) == (3.0, 0.0, 0.0)
    assert (summary["steps_done"], summary["steps_failed"]) == (3.0, 0.0)


@NEEDS_BROWSER
def test_a_block_is_taken_along_and_the_rest_does_not_react(tmp_path: Path) -> None:
    """From (0.25, 0.95, 0.4) to (0.1, 1.1, 0.35): 15, 15 and 5 cm make 21.8 cm."""
    text = "- {do: press block, input: trigger}\n- {do: grab block to 0.1 1.1 0.35}\n"
    found = played(script(tmp_path, text), inputs=["right.squeeze"])
    pressed, grabbed = found.rounds[0].script
    assert (pressed.by, pressed.inputs, dict(pressed.changed)) == (
        "touch", ("right.trigger",), {"air": (0.0, 1.0)},
    )  # fmt: skip
    assert grabbed.inputs == ("right.squeeze",)
    assert dict(grabbed.changed) == {"taken": (0.0, 1.0)}
    assert grabbed.object_moved_m == pytest.approx(0.218, abs=0.025)
    assert grabbed.moved_gap_m is not None
    assert grabbed.moved_gap_m < 0.02
    assert "right.squeeze pressed" in grabbed.words


@NEEDS_BROWSER
def test_what_cannot_be_done_is_said() -> None:
    found = played("touch key1", seconds=3.0)
    (step,) = found.rounds[0].script
    assert (step.done, step.problem) == (False, "the round ended before it was done")
    with pytest.raises(InputError, match=r"no object 'kye1', expected .*did you mean 'key1'"):
        played("touch kye1")


@NEEDS_BROWSER
def test_a_smoke_test_on_the_command_line(capsys: Any, tmp_path: Path) -> None:
    task = tmp_path / "task.yaml"
    task.write_text("seconds: 4\nreward: {expression: app.right}\n")
    words = ["evaluate", "--page", KEYPAD, "--task", str(task), "--episodes", "1", "--json"]
    for user, expected, status in (
        ("press lit by ray", "right >= 1", 0),
        ("press lit by touch", "steps_failed == 0", 1),
    ):
        with pytest.raises(SystemExit) as exit_:
            main([*words, "--user", user, "--expect", expected])
        out = capsys.readouterr().out
        assert int(exit_.value.code or 0) == status
        (step,) = json.loads(out)["standard"]["rounds"][0]["script"]
        assert (step["step"], step["done"]) == (user, status == 0)


def test_a_ball_that_jumps_counts_as_touched(tmp_path: Path) -> None:
    """The sample's ball goes elsewhere at a touch and counts a point."""
    user = script(tmp_path, "- {do: touch Ball, repeats: 3}\n- point Ball\n")
    app: dict[str, Any] = {"game": "sample", "renderer": "null", "options": {"round_seconds": 6.0}}
    found = play(user, **app)
    (steps,) = (one.script for one in found.rounds)
    assert [step.done for step in steps] == [True] * 4
    points = [step.changed["Points"] for step in steps[:3]]
    assert points == [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0)]
    with pytest.raises(InputError, match=r"no object 'Bal', expected .*did you mean 'Ball'"):
        play("touch Bal", **app)


@NEEDS_BROWSER
@NEEDS_ENGINES
def test_a_ray_is_the_pages_own() -> None:
    """Without its model of the controller, A-Frame's laser lies along the grip's axis.

    WebXR's target ray is 60 degrees below that.
    """
    found = play(
        "press target by ray",
        transport="webxr",
        page=str(PAGES / "laser.html"),
        map={CDN: str(ENGINES)},
        task={
            "seconds": 6.0,
            "reward": {"expression": "app.clicks"},
            "values": {"clicks": "app.clicks"},
        },
    )
    (step,) = found.rounds[0].script
    assert step.done
    assert step.ray_off_deg == pytest.approx(60.0, abs=1.0)
    assert "the page's own ray, 60 degrees from WebXR's" in step.words
    assert step.changed == {"clicks": (0.0, 1.0)}


def test_a_training_notes_that_doing_nothing_pays(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Before anything is trained."""

    def begin(*arguments: object, **more: object) -> None:
        raise RuntimeError("begun")

    monkeypatch.setattr("sim2vr_harness.training.run.trainer.train", begin)
    env = ["--set", "env.app.game=pointing", "--set", "env.app.options={}"]
    with pytest.raises(SystemExit):
        main(["train", "whacamole_constrained", *env, "--out", str(tmp_path / "run")])
    noted, begun = capsys.readouterr().err.splitlines()[-2:]
    assert begun == "error: begun"
    assert noted.startswith("note: doing nothing pays: an idle user earns -")
    # Pointing takes points for errors, which random movements make; the sample for distance.
    idle, rest, moved, effort = map(float, re.findall(r"-?\d+\.\d+", noted))
    env_of = {game: ResolvedEnv(EnvConfig(app={"game": game})) for game in ("pointing", "sample")}
    with closing(Simulation(env_of["pointing"], 8)) as simulation:
        assert baseline_reward(simulation, "still", 1) == pytest.approx((idle, rest), abs=0.01)
        assert baseline_reward(simulation, "random", 1) == pytest.approx((moved, effort), abs=0.01)
    assert idle > moved
    assert doing_nothing_pays(env_of["sample"]) is None
