"""Saved states: what is restored, what is copied, and what is refused."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from sim2vr_harness.base.state import RowState, State


@dataclass
class Motion:
    angles: torch.Tensor
    speeds: torch.Tensor


class Part(State):
    _state = ("level",)

    def __init__(self) -> None:
        self.level = 0.0


class Learner(State):
    _state = (
        *("step", "rng", "generator", "net", "part", "motion", "past", "rows", "best", "rewards"),
        "part.level",
    )

    def __init__(self, value: float) -> None:
        self.step = int(value)
        self.rng = np.random.default_rng(int(value))
        self.generator = torch.Generator().manual_seed(int(value))
        self.net = nn.Linear(1, 1)
        nn.init.constant_(self.net.weight, value)
        self.part = Part()
        self.part.level = value
        self.motion = Motion(torch.full((2,), value), torch.zeros(2))
        self.past = [torch.full((1,), value)] * int(value)
        self.rows = np.full(3, value)
        self.best: float | None = None
        self.rewards = deque([value], maxlen=2)

    def draws(self) -> tuple[float, float]:
        return float(self.rng.random()), float(torch.rand(1, generator=self.generator))


def test_an_object_goes_on_from_its_state(tmp_path: Any) -> None:
    """Through a file of plain values and tensors; what the saved one does later changes nothing."""
    one, other = Learner(3.0), Learner(1.0)
    rows, net = other.rows, other.net
    one.best = 0.5
    torch.save(one.state_dict(), tmp_path / "state.pt")
    drawn = one.draws()
    state = one.state_dict()
    one.rows[:] = one.motion.angles[:] = 9.0
    with torch.no_grad():
        one.net.weight.fill_(9.0)
    other.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    assert other.draws() == drawn
    assert (other.step, other.best, list(other.rewards)) == (3, 0.5, [3.0])
    assert other.rewards.maxlen == 2
    assert other.part.level == 3.0
    assert other.rows.tolist() == [3.0] * 3
    assert other.rows is rows and other.net is net  # others may hold them
    assert float(other.net.weight) == 3.0
    assert other.motion.angles.tolist() == [3.0, 3.0]
    assert [float(moment) for moment in other.past] == [3.0] * 3
    other.load_state_dict(state)
    assert other.rows.tolist() == [3.0] * 3


def test_a_state_of_something_else_is_refused() -> None:
    with pytest.raises(ValueError, match="got a state without step, expected Learner's"):
        Learner(1.0).load_state_dict({"level": 1.0})


class Users(RowState):
    _state = ("_rows", "_count", "_rngs", "_part", "_none")

    def __init__(self, n: int, part: bool = True) -> None:
        self._rows, self._count = np.zeros((n, 2)), np.zeros(n, np.int64)
        self._rngs = [np.random.default_rng(i) for i in range(n)]
        self._part = Users(n, False) if part else None
        self._none = None


def test_a_user_goes_on_in_another_batch() -> None:
    one, other = Users(2), Users(3)
    one._rows[1], one._count[1] = 5.0, 7
    assert one._part is not None and other._part is not None
    one._part._rows[1] = 4.0
    one._rngs[1].random(3)
    state = one.state_dict(1)
    assert sorted(state) == ["count", "part", "rngs", "rows"]
    expected = one._rngs[1].random()
    one._rows[1] = 0.0
    other.load_state_dict(2, state)
    assert other._rows.tolist() == [[0.0, 0.0], [0.0, 0.0], [5.0, 5.0]]
    assert other._count.tolist() == [0, 0, 7]
    assert other._part._rows[2].tolist() == [4.0, 4.0]
    assert other._rngs[2].random() == expected
    with pytest.raises(ValueError, match=r"'Users', rows: got shape \(3,\), expected \(2,\)"):
        other.load_state_dict(0, {**state, "rows": np.zeros(3)})
