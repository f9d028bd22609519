"""The commands of the workflow for continuous integration run on the sample game."""

import json
import re
import shlex
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from python.cli.calls import call

WORKFLOW = Path(__file__).resolve().parents[3] / "docs/examples/ci_workflow.yml"
CHECKS = 2 + 2 + 1
"""Two bounds of both conditions, one of one."""


def command() -> list[str]:
    """The words of the workflow's only call of the harness."""
    steps = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))["jobs"]["play"]["steps"]
    scripts = [step["run"].replace("\\\n", " ") for step in steps if "run" in step]
    calls = re.findall(r"^sim2vr-harness (.*)$", "\n".join(scripts), flags=re.M)
    assert len(calls) == 1
    return shlex.split(calls[0])


def test_the_workflow_passes_and_fails_when_the_user_gets_worse(
    capsys: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = command()
    at = whole.index("--against")
    status, _, err = call(capsys, *whole[:at], *whole[at + 2 :])
    assert (status, err.splitlines()[-1]) == (0, f"0 of {CHECKS} checks failed")

    results = json.loads(Path("played/results.json").read_text())
    Path("ci").mkdir()
    Path("ci/baseline.json").write_text(json.dumps(results))
    status, _, err = call(capsys, *whole)
    assert status == 0 and "failed:" not in err
    suite = ElementTree.parse("played/checks.xml").getroot()[0]
    compared = [case.get("name") for case in suite if "baseline" in str(case.get("name"))]
    assert "points against the baseline" in compared
    assert int(str(suite.get("tests"))) == CHECKS + len(compared)

    # A baseline of users who came nearer to the ball, by more than rounds differ.
    results["usual"]["distance_m"] -= 0.2
    Path("ci/baseline.json").write_text(json.dumps(results))
    status, _, err = call(capsys, *whole)
    failed = [line for line in err.splitlines() if line.startswith("failed:")]
    assert status == 1 and len(failed) == 1
    assert failed[0].startswith("failed: usual: distance_m is 0.")
    assert "worse than the baseline" in failed[0] and "by 0.2 with" in failed[0]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--expect", "distanc_m < 1"], "error: --expect: got 'distanc_m', expected a measure "
         "(did you mean 'distance_m'?)"),
        (["--expect", "points 1"], "error: --expect: got 'points 1', expected [CONDITION_OR_CELL:]"
         "MEASURE OP NUMBER with OP one of >= <= > < =="),
    ],
)  # fmt: skip
def test_nothing_is_played_for_a_check_that_cannot_be_made(
    capsys: Any, tmp_path: Path, more: list[str], message: str
) -> None:
    first = ["evaluate", "--user", "random", "--set", "env.app.game=sample", "--out"]
    assert call(capsys, *first, str(tmp_path / "out"), *more) == (2, "", f"{message}\n")
    assert not (tmp_path / "out").exists()
