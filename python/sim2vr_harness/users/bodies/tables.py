"""Reads the number tables that describe a user model and the VR hardware.

The tables are plain CSV and JSON files inside the package, so that a user model can be inspected
in a spreadsheet and a new one can be added without writing XML. Cells that hold a vector list its
numbers separated by spaces.

Units: m, kg, s, rad, N. Quaternions are w x y z. World frame: z up, x forward, y left (MuJoCo).
"""

import csv
import json
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, TypeVar, get_type_hints

import mujoco

Vector = tuple[float, ...]
Row = TypeVar("Row", bound=Any)


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
    axis: Vector
    limits: Vector | None
    stiffness: float
    damping: float
    armature: float
    kind: str = "hinge"
    """``hinge`` or ``slide``."""
    pos: Vector = (0.0, 0.0, 0.0)
    """Position in the segment's frame, m."""


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
    path: tuple[str, ...] = ()


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
    """A point of a muscle's path, fixed to `body` at `pos` (m, body frame)."""

    name: str
    body: str
    pos: Vector
    muscle: str


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

    def attach(
        self, parent: mujoco.MjsBody, position: Vector, quaternion: Vector, weight: bool = True
    ) -> None:
        """Adds the device to the body that wears it: a rigid child body and a site, so called.

        Departure from the reference, which holds free bodies by soft welds that slip by 1.9 mm on
        average and start every episode at the pose of the zero posture (SIM2VR paper's release).

        Args:
            parent: the body.
            position: of the device's frame (x forward, y left, z up) in the parent's, m.
            quaternion: w x y z.
            weight: whether it has the device's mass; without, only its pose is known.
        """
        body = parent.add_body(name=self.name, pos=position, quat=quaternion)
        if weight:
            body.mass = self.mass
            body.ipos = self.com
            body.iquat = self.inertia_quat_wxyz
            body.inertia = self.inertia
            body.explicitinertial = True
        body.add_site(name=self.name, pos=self.openxr_offset, size=[0.004] * 3, group=4)


def _file(*path: str) -> Traversable:
    return resources.files("sim2vr_harness.users").joinpath("data", *path)


def _text(*path: str) -> str:
    return _file(*path).read_text(encoding="utf-8")


def _rows(
    folder: str, row: type[Row], table: tuple[str, str], optional: bool = False
) -> tuple[Row, ...]:
    """Rows of a table: what the columns are called, in the order of the fields, and the file.

    Fields whose column a table does not have keep their defaults.
    """
    columns, file = table
    if optional and not _file(folder, file).is_file():
        return ()
    kinds = get_type_hints(row)
    named = list(zip(fields(row), columns.split(), strict=False))

    def parsed(cells: dict[str, str]) -> Row:
        values: dict[str, Any] = {}
        for field, column in named:
            if (cell := cells.get(column)) is not None:
                kind = kinds[field.name]
                vector = kind not in (float, str)
                values[field.name] = _vector(cell) or None if vector else kind(cell)
        return row(**values)

    return tuple(parsed(cells) for cells in csv.DictReader(_text(folder, file).splitlines()))


def _vector(cell: str) -> Vector:
    return tuple(float(number) for number in cell.split())


_BODIES = "body parent pos_m quat_wxyz mass_kg com_m inertia_quat_wxyz inertia_kgm2", "bodies.csv"
_JOINTS = (
    "joint body axis range_rad stiffness_Nm_per_rad damping_Nms_per_rad armature_kgm2 type pos_m",
    "joints.csv",
)
_MOTORS = "motor joint kp_Nm_per_rad kd_Nms_per_rad range_rad torque_Nm", "motors.csv"


@cache
def load_model_tables(folder: str) -> ModelTables:
    """Reads the tables of one user model from the package folder `data/<folder>`."""
    points = _rows(folder, PointRow, ("point body pos_m muscle", "muscle_points.csv"), True)
    muscles = _rows(folder, MuscleRow, ("muscle peak_force_N length_range_m", "muscles.csv"), True)
    couplings = "dependent driver coefficients solimp", "couplings.csv"
    return ModelTables(
        bodies=_rows(folder, BodyRow, _BODIES),
        joints=_rows(folder, JointRow, _JOINTS),
        couplings=_rows(folder, CouplingRow, couplings),
        muscles=tuple(
            replace(each, path=tuple(point.name for point in points if point.muscle == each.name))
            for each in muscles
        ),
        motors=_rows(folder, MotorRow, _MOTORS, True),
        points=points,
        bones=_rows(folder, BoneRow, ("bone body end1_m end2_m mean_radius_m", "bones.csv")),
        settings=load_settings(folder),
    )


@cache
def load_torso_tables() -> TorsoTables:
    """Reads the tables of trunk and neck, `data/torso`; every row names its source."""
    return TorsoTables(
        _rows("torso", BodyRow, _BODIES),
        _rows("torso", JointRow, _JOINTS),
        _rows("torso", MotorRow, _MOTORS),
    )


def load_settings(folder: str) -> dict[str, Any]:
    """Reads model.json of the package folder `data/<folder>`."""
    settings: dict[str, Any] = json.loads(_text(folder, "model.json"))
    return settings


@cache
def load_device_rows() -> dict[str, DeviceRow]:
    """Reads the VR hardware (Meta Quest 1) table; keys are device names."""
    devices = json.loads(_text("hardware.json"))["devices"]
    keys = ["pos_m", "quat_wxyz", "mass_kg", "com_m", "inertia_quat_wxyz", "inertia_kgm2"]
    keys += ["openxr_offset_m", "box_min_m", "box_max_m"]

    def value(content: Any) -> Any:
        return tuple(content) if isinstance(content, list) else content

    return {name: DeviceRow(name, *(value(d[key]) for key in keys)) for name, d in devices.items()}
