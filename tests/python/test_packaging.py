"""Files that must agree with each other."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUB = ROOT / "python/sim2vr_harness/_app_runtime.pyi"


def test_every_dependency_is_locked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"] + project["optional-dependencies"]["dev"]
    names = {re.split(r"[<>=!~\[ ]", entry)[0].lower() for entry in wanted}
    lock = (ROOT / "requirements.lock").read_text()
    locked = dict(re.findall(r"^([a-z0-9-]+)==(\S+)$", lock, flags=re.MULTILINE))
    assert names <= set(locked)
    assert not [line for line in lock.splitlines() if "://" in line or "+cpu" in line]


def test_packages_txt_has_one_known_kind_per_line():
    lines = (ROOT / "packages.txt").read_text().splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    assert {kind for kind, _ in rows} == {"build", "runtime", "optional"}
    assert len(rows) == len({package for _, package in rows})


@pytest.mark.skipif(not STUB.exists(), reason="the extension module has no stub yet")
@pytest.mark.skipif(
    importlib.util.find_spec("pybind11_stubgen") is None, reason="needs pybind11-stubgen"
)
def test_the_stub_of_the_extension_module_is_current(tmp_path):
    fresh = tmp_path / "_app_runtime.pyi"
    subprocess.run([ROOT / "tools/dev/stubs.sh", fresh], check=True, capture_output=True)
    assert fresh.read_text() == STUB.read_text(), "the stub is out of date; run: make stubs"
