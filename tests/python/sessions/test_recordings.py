"""Reading the original's logs and the packed form, with wrong files too."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.sessions import read_session, read_sessions
from sim2vr_harness.sessions.logs import TargetEvent as Event
from sim2vr_harness.sessions.logs import target_events
from sim2vr_harness.sessions.whacamole import constrained, plane_of, timing_of


def state_row(t: str) -> str:
    # Left and right controller, head, marker; told apart by their x.
    poses = [f"{x}, 1.2, 0.3, 0, 0, 0, 1" for x in (0.1, 0.2, 0.3, 0.4)]
    return f"{t}, {', '.join(poses)}"


AXES = ("pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w")
DEVICES = ("left", "right", "head", "marker")
HEADER = ", ".join(["timestamp", *(f"{device}_{axis}" for device in DEVICES for axis in AXES)])
EVENTS = """324.9251, target plane transform 0.145153 0.9885641 0.335235 0 0 0 1
324.9251, grid mapping [0 0 0 -0.125 0.125 0.02 1.11 0.33] [1 0 1 0 0.125 0.14 1.11 0.33]
329.0148, target_spawn, target ID 0, grid ID 4
329.4, target_contact, target ID 0, grid ID 4, velocity -0.4 2.5E-05 0.7912978
329.7, target_hit, target ID 0, grid ID 4, velocity -0.4 0.01 1.321925
329.8, bomb_detonate, 3, 0 0 0
388.9437, episode statistics, contacts 1, hits 1, misses 0, hit rate 1
"""


def write_log(folder: Path, title: str = "condition medium, random seed 859190") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    rows = [state_row(t) for t in ("324.9251", "328.9481", "328.9620", "328.976")]
    (folder / "states.csv").write_text("\r\n".join([title, HEADER, *rows]) + "\r\n")
    (folder / "events.csv").write_text(EVENTS)
    return folder


def test_the_originals_log(tmp_path: Path) -> None:
    recording = read_session(write_log(tmp_path / "13-39-48-medium"))
    assert recording.name == "13-39-48-medium"
    assert (recording.app.condition, recording.seed) == ("medium", 859190)
    assert (recording.app.kind, recording.app.name) == ("game", "whacamole")
    assert constrained(recording)
    assert (recording.time_ns / 1e9).tolist() == [324.9251, 328.9481, 328.962, 328.976]
    assert recording.left is None  # which was not used
    assert recording.right is not None and recording.right.grip[0, 0] == 0.2
    assert recording.head[0, 0] == 0.3
    assert recording.objects["marker"][0, 0] == 0.4
    plane = plane_of(recording)
    assert plane is not None
    assert plane.tolist() == [0.145153, 0.9885641, 0.335235, 0.0, 0.0, 0.0, 1.0]
    assert target_events(recording) == (
        Event(329.0148, "spawn", 0, 4),
        Event(329.4, "contact", 0, 4, (-0.4, 2.5e-05, 0.7912978)),
        Event(329.7, "hit", 0, 4, (-0.4, 0.01, 1.321925)),
    )


def packed(folder: Path, **changes: object) -> Path:
    t = np.array([10.0, 14.0, 14.014, 14.028])
    pose = np.tile(np.array([0, 1.2, 0, 0, 0, 0, 1], dtype=np.float32), (4, 1))
    folder.mkdir(exist_ok=True)
    np.savez(
        folder / "77_low.npz",
        t=t,
        right=pose + np.float32([0.1, 0, 0, 0, 0, 0, 0]),
        head=pose,
        marker=pose,
    )
    (folder / "77_low_events.csv").write_text(
        "t,type,target_id,grid_id,vx,vy,vz\n14.014,spawn,0,3,,,\n15.0,contact,0,3,1,2,3\n"
    )
    trial = {
        "file": "77_low",
        "condition": "low",
        "constrained": False,
        "seed": 5,
        "fixed_timestep": 0.014285714,
        **changes,
    }
    (folder / "manifest.json").write_text(json.dumps({"trials": [trial]}))
    return folder


def test_the_packed_form(tmp_path: Path) -> None:
    folder = packed(tmp_path / "rounds")
    (recording,) = read_sessions(folder)
    assert read_session(folder / "77_low.npz").events == recording.events
    assert (recording.name, recording.app.condition) == ("77_low", "low-unconstrained")
    assert timing_of(recording).clock.fixed_delta_time_s == 0.014285714
    assert recording.right is not None and recording.right.grip.dtype == np.float64
    assert target_events(recording) == (
        Event(14.014, "spawn", 0, 3),
        Event(15.0, "contact", 0, 3, (1.0, 2.0, 3.0)),
    )


def error_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_sessions(path)
    return str(caught.value)


def test_errors_say_where_and_what(tmp_path: Path) -> None:
    assert error_of(tmp_path / "no").endswith("expected a file or folder that exists")
    assert "states.csv and events.csv" in error_of(tmp_path)
    log = write_log(tmp_path / "log", "condition medium")
    assert "states.csv, line 1: got 'condition medium', expected 'condition C, ran" in error_of(log)
    write_log(log)
    text = (log / "states.csv").read_text().replace("328.9620, 0.1", "328.9620, zero")
    (log / "states.csv").write_text(text)
    assert "states.csv, line 5: got '328.9620, zero" in error_of(log)
    write_log(log)
    (log / "events.csv").write_text(EVENTS.replace("grid ID 4\n", "grid ID 9\n"))
    found = error_of(log)
    assert "events.csv, line 3: got '329.0148, target_spawn, target id 0, grid id 9'" in found
    (log / "events.csv").write_text(EVENTS.replace("velocity -0.4 2.5E-05", "velocity 1E999 2"))
    found = error_of(log)
    assert "events.csv, line 4: got 'velocity 1E999 2 0.7912978', expected finite" in found
    rounds = packed(tmp_path / "rounds", file="78_low")
    assert "no trial '77_low'" in error_of(rounds / "77_low.npz")
    assert "78_low.npz" in error_of(rounds)
    (rounds / "manifest.json").unlink()
    assert error_of(rounds / "77_low.npz") == (
        f"PATH: got '{rounds}/77_low.npz', expected a manifest.json beside it, which has its "
        "condition and seed"
    )
    assert "events.csv: got another file, expected a session" in error_of(log / "events.csv")


def test_logs_of_pointing_are_no_rounds_of_whacamole(tmp_path: Path) -> None:
    (write_log(tmp_path) / "events.csv").write_text(
        "0, block_start, block 0, distance 0.2, width 0.03\n"
        "0, target_spawn, target ID 0, grid ID 0, block 0, trial 0, center 0 0.1\n"
    )
    assert read_session(tmp_path).app.name == "pointing"
