"""Progress of work in a terminal and in plain lines."""

import io
import time

import pytest
from rich.console import Console

from sim2vr_harness.base import progress
from sim2vr_harness.base.progress import ProgressDisplay, View, duration
from sim2vr_harness.training.run.stage import Stopwatch


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(None, "-"), (12.4, "12 s"), (185, "3 min 05 s"), (7800, "2 h 10 min"), (273600, "3 d 4 h")],
)
def test_durations(seconds: float | None, text: str) -> None:
    assert duration(seconds) == text


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


def test_a_bar_in_a_terminal() -> None:
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100)
    with ProgressDisplay("imagined", 20, console) as display:
        display.update(view)
        display.say("Cycle done.")
    for part in (
        "imagined",
        "25%",
        "cycle 6 of 20: playing",
        "Cycle done.",
        "left -",
        "12 steps/s",
    ):
        assert part in output.getvalue()


def test_times_of_parts_that_alternate_are_added_up() -> None:
    watch = Stopwatch()
    for _ in range(2):
        watch.begin("sleeping")
        watch.begin("sleeping")
        time.sleep(0.05)
        watch.begin("computing")
        began = time.process_time()
        while time.process_time() - began < 0.05:
            pass
    watch.stop()
    assert list(watch.parts) == ["preparing", "sleeping", "computing"]
    sleeping, computing = watch.parts["sleeping"], watch.parts["computing"]
    assert sleeping.seconds >= 0.1
    assert sleeping.cpu_seconds < 0.05
    assert computing.cpu_seconds == pytest.approx(0.1, abs=0.04)
