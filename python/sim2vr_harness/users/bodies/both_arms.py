"""Both arms of a body that has tables of one: the other is its mirror image.

The arm's bodies, joints, muscles and points get `_r` and `_l` behind their names; thorax and skull
are shared. The left arm is what `mirror` makes of the right one, and so is the controller in it, so
equal angles and activations left and right make mirrored postures and forces.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from sim2vr_harness.users.bodies.mirror import mirror, swapped
from sim2vr_harness.users.bodies.table_spec import build_spec
from sim2vr_harness.users.bodies.tables import (
    BodyRow,
    BoneRow,
    CouplingRow,
    DeviceRow,
    JointRow,
    ModelTables,
    MuscleRow,
    PointRow,
    Vector,
)

_SHARED = ("world", "thorax", "skull")


def both_arms(
    one: ModelTables, held: DeviceRow, settings: Mapping[str, Any]
) -> tuple[ModelTables, DeviceRow]:
    """Returns the tables of a body with two arms, and the device in the other hand.

    Args:
        one: the body with a right arm.
        held: the controller in its right hand.
        settings: what the new body's model.json says; the rest is the old one's.
    """
    left = _mirrored(one, held)
    arms = [_Arm("_r", one, None), _Arm("_l", one, left)]
    shared_joints = tuple(row for row in one.joints if row.body in _SHARED)
    fixed = {row.name for row in shared_joints}
    tables = ModelTables(
        bodies=(
            *(row for row in one.bodies if row.name in _SHARED),
            *(row for arm in arms for row in arm.bodies()),
        ),
        joints=(*shared_joints, *(row for arm in arms for row in arm.joints())),
        couplings=(
            *(row for row in one.couplings if row.dependent in fixed),
            *(row for arm in arms for row in arm.couplings(fixed)),
        ),
        muscles=tuple(row for arm in arms for row in arm.muscles()),
        motors=(),
        points=tuple(row for arm in arms for row in arm.points()),
        bones=(
            *(row for row in one.bones if row.body in _SHARED),
            *(row for arm in arms for row in arm.bones()),
        ),
        settings={
            **one.settings,
            "sites": [row for arm in arms for row in arm.sites()],
            "anatomy": _anatomy(one.settings["anatomy"]),
            "lifting": [f"{name}{arm.side}" for arm in arms for name in one.settings["lifting"]],
            **settings,
        },
    )
    hand_name = swapped(held.name)
    body = left.body(hand_name)
    flip = np.array([1.0, -1.0, 1.0])  # devices' frames have y to the left
    low, high = np.array(held.box_min) * flip, np.array(held.box_max) * flip
    other_hand = DeviceRow(
        name=hand_name,
        pos=_numbers(body.pos),
        quat_wxyz=_numbers(body.quat),
        mass=held.mass,
        com=_numbers(body.ipos),
        inertia_quat_wxyz=_numbers(body.iquat),
        inertia=_numbers(body.inertia),
        openxr_offset=_numbers(left.site(hand_name).pos),
        box_min=_numbers(np.minimum(low, high)),
        box_max=_numbers(np.maximum(low, high)),
    )
    return tables, other_hand


class _Arm:
    """One arm's rows, renamed; `model` is the mirrored body, None: as the tables have it."""

    def __init__(self, side: str, one: ModelTables, model: mujoco.MjModel | None) -> None:
        self.side, self._one, self._model = side, one, model

    def _named(self, name: str) -> str:
        return name if name in _SHARED else name + self.side

    def bodies(self) -> list[BodyRow]:
        rows = [row for row in self._one.bodies if row.name not in _SHARED]
        if self._model is not None:
            rows = [_body(row, self._model) for row in rows]
        return [
            replace(row, name=self._named(row.name), parent=self._named(row.parent)) for row in rows
        ]

    def joints(self) -> list[JointRow]:
        rows = [row for row in self._one.joints if row.body not in _SHARED]
        if self._model is not None:
            rows = [replace(row, axis=_numbers(self._model.joint(row.name).axis)) for row in rows]
        return [
            replace(row, name=self._named(row.name), body=self._named(row.body)) for row in rows
        ]

    def couplings(self, fixed: set[str]) -> list[CouplingRow]:
        rows = (row for row in self._one.couplings if row.dependent not in fixed)
        return [
            replace(row, dependent=self._named(row.dependent), driver=self._named(row.driver))
            for row in rows
        ]

    def muscles(self) -> list[MuscleRow]:
        return [
            replace(row, name=self._named(row.name), path=tuple(map(self._named, row.path)))
            for row in self._one.muscles
        ]

    def points(self) -> list[PointRow]:
        return [
            PointRow(self._named(row.name), self._named(row.body), self._place(row.name, row.pos))
            for row in self._one.points
        ]

    def bones(self) -> list[BoneRow]:
        rows = (row for row in self._one.bones if row.body not in _SHARED)
        return [
            replace(
                row,
                name=self._named(row.name),
                body=self._named(row.body),
                end1=self._place(f"{row.name} end1", row.end1),
                end2=self._place(f"{row.name} end2", row.end2),
            )
            for row in rows
        ]

    def sites(self) -> list[dict[str, Any]]:
        rows = []
        for row in self._one.settings["sites"]:
            pos, quat = tuple(row["pos_m"]), tuple(row["quat_wxyz"])
            if self._model is not None:
                site = self._model.site(row["name"])
                pos, quat = _numbers(site.pos), _numbers(site.quat)
            body, name = self._named(row["body"]), self._named(row["name"])
            rows.append({"name": name, "body": body, "pos_m": pos, "quat_wxyz": quat})
        return rows

    def _place(self, site: str, own: Vector) -> Vector:
        return own if self._model is None else _numbers(self._model.site(site).pos)


def _mirrored(one: ModelTables, held: DeviceRow) -> mujoco.MjModel:
    """The left-hander, with sites where the bones end."""
    spec = build_spec(one, [(held, one.settings["devices"][held.name])], None)
    for row in one.bones:
        for end in ("end1", "end2"):
            spec.body(row.body).add_site(name=f"{row.name} {end}", pos=getattr(row, end))
    mirror(spec)
    return spec.compile()


def _body(row: BodyRow, model: mujoco.MjModel) -> BodyRow:
    body = model.body(row.name)
    return replace(
        row,
        pos=_numbers(body.pos),
        quat_wxyz=_numbers(body.quat),
        com=_numbers(body.ipos),
        inertia_quat_wxyz=_numbers(body.iquat),
        inertia=_numbers(body.inertia),
    )


def _anatomy(table: dict[str, Any]) -> dict[str, Any]:
    segments = {
        name: {
            "bodies": [f"{body}{side}" for body in row["bodies"] for side in ("_r", "_l")],
            "start": f"{row['start']}_r",
            "end": f"{row['end']}_r",
        }
        for name, row in table["segments"].items()
    }
    return {**table, "segments": segments}


def _numbers(values: Any) -> Vector:
    return tuple(np.asarray(values, dtype=np.float64).tolist())
