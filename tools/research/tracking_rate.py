"""What the tracking rate changes: how often the app sees the hand decides what it notices.

Part A swings the hammer straight at a target, at many speeds and many phases of the app's frames,
and asks the real app (no display needed) what it noticed. Part B plays rounds that people recorded
in the original game, resampled to 20 and 100 Hz: packed rounds with a manifest.json in FOLDER.

    python tools/research/tracking_rate.py [--out FIGURE.png] [--strikes 61] [--recordings FOLDER]
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from sim2vr_harness.client import ClockSettings, DevicePoses, InProcessApp, frame_time_ns

ROOT = Path(__file__).resolve().parents[2]
FIGURE = ROOT / "docs/images/tracking_rate.png"

Float64Array = NDArray[np.float64]

LOCKSTEP = ClockSettings()
PEOPLE = ClockSettings(fixed_delta_time_s=0.014285714, fixed_step_tolerance_s=1e-5)


@dataclass(frozen=True)
class Tracking:
    """How often the app sees the hand.

    Attributes:
        name: for tables and legends.
        hz: frames per second.
        clock: of the app.
        color: in the figure.
    """

    name: str
    hz: int
    clock: ClockSettings
    color: str


TRACKING = (
    Tracking("20 Hz", 20, LOCKSTEP, "#c0392b"),
    Tracking("50 Hz", 50, LOCKSTEP, "#e08e0b"),
    Tracking("72 Hz", 72, PEOPLE, "#7f8c8d"),
    Tracking("100 Hz", 100, LOCKSTEP, "#1f6fb2"),
)
"""20 Hz: the reference's simulated user. 72 Hz: the headset in its study, with game physics at
70 Hz. 100 Hz: ``frames_per_step: 5``."""

# --- geometry (docs/reference/games/whacamole.md): app frame, x right, y up, z forward, m --------

HEAD = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
AREA = HEAD[:3] + np.array([0.15, -0.10, 0.40])
TARGET_FRONT = -0.0025  # of the hit volume, relative to the area's plane
HAMMER_IN_CONTROLLER = Rotation.from_quat([0.30295587, 0.6412905, 0.301122, 0.63740873])
HEAD_CENTER_IN_CONTROLLER = np.array([0.0094392, 0.0393488, 0.0537127])
HEAD_HALF_LENGTH = 0.05
# Handle up, striking face (the head's -x) forward: the hammer hits the target flat.
STRIKING = (
    Rotation.from_matrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    * HAMMER_IN_CONTROLLER.inv()
)

# --- part A: strikes ------------------------------------------------------------------------------

RUN_UP = 0.15  # from the striking face to the target's front at the start
SLOT_S = 3.0  # one strike and its target
STRIKE_AT_S = 0.3  # the target is up by then
TARGET_LIFE_S = 1.9
PHASES_S = 0.1  # strikes start within this time, whole frames of 20, 50 and 100 Hz
SPEEDS_MPS = (0.5, 0.7, 0.85, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0)
BELL_AMPLITUDE = 0.2
HITS_OF_PEOPLE_MPS = (1.0, 2.6)  # 5 to 95 % of the recorded constrained hits (part B prints it)


def through(t: Float64Array, speed_mps: float) -> Float64Array:
    """Constant speed through the target and 30 cm on."""
    return np.minimum(speed_mps * t - RUN_UP, 0.30)


def there_and_back(t: Float64Array, speed_mps: float) -> Float64Array:
    """Constant speed to 5 cm behind the target's front, and back."""
    deep = RUN_UP + 0.05
    return np.maximum(deep - np.abs(speed_mps * t - deep), 0.0) - RUN_UP


def bell(t: Float64Array, speed_mps: float) -> Float64Array:
    """A person's stroke: 20 cm forward and 20 cm back, each with the smoothest acceleration.

    Minimum jerk: the speed is a bell over time, 1.875 times the mean at its peak, which is in the
    middle of the way, where the target is.
    """
    duration_s = 1.875 * BELL_AMPLITUDE / speed_mps
    s = np.clip(t / duration_s, 0.0, 2.0)
    s = np.minimum(s, 2.0 - s)
    return BELL_AMPLITUDE * (10 * s**3 - 15 * s**4 + 6 * s**5) - BELL_AMPLITUDE / 2


Stroke = Callable[[Float64Array, float], Float64Array]
"""(time since the start in s, true speed at the contact in m/s) -> how far the striking face is
behind the target's front, m."""

STROKES: dict[str, Stroke] = {
    "through": through,
    "there and back": there_and_back,
    "bell-shaped, there and back": bell,
}


@dataclass(frozen=True)
class Strikes:
    """What the app made of strikes of one kind and speed.

    Attributes:
        noticed: share with any touch of the target.
        hits: share that counted as a hit.
        ratio_mean: of the game's speed at the first touch to the true speed at the contact; NaN
            when none was noticed.
        ratio_sd: its standard deviation.
    """

    noticed: float
    hits: float
    ratio_mean: float
    ratio_sd: float

    def text(self) -> str:
        """Noticed %, hits %, ratio: mean and SD."""
        shares = f"{100 * self.noticed:9.0f}{100 * self.hits:5.0f}"
        return shares + f"{self.ratio_mean:5.2f} {self.ratio_sd:4.2f}"


def strike(stroke: Stroke, speed_mps: float, tracking: Tracking, count: int) -> Strikes:
    """Plays ``count`` strikes at as many targets, one after the other, in the app.

    Their phases cover a frame of every rate evenly when ``count`` is a prime above 5.
    """
    starts = np.arange(count) * SLOT_S
    begin = starts + STRIKE_AT_S + PHASES_S * (np.arange(count) + 0.5) / count
    times_ns = frame_times_ns(tracking, starts[-1] + SLOT_S)
    times = times_ns * 1e-9
    slot = np.minimum((times / SLOT_S).astype(int), count - 1)
    since = times - begin[slot]
    # The hand goes back for the next strike while the target fades out and takes no touch.
    since[times - starts[slot] > SLOT_S - 0.8] = 0.0
    depth = stroke(np.maximum(since, 0.0), speed_mps)
    options = {
        "condition": "medium",
        "round_seconds": 3600.0,
        "life_seconds": TARGET_LIFE_S,
        "spawn_times": starts.tolist(),
        "spawn_cells": [4.0] * count,
    }
    events = play(options, tracking.clock, times_ns, np.tile(HEAD, (len(times), 1)), hand(depth))
    first = first_touches(events)
    ratios = np.array([event.velocity[2] for event in first.values()]) / speed_mps
    return Strikes(
        noticed=len(first) / count,
        hits=sum(event.kind == "hit" for event in events) / count,
        ratio_mean=float(ratios.mean()) if len(ratios) else float("nan"),
        ratio_sd=float(ratios.std()) if len(ratios) else float("nan"),
    )


def frame_times_ns(tracking: Tracking, seconds: float) -> NDArray[np.int64]:
    """Frames of a lockstep round, (F,) ns."""
    frames = int(seconds * tracking.hz) + 1
    return np.array([frame_time_ns(n, tracking.hz) for n in range(frames)], dtype=np.int64)


def hand(depth: Float64Array) -> Float64Array:
    """Controller poses, (F, 7), that hold the striking face ``depth`` behind the target's front."""
    center = np.zeros((len(depth), 3))
    center[:, 2] = TARGET_FRONT + depth - HEAD_HALF_LENGTH
    position = AREA + center - STRIKING.apply(HEAD_CENTER_IN_CONTROLLER)
    return np.hstack([position, np.tile(STRIKING.as_quat(), (len(depth), 1))])


# --- the app --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Event:
    """A touch of a target.

    Attributes:
        kind: ``hit`` or ``contact``.
        target: its number, in the order of the spawns.
        velocity: the game's, (3,) m/s.
    """

    kind: str
    target: int
    velocity: Float64Array


_EVENT = re.compile(r"\S+, target_(hit|contact), target ID (\d+), grid ID \d+, velocity (.*)")


def play(
    options: Mapping[str, Any],
    clock: ClockSettings,
    times_ns: NDArray[np.int64],
    head: Float64Array,
    right: Float64Array,
) -> list[Event]:
    """Plays one round with given poses, (F, 7), and returns the touches in their order."""
    with tempfile.TemporaryDirectory() as folder:
        with InProcessApp(
            "whacamole", options, renderer="null", log_dir=Path(folder), clock=clock
        ) as app:
            app.reset(1, DevicePoses(head[0], right[0]), time_ns=int(times_ns[0]))
            app.step_frames(times_ns[1:], DevicePoses(head[1:], right[1:]))
        lines = next(Path(folder).rglob("events.csv")).read_text().splitlines()
    found = [match.groups() for line in lines if (match := _EVENT.fullmatch(line))]
    return [Event(kind, int(i), np.array(v.split(), dtype=float)) for kind, i, v in found]


def first_touches(events: Sequence[Event], kind: str | None = None) -> dict[int, Event]:
    """Target -> its first touch of a kind, or of any."""
    first: dict[int, Event] = {}
    for event in events:
        if kind in (None, event.kind):
            first.setdefault(event.target, event)
    return first


# --- part B: rounds of people ---------------------------------------------------------------------

FIRST_FRAME_S = 0.1  # of play, on a lockstep clock


@dataclass
class Tally:
    """What became of recorded hits at one tracking rate.

    Attributes:
        noticed: targets hit in the recordings that were touched here at all.
        found: of those, the ones that were hit here as well.
        extra: targets that were hit here only.
        contacts_recorded: touches in the recordings that were no hits.
        contacts: such touches here.
        speeds_mps: norm of the game's velocity at the recorded hits, one each.
        errors_mps: norm of the difference between velocity here and recorded, per found hit.
        ratios: norm of the velocity here over the recorded one, per found hit.
    """

    noticed: int = 0
    found: int = 0
    extra: int = 0
    contacts_recorded: int = 0
    contacts: int = 0
    speeds_mps: list[float] = field(default_factory=list)
    errors_mps: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)

    def add(self, recorded: Sequence[Event], here: Sequence[Event]) -> None:
        """Counts one round."""
        then, now = first_touches(recorded, "hit"), first_touches(here, "hit")
        both = then.keys() & now.keys()
        self.noticed += len(then.keys() & first_touches(here).keys())
        self.found += len(both)
        self.extra += len(now) - len(both)
        self.contacts_recorded += len(recorded) - len(then)
        self.contacts += len(here) - len(now)
        self.speeds_mps += [float(np.linalg.norm(event.velocity)) for event in then.values()]
        for target in both:
            old, new = then[target].velocity, now[target].velocity
            self.errors_mps.append(float(np.linalg.norm(new - old)))
            self.ratios.append(float(np.linalg.norm(new) / np.linalg.norm(old)))


@dataclass(frozen=True)
class Recording:
    """One round of a person: poses per frame, spawns and touches."""

    condition: str
    t: Float64Array
    head: Float64Array
    right: Float64Array
    spawn_times: list[float]
    spawn_cells: list[float]
    events: list[Event]


def load_recording(folder: Path, trial: Mapping[str, Any]) -> Recording:
    """Reads a round of the manifest; row 0 is the frame in which the target area was placed."""
    rows = np.load(folder / f"{trial['file']}.npz")
    with (folder / f"{trial['file']}_events.csv").open() as file:
        lines = list(csv.DictReader(file))
    spawns = [line for line in lines if line["type"] == "spawn"]
    touches = [line for line in lines if line["type"] in ("hit", "contact")]
    return Recording(
        condition=trial["condition"] + ("" if trial["constrained"] else "-unconstrained"),
        t=rows["t"],
        head=rows["head"].astype(float),
        right=rows["right"].astype(float),
        spawn_times=[float(line["t"]) for line in spawns],
        spawn_cells=[float(line["grid_id"]) for line in spawns],
        events=[
            Event(
                line["type"],
                int(line["target_id"]),
                np.array([float(line[axis]) for axis in ("vx", "vy", "vz")]),
            )
            for line in touches
        ],
    )


def play_as_recorded(recording: Recording) -> list[Event]:
    """Plays every recorded frame at its own time: what the method finds at best."""
    # The frame before play places the area, with the head of that time and the hand of the first
    # frame of play, where the original's velocity filter starts.
    times = np.concatenate([[recording.t[1] - 0.0139], recording.t[1:]])
    right = np.vstack([recording.right[1:2], recording.right[1:]])
    # A millisecond early, so that the rounding of a frame's time cannot make its spawn late.
    options = scheduled(recording, np.array(recording.spawn_times) - 0.001)
    return play(options, PEOPLE, np.round(times * 1e9).astype(np.int64), recording.head, right)


def play_resampled(recording: Recording, tracking: Tracking) -> list[Event]:
    """Plays the recorded motion as a lockstep app sees it at another tracking rate."""
    shift = FIRST_FRAME_S - recording.t[1]
    t = recording.t[1:] + shift
    times_ns = frame_times_ns(tracking, t[-1])
    at = np.clip(times_ns * 1e-9, t[0], t[-1])
    head, right = resample(t, recording.head[1:], at), resample(t, recording.right[1:], at)
    head[0] = recording.head[0]
    options = scheduled(recording, np.array(recording.spawn_times) + shift)
    return play(options, tracking.clock, times_ns, head, right)


def scheduled(recording: Recording, spawn_times: Float64Array) -> dict[str, Any]:
    """The game's options for a round with the recorded targets."""
    return {
        "condition": recording.condition,
        "round_seconds": 3600.0,
        "spawn_times": spawn_times.tolist(),
        "spawn_cells": recording.spawn_cells,
    }


def resample(t: Float64Array, poses: Float64Array, at: Float64Array) -> Float64Array:
    """Poses (F, 7) at other times: positions linear, rotations along the shortest arc."""
    position = np.stack([np.interp(at, t, poses[:, axis]) for axis in range(3)], axis=1)
    return np.hstack([position, Slerp(t, Rotation.from_quat(poses[:, 3:]))(at).as_quat()])


def replay_people(folder: Path, rounds: int | None = None) -> dict[tuple[str, str], Tally]:
    """(constrained or unconstrained, tracking rate) -> what was found, over recorded rounds."""
    trials = json.loads((folder / "manifest.json").read_text())["trials"]
    tallies: dict[tuple[str, str], Tally] = {}
    every = max(1, len(trials) // rounds) if rounds else 1
    for trial in trials[::every][:rounds]:
        recording = load_recording(folder, trial)
        group = "constrained" if trial["constrained"] else "unconstrained"
        played = {"as recorded": play_as_recorded(recording)}
        for tracking in TRACKING:
            if tracking.clock == LOCKSTEP:
                played[tracking.name] = play_resampled(recording, tracking)
        for name, events in played.items():
            tallies.setdefault((group, name), Tally()).add(recording.events, events)
    return tallies


# --- what comes out -------------------------------------------------------------------------------

Results = dict[tuple[str, float, str], Strikes]
"""(stroke, speed in m/s, tracking rate) -> strikes."""


def strike_everywhere(count: int, speeds_mps: Sequence[float]) -> Results:
    """Part A: every stroke at every speed and tracking rate, ``count`` strikes each."""
    return {
        (name, speed, tracking.name): strike(stroke, speed, tracking, count)
        for name, stroke in STROKES.items()
        for speed in speeds_mps
        for tracking in TRACKING
    }


def print_strikes(results: Results) -> None:
    """Prints part A: per stroke and speed, for each rate, noticed %, hits % and speed ratio."""
    speeds = sorted({speed for _, speed, _ in results})
    print("A. Strikes: noticed %, hits %, speed in the game / true speed at the contact (mean, SD)")
    print("   Truth: all noticed, all hits above 0.8 m/s, ratio 1.")
    for stroke in STROKES:
        print(f"\n{stroke}\n   m/s" + "".join(f"{tracking.name:>24}" for tracking in TRACKING))
        for speed in speeds:
            cells = [results[stroke, speed, tracking.name] for tracking in TRACKING]
            print(f"{speed:6.2f}" + "".join(cell.text() for cell in cells))


def print_people(tallies: Mapping[tuple[str, str], Tally]) -> None:
    """Prints part B."""
    print("\nB. Recorded rounds of people: hits noticed and found, velocity at those found")
    for group in sorted({group for group, _ in tallies}):
        own = {name: tally for (of, name), tally in tallies.items() if of == group}
        recorded = next(iter(own.values()))
        low, median, high = np.percentile(recorded.speeds_mps, [5, 50, 95])
        print(
            f"\n{group}: {len(recorded.speeds_mps)} hits ({low:.2f}, {median:.2f}, {high:.2f} m/s "
            f"at 5, 50, 95 %), {recorded.contacts_recorded} contacts\n{'tracking':12}"
            f"{'noticed %':>10}{'found %':>9}{'extra':>7}{'contacts':>10}"
            f"{'median |dv| m/s':>17}{'speed ratio':>13}"
        )
        for name, tally in own.items():
            hits = len(tally.speeds_mps)
            print(
                f"{name:12}{100 * tally.noticed / hits:10.1f}{100 * tally.found / hits:9.1f}"
                f"{tally.extra:7}{tally.contacts:10}"
                f"{np.median(tally.errors_mps):17.3f}{np.median(tally.ratios):13.2f}"
            )


def draw(results: Results, file: Path) -> None:
    """Draws part A: a row per stroke; noticed, counted as hits, speed ratio."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    speeds = sorted({speed for _, speed, _ in results})
    panels = figure.subplots(len(STROKES), 3, sharex=True)
    for row, stroke in zip(panels, STROKES, strict=True):
        for tracking in TRACKING:
            cells = [results[stroke, speed, tracking.name] for speed in speeds]
            look = {"color": tracking.color, "label": tracking.name, "marker": "o", "ms": 3}
            row[0].plot(speeds, [100 * cell.noticed for cell in cells], **look)
            row[1].plot(speeds, [100 * cell.hits for cell in cells], **look)
            mean = np.array([cell.ratio_mean for cell in cells])
            sd = np.array([cell.ratio_sd for cell in cells])
            row[2].plot(speeds, mean, **look)
            row[2].fill_between(speeds, mean - sd, mean + sd, color=tracking.color, alpha=0.15)
        truth = {"color": "black", "ls": "--", "lw": 1, "label": "truth"}
        row[0].axhline(100, **truth)
        row[1].plot([min(speeds), 0.8, 0.8, max(speeds)], [0, 0, 100, 100], **truth)
        row[2].axhline(1.0, **truth)
        row[0].set_ylabel(f"{stroke}\n% of strikes", fontsize=9)
        for axes in row:
            axes.axvspan(
                *HITS_OF_PEOPLE_MPS, color="black", alpha=0.06, lw=0, label="hits of people"
            )
        for axes in row[:2]:
            axes.set_ylim(-4, 106)
    for axes, title in zip(
        panels[0],
        ("Strikes noticed", "Strikes counted as hits", "Speed in the game / true speed"),
        strict=True,
    ):
        axes.set_title(title, fontsize=10)
        axes.set_xscale("log")
    ticks = [tick for tick in (0.5, 1, 2, 4, 8) if min(speeds) <= tick <= max(speeds)]
    for axes in panels.flat:
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xticks([], minor=True)
        axes.grid(alpha=0.3)
        axes.tick_params(labelsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("true speed at the contact, m/s", fontsize=9)
    panels[0, 0].legend(fontsize=8, loc="lower left")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=100)
    # A palette of 128 colours takes half the space.
    Image.open(file).convert("RGB").quantize(128).save(file, optimize=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs both parts, prints the tables and writes the figure."""
    parser = argparse.ArgumentParser(description="What the tracking rate changes.")
    parser.add_argument("--out", type=Path, default=FIGURE, help="the figure's file")
    parser.add_argument(
        "--strikes", type=int, default=61, help="per stroke, speed and rate; a prime"
    )
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS_MPS, help="m/s")
    parser.add_argument("--recordings", type=Path, help="a folder of packed rounds: part B, too")
    given = parser.parse_args(arguments)
    results = strike_everywhere(given.strikes, given.speeds)
    print_strikes(results)
    draw(results, given.out)
    print(f"\nFigure: {given.out}")
    if given.recordings:
        print_people(replay_people(given.recordings))


if __name__ == "__main__":
    main()
