"""Progress lines outside a terminal: one at once, then one every 15 s."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim2vr_harness.base import progress
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
    # After 15 s 15/40 are done, after 30 s twice that; the bar measures its speed by its own clock.
    first, *lines = capsys.readouterr().err.splitlines()
    assert first == "Playing ..."
    assert [line.split(" | left ")[0] for line in lines] == ["Playing 38%", "Playing 75%"]


def test_a_study_says_how_much_there_is(capsys: Any) -> None:
    with Shown() as shown:
        shown.show(StudyProgress(0, 12, "", None))
    assert capsys.readouterr().err == "[0/12] begins (0 s)\n"
