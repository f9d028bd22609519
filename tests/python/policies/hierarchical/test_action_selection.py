"""Who waits in vain: one hand and four cells, by hand."""

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from sim2vr_harness.policies.hierarchical.action_selection import (
    committed,
    mask_unreached,
    remembered,
)
from sim2vr_harness.policies.hierarchical.options import PLAIN
from sim2vr_harness.policies.hierarchical.primitives import MOVES, OptionChoice, PrimitiveController

CELLS = torch.tensor([[0.4, 0.0, 1.0], [0.4, 0.03, 1.0], [0.4, 0.1, 1.0], [2.0, 0.0, 1.0]])
MOVER = cast(PrimitiveController, SimpleNamespace(layer=SimpleNamespace(step_s=0.05)))


def waiting(at: int, short_m: float) -> OptionChoice:
    """A hand that goes for a cell, and is told to be so far before it."""
    choice = OptionChoice(1, 1)
    choice.move[:] = MOVES.index("touch")
    choice.seen[0, 0] = CELLS[at]
    choice.place[0, 0] = CELLS[at] - torch.tensor([short_m, 0.0, 0.0])
    return choice


def left_alone(
    choice: OptionChoice,
    speed: float,
    decisions: int,
    hold: int = 1,
) -> list[list[int]]:
    """Cells that are not gone for, of each decision, by a hand that moves at a speed in m/s."""
    places = CELLS.T.reshape(1, 3, 1, 4)
    something: Any = torch.ones(1, 4, dtype=torch.bool)
    found = []
    for number in range(decisions):
        tip = torch.tensor([[[speed * 0.05 * hold * number, 0.0, 0.0]]])
        there = mask_unreached(choice, tip, something, places, hold, MOVER)
        found.append(torch.nonzero(~there[0, 0]).flatten().tolist())
    return found


def test_what_was_waited_at_for_a_second_is_left_alone_for_a_while() -> None:
    """Nothing for a second, 20 steps from the first on; for 0.3 s what is within 8 cm.

    Then it counts anew; who comes back to it leaves it, and what is within 16 cm, for 0.6 s, and
    then what is within 32 cm for 1.2 s.
    """
    found = left_alone(waiting(0, 0.07), 0.0, 85)
    assert found[:20] == [[]] * 20
    assert found[20:26] == [[0, 1]] * 6
    assert found[26:40] == [[]] * 14
    assert found[40:52] == [[0, 1, 2]] * 12
    assert found[52:60] == [[]] * 8
    assert found[60:80] == [[0, 1, 2]] * 20
    # Still for another second meanwhile, the fourth time: 64 cm, 2.4 s.
    assert found[80:] == [[0, 1, 2]] * 5


def test_a_decision_of_five_steps_counts_five() -> None:
    found = left_alone(waiting(2, 0.0), 0.0, 7, hold=5)
    assert found == [[], [], [], [], [1, 2], [1, 2], []]


@pytest.mark.parametrize(
    ("choice", "speed"),
    [
        pytest.param(waiting(0, 0.0), 0.2, id="moves"),
        pytest.param(waiting(3, 1.4), 0.0, id="what it waits for is to come"),
        pytest.param(OptionChoice(1, 1), 0.0, id="rests"),
    ],
)
def test_others_are_patient(choice: OptionChoice, speed: float) -> None:
    assert left_alone(choice, speed, 60) == [[]] * 60


def test_what_is_pursued_is_changed_for_what_is_clearly_better() -> None:
    """Cells 0 and 1 are 3 cm apart and show the same; cell 2 is 10 cm away; a tenth is clear."""
    options = SimpleNamespace(commitment=0.1)
    primitives = cast(PrimitiveController, SimpleNamespace(options=PLAIN, manner=options))
    places, there = CELLS.T.reshape(1, 3, 1, 4), torch.ones(1, 4, dtype=torch.bool)
    choice, rest, push = waiting(0, 0.0), 4 * len(MOVES), 4

    def chosen(**values: float) -> int:
        worth = torch.zeros(1, 1, rest + 1)
        for name, value in values.items():
            worth[0, 0, {"near": 1, "far": 2, "push": push, "rest": rest}[name]] = value
        return int(committed(worth, there, choice, places, primitives).item())

    assert chosen(near=0.5, far=0.59) == 1
    assert chosen(near=0.5, far=0.61) == 2
    assert chosen(near=0.5, push=0.61) == push  # another option at the same place
    choice.move[:] = -1
    assert chosen(rest=0.5, far=0.49) == rest
    assert chosen(rest=0.5, far=0.51) == 2  # who rests pursues nothing
    choice, options.commitment = waiting(0, 0.0), 0.0
    assert chosen(near=0.5, far=0.51) == 2


@pytest.mark.parametrize(
    ("place", "width_m", "tip", "kept"),
    [
        ((0.35, 0.0, 0.0), 0.02, (0.34, 0.0, 0.0), True),  # the tool, 5 cm before the thing
        ((0.35, 0.0, 0.0), 0.02, (0.10, 0.0, 0.0), False),  # something else came before it
        ((0.38, 0.0, 0.0), 0.03, (0.37, 0.0, 0.0), False),  # as far as before, a step of depth
        ((0.40, 0.05, 0.0), 0.03, (0.37, 0.0, 0.0), False),  # another thing beside it
        ((0.40, 0.01, 0.0), 0.02, (0.37, 0.0, 0.0), True),  # two thirds of it are left
        ((0.45, 0.0, 0.0), 0.03, (0.44, 0.0, 0.0), False),  # the tool hid it, and does no more
    ],
)
def test_own_tools_hide_things_and_do_not_replace_them(
    place: tuple[float, ...], width_m: float, tip: tuple[float, ...], kept: bool
) -> None:
    """A hand goes for a thing of 3 cm, 40 cm before the head."""
    choice = OptionChoice(1, 1)
    choice.move[:], choice.width[:] = MOVES.index("touch"), 0.03
    choice.seen[0, 0] = torch.tensor([0.4, 0.0, 0.0])
    new = (torch.tensor([[place]]), torch.tensor([[width_m]]))
    found, width = remembered(choice, new, torch.zeros(1, 3), torch.tensor([[tip]]))
    assert found[0, 0].tolist() == pytest.approx((0.4, 0.0, 0.0) if kept else place)
    assert float(width) == pytest.approx(0.03 if kept else width_m)
    choice.move[:] = -1  # at rest it has nothing to remember
    assert torch.equal(remembered(choice, new, torch.zeros(1, 3), torch.tensor([[tip]]))[0], new[0])
