"""Measures of a motor layer, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming
from sim2vr_harness.training.motor_control.benchmark import BenchmarkMovements, MotorMeasures

_WORST_MM = 50.0


def draw_measures(measures: MotorMeasures, title: str, out: Path) -> Path:
    """Draw where hands end, how fast they strike, and their times by difficulty, into a PNG file.

    Args:
        measures: of a layer.
        title: above everything.
        out: the file.

    Raises:
        InputError: ``out`` is no PNG.
    """
    if out.suffix.lower() != ".png":
        raise InputError("--out", repr(str(out)), "a file name that ends in .png")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7.4), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    (above, front, held), (strikes, fitts, effort) = figure.subplots(2, 3)
    hand = next(iter(measures.reaches.values()))
    _places(figure, above, hand, 0, hand.error_m, "On arrival, from above")
    _places(figure, front, hand, 2, hand.error_m, "On arrival, from behind")
    _places(figure, held, hand, 2, hand.held_m, "Held for 0.6 s, from behind")
    _strikes(strikes, measures.strikes)
    _fitts(fitts, measures)
    _effort(effort, hand)
    out.parent.mkdir(parents=True, exist_ok=True)
    with naming(out):
        figure.savefig(out, dpi=110)
    return out


def _places(
    figure: Any, axes: Any, aimed: BenchmarkMovements, over: int, error_m: Any, title: str
) -> None:
    """Goals by how far to the left they are and by another axis of the world, 0 or 2."""
    dots = axes.scatter(
        aimed.goal[:, 1], aimed.goal[:, over], c=1000 * error_m, s=14, vmin=0.0, vmax=_WORST_MM
    )
    figure.colorbar(dots, ax=axes, label="Off the goal (mm)", extend="max")
    axes.set_title(f"{title}:\nmedian {1000 * np.nanmedian(error_m):.0f} mm", fontsize=10)
    axes.set(xlabel="Left (m)", ylabel="Ahead (m)" if over == 0 else "Up (m)", aspect="equal")
    axes.invert_xaxis()


def _strikes(axes: Any, aimed: BenchmarkMovements) -> None:
    asked = np.linalg.norm(aimed.velocity, axis=1)
    along = (aimed.end_velocity * aimed.velocity).sum(1) / asked
    axes.plot([0.0, asked.max()], [0.0, asked.max()], color="#888888", linewidth=0.8)
    axes.scatter(asked, along, s=10)
    axes.set(
        title="Strikes from 10 cm, in 0.45 s",
        xlabel="Speed requested (m/s)",
        ylabel="Speed along the way requested (m/s)",
    )


def _fitts(axes: Any, measures: MotorMeasures) -> None:
    bits, times_s = measures.difficulties()
    line = measures.fitts()
    axes.scatter(bits, times_s, s=16)
    ends = np.array([bits.min(), bits.max()])
    axes.plot(ends, line["a_s"] + line["b_s_per_bit"] * ends)
    axes.set(
        title=f"{line['a_s']:.2f} s + {line['b_s_per_bit']:.2f} s/bit, R2 = {line['r2']:.2f}",
        xlabel="Effective index of difficulty (bits)",
        ylabel="Time given (s)",
    )


def _effort(axes: Any, aimed: BenchmarkMovements) -> None:
    known = ~np.isnan(aimed.least_effort)
    axes.set(title="Holding still", xlabel="Least possible", ylabel="Mean square of drives")
    if not known.any():
        axes.text(0.5, 0.5, "no muscles", ha="center", transform=axes.transAxes)
        return
    least, own = aimed.least_effort[known], aimed.effort[known]
    most = max(least.max(), own.max())
    axes.plot([0.0, most], [0.0, most], color="#888888", linewidth=0.8)
    axes.scatter(least, own, s=14)
    axes.set_title(f"Holding still: {own.mean() / least.mean():.1f} times the least")
