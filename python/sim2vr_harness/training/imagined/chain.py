"""Where worn devices are by the joints' angles: exact, and differentiable."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.users import Body

__all__ = ["Chain", "Chains"]


class Chains(nn.Module):
    """Where some devices are, in their order."""

    def __init__(self, user: Body, devices: Sequence[str]) -> None:
        super().__init__()
        self._each = nn.ModuleList([Chain(user, device) for device in devices])

    def forward(self, angles: Tensor) -> Tensor:
        """(B, D, 4, 4) transforms, MuJoCo world frame, for independent angles (B, J)."""
        return torch.stack([chain(angles) for chain in self._each], 1)


class Chain(nn.Module):
    """Where a device is, exactly: the joints between world and hand, one rotation each.

    A joint's transform is linear in 1, sin and cos of its angle, and dependent joints are
    polynomials of independent ones.
    """

    fixed: Tensor
    by_sin: Tensor
    by_cos: Tensor
    polynomials: Tensor
    tail: Tensor

    def __init__(self, user: Body, device: str) -> None:
        super().__init__()
        model = user.physics_model
        site = model.site(device)
        bodies: list[int] = []
        body = int(site.bodyid[0])
        while body != 0:
            bodies.insert(0, body)
            body = int(model.body_parentid[body])
        couplings = {coupling.dependent: coupling for coupling in user.couplings}
        independent = {name: k for k, name in enumerate(user.independent_joints)}
        before = np.eye(4)
        parts: list[tuple[NDArray[np.float64], ...]] = []
        self._drivers: list[int] = []
        polynomials = []
        for body in bodies:
            before = before @ _placed(model.body_pos[body], model.body_quat[body])
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            for joint in range(first, first + count):
                parts.append(tuple(before @ part for part in _hinge(model, joint)))
                before = np.eye(4)
                name = model.joint(joint).name
                coefficients = np.zeros(5)
                if name in independent:
                    coefficients[1] = 1.0
                    self._drivers.append(independent[name])
                else:
                    coupling = couplings[name]
                    coefficients[: len(coupling.coefficients)] = coupling.coefficients
                    driver = coupling.driver
                    self._drivers.append(independent[driver] if driver else 0)
                coefficients[0] -= model.qpos0[model.jnt_qposadr[joint]]
                polynomials.append(coefficients)
        tail = before @ _placed(model.site_pos[site.id], model.site_quat[site.id])
        fixed, by_sin, by_cos = (
            np.array([part[k] for part in parts]).reshape(-1, 4, 4) for k in range(3)
        )
        for buffer, values in {
            "fixed": fixed,
            "by_sin": by_sin,
            "by_cos": by_cos,
            "polynomials": np.array(polynomials).reshape(-1, 5),
            "tail": tail,
        }.items():
            self.register_buffer(buffer, torch.tensor(values, dtype=torch.float32))

    def forward(self, angles: Tensor) -> Tensor:
        """(B, 4, 4) the device's transform, MuJoCo world frame, for independent angles (B, J)."""
        if not self._drivers:  # it does not move
            return self.tail.expand(len(angles), 4, 4)
        x = angles[:, self._drivers]
        turned = self.polynomials[:, 4]
        for power in (3, 2, 1, 0):
            turned = turned * x + self.polynomials[:, power]
        links = (
            self.fixed
            + turned.sin()[..., None, None] * self.by_sin
            + turned.cos()[..., None, None] * self.by_cos
        )
        while links.shape[1] > 1:  # neighbours first: few products of many matrices
            even = links.shape[1] // 2 * 2
            links = torch.cat([links[:, 0:even:2] @ links[:, 1:even:2], links[:, even:]], 1)
        placed: Tensor = links[:, 0] @ self.tail
        return placed


def _placed(position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quaternion, dtype=np.float64))
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation.reshape(3, 3), position
    return transform


def _hinge(model: mujoco.MjModel, joint: int) -> tuple[NDArray[np.float64], ...]:
    """Rodrigues' formula about the joint's anchor: constant part, and those of sin and cos."""
    x, y, z = model.jnt_axis[joint]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    there, back = np.eye(4), np.eye(4)
    there[:3, 3], back[:3, 3] = model.jnt_pos[joint], -model.jnt_pos[joint]
    parts = []
    for rotation, last in ((np.eye(3) + cross @ cross, 1.0), (cross, 0.0), (-cross @ cross, 0.0)):
        part = np.zeros((4, 4))
        part[:3, :3], part[3, 3] = rotation, last
        parts.append(there @ part @ back)
    return tuple(parts)
