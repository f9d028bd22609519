"""Forward kinematics of many bodies that differ in size only, a row of postures each."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.kinematics.forward import Linkage, _Joint, _Link

FloatArray = NDArray[np.float64]

RAY = "ray"
_RAY_M = (0.0, 100.0)


class StackedLinkage(Linkage):
    """Linkages of B bodies with the same joints, as one whose postures have a row per body.

    Args:
        linkages: of bodies that differ in lengths only; their limits may differ.
        ray: the same linkages with a point one unit further along a ray; None: no ray. With it the
            last coordinate, ``ray``, is how far along its ray the point is, m.

    Attributes:
        limits: (B, K, 2) of each body.

    Raises:
        ValueError: the linkages differ in more.
    """

    def __init__(self, linkages: Sequence[Linkage], ray: Sequence[Linkage] | None = None) -> None:
        first = linkages[0]
        if any(_shape(each) != _shape(first) for each in linkages):
            raise ValueError("linkages: got bodies with other joints, expected other sizes only")
        self._couplings, self.joints, self.rest = first._couplings, first.joints, first.rest
        self.limits = np.stack([each.limits for each in linkages])
        self._tail = np.stack([each._tail for each in linkages])
        self._links = [
            replace(
                link,
                position=np.stack([each._links[i].position for each in linkages]),
                joints=tuple(
                    replace(
                        joint, anchor=np.stack([e._links[i].joints[j].anchor for e in linkages])
                    )
                    for j, joint in enumerate(link.joints)
                ),
            )
            for i, link in enumerate(first._links)
        ]
        if ray is not None:
            self._add_ray(ray[0]._tail - first._tail)

    def _add_ray(self, axis: FloatArray) -> None:
        """Let the point slide along an axis of the last part."""
        count, zeros = len(self._tail), np.zeros(3)
        slide = _Joint(RAY, hinge=False, axis=axis, anchor=zeros, start=0.0)
        self._links.append(_Link(self._tail, np.eye(3), (slide,)))
        self._tail = zeros
        self.joints = (*self.joints, RAY)
        self.rest = np.append(self.rest, 1.0)
        limits = np.broadcast_to(np.array(_RAY_M), (count, 1, 2))
        self.limits = np.concatenate([self.limits, limits], axis=1)

    def take(self, rows: NDArray[np.integer]) -> StackedLinkage:
        """Return the linkage of some bodies, in any order, each as often as it is named."""
        part = copy(self)
        part.limits = self.limits[rows]
        part._tail = _taken(self._tail, rows)
        part._links = [
            _Link(link.position[rows], link.rotation, tuple(j.taken(rows) for j in link.joints))
            for link in self._links
        ]
        return part

    def with_limits(self, limits: FloatArray) -> StackedLinkage:
        """Return the same linkage with other limits (B, K, 2)."""
        part = copy(self)
        part.limits = limits
        return part


def _taken(values: FloatArray, rows: NDArray[np.integer]) -> FloatArray:
    return values if values.ndim == 1 else values[rows]


def _shape(linkage: Linkage) -> tuple[object, ...]:
    return linkage.joints, tuple(len(link.joints) for link in linkage._links)
