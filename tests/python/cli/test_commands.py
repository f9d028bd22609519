"""The command line: outputs, exit statuses and one-line errors."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from fake_simulation import FakeSimulation, played_by

from python.cli.calls import call
from sim2vr_harness.cli.main import main

DATA = Path(__file__).parents[2] / "data"
TINY = [
    "policy.net_arch=[16]",
    "policy.vision_features=8",
    "policy.proprioception_features=8",
    "ppo.n_envs=3",
    "ppo.n_steps=20",
    "ppo.batch_size=15",
    "ppo.n_epochs=1",
    "evaluation.conditions=[easy, hard]",
    "evaluation.episodes_after_training=1",
]


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every command plays on the quick stand-in."""
    played_by(monkeypatch, FakeSimulation)
    monkeypatch.setattr("sim2vr_harness.play.users.doing_nothing_pays", lambda env: None)
    monkeypatch.setattr("sim2vr_harness.evaluation.evaluate.doing_nothing_pays", lambda env: None)


def train(capsys: Any, folder: Path, *more: str) -> tuple[int, str, str]:
    settings = [part for setting in TINY for part in ("--set", setting)]
    return call(capsys, "train", "whacamole_constrained", *settings, "--out", str(folder), *more)


def test_help_needs_neither_torch_nor_mujoco() -> None:
    import subprocess

    code = (
        "import sys; from sim2vr_harness.cli import main; "
        "sys.exit(any(name in sys.modules for name in ('torch', 'mujoco', 'stable_baselines3')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_train_ends_with_the_table_and_where_to_look_next(capsys: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    status, out, err = train(capsys, run, "--timesteps", "100")
    assert status == 0, err
    assert err.startswith("Preparing whacamole_constrained (recipe ppo) ...\n")
    assert "from step 0 to 120" in err
    for part in (
        "After 120 user steps", "easy", "hard", "Hit rate",
        f"Saved user: {run}/checkpoints/step_000000120.zip",
        f"sim2vr-harness evaluate {run} --record",
        f"tensorboard --logdir {run}/tensorboard",
        f"sim2vr-harness train --resume {run}",
    ):  # fmt: skip
        assert part in out
    status, out, err = call(capsys, "train", "--resume", "--out", str(run), "--timesteps", "180")
    assert status == 0, err
    assert "from step 120 to 180" in err
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [60, 120, 180]


def test_ctrl_c_saves_and_says_so(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def impatient(config: Any, n: int, **how: Any) -> FakeSimulation:
        simulation = FakeSimulation(config, n, **how)
        simulation.fail_at = 25
        return simulation

    played_by(monkeypatch, impatient)
    status, out, _ = train(capsys, tmp_path / "run", "--timesteps", "180")
    assert status == 130
    lost = "(12 steps of an unfinished iteration will be repeated)"
    assert f"Stopped in stage 'ppo'; saved: 60 of 180 user steps {lost}." in out
    assert "--resume" in out
    assert (tmp_path / "run" / "checkpoints" / "step_000000060.zip").is_file()


def test_evaluate_prints_one_json_object(capsys: Any, trained: Path) -> None:
    arguments = ("evaluate", str(trained), "--condition", "easy", "--condition", "hard")
    status, out, err = call(capsys, *arguments, "--episodes", "2", "--json")
    assert status == 0, err
    content = json.loads(out)
    assert list(content) == ["easy", "hard"]
    for key in ("hits", "misses", "contacts", "hit_rate", "hit_speed_mps", "hammer_depth_m",
                "max_fatigued", "effort", "return", "game_return", "episodes"):  # fmt: skip
        assert key in content["easy"]
    assert err == "Playing ...\nnote: not trained for: conditions easy, hard (trained: medium)\n"
    status, out, _ = call(capsys, *arguments, "--deterministic")
    assert status == 0
    assert "deterministic" in out
    assert "Evaluated: " in out


def test_an_app_of_ones_own(capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    given = ("--app", "build/Game.x86_64", "--app-arg", "-condition", "--app-arg", "easy")
    assert train(capsys, tmp_path / "run", "--timesteps", "60", *given)[0] == 0
    app = yaml.safe_load((tmp_path / "run/config.yaml").read_text())["env"]["app"]
    assert app["transport"] == "protocol1"
    assert app["executable"] == str(tmp_path / "build/Game.x86_64")
    assert app["arguments"] == ["-condition", "easy"]
    # Continued with an app that runs already, over the other protocol.
    more = ("--resume", "--out", str(tmp_path / "run"), "--timesteps", "120")
    given = ("--connect", "localhost:5555", "--protocol", "2")
    status, _, err = call(capsys, "train", *more, *given)
    assert status == 0, err
    app = yaml.safe_load((tmp_path / "run/config.yaml").read_text())["env"]["app"]
    assert (app["transport"], app["connect"]) == ("protocol2", "localhost:5555")
    assert (app["executable"], app["arguments"]) == (None, [])


BAD_INPUT = """
    train | CONFIG: got nothing, expected a configuration file, or --resume
    train nope.yaml | CONFIG: got 'nope.yaml', expected a configuration
    train {config} --set ppo.n_step=1 | ppo.n_step: got an unknown key
    train {config} --set ppo.n_steps=x | ppo.n_steps: got 'x', expected
    train {config} --timesteps 0 | --timesteps: got 0, expected
    train {config} --timesteps x | --timesteps: got 'x', expected a who
    train whacamol_constrained | CONFIG: got 'whacamol_constrained', expected
    evaluate {run} --episodes=abc | --episodes: got 'abc', expected a whole
    doctor --jsn | --jsn: got an unknown option, expected one of the command's (d
    doctor --app-arg -x | --app-arg: got it without --app, expected it tog
    render snapshot --seconds x | --seconds: got 'x', expected a number
    render snapshot --out {file} | --out: got '{file}', which is a file, exp
    evaluate {run} --out {file}/x/y | --out: got '{file}/x/y', but {file} is a file, expected a
    train {config} --resume --overwrite | --overwrite: got it together
    train {run} | CONFIG: got '{run}', the folder of a run, expected a con
    train --resume | CONFIG: got nothing, expected a configuration file, or
    evaluate {empty}/none | RUN: got '{empty}/none', which does not exist
    evaluate {run} --condition x | --condition: got 'x', expected a cond
    render snapshot --game sampel | game: got 'sampel', expected one o
    evaluate {run} --episodes 0 | --episodes: got 0, expected
    render snapshot --size 3 | --size: got '3', expected WIDTHxHEIGHT
    train {config} --protocol 3 | --protocol: got 3, expected 1 or 2
    train {config} --app a --connect b:1 | --connect: got it toget
    users motor train arm --begin nope.pt --out {empty}/x | --begin: got 'nope.pt', which is no fil
    evaluat | command: got 'evaluat', expected one of audit,
    evaluate --user still --xvfb | --xvfb: got it without --openxr, expected it together with
    evaluate --user still --openxr x --page y | --openxr: got it together with --page
    evaluate --user still --openxr "x 'y" | --openxr: got "x 'y" (No closing quotation)
    train --page {page} | --task: got nothing, expected what the app is worth
    evaluate --user random --map x=y | --map: got it without --page
    evaluate --page {page} --user still --map x | --map: got 'x', expected URL=FOLDER
    evaluate {run} --user still | --user: got it together with '{run}'
    replay {empty}/no | PATH: got
    replay {round} --video film.avi | --video: got film.avi, expected a file name
    replay {round} --video f.mp4 --size 9 | --size: got '9', expected WIDTHxH
    replay {round} --fixed-step 7 | --fixed-step: got 7, expected a period
"""
"""Words of a command, and how its error begins."""


@pytest.mark.parametrize("case", BAD_INPUT.strip().splitlines())
def test_bad_input_is_one_line_and_status_2(
    capsys: Any, tmp_path: Path, trained: Path, case: str
) -> None:
    values = {"config": "whacamole_constrained", "empty": tmp_path, "run": trained}
    values |= {"page": DATA / "webxr" / "touch.html", "round": DATA / "whacamole_round"}
    words, message = (part.strip().format(**values, file=__file__) for part in case.split(" | "))
    status, out, err = call(capsys, *shlex.split(words))
    assert (status, out, err.count("\n")) == (2, "", 1), err
    assert err.startswith(f"error: {message}")
    assert list(tmp_path.iterdir()) == []


def test_failures_are_status_1_and_tracebacks_are_for_debugging(
    capsys: Any, trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: Any, **settings: Any) -> None:
        raise RuntimeError("no renderer\nworks")

    played_by(monkeypatch, broken)
    assert call(capsys, "evaluate", str(trained)) == (1, "", "error: no renderer works\n")
    with pytest.raises(RuntimeError, match="no renderer"):
        main(["--debug", "evaluate", str(trained)])
