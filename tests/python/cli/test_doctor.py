"""The report of ``sim2vr-harness doctor``."""

import json
import re
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


def test_this_installation_is_whole() -> None:
    assert [check for check in doctor.collect() if check.status == "missing"] == []
