"""An evaluation's rounds as recordings of IWER."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.cli.main import main
from sim2vr_harness.evaluation.data import Column, DataFolder
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.sessions import read_session


def test_rounds_of_an_evaluation_become_recordings_of_iwer(tmp_path: Path) -> None:
    """Columns that pandas gives from Parquet cannot be written to, which once ended the export."""
    short = ("env.app.options.round_seconds=1",)
    request = Request(conditions=["easy"], episodes=1, overrides=short, out=tmp_path / "played")
    played = evaluate("whacamole_people", request)
    steps = played.data.steps()
    with pytest.raises(SystemExit) as ended:
        main(["export", str(tmp_path / "played"), "--iwer", "--out", str(tmp_path / "iwer")])
    assert not ended.value.code
    (file,) = (tmp_path / "iwer").iterdir()
    session = read_session(file)
    assert len(session) == len(steps) == len(json.loads(file.read_text())["frames"])
    columns = ["head_x_m", "head_y_m", "head_z_m"]
    np.testing.assert_allclose(session.head[:, :3], steps[columns], atol=2e-6)
    assert session.right is not None
    columns = ["right_x_m", "right_y_m", "right_z_m"]
    np.testing.assert_allclose(session.right.grip[:, :3], steps[columns], atol=2e-6)


@pytest.mark.parametrize("form", [("--csv",), ("--iwer",)])
def test_every_export_checks_the_names_of_episodes_first(
    form: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = Column("episode", "text", "", "Key")
    tables = {"episodes": ([{"episode": "easy_1"}], [key]), "events": ([], [key])}
    DataFolder(tmp_path / "data").add(tables)
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as ended:
        main(["export", str(tmp_path), "--episode", "easy_2", *form, "--out", str(out)])
    assert ended.value.code == 2
    assert "episode: got 'easy_2'" in capsys.readouterr().err
    assert not out.exists() or not list(out.iterdir())
