"""Progress of work in a terminal and in plain lines."""

import io
import time

import pytest
from rich.console import Console

from sim2vr_harness.base import progress
from sim2vr_harness.base.progress import ProgressDisplay, View


def view() -> View:
    return View(5, "cycle 6 of 20: playing", ("12 steps/s",))


def test_plain_lines_come_when_they_are_due_or_forced() -> None:
    output = io.StringIO()
    with ProgressDisplay("imagined", 20, Console(file=output), interval_s=1000.0) as display:
        display.update(view)  # too soon
        display.say("Cycle done.")
        display.update(view, force=True)
    with ProgressDisplay("imagined", 20, Console(file=output), interval_s=0.0) as display:
        display.update(view)
    line = "imagined 25% | cycle 6 of 20: playing | left - | 12 steps/s"
    assert output.getvalue().splitlines() == ["Cycle done.", line, line]


def test_what_is_left_follows_from_the_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two units a second: the 80 that are left of 100 take 40 s."""
    now = time.monotonic()
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    display = ProgressDisplay("ppo", 100, Console(file=io.StringIO()))
    display._bar.get_time = lambda: now  # type: ignore[method-assign]
    for done in range(0, 21, 2):
        display.update(lambda done=done: View(done))
        now += 1.0
    assert "left 40 s" in display.line()
