"""Studies that start somebody's app ask once; those without one do not ask."""

import json
from pathlib import Path

import pytest

from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.studies import run_study


@pytest.fixture(autouse=True)
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user of this machine who has never agreed to anything."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])


def wrapper(folder: Path) -> Path:
    """The runtime's own app, started by somebody's script."""
    file = folder / "sim2vr-app.sh"
    app = paths.app_executable()
    file.write_text(f'#!/bin/sh\necho started >> {folder / "log"}\nexec {app} "$@"\n')
    file.chmod(0o755)
    return file


def test_workers_of_a_trusted_study_start_its_app(tmp_path: Path) -> None:
    """Processes get the answer, and a study that is gone on with needs no second one."""
    outside = {"env.app.transport": "protocol2", "env.app.executable": str(wrapper(tmp_path))}
    study = {
        "name": "outside",
        "fixed": {"user": "whacamole_constrained", "env.max_episode_seconds": 0.5, **outside},
        "factors": {"level": {"key": "condition", "levels": ["easy", "medium"]}},
        "episodes": 1,
        "measures": ["hits"],
    }
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"env\.app\.executable: .*--trust-app"):
        run_study(study, out, jobs=2)
    assert not out.exists()
    found = run_study(study, out, jobs=2, trust_app=True)
    assert found.played == 2
    assert (tmp_path / "log").read_text().count("started") >= 2
    assert run_study(study, out, jobs=2).played == 0
    mark = json.loads(next(out.glob("cells/*/cell.json")).read_text())
    assert "env" not in mark and "trust_app" not in mark
