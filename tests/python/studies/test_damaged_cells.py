"""Cells of a study whose files have changed: refused, or played again."""

import json
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from python.studies.quick_study import content, study
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.studies import read_study, run_study
from sim2vr_harness.studies.report.source import read_source


def damaged_cells(out: Path, how: str) -> Path:
    """A finished cell's file that is not any more what the study wrote."""
    cell = next((out / "cells").glob("*"))
    file = cell / ("cell.json" if how == "mark" else "data/episodes.parquet")
    if how == "missing":
        file.unlink()
    elif how == "edited":  # a table that reads well, with other numbers
        table = pq.read_table(file)
        at = table.column_names.index("hits")
        pq.write_table(table.set_column(at, "hits", pa.array([999] * len(table))), file)
    else:
        file.write_text(json.dumps({"key": cell.name}))  # without the files' hashes
    return file


@pytest.mark.parametrize("how", ["edited", "missing", "mark"])
def test_a_damaged_cell_is_refused_or_played_again(
    how: str, trained: Path, quick: list[str], tmp_path: Path
) -> None:
    run_study(study(trained), tmp_path, jobs=1)
    before = content(tmp_path)
    file = damaged_cells(tmp_path, how)
    quick.clear()
    message = (
        rf"^cell difficulty=\w+,noise=\w+: {re.escape(str(file))}: got .*, expected the file that "
        r"the study wrote: put it back .* --replay-damaged$"
    )
    for read in (
        lambda: run_study(study(trained), tmp_path, jobs=1),
        lambda: read_study(tmp_path),
        lambda: read_source(tmp_path),
    ):
        with pytest.raises(InputError, match=message):
            read()
    assert not quick
    found = run_study(study(trained), tmp_path, jobs=1, replay_damaged=True)
    assert (found.played, len(quick)) == (1, 1)
    assert content(tmp_path) == before
    statistics = tmp_path / "statistics.json"
    statistics.write_text(statistics.read_text().replace('"n": 1', '"n": 100'))
    with pytest.raises(InputError, match=r"statistics.json: got other content than the study wro"):
        _ = read_study(tmp_path).statistics
    (tmp_path / "data" / "episodes.parquet").write_text("")
    with pytest.raises(InputError, match=r"data/episodes.parquet: got other content than the "):
        read_study(tmp_path)
