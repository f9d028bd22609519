"""Pictures of levels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim2vr_harness.client import Timeline, TimelineItem
from sim2vr_harness.figures import level_timeline as timeline
from sim2vr_harness.figures.level_timeline import draw_timeline

LEVEL = Timeline(
    name="a level",
    length_s=20.0,
    lanes=("low", "high"),
    beats_s=(0.0, 0.5, 1.0),
    items=(),
    facts={},
)


def size(out: Path) -> tuple[int, int]:
    with Image.open(out) as picture:
        return picture.size


def pixels(out: Path, color: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the picture's pixels of a colour, (N, 2)."""
    with Image.open(out) as picture:
        return np.argwhere((np.asarray(picture.convert("RGB")) == color).all(axis=-1))


def draw(tmp_path: Path, *items: TimelineItem) -> Path:
    return draw_timeline(replace(LEVEL, items=items), tmp_path / "level.png")


def test_a_box_is_where_it_belongs(tmp_path: Path) -> None:
    red = (248, 24, 24)
    early = draw(tmp_path, TimelineItem(3.0, 0.0, "box", "#f81818", "left"))
    width, height = size(early)
    first = pixels(early, red)
    assert len(first) > 50
    # The first of two strips, in its left half. The legend, below, has the colour, too.
    box = first[first[:, 0] < height / 2]
    assert box[:, 1].max() < width / 2
    high = draw(tmp_path, TimelineItem(3.0, 1.0, "box", "#f81818", "left"))
    above = pixels(high, red)
    assert above[above[:, 0] < height / 2][:, 0].mean() < box[:, 0].mean() - 20
    late = draw(tmp_path, TimelineItem(18.0, 0.0, "box", "#f81818", "left"))
    assert (pixels(late, red)[:, 0] > height / 2).all()


def test_an_arrow_and_a_ring_change_the_picture(tmp_path: Path) -> None:
    box = TimelineItem(3.0, 0.0, "box", "#f81818", "left")
    plain = len(pixels(draw(tmp_path, box), (248, 24, 24)))
    with_arrow = len(pixels(draw(tmp_path, replace(box, arrow_deg=90.0)), (248, 24, 24)))
    assert with_arrow < plain
    black = len(pixels(draw(tmp_path, box), (0, 0, 0)))
    assert len(pixels(draw(tmp_path, replace(box, marked=True)), (0, 0, 0))) > black


def test_a_bar_is_as_long_as_it_lasts(tmp_path: Path) -> None:
    def columns(duration_s: float) -> int:
        bar = TimelineItem(3.0, 0.0, "bar", "#0000ff", "wall", duration_s=duration_s, lanes=2.0)
        found = pixels(draw(tmp_path, bar), (166, 166, 255))  # 35 % of it on white
        return int(np.ptp(found[:, 1])) + 1

    assert columns(4.0) == pytest.approx(2 * columns(2.0), rel=0.05)


def test_another_file_than_a_png_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"--out: got .*expected a file name that ends in \.png"):
        draw_timeline(LEVEL, tmp_path / "level.jpg")


def test_walls_that_cover_a_strip_alike_are_drawn_once() -> None:
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    axes.set_xlim(0.0, 15.0)
    walls = [
        TimelineItem(-0.01 * i, 0.0, "bar", "#e08000", "wall", duration_s=900.0)
        for i in range(1000)
    ]
    timeline._draw_bars(axes, walls)
    (drawn,) = axes.collections
    (wall,) = drawn.get_paths()
    assert wall.get_extents().bounds == (0.0, -0.5, 15.0, 1.0)
