"""The contract of everything that learns: it goes on from its state to the same bits."""

import pickle
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.runs.checkpoint import read_tensors, write_tensors


def assert_goes_on(make: Callable[[Path], Any], folder: Path, before: int, after: int) -> Any:
    """Check that a stopped learner equals one that was not stopped; return the latter.

    Its state goes through a file, and a step that is lost comes after it. A state of something else
    is refused.

    Args:
        make: returns a learner that works in a folder, always the same one.
        folder: where they may work.
        before: steps until the state.
        after: steps from there.
    """
    whole = make(folder / "whole")
    for _ in range(before + after):
        whole.step()
    expected = whole.state_dict()
    parts = make(folder / "parts")
    for _ in range(before):
        parts.step()
    write_tensors(folder / "state.pt", parts.state_dict())
    parts.step()  # lost
    again = make(folder / "parts")
    again.load_state_dict(read_tensors(folder / "state.pt", "a state"))
    for _ in range(after):
        again.step()
    assert_same(expected, again.state_dict())
    with pytest.raises(ValueError, match="got a state without"):
        again.load_state_dict({"something": 1})
    return whole


def assert_same(one: Any, other: Any, where: str = "state") -> None:
    """Compare two states to the bit."""
    if isinstance(one, Mapping):
        assert list(one) == list(other), where
        for name, value in one.items():
            assert_same(value, other[name], f"{where}.{name}")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), where
        for i, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{where}[{i}]")
    elif where.endswith(".simulation.simulation") and int(one[0]) == pickle.PROTO[0]:
        assert_same(*(pickle.loads(np.asarray(each).tobytes()) for each in (one, other)), where)
    else:
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other), err_msg=where)
