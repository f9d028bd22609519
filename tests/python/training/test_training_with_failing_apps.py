"""Training and evaluation in apps outside this process, some of which fail on the way."""

import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.runs.checkpoint import require_readable
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.training.run import trainer

FAKE_APP = Path(__file__).parents[1] / "client/fake_app.py"
SETTINGS = [
    "ppo.n_envs=2",
    "ppo.n_steps=30",
    "ppo.batch_size=30",
    "ppo.n_epochs=1",
    "policy.net_arch=[16]",
    "env.app.options.condition=medium",
    "env.app.renderer='null'",
    "evaluation.episodes=2",
    "evaluation.conditions=[low-medium, medium]",
    "device=cpu",
]


def config(*settings: str) -> TrainingConfig:
    return load_config("whacamole_constrained", [*SETTINGS, *settings])


def train(config: TrainingConfig, folder: Path, stop: int, **how: Any) -> tuple[Any, str]:
    out = io.StringIO()
    console = Console(file=out, width=10_000)
    result = trainer.train(config, folder, timesteps=stop, console=console, **how)
    return result, out.getvalue()


@pytest.fixture
def unity_settings(tmp_path: Path) -> list[str]:
    """Settings for the stand-in of a Unity build."""
    file = tmp_path / "build.x86_64"
    file.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{FAKE_APP}" "$@"\n')
    file.chmod(0o755)
    return ["env.app.transport=protocol1", f"env.app.executable={file}"]


def with_arguments(*arguments: str) -> str:
    return f"env.app.arguments={json.dumps(arguments)}"


def test_training_goes_on_and_says_so(tmp_path: Path, unity_settings: list[str]) -> None:
    once = str(tmp_path / "once")
    arguments = with_arguments("-round", "0.4", "-fault", "kill@12", "-once", once)
    result, said = train(config(*unity_settings, arguments), tmp_path / "run", 120)
    assert result.step == 120
    assert "User " in said
    assert "was killed (SIGKILL) during a step" in said
    assert "the app is started again and the training goes on" in said
    assert "app failures 1" in said
    # An app of the reference cannot be saved: said once.
    assert said.count("starts new rounds, since this app cannot save its state") == 1
    session = result.folder.metadata()["sessions"][-1]
    (failure,) = session["app_failures"]
    assert failure["user"] in (0, 1)
    assert "fault: kill" in failure["error"]  # the end of the app's log
    row = result.folder.metrics()[0]
    assert row["rollout/app_failures"] == 1.0
    # A round is 9 steps; the one cut short is in no mean.
    assert row["rollout/ep_len_mean"] == 9.0
    again, said = train(config(*unity_settings, arguments), tmp_path / "run", 180, resume=True)
    assert again.step == 180
    assert "app failures" not in said


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("nan", "reward: got nan, expected a finite number"),
        ("size", "image: got 90 x 60 pixels, expected 120 x 80"),
    ],
)
def test_an_app_that_sends_what_cannot_be_used_spoils_nothing(
    tmp_path: Path, unity_settings: list[str], fault: str, message: str
) -> None:
    # Every app does so in its second round: the handshake, a reset and 9 steps are before it.
    arguments = with_arguments("-round", "0.4", "-fault", f"{fault}@12")
    result, _ = train(config(*unity_settings, arguments), tmp_path / "run", 120)
    assert (result.step, result.interrupted) == (120, False)
    failures = result.folder.metadata()["sessions"][-1]["app_failures"]
    assert len(failures) >= 4, "60 steps of two users are more than 3 rounds each"
    assert all(message in failure["error"] for failure in failures)
    for file in result.folder.checkpoints():
        require_readable(file)  # which weights that are not finite are not
    rows = result.folder.metrics()
    assert all(row["train/loss"] is not None for row in rows)
    # Rounds that were cut short are in no mean: the others have 9 steps.
    assert {row["rollout/ep_len_mean"] for row in rows} == {9.0}


def test_an_app_that_always_fails_ends_the_training_with_a_checkpoint(
    tmp_path: Path, unity_settings: list[str]
) -> None:
    arguments = with_arguments("-fault", "die@1")
    with pytest.raises(RuntimeError, match=r"3 apps in a row failed at the start of a round"):
        train(config(*unity_settings, arguments), tmp_path / "run", 120)


def test_training_outside_is_the_same_as_in_process(tmp_path: Path) -> None:
    inside, _ = train(config(), tmp_path / "inside", 120)
    outside, said = train(config("env.app.transport=protocol2"), tmp_path / "outside", 60)
    assert "continues exactly" in said
    # Where the app runs may change between sessions.
    outside, _ = train(config(), tmp_path / "outside", 120, resume=True)
    for one, other in zip(inside.folder.metrics(), outside.folder.metrics(), strict=True):
        assert {k: v for k, v in one.items() if not k.startswith("time")} == {
            k: v for k, v in other.items() if not k.startswith("time")
        }


def test_evaluation_in_a_unity_build(tmp_path: Path, unity_settings: list[str]) -> None:
    record, once = tmp_path / "messages", tmp_path / "once"
    common = ("-round", "0.4", "-record", str(record))
    settings = [*unity_settings, with_arguments(*common)]
    result, _ = train(config(*settings), tmp_path / "run", 60)
    record.unlink()
    found = evaluate(result.checkpoint, Request(batch=1))
    # One process per condition: it takes the condition at its start.
    starts = [json.loads(line) for line in record.read_text().splitlines()]
    assert sum("timestep" in message for message in starts) == 2
    assert [entry["ended"] for entry in found.summaries["medium"]["rounds"]] == ["finished"] * 2
    assert found.summaries["medium"]["hits"] == 9.0
    # A round whose app dies is counted apart.
    arguments = [*common, "-fault", "die@4", "-once", str(once)]
    found = evaluate(result.checkpoint, Request(batch=2, app={"arguments": arguments}))
    ends = [entry["ended"] for summary in found.summaries.values() for entry in summary["rounds"]]
    assert sorted(ends) == ["app_failed", "finished", "finished", "finished"]
    failed = found.summaries["low-medium"]
    assert (failed["app_failed"], failed["hits"], failed["diverged"]) == (1, 9.0, 0)


TRAINING = """
import signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
from sim2vr_harness.training.run import trainer
from sim2vr_harness.runs.checkpoint import require_readable
from sim2vr_harness.runs.config import load_config
trainer.train(load_config("whacamole_constrained", sys.argv[2:]), Path(sys.argv[1]))
"""


def children_of(pid: int) -> list[int]:
    return [int(text) for text in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()] + [
        int(text)
        for task in Path(f"/proc/{pid}/task").iterdir()
        if task.name != str(pid)
        for text in (task / "children").read_text().split()
    ]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("protocol", "number"),
    [
        ("protocol2", signal.SIGINT),
        ("protocol2", signal.SIGKILL),
    ],
)
def test_no_app_outlives_a_training(tmp_path: Path, protocol: str, number: signal.Signals) -> None:
    settings = [*SETTINGS, f"env.app.transport={protocol}", "env.app.processes=2"]
    training = subprocess.Popen(
        [sys.executable, "-c", TRAINING, tmp_path / "run", *settings],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert training.stderr is not None
    while "playing" not in training.stderr.readline():
        assert training.poll() is None
    apps = children_of(training.pid)
    assert len(apps) == 2
    training.send_signal(number)
    _, said = training.communicate(timeout=240)
    assert training.returncode == (-number if number == signal.SIGKILL else 0), said
    deadline = time.monotonic() + 10.0
    while any(map(alive, apps)) and time.monotonic() < deadline:
        time.sleep(0.02)
    left = [pid for pid in apps if alive(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert left == []
    if number != signal.SIGKILL:
        assert list((tmp_path / "run/checkpoints").glob("step_*.zip"))
