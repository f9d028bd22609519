"""Progress lines outside a terminal: one at once, then one every 15 s."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim2vr_harness.cli import progress
from sim2vr_harness.cli.progress import Share
from sim2vr_harness.cli.studies import Shown
from sim2vr_harness.studies.runner import StudyProgress


def test_a_line_at_once_and_then_one_every_interval(
    capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock.now)
    with Share("Playing") as share:
        assert capsys.readouterr().err == ""
        for second in range(41):
            clock.now = 100.0 + second
            share.show(second / 40)
    # 15 s: 15/40 done, 25 s left at the same pace; 30 s: 10 s left.
    lines = ["Playing ...", "Playing: 38%, left 25 s", "Playing: 75%, left 10 s"]
    assert capsys.readouterr().err.splitlines() == lines


def test_a_study_says_how_much_there_is(capsys: Any) -> None:
    with Shown() as shown:
        shown.show(StudyProgress(0, 12, "", None))
    assert capsys.readouterr().err == "[0/12] begins (0 s)\n"
