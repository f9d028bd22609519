"""Forward kinematics: positions of a body's points from joint angles, for many postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import Body
from sim2vr_harness.users.bodies.spec_body import polynomial
from sim2vr_harness.users.name_errors import unknown_name

FloatArray = NDArray[np.float64]

_EYE = np.eye(3)
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True)
class Point:
    """A point that moves with a part of a body.

    Attributes:
        part: a site or a body of the model, such as the controller ``controller_right``.
        offset_m: from there, in the axes of the part, m.
    """

    part: str
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Link:
    """A part of the chain: where it hangs on the part above, and how its joints move it."""

    position: FloatArray
    rotation: FloatArray
    joints: tuple[_Joint, ...]

    @cached_property
    def straight(self) -> bool:
        """Whether it is not turned against the part above."""
        return bool((self.rotation == _EYE).all())


@dataclass(frozen=True)
class _Joint:
    """One degree of freedom of a link.

    Attributes:
        name: of the joint.
        hinge: or else a slide.
        axis: (3,) in the link.
        anchor: (3,) in the link, m.
        start: angle or length at which the model was drawn.
    """

    name: str
    hinge: bool
    axis: FloatArray
    anchor: FloatArray
    start: float

    @cached_property
    def centred(self) -> bool:
        """Whether the anchor is the link's origin."""
        return not self.anchor.any()

    @cached_property
    def cross(self) -> FloatArray:
        """(3, 3) matrix of the cross product with the axis."""
        x, y, z = self.axis
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

    @cached_property
    def cross_twice(self) -> FloatArray:
        """(3, 3) the same, applied twice."""
        return np.asarray(self.cross @ self.cross)

    def taken(self, rows: NDArray[np.integer]) -> _Joint:
        """Return the joint with the anchors of some bodies."""
        if self.anchor.ndim == 1:
            return self
        part = _Joint(self.name, self.hinge, self.axis, self.anchor[rows], self.start)
        for name in ("centred", "cross", "cross_twice"):
            part.__dict__[name] = getattr(self, name)
        return part


class Linkage:
    """The joints between the world and a point, couplings included.

    Args:
        body: whose they are. Joints with more than one degree of freedom stay where the model has
            them.
        point: the point.

    Attributes:
        joints: the K independent joints that move the point, in the body's order.
        limits: (K, 2) rad (slides m); a joint without counts as one of +-pi rad (+-1 m).
        rest: (K,) the posture that episodes start near, within the limits.

    Raises:
        ValueError: the model has no such part; names the nearest. Nothing moves the point.
    """

    def __init__(self, body: Body, point: Point) -> None:
        model = body.physics_model
        part, tail, turn = _part(model, point.part)
        self._tail = tail + turn @ np.asarray(point.offset_m)
        self._links = _links(model, part)
        self._couplings = {coupling.dependent: coupling for coupling in body.couplings}
        wanted = {self._driver(joint.name) for link in self._links for joint in link.joints}
        self.joints: tuple[str, ...] = tuple(j for j in body.independent_joints if j in wanted)
        if not self.joints:
            raise ValueError(f"point: got {point.part!r}, expected a part that joints can move")
        columns = [body.independent_joints.index(joint) for joint in self.joints]
        self.limits: FloatArray = body.joint_ranges[columns]
        posture = np.array([body.reset_rule.posture.get(joint, 0.0) for joint in self.joints])
        self.rest: FloatArray = np.clip(posture, *self.limits.T)

    def take(self, rows: NDArray[np.integer]) -> Linkage:
        """Return the linkage of these rows of postures: itself, as all rows are of one body."""
        del rows
        return self

    def _driver(self, joint: str) -> str:
        """The independent joint that a joint follows, itself included; empty for none."""
        while joint in self._couplings:
            joint = self._couplings[joint].driver
        return joint

    def _angle(self, joint: str, q: FloatArray) -> tuple[FloatArray, FloatArray, int | None]:
        """Angles (B,) of a joint, their derivative by the joint that it follows, and which."""
        if joint in self.joints:
            column = self.joints.index(joint)
            return q[:, column], np.ones(len(q)), column
        if joint not in self._couplings:
            return np.zeros(len(q)), np.zeros(len(q)), None
        coupling = self._couplings[joint]
        if not coupling.driver:
            return np.full(len(q), coupling.coefficients[0]), np.zeros(len(q)), None
        driver, slope, column_or_none = self._angle(coupling.driver, q)
        curve = np.asarray(coupling.coefficients, dtype=np.float64)
        steepness = curve[1:] * np.arange(1, len(curve)) if len(curve) > 1 else np.zeros(1)
        return polynomial(curve, driver), polynomial(steepness, driver) * slope, column_or_none

    def place(self, q: FloatArray) -> FloatArray:
        """(B, 3) where the point is, MuJoCo's world, m, for angles (B, K)."""
        return self._walk(np.asarray(q, dtype=np.float64), [])

    def place_and_slope(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, and its derivative (B, 3, K) by the angles."""
        q = np.asarray(q, dtype=np.float64)
        moves: list[tuple[int, FloatArray, FloatArray | None]] = []
        x = self._walk(q, moves)
        slope = np.zeros((len(q), 3, len(self.joints)))
        for column, axis, anchor in moves:
            slope[:, :, column] += axis if anchor is None else _cross(axis, x - anchor)
        return x, slope

    def _walk(
        self, q: FloatArray, moves: list[tuple[int, FloatArray, FloatArray | None]]
    ) -> FloatArray:
        """Where the point is; notes of each joint its column, axis and anchor (None: a slide)."""
        origin, turn = np.zeros((len(q), 3)), np.broadcast_to(np.eye(3), (len(q), 3, 3))
        for link in self._links:
            origin = origin + _turned(turn, link.position)
            turn = turn if link.straight else turn @ link.rotation
            for joint in link.joints:
                angle, slope, column = self._angle(joint.name, q)
                axis = turn @ joint.axis
                moved = angle - joint.start
                anchor = origin if joint.centred else origin + _turned(turn, joint.anchor)
                if joint.hinge:
                    turn = turn @ _rotations(joint, moved)
                    origin = anchor if joint.centred else anchor - _turned(turn, joint.anchor)
                else:
                    origin = origin + axis * moved[:, None]
                if column is not None:
                    weighted = axis * slope[:, None]
                    moves.append((column, weighted, anchor if joint.hinge else None))
        return origin + _turned(turn, self._tail)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(B, 3) cross products of two (B, 3), without the set-up of NumPy's."""
    found = np.empty_like(b)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return found


def _turned(turn: FloatArray, vector: FloatArray) -> FloatArray:
    """(B, 3) a vector (3,), or one a row (B, 3), turned by (B, 3, 3)."""
    if vector.ndim == 1:
        found: FloatArray = turn @ vector
        return found
    return np.einsum("bij,bj->bi", turn, vector)


def _rotations(joint: _Joint, angle: FloatArray) -> FloatArray:
    """(B, 3, 3) turns of a joint by angles (B,), after Rodrigues."""
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    turns: FloatArray = _EYE + sin * joint.cross + (1.0 - cos) * joint.cross_twice
    return turns


def rotation_matrix(quat: Sequence[float] | FloatArray) -> FloatArray:
    """(3, 3) of a quaternion w x y z."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, dtype=np.float64))
    return matrix.reshape(3, 3)


def _part(model: mujoco.MjModel, name: str) -> tuple[int, FloatArray, FloatArray]:
    """The body of a site or body, and where the part is in it: position and axes."""
    sites = [model.site(i).name for i in range(model.nsite)]
    bodies = [model.body(i).name for i in range(model.nbody)]
    if name in sites:
        site = model.site(name)
        return int(site.bodyid[0]), np.array(site.pos), rotation_matrix(site.quat)
    if name in bodies:
        return int(model.body(name).id), np.zeros(3), np.eye(3)
    raise ValueError(unknown_name("point", name, [part for part in (*sites, *bodies) if part]))


def _links(model: mujoco.MjModel, body: int) -> list[_Link]:
    """The parts from below the world down to a body."""
    links = []
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = tuple(
            _Joint(
                model.joint(j).name,
                int(model.jnt_type[j]) == _HINGE,
                np.array(model.jnt_axis[j]),
                np.array(model.jnt_pos[j]),
                float(model.qpos0[model.jnt_qposadr[j]]),
            )
            for j in range(first, first + count)
            if int(model.jnt_type[j]) in (_HINGE, _SLIDE)
        )
        axes = rotation_matrix(model.body_quat[body])
        links.append(_Link(np.array(model.body_pos[body]), axes, joints))
        body = int(model.body_parentid[body])
    return links[::-1]
