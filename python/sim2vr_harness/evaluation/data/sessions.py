"""Steps of an evaluation as sessions: a frame per user step."""

from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import INPUT_COUNT, INPUTS
from sim2vr_harness.evaluation.data.columns import column_name
from sim2vr_harness.evaluation.data.folder import EvaluationData
from sim2vr_harness.sessions import AppIdentity, Controller, Session

_PARTS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


def session_of_steps(data: EvaluationData, episode: str) -> Session:
    """Return the session with a simulated user's device poses at the end of every step.

    Args:
        data: Of an evaluation that kept steps.
        episode: Key of the table episodes.

    Raises:
        InputError: There is no such episode, or its steps have no pose of the head.
    """
    steps = data.steps(episode)
    head = _poses(steps, "head")
    if head is None:
        raise InputError("steps", f"no columns head_x_m to head_qw in {episode}", "poses of a head")
    about = data.episodes[data.episodes["episode"] == episode].iloc[0]
    return Session(
        time_ns=np.rint(steps["time_s"].to_numpy(dtype=np.float64) * 1e9).astype(np.int64),
        head=head,
        left=_controller(steps, "left"),
        right=_controller(steps, "right"),
        app=AppIdentity("unknown", condition=str(about.get("condition", ""))),
        source="evaluation",
    )


def _poses(steps: Any, name: str) -> Any:
    columns = [f"{name}_{part}" for part in _PARTS]
    if not set(columns) <= set(steps.columns):
        return None
    poses = np.array(steps[columns], dtype=np.float64)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return poses


def _controller(steps: Any, side: str) -> Controller | None:
    grip = _poses(steps, side)
    if grip is None:
        return None
    inputs = None
    for one in INPUTS:
        name = f"input_{column_name(f'{side}.{one.name}')}"
        if one.hand == side and name in steps.columns:
            inputs = np.zeros((len(grip), INPUT_COUNT)) if inputs is None else inputs
            inputs[:, one.column] = steps[name].to_numpy(dtype=np.float64)
    return Controller(grip, inputs=inputs)
