"""npm packages behind a page's addresses: which, fetched by npm, mapped, checked."""

import base64
import hashlib
import io
import json
import os
import sys
import tarfile
from pathlib import Path

import pytest

from sim2vr_harness.cli import main as cli
from sim2vr_harness.client import AppRefused
from sim2vr_harness.client.webxr.packages import package_of
from sim2vr_harness.client.webxr.vendor import packages_behind, read_map, vendor
from webxr_pages import NEEDS_BROWSER, page_with

CDN = "https://cdn.jsdelivr.net/npm/"
TOY = f"{CDN}toy@1/lib/toy.js"
ADDRESSES = {
    f"{CDN}three@0.187.0/build/three.module.js": "three@0.187.0 build/three.module.js",
    "https://unpkg.com/super-hands/dist/s.min.js": "super-hands@latest dist/s.min.js",
    "https://unpkg.com/a-b@%5E4.0.0/dist/c.js": "a-b@^4.0.0 dist/c.js",
    f"{CDN}@webxr-input-profiles/assets@1.0/a.json": "@webxr-input-profiles/assets@1.0 a.json",
    "https://cdnjs.cloudflare.com/ajax/libs/three.js/r128/three.min.js": "three@0.128 three.min.js",
    "https://aframe.io/releases/1.4.2/aframe.min.js": "aframe@1.4.2 dist/aframe-master.min.js",
    "https://cdn.skypack.dev/three@0.132.2": "three@0.132.2  module",
    "https://esm.sh/@a/b@1/sub/path.js?dev": "@a/b@1 sub/path.js module",
    f"{CDN}lil-gui@0.19/+esm": "lil-gui@0.19  module",
    "https://cdn.babylonjs.com/loaders/babylonjs.loaders.js": "babylonjs-loaders@latest "
    "babylonjs.loaders.js",
    "https://code.playcanvas.com/playcanvas-1.70.0.min.js": "playcanvas@1.70.0 build/playcanvas.js",
    f"{CDN[:-4]}gh/someone/something@1/file.js": "",
    # What npm would read as more than a package.
    "https://cdnjs.cloudflare.com/ajax/libs/--pack-destination/1.0/x.js": "",
    f"{CDN}toy@file%3A%2Fhome": "",
}


@pytest.mark.parametrize("address", ADDRESSES)
def test_the_package_of_an_address(address: str) -> None:
    found = package_of(address)
    words = f"{found.spec} {found.path}{' module' if found.module else ''}" if found else ""
    assert words == ADDRESSES[address]


PACKAGE = {
    "package.json": '{"name": "toy", "version": "1.2.3", "main": "lib/toy", "module": "toy.mjs",'
    ' "dependencies": {"other": "^2"}}',
    "lib/toy.js": "window.toy = 1;",
    "toy.mjs": "import { x } from './inner.mjs';\nimport 'other';\nexport default x;",
    "inner.mjs": "export const x = 1;",
}
NPM = """#!{python}
import base64, hashlib, json, shutil, sys
words = sys.argv[1:]
assert "--ignore-scripts" in words, words
with open({log!r}, "a") as log:
    log.write(" ".join(words[:2]) + "\\n")
if words[0] == "pack" and words[1].startswith("toy@"):
    shutil.copy({archive!r}, words[words.index("--pack-destination") + 1])
    answer = {{"name": "toy", "version": "1.2.3", "filename": "toy-1.2.3.tgz"}}
    print(json.dumps([answer | {told!r}]))
elif words[0] == "view":
    print(json.dumps({integrity!r}))
else:
    print(json.dumps({{"error": {{"code": "E404"}}}}))
    sys.exit(1)
"""


@pytest.fixture
def npm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """Have a program stand in for npm, which has one package; returns the file of its calls.

    The parameter has further files of the package; ``npm prints`` is JSON of its own.
    """
    files = {**PACKAGE, **getattr(request, "param", {})}
    told = json.loads(files.pop("npm prints", "{}"))
    archive, log = tmp_path / "toy-1.2.3.tgz", tmp_path / "calls"
    with tarfile.open(archive, "w:gz") as packed:
        for name, text in files.items():
            entry = tarfile.TarInfo(f"package/{name}")
            entry.size = len(text)
            packed.addfile(entry, io.BytesIO(text.encode()))
    integrity = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
    program = tmp_path / "bin" / "npm"
    program.parent.mkdir()
    program.write_text(
        NPM.format(
            python=sys.executable,
            log=str(log),
            archive=str(archive),
            integrity=f"sha512-{integrity}",
            told=told,
        )
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    return log


def test_packages_come_with_a_map(tmp_path: Path, npm: Path) -> None:
    addresses = [
        TOY,
        f"{CDN}toy@1/lib/toy.min.js",  # which jsdelivr makes of lib/toy.js
        "https://unpkg.com/toy",
        f"{CDN}gone@1/a.js",
        "https://fonts.example/nice.woff2",
    ]
    packages, unknown = packages_behind(addresses)
    assert [each.address for each in unknown] == ["https://fonts.example/nice.woff2"]
    folder = tmp_path / "engines"
    without = vendor(packages, folder)
    assert [each.why for each in without] == ["npm has no gone@1 (E404)"]
    place = folder / "toy@1.2.3"
    assert read_map(folder / "map.json") == {
        f"{CDN}toy@1/": str(place),
        f"{CDN}toy@1/lib/toy.min.js": str(place / "lib" / "toy.js"),
        "https://unpkg.com/toy": str(place / "lib" / "toy.js"),
    }
    # A map moves with its folder, so that others can have it.
    assert json.loads((folder / "map.json").read_text())[f"{CDN}toy@1/"] == "toy@1.2.3"


def test_a_host_of_modules_answers_with_imports_by_address(tmp_path: Path, npm: Path) -> None:
    mapped = fetched("https://esm.sh/toy@1", tmp_path)
    own = "https://esm.sh/sim2vr/toy@1.2.3/"
    stub = Path(mapped["https://esm.sh/toy@1"]).read_text()
    assert stub.splitlines() == [
        f'export * from "{own}toy.mjs";',
        f'export {{ default }} from "{own}toy.mjs";',
    ]
    copied = Path(mapped[own])
    assert f"from '{own}inner.mjs'" in (copied / "toy.mjs").read_text()
    assert "import 'https://esm.sh/other@^2'" in (copied / "toy.mjs").read_text()
    assert (copied / "inner.mjs").read_text() == PACKAGE["inner.mjs"]


def fetched(address: str, folder: Path) -> dict[str, str]:
    """Fetches the package of an address; returns the map."""
    vendor(packages_behind([address])[0], folder)
    return read_map(folder / "map.json")


def test_an_archive_that_is_not_npms_is_refused(tmp_path: Path, npm: Path) -> None:
    archive = tmp_path / "toy-1.2.3.tgz"
    archive.write_bytes(archive.read_bytes() + b"\0")
    with pytest.raises(AppRefused, match=r"toy@1\.2\.3: its archive has another checksum"):
        fetched(TOY, tmp_path / "engines")
    assert not (tmp_path / "engines" / "toy@1.2.3").exists()


@pytest.mark.parametrize("npm", [{"../../outside.js": "mine now"}], indirect=True)
def test_an_archive_writes_nothing_outside_its_folder(tmp_path: Path, npm: Path) -> None:
    with pytest.raises(AppRefused, match=r"toy@1\.2\.3: its archive cannot be unpacked"):
        fetched(TOY, tmp_path / "engines")
    assert not [*tmp_path.rglob("outside.js")]
    assert not (tmp_path / "engines" / "toy@1.2.3").exists()


SECRET = "export const secret = 'of the user';"


@pytest.mark.parametrize("address", ["https://unpkg.com/toy", "https://esm.sh/toy"])
@pytest.mark.parametrize("path", ["../../secret.js", "{tmp}/secret.js", "lib/../../../secret"])
@pytest.mark.parametrize("key", ["main", "module", "unpkg", "exports", "import"])
@pytest.mark.parametrize("npm", [{}], indirect=True)
def test_a_package_names_only_its_own_files(
    key: str, path: str, address: str, tmp_path: Path, npm: Path
) -> None:
    """Whatever a package names, the page receives nothing that lies outside the package."""
    (tmp_path / "secret.js").write_text(SECRET)
    path = path.format(tmp=tmp_path)
    place = tmp_path / "engines" / "toy@1.2.3"
    place.mkdir(parents=True)
    about = {"name": "toy", "type": "module", key: path}
    if key == "import":
        about = {"name": "toy", "module": "entry.js"}
        (place / "entry.js").write_text(f"export * from '{path}';")
    (place / "package.json").write_text(json.dumps(about))
    reached = fetched(address, tmp_path / "engines")
    there = [one for one in place.parent.rglob("*") if one.is_file()]
    assert SECRET not in [one.read_text() for one in there]
    assert all(str(place.parent) in one for one in reached.values())


TOLD = [{"name": "../../outside"}, {"version": ".."}, {"filename": "../x.tgz"}, {"version": None}]


@pytest.mark.parametrize("npm", [{"npm prints": json.dumps(one)} for one in TOLD], indirect=True)
def test_names_that_npm_prints_are_checked(tmp_path: Path, npm: Path) -> None:
    with pytest.raises(AppRefused, match=r"toy@1: got .* of npm, expected the package's name"):
        fetched(TOY, tmp_path / "deep" / "engines")
    assert [*(tmp_path / "deep").rglob("*.js")] == []


@pytest.mark.parametrize("npm", [{"zeros.bin": "\0" * 4000}], indirect=True)
@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [("MOST_UNPACKED", 3000, "3,000 bytes"), ("MOST_FILES", 3, "3 files")],
)
def test_a_package_has_a_limit(
    limit: str, value: int, words: str, tmp_path: Path, npm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"sim2vr_harness.client.webxr.vendor.{limit}", value)
    with pytest.raises(AppRefused, match=f"toy@1.2.3: .* got more than {words}, expected at most"):
        fetched(TOY, tmp_path / "engines")
    assert [*(tmp_path / "engines").iterdir()] == []


PAGE = f"""const load = (src) => new Promise((done) => document.head.append(
  Object.assign(document.createElement('script'), {{ src, onload: done }})));
await load('{CDN}toy@1/lib/toy.js');
const {{ Boxes, button }} = await import('./boxes.js');
const boxes = new Boxes();
button('Enter VR', () => boxes.enter((time, frame) => {{
  for (const {{ gamepad }} of frame.session.inputSources) gamepad.buttons[0].pressed;
}}));"""


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([*arguments])
    return int(ended.value.code or 0)


@NEEDS_BROWSER
def test_check_and_vendor(
    tmp_path: Path, npm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page, out = str(page_with(tmp_path, PAGE)), tmp_path / "engines"
    assert run("page", "check", page) == 1
    said = capsys.readouterr().out
    assert f"{CDN}toy@1/lib/toy.js  (npm package toy@1: sim2vr-harness page vendor)" in said
    assert not npm.exists()
    # Without a yes nothing is fetched.
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    assert run("page", "vendor", page, "--out", str(out)) == 1
    assert not npm.exists()
    assert run("page", "vendor", page, "--out", str(out), "--yes") == 0
    assert "It plays" in capsys.readouterr().out
    assert npm.read_text().splitlines() == ["pack toy@1", "view toy@1.2.3"]
    assert run("page", "check", page, "--map", str(out / "map.json"), "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["plays"]
    assert found["missing"] == {}
    assert found["report"]["sessions"] == ["immersive-vr"]
    assert found["report"]["features"] == ["local-floor (required)"]
    assert found["report"]["inputs"] == ["trigger"]
