"""Rounds recorded in the original game, played again from seed and poses alone.

The recordings are not part of the project (they carry no licence). They are looked for in
``$SIM2VR_SHARED/data`` and in ``../shared/data`` beside the repository.
"""

from __future__ import annotations

import csv
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import DevicePoses, InProcessApp, frame_time_ns

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = Path(os.environ.get("SIM2VR_SHARED", ROOT.parent / "shared")) / "data/simulated_rounds"
MANIFEST = ROUNDS / "manifest.json"
TRIALS = json.loads(MANIFEST.read_text())["trials"] if MANIFEST.is_file() else []
PARAMETERS = [pytest.param(trial, id=trial["file"]) for trial in TRIALS] or [
    pytest.param(
        None,
        marks=pytest.mark.skip(
            "no recorded rounds: SIM2VR_SHARED can name a folder with data/simulated_rounds"
        ),
        id="no recordings",
    )
]

Event = tuple[float, str, int, int, tuple[float, ...]]
_OWN_EVENT = re.compile(r"(\S+), target_(\w+), target ID (\d+), grid ID (\d+)(?:, velocity (.*))?")


def recorded_events(path: Path) -> list[Event]:
    with path.open() as file:
        return [
            (
                float(row["t"]),
                row["type"],
                int(row["target_id"]),
                int(row["grid_id"]),
                tuple(float(row[axis]) for axis in ("vx", "vy", "vz") if row[axis]),
            )
            for row in csv.DictReader(file)
        ]


def own_events(path: Path) -> list[Event]:
    events = []
    for line in path.read_text().splitlines():
        match = _OWN_EVENT.fullmatch(line)
        if match:
            t, kind, target, cell, velocity = match.groups()
            speeds = tuple(float(x) for x in (velocity or "").split())
            events.append((float(t), kind, int(target), int(cell), speeds))
    return events


def replay(trial: dict[str, Any], log_dir: Path) -> list[Event]:
    rows = np.load(ROUNDS / f"{trial['file']}.npz")
    options = {"condition": trial["condition"], "head_rotation": "device"}
    if not trial["constrained"]:
        options["condition"] += "-unconstrained"
    poses = [
        DevicePoses(head.astype(float), right.astype(float))
        for head, right in zip(rows["head"], rows["right"], strict=True)
    ]
    with InProcessApp("whacamole", options, renderer="null", log_dir=log_dir) as app:
        app.reset(trial["seed"], poses[0])
        for t, pose in zip(rows["t"][1:], poses[1:], strict=True):
            # The log rounds its times to 7 digits; the frame number gives the full ones.
            app.step(frame_time_ns(round(t / 0.05), 20), pose)
    return own_events(next(log_dir.rglob("events.csv")))


@pytest.mark.parametrize("trial", PARAMETERS)
def test_simulated_users_round_from_seed_and_poses(trial: dict[str, Any], tmp_path: Path) -> None:
    expected = sorted(recorded_events(ROUNDS / f"{trial['file']}_events.csv"))
    events = sorted(replay(trial, tmp_path))
    # Two targets hit in one fixed step may be reported in either order: compare sorted.
    assert [event[1:4] for event in events] == [event[1:4] for event in expected]
    for own, recorded in zip(events, expected, strict=True):
        assert own[0] == pytest.approx(recorded[0], abs=2e-5 + 1e-6 * recorded[0])
        # Poses are logged with 7 digits. Besides, the original's velocity filter still holds the
        # hammer's jump from the round before (some metres in 50 ms), halved with every frame.
        leftover_mps = 40.0 * 0.5 ** (recorded[0] / 0.05)
        assert own[4] == pytest.approx(recorded[4], abs=5e-4 + leftover_mps)
