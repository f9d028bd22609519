"""Forward kinematics of worn devices in PyTorch: exact and differentiable."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from sim2vr_harness.users import Body
from sim2vr_harness.users.kinematics.forward import Chain, Point

Reference = tuple[tuple[float, ...], Body]
"""Sizes of a person, and the body that has them."""


class Chains(nn.Module):
    """Forward kinematics of some devices, in their order.

    Args:
        user: the body.
        devices: names of the devices' sites.
        references: bodies of other sizes. Persons of other sizes have the same rotations, and
            translations that are linear in the sizes; the coefficients are computed from these
            bodies.
    """

    def __init__(
        self, user: Body, devices: Sequence[str], references: Sequence[Reference] = ()
    ) -> None:
        super().__init__()
        self._each = nn.ModuleList([_Device(user, device, references) for device in devices])

    def forward(self, angles: Tensor, sizes: Tensor | None = None) -> Tensor:
        """(B, D, 4, 4) transforms, MuJoCo world frame, for independent angles (B, J).

        Args:
            angles: rad.
            sizes: (B, S) of the persons; None: all are `user`.
        """
        return torch.stack([device(angles, sizes) for device in self._each], 1)


class _Device(nn.Module):
    """Forward kinematics of a device, the product of the transforms of a :class:`.Chain`."""

    fixed: Tensor
    by_sin: Tensor
    by_cos: Tensor
    by_length: Tensor | None
    """(K, 4, 4) coefficients of the length of slides; None without slides."""
    polynomials: Tensor
    tail: Tensor
    still: Tensor | None
    """(1, 4, 4) transform of a device that no joint moves, if all users are alike."""
    by_size: Tensor
    """(1 + S, 3 K + 1, 3) translations of the parts of K joints and of the tail, by 1 and sizes."""

    def __init__(self, user: Body, device: str, references: Sequence[Reference]) -> None:
        super().__init__()
        chain = Chain(user, Point(device))
        self._drivers = torch.tensor(np.maximum(chain.drivers, 0), dtype=torch.long)
        buffers = {
            "fixed": chain.parts[0],
            "by_sin": chain.parts[1],
            "by_cos": chain.parts[2],
            "polynomials": chain.polynomials,
            "tail": chain.tail,
        }
        if references:
            known = np.array([[1.0, *sizes] for sizes, _ in references])
            wanted = np.stack([Chain(body, Point(device)).translations() for _, body in references])
            flat = np.linalg.lstsq(known, wanted.reshape(len(known), -1), rcond=None)[0]
            buffers["by_size"] = flat.reshape(-1, *wanted.shape[1:])
        for buffer, values in buffers.items():
            self.register_buffer(buffer, torch.tensor(values, dtype=torch.float32))
        slides = torch.tensor(chain.parts[3], dtype=torch.float32) if chain.parts[3].any() else None
        self.register_buffer("by_length", slides, persistent=False)
        # Zeros change nothing: the highest power that some joint has.
        self._degree = int(np.flatnonzero(chain.polynomials.any(0)).max(initial=1))
        self.register_buffer("still", None, persistent=False)
        if not chain.polynomials[:, 1:].any() and not references:
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
        if self.by_length is not None:
            links = links + turned[..., None, None] * self.by_length
        while links.shape[1] > 1:  # neighbours first: few products of many matrices
            even = links.shape[1] // 2 * 2
            links = torch.cat([links[:, 0:even:2] @ links[:, 1:even:2], links[:, even:]], 1)
        placed: Tensor = links[:, 0] @ tail
        return placed


def _with_translation(transforms: Tensor, translation: Tensor) -> Tensor:
    """Transforms (..., 4, 4) with other translations, (..., 3)."""
    rotation = transforms[..., :3]
    column = torch.cat([translation, torch.ones_like(translation[..., :1])], -1)
    return torch.cat([rotation, column[..., None]], -1)
