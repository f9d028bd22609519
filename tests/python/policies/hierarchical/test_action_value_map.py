"""Values of options by image cell, against the same layers written out in float64."""

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid

N, HANDS = 5, 2
SIGHT = DepthGrid(16, 24)


def network() -> ActionValueMap:
    torch.manual_seed(3)
    net = ActionValueMap(SIGHT, HANDS)
    for layer in (net.leave, net.rest):
        torch.nn.init.normal_(layer.weight)
    return net


def scene() -> tuple[Tensor, ...]:
    torch.manual_seed(4)
    pictures = torch.randint(0, 256, (N, 8, SIGHT.height, SIGHT.width), dtype=torch.uint8)
    places = torch.randn(N, 3, SIGHT.rows, SIGHT.columns)
    return pictures, places, *(torch.randn(N, *shape) for shape in ((3,), (HANDS, 3), (HANDS, 3)))


def written_out(weights: dict[str, Tensor], given: tuple[Tensor, ...]) -> Tensor:
    """Lengths are in units of 0.4 m near and 2 m far, speeds of 2 m/s, bytes from -1 to 1."""
    pictures, places, head, tips, velocities = (each.double() for each in given)

    def layer(name: str, x: Tensor, **how: Any) -> Tensor:
        return functional.conv2d(x, weights[f"{name}.weight"], weights[f"{name}.bias"], **how)

    x = functional.silu(layer("stem.0", pictures / 127.5 - 1.0, stride=2, padding=1))
    x = functional.silu(layer("stem.2", x, stride=2, padding=1))
    from_head = places - head[:, :, None, None]
    maps = [from_head]
    for hand in range(HANDS):
        away = places - tips[:, hand, :, None, None]
        maps += [away, torch.linalg.vector_norm(away, dim=1, keepdim=True)]
    geometry = torch.cat([torch.cat(maps, 1) / 0.4, from_head / 2.0], 1).clamp(-3.0, 3.0)
    x = functional.silu(layer("enter", torch.cat([x, geometry], 1)))
    hands = torch.cat([(tips - head[:, None]) / 0.4, velocities / 2.0], -1).flatten(1)
    known = torch.cat([x.mean((2, 3)), hands], 1)
    common = known @ weights["common.weight"].T + weights["common.bias"]
    spread = layer("spread", x, padding=2, dilation=2)
    x = functional.silu(spread + x + common[:, :, None, None])
    rest = functional.silu(common) @ weights["rest.weight"].T + weights["rest.bias"]
    moves = layer("leave", x).reshape(N, HANDS, -1)
    return torch.cat([moves, rest.reshape(N, HANDS, -1)], -1)


def test_values_and_gradients_are_those_of_the_layers_written_out() -> None:
    net, given = network(), scene()
    exact = {name: p.detach().double().requires_grad_() for name, p in net.named_parameters()}
    values, wanted = net(*given), written_out(exact, given)
    assert values.shape == (N, HANDS, len(net.options.placed) * SIGHT.cells + 1)
    torch.testing.assert_close(values.double(), wanted, rtol=1e-5, atol=1e-4)
    found = torch.autograd.grad(values.square().mean(), list(net.parameters()))
    for gradient, right in zip(
        found, torch.autograd.grad(wanted.square().mean(), list(exact.values())), strict=True
    ):
        scale = float(right.abs().max())
        torch.testing.assert_close(gradient.double(), right, rtol=1e-4, atol=1e-5 * scale)
