"""``sim2vr-harness reach``: how far a user reaches, and which targets lie within."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.tools.reach.extent import Reach, Verdict, Volume
from sim2vr_harness.tools.reach.targets import Target, in_mujoco
from sim2vr_harness.users import Body
from sim2vr_harness.users.kinematics.forward import Linkage, Point

FloatArray = NDArray[np.float64]

_GRID = 100
_SWEPT = ("elv_angle", "shoulder_elv")
_LOWEST = "elbow_flexion"
"""Of the reference's sweep: the joints that go over their ranges, and one that stays low."""


@dataclass(frozen=True)
class Sweep:
    """The reference's sweep: two joints over their whole ranges, the elbow straight.

    Attributes:
        joints: the two.
        angles: (N, 2) rad.
        points: (N, 3) where the point is, MuJoCo's world, m.
    """

    joints: tuple[str, str]
    angles: FloatArray
    points: FloatArray


@dataclass(frozen=True)
class Measured:
    """What came out.

    Attributes:
        body: whose reach it is.
        point: of what.
        reach: everything that the joints' limits allow.
        extent_m: (2, 3) least and greatest right, up, ahead: the app's frame, m.
        volume: the cells that can be reached.
        sweep: the reference's, for comparison.
        targets: the places requested.
        verdicts: on each of them.
    """

    body: Body
    point: Point
    reach: Reach
    extent_m: FloatArray
    volume: Volume
    sweep: Sweep
    targets: tuple[Target, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def missed(self) -> list[str]:
        """Names of the targets that cannot be reached."""
        pairs = zip(self.targets, self.verdicts, strict=True)
        return [target.name for target, verdict in pairs if not verdict.inside]


def chosen_point(body: Body, name: str | None) -> Point:
    """Return the point of a body that a name stands for: a device, site or part of its model.

    Without a name the first controller that the body wears.

    Raises:
        InputError: The body has no controller, or nothing of that name.
    """
    model = body.physics_model
    parts = [model.site(i).name for i in range(model.nsite)]
    parts += [model.body(i).name for i in range(model.nbody)]
    if name is None:
        worn = [device for device in body.devices if device.startswith("controller")]
        if not worn:
            raise InputError("--point", "none", f"a part of {body.name}, which holds no controller")
        return Point(worn[0])
    if name not in parts:
        raise unknown_name("--point", name, [part for part in parts if part])
    return Point(name)


def measure(
    body: Body, point: Point, targets: Sequence[Target] = (), *, cell_m: float = 0.05
) -> Measured:
    """Measure how far a point of a body reaches.

    Args:
        body: The body.
        point: The point.
        targets: Places to judge.
        cell_m: Edge of the cells that the room is divided into.

    Raises:
        InputError: Nothing moves the point, or a number is out of range.
    """
    if not 0.01 <= cell_m <= 0.2:
        raise InputError("--cell", f"{cell_m:g}", "0.01 to 0.2 m")
    try:
        linkage = Linkage(body, point)
    except ValueError as error:
        raise InputError("--point", repr(point.part), "a part that joints can move") from error
    reach = Reach(linkage)
    extent = position_to_app(reach.extent())
    return Measured(
        body,
        point,
        reach,
        np.stack([extent.min(axis=0), extent.max(axis=0)]),
        reach.fill(cell_m),
        sweep(linkage),
        tuple(targets),
        tuple(reach.judge(in_mujoco(targets))) if targets else (),
    )


def sweep(linkage: Linkage) -> Sweep:
    """Move two joints over their ranges, the others at rest and the elbow at its lower limit.

    The reference sweeps 100 x 100 angles of elevation plane and elevation (SIM2VR, tools). A body
    without these joints moves the first two of those that move the point.
    """
    columns = [_column(linkage, name) for name in _SWEPT]
    found = [column for column in columns if column is not None]
    if len(found) < 2:
        found = [0, min(1, len(linkage.joints) - 1)]
    q = np.repeat(linkage.rest[None], _GRID * _GRID, axis=0)
    straight = _column(linkage, _LOWEST)
    if straight is not None:
        q[:, straight] = linkage.limits[straight, 0]
    shares = np.linspace(0.0, 1.0, _GRID)
    ranges = [low + shares * (high - low) for low, high in linkage.limits[found]]
    q[:, found] = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 2)
    first, second = found
    return Sweep((linkage.joints[first], linkage.joints[second]), q[:, found], linkage.place(q))


def _column(linkage: Linkage, name: str) -> int | None:
    """Which joint has this name, with or without the side's letter."""
    for column, joint in enumerate(linkage.joints):
        if joint in (name, f"{name}_r", f"{name}_l"):
            return column
    return None
