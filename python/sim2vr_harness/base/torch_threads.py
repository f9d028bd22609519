"""Context manager for torch's number of threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch use ``count`` threads within the block.

    One thread is best between simulation steps: a small batch gains nothing from more, and torch's
    waiting threads take the cores from the physics (on two busy cores, 4 times the user steps).
    """
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
