"""Software rendering in a browser, in one thread for each user."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

from sim2vr_harness.client.errors import AppRefused

RENDERERS = ("swiftshader", "mesa")

_LIBRARY = "libvk_swiftshader.so"
_LONGEST_SCRIPT_BYTES = 1 << 16


@dataclass(frozen=True)
class Drawing:
    """How a browser is started to draw.

    Attributes:
        flags: on its command line.
        environment: variables.
        files: name -> content, to lie in the working directory.
    """

    flags: tuple[str, ...]
    environment: dict[str, str]
    files: dict[str, str]


def drawing_by(renderer: str, program: str, folder: str) -> Drawing:
    """Return how a browser is started to draw with a renderer.

    SwiftShader is the browser's own: the same pictures with any driver, or without. By itself it
    has a thread for each core, which wait for each other in loops. A file in the working directory
    gives it one, but ANGLE enters the browser's folder before SwiftShader looks for that; loaded as
    a Vulkan driver of ours, it looks here. Mesa's llvmpipe draws in the thread that asks.

    Args:
        renderer: one of :data:`RENDERERS`.
        program: the browser's path, or that of a script that starts it.
        folder: the working directory.

    Raises:
        AppRefused: there is no such renderer.
    """
    if renderer == "mesa":
        environment = {
            "LP_NUM_THREADS": "0",
            "EGL_PLATFORM": "surfaceless",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "GALLIUM_DRIVER": "llvmpipe",
        }
        return Drawing(("--use-angle=gl-egl",), environment, {})
    if renderer != RENDERERS[0]:
        raise AppRefused(
            f"app.transport_options.renderer: got {renderer!r}, expected one of "
            f"{', '.join(RENDERERS)}"
        )
    library = _find_library(Path(program))
    allowed = "--enable-unsafe-swiftshader"
    if library is None:
        return Drawing(("--use-angle=swiftshader", allowed), {}, {})
    driver = {
        "file_format_version": "1.0.0",
        "ICD": {"library_path": str(library), "api_version": "1.0.5"},
    }
    found = f"{folder}/driver.json"
    return Drawing(
        ("--use-angle=vulkan", allowed),
        {"VK_DRIVER_FILES": found, "VK_ICD_FILENAMES": found},
        {"driver.json": json.dumps(driver), "SwiftShader.ini": "[Processor]\nThreadCount=1\n"},
    )


def _find_library(program: Path) -> Path | None:
    """Return SwiftShader of a browser: beside it, or beside what a script starts."""
    folders = [program.resolve().parent]
    with program.open("rb") as stream:
        start = stream.read(_LONGEST_SCRIPT_BYTES)
    if start.startswith(b"#!"):
        for name in re.findall(r"/[\w./+-]+", start.decode(errors="replace")):
            folders += [Path(name), Path(name).parent]
    return next((one / _LIBRARY for one in folders if (one / _LIBRARY).is_file()), None)
