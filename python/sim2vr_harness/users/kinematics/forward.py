"""Forward kinematics: where parts of bodies are, from joint angles, for many postures at once.

:class:`Chain` describes what moves a part, as read from the model. :class:`Linkage` evaluates it in
NumPy for one point, with slopes; :class:`.Chains` evaluates it in PyTorch for devices, with
gradients.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.users import Body

FloatArray = NDArray[np.float64]

RAY = "ray"
_RAY_M = (0.0, 100.0)
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_ROWS = 512
"""Postures that are computed at once, so that their numbers stay in the processor's cache."""
_POWERS = 5
"""Coefficients of MuJoCo's couplings of joints."""


@dataclass(frozen=True)
class Point:
    """A point that moves with a part of a body.

    Attributes:
        part: a site or a body of the model, such as the controller ``controller_right``.
        offset_m: from there, in the axes of the part, m.
    """

    part: str
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Chain:
    """The K joints between the world and a part of a body, a transform each.

    The transform of a joint against the one before it is linear in 1, the sine and the cosine of
    its angle (Rodrigues), that of a slide in its length. Dependent joints are polynomials of
    independent ones. Joints with more than one degree of freedom stay where the model has them.

    Args:
        body: whose they are.
        point: on the part.

    Attributes:
        parts: (4, K, 4, 4) transforms: constant, by sine, by cosine and by length.
        drivers: (K,) number of the independent joint that each joint follows, itself included; -1:
            none.
        polynomials: (K, P) how; lowest power first, from the angle at which the model was drawn.
        tail: (4, 4) from the last joint to the point.

    Raises:
        ValueError: the model has no such part; names the nearest.
    """

    def __init__(self, body: Body, point: Point) -> None:
        model = body.physics_model
        part, tail = _part(model, point.part)
        tail[:3, 3] += tail[:3, :3] @ np.asarray(point.offset_m)
        bodies: list[int] = []
        while part:
            bodies.insert(0, part)
            part = int(model.body_parentid[part])
        couplings = {coupling.dependent: coupling for coupling in body.couplings}
        independent = {name: k for k, name in enumerate(body.independent_joints)}

        def follows(name: str) -> tuple[int, FloatArray]:
            """Return the independent joint that a joint follows, and the polynomial."""
            if name in independent:
                return independent[name], np.array([0.0, 1.0])
            if name not in couplings:
                return -1, np.zeros(1)
            curve = np.asarray(couplings[name].coefficients, dtype=np.float64)
            if not couplings[name].driver:
                return -1, curve[:1]
            driver, inner = follows(couplings[name].driver)
            direct = couplings[name].driver in independent
            outer = curve if direct else Polynomial(curve)(Polynomial(inner)).coef
            return driver, np.asarray(outer, dtype=np.float64)

        before, parts, drivers, curves = np.eye(4), [], [], []
        for number in bodies:
            before = before @ _placed(model.body_pos[number], model.body_quat[number])
            first, count = int(model.body_jntadr[number]), int(model.body_jntnum[number])
            for joint in range(first, first + count):
                if int(model.jnt_type[joint]) not in (_HINGE, _SLIDE):
                    continue
                parts.append(before @ _moved(model, joint))
                before = np.eye(4)
                driver, curve = follows(model.joint(joint).name)
                curve = np.array(curve)
                curve[0] -= model.qpos0[model.jnt_qposadr[joint]]
                drivers.append(driver)
                curves.append(curve)
        self.tail: FloatArray = before @ tail
        self.parts: FloatArray = np.reshape(parts, (-1, 4, 4, 4)).swapaxes(0, 1)
        self.drivers = np.array(drivers, dtype=np.int64)
        width = max([_POWERS, *map(len, curves)])
        self.polynomials: FloatArray = np.zeros((len(curves), width))
        for row, curve in zip(self.polynomials, curves, strict=True):
            row[: len(curve)] = curve

    def translations(self) -> FloatArray:
        """(3 K + 1, 3) of the parts constant, by sine and by cosine, and of the tail, m."""
        moved: FloatArray = np.concatenate(
            [self.parts[:3, :, :3, 3].reshape(-1, 3), self.tail[None, :3, 3]]
        )
        return moved


class Linkage:
    """The joints that bring a point of a body to its place.

    Args:
        body: whose they are.

    Attributes:
        joints: the J independent joints that move the point, in the body's order.
        limits: (J, 2) rad (slides m), or (B, J, 2) of B bodies; a joint without counts as one of
            +-pi rad (+-1 m).
        rest: (J,) the posture that episodes start near, within the limits.

    Raises:
        ValueError: the model has no such part; names the nearest. Nothing moves the point.
    """

    def __init__(self, body: Body, point: Point) -> None:
        chain = Chain(body, point)
        columns = sorted({int(driver) for driver in chain.drivers if driver >= 0})
        if not columns:
            raise ValueError(f"point: got {point.part!r}, expected a part that joints can move")
        self.joints = tuple(body.independent_joints[column] for column in columns)
        self.limits: FloatArray = body.joint_ranges[columns]
        posture = np.array([body.reset_rule.posture.get(joint, 0.0) for joint in self.joints])
        self.rest: FloatArray = np.clip(posture, *self.limits.T)
        self._columns = np.searchsorted(columns, np.maximum(chain.drivers, columns[0]))
        self._polynomials = chain.polynomials
        # (K, 9, 3): the rotations of the three parts below each other.
        self._turns = chain.parts[:3, :, :3, :3].swapaxes(0, 1).reshape(-1, 9, 3)
        self._lengths: FloatArray = chain.parts[3, :, :3, 3]
        self._axes: FloatArray = chain.tail[:3, :3]
        self._places: FloatArray = chain.translations()

    @classmethod
    def stacked(cls, linkages: Sequence[Linkage], ray: ArrayLike | None = None) -> Linkage:
        """Return linkages of B bodies as one, whose postures have a row per body.

        Args:
            linkages: of bodies that differ in lengths only; their limits may differ.
            ray: (3,) along which the point slides, in the axes of its part. How far it then is
                along it, m, is the last joint, ``ray``.

        Raises:
            ValueError: the linkages differ in more.
        """
        stack = copy(linkages[0])
        if any(each.joints != stack.joints for each in linkages) or any(
            each._places.shape != stack._places.shape for each in linkages
        ):
            raise ValueError("linkages: got bodies with other joints, expected other sizes only")
        stack.limits = np.stack([each.limits for each in linkages])
        stack._places = np.stack([each._places for each in linkages])
        return (
            stack
            if ray is None
            else stack._with_ray(stack._axes @ np.asarray(ray, dtype=np.float64))
        )

    def _with_ray(self, axis: FloatArray) -> Linkage:
        """Let the point slide along an axis (3,) of the last joint."""
        count = len(self._places)
        self.joints = (*self.joints, RAY)
        self.rest = np.append(self.rest, 1.0)
        limits = np.broadcast_to(_RAY_M, (count, 1, 2))
        self.limits = np.concatenate([self.limits, limits], axis=1)
        self._columns = np.append(self._columns, len(self.joints) - 1)
        self._polynomials = np.concatenate(
            [self._polynomials, np.eye(1, self._polynomials.shape[1], 1)]
        )
        turn = np.concatenate([np.eye(3), np.zeros((6, 3))])
        self._turns = np.concatenate([self._turns, turn[None]])
        self._lengths = np.concatenate([self._lengths, axis[None]])
        parts = self._places[:, :-1].reshape(count, 3, -1, 3)
        begin = np.zeros((count, 3, 1, 3))
        begin[:, 0, 0] = self._places[:, -1]
        joined = np.concatenate([parts, begin], axis=2).reshape(count, -1, 3)
        self._places = np.concatenate([joined, np.zeros((count, 1, 3))], axis=1)
        return self

    def take(self, rows: NDArray[np.integer]) -> Linkage:
        """Return the linkage of some rows, in any order; itself, if all rows are of one body."""
        if self._places.ndim == 2:
            return self
        part = copy(self)
        part.limits, part._places = self.limits[rows], self._places[rows]
        return part

    def with_limits(self, limits: FloatArray) -> Linkage:
        """Return the same linkage with other limits."""
        part = copy(self)
        part.limits = limits
        return part

    def place(self, q: FloatArray) -> FloatArray:
        """Return (B, 3) positions of the point in MuJoCo's world, m, for angles (B, J)."""
        return self._evaluated(np.asarray(q, dtype=np.float64), slopes=False)[:, :, 0]

    def place_and_slope(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the position and its derivative (B, 3, J) with respect to the angles."""
        found = self._evaluated(np.asarray(q, dtype=np.float64), slopes=True)
        return found[:, :, 0], found[:, :, 1:]

    def _evaluated(self, q: FloatArray, *, slopes: bool) -> FloatArray:
        """(B, 3, 1 + J) place and slopes, or (B, 3, 1) without slopes."""
        found = np.zeros((len(q), 3, 1 + len(self.joints) * slopes))
        for first in range(0, len(q), _ROWS):
            rows = slice(first, first + _ROWS)
            places = self._places if self._places.ndim == 2 else self._places[rows]
            self._walk(q[rows].T, np.moveaxis(np.atleast_3d(places.T), 1, 0), found[rows], slopes)
        return found

    def _walk(self, q: FloatArray, places: FloatArray, found: FloatArray, slopes: bool) -> None:
        """Go from the point to the world, a joint at a time, the postures along the last axis.

        Each joint's transform acts on the point and on the slopes of the joints that are behind it.

        Args:
            q: (J, B) angles.
            places: (3 K + 1, 3, B or 1) as of :meth:`Chain.translations`.
            found: (B, 3, 1 + J) receives place and slopes.
            slopes: whether to compute them.
        """
        count, size = len(self._columns), q.shape[1]
        parts = places[:-1].reshape(3, count, 3, -1)
        angles, steepness = self._angles(q[self._columns])
        sines, cosines = np.sin(angles), np.cos(angles)
        moved = np.zeros((3, 1 + len(self.joints) * slopes, size))
        moved[:, 0] = places[-1]
        behind: dict[int, int] = {}
        for k in range(count - 1, -1, -1):
            known = 1 + len(behind)
            turned = self._turns[k] @ moved[:, :known].reshape(3, -1)
            still, by_sine, by_cosine = turned.reshape(3, 3, known, size)
            still[:, 0] += parts[0, k]
            by_sine[:, 0] += parts[1, k]
            by_cosine[:, 0] += parts[2, k]
            along = self._lengths[k, :, None]
            if along.any():
                still[:, 0] += along * angles[k]
            moved[:, :known] = still + sines[k] * by_sine + cosines[k] * by_cosine
            if slopes and self._polynomials[k, 1:].any():
                slope = along + cosines[k] * by_sine[:, 0] - sines[k] * by_cosine[:, 0]
                column = behind.setdefault(int(self._columns[k]), known)
                moved[:, column] += slope * steepness[k]
        found[:, :, 0] = moved[:, 0].T
        for joint, column in behind.items():
            found[:, :, 1 + joint] = moved[:, column].T

    def _angles(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(K, B) angles of all joints from those that they follow, and their derivatives."""
        angles, steepness = np.zeros_like(x), np.zeros_like(x)
        degree = int(np.flatnonzero(self._polynomials.any(axis=0)).max())
        for power in range(degree, -1, -1):
            steepness = steepness * x + angles
            angles = angles * x + self._polynomials[:, power, None]
        return angles, steepness


def rotation_matrix(quat: Sequence[float] | FloatArray) -> FloatArray:
    """(3, 3) of a quaternion w x y z."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, dtype=np.float64))
    return matrix.reshape(3, 3)


def _placed(position: FloatArray, quat: FloatArray) -> FloatArray:
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation_matrix(quat), position
    return transform


def _part(model: mujoco.MjModel, name: str) -> tuple[int, FloatArray]:
    """The body of a site or body, and the part's transform (4, 4) in it."""
    sites = [model.site(i).name for i in range(model.nsite)]
    bodies = [model.body(i).name for i in range(model.nbody)]
    if name in sites:
        site = model.site(name)
        return int(site.bodyid[0]), _placed(site.pos, site.quat)
    if name in bodies:
        return int(model.body(name).id), np.eye(4)
    raise unknown_name("point", name, [part for part in (*sites, *bodies) if part])


def _moved(model: mujoco.MjModel, joint: int) -> FloatArray:
    """(4, 4, 4) transform of a joint, as of :attr:`Chain.parts`: a hinge turns about its anchor."""
    x, y, z = model.jnt_axis[joint]
    parts = np.zeros((4, 4, 4))
    if int(model.jnt_type[joint]) == _SLIDE:
        parts[0], parts[3, :3, 3] = np.eye(4), (x, y, z)
        return parts
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    there, back = np.eye(4), np.eye(4)
    there[:3, 3], back[:3, 3] = model.jnt_pos[joint], -model.jnt_pos[joint]
    parts[:3, :3, :3] = np.eye(3) + cross @ cross, cross, -cross @ cross
    parts[0, 3, 3] = 1.0
    parts[:3] = there @ parts[:3] @ back
    return parts
