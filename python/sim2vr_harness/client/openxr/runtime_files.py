"""Paths of the OpenXR runtime and of the libraries that programs preload."""

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
LAYER_LIBRARY = "libsim2vr_openxr_layer.so"
"""Records what programs do on a headset."""
_BUILT = ("openxr", "openxr/layer", "preload")


def _places() -> Iterator[Path]:
    """Folders that may hold them: of the wheel, or of a checkout's builds."""
    for package in paths.package_dirs():
        yield package / "lib"
    if (root := paths.checkout_dir()) is not None:
        builds = sorted((root / "build").glob("*/app_runtime"))
        for build in sorted(builds, key=lambda found: found.parent.name != "release"):
            yield from (build / name for name in _BUILT)


def find_runtime() -> Path:
    """Return the manifest of the runtime; ``SIM2VR_OPENXR_RUNTIME`` takes precedence.

    Raises:
        AppRefused: there is none, or its library is missing.
    """
    named = os.environ.get(RUNTIME_VARIABLE)
    files = [Path(named)] if named else [place / MANIFEST for place in _places()]
    got = f"{named!r} in {RUNTIME_VARIABLE}" if named else "none"
    for file in filter(Path.is_file, files):
        try:
            library = json.loads(file.read_text())["runtime"]["library_path"]
            if (file.parent / str(library)).is_file():
                return file.resolve()
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise AppRefused(
                f"OpenXR runtime: got {file}, which is no manifest ({error})"
            ) from error
        got = f"{file} without {library}"
    raise AppRefused(
        f"OpenXR runtime: got {got}, expected the package's own; run: {paths.rebuild_command()}"
    )


def find_library(name: str) -> Path | None:
    """Return the path of a library that programs preload; None: it was not built."""
    return next((file for place in _places() if (file := place / name).is_file()), None)
