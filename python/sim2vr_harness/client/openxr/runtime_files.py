"""Paths of the OpenXR runtime and of the libraries that programs preload."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

from sim2vr_harness.base import paths
from sim2vr_harness.client.errors import AppRefused

RUNTIME_VARIABLE = "SIM2VR_OPENXR_RUNTIME"
"""Environment variable that names another manifest of the runtime."""
MANIFEST = "sim2vr_openxr.json"
CLOCK_LIBRARY = "libsim2vr_clock.so"
"""Virtual time, and lines of output that are written at once."""
MODES_LIBRARY = "libsim2vr_vidmode.so"
"""Gives programs that ask an X server for its modes one mode."""
_BUILT = ("openxr", "preload")
_EXPECTED = "the package's own, built with OpenXR's headers (apt-get install libopenxr-dev)"


def _places() -> Iterator[Path]:
    """Folders that may hold them: of the wheel, or of a checkout's builds."""
    for package in paths.package_dirs():
        yield package / "lib"
    if (root := paths.checkout_dir()) is not None:
        for build in sorted((root / "build").glob("*/app_runtime")):
            yield from (build / name for name in _BUILT)


def find_runtime() -> Path:
    """Return the manifest of the runtime; ``SIM2VR_OPENXR_RUNTIME`` takes precedence.

    Raises:
        AppRefused: there is none, or its library is missing.
    """
    named = os.environ.get(RUNTIME_VARIABLE)
    files = [Path(named)] if named else [place / MANIFEST for place in _places()]
    found = next((file for file in files if file.is_file()), None)
    if found is None:
        got = f"{named!r} in {RUNTIME_VARIABLE}" if named else "none"
        raise AppRefused(f"OpenXR runtime: got {got}, expected {_EXPECTED}")
    try:
        library = json.loads(found.read_text())["runtime"]["library_path"]
        there = (found.parent / str(library)).is_file()
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise AppRefused(f"OpenXR runtime: got {found}, which is no manifest ({error})") from error
    if not there:
        raise AppRefused(f"OpenXR runtime: got {found} without {library}, expected {_EXPECTED}")
    return found.resolve()


def find_library(name: str) -> Path | None:
    """Return the path of a library that programs preload; None: it was not built."""
    return next((file for place in _places() if (file := place / name).is_file()), None)
