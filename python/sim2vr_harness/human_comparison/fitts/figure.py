"""Movement time over index of difficulty, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sim2vr_harness.figures.figure import GREY, Figure, Layer, Line, Panel, Points, colour_of
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.human_comparison.fitts.published import STUDIES
from sim2vr_harness.human_comparison.fitts.users import AimedUser, Spread

_MEAN = "mean ± SD over persons"


def draw_fitts(users: Sequence[AimedUser], out: Path) -> Path:
    """Draw movement time, errors and throughput over the index of difficulty: PNG or PDF.

    Means over persons with their standard deviations; lines are MT = a + b ID of the means, dashed
    ones are published of people.

    Args:
        users: at least one.
        out: the file.

    Raises:
        InputError: ``out`` is neither PNG nor PDF.
    """
    times: list[Layer] = []
    throughputs: list[Layer] = []
    rates: list[Layer] = []
    for number, user in enumerate(users):
        bits, colour = [row.bits for row in user.difficulties], colour_of(number)
        label = user.name
        if user.line is not None:
            line = user.line
            label += f": {line.a_s:.2f} s + {line.b_s_per_bit:.2f} s/bit, R2 = {line.r2:.2f}"
            times.append(_straight(label, line.a_s, line.b_s_per_bit, bits, colour))
        for layers, key in (
            (times, "movement_time_s"),
            (throughputs, "throughput_bps"),
            (rates, "error_rate"),
        ):
            found: list[Spread] = [getattr(row, key) for row in user.difficulties]
            means, sds = [row.mean for row in found], [row.sd for row in found]
            spread = None if None in sds else sds
            name = label if layers is times else user.name
            layers.append(Points(name, bits, means, colour, spread=spread, key=_MEAN))
            if layers is not times:
                layers.append(Line(label, bits, means, colour))
    every = [row.bits for user in users for row in user.difficulties]
    times += [
        _straight(f"people: {s.label}", s.a_s, s.b_s_per_bit, every, GREY, dashed=True)
        for s in STUDIES
        if s.a_s is not None and s.b_s_per_bit is not None
    ]
    x = "index of difficulty (bits)"
    panels = [
        Panel("", times, x, "movement time (s)", y_range=(0.0, 0.0), legend=True),
        Panel("", throughputs, x, "throughput of a block (bits/s)", y_range=(0.0, 0.0)),
        Panel("", rates, x, "proportion of errors", y_range=(-0.03, 1.03)),
    ]
    return write_figure(Figure("movement_time", "Aimed movements", "", panels), out)


def _straight(
    name: str, a_s: float, b: float, bits: Sequence[float], colour: str, *, dashed: bool = False
) -> Line:
    """MT = a + b ID over the indices that were played."""
    ends = [min(bits), max(bits)]
    return Line(name, ends, [a_s + b * end for end in ends], colour, dashed=dashed)
