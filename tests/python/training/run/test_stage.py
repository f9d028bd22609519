"""Every stage is stopped, saved and resumed in the same way, to the same bits."""

import os
import signal
from pathlib import Path

import pytest
import torch
from short_cycles import short_cycles
from tiny_distill import SETTINGS, train, weights

from sim2vr_harness.cli.main import main
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.run.stage import Callbacks

# When a stage is stopped, in calls of its callbacks, and what it has saved then.
CUTS = {
    "imagined": (70, "1 of 2 cycles"),
    "student": (50, "64 of 96 frames"),
    "ppo": (16, "20 of 40 user steps"),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, torch.Tensor]:
    folder = tmp_path_factory.mktemp("stages") / "run"
    train(folder)
    return weights(RunFolder.open(folder).latest_checkpoint())


def cut(folder: Path, stage: str, how: int | None, monkeypatch: pytest.MonkeyPatch):
    """Train until the callbacks of ``stage`` were called so often; by a signal or by ``stop``."""
    calls, check = 0, Callbacks.check

    def counting(self: Callbacks) -> None:
        nonlocal calls
        calls += self._stage.name == stage
        if how is not None and calls == CUTS[stage][0]:
            calls += 1
            os.kill(os.getpid(), how)
        check(self)

    def stop() -> bool:
        return how is None and calls >= CUTS[stage][0]

    with monkeypatch.context() as patch:
        patch.setattr(Callbacks, "check", counting)
        return train(folder, stop=stop)


@pytest.mark.parametrize(
    ("stage", "how"),
    [
        ("imagined", signal.SIGTERM),
        ("student", None),
        ("ppo", signal.SIGINT),
    ],
)
def test_a_stopped_stage_goes_on_to_the_same_bits(
    whole: dict[str, torch.Tensor],
    stage: str,
    how: int | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder, before = tmp_path / "run", signal.getsignal(signal.SIGTERM)
    result, _ = cut(folder, stage, how, monkeypatch)
    assert (result.interrupted, result.stage) == (True, stage)
    assert result.saved == CUTS[stage][1]
    assert (result.checkpoint is None) == (stage != "ppo")
    assert signal.getsignal(signal.SIGTERM) == before
    result, _ = train(folder, resume=True)
    assert (result.interrupted, result.step) == (False, 40)
    other = weights(result.checkpoint)
    assert [key for key in whole if not torch.equal(whole[key], other[key])] == []
    sessions = RunFolder(folder).metadata()["sessions"]
    first = "stopped" if how is None else "interrupted"
    assert [session["status"] for session in sessions] == [first, "finished"]
    assert len((folder / "imagined" / "cycles.jsonl").read_text().splitlines()) == 2
    assert train(folder, resume=True)[1].startswith("Nothing to train")


def test_the_command_says_what_is_saved_and_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    calls, check = 0, Callbacks.check

    def counting(self: Callbacks) -> None:
        nonlocal calls
        calls += 1
        if calls == CUTS["imagined"][0]:
            os.kill(os.getpid(), signal.SIGINT)
        check(self)

    run, settings = tmp_path / "run", [part for s in SETTINGS for part in ("--set", s)]
    with monkeypatch.context() as patch, short_cycles():
        patch.setattr(Callbacks, "check", counting)
        with pytest.raises(SystemExit) as ended:
            main(["train", "whacamole_constrained", *settings, "--out", str(run)])
    assert ended.value.code == 130
    assert capsys.readouterr().out.splitlines() == [
        "Stopped in stage 'imagined'; saved: 1 of 2 cycles.",
        f"Go on with: sim2vr-harness train --resume {run}",
    ]
