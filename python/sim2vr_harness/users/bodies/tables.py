"""Reads the number tables that describe a user model and the VR hardware.

The tables are plain CSV and JSON files inside the package, so that a user model can be inspected
in a spreadsheet and a new one can be added without writing XML. Cells that hold a vector list its
numbers separated by spaces.

Units: m, kg, s, rad, N. Quaternions are w x y z. World frame: z up, x forward, y left (MuJoCo).
"""

import csv
import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, Literal

Vector = tuple[float, ...]


@dataclass(frozen=True)
class BodyRow:
    """One rigid body: pose in its parent (m, wxyz), mass (kg) and inertia (kg m^2)."""

    name: str
    parent: str
    pos: Vector
    quat_wxyz: Vector
    mass: float
    com: Vector
    inertia_quat_wxyz: Vector
    inertia: Vector


@dataclass(frozen=True)
class JointRow:
    """One joint. `limits` (rad; slides m) is None for a joint that only its coupling holds."""

    name: str
    body: str
    kind: Literal["hinge", "slide"]
    axis: Vector
    limits: Vector | None
    stiffness: float
    damping: float
    armature: float
    pos: Vector = (0.0, 0.0, 0.0)
    """Where it is in the body's frame, m."""


@dataclass(frozen=True)
class CouplingRow:
    """q_dependent = sum_k coefficients[k] * q_driver^k; no driver means q_dependent = c0."""

    dependent: str
    driver: str
    coefficients: Vector
    solimp: Vector


@dataclass(frozen=True)
class MuscleRow:
    """One muscle: peak isometric force (N), operating length range (m), path as point names."""

    name: str
    peak_force: float
    length_range: Vector
    path: tuple[str, ...]


@dataclass(frozen=True)
class MotorRow:
    """A position servo: kp (Nm/rad), kd (Nm s/rad), range of target angles (rad).

    `torques` (Nm) are its limits, None for one without.
    """

    name: str
    joint: str
    kp: float
    kd: float
    limits: Vector
    torques: Vector | None = None


@dataclass(frozen=True)
class PointRow:
    """A point of a muscle path, fixed to `body` at `pos` (m, body frame)."""

    name: str
    body: str
    pos: Vector


@dataclass(frozen=True)
class BoneRow:
    """A bone seen as a capsule in the frame of `body` (m): for drawing only, it has no mass."""

    name: str
    body: str
    end1: Vector
    end2: Vector
    radius: float


@dataclass(frozen=True)
class ModelTables:
    """Everything that defines one user model; `settings` is the content of model.json."""

    bodies: tuple[BodyRow, ...]
    joints: tuple[JointRow, ...]
    couplings: tuple[CouplingRow, ...]
    muscles: tuple[MuscleRow, ...]
    motors: tuple[MotorRow, ...]
    points: tuple[PointRow, ...]
    bones: tuple[BoneRow, ...]
    settings: dict[str, Any]


@dataclass(frozen=True)
class TorsoTables:
    """Trunk and neck that move, for bodies whose own do not."""

    bodies: tuple[BodyRow, ...]
    joints: tuple[JointRow, ...]
    motors: tuple[MotorRow, ...]


@dataclass(frozen=True)
class DeviceRow:
    """A VR device held rigidly by a body of the user.

    `pos`/`quat_wxyz`: device frame (x forward, y left, z up) in the skull or hand (m).
    `openxr_offset` (m, device frame) leads from the tracked device frame to the pose that the
    OpenXR runtime reports to the application.
    `box_min`/`box_max` (m, device frame) bound its housing, for drawing.
    """

    name: str
    pos: Vector
    quat_wxyz: Vector
    mass: float
    com: Vector
    inertia_quat_wxyz: Vector
    inertia: Vector
    openxr_offset: Vector
    box_min: Vector
    box_max: Vector


def _file(*path: str) -> Traversable:
    return resources.files("sim2vr_harness.users").joinpath("data", *path)


def _text(*path: str) -> str:
    return _file(*path).read_text(encoding="utf-8")


def _rows(folder: str, file: str, optional: bool = False) -> list[dict[str, str]]:
    if optional and not _file(folder, file).is_file():
        return []
    return list(csv.DictReader(_text(folder, file).splitlines()))


def _vector(cell: str) -> Vector:
    return tuple(float(number) for number in cell.split())


def _bodies(folder: str) -> tuple[BodyRow, ...]:
    return tuple(
        BodyRow(
            name=r["body"],
            parent=r["parent"],
            pos=_vector(r["pos_m"]),
            quat_wxyz=_vector(r["quat_wxyz"]),
            mass=float(r["mass_kg"]),
            com=_vector(r["com_m"]),
            inertia_quat_wxyz=_vector(r["inertia_quat_wxyz"]),
            inertia=_vector(r["inertia_kgm2"]),
        )
        for r in _rows(folder, "bodies.csv")
    )


def _joints(folder: str) -> tuple[JointRow, ...]:
    return tuple(
        JointRow(
            name=r["joint"],
            body=r["body"],
            kind="slide" if r.get("type") == "slide" else "hinge",
            axis=_vector(r["axis"]),
            limits=_vector(r["range_rad"]) or None,
            stiffness=float(r["stiffness_Nm_per_rad"]),
            damping=float(r["damping_Nms_per_rad"]),
            armature=float(r["armature_kgm2"]),
            pos=_vector(r.get("pos_m", "0.0 0.0 0.0")),
        )
        for r in _rows(folder, "joints.csv")
    )


def _motors(folder: str) -> tuple[MotorRow, ...]:
    return tuple(
        MotorRow(
            name=r["motor"],
            joint=r["joint"],
            kp=float(r["kp_Nm_per_rad"]),
            kd=float(r["kd_Nms_per_rad"]),
            limits=_vector(r["range_rad"]),
            torques=_vector(r.get("torque_Nm", "")) or None,
        )
        for r in _rows(folder, "motors.csv", optional=True)
    )


@cache
def load_model_tables(folder: str) -> ModelTables:
    """Reads the tables of one user model from the package folder `data/<folder>`."""
    points = tuple(
        PointRow(r["point"], r["body"], _vector(r["pos_m"]))
        for r in _rows(folder, "muscle_points.csv", optional=True)
    )
    paths: dict[str, list[str]] = {}
    for r in _rows(folder, "muscle_points.csv", optional=True):
        paths.setdefault(r["muscle"], []).append(r["point"])
    return ModelTables(
        bodies=_bodies(folder),
        joints=_joints(folder),
        couplings=tuple(
            CouplingRow(
                r["dependent"], r["driver"], _vector(r["coefficients"]), _vector(r["solimp"])
            )
            for r in _rows(folder, "couplings.csv")
        ),
        muscles=tuple(
            MuscleRow(
                name=r["muscle"],
                peak_force=float(r["peak_force_N"]),
                length_range=_vector(r["length_range_m"]),
                path=tuple(paths[r["muscle"]]),
            )
            for r in _rows(folder, "muscles.csv", optional=True)
        ),
        motors=_motors(folder),
        points=points,
        bones=tuple(
            BoneRow(
                r["bone"],
                r["body"],
                _vector(r["end1_m"]),
                _vector(r["end2_m"]),
                float(r["mean_radius_m"]),
            )
            for r in _rows(folder, "bones.csv")
        ),
        settings=load_settings(folder),
    )


@cache
def load_torso_tables() -> TorsoTables:
    """Reads the tables of trunk and neck, `data/torso`; every row names its source."""
    return TorsoTables(_bodies("torso"), _joints("torso"), _motors("torso"))


def load_settings(folder: str) -> dict[str, Any]:
    """Reads model.json of the package folder `data/<folder>`."""
    settings: dict[str, Any] = json.loads(_text(folder, "model.json"))
    return settings


@cache
def load_device_rows() -> dict[str, DeviceRow]:
    """Reads the VR hardware (Meta Quest 1) table; keys are device names."""
    devices = json.loads(_text("hardware.json"))["devices"]
    return {
        name: DeviceRow(
            name=name,
            pos=tuple(d["pos_m"]),
            quat_wxyz=tuple(d["quat_wxyz"]),
            mass=d["mass_kg"],
            com=tuple(d["com_m"]),
            inertia_quat_wxyz=tuple(d["inertia_quat_wxyz"]),
            inertia=tuple(d["inertia_kgm2"]),
            openxr_offset=tuple(d["openxr_offset_m"]),
            box_min=tuple(d["box_min_m"]),
            box_max=tuple(d["box_max_m"]),
        )
        for name, d in devices.items()
    }
