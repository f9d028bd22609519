"""Record tests/data/whacamole_reaches: reaches with the timing of a person, made by this script.

About once a second a hand waits for its reaction time, moves to the plane of the targets along a
minimum-jerk path, and withdraws. It does not aim at the targets that are there, so it hits few.
The recordings are Whac-A-Mole's logs of those rounds.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from sim2vr_harness.client import DevicePoses, InProcessApp, frame_time_ns

HEAD = np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0])
REST = np.array([0.15, 1.03, 0.15])
RATE_HZ, ROUND_S = 20, 6.0
MOVEMENT_S = 0.45  # usual for reaches to a target that appears
PERSONS = {"person_1": (5, 0.25), "person_2": (6, 0.32)}  # seed, reaction time in s


def hand(time_s: float, seed: int, reaction_s: float) -> np.ndarray:
    """Strike about once a second, at places that spread as a person's endpoints do."""
    number, phase = divmod(time_s, 1.1)
    spread = np.random.default_rng([seed, int(number)]).normal(0.0, [0.06, 0.06, 0.005])
    target = np.array([0.15, 1.03, 0.38]) + spread
    share = min(max((phase - reaction_s) / MOVEMENT_S, 0.0), 1.0)
    if phase > reaction_s + MOVEMENT_S:
        share = max(1.0 - (phase - reaction_s - MOVEMENT_S) / 0.4, 0.0)
    eased = 10 * share**3 - 15 * share**4 + 6 * share**5
    return np.concatenate([REST + eased * (target - REST), [0.0, 0.0, 0.0, 1.0]])


def record(out: Path, seed: int, reaction_s: float) -> None:
    with tempfile.TemporaryDirectory() as place:
        options = {"condition": "medium", "round_seconds": ROUND_S}
        with InProcessApp("whacamole", options, renderer="null", log_dir=Path(place)) as app:
            reply = app.reset(seed, DevicePoses(HEAD, hand(0.0, seed, reaction_s)), time_ns=0)
            frame = 0
            while not reply.finished:
                frame += 1
                now = frame_time_ns(frame, RATE_HZ)
                poses = DevicePoses(HEAD[None], hand(now / 1e9, seed, reaction_s)[None])
                reply = app.step_frames(np.array([now]), poses)
        (log,) = Path(place).iterdir()
        out.mkdir(parents=True, exist_ok=True)
        for file in log.glob("*.csv"):
            shutil.copy(file, out / file.name)


if __name__ == "__main__":
    for name, (seed, reaction_s) in PERSONS.items():
        record(Path(sys.argv[1]) / name / "round_1", seed, reaction_s)
