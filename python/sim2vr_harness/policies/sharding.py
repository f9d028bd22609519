"""A batch through a network in shards, one core each.

Torch spreads every single operation over the cores and waits for the slowest of them each time;
whatever else the machine does then stops all cores, dozens of times per minibatch, and the
activations of 1,000 images fit no cache. Here a thread takes a shard of the batch through the whole
network, forward and backward, and the only wait is at the end. Where the shards begin and end does
not depend on the number of threads, and their gradients are added in their order: the result is the
same to the bit for any number of threads.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.base.torch_threads import torch_threads

Batch = dict[str, Tensor]
Network = Callable[[Batch], tuple[Tensor, ...]]

LEARNING, ACTING = 125, 32
"""Samples per shard, with gradients and without. Larger ones leave the caches, and their blocks of
memory are so large that the C library returns them; smaller ones spend their time on handing over
and on adding up gradients."""


def in_shards(
    network: Network, parameters: Sequence[Tensor], batch: Batch, workers: int
) -> tuple[Tensor, ...]:
    """Return ``network(batch)``, computed shard by shard in ``workers`` threads.

    Args:
        network: Row-wise: row i of each output depends on row i of the batch alone.
        parameters: What gradients are wanted of; ``network`` uses every one of them.
        batch: key -> (B, ...), on the CPU. The outputs are not differentiated by it.
        workers: Number of threads. They make no difference to the result.

    Returns:
        The outputs, (B, ...) each. Gradients reach ``parameters`` unless they are switched off.
    """
    learning = torch.is_grad_enabled() and len(parameters) > 0
    size = LEARNING if learning else ACTING
    columns = zip(*(torch.split(values, size) for values in batch.values()), strict=True)
    shards = [dict(zip(batch.keys(), column, strict=True)) for column in columns]
    if learning:
        outputs: tuple[Tensor, ...] = _InShards.apply(network, shards, workers, *parameters)  # type: ignore[no-untyped-call]
        return outputs
    with torch.no_grad(), torch_threads(1):
        if workers == 1 or len(shards) == 1:
            return _joined([network(shard) for shard in shards])
        return _joined(list(_pool(workers).map(torch.no_grad()(network), shards)))


@cache
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, "shard", initializer=torch.set_num_threads, initargs=(1,))


def _joined(outputs: Sequence[tuple[Tensor, ...]]) -> tuple[Tensor, ...]:
    return tuple(torch.cat(parts) for parts in zip(*outputs, strict=True))


class _InShards(torch.autograd.Function):
    """Every shard keeps a graph of its own, which the backward pass runs in the same threads."""

    @staticmethod
    def forward(
        ctx: Any,
        network: Network,
        shards: list[Batch],
        workers: int,
        *parameters: Tensor,
    ) -> tuple[Tensor, ...]:
        ctx.parameters, ctx.pool = parameters, _pool(workers)
        # Whether gradients are on is known to each thread for itself.
        ctx.outputs = list(ctx.pool.map(torch.enable_grad()(network), shards))
        return _joined([tuple(part.detach() for part in output) for output in ctx.outputs])

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        sizes = [len(output[0]) for output in ctx.outputs]
        columns = zip(*(torch.split(gradient, sizes) for gradient in gradients), strict=True)

        def differentiate(output: tuple[Tensor, ...], gradient: tuple[Tensor, ...]) -> Any:
            # Some outputs may depend on frozen weights alone.
            live = [k for k, part in enumerate(output) if part.requires_grad]
            return torch.autograd.grad(
                [output[k] for k in live], ctx.parameters, [gradient[k] for k in live]
            )

        results = ctx.pool.map(differentiate, ctx.outputs, columns)
        total = list(next(results))
        for more in results:
            torch._foreach_add_(total, list(more))
        return None, None, None, *total
