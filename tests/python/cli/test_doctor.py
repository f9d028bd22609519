"""The report of ``sim2vr-harness doctor``."""

from __future__ import annotations

import json

import pytest

from sim2vr_harness.cli import doctor


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
    (check,) = doctor._openxr_check()
    assert (check.status, check.mend) == ("info", "")
    assert "none.json' in SIM2VR_OPENXR_RUNTIME" in check.found
    (tmp_path / "lib.so").write_bytes(b"no library")
    (tmp_path / "none.json").write_text('{"runtime": {"library_path": "./lib.so"}}')
    (check,) = doctor._openxr_check()
    assert check.status == "warning" and "libopenxr-dev" in check.mend
    monkeypatch.setattr(doctor, "_probe", lambda code: (True, "OpenGL (EGL)"))
    (check,) = doctor._openxr_check()
    assert check.status == "ok"
    assert "OpenGL (EGL); built without OpenGL (X11), Vulkan" in check.found


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
