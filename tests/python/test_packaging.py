"""Files that must agree with each other."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
STUB = ROOT / "python/sim2vr_harness/_app_runtime.pyi"


def test_the_stub_of_the_extension_module_is_current(tmp_path):
    fresh = tmp_path / "_app_runtime.pyi"
    subprocess.run([ROOT / "tools/dev/stubs.sh", fresh], check=True, capture_output=True)
    assert fresh.read_text() == STUB.read_text(), "the stub is out of date; run: make stubs"


def test_a_wheel_carries_the_licences_of_what_it_carries(tmp_path):
    """Of a wheel with one library, renamed as auditwheel does; hashes and headers stay right."""
    tool = ROOT / "tools/dev/wheel_licences.py"
    real = sorted(Path("/usr/lib").glob("*-linux-gnu/libzmq.so.*.*"))
    renamed = real[0].name.replace("libzmq.so", "libzmq-98f0defc.so")
    made = tmp_path / "x-1-cp311-cp311-manylinux_2_35_x86_64.whl"
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr(f"x.libs/{renamed}", b"")
        metadata = "Metadata-Version: 2.4\nName: x\nLicense-File: LICENSE\n\nAbout.\n\nMore."
        archive.writestr("x-1.dist-info/METADATA", metadata)
        archive.writestr("x-1.dist-info/WHEEL", "Wheel-Version: 1.0\n")
        archive.writestr("x-1.dist-info/RECORD", "")
    out = tmp_path / "dist"
    out.mkdir()
    subprocess.run([sys.executable, tool, made, out], check=True, capture_output=True)
    place = "x-1.dist-info/licenses/carried"
    with zipfile.ZipFile(out / made.name) as archive:
        texts = {name: archive.read(name) for name in archive.namelist() if name[-1] != "/"}
    listed = texts[f"{place}/README.md"].decode()
    assert re.search(rf"\| libzmq5\S* \| \S+ \| {re.escape(renamed)} \|", listed)
    for package in ("libzmq5", "libeigen3-dev", "cppzmq-dev"):
        found = [text for name, text in texts.items() if name.startswith(f"{place}/{package}")]
        assert found == [Path(f"/usr/share/doc/{package}/copyright").read_bytes()]
    # ZeroMQ's page names the LGPL, whose text is beside it.
    assert b"GNU LESSER GENERAL PUBLIC LICENSE" in texts[f"{place}/common-licenses/LGPL-3"]
    headers, _, rest = texts["x-1.dist-info/METADATA"].decode().partition("\n\n")
    assert "License-File: carried/libzmq5.txt" in headers and rest == "About.\n\nMore."
    # What belongs to no package is said, and no wheel is left.
    with zipfile.ZipFile(made, "a") as archive:
        archive.writestr("x.libs/libnobody-00000000.so.1", b"")
    (out / made.name).unlink()
    failed = subprocess.run([sys.executable, tool, made, out], capture_output=True, check=False)
    assert b"got no package with libnobody.so.1" in failed.stderr
    assert failed.returncode and not list(out.iterdir())


def test_every_package_is_in_the_list_of_third_parties() -> None:
    """Dependencies, extras and libraries of C++ by their names there; and no figure of others."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = list(project["dependencies"])
    for extra in project["optional-dependencies"].values():
        wanted += extra
    names = {re.split(r"[<>=!~\[ ]", entry)[0].lower() for entry in wanted}
    text = (ROOT / "THIRD_PARTY_LICENSES.md").read_text("utf-8").lower()
    called = {"torch": "pytorch", "types-pyyaml": "mypy", "clang-format": "clang-format"}
    assert [name for name in sorted(names) if called.get(name, name) not in text] == []
    data = ROOT / "python/sim2vr_harness/users/data"
    terms = (data / "LICENCES.md").read_text("utf-8")
    assert [entry.name for entry in data.iterdir() if entry.name[:9] not in terms] == [
        "LICENCES.md"
    ]
    assert "non-commercial" in terms and "Copyright" in (ROOT / "NOTICE").read_text()
