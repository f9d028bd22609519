"""Unmodified OpenXR programs in lockstep: the same round twice, inputs that matter, and pictures.

Programs that need packages are started by the interpreter that SIM2VR_OPENXR_PYTHON names, or by
this one.
"""

import hashlib
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from openxr_programs import PROGRAMS, PYTHON, Played, hands, opened, playable
from parts import missing
from sim2vr_harness.client import AppRefused, OpenXRApp, frame_time_ns

LAYER = "XR_APILAYER_LUNARG_core_validation"
EXPECTED = {
    "Qt": [
        # The layer makes another handle of it than the one that it gave to the program: a program
        # that only creates and destroys a messenger gets the same message.
        "VUID-xrDestroyDebugUtilsMessengerEXT-messenger-parameter | xrDestroyDebugUtilsMessengerEXT"
    ]
}
"""Errors of the validation layer that are not the runtime's."""


def folder_of_layer() -> Path:
    """The folder with Khronos's validation layer. Debian's is too old: it knows no EGL."""
    where = "import xr; print(xr.__path__[0])"
    asked = subprocess.run([PYTHON, "-c", where], capture_output=True, text=True, check=False)
    folder = Path(asked.stdout.strip(), "api_layer", f"linux_{os.uname().machine}")
    if asked.returncode != 0 or not folder.is_dir():
        missing("openxr", "no pyopenxr in the Python of SIM2VR_OPENXR_PYTHON")
    return folder


@pytest.fixture(params=PROGRAMS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def played(name: str) -> Played:
    return playable(PROGRAMS[name])


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
