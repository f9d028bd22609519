"""The report of ``sim2vr-harness doctor``."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from python.cli.calls import call
from sim2vr_harness.base import paths
from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.cli import doctor
from sim2vr_harness.client.openxr import runtime_files
from sim2vr_harness.client.openxr.runtime_files import find_runtime
from sim2vr_harness.client.webxr import browser


@pytest.mark.parametrize(
    ("statuses", "exit_status"),
    [(["ok", "info"], 0), (["ok", "warning"], 0), (["ok", "missing"], 1)],
)
def test_only_missing_essentials_fail(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, statuses: list[Any], exit_status: int
) -> None:
    checks = [doctor.Check("it", each, "[not] there", "apt-get install it") for each in statuses]
    monkeypatch.setattr(doctor, "collect", lambda: checks)
    status, out, _ = call(capsys, "doctor", "--json")
    report = json.loads(out)
    assert (status, report["ok"]) == (exit_status, exit_status == 0)
    assert [check["status"] for check in report["checks"]] == statuses
    status, out, _ = call(capsys, "doctor")
    assert status == exit_status
    assert "[not] there" in out and "apt-get install it" in out


def test_a_browser_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, status, found in (("no-such-browser", "info", "none"), ("false", "warning", "false")):
        monkeypatch.setattr(browser, "BROWSERS", (name,))
        (check,) = doctor._browser_check()
        assert check.status == status and found in check.found
    monkeypatch.setattr(doctor, "_probe", lambda code: (True, "HeadlessChrome/1, SwiftShader"))
    (check,) = doctor._browser_check()
    assert check.status == "ok"


def test_an_openxr_runtime_is_looked_at(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SIM2VR_OPENXR_RUNTIME", str(tmp_path / "none.json"))
    check = next(doctor._openxr_check())
    assert (check.status, check.mend) == ("missing", "make setup")
    assert "none.json' in SIM2VR_OPENXR_RUNTIME" in check.found
    (tmp_path / "none.json").write_text('{"runtime": {"library_path": "./lib.so"}}')
    check = next(doctor._openxr_check())
    assert (check.status, check.mend) == ("missing", "make setup")
    assert "none.json without ./lib.so" in check.found
    (tmp_path / "lib.so").write_bytes(b"no library")
    check = next(doctor._openxr_check())
    assert check.status == "missing" and "libopenxr-dev" in check.mend
    monkeypatch.setattr(doctor, "_probe", lambda code: (True, "OpenGL (EGL)"))
    check = next(doctor._openxr_check())
    assert check.status == "ok"
    assert "OpenGL (EGL); without OpenGL (X11), Vulkan" in check.found


def test_the_built_openxr_runtime_says_what_programs_draw_with() -> None:
    """The runtime names an extension for each; one that has none could not be drawn with."""
    words = doctor.runtime_graphics(find_runtime()).split(", ")
    assert words and set(words) <= {"OpenGL (X11)", "OpenGL (EGL)", "Vulkan"}


def test_a_checkout_without_the_openxr_libraries_fails_and_names_the_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any
) -> None:
    """As after a set-up that left them out; doctor and commands name the same one."""
    monkeypatch.setattr(runtime_files, "_places", lambda: iter([tmp_path]))
    monkeypatch.setattr(doctor, "collect", lambda: list(doctor._openxr_check()))
    status, out, _ = call(capsys, "doctor", "--json")
    checks = json.loads(out)["checks"]
    assert status == 1
    assert [(check["status"], check["mend"]) for check in checks] == [("missing", "make setup")] * 4
    status, _, err = call(
        capsys, "render", "snapshot", "--openxr", "ls", "--out", str(tmp_path / "out")
    )
    assert status == 2
    assert "expected the package's own; run: make setup" in " ".join(err.split())


def test_setup_builds_what_is_looked_for(tmp_path: Path) -> None:
    """Each file that commands of the guides use is an output of the targets that it names."""
    root = paths.checkout_dir()
    assert root is not None
    (line,) = re.findall(r"cmake --build .*", (root / "tools/dev/setup.sh").read_text())
    targets = re.findall(r"--target ((?:[\w-]+ )+)", line)[0].split()
    configure: list[Any] = ["cmake", "-S", root, "-B", tmp_path, "-G", "Ninja"]
    configure += ["-DSIM2VR_INPLACE=ON", "-DSIM2VR_BUILD_TESTS=OFF"]
    configure += [f"-DPython_EXECUTABLE={sys.executable}", "-DSIM2VR_BUILD_BINDINGS=ON"]
    subprocess.run(configure, check=True, capture_output=True)
    asked: list[Any] = ["ninja", "-C", tmp_path, "-n", *targets]  # only says what it would build
    listed = subprocess.run(asked, check=True, capture_output=True, text=True).stdout
    built = {Path(file).name for file in re.findall(r"Linking .* (\S+)$", listed, re.MULTILINE)}
    runtime = find_runtime()
    wanted = {app_executable().name, runtime.name, runtime_files.CLOCK_LIBRARY}
    wanted |= {runtime_files.LAYER_LIBRARY, runtime_files.MODES_LIBRARY}
    wanted |= {json.loads(runtime.read_text())["runtime"]["library_path"].removeprefix("./")}
    manifests = {file.name for file in (tmp_path / "app_runtime/openxr").rglob("sim2vr_*.json")}
    assert manifests == {"sim2vr_openxr.json", "sim2vr_openxr_layer.json"}
    assert wanted - manifests <= built
    assert any(name.startswith("_app_runtime.") for name in built)


def test_a_probe_that_crashes_or_hangs_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor._probe("import os; os.abort()") == (False, "crashed with signal 6")
    assert doctor._probe("raise ValueError('boom')") == (False, "ValueError: boom")
    assert doctor._probe("print('fine')") == (True, "fine")
    monkeypatch.setattr(doctor, "_PROBE_DEADLINE_S", 0.2)
    assert doctor._probe("import time; time.sleep(30)") == (False, "no answer within 0 s")


def test_missing_debian_packages_are_named_with_the_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(
        doctor, "_installed_debian_packages", lambda wanted: set(wanted) - {"libpng-dev"}
    )
    runtime, build = doctor._debian_checks()
    assert runtime.status == "ok"
    assert (build.status, build.found) == ("warning", "missing: libpng-dev")
    assert build.mend.endswith("apt-get install -y --no-install-recommends libpng-dev")


def test_this_installation_is_whole() -> None:
    assert [check for check in doctor.collect() if check.status == "missing"] == []
