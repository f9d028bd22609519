"""Virtual time of a program: a page of memory that the preloaded library reads."""

import mmap
import os
import struct
import weakref

CLOCK_VARIABLE = "SIM2VR_CLOCK"
"""Environment variable with the number of the page's descriptor."""
START_NS = 100_000_000_000
"""XrTime of a round's first frame, with and without virtual time; must be above 0."""
_STARTUP_NS = START_NS - 10_000_000_000
"""Virtual time until the first frame; sleeps of the start fit before it."""

_NOW = struct.Struct("<q")
_STATE = struct.Struct("<II")
_STARTING, _PLAYING, _WAITING = 0, 1, 2


class VirtualClock:
    """The page of one program; see ``app_runtime/preload/clock.c`` for its layout.

    Attributes:
        descriptor: to be inherited by the program.
    """

    def __init__(self) -> None:
        self.descriptor = os.memfd_create("sim2vr-clock", os.MFD_CLOEXEC)
        os.posix_fallocate(self.descriptor, 0, mmap.PAGESIZE)
        self._page = mmap.mmap(self.descriptor, mmap.PAGESIZE)
        self._generation = 0
        _NOW.pack_into(self._page, 0, _STARTUP_NS)
        self._finalizer = weakref.finalize(self, os.close, self.descriptor)

    def play(self, time_ns: int) -> None:
        """Set the time; the program is about to compute frames."""
        _NOW.pack_into(self._page, 0, max(time_ns, *_NOW.unpack_from(self._page)))
        self._set(_PLAYING)

    def wait(self) -> None:
        """Note that the program waits for the next step."""
        self._set(_WAITING)

    def _set(self, state: int) -> None:
        self._generation = (self._generation + 1) & 0xFFFFFFFF
        _STATE.pack_into(self._page, 8, self._generation, state)

    def close(self) -> None:
        """Give the page back; idempotent."""
        self._finalizer()
