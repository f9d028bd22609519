"""Tables that are written, added to and read again."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.evaluation.data import DataFolder, EvaluationData, export_opensim, read_data
from sim2vr_harness.evaluation.data.columns import (
    Column,
    columns_of,
    number_table,
)

KEY = Column("episode", "text", "", "Key")
HITS = Column("hits", "integer", "", "Hits")


def episodes(*rows: tuple[str, int], **more: Any) -> dict[str, Any]:
    found = [{"episode": key, "hits": hits, **more} for key, hits in rows]
    columns = [KEY, HITS, *columns_of(more, {"speed": ("m/s", "Speed")})]
    return {"episodes": (found, columns), "events": ([], [KEY])}


def steps(episode: str, times: int = 2) -> Any:
    columns = [
        Column("q_elbow", "single", "rad", "Angle"),
        Column("q_slide", "single", "m", "Position"),
        Column("act_biceps", "single", "", "Activation"),
        Column("force_biceps", "single", "N", "Force"),
    ]
    counts = [
        (Column("step", "integer", "", "Step"), range(1, times + 1)),
        (Column("time_s", "number", "s", "Time"), 0.05 * np.arange(1, times + 1)),
    ]
    values = np.tile(np.array([np.pi / 2, 0.1, 0.25, -20.0], np.float32), (times, 1))
    return number_table(episode, counts, values, columns)


def test_rows_are_added_and_the_same_episodes_replaced(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "data")
    folder.add(episodes(("a", 1), ("b", 2)))
    folder.add(episodes(("b", 3), ("c", 4), speed=1.5))
    found = read_data(tmp_path).episodes
    assert found["episode"].tolist() == ["a", "b", "c"]
    assert found["hits"].tolist() == [1, 3, 4]
    assert found["speed"].isna().tolist() == [True, False, False]
    read_data(tmp_path).export_csv(tmp_path / "csv")
    text = (tmp_path / "csv" / "episodes.csv").read_text()
    assert text == '"episode","hits","speed"\n"a",1,\n"b",3,1.5\n"c",4,1.5\n'
    told = read_data(tmp_path).dictionary
    line = told[(told["table"] == "episodes") & (told["column"] == "speed")].iloc[0]
    assert (line["type"], line["unit"], line["description"]) == ("number", "m/s", "Speed")
    folder.clear()
    folder.add(episodes(("d", 5)))
    assert read_data(tmp_path).episodes["episode"].tolist() == ["d"]


def test_the_manifest_has_the_versions_of_who_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = DataFolder(tmp_path / "data")
    for version, keys in (("1", "ab"), ("2", "bc"), ("1", "d")):
        monkeypatch.setattr(
            "sim2vr_harness.evaluation.data.folder.versions",
            lambda version=version: {"mujoco": version},
        )
        data.add(episodes(*((key, 0) for key in keys)))
    found = json.loads((tmp_path / "data" / "manifest.json").read_text())
    assert found["recorded_with"] == [
        {"versions": {"mujoco": "2"}, "episodes": ["b", "c"]},
        {"versions": {"mujoco": "1"}, "episodes": ["a", "d"]},
    ]
    assert read_data(tmp_path).recorded_with == [{"mujoco": "2"}, {"mujoco": "1"}]
    (tmp_path / "data" / "manifest.json").write_text('{"recorded_with": [{"versions": 3}]}')
    data.clear()
    assert not (tmp_path / "data" / "manifest.json").exists()


def test_steps_are_read_by_episode_and_column(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "data")
    for key in ("a", "b"):
        folder.write_moments("steps", key, steps(key))
    folder.add(episodes(("a", 1), ("b", 2)))
    data = EvaluationData(tmp_path / "data")
    assert len(data.steps()) == 4
    assert data.steps("b", columns=["act_biceps"]).columns.tolist() == [
        *("episode", "step", "time_s", "act_biceps")
    ]
    written = data.export_csv(tmp_path / "csv", ["a"])
    names = [str(file.relative_to(tmp_path / "csv")) for file in written]
    assert names == ["dictionary.csv", "episodes.csv", "events.csv", "steps/a.csv"]
    lines = written[-1].read_text().splitlines()
    assert lines[0].startswith('"episode","step","time_s","q_elbow"')
    assert len(lines) == 3
    with pytest.raises(InputError, match=r"^episode: got 'c', expected one of a, b"):
        data.export_csv(tmp_path / "csv", ["c"])
    with pytest.raises(InputError, match=r"^column: got 'act_bicep'.*did you mean 'act_biceps'"):
        data.steps("a", columns=["act_bicep"])
    with pytest.raises(InputError, match=r"frames: got no frames, expected .*--no-steps"):
        data.frames()


def test_opensim_s_tables_by_hand(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "data")
    folder.write_moments("steps", "a", steps("a"))
    folder.add(episodes(("a", 1)))
    files = export_opensim(read_data(tmp_path), tmp_path / "out")
    assert [file.name for file in files] == [*("a_joints.mot", "a_activations.sto", "a_forces.sto")]
    assert files[0].read_text().split("\n") == [
        *("a_joints", "version=1", "nRows=2", "nColumns=3", "inDegrees=yes", "endheader"),
        *("time\telbow\tslide", "0.050000\t90\t0.1", "0.100000\t90\t0.1", ""),
    ]
    assert files[1].read_text().split("\n")[6:8] == ["time\tbiceps", "0.050000\t0.25"]
    assert files[2].read_text().split("\n")[6:8] == ["time\tbiceps", "0.050000\t20"], "it pulls"


READ_A_CUT_TABLE = """
import os, sys
from pathlib import Path
import pyarrow as pa
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.evaluation.data.folder import parquet_bytes, read_table

file = Path(sys.argv[1])
content = parquet_bytes(pa.table({f"column{k}": list(range(1000)) for k in range(50)}))
file.write_bytes(content[:2000] + bytes(2000) + content[4000:])
before = set(os.listdir("/proc/self/task"))
try:
    read_table(file)
except InputError as error:
    assert set(os.listdir("/proc/self/task")) <= before, "a thread of pyarrow goes on"
    print(error)
"""


def test_a_read_that_fails_leaves_no_thread_that_could_abort_the_program(tmp_path: Path) -> None:
    command = [sys.executable, "-c", READ_A_CUT_TABLE, str(tmp_path / "cut.parquet")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "cut.parquet: got no Parquet, or a damaged one, expected a table" in ended.stdout
