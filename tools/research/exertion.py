"""Compares the exertion measures with published effects and with people's ratings.

    python tools/research/exertion.py curves
    python tools/research/exertion.py postures
    python tools/research/exertion.py recordings FOLDER RATINGS.csv
    python tools/research/exertion.py user whacamole_constrained --episodes 3

Prints Markdown tables; docs/evidence/body_and_alignment.md holds them. FOLDER has packed
rounds of Whac-A-Mole, RATINGS.csv the columns scale, group, placement, mean.
"""

import argparse
import csv
import tempfile
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from statistics import mean

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.stats import spearmanr

from sim2vr_harness.audit.postures import hold
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.tools.track.paths import RecordedPath, read_paths
from sim2vr_harness.tools.track.registration import place
from sim2vr_harness.users import FATIGUE_PRESETS, Body, CumulativeFatigue3CCr, load_body
from sim2vr_harness.users.exertion import (
    ArmDynamics,
    ConsumedEnduranceMeter,
    NicerMeter,
    Strength,
    arms_of,
    consumed_endurance_time,
    endurance_time,
    fatigue_endurance_time,
)
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import solve

FloatArray = NDArray[np.float64]

DT_S = 0.05
MODELS = ("3CC-r, reference", "3CC-r, shoulder", "NICER", "Consumed Endurance")
PLACEMENTS = ("low", "mid", "high")
GROUPS = {"constrained": range(1, 31), "unconstrained": range(31, 61)}
"""Groups of participants by their numbers."""
START_DEG = {"elv_angle": 60.0, "shoulder_elv": 40.0, "elbow_flexion": 90.0}


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a Markdown table."""
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for row in rows:
        print("| " + " | ".join(map(_text, row)) + " |")
    print()


def _text(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if np.isinf(value):
        return "endless"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def curves() -> None:
    """Endurance by load: E10, E21."""
    rows = []
    for share in (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8):
        people = float(endurance_time(share))
        times = [
            float(fatigue_endurance_time(share, rates["fatigue"], rates["recovery"]))
            for rates in FATIGUE_PRESETS.values()
        ]
        times.append(float(consumed_endurance_time(share)))
        rows.append([f"{share:.2f}", people, *(f"{_text(t)} ({t / people:.2f})" for t in times)])
    table(["share of maximum", "people (s)", *MODELS[:2], MODELS[3]], rows)


def postures() -> None:
    """Endurance of an outstretched arm by its elevation: E9, and E11 above the shoulder."""
    for body, (plane, name) in product(
        ("mobl_arms_wrist", "myoarm_r"), ((90, "flexion"), (0, "abduction"))
    ):
        print(f"{body}, {name}:\n")
        rows = []
        for elevation in (30, 60, 90, 120, 150):
            pose = f"elv_angle={plane},shoulder_elv={elevation},elbow_flexion=5"
            (held,) = hold(UserConfig(model=body), pose)
            share = "none" if held.share is None else held.share
            times = [held.endurance_s[model] for model in MODELS]
            rows.append([elevation, held.torque_nm, share, held.strength_share, *times])
        heads = ["degrees", "torque (Nm)", "muscles' share", "torque's share", *MODELS]
        table(heads, rows)


def exertion_of(body: Body, paths: Sequence[RecordedPath]) -> list[dict[str, float]]:
    """What the models say of recorded rounds: per cent, of 3CC-r of fatigued motor units.

    The arm follows the recorded controller by inverse kinematics from one moment to the next,
    which leaves the turn of the elbow about the line from shoulder to hand to it.
    """
    (arm,) = arms_of(body)
    linkage = Linkage(body, Point(arm.device))
    hands = [_hand(body, path) for path in paths]
    steps = min(map(len, hands))
    targets = np.stack([hand[:steps] for hand in hands], axis=1)
    rest = np.radians([START_DEG.get(joint, 0.0) for joint in linkage.joints])
    now = np.tile(np.clip(rest, *linkage.limits.T), (len(paths), 1))
    now = solve(linkage, targets[0], now, iterations=200)[0]
    angles = np.empty((steps, *now.shape))
    for row, target in zip(angles, targets, strict=True):
        now = row[:] = solve(linkage, target, now, iterations=15, close_m=1e-3)[0]
    columns = [body.independent_joints.index(joint) for joint in linkage.joints]
    dynamics = ArmDynamics(body.physics_model, arm)
    return [_exertion(body, dynamics, columns, angles[:, i]) for i in range(len(paths))]


def _hand(body: Body, path: RecordedPath) -> FloatArray:
    """(T, 3) where the right controller is, every DT_S, in the body's world."""
    where = place(path, _head(body)).places(path.hands["controller_right"])
    times = np.arange(path.times_s[0], path.times_s[-1], DT_S)
    return np.stack([np.interp(times, path.times_s, axis) for axis in where.T], axis=1)


def _exertion(
    body: Body, dynamics: ArmDynamics, columns: list[int], angles: FloatArray
) -> dict[str, float]:
    """What the models say of one motion, angles (T, K)."""
    strength = Strength()
    smooth, speed, acceleration = (
        savgol_filter(angles, 7, 3, deriv=order, delta=DT_S, axis=0) for order in range(3)
    )
    nicer, consumed = NicerMeter(1), ConsumedEnduranceMeter(1)
    fatigue = [
        CumulativeFatigue3CCr(
            1, 1, dt=DT_S, r=rates["r"], fatigue=rates["fatigue"], recovery=rates["recovery"]
        )
        for rates in FATIGUE_PRESETS.values()
    ]
    for q, v, a in zip(smooth, speed, acceleration, strict=True):
        load = dynamics.load(*_moving(body, columns, q, v, a))
        torque, shoulder, elbow = np.array([[load.torque], [load.shoulder_deg], [load.elbow_deg]])
        nicer.update(torque, shoulder, elbow, DT_S)
        consumed.update(torque, DT_S)
        share = np.clip(torque / strength.shoulder_torque(shoulder, elbow), 0.0, 1.0)[:, None]
        for model in fatigue:
            model.update(share, share)
    tired = [100.0 * float(model.max_fatigued()[0]) for model in fatigue]
    return dict(zip(MODELS, [*tired, float(nicer.value[0]), float(consumed.value[0])], strict=True))


def _head(body: Body) -> FloatArray:

    data = mujoco.MjData(body.physics_model)
    mujoco.mj_kinematics(body.physics_model, data)
    return np.array(data.site("headset").xpos)


def _moving(
    body: Body, columns: list[int], q: FloatArray, v: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angles, velocities and accelerations of all joints, by differences along the motion."""
    step = 1e-3

    def at(t: float) -> FloatArray:
        angles = np.zeros(len(body.independent_joints))
        angles[columns] = q + v * t + 0.5 * a * t * t
        return body.coupled_qpos(angles)

    before, now, after = at(-step), at(0.0), at(step)
    return now, (after - before) / (2.0 * step), (after - 2.0 * now + before) / step**2


def recordings(folder: Path, ratings: Path) -> None:
    """People's recorded rounds beside their ratings: E15."""
    body = load_body("mobl_arms_wrist", appearance=False)
    paths = [path for path in read_paths(folder) if path.name.partition("_")[2] in PLACEMENTS]
    rounds: dict[tuple[str, str], list[dict[str, float]]] = {}
    for path, found in zip(paths, exertion_of(body, paths), strict=True):
        number, _, placement = path.name.partition("_")
        group = next(name for name, members in GROUPS.items() if int(number) in members)
        rounds.setdefault((group, placement), []).append(found)
    rated = list(csv.DictReader(line for line in ratings.open() if not line.startswith("#")))
    cells = [cell for cell in product(GROUPS, PLACEMENTS) if cell in rounds]
    borg = {
        scale: [
            next(
                float(row["mean"])
                for row in rated
                if (row["scale"], row["group"], row["placement"]) == (scale, *cell)
            )
            for cell in cells
        ]
        for scale in ("full", "arm")
    }
    means = {
        model: [mean(one[model] for one in rounds[cell]) for cell in cells] for model in MODELS
    }
    rows = [
        [*cell, len(rounds[cell]), borg["full"][i], borg["arm"][i], *(means[m][i] for m in MODELS)]
        for i, cell in enumerate(cells)
    ]
    table(["group", "placement", "rounds", "Borg, body", "Borg, arm", *MODELS], rows)
    rows = [
        [scale, *(float(spearmanr(borg[scale], means[model])[0]) for model in MODELS)]
        for scale in borg
    ]
    table(["rank correlation with Borg", *MODELS], rows)


def user(name: str, episodes: int) -> None:
    """A trained user's rounds by placement: E15."""
    from sim2vr_harness import evaluate

    rows = []
    with tempfile.TemporaryDirectory() as out:
        found = evaluate(
            name, conditions=["low", "medium", "high"], episodes=episodes, out=out, steps=False
        )
    for condition, summary in found.summaries.items():
        names = ("exertion.nicer_right", "exertion.consumed_endurance_right", "max_fatigued")
        rows.append(
            [condition, *(f"{_text(summary[n])} ± {_text(summary[f'{n}_sd'])}" for n in names)]
        )
    table([name, "NICER (%)", "Consumed Endurance (%)", "fatigued motor units"], rows)


def main() -> None:
    """Run what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = parser.add_subparsers(dest="what", required=True)
    what.add_parser("curves")
    what.add_parser("postures")
    recorded = what.add_parser("recordings")
    recorded.add_argument("folder", type=Path)
    recorded.add_argument("ratings", type=Path)
    simulated = what.add_parser("user")
    simulated.add_argument("name")
    simulated.add_argument("--episodes", type=int, default=3)
    args = parser.parse_args()
    if args.what == "recordings":
        recordings(args.folder, args.ratings)
    elif args.what == "user":
        user(args.name, args.episodes)
    else:
        {"curves": curves, "postures": postures}[args.what]()


if __name__ == "__main__":
    main()
