"""OpenSim's own reader reads what is exported."""

import math
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.evaluation.data import export_opensim
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.users import load_body

opensim = pytest.importorskip("opensim", reason="extras: no opensim")


@pytest.mark.parametrize("user", ["pretrained:whacamole_constrained"])
def test_opensim_reads_names_units_and_numbers(user: str, tmp_path: Path) -> None:
    short = ("env.app.options.round_seconds=1",)
    request = Request(conditions=["easy"], episodes=1, overrides=short, out=tmp_path / "played")
    data = evaluate(user, request).data
    angles, activations, forces = export_opensim(data, tmp_path)
    steps = data.steps()
    body = load_body("mobl_arms_wrist")
    read = {file: opensim.Storage(str(file)) for file in (angles, activations, forces)}
    for file, storage in read.items():
        assert storage.isInDegrees() == (file == angles)
        assert storage.getSize() == len(steps)
        labels = storage.getColumnLabels()
        names = [labels.get(i) for i in range(1, labels.getSize())]
        if file == angles:
            assert set(body.independent_joints) <= set(names)
        else:
            assert names == list(body.muscles)
        times = opensim.ArrayDouble()
        storage.getTimeColumn(times)
        found = [times.get(i) for i in range(times.getSize())]
        np.testing.assert_allclose(found, steps["time_s"], atol=1e-6)
    for storage, name, column, factor in (
        (read[angles], "elbow_flexion", "q_elbow_flexion", 180.0 / math.pi),
        (read[activations], "ANC", "act_ANC", 1.0),
        (read[forces], "DELT1", "force_DELT1", -1.0),
    ):
        values = opensim.ArrayDouble()
        storage.getDataColumn(name, values)
        found = [values.get(i) for i in range(values.getSize())]
        np.testing.assert_allclose(found, factor * steps[column], rtol=1e-6, atol=1e-9)
    table = opensim.TimeSeriesTable(str(angles))
    assert table.getTableMetaDataAsString("inDegrees") == "yes"
    assert table.getNumRows() == len(steps)
