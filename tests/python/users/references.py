"""Reference values of the arm models and what is compared with them.

The excerpts in `tests/data/mobl_arms` always serve; the full reference files where they are found,
in the folder that SIM2VR_SHARED names or in `shared` next to the repository.
"""

import json
import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sim2vr_harness.users import Body

REPOSITORY = Path(__file__).resolve().parents[3]
EXCERPTS = REPOSITORY / "tests" / "data" / "mobl_arms"


def load_reference(folder: str, name: str, excerpt: str | None) -> dict[str, Any]:
    """Reads `name` of the reference's `folder`; `excerpt` is the file that stands in for it."""
    if excerpt is not None:
        return json.loads((EXCERPTS / excerpt).read_text())
    root = Path(os.environ.get("SIM2VR_SHARED", REPOSITORY.parent / "shared"))
    path = root / "facts" / "mobl_arms" / folder / f"{name}.json"
    if not path.exists():
        pytest.skip(f"full reference file {path} not found; set SIM2VR_SHARED to its root")
    return json.loads(path.read_text())


def gap(got: Any, expected: Any) -> float:
    """The largest difference."""
    return float(np.abs(np.asarray(got) - np.asarray(expected)).max())


def rotation_gap(got: Any, expected: Any) -> float:
    """Quaternions q and -q are the same rotation."""
    return min(gap(got, expected), gap(got, -np.asarray(expected)))


def coupling_jacobian(body: Body, q: np.ndarray) -> np.ndarray:
    """(nv, J) d qpos / d q_independent; all joints are scalar, so qpos and dofs coincide."""
    h = 1e-6
    columns = [
        (body.coupled_qpos(q + h * e) - body.coupled_qpos(q - h * e)) / (2 * h)
        for e in np.eye(len(q))
    ]
    return np.stack(columns, axis=1)


def moment_arms(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """(ntendon, nv) d length / d q, m/rad."""
    dense = np.zeros((model.ntendon, model.nv))
    mujoco.mju_sparse2dense(
        dense, data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind
    )
    return dense
