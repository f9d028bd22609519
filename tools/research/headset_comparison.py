"""Puts our headset view beside the published one, and compares colours sampled from both.

The reference is the figure of the SIM2VR repository that shows two headset views of Whac-A-Mole,
one above the other (F. Fischer et al., *SIM2VR: Towards Automated Biomechanical Testing in VR*,
UIST 2024). Head and hammer were fitted to it: the area's edges, the rings of the targets and the
hammer's outline. The headset's field of view is not stated there; the fit gives 46.8 degrees from
top to bottom, and the sky, which took no part in it, then agrees to a few levels. Our head camera
sees 90 degrees, so a panel is the middle of a larger picture.

Usage: python tools/research/headset_comparison.py REFERENCE.png [--out PICTURE.png]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim2vr_harness.client import DevicePoses, InProcessApp, frame_time_ns

Picture = NDArray[np.uint8]
Vector = NDArray[np.float64]

PANEL = (456, 257)
"""Width and height of a view in the figure, pixels; its file shows them twice as large."""
FOCAL_PX = 297.5
"""Pixels per unit slope, from the fit; half the height of a picture of 90 degrees."""
START = np.array([0.0, 1.17, 0.0])
"""Head at the start of the round, m; the area is placed from it."""
AREA = np.add(START, (0.15, -0.10, 0.40))
FADE_IN_S, LIFE_S = 0.1, 1.0
FRAME_RATE_HZ = 100
SHOWN_FRAME = 130


@dataclass(frozen=True)
class Moment:
    """One view of the figure. Positions are relative to the area's centre, app frame, m."""

    caption: str
    corner: tuple[int, int]
    """Upper left corner of the view in the figure's file, pixels."""
    head_position: tuple[float, float, float]
    head_angles_deg: tuple[float, float, float]
    """Yaw to the right, pitch down, roll to the left; turned in the order roll, pitch, yaw."""
    controller_position: tuple[float, float, float]
    controller_rotation: tuple[float, float, float, float]
    ages: dict[int, float]
    """Cell -> part of the life that is over, 0 (green) to 1 (red)."""
    hit: dict[int, float] = field(default_factory=dict)
    """Cell -> seconds since it was hit."""


MOMENTS = (
    Moment(
        "a target was hit",
        (8, 12),
        (0.2669, -0.0148, -0.2564),
        (-49.77, -3.80, -0.22),
        (-0.1827, -0.0346, -0.0670),
        (-0.2428, 0.0820, 0.1325, 0.9575),
        {5: 0.96, 6: 0.45},
        {3: 0.03},
    ),
    Moment(
        "just before",
        (8, 562),
        (0.2564, -0.0146, -0.2465),
        (-47.92, -3.19, -0.49),
        (-0.1775, -0.0296, -0.0661),
        (-0.3672, 0.0852, 0.2024, 0.9038),
        {5: 0.96, 6: 0.45, 3: 0.05},
    ),
)


@dataclass(frozen=True)
class Sample:
    """A spot that is compared."""

    name: str
    moment: int
    x: int
    y: int
    """Middle, pixels of the panel."""
    reach: int = 1
    """Pixels to each side that are averaged."""


SAMPLES = (
    Sample("sky, top", 0, 60, 3),
    Sample("sky", 0, 60, 40),
    Sample("sky", 0, 60, 80),
    Sample("sky, low", 0, 60, 115),
    Sample("horizon", 0, 60, 148),
    Sample("ground, near the horizon", 0, 60, 170),
    Sample("ground", 0, 60, 240),
    Sample("through the area, sky", 0, 280, 20),
    Sample("through the area, sky", 0, 280, 70),
    Sample("through the area, sky", 0, 280, 110),
    Sample("through the area, horizon", 0, 280, 147),
    Sample("through the area, ground", 0, 280, 180),
    Sample("fresh target", 1, 179, 129),
    Sample("middle-aged target", 1, 179, 213),
    Sample("old target", 1, 346, 133, 3),
    Sample("dome of the middle-aged target", 1, 192, 220),
    Sample("hammer, head", 1, 130, 112, 8),
    Sample("hammer, head's end", 0, 126, 112, 2),
    Sample("hammer, handle above the grip", 1, 125, 133, 2),
    Sample("hammer, grip", 1, 125, 186, 3),
    Sample("hammer, knob", 1, 127, 92, 2),
    Sample("burst", 0, 200, 140, 3),
    Sample("controller, body", 1, 117, 209, 1),
    Sample("controller, ring", 1, 90, 146, 3),
)


def quaternion(axis: int, degrees: float) -> Vector:
    """Return the rotation about a coordinate axis, x y z w."""
    half = np.radians(degrees) / 2.0
    rotation = np.zeros(4)
    rotation[axis], rotation[3] = np.sin(half), np.cos(half)
    return rotation


def product(a: Vector, b: Vector) -> Vector:
    """Return the quaternion that turns by b, then by a, x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def poses(moment: Moment) -> DevicePoses:
    """Return the fitted poses in the app's frame."""
    yaw, pitch, roll = moment.head_angles_deg
    turned = product(quaternion(1, yaw), product(quaternion(0, pitch), quaternion(2, roll)))
    head = np.concatenate([AREA + moment.head_position, turned])
    rotation = np.array(moment.controller_rotation)
    controller = np.concatenate(
        [AREA + moment.controller_position, rotation / np.linalg.norm(rotation)]
    )
    return DevicePoses(head, controller)


def spawns(moment: Moment) -> dict[str, list[float]]:
    """Return the options that make the targets have their ages in the shown frame."""
    shown_s = SHOWN_FRAME / FRAME_RATE_HZ
    times = {cell: shown_s - FADE_IN_S - age * LIFE_S for cell, age in moment.ages.items()}
    for cell, since_hit_s in moment.hit.items():
        times[cell] = shown_s - since_hit_s - 2.0 * FADE_IN_S
    cells = sorted(times, key=lambda cell: times[cell])
    return {
        "spawn_times": [round(times[cell], 4) for cell in cells],
        "spawn_cells": [float(cell) for cell in cells],
    }


def play(moment: Moment) -> Picture:
    """Play up to the moment and return the panel, (257, 456, 3)."""
    options: dict[str, Any] = {
        "condition": "medium-unconstrained",
        "fade_in_seconds": FADE_IN_S,
        "life_seconds": LIFE_S,
        **spawns(moment),
    }
    fitted = poses(moment)
    # Where the area is placed, with the hammer out of reach.
    away = DevicePoses(
        np.concatenate([START, (0.0, 0.0, 0.0, 1.0)]),
        np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 1.0]),
    )
    # The frame after the hammer has arrived finds the touch. Where nothing is hit it arrives last.
    strike = SHOWN_FRAME - round(max(moment.hit.values(), default=0.0) * FRAME_RATE_HZ)
    with InProcessApp("whacamole", options) as app:
        app.reset(1, away)
        for frame in range(1, SHOWN_FRAME + 1):
            arrived = frame >= strike
            app.step(frame_time_ns(frame, FRAME_RATE_HZ), fitted if arrived else away)
        height = round(2.0 * FOCAL_PX)
        top = (height - PANEL[1]) // 2
        return app.render_headset(PANEL[0], height)[top : top + PANEL[1], :, :3].copy()


def published(figure: Image.Image, moment: Moment) -> Picture:
    """Return the moment's view of the figure at its own size, (257, 456, 3)."""
    left, top = moment.corner
    view = figure.crop((left, top, left + 2 * PANEL[0], top + 2 * PANEL[1]))
    return np.asarray(view.resize(PANEL, Image.Resampling.BOX))


def color(picture: Picture, sample: Sample) -> NDArray[np.int64]:
    """Return the mean colour of a spot, rounded."""
    rows = slice(max(sample.y - sample.reach, 0), sample.y + sample.reach + 1)
    columns = slice(max(sample.x - sample.reach, 0), sample.x + sample.reach + 1)
    return np.rint(picture[rows, columns].mean(axis=(0, 1))).astype(np.int64)


def table(reference: list[Picture], ours: list[Picture]) -> str:
    """Return the comparison of the samples, Markdown."""
    lines = ["| spot | reference | ours | difference |", "|---|---|---|---|"]
    for sample in SAMPLES:
        theirs = color(reference[sample.moment], sample)
        own = color(ours[sample.moment], sample)
        cells = [", ".join(str(value) for value in row) for row in (theirs, own)]
        difference = ", ".join(f"{value:+d}" for value in own - theirs)
        lines.append(f"| {sample.name} | {cells[0]} | {cells[1]} | {difference} |")
    return "\n".join(lines)


def side_by_side(reference: list[Picture], ours: list[Picture]) -> Image.Image:
    """Return the views with captions: published ones left, ours right."""
    gap, head = 6, 24
    width, height = PANEL
    sheet = Image.new("RGB", (2 * width + gap, len(MOMENTS) * (head + height)), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(14)
    for row, moment in enumerate(MOMENTS):
        top = row * (head + height)
        columns = (("SIM2VR (UIST 2024)", reference[row]), ("this project", ours[row]))
        for column, (name, picture) in enumerate(columns):
            left = column * (width + gap)
            caption = f"{name}: {moment.caption}"
            draw.text((left + 4, top + head // 2), caption, "black", font, anchor="lm")
            sheet.paste(Image.fromarray(picture), (left, top + head))
    return sheet


def main() -> None:
    """Write the picture and print the table."""
    parser = argparse.ArgumentParser(description="Our headset view beside the published one.")
    parser.add_argument("reference", type=Path, help="the published figure, both views, PNG")
    parser.add_argument("--out", type=Path, default=Path("headset_comparison.png"))
    arguments = parser.parse_args()
    figure = Image.open(arguments.reference).convert("RGB")
    reference = [published(figure, moment) for moment in MOMENTS]
    ours = [play(moment) for moment in MOMENTS]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    side_by_side(reference, ours).save(arguments.out, optimize=True)
    print(table(reference, ours))


if __name__ == "__main__":
    main()
