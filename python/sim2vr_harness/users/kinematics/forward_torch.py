"""Forward kinematics of worn devices from joint angles: exact and differentiable."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.users import Body

Reference = tuple[tuple[float, ...], Body]
"""Sizes of a person, and the body that has them."""


class Chains(nn.Module):
    """Where some devices are, in their order.

    Args:
        user: the body.
        devices: by the names of their sites.
        references: bodies of other sizes, that those of every user follow from; see :class:`Chain`.
    """

    def __init__(
        self, user: Body, devices: Sequence[str], references: Sequence[Reference] = ()
    ) -> None:
        super().__init__()
        self._each = nn.ModuleList([Chain(user, device, references) for device in devices])

    def forward(self, angles: Tensor, sizes: Tensor | None = None) -> Tensor:
        """(B, D, 4, 4) transforms, MuJoCo world frame, for independent angles (B, J).

        Args:
            angles: rad.
            sizes: (B, S) of the persons; None: all are `user`.
        """
        return torch.stack([chain(angles, sizes) for chain in self._each], 1)


class Chain(nn.Module):
    """Where a device is, exactly: the joints between world and hand, one rotation each.

    A joint's transform is linear in 1, sin and cos of its angle, and dependent joints are
    polynomials of independent ones. Persons of other sizes have the same rotations, and
    translations that are linear in the sizes.
    """

    fixed: Tensor
    by_sin: Tensor
    by_cos: Tensor
    polynomials: Tensor
    tail: Tensor
    still: Tensor | None
    """(1, 4, 4) of a device that no joint moves, where all users are alike."""
    by_size: Tensor
    """(1 + S, 3 K + 1, 3) translations of the parts of K links and of the tail, by 1 and sizes."""

    def __init__(self, user: Body, device: str, references: Sequence[Reference] = ()) -> None:
        super().__init__()
        links = _Links(user, device)
        self._drivers = torch.tensor(links.drivers, dtype=torch.long)
        buffers = {
            "fixed": links.parts[0],
            "by_sin": links.parts[1],
            "by_cos": links.parts[2],
            "polynomials": links.polynomials,
            "tail": links.tail,
        }
        if references:
            known = np.array([[1.0, *sizes] for sizes, _ in references])
            wanted = np.stack([_Links(body, device).translations() for _, body in references])
            flat = np.linalg.lstsq(known, wanted.reshape(len(known), -1), rcond=None)[0]
            buffers["by_size"] = flat.reshape(-1, *wanted.shape[1:])
        for buffer, values in buffers.items():
            self.register_buffer(buffer, torch.tensor(values, dtype=torch.float32))
        # Zeros change nothing: the highest power that some joint has.
        self._degree = int(np.flatnonzero(links.polynomials.any(0)).max(initial=1))
        self.register_buffer("still", None, persistent=False)
        if not links.polynomials[:, 1:].any() and not references:
            self.still = self(torch.zeros(1, len(user.independent_joints)))

    def forward(self, angles: Tensor, sizes: Tensor | None = None) -> Tensor:
        """(B, 4, 4) the device's transform, MuJoCo world frame, for independent angles (B, J)."""
        if self.still is not None:
            return self.still.expand(len(angles), 4, 4)
        tail, moved = self.tail, None
        if sizes is not None:
            moved = torch.einsum("bs,skx->bkx", sizes, self.by_size[1:]) + self.by_size[0]
            tail = _with_translation(tail.expand(len(angles), 4, 4), moved[:, -1])
        if not len(self._drivers):  # it does not move
            return tail.expand(len(angles), 4, 4)
        x = angles[:, self._drivers]
        turned = self.polynomials[:, self._degree]
        for power in reversed(range(self._degree)):
            turned = turned * x + self.polynomials[:, power]
        sin, cos = turned.sin()[..., None], turned.cos()[..., None]
        links = self.fixed + sin[..., None] * self.by_sin + cos[..., None] * self.by_cos
        if moved is not None:
            still, by_sin, by_cos = moved[:, :-1].chunk(3, 1)
            links = _with_translation(links, still + sin * by_sin + cos * by_cos)
        while links.shape[1] > 1:  # neighbours first: few products of many matrices
            even = links.shape[1] // 2 * 2
            links = torch.cat([links[:, 0:even:2] @ links[:, 1:even:2], links[:, even:]], 1)
        placed: Tensor = links[:, 0] @ tail
        return placed


class _Links:
    """The rotations between the world and a device, as the body's model has them.

    Attributes:
        parts: (3, K, 4, 4) of K joints' transforms: constant, by sin and by cos.
        drivers: of each joint, the number of the independent joint that it follows.
        polynomials: (K, 5) how.
        tail: (4, 4) from the last joint to the device.
    """

    def __init__(self, user: Body, device: str) -> None:
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
        self.drivers: list[int] = []
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
                    self.drivers.append(independent[name])
                else:
                    coupling = couplings[name]
                    coefficients[: len(coupling.coefficients)] = coupling.coefficients
                    driver = coupling.driver
                    self.drivers.append(independent[driver] if driver else 0)
                coefficients[0] -= model.qpos0[model.jnt_qposadr[joint]]
                polynomials.append(coefficients)
        self.tail = before @ _placed(model.site_pos[site.id], model.site_quat[site.id])
        self.parts = np.array(
            [np.array([part[k] for part in parts]).reshape(-1, 4, 4) for k in range(3)]
        )
        self.polynomials = np.array(polynomials).reshape(-1, 5)

    def translations(self) -> NDArray[np.float64]:
        """(3 K + 1, 3) of all parts, part by part, and of the tail, m."""
        moved: NDArray[np.float64] = np.concatenate(
            [self.parts[:, :, :3, 3].reshape(-1, 3), self.tail[None, :3, 3]]
        )
        return moved


def _with_translation(transforms: Tensor, translation: Tensor) -> Tensor:
    """Transforms (..., 4, 4) with other translations, (..., 3)."""
    rotation = transforms[..., :3]
    column = torch.cat([translation, torch.ones_like(translation[..., :1])], -1)
    return torch.cat([rotation, column[..., None]], -1)


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
