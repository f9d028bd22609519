"""Who waits in vain: one hand and four cells, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from sim2vr_harness.training.skills.choosing import best_choices, lose_patience
from sim2vr_harness.training.skills.moves import MOVES, Choice, Mover

CELLS = torch.tensor([[0.4, 0.0, 1.0], [0.4, 0.03, 1.0], [0.4, 0.1, 1.0], [2.0, 0.0, 1.0]])
MOVER = cast(Mover, SimpleNamespace(layer=SimpleNamespace(step_s=0.05)))


def waiting(at: int, short_m: float) -> Choice:
    """A hand that goes for a cell, and is told to be so far before it."""
    choice = Choice(1, 1)
    choice.move[:] = MOVES.index("touch")
    choice.seen[0, 0] = CELLS[at]
    choice.place[0, 0] = CELLS[at] - torch.tensor([short_m, 0.0, 0.0])
    return choice


def left_alone(choice: Choice, speed: float, decisions: int, hold: int = 1) -> list[list[int]]:
    """Cells that are not gone for, of each decision."""
    places = CELLS.T.reshape(1, 3, 1, 4)
    something: Any = torch.ones(1, 4, dtype=torch.bool)
    velocity = torch.tensor([[[speed, 0.0, 0.0]]])
    found = []
    for _ in range(decisions):
        there = lose_patience(choice, velocity, something, places, hold, MOVER)
        found.append(torch.nonzero(~there[0, 0]).flatten().tolist())
    return found


def test_what_was_waited_at_for_a_second_is_left_alone_for_a_while() -> None:
    """Nothing for 19 steps, from the 20th on for 0.3 s what is within 4 cm; then it counts anew."""
    found = left_alone(waiting(0, 0.07), 0.05, 46)
    assert found[:19] == [[]] * 19
    assert found[19:25] == [[0, 1]] * 6
    assert found[25:39] == [[]] * 14
    assert found[39:45] == [[0, 1]] * 6


def test_a_decision_of_five_steps_counts_five() -> None:
    found = left_alone(waiting(2, 0.0), 0.0, 6, hold=5)
    assert found == [[], [], [], [2], [2], []]


@pytest.mark.parametrize(
    ("choice", "speed"),
    [
        pytest.param(waiting(0, 0.0), 0.2, id="moves"),
        pytest.param(waiting(3, 1.4), 0.0, id="what it waits for is to come"),
        pytest.param(Choice(1, 1), 0.0, id="rests"),
    ],
)
def test_others_are_patient(choice: Choice, speed: float) -> None:
    assert left_alone(choice, speed, 60) == [[]] * 60


def test_the_next_best_is_done_instead() -> None:
    values = torch.zeros(1, 1, 4 * len(MOVES) + 1)
    values[0, 0, :3] = torch.tensor([3.0, 2.0, 1.0])
    all_there = torch.ones(1, 4, dtype=torch.bool)
    assert best_choices(values, all_there).item() == 0
    assert best_choices(values, torch.tensor([[[False, False, True, True]]])).item() == 2


def test_a_new_round_begins_patiently() -> None:
    choice = waiting(0, 0.0)
    left_alone(choice, 0.0, 22)
    choice.forget(torch.tensor([0]).numpy())
    assert choice.move.item() == -1
    assert left_alone(choice, 0.0, 1) == [[]]
