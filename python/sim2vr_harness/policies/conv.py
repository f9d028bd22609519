"""Convolutions of pictures as bytes, in a precision below that of their weights."""

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

_MIDDLE = 127.5
"""(x / 255 - 0.5) * 2 = (x - 127.5) / 127.5. The difference is exact, in bfloat16 too; the factor
goes into the first weights. Zero padding stays what it is."""


def convolutions(
    inputs: int, channels: Sequence[int], strides: Sequence[int] | None = None
) -> nn.Sequential:
    """Return 3x3 convolutions with padding 1, of stride 2 unless it is said, leaky behind each."""
    layers: list[nn.Module] = []
    for outputs, stride in zip(channels, strides or [2] * len(channels), strict=True):
        layers += [nn.Conv2d(inputs, outputs, 3, stride, padding=1), nn.LeakyReLU()]
        inputs = outputs
    return nn.Sequential(*layers)


def centred(picture: Tensor, dtype: torch.dtype) -> Tensor:
    """Bytes less 127.5, a copy, for :func:`convolved`."""
    return picture.to(dtype, copy=True).sub_(_MIDDLE)


def convolved(layers: Iterable[nn.Module], picture: Tensor) -> Tensor:
    """Take a picture through convolutions, leaky behind each, all other layers left out.

    Args:
        layers: of them, with weights of float32.
        picture: (B, C, H, W) of :func:`centred`; what is computed in is its type.
    """
    x, factor = picture, 1.0 / _MIDDLE
    for layer in layers:
        if isinstance(layer, nn.Conv2d):
            weight, bias = cast(layer.weight * factor, layer.bias, x.dtype)
            x = functional.conv2d(x, weight, bias, layer.stride, layer.padding)
            x = functional.leaky_relu_(x)
            factor = 1.0
    return x


def cast(weight: Tensor, bias: Tensor | None, dtype: torch.dtype) -> tuple[Tensor, Tensor | None]:
    """Weights in another type, differentiable."""
    return weight.to(dtype), None if bias is None else bias.to(dtype)


def channels_last(image: Tensor) -> Tensor:
    """Return (B, C, H, W) images with the bytes of a pixel beside each other."""
    if image.is_contiguous(memory_format=torch.channels_last):
        return image
    # Several times as quick as .contiguous(memory_format=torch.channels_last) for bytes.
    return torch.stack(image.unbind(1), dim=-1).permute(0, 3, 1, 2)
