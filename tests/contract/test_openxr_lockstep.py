"""Unmodified OpenXR programs in lockstep: the same round twice, inputs that matter, and pictures.

Programs that need packages are started by the interpreter that SIM2VR_OPENXR_PYTHON names, or by
this one.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from openxr_programs import hands, open_program
from sim2vr_harness.client import AppRefused, OpenXRApp, frame_time_ns
from sim2vr_harness.client.openxr import find_runtime

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "openxr"
PYTHON = os.environ.get("SIM2VR_OPENXR_PYTHON", sys.executable)


@dataclass(frozen=True)
class Played:
    """A program, and how it is started."""

    command: tuple[str, ...]
    needs: str = ""
    depth: bool = False
    options: Mapping[str, object] = field(default_factory=dict)


QT = {"xvfb": True, "virtual_clock": True}
TOUCH, LAMPS = (str(EXAMPLES / name / f"{name}.py") for name in ("touch", "lamps"))
PROGRAMS = {
    "hello_xr, Vulkan2": Played(("hello_xr", "-g", "Vulkan2")),
    "hello_xr, Vulkan": Played(("hello_xr", "-g", "Vulkan")),
    "hello_xr, OpenGL": Played(("hello_xr", "-g", "OpenGL"), options={"xvfb": True}),
    "pyopenxr": Played((PYTHON, TOUCH, "--seed", "3"), "xr", True),
    "Qt": Played((PYTHON, LAMPS, "--seed", "3"), "PySide6", True, QT),
}


LAYER = "XR_APILAYER_LUNARG_core_validation"
LAYER_FILES = "XrApiLayer_core_validation*.json"
DEBIAN_LAYERS = Path("/usr/share/openxr/1/api_layers/explicit.d")
EXPECTED = {
    "Qt": [
        # The layer makes another handle of it than the one that it gave to the program: a program
        # that only creates and destroys a messenger gets the same message.
        "VUID-xrDestroyDebugUtilsMessengerEXT-messenger-parameter | xrDestroyDebugUtilsMessengerEXT"
    ]
}
"""Errors of the validation layer that are not the runtime's."""


def has(module: str) -> bool:
    """Whether the programs' interpreter has a package."""
    asked = subprocess.run([PYTHON, "-c", f"import {module}"], capture_output=True, check=False)
    return asked.returncode == 0


def folder_of_layer() -> Path:
    """The folder with Khronos's validation layer: of pyopenxr, or of Debian."""
    where = "import xr; print(xr.__path__[0])"
    asked = subprocess.run([PYTHON, "-c", where], capture_output=True, text=True, check=False)
    own = Path(asked.stdout.strip(), "api_layer", f"linux_{os.uname().machine}")
    for folder in (own, DEBIAN_LAYERS):
        if any(folder.glob(LAYER_FILES)):
            return folder
    pytest.skip("no validation layer (apt-get install openxr-layer-corevalidation)")


@pytest.fixture(params=PROGRAMS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def played(name: str) -> Played:
    found = PROGRAMS[name]
    try:
        find_runtime()
    except AppRefused as error:
        pytest.skip(str(error))
    if shutil.which(found.command[0]) is None:
        pytest.skip(f"no {found.command[0]} (apt-get install libopenxr-utils)")
    if found.options.get("xvfb") and shutil.which("Xvfb") is None:
        pytest.skip("no Xvfb")
    if found.needs and not has(found.needs):
        pytest.skip(f"{PYTHON} has no {found.needs}; SIM2VR_OPENXR_PYTHON names another Python")
    return found


def opened(played: Played, **settings: object) -> OpenXRApp:
    settings = {"width": 60, "height": 40, "eyes": 2, "timeout_s": 60.0} | settings
    settings |= {"start_timeout_s": 60.0, "depth": played.depth, "options": played.options}
    return open_program(*played.command, **settings)


def round_of(app: OpenXRApp, steps: int = 40, height_m: float = 1.1) -> tuple[str, int]:
    """Hash of all pictures, and how many vibrations there were."""
    app.reset(1, hands(height_m))
    found, pulses = hashlib.sha256(app.image.tobytes()), 0
    for step in range(1, steps):
        poses = hands(height_m + 0.1 * np.sin(0.3 * step), trigger=float(step % 10 < 3))
        pulses += len(app.step(frame_time_ns(step, 20), poses).haptics)
        found.update(app.image.tobytes())
    return found.hexdigest(), pulses


def test_the_same_round_twice_and_another_one(played: Played) -> None:
    with opened(played) as app:
        first = round_of(app)
        assert round_of(app) == first
        left, right = app.image[..., :3].astype(int)
        assert len(np.unique(left.reshape(-1, 3), axis=0)) > 1
        assert (left != right).any()
    with opened(played) as app:
        assert round_of(app) == first


def test_the_validation_layer_finds_no_error(
    name: str, played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = tmp_path / "report.txt"
    monkeypatch.setenv("XR_API_LAYER_PATH", str(folder_of_layer()))
    monkeypatch.setenv("XR_ENABLE_API_LAYERS", LAYER)
    monkeypatch.setenv("XR_CORE_VALIDATION_EXPORT_TYPE", "text")
    monkeypatch.setenv("XR_CORE_VALIDATION_FILE_NAME", str(report))
    with opened(played) as app:
        round_of(app)
    lines = report.read_text()
    assert "Core Validation Layer is initialized" in lines
    found = re.findall(r"\[VALID_(?:ERROR|WARNING) \| ([^\]]+)\]", lines)
    assert found == EXPECTED.get(name, []), lines


def test_frames_of_a_step_reach_the_program(played: Played) -> None:
    """Three frames in a message end where three messages do."""
    moments = [hands(1.0 + 0.02 * k) for k in range(4)]
    with opened(played) as app, opened(played) as other:
        app.reset(1, moments[0])
        other.reset(1, moments[0])
        for k in (1, 2, 3):
            app.step(frame_time_ns(k, 60), moments[k])
        times = np.array([frame_time_ns(k, 60) for k in (1, 2, 3)])
        other.step_frames(times, type(moments[0]).stack(moments[1:]))
        np.testing.assert_array_equal(app.image, other.image)


def test_depth_is_linear_and_refused_where_there_is_none(played: Played) -> None:
    if not played.depth:
        with opened(played) as app:
            app._launch = type(app._launch)(**{**vars(app._launch), "depth": True})
            with pytest.raises(AppRefused, match=r"vision.channels: got depth, but hello_xr"):
                app.reset(1, hands())
        return
    with opened(played) as app:
        app.reset(1, hands())
        depth_m = app.image[0, ..., 3] * (10.0 / 255.0)
        # The wall behind everything: 4 m away in the one, 3 m and a sky in the other.
        wall_m = 4.0 if "touch" in played.command[1] else 3.0
        assert np.median(depth_m[10:15, 20:40]) == pytest.approx(wall_m, abs=0.12)
