"""A trunk and a neck that move, for bodies whose thorax and skull do not: `torso: true`.

Three hinges each, at the lumbosacral and the cervicothoracic joint, worked by position servos with
limited torque. What hangs on the thorax (both arms, the head) moves with it; pelvis, legs and seat
stay. Numbers and their sources: `data/torso`, docs/reference/bodies.md.

The arm models have four "phantom" bodies an arm, which weigh nothing and have an inertia of
1 kg m^2 about every axis: an artefact of their conversion, which on a thorax that turns would be
ten times the trunk's own. Two of them only undo rotations, so their inertia has no effect on the
arm and goes. The third turns with elv_angle alone, where the same inertia becomes armature. The
fourth's effect depends on the posture, so it stays: the arm's effective inertia is what it is
without a torso.
"""

from dataclasses import replace

from sim2vr_harness.users.bodies.tables import (
    BodyRow,
    JointRow,
    ModelTables,
    load_torso_tables,
)

TORSO_MOTORS: tuple[str, ...] = tuple(row.name for row in load_torso_tables().motors)
"""The six motors, in the order of their actions."""

NOD = "neck_flexion"
"""The hinge that tips the head forward."""

_ROTATIONS_UNDONE = ("clavphant", "scapphant")
_TURNS_WITH_ELV_ANGLE = "humphant"
_NEXT_TO_NOTHING_KGM2 = 1e-3  # as the models' other massless bodies


def with_torso(tables: ModelTables) -> ModelTables:
    """Returns the tables of the same body with a trunk and a neck that move.

    Thorax and skull get masses of trunk and head; the joints that held the thorax go.
    """
    torso = load_torso_tables()
    new = {row.name: row for row in torso.bodies}
    thorax = next(row for row in tables.bodies if row.name == "thorax")
    pelvis = replace(new["pelvis"], pos=thorax.pos, quat_wxyz=thorax.quat_wxyz)
    held = {row.name for row in tables.joints if row.body == "thorax"}
    return replace(
        tables,
        bodies=(pelvis, *(_light(_heavier(row, new)) for row in tables.bodies)),
        joints=(*torso.joints, *(_stiffer(row) for row in tables.joints if row.name not in held)),
        couplings=tuple(row for row in tables.couplings if row.dependent not in held),
        motors=(*tables.motors, *torso.motors),
    )


def _heavier(row: BodyRow, new: dict[str, BodyRow]) -> BodyRow:
    if row.name not in new:
        return row
    return replace(new[row.name], parent=row.parent, pos=row.pos, quat_wxyz=row.quat_wxyz)


def _light(row: BodyRow) -> BodyRow:
    if _stem(row.name) in (*_ROTATIONS_UNDONE, _TURNS_WITH_ELV_ANGLE):
        return replace(row, inertia=(_NEXT_TO_NOTHING_KGM2,) * 3)
    return row


def _stiffer(row: JointRow) -> JointRow:
    """Gives elv_angle the inertia of the body that only it turns."""
    if _stem(row.name) == "elv_angle":
        return replace(row, armature=row.armature + 1.0 - _NEXT_TO_NOTHING_KGM2)
    return row


def _stem(name: str) -> str:
    return name.removesuffix("_r").removesuffix("_l")
