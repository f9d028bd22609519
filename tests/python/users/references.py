"""Reference values of the arm models and what is compared with them."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim2vr_harness.users import Body

EXCERPTS = Path(__file__).resolve().parents[2] / "data" / "mobl_arms"


def load_reference(name: str) -> dict[str, Any]:
    return json.loads((EXCERPTS / f"{name}_excerpt.json").read_text())


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
