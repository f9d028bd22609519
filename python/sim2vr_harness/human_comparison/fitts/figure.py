"""Movement time over index of difficulty, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming
from sim2vr_harness.human_comparison.fitts.published import STUDIES
from sim2vr_harness.human_comparison.fitts.users import AimedUser, Spread

__all__ = ["draw_fitts"]


def draw_fitts(users: Sequence[AimedUser], out: Path) -> Path:
    """Draw movement time, errors and throughput over the index of difficulty into a PNG file.

    Means over persons with their standard deviations; lines are MT = a + b ID of the means, dashed
    ones are published of people.

    Args:
        users: at least one.
        out: the file.

    Raises:
        InputError: ``out`` is no PNG.
    """
    if out.suffix.lower() != ".png":
        raise InputError("--out", repr(str(out)), "a file name that ends in .png")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    times, throughputs, rates = figure.subplots(1, 3)
    for number, user in enumerate(users):
        _draw_user(times, throughputs, rates, user, f"C{number % 10}")
    _draw_people(times)
    times.set(ylabel="Movement time (s)", ylim=(0.0, None))
    times.legend(fontsize=7, loc="upper left")
    throughputs.set(ylabel="Throughput of a block (bits/s)", ylim=(0.0, None))
    rates.set(ylabel="Share of errors", ylim=(0.0, 1.0))
    for axes in (times, throughputs, rates):
        axes.set_xlabel("Index of difficulty (bits)")
        axes.grid(color="#e8e8e8", linewidth=0.5)
    out.parent.mkdir(parents=True, exist_ok=True)
    with naming(out):
        figure.savefig(out, dpi=110)
    return out


def _draw_user(times: Any, throughputs: Any, rates: Any, user: AimedUser, color: str) -> None:
    bits = [row.bits for row in user.difficulties]
    label = user.name
    if user.line is not None:
        line = user.line
        label += f": {line.a_s:.2f} s + {line.b_s_per_bit:.2f} s/bit, R2 = {line.r2:.2f}"
        ends = np.array([min(bits), max(bits)])
        times.plot(ends, line.a_s + line.b_s_per_bit * ends, color=color)
    for axes, key, style in (
        (times, "movement_time_s", "o"),
        (throughputs, "throughput_bps", "o-"),
        (rates, "error_rate", "o-"),
    ):
        found: list[Spread] = [getattr(row, key) for row in user.difficulties]
        spread = [row.sd for row in found if row.sd is not None]
        axes.errorbar(
            bits,
            [row.mean for row in found],
            yerr=spread if len(spread) == len(found) else None,
            fmt=style,
            color=color,
            capsize=2,
            label=label if axes is times else None,
        )


def _draw_people(axes: Any) -> None:
    ends = np.array(axes.get_xlim())
    for study in STUDIES:
        if study.a_s is None or study.b_s_per_bit is None:
            continue
        axes.plot(
            ends,
            study.a_s + study.b_s_per_bit * ends,
            "--",
            color="gray",
            linewidth=1.0,
            label=f"people: {study.label}",
        )
