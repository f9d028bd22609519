"""Attention crops: small cut-outs of the pictures around objects that matter for the task.

A flat layer behind convolutions has to learn an object's look for every place of a picture; a crop
around the object looks alike at any place. A locator predicts the objects' places. It is the
attention of Mnih et al. (2014) with supervision: the student stage trains it on the places that the
teacher observes. After that stage its weights are fixed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from sim2vr_harness.policies.conv import cast, centred, channels_last, convolutions, convolved
from sim2vr_harness.runs.attention_config import FOVEA_ZOOM, AttentionCropConfig

_VISION_PIXELS, _FOVEA_PIXELS = 24, 32
"""Sides of the crops of ``vision`` and ``fovea``; multiples of 8, which the encoder divides by."""
_FEATURES = 96
"""Features per crop, fewer than for the whole image (256), because a crop shows one object."""
_CELL = 8
"""Width and height of a cell of the locator's grid, in pixels of the wide image."""
_LOCATOR = (8, 16, 24, 32)
_ENCODER = (16, 32, 48)


class AttentionCrops(nn.Module):
    """A locator of objects in the picture, and encoders of the crops around them.

    Places are in units of the wide picture's half height from its middle, right and up: at a
    vertical angle of 90 degrees tangents of angles from straight ahead.

    Args:
        shapes: (C, H, W) of the uint8 pictures ``vision`` and, if there is one, ``fovea``.
        dtype: what is computed in; weights are float32 either way.
    """

    def __init__(
        self,
        shapes: Mapping[str, Sequence[int]],
        config: AttentionCropConfig,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        self.count, self.features, self.dtype = config.count, _FEATURES, dtype
        wide, height, width = shapes["vision"]
        self._half, self._width = height / 2.0, width
        self._size = -(-height // _CELL), -(-width // _CELL)
        self.locator = convolutions(wide, _LOCATOR, (2, 2, 2, 1))
        self.grid = nn.Conv2d(_LOCATOR[-1], 3 * config.count, 1)
        self.looks = {"vision": (_VISION_PIXELS, 1)}
        if "fovea" in shapes:
            self.looks["fovea"] = (_FOVEA_PIXELS, FOVEA_ZOOM)
        encoders, flat = {}, 0
        for key, (side, _) in self.looks.items():
            encoders[key] = convolutions(shapes[key][0], _ENCODER)
            flat += _ENCODER[-1] * (-(-side // 2 ** len(_ENCODER))) ** 2
        self.encoders = nn.ModuleDict(encoders)
        self.linear = nn.Linear(flat, self.features)
        self.teach(False)
        self.outputs = config.count * (self.features + 3)
        """Number of features: of each crop its content, its place and the locator's confidence."""

    def parted(self, features: Tensor) -> Tensor:
        """(B, G, features) the crops' contents, of features that begin with all of theirs."""
        each = features[:, : self.outputs].view(-1, self.count, self.features + 3)
        return each[..., : self.features]

    def teach(self, learning: bool) -> None:
        """Say whether the locator learns: in the student stage, to given places the places."""
        self.locator.requires_grad_(learning)
        self.grid.requires_grad_(learning)

    def where(self, picture: Tensor) -> Tensor:
        """(B, G, 3, cells) of the locator's grid: logits, and places of the thing if it is there.

        Args:
            picture: (B, C, H, W) uint8, ``vision``.
        """
        x = convolved(self.locator, centred(channels_last(picture), self.dtype))
        last = self.grid
        told = functional.conv2d(x, *cast(last.weight, last.bias, self.dtype)).float()
        told = told.reshape(len(told), self.count, 3, -1)
        rows, columns = self._size
        cell = torch.arange(rows * columns, device=told.device)
        right = cell % columns + 0.5 * (1 - columns)
        up = 0.5 * (rows - 1) - torch.div(cell, columns, rounding_mode="floor")
        places = (torch.stack([right, up]) + told[:, :, 1:]) * (_CELL / self._half)
        return torch.cat([told[:, :, :1], places], 2)

    def loss(self, told: Tensor, places: Tensor, there: Tensor) -> Tensor:
        """Return the locator's loss: cross-entropy of cells, and distance in the right cell.

        Args:
            told: (B, G, 3, cells) predictions of :meth:`where`.
            places: (B, G, 2) true positions.
            there: (B, G) 1 for objects that are present, 0 for the others.

        Returns:
            The mean over the objects that are present and inside the image.
        """
        rows, columns = self._size
        edge = torch.tensor([self._width / (2.0 * self._half), 1.0], device=told.device)
        there = there * (places.abs() <= edge).all(-1)
        at = places * (self._half / _CELL)
        column = (at[..., 0] + columns / 2.0).long().clamp(0, columns - 1)
        row = (rows / 2.0 - at[..., 1]).long().clamp(0, rows - 1)
        cell = row * columns + column
        logits = told[:, :, 0].flatten(0, 1)
        cross = functional.cross_entropy(logits, cell.flatten(), reduction="none")
        off_px = (_places(told, cell) - places).abs().sum(2) * self._half
        errors = cross.view_as(off_px) + off_px / _CELL
        return (errors * there).sum() / there.sum().clamp(min=1.0)

    def forward(self, pictures: Mapping[str, Tensor], told: Tensor) -> Tensor:
        """Return the features of the crops at the most probable places.

        Args:
            pictures: key -> (B, C, H, W) uint8.
            told: predictions of :meth:`where`.

        Returns:
            (B, :attr:`outputs`) float32, without a gradient with respect to the places.
        """
        told = told.detach()
        sure, cell = torch.softmax(told[:, :, 0], -1).max(-1)
        place = _places(told, cell)
        seen = []
        for key, (side, zoom) in self.looks.items():
            cut = _cut_out(pictures[key], place * (self._half * zoom), side, self.dtype)
            encoder: Any = self.encoders[key]
            seen.append(convolved(encoder, cut).flatten(1))
        weight, bias = cast(self.linear.weight, self.linear.bias, self.dtype)
        features = functional.linear(torch.cat(seen, 1), weight, bias)
        features = functional.leaky_relu_(features).float()
        features = features.view(-1, self.count, self.features)
        return torch.cat([features, place, sure[..., None]], 2).flatten(1)


def _places(told: Tensor, cell: Tensor) -> Tensor:
    """(B, G, 2) the places that cells (B, G) say, of what :meth:`AttentionCrops.where` said."""
    return told[:, :, 1:].gather(3, cell[..., None, None].expand(-1, -1, 2, 1))[..., 0]


def _cut_out(picture: Tensor, place_px: Tensor, side: int, dtype: torch.dtype) -> Tensor:
    """(B G, C, side, side) around (B, G, 2) px right and up of the middle, less 127.5; 0 outside.

    Args:
        picture: (B, C, H, W) uint8.
        side: of the cut-outs, px.
    """
    b, channels, height, width = picture.shape
    steps = torch.arange(side, device=picture.device)
    left = (place_px[..., 0] + 0.5 * (width - side)).round().long()
    top = (0.5 * (height - side) - place_px[..., 1]).round().long()
    x, y = left[..., None] + steps, top[..., None] + steps
    inside = ((y >= 0) & (y < height))[..., :, None] & ((x >= 0) & (x < width))[..., None, :]
    first = height * width * torch.arange(b, device=picture.device)[:, None, None, None]
    rows, columns = y.clamp(0, height - 1) * width, x.clamp(0, width - 1)
    at = (first + rows[..., :, None] + columns[..., None, :]).flatten()
    pixels = channels_last(picture).permute(0, 2, 3, 1).reshape(-1, channels)[at]
    values = centred(pixels, dtype) * inside.flatten()[:, None]
    return values.view(-1, side, side, channels).permute(0, 3, 1, 2)
