"""Commands that are given files which nobody can read: one line, which names the file; status 2."""

import json
import lzma
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from python.cli.calls import call
from sim2vr_harness.base import paths
from sim2vr_harness.runs.config import defaults, to_yaml

DATA = Path(__file__).parents[2] / "data"
DAMAGES = (
    *("missing", "folder", "empty", "garbage", "utf-16", "latin-1"),
    *("long line", "loop", "list", "zero byte", "deep"),
)

KINDS = (
    *("configuration", "policy", "user", "curves", "states", "events", "results"),
    "details",
)


def damage(file: Path, how: str) -> None:
    """Leave something else in a file's place."""
    text = file.read_bytes()
    file.unlink()
    if how == "folder":
        file.mkdir()
    elif how == "loop":
        file.symlink_to(file)
    elif how != "missing":
        contents = {
            "empty": b"",
            "garbage": np.random.default_rng(0).bytes(5000),
            "utf-16": text.decode(errors="replace").encode("utf-16"),
            "latin-1": b'{"na\xebme": 1}\n',
            "long line": b"a" * 1_000_000,
            "list": b"[1, 2]",
            "zero byte": b"\x00",
            "deep": b"[" * 50_000,
        }
        file.write_bytes(contents[how])


def shipped() -> Path:
    """The folder of a user that ships."""
    return paths.trained_users_dir() / "whacamole_constrained"


def places(folder: Path) -> dict[str, tuple[Path, list[str]]]:
    """A file of each kind, and a command that reads it."""
    config = folder / "config" / "some.yaml"
    config.parent.mkdir()
    config.write_text(to_yaml(defaults()))
    for name in ("user", "curves"):
        shutil.copytree(shipped(), folder / name)
    curves = b'{"q_learning": [], "imagined": [], "student": [], "rows": []}'
    (folder / "curves" / "curves.json.xz").write_bytes(lzma.compress(curves))
    shutil.copytree(DATA / "whacamole_round", folder / "round")
    (folder / "results").mkdir()
    (folder / "results" / "results.json").write_text("{}")
    (folder / "details.json").write_text("{}")
    user, out = str(folder / "user"), str(folder / "out")
    return {
        "configuration": (config, ["train", str(config), "--timesteps", "0", "--out", out]),
        "policy": (
            folder / "user" / "policy.pt.xz",
            ["evaluate", user, "--episodes", "1", "--condition", "medium", "--out", out],
        ),
        "user": (folder / "user" / "config.yaml", ["users", "show", user]),
        "curves": (
            folder / "curves" / "curves.json.xz",
            ["plot", "curves", str(folder / "curves"), "--out", str(folder / "curves.png")],
        ),
        "states": (folder / "round" / "states.csv", ["replay", str(folder / "round")]),
        "events": (folder / "round" / "events.csv", ["replay", str(folder / "round")]),
        "results": (
            folder / "results" / "results.json",
            ["evaluate", user, "--episodes", "1", "--out", str(folder / "results")],
        ),
        "details": (
            folder / "details.json",
            ["users", "pack", user, "me", "--out", out, "--details", str(folder / "details.json")],
        ),
    }


@pytest.mark.parametrize("how", DAMAGES)
def test_one_line_names_the_file(how: str, capsys: Any, tmp_path: Path) -> None:
    for name in KINDS:
        (tmp_path / name).mkdir()
        file, command = places(tmp_path / name)[name]
        if name == "results" and how == "missing":
            continue  # they are written then
        damage(file, how)
        status, _, said = call(capsys, *command)
        assert (status, said.count("\n")) == (2, 1), (name, said)
        assert said.startswith("error: ")
        named = file.name if name not in ("states", "curves") or how != "missing" else ""
        assert named in said or str(file.parent) in said, (name, said)
        assert "expected" in said
        assert "Traceback" not in said


def test_names_with_line_breaks_and_escape_codes(capsys: Any) -> None:
    for name in ("one\ntwo.yaml", "\x1b[31mred.yaml", "x" * 5000, "\udcff.yaml"):
        for command in (
            ["train", name, "--timesteps", "0"],
            ["replay", name],
            ["users", "show", name],
        ):
            status, _, said = call(capsys, *command)
            assert status == 2
            assert said.count("\n") == 1
            assert said.rstrip("\n").isprintable()


def test_a_group_that_is_off_is_switched_on_by_its_keys() -> None:
    off = defaults()
    assert off.env.vision.fovea is None
    on = defaults(["env.vision.fovea=null", "env.vision.fovea.gaze=ahead"])
    assert on.env.vision.fovea is not None
    assert on.env.vision.fovea.gaze == "ahead"
    assert json.loads(json.dumps(on.model_dump(mode="json")))["env"]["vision"]["fovea"]
