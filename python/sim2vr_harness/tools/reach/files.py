"""Output files of ``sim2vr-harness reach``: tables, a page, a picture, a video."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from sim2vr_harness.base.files import naming
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.tools.reach.figures import write_picture, write_turntable
from sim2vr_harness.tools.reach.measuring import Measured
from sim2vr_harness.tools.reach.page import write_page


def write(found: Measured, out: Path, *, film: bool = True) -> list[Path]:
    """Write what was found.

    Args:
        found: It.
        out: Folder for ``targets.csv`` (verdicts; right, up, ahead in m, angles in degrees),
            ``reach.csv`` (the cells on the surface of what can be reached), ``sweep.csv`` (the
            reference's columns: rad, MuJoCo's world), ``reach.html``, ``reach.png`` and, with
            ``film``, ``turntable.mp4``.
        film: Whether to film.
    """
    out.mkdir(parents=True, exist_ok=True)
    files = [_targets(found, out), _surface(found, out), _sweep(found, out)]
    files += [write_page(found, out / "reach.html"), write_picture(found, out / "reach.png")]
    return [*files, write_turntable(found, out / "turntable.mp4")] if film else files


def _table(file: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    with naming(file), file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        writer.writerows(rows)
    return file


def _targets(found: Measured, out: Path) -> Path:
    joints = found.reach.linkage.joints
    header = ["target", "right_m", "up_m", "ahead_m", "inside", "margin_cm"]
    header += ["nearest_right_m", "nearest_up_m", "nearest_ahead_m", *(f"{j}_deg" for j in joints)]
    rows = []
    for target, verdict in zip(found.targets, found.verdicts, strict=True):
        numbers = [*target.place_m.round(4).tolist()]
        nearest = position_to_app(verdict.nearest_m).round(4).tolist()
        angles = np.degrees(verdict.posture).round(2).tolist()
        margin = round(100.0 * verdict.margin_m, 2)
        rows.append([target.name, *numbers, int(verdict.inside), margin, *nearest, *angles])
    return _table(out / "targets.csv", header, rows)


def _surface(found: Measured, out: Path) -> Path:
    rows = position_to_app(found.volume.surface()).round(4).tolist()
    return _table(out / "reach.csv", ["right_m", "up_m", "ahead_m"], rows)


def _sweep(found: Measured, out: Path) -> Path:
    header = ["index", *(f"{joint}_pos" for joint in found.sweep.joints)]
    header += [f"end-effector_xpos_{axis}" for axis in "xyz"]
    numbers = np.concatenate([found.sweep.angles, found.sweep.points], axis=1).round(6)
    rows = ([i, *row] for i, row in enumerate(numbers.tolist()))
    return _table(out / "sweep.csv", header, rows)
