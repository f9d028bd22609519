"""Validation of the users and actions that a batch receives."""

from collections.abc import Iterable, Mapping, Sequence, Sized
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def checked_ids(ids: Sequence[int] | NDArray[np.integer], n: int) -> NDArray[np.int64]:
    """(K,) distinct users of n.

    Raises:
        ValueError: they are no indices, one is out of range or comes twice.
    """
    given = np.asarray(ids)
    if given.ndim != 1 or (given.size and not np.issubdtype(given.dtype, np.integer)):
        raise ValueError(f"ids: got {ids!r}, expected a list of user indices")
    wrong = given[(given < 0) | (given >= n)]
    if wrong.size:
        raise ValueError(f"ids: got {int(wrong[0])}, expected 0 to {n - 1}")
    if len(np.unique(given)) != len(given):
        raise ValueError(f"ids: got {given.tolist()}, expected each user at most once")
    return given.astype(np.int64)


def checked_stops(substeps: int, pose_samples: int, pauses: Iterable[int]) -> list[int]:
    """The substeps of a user step, in order, at whose ends something is to be done.

    Raises:
        ValueError: samples that do not divide the step, or a pause at no substep.
    """
    if pose_samples < 1 or substeps % pose_samples:
        raise ValueError(
            f"pose_samples: got {pose_samples}, expected a divisor of substeps={substeps}"
        )
    wrong = [stop for stop in pauses if stop not in range(1, substeps + 1)]
    if wrong:
        raise ValueError(f"pauses: got substep {wrong[0]}, expected 1 to {substeps}")
    every = substeps // pose_samples
    return sorted({*range(every, substeps + 1, every), *pauses})


def require_each(field: str, given: Sized, ids: Sized) -> None:
    """Raise ValueError unless there is one of something for each id."""
    if len(given) != len(ids):
        raise ValueError(f"{field}: got {len(given)}, expected {len(ids)}, one per id")


def require_state(state: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Raise ValueError unless a state has the keys and shapes of another, and finite numbers."""
    if set(state) != set(expected):
        raise ValueError(f"state: got keys {sorted(state)}, expected {sorted(expected)}")
    for key, value in expected.items():
        if isinstance(value, np.ndarray) and np.shape(state[key]) != value.shape:
            raise ValueError(
                f"state {key}: got shape {np.shape(state[key])}, expected {value.shape}"
            )
    if not np.isfinite(state["simulation"]).all():
        raise ValueError("state simulation: got NaN or infinity, expected finite numbers")


def checked_action(action: ArrayLike, n: int, names: Sequence[str]) -> NDArray[np.float64]:
    """(N, A) finite actions of n users, one for each name.

    Raises:
        ValueError: another shape, or numbers that are not real and finite.
    """
    shape = (n, len(names))
    try:
        given = np.asarray(action)
    except ValueError as error:
        raise ValueError(f"action: got rows of several lengths, expected {shape}") from error
    if given.shape != shape:
        raise ValueError(f"action: got shape {given.shape}, expected {shape}")
    if not np.issubdtype(given.dtype, np.number) or np.iscomplexobj(given):
        raise ValueError(f"action: got dtype {given.dtype}, expected real numbers")
    given = given.astype(np.float64)
    wrong = np.argwhere(~np.isfinite(given))
    if len(wrong):
        i, j = (int(k) for k in wrong[0])
        raise ValueError(
            f"action[{i}, {j}] ({names[j]}): got {given[i, j]}, expected a finite number in [-1, 1]"
        )
    return given
