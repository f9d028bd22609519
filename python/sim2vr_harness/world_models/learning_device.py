"""The device of imagined rollouts: the CPU, or a GPU that replays captured windows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import torch
from torch import Tensor, nn


class Part(Protocol):
    """Object whose state changes in a window; see :class:`~sim2vr_harness.base.state.State`."""

    def state_dict(self) -> dict[str, Any]:
        """Return copies of its tensors."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore the tensors of :meth:`state_dict`."""


class LearningDevice:
    """The device that learns, and its random numbers.

    On the CPU nothing is changed: same seed, same bits. On a GPU results differ in the last bits
    from run to run.

    Args:
        device: ``cpu``, ``cuda`` or ``cuda:N``.
    """

    def __init__(self, device: str | torch.device) -> None:
        self.device = torch.device(device)
        self.is_gpu = self.device.type == "cuda"
        self._gpus: Sequence[torch.device] = [self.device] if self.is_gpu else []
        self._stream: Any = None
        if self.is_gpu:
            self._stream = torch.cuda.Stream(self.device)  # type: ignore[no-untyped-call]

    @contextmanager
    def seeded(self, seed: int | Sequence[Tensor]) -> Iterator[None]:
        """Draw from a seed or a :meth:`random_state`; other draws are as without it."""
        with torch.random.fork_rng(self._gpus):
            if isinstance(seed, int):
                torch.manual_seed(seed)
            else:
                torch.set_rng_state(seed[0])
                for gpu, state in zip(self._gpus, seed[1:], strict=False):
                    torch.cuda.set_rng_state(state, gpu)
            yield

    def random_state(self) -> list[Tensor]:
        """Return where the random numbers stand, for :meth:`seeded`."""
        states = [torch.cuda.get_rng_state(gpu) for gpu in self._gpus]
        return [torch.get_rng_state(), *states]

    @contextmanager
    def active(self, *modules: nn.Module) -> Iterator[None]:
        """Make tensors on the device, and have modules there; afterwards modules are on the CPU."""
        if not self.is_gpu:
            yield
            return
        for module in modules:
            module.to(self.device)
        try:
            self._stream.wait_stream(torch.cuda.current_stream(self.device))
            with torch.cuda.stream(self._stream), self.device:
                yield
            self._stream.synchronize()
        finally:
            for module in modules:
                module.zero_grad(set_to_none=True)
                module.to("cpu")

    def window(self, run: Callable[[], Any], parts: Sequence[Part]) -> Window:
        """Return ``run`` as it is on the CPU, as a captured graph on a GPU."""
        return Window(run, parts, self._stream)

    def moved(self, state: Any) -> Any:
        """Return a state with its tensors on the device."""
        if isinstance(state, Tensor):
            return state.to(self.device)
        if isinstance(state, dict):
            return {name: self.moved(value) for name, value in state.items()}
        if isinstance(state, list):
            return [self.moved(value) for value in state]
        return state


class Window:
    """A function of no arguments that changes the tensors of some parts, on a GPU a CUDA graph.

    A window of imagined user steps is some ten thousand short operations: started one by one they
    keep a GPU waiting. Captured, they are one. What is not a tensor is a constant of the graph:
    call :meth:`forget` when it has changed.

    Args:
        run: the function; it must not read a tensor's values, and returns tensors.
        parts: what it changes, all tensors on the GPU.
        stream: that it runs on; None: a CPU, nothing is captured.
    """

    def __init__(
        self, run: Callable[[], Any], parts: Sequence[Part], stream: torch.cuda.Stream | None
    ) -> None:
        self._run, self._parts, self._stream = run, parts, stream
        self._graph: torch.cuda.CUDAGraph | None = None
        self._pool: Any = None
        self._kept: list[dict[str, Any]] = []
        self._returned: Any = None
        self._warm = False

    def forget(self) -> None:
        """Capture anew at the next call."""
        self._graph = self._returned = None
        self._kept = []

    def __call__(self) -> Any:
        """Run once, and return what the function returned; the next call overwrites it."""
        if self._stream is None or not self._warm:  # libraries choose their kernels at first
            self._warm = True
            return self._run()
        if self._graph is None:
            self._kept = [capture_part.state_dict() for capture_part in self._parts]
            self._pool = self._pool or torch.cuda.graph_pool_handle()
            self._graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self._graph, pool=self._pool, stream=self._stream):
                self._take()
                self._returned = self._run()
                for capture_kept, capture_part in zip(self._kept, self._parts, strict=True):
                    _copy(capture_part.state_dict(), capture_kept)
            self._take()
        for kept, part in zip(self._kept, self._parts, strict=True):
            _copy(part.state_dict(), kept)
        assert self._graph is not None
        self._graph.replay()
        self._take()
        return self._returned

    def _take(self) -> None:
        for kept, part in zip(self._kept, self._parts, strict=True):
            part.load_state_dict(kept)


def _copy(values: Any, to: Any) -> None:
    """Overwrite the tensors of a state by those of another one."""
    if isinstance(to, Tensor):
        with torch.no_grad():
            to.copy_(values)
    elif isinstance(to, dict | list):
        for name in to if isinstance(to, dict) else range(len(to)):
            _copy(values[name], to[name])
