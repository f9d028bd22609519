"""The report of ``sim2vr-harness doctor``."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sim2vr_harness.base import paths
from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.cli import doctor
from sim2vr_harness.cli.main import main
from sim2vr_harness.client.openxr import find_runtime, runtime_files


def checks_of(*statuses):
    return [doctor.Check(f"part {i}", status, "found") for i, status in enumerate(statuses)]


@pytest.mark.parametrize(
    ("statuses", "exit_status"),
    [
        (["ok", "info"], 0),
        (["ok", "warning"], 0),
        (["ok", "missing"], 1),
    ],
)
def test_only_missing_essentials_fail(monkeypatch, capsys, statuses, exit_status):
    monkeypatch.setattr(doctor, "collect", lambda: checks_of(*statuses))
    assert doctor.run_doctor(json=True) == exit_status
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] == (exit_status == 0)
    assert [check["status"] for check in report["checks"]] == statuses


def test_the_table_gives_the_mending_command(monkeypatch, capsys):
    check = doctor.Check("a part", "missing", "[not] there", "apt-get install -y a-part")
    monkeypatch.setattr(doctor, "collect", lambda: [check])
    assert doctor.run_doctor() == 1
    output = capsys.readouterr().out
    assert "[not] there" in output
    assert "apt-get install -y a-part" in output


def test_a_browser_is_looked_at(monkeypatch):
    from sim2vr_harness.client.webxr import browser

    monkeypatch.setattr(browser, "BROWSERS", ("no-such-browser",))
    (check,) = doctor._browser_check()
    assert (check.status, check.mend) == ("info", "")
    monkeypatch.setattr(browser, "BROWSERS", ("false",))
    (check,) = doctor._browser_check()
    assert check.status == "warning"
    assert "false (process" in check.found
    monkeypatch.setattr(doctor, "_probe", lambda code: (True, "HeadlessChrome/1, SwiftShader"))
    (check,) = doctor._browser_check()
    assert check.status == "ok"


def test_an_openxr_runtime_is_looked_at(monkeypatch, tmp_path):
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


def test_a_checkout_without_the_openxr_libraries_fails_and_names_the_command(
    monkeypatch, tmp_path, capsys
):
    """As after a set-up that left them out; doctor and commands name the same one."""
    monkeypatch.setattr(runtime_files, "_places", lambda: iter([tmp_path]))
    monkeypatch.setattr(doctor, "collect", lambda: list(doctor._openxr_check()))
    assert doctor.run_doctor(json=True) == 1
    checks = json.loads(capsys.readouterr().out)["checks"]
    assert [(check["status"], check["mend"]) for check in checks] == [("missing", "make setup")] * 4
    with pytest.raises(SystemExit, match="2"):
        main(["render", "snapshot", "--openxr", "ls", "--out", str(tmp_path / "out")])
    assert "expected the package's own; run: make setup" in " ".join(
        capsys.readouterr().err.split()
    )


@pytest.mark.skipif(shutil.which("ninja") is None, reason="needs ninja")
def test_setup_builds_what_is_looked_for(tmp_path):
    """Each file that commands of the guides use is an output of the targets that it names."""
    root = paths.checkout_dir()
    (line,) = re.findall(r"cmake --build .*", (root / "tools/dev/setup.sh").read_text())
    targets = re.search(r"--target ((?:[\w-]+ )+)", line).group(1).split()
    configure = ["cmake", "-S", root, "-B", tmp_path, "-G", "Ninja", "-DSIM2VR_INPLACE=ON"]
    configure += [f"-DPython_EXECUTABLE={sys.executable}", "-DSIM2VR_BUILD_BINDINGS=ON"]
    subprocess.run([*configure, "-DSIM2VR_BUILD_TESTS=OFF"], check=True, capture_output=True)
    asked = ["ninja", "-C", tmp_path, "-n", *targets]  # only says what it would build
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


def test_a_crashing_probe_is_reported_not_suffered():
    assert doctor._probe("import os; os.abort()") == (False, "crashed with signal 6")
    assert doctor._probe("raise ValueError('boom')") == (False, "ValueError: boom")
    assert doctor._probe("print('fine')") == (True, "fine")


def test_a_hanging_probe_is_given_up(monkeypatch):
    monkeypatch.setattr(doctor, "_PROBE_DEADLINE_S", 0.2)
    worked, answer = doctor._probe("import time; time.sleep(30)")
    assert not worked
    assert "no answer within" in answer


def test_missing_debian_packages_are_named_with_the_command(monkeypatch):
    monkeypatch.setattr(doctor.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(
        doctor, "_installed_debian_packages", lambda wanted: set(wanted) - {"libpng-dev"}
    )
    rows = {check.name: check for check in doctor._debian_checks()}
    assert rows["Debian packages (runtime)"].status == "ok"
    build = rows["Debian packages (build)"]
    assert build.status == "warning"
    assert build.found == "missing: libpng-dev"
    assert build.mend.endswith("apt-get install -y --no-install-recommends libpng-dev")


def test_this_installation_is_whole():
    missing = [check for check in doctor.collect() if check.status == "missing"]
    assert not missing, missing


def test_what_people_look_with_is_named(monkeypatch):
    checks = {check.name: check for check in doctor._looking_checks()}
    assert list(checks) == ["font", "ffmpeg", "windows and RecordVideo", "viewer of bodies"]
    assert checks["font"].status == "ok"
    assert "mujoco-studio FILE.xml" in checks["viewer of bodies"].found
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("shutil.which", lambda *name, **path: None)
    checks = {check.name: check for check in doctor._looking_checks()}
    assert "sim2vr-harness[video]" in checks["windows and RecordVideo"].found
    assert {check.status for check in checks.values()} == {"ok", "info"}
