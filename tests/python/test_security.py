"""SECURITY.md's table, row by row: a hostile file does nothing before somebody has agreed."""

import gzip
import json
import lzma
import os
import pickle
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from fake_simulation import FakeSimulation

from python.hostile import Case, Evil
from python.users.bodies import OWN_ARM
from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.tasks import load_task
from sim2vr_harness.envs.simulation import unpacked
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.playing import UserPolicy
from sim2vr_harness.studies import load_study, run_study
from sim2vr_harness.studies import worker as work
from sim2vr_harness.studies.plan import plan_of
from sim2vr_harness.tools.record.parts import Parts

PAGE = Path(__file__).resolve().parents[2] / "SECURITY.md"


def table() -> dict[str, str]:
    """File -> whether it can run code, as the page has it."""
    rows = re.findall(r"^\| (.+?) \| (yes|no)\b.*\|$", PAGE.read_text(encoding="utf-8"), re.M)
    assert len(rows) == len(dict(rows))
    return dict(rows)


def study_file(case: Case) -> None:
    """Fixed keys, levels and those of trainings; command line and Python."""
    program, task = str(case.program()), f"{case.python('task.py')}:Mine"
    outside = {"env.app.transport": "protocol1", "env.app.executable": program}
    file = case.study(**outside)
    out = case.folder / "out"
    case.refused("study", file, "--out", out, key="env.app.executable")
    body = case.body(package=case.python("evil_study.py").stem, model="arm")
    case.refused("study", case.study(**{"env.user.model": str(body)}), key="env.user.model")
    tree = yaml.safe_load(file.read_text())
    level = {"levels": {"a": {"env.app.task": None}, "b": {"env.app.task": task}}}
    user = {"user": "whacamole_constrained"}
    case.asked(lambda: run_study({**tree, "fixed": user, "factors": {"l": level}}, out))
    # What a training plays in is asked about even where its cells play in something else.
    trains = {
        "config": "whacamole_constrained",
        **{f"training.{key}": value for key, value in outside.items()},
        "env.app.transport": "in_process",
        "env.app.executable": None,
    }
    case.asked(lambda: run_study({**tree, "fixed": trains}, out))
    assert not out.exists()
    case.agreed("study", file, "--out", out, "--jobs", "1")


def study_folder(case: Case) -> None:
    """A training that is done, whose folder names another app than the study."""
    case.program()
    file = case.study()
    tree = yaml.safe_load(file.read_text())
    del tree["fixed"]["user"]
    tree["fixed"]["config"] = str(case.trained / "config.yaml")
    file.write_text(yaml.safe_dump(tree))
    (training,) = plan_of(load_study(file)).trainings
    root = case.folder / "begun"
    place = root / "trainings" / training.key
    shutil.copytree(case.trained, place)
    app = {"transport": "protocol1", "executable": str(case.program())}
    case.change(place / "config.yaml", app=app)
    (place / "trained.json").write_text("{}")
    (root / "cells").mkdir()
    case.refused("study", file, "--out", root, "--jobs", "1")
    case.agreed("study", file, "--out", root, "--jobs", "1")


def run_folder(case: Case) -> None:
    run = case.run(app={"transport": "protocol1", "executable": str(case.program())})
    out = ("--out", case.folder / "out")
    case.refused("evaluate", run)
    case.refused("train", "--resume", run)
    case.refused("train", "--from", run, *out)
    case.refused("render", "snapshot", "--user", run, *out)
    case.refused("audit", "--user", run, "--targets", "0,1,0.4", *out)
    case.refused("study", case.study(user=str(run)), *out)
    case.asked(lambda: UserPolicy(run))
    case.asked(lambda: evaluate(run, Request(out=case.folder / "out")))
    case.agreed("evaluate", run, *out, "--condition", "medium")


def packed_user(case: Case) -> None:
    folder = case.folder / "packed"
    shutil.copytree(paths.trained_users_dir() / "whacamole_constrained", folder)
    case.change(
        folder / "config.yaml", app={"transport": "protocol1", "executable": str(case.program())}
    )
    case.refused("evaluate", folder)
    case.agreed("evaluate", folder, "--out", case.folder / "out", "--condition", "easy")


def training_configuration(case: Case) -> None:
    file = case.folder / "config.yaml"
    shutil.copy(case.trained / "config.yaml", file)
    case.change(file, app={"transport": "protocol1", "executable": str(case.program())})
    case.refused("train", file, "--out", case.folder / "out")
    case.agreed("train", file, "--out", case.folder / "out", "--timesteps", "60")


def policy_of_a_study(case: Case) -> None:
    file = case.study(user=f"{case.python('policy.py')}:Mine")
    case.refused("study", file, "--out", case.folder / "out", key="user: ")
    case.agreed("study", file, "--out", case.folder / "out")


def python_task(case: Case) -> None:
    run = case.run(app={"task": f"{case.python('task.py')}:Mine"})
    case.refused("evaluate", run, key="env.app.task")
    case.refused("train", "--resume", run, key="env.app.task")
    # Another task of this user's own does not let in the file's.
    (case.folder / "rules.yaml").write_text("seconds: 1\n")
    rules = case.folder / "rules.yaml"
    case.read("evaluate", run, "--task", rules, "--out", case.folder / "rules")
    case.refused("evaluate", run, key="env.app.task")
    case.agreed("evaluate", run, "--out", case.folder / "out")


def page(case: Case) -> None:
    (case.folder / "index.html").write_text("<script>1</script>")
    app = {"transport": "webxr", "page": str(case.folder), "browser": str(case.program())}
    run = case.run(app={**app, "task": {"seconds": 5}})
    case.refused("evaluate", run, key="env.app.page")
    case.refused("evaluate", run, "--page", case.folder)  # the browser is the file's
    case.agreed("evaluate", run, "--out", case.folder / "out", "--condition", "standard")


def rules_of_a_page(case: Case) -> None:
    page = case.folder / "whacamole"
    page.mkdir()
    (page / "index.html").write_text("<script>1</script>")
    app = {"transport": "webxr", "page": str(page), "browser": str(case.program())}
    rules = {"seconds": 5, "reward": {"expression": "fetch('/'), 1"}}
    run = case.run(app={**app, "task": rules})
    mine = ("--page", page, "--browser", app["browser"], "--condition", "standard")
    case.refused("evaluate", run, *mine, key="env.app.task")
    case.agreed("evaluate", run, *mine, "--out", case.folder / "out")


def openxr_program(case: Case) -> None:
    (case.folder / "libnone.so").touch()
    manifest = case.folder / "runtime.json"
    manifest.write_text(json.dumps({"runtime": {"library_path": "./libnone.so"}}))
    rules = {"seconds": 5, "values": {"x": 'printed("x")'}}
    app = {"transport": "openxr", "executable": str(case.program()), "task": rules}
    run = case.run(app=app, vision={"channels": ["green"]})
    key = "env.app.executable"
    case.refused("evaluate", run, key=key)
    file = case.folder / "config.yaml"
    shutil.copy(run / "config.yaml", file)
    case.refused("train", file, "--out", case.folder / "out", key=key)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SIM2VR_OPENXR_RUNTIME", str(manifest))
        case.agreed("train", file, "--out", case.folder / "out", "--timesteps", "60")


def library_of_games(case: Case) -> None:
    """A library without games, which is opened all the same."""
    file = evil_library(case, case.folder / "libevil.so")
    run = case.run(app={"game_library": str(file)})
    case.refused("evaluate", run, key="env.app.game_library")
    case.agreed("evaluate", run)


def body_file(case: Case) -> None:
    package = case.python(f"evil_body_{os.getpid()}/__init__.py").parent.name
    shutil.copy(Path(OWN_ARM).parent / "arm.xml", case.folder / package / "arm.xml")
    body = case.body(package=package, model="arm")
    key = "env.user.model"
    case.read("users", "export", case.body(package=package, mjcf="arm.xml"), case.folder / "b.xml")
    assert (case.folder / "b.xml").exists(), "files of a package are found without importing it"
    case.refused("users", "export", body, case.folder / "a.xml", key=key)
    case.refused("evaluate", case.run(user={"model": str(body)}), key=key)
    case.agreed("users", "export", body, case.folder / "a.xml")


def task_rules(case: Case) -> None:
    code = f"__import__('os').system('touch {case.marker}')"
    case.would(lambda: eval(code))
    file = case.folder / "task.yaml"
    file.write_text(yaml.safe_dump({"seconds": 0.2, "reward": {"expression": code}}))
    load_task(str(file))
    case.read("evaluate", case.run(), "--task", file, "--out", case.folder / "out")
    file.write_text(f"!!python/object/apply:os.system ['touch {case.marker}']\n")
    case.would(lambda: yaml.unsafe_load(file.read_text()))
    case.read("evaluate", case.run(), "--task", file, "--out", case.folder / "out")


def evil_library(case: Case, file: Path) -> Path:
    """A library that leaves the marker as soon as it is opened."""
    source = case.folder / "evil.c"
    source.write_text(
        "#include <stdio.h>\n__attribute__((constructor)) static void run(void) "
        f'{{ fclose(fopen("{case.marker}", "w")); }}\n'
    )
    file.parent.mkdir(exist_ok=True)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", file, source], check=True)
    return file


def mjcf(case: Case) -> None:
    library = evil_library(case, case.folder / "mujoco_plugin" / "libevil.so")
    load = f"import ctypes; ctypes.CDLL({str(library)!r})"
    case.would(lambda: subprocess.run([sys.executable, "-c", load], check=True))
    text = (Path(OWN_ARM).parent / "arm.xml").read_text()
    for name in ("evil", str(library)):
        extension = f'<extension><plugin plugin="{name}"/></extension>'
        (case.folder / "arm.xml").write_text(re.sub(r"(<mujoco[^>]*>)", rf"\1{extension}", text))
        case.read("users", "export", case.body(mjcf="arm.xml"), case.folder / "out.xml")


def weights(case: Case) -> None:
    evil = pickle.dumps({"format": "sim2vr simulation state 5", "n": 1, "x": Evil(case.marker)})
    case.would(lambda: pickle.loads(evil))
    with pytest.raises(ValueError, match="expected plain data"):
        unpacked({"simulation": np.frombuffer(evil, np.uint8)}, 1)
    saved, arrays = BytesIO(), BytesIO()
    torch.save({"weights": Evil(case.marker)}, saved)
    np.savez(arrays, header=np.array([Evil(case.marker)], dtype=object))
    run = case.run()
    (checkpoint,) = (run / "checkpoints").glob("*.zip")
    with zipfile.ZipFile(checkpoint) as archive:
        whole = {name: archive.read(name) for name in archive.namelist()}
    for member in whole.keys() - {"data"}:  # only Stable-Baselines3 itself reads the data
        content = whole | {member: arrays.getvalue() if "npz" in member else saved.getvalue()}
        with zipfile.ZipFile(checkpoint, "w") as archive:
            for name, part in content.items():
                archive.writestr(name, part)
        case.read("evaluate", run, "--out", case.folder / "out", "--condition", "medium")
    packed = case.folder / "packed"
    shutil.copytree(paths.trained_users_dir() / "whacamole_constrained", packed)
    (packed / "policy.pt.xz").write_bytes(lzma.compress(saved.getvalue()))
    case.read("evaluate", packed, "--out", case.folder / "out", "--condition", "easy")


def motor_layer(case: Case) -> None:
    file = case.folder / "layer.pt"
    torch.save({"weights": Evil(case.marker)}, file)
    case.would(lambda: torch.load(file, weights_only=False))
    case.read("users", "motor", "measure", "mobl_arms_wrist", "--layer", file)


def recorded_rounds(case: Case) -> None:
    evil = np.array([Evil(case.marker)], dtype=object)
    np.savez(case.folder / "a.npz", t=evil, right=evil, head=evil, marker=evil)
    case.would(lambda: np.load(case.folder / "a.npz", allow_pickle=True)["t"])
    (case.folder / "a_events.csv").write_text("")
    round_ = {"file": "a", "condition": "easy", "seed": 1}
    (case.folder / "manifest.json").write_text(json.dumps({"trials": [round_]}))
    case.read("replay", case.folder / "a.npz")
    case.read("replay", case.folder)


def sent_session(case: Case) -> None:
    """Parts that a hostile page sends: pickles, also packed, and names that lead elsewhere."""
    evil = pickle.dumps(Evil(case.marker))
    case.would(lambda: pickle.loads(evil))
    name = f"../../$(touch {case.marker})"
    header = {"format": "sim2vr-session", "version": 1, "person": name, "headset": name}
    header["app"] = {"kind": "page", "name": name, "options": {name: name}}
    good = json.dumps(header).encode() + b'\n{"t":0,"head":[0,1.5,0,0,0,0,1]}\n'
    for number, content in enumerate((evil, gzip.compress(evil), good)):
        parts = Parts(case.folder / f"{number}.jsonl")
        parts.take(f"session={'0' * 32}&part=0&last=1", content)
        if content is good:
            session = parts.session()
            assert session is not None and session.app.name == name  # kept as text
        else:
            with pytest.raises(InputError):
                parts.session()
        parts.close()
        assert not case.marker.exists()
        case.reads += 1
    assert {file.suffix for file in case.folder.iterdir()} == {".parts"}


def beats_map(case: Case) -> None:
    song = f"$(touch {case.marker})"
    case.would(lambda: os.system(f"echo {song}"))
    levels = {"_difficulty": "Easy", "_beatmapFilename": f"`touch {case.marker}`"}
    sets = [{"_beatmapCharacteristicName": "Standard", "_difficultyBeatmaps": [levels]}]
    info = {"_version": "2.0.0", "_songName": song, "_songFilename": f"| touch {case.marker}"}
    info |= {"_beatsPerMinute": 100, "_difficultyBeatmapSets": sets}
    (case.folder / "map").mkdir()
    (case.folder / "map" / "Info.dat").write_text(json.dumps(info))
    case.read("level", case.folder / "map", "--game", "beats")


def folders_that_are_read(case: Case) -> None:
    package = case.python("evil_read.py").stem
    body = case.body(package=package, model="arm")
    run = case.run(
        user={"model": str(body)}, app={"transport": "protocol1", "executable": str(case.program())}
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "evaluate", _on_the_stand_in)
        found = run_study(case.study(user=str(case.trained)), case.folder / "study", jobs=1)
    root = found.data.root
    # Whoever looks for the body that played finds the hostile run.
    about = json.loads((root / "study.json").read_text().replace(str(case.trained), str(run)))
    (root / "study.json").write_text(json.dumps(about))
    (root / "trainings").mkdir(exist_ok=True)
    shutil.copytree(run, root / "trainings" / "first")
    case.read("report", root, "--no-figures")
    assert (root / "report.html").exists()
    (cell, *_) = sorted((root / "cells").iterdir())
    case.read("export", cell, "--out", case.folder / "opensim")
    case.read("compare", root, "--out", case.folder / "compared")
    case.read("plot", "curves", run, "--out", case.folder / "curves")


def _on_the_stand_in(user: str, request: Any) -> Any:
    return evaluate(user, request, simulation=FakeSimulation)


ROWS: dict[str, Callable[[Case], None]] = {
    "study (`STUDY.yaml`)": study_file,
    "study folder that you continue": study_folder,
    "run folder": run_folder,
    "packed user": packed_user,
    "training configuration (`CONFIG.yaml`)": training_configuration,
    "Python task (`FILE.py:CLASS`) that a file names": python_task,
    "Python policy (`FILE.py:CLASS`) that a study names": policy_of_a_study,
    "WebXR page, `map` and `browser` that a file names": page,
    "rules of a page's task that a file names": rules_of_a_page,
    "OpenXR program that a file names": openxr_program,
    "library of games (`LIBRARY.so`) that a file names": library_of_games,
    "body file (`BODY.yaml`)": body_file,
    "task rules of an app that is no page (`TASK.yaml`)": task_rules,
    "MJCF model": mjcf,
    "checkpoint, saved state, packed weights": weights,
    "motor layer (`LAYER.pt`)": motor_layer,
    "recorded rounds (`.csv`, `.npz`)": recorded_rounds,
    "session that a page sends to `session record`": sent_session,
    "Beats map": beats_map,
    "folder of an evaluation or a study that is only read (`report`, `export`, `compare`)": (
        folders_that_are_read
    ),
}
"""First column of the table -> what is tried with such a file."""


@pytest.fixture(autouse=True)
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A user of this machine who has never agreed to anything."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])
    monkeypatch.setattr("sim2vr_harness.users.bodies.packages._allowed", set())
    yield
    for name in [name for name in sys.modules if name.startswith("evil_")]:
        del sys.modules[name]


@pytest.mark.parametrize("row", table())
def test_no_code_runs_before_the_question(
    row: str, trained: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "received"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.chdir(tmp_path)
    case = Case(folder, tmp_path / "marker", trained, capsys)
    assert row in ROWS, "a row of SECURITY.md without a test"
    ROWS[row](case)
    if table()[row] == "yes":
        assert case.refusals and case.agreements
    else:
        assert case.reads and not case.refusals and not case.agreements
        assert not case.marker.exists()


def test_every_test_has_its_row() -> None:
    assert set(ROWS) == set(table())
