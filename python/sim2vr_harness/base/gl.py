"""Preparation of a process before it opens its first OpenGL context."""

import importlib
import importlib.util
from functools import cache


@cache
def prepare_process() -> None:
    """Load libraries that cannot be loaded after Mesa's CPU driver.

    The driver loads LLVM with its symbols visible to everything loaded later. Triton, which comes
    with PyTorch's CUDA builds and is imported when the first optimiser is made, brings an LLVM of
    another version and crashes if it finds those symbols. Loaded before the driver it keeps to its
    own. Does nothing without Triton.
    """
    if importlib.util.find_spec("triton") is not None:
        importlib.import_module("triton._C.libtriton")
