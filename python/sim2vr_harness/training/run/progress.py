"""Progress display of a training: a live panel, or plain lines outside a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from sim2vr_harness.client import GameFacts
from sim2vr_harness.runs.run_folder import metric_key

PLAIN_INTERVAL_S = 15.0


@dataclass(frozen=True)
class View:
    """What is shown of a stage at one moment.

    Attributes:
        done: how far it is, of the stage's total.
        doing: what it does now.
        seconds_left: to the end of the stage; None if that is not known yet.
        details: further numbers, a line each in the panel.
    """

    done: float
    doing: str
    seconds_left: float | None = None
    details: tuple[str, ...] = ()


class Phase:
    """What the learner is doing."""

    STARTING = "starting"
    PLAYING = "playing"
    LEARNING = "learning"


@dataclass
class TrainingProgress:
    """The numbers of a stage that plays and learns by turns.

    Attributes:
        step: User steps taken so far, earlier sessions included.
        start_step: User steps taken before this session.
        stop_step: Where this session stops.
        iteration_steps: User steps per iteration.
        minibatches: Minibatches per iteration.
        minibatch_seconds: A first estimate of the time for one of them.
        phase: One of :class:`Phase`.
        phase_done: User steps played or minibatches learned in this phase.
        phase_total: What ``phase_done`` counts up to.
        play_seconds: Time spent playing in this session, finished phases only.
        played: User steps of these phases.
        learn_seconds: Time spent learning in this session, finished phases only.
        learned: Samples (user steps) of these phases.
        episodes: Rounds finished in this session.
        app_failures: Apps that failed and were started again in this session.
        means: Means over the last rounds, keyed as in metrics.jsonl without ``rollout/``.
        game: What the game publishes.
        counts_now: The game's counters in the rounds that are being played, by label.
        note: What happened last, for example a checkpoint.
    """

    step: int
    start_step: int
    stop_step: int
    iteration_steps: int
    minibatches: int
    minibatch_seconds: float | None = None
    phase: str = Phase.STARTING
    phase_done: int = 0
    phase_total: int = 0
    play_seconds: float = 0.0
    played: int = 0
    learn_seconds: float = 0.0
    learned: int = 0
    episodes: int = 0
    app_failures: int = 0
    means: dict[str, float] = field(default_factory=dict)
    game: GameFacts = field(default_factory=lambda: GameFacts(""))
    counts_now: dict[str, float] = field(default_factory=dict)
    note: str = ""
    started: float = field(default_factory=time.monotonic)
    phase_started: float = field(default_factory=time.monotonic)

    def begin(self, phase: str, total: int) -> None:
        """Enter a phase."""
        self.phase, self.phase_done, self.phase_total = phase, 0, total
        self.phase_started = time.monotonic()

    def end_playing(self, steps: int) -> None:
        """Count a finished rollout of ``steps`` user steps."""
        self.play_seconds += time.monotonic() - self.phase_started
        self.played += steps

    def end_learning(self, steps: int) -> None:
        """Count a finished update on ``steps`` user steps."""
        self.learn_seconds += time.monotonic() - self.phase_started
        self.learned += steps

    @property
    def play_seconds_each(self) -> float | None:
        """Seconds of playing per iteration; None before the first step."""
        if self.played:
            return self.play_seconds * self.iteration_steps / self.played
        if self.phase == Phase.PLAYING and self.phase_done:
            elapsed = time.monotonic() - self.phase_started
            return elapsed * self.iteration_steps / self.phase_done
        return None

    @property
    def learn_seconds_each(self) -> float | None:
        """Seconds of learning per iteration, at first as measured on one minibatch."""
        if self.learned:
            return self.learn_seconds * self.iteration_steps / self.learned
        if self.phase == Phase.LEARNING and self.phase_done:
            return (time.monotonic() - self.phase_started) * self.minibatches / self.phase_done
        if self.minibatch_seconds is None:
            return None
        return self.minibatch_seconds * self.minibatches

    @property
    def play_rate(self) -> float | None:
        """User steps per second while playing."""
        return _rate(self.iteration_steps, self.play_seconds_each)

    @property
    def learn_rate(self) -> float | None:
        """User steps per second while learning."""
        return _rate(self.iteration_steps, self.learn_seconds_each)

    @property
    def rate(self) -> float | None:
        """User steps per second of whole iterations."""
        play, learn = self.play_seconds_each, self.learn_seconds_each
        return None if play is None or learn is None else _rate(self.iteration_steps, play + learn)

    def seconds_left(self) -> float | None:
        """Return the expected time to the end of the session, None if it is not known yet."""
        play, learn = self.play_seconds_each, self.learn_seconds_each
        if play is None or learn is None:
            return None
        iterations = (self.stop_step - self.start_step - self.learned) / self.iteration_steps
        spent = time.monotonic() - self.phase_started
        if self.phase == Phase.LEARNING:
            spent += play
        return max(0.0, iterations * (play + learn) - (spent if iterations else 0.0))

    def view(self) -> View:
        """Return what is shown now."""
        share = self.phase_done / self.phase_total if self.phase_total else 0.0
        speed = (
            f"{_number(self.rate)} steps/s (playing {_number(self.play_rate)}, learning "
            f"{_number(self.learn_rate)})"
        )
        numbers = self.game_numbers()
        details = [speed]
        if numbers:
            details.append("per round: " + ", ".join(f"{name} {value}" for name, value in numbers))
        elif self.counts_now:
            counts = [f"{name.lower()} {_number(count)}" for name, count in self.counts_now.items()]
            details.append("first rounds: " + ", ".join(counts) + " so far")
        if self.app_failures:
            details.append(f"app failures {self.app_failures:,}")
        if self.note:
            details.append(self.note)
        doing = f"step {self.step:,}/{self.stop_step:,}, {self.phase} {share:.0%}"
        return View(self.step, doing, self.seconds_left(), tuple(details))

    def game_numbers(self) -> list[tuple[str, str]]:
        """Return labels and values of the last rounds' means; none before a round has ended."""
        means = self.means
        if not means:
            return []
        return [
            ("return", _number(means.get("ep_rew_mean"), 1)),
            *(
                (measure.heading.lower(), _number(means.get(metric_key(measure)), measure.digits))
                for measure in self.game.headlines
            ),
            ("effort", _number(means.get("ep_effort_cost_mean"), 1)),
        ]


def _rate(count: int, seconds: float | None) -> float | None:
    return count / seconds if seconds else None


def duration(seconds: float | None) -> str:
    """Write a time span for people: ``12 s``, ``3 min 05 s``, ``2 h 10 min``, ``3 d 4 h``."""
    if seconds is None:
        return "-"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    if whole < 86400:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
    return f"{whole // 86400} d {whole % 86400 // 3600} h"


def _number(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:,.{digits}f}"


class StageDisplay:
    """A live panel in a terminal, plain lines elsewhere. Use it in a ``with`` block.

    Args:
        name: Of the stage.
        total: What :attr:`View.done` counts up to.
        console: Where to show it. Outside a terminal a line is printed at most every ``interval``
            seconds, whenever :meth:`update` is called.
        interval: Seconds between plain lines.
    """

    def __init__(
        self, name: str, total: float, console: Console, interval: float = PLAIN_INTERVAL_S
    ) -> None:
        self._name, self._total = name, total
        self._console, self._interval = console, interval
        self._view: Callable[[], View] = lambda: View(0.0, Phase.STARTING)
        self._began = time.monotonic()
        self._last_line = self._began
        self._live: Live | None = None
        if console.is_terminal:  # it asks for the panel at once
            self._live = Live(
                console=console, get_renderable=self._panel, refresh_per_second=4, transient=True
            )

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, view: Callable[[], View], *, force: bool = False) -> None:
        """Show this view from now on; it is asked when something is drawn.

        Args:
            view: what to show.
            force: print a plain line even if the last one is recent.
        """
        self._view = view
        now = time.monotonic()
        if self._live is None and (force or now - self._last_line >= self._interval):
            self.say(self.line())

    def say(self, text: str) -> None:
        """Print a line that stays, above the panel if there is one; the next one is due later."""
        self._last_line = time.monotonic()
        self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def line(self) -> str:
        """Return the present view in one line."""
        view = self._view()
        parts = [f"{self._name} {view.done / max(self._total, 1):.0%}", view.doing]
        return " | ".join([*parts, f"left {duration(view.seconds_left)}", *view.details])

    def _panel(self) -> RenderableType:
        view, total = self._view(), max(self._total, 1)
        elapsed = duration(time.monotonic() - self._began)
        times = f"elapsed {elapsed}   left {duration(view.seconds_left)}"
        bar = ProgressBar(total=total, completed=view.done, width=36)
        grid = Table.grid(padding=(0, 2))
        grid.add_row(self._name, bar, f"{view.done / total:.0%}", times)
        lines = [Text(line, style="dim") for line in (view.doing, *view.details)]
        return Group(grid, *lines)
