from __future__ import annotations

import io
import time

import pytest
from rich.console import Console

from sim2vr_harness.client import describe_game
from sim2vr_harness.training.run.progress import (
    Phase,
    StageDisplay,
    TrainingProgress,
    View,
    duration,
)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(None, "-"), (12.4, "12 s"), (185, "3 min 05 s"), (7800, "2 h 10 min"), (273600, "3 d 4 h")],
)
def test_durations(seconds: float | None, text: str) -> None:
    assert duration(seconds) == text


def progress() -> TrainingProgress:
    return TrainingProgress(
        step=0, start_step=0, stop_step=400, iteration_steps=100, minibatches=10
    )


def test_rates_and_time_left() -> None:
    p = progress()
    assert p.seconds_left() is None
    p.minibatch_seconds = 0.5
    p.begin(Phase.PLAYING, 100)
    p.phase_started = time.monotonic() - 2.0
    p.phase_done = 50
    assert p.play_rate == pytest.approx(25, rel=0.01)  # 50 steps in 2 s
    assert p.learn_rate == pytest.approx(20)  # 10 minibatches of 0.5 s
    assert p.rate == pytest.approx(100 / 9, rel=0.01)
    assert p.seconds_left() == pytest.approx(4 * 9 - 2, rel=0.01)
    p.play_seconds, p.played = 4.0, 100
    p.begin(Phase.LEARNING, 10)
    p.phase_started = time.monotonic() - 3.0
    p.phase_done = 5
    assert p.seconds_left() == pytest.approx(4 * (4 + 6) - 4 - 3, rel=0.01)
    p.learn_seconds, p.learned = 6.0, 100
    p.begin(Phase.PLAYING, 100)
    assert p.seconds_left() == pytest.approx(30, rel=0.01)


def test_a_stage_that_plays_and_learns_in_plain_lines() -> None:
    output = io.StringIO()
    p = progress()
    with StageDisplay("ppo", 400, Console(file=output), interval=1000.0) as display:
        display.update(p.view)  # too soon
        p.game = describe_game("whacamole")
        p.means = {"ep_rew_mean": 3.25, "ep_Points_mean": 7.0, "ep_hit_rate": 0.5}
        p.step = 100
        display.update(p.view, force=True)
    (line,) = output.getvalue().splitlines()
    assert line.startswith("ppo 25% | step 100/400, starting 0% | left - | - steps/s")
    assert "per round: return 3.2, hits 7.0, misses -, hit rate 0.500" in line


def test_a_stage_that_plays_and_learns_in_a_terminal() -> None:
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100)
    p = progress()
    p.begin(Phase.LEARNING, 10)
    p.phase_done = 4
    p.means = {"ep_rew_mean": 3.0, "ep_effort_cost_mean": 120.0}
    p.note = "Saved x.zip"
    with StageDisplay("ppo", 400, console) as display:
        display.update(p.view)
    text = output.getvalue()
    for part in ("learning 40%", "effort 120.0", "Saved x.zip", "steps/s"):
        assert part in text


def view() -> View:
    return View(5, "cycle 6 of 20: playing", 61.0)


def test_stage_in_plain_lines() -> None:
    output = io.StringIO()
    with StageDisplay("imagined", 20, Console(file=output), interval=1000.0) as display:
        display.update(view)  # too soon
        display.say("Cycle done.")
    with StageDisplay("imagined", 20, Console(file=output), interval=0.0) as display:
        display.update(view)
    assert output.getvalue().splitlines() == [
        "Cycle done.",
        "imagined 25% | cycle 6 of 20: playing | left 1 min 01 s",
    ]


def test_stage_in_a_terminal() -> None:
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100)
    with StageDisplay("imagined", 20, console) as display:
        display.update(lambda: View(5, "cycle 6 of 20: playing"))
        display.say("Cycle done.")
    text = output.getvalue()
    for part in ("imagined", "25%", "cycle 6 of 20: playing", "Cycle done.", "left -"):
        assert part in text
