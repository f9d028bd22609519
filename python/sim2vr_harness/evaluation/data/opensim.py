"""Steps as OpenSim's tables: joint angles (``.mot``), activations and forces (``.sto``)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.evaluation.data.folder import EvaluationData


def export_opensim(data: EvaluationData, out: Path, episodes: Sequence[str] = ()) -> list[Path]:
    """Write ``<episode>_joints.mot``, ``_activations.sto`` and ``_forces.sto`` per episode.

    Angles are in degrees, positions of slides in metres, activations from 0 to 1, forces in N
    (torques in Nm). The names are those of the body's joints and muscles, without a model's paths.
    Forces are tensile, hence positive.

    Args:
        data: Of an evaluation that kept steps.
        out: Folder for the files; made if needed.
        episodes: Episodes to export; empty: all.

    Returns:
        The files.

    Raises:
        InputError: There is no such episode, or there are no steps.
    """
    units = data.dictionary[data.dictionary["table"] == "steps"].set_index("column")["unit"]
    files = []
    for episode in data.episode_keys(episodes):
        steps = data.steps(episode)
        joints = [name for name in steps.columns if name.startswith("q_")]
        if not joints:
            raise InputError("steps", f"no joints in {episode}", "columns q_JOINT")
        degrees = steps[joints].copy()
        for name in joints:
            if units.get(name) == "rad":
                degrees[name] = np.degrees(degrees[name])
        muscles = [name for name in steps.columns if name.startswith("act_")]
        forces = [name for name in steps.columns if name.startswith("force_")]
        pulling = steps[forces].copy()
        for name in forces:
            if units.get(name) == "N":
                pulling[name] = -pulling[name]
        times_s = steps["time_s"].to_numpy()
        for suffix, table, in_degrees in (
            ("joints.mot", degrees, True),
            ("activations.sto", steps[muscles], False),
            ("forces.sto", pulling, False),
        ):
            file = out / f"{episode}_{suffix}"
            write_atomically(file, _table(file.stem, times_s, table, in_degrees).encode())
            files.append(file)
    return files


def _table(title: str, times_s: Any, values: Any, in_degrees: bool) -> str:
    """OpenSim's text format, version 1: a header of facts, the labels, tab-separated rows."""
    labels = ["time", *(name.partition("_")[2] for name in values.columns)]
    lines = [
        title,
        "version=1",
        f"nRows={len(values)}",
        f"nColumns={len(labels)}",
        f"inDegrees={'yes' if in_degrees else 'no'}",
        "endheader",
        "\t".join(labels),
    ]
    for time_s, row in zip(times_s, values.to_numpy(), strict=True):
        lines.append("\t".join([f"{time_s:.6f}", *(f"{value:.8g}" for value in row)]))
    return "\n".join(lines) + "\n"
