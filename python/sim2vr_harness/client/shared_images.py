"""Images in memory that an app shares with this process."""

import mmap
import os

import numpy as np

from sim2vr_harness.client.base import UInt8Array


def map_images(path: str, link: str, shape: tuple[int, ...]) -> UInt8Array | None:
    """Map an app's images, to read only; None where they cannot be reached from here.

    Args:
        path: of the memory, such as ``/proc/PID/fd/N``.
        link: where that leads; in another container the same path is something else.
        shape: of all images together, uint8.
    """
    try:
        if os.readlink(path) != link:
            return None
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except (OSError, ValueError):
        return None
    try:
        return map_file(descriptor, shape)
    finally:
        os.close(descriptor)


def map_file(descriptor: int, shape: tuple[int, ...]) -> UInt8Array | None:
    """Map the images of an open file, to read only; None where they do not fit into it."""
    size = int(np.prod(shape))
    try:
        if os.fstat(descriptor).st_size < size:
            return None
        memory = mmap.mmap(descriptor, size, prot=mmap.PROT_READ)
    except (OSError, ValueError):
        return None
    return np.frombuffer(memory, np.uint8).reshape(shape)
