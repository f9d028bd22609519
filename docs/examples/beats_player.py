"""A scripted player of Beats: cuts every box in the middle, leaves mines alone, dodges walls.

It knows the level beforehand and moves hands and head through points in time, both blades along z.
Between two strokes a saber is drawn back behind the player, where nothing comes any more.

Usage: python docs/examples/beats_player.py [LEVEL] [--seed N] [--seconds S] [--out FILM.mp4]

LEVEL is first, full, generated or the path of a map. Without --out the round is played only.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import (
    DevicePoses,
    InProcessApp,
    Timeline,
    TimelineItem,
    describe_game,
    describe_level,
    frame_time_ns,
)

Point = NDArray[np.float64]

# docs/reference/games/beats.md: the grid relative to where the head starts.
CELL_M = np.array([0.40, 0.35])
MIDDLE_ROW_M = -0.30
COLUMNS = 4
HEAD = np.array([0.0, 1.17, 0.0])

# A stroke of 42 cm in 0.1 s, 4.2 m/s, begins 2 cm outside of the box (17.5 cm and the blade's 1.5)
# and ends as far behind it: it does not reach a mine in the next cell, 35 - 12 - 1.5 cm away. It
# waits at either end for more than a frame of 20 Hz, so that no frame cuts a corner.
HALF_STROKE_M = 0.21
HALF_STROKE_S = 0.05
WAIT_S = 0.06
REACH_S = 0.05
# Blades reach from z = 8 cm to 1.08 m from the grip.
FORWARD_M = 0.0
BACK_M = -1.3
# Aside or below by more than the head's 8 cm; so long before and after.
FREE_M = 0.12
DODGE_S = 0.3


@dataclass
class Path:
    """Points in time, with straight lines between."""

    times: list[float]
    points: list[Point]

    def add(self, time_s: float, point: Point) -> None:
        """Append a point; times rise."""
        self.times.append(time_s)
        self.points.append(point)

    def at(self, time_s: float) -> Point:
        """The place at a time, m; before the first point and behind the last one, theirs."""
        points = np.array(self.points)
        return np.array([np.interp(time_s, self.times, axis) for axis in points.T])


def hand_path(boxes: list[TimelineItem], rest_x_m: float) -> Path:
    """Of a grip, m from where the head starts."""
    path = Path([0.0], [np.array([rest_x_m, MIDDLE_ROW_M, BACK_M])])
    for box in sorted(boxes, key=lambda box: box.time_s):
        row, column = divmod(box.lane, COLUMNS)
        middle = CELL_M * [column - 1.5, row - 1.0] + [0.0, MIDDLE_ROW_M]
        # A box of any direction is cut downwards.
        angle = np.radians(-90.0 if box.arrow_deg is None else box.arrow_deg)
        half = HALF_STROKE_M * np.array([np.cos(angle), np.sin(angle)])
        for side in (-1.0, 1.0):
            end = middle + side * half
            near = box.time_s + side * HALF_STROKE_S
            far = near + side * WAIT_S
            knots = [
                (near, FORWARD_M),
                (far, FORWARD_M),
                (far + side * REACH_S, BACK_M),
            ]
            for time_s, z in knots[:: 1 if side > 0 else -1]:
                path.add(time_s, np.append(end, z))
    return path


def head_path(walls: list[TimelineItem]) -> Path:
    """Of the head, m from where it starts."""
    path = Path([0.0], [np.zeros(3)])
    for time_s in sorted({wall.time_s for wall in walls}):
        bars = [wall for wall in walls if wall.time_s == time_s]
        end_s = time_s + max(bar.duration_s for bar in bars)
        aside = np.zeros(3)
        if min(bar.lane for bar in bars) >= 2 * COLUMNS:
            # The top row's lower edge.
            aside[1] = MIDDLE_ROW_M + CELL_M[1] / 2.0 - FREE_M
        else:
            left = (min(bar.lane % COLUMNS for bar in bars) - 2.0) * CELL_M[0]
            right = left + max(bar.lanes for bar in bars) * CELL_M[0]
            ways = [x for x in (left - FREE_M, right + FREE_M) if left < FREE_M and right > -FREE_M]
            aside[0] = min(ways, key=abs, default=0.0)
        path.add(max(time_s - 2.0 * DODGE_S, path.times[-1]), path.points[-1])
        path.add(time_s - DODGE_S, aside)
        path.add(end_s + DODGE_S, aside)
        path.add(end_s + 2.0 * DODGE_S, np.zeros(3))
    return path


class BeatsPlayer:
    """Plays one level.

    Args:
        level: What comes when (`sim2vr_harness.client.describe_level`).
        period_s: Time between two frames.
    """

    def __init__(self, level: Timeline, period_s: float = 0.05) -> None:
        def of_kind(kind: str) -> list[TimelineItem]:
            return [item for item in level.items if item.kind == kind]

        self.period_s = period_s
        self.left = hand_path(of_kind("left box"), -0.2)
        self.right = hand_path(of_kind("right box"), 0.2)
        self.head = head_path(of_kind("wall"))

    def __call__(self, frame: int) -> DevicePoses:
        """Poses in a frame, world axes, m."""
        time_s = frame * self.period_s
        head, right, left = (
            np.append(HEAD + path.at(time_s), [0.0, 0.0, 0.0, 1.0])
            for path in (self.head, self.right, self.left)
        )
        return DevicePoses(head, right, left)


FRAME_RATE_HZ = 60
VIEW = (640, 480)
"""Width and height of headset view and view from outside in the film, pixels."""


def play(
    level: str, seed: int = 1, seconds: float = 600.0, film: FilePath | None = None
) -> Mapping[str, float]:
    """Play a level at 60 frames a second.

    Args:
        level: As the game's option.
        seed: Of a generated level.
        seconds: To play at most.
        film: The MP4 file to write, if any.

    Returns:
        The game's log at the end.
    """
    from sim2vr_harness.play.film import Film, Painter, score_text

    options = {"level": level, "end_on_miss": False}
    timeline = describe_level("beats", options, seed)
    player = BeatsPlayer(timeline, 1.0 / FRAME_RATE_HZ)
    painter = Painter({"headset": VIEW, "game": VIEW})
    renderer = "null" if film is None else "automatic"
    writer = None if film is None else Film(film, painter.width, painter.height, FRAME_RATE_HZ)
    with InProcessApp("beats", options, renderer=renderer) as app:
        reply = app.reset(seed, player(0))
        for frame in range(1, 1 + round(seconds * FRAME_RATE_HZ)):
            reply = app.step(frame_time_ns(frame, FRAME_RATE_HZ), player(frame))
            if writer is not None:
                panels = {
                    "headset": app.render_headset(*VIEW)[..., :3],
                    "game": app.render_third_person(*VIEW, view="spectator")[..., :3],
                }
                text = score_text(describe_game("beats"), reply.log, frame / FRAME_RATE_HZ)
                writer.add(painter.frame(panels, f"{timeline.name}, by a script", text))
            if reply.finished:
                break
    if writer is not None:
        writer.finish()
    return reply.log


def main() -> None:
    """Play, and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("level", nargs="?", default="full")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--out", type=FilePath)
    given = parser.parse_args()
    log = play(given.level, given.seed, given.seconds, given.out)
    for name in ("Score", "AccumulatedCorrectSlices", "Boxes", "AccumulatedErrors", "MaxCombo"):
        print(f"{name}: {log[name]:g}")
    if given.out is not None:
        print(f"Written: {given.out}")


if __name__ == "__main__":
    main()
