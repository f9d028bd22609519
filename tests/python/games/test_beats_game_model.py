"""Imagined Beats by itself: blades that go where they are told to, and boxes made by hand."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from shapings import shaped

from sim2vr_harness.games.beats import settings as model_settings
from sim2vr_harness.games.beats.game_model import (
    EVENTS,
    FIELDS,
    Blades,
    ImaginedBeats,
    distances,
    points,
)
from sim2vr_harness.games.beats.levels import Levels, made_of
from sim2vr_harness.games.beats.settings import GameModelSettings, Relaxation

STEP_S = 0.05
SOFT = Relaxation(contact_m=0.05, speed_mps=0.3, angle_deg=15.0, near=5.0, error=20.0, hazard=20.0)
UP, DOWN, DOWN_RIGHT, ANY = 0, 1, 7, 8
LEFT, RIGHT = 0, 1
HEAD = (0.0, 1.2, 0.1)
"""App's axes: x right, y up, z forward, m."""
DOWNWARDS = (0.0, -1.0, 0.0)


def box(time_s: float, column: float, hand: int, cut: int, **more: Any) -> dict[str, Any]:
    placed = {"time_s": time_s, "column": column, "row": 1.0, "hand": hand, "cut": cut}
    return placed | {"angle_offset_deg": 0.0, "link": False} | more


def level(*boxes: dict[str, Any], **more: Any) -> dict[str, Any]:
    made = {"length_s": 10.0, "speed_mps": 10.0, "approach_s": 1.5, "mines": [], "walls": []}
    return made | {"boxes": list(boxes)} | more


def rounds(
    n: int, *levels: dict[str, Any], settings: GameModelSettings | None = None
) -> ImaginedBeats:
    known = Levels.joined([made_of(each, 0) for each in levels], least=3)
    return ImaginedBeats(n, known, 1, settings or GameModelSettings(), step_s=STEP_S, seed=1)


def at(vector: Any) -> torch.Tensor:
    """App's axes to MuJoCo's."""
    x, y, z = torch.as_tensor(vector, dtype=torch.float32).unbind(-1)
    return torch.stack([z, -x, y], -1)


def placed(left: Any, right: Any, axis: Any = (0.0, 0.0, 1.0), head: Any = HEAD) -> torch.Tensor:
    """(1, 3, 4, 4) places whose blades begin at ``left`` and ``right`` from the head."""
    place = torch.eye(4).repeat(1, 3, 1, 1)
    forward = at(axis) / at(axis).norm()
    other = torch.linalg.cross(forward, torch.tensor([0.3, 0.5, 0.8]))
    other = other / other.norm()
    rotation = torch.stack([forward, other, torch.linalg.cross(forward, other)], 1)
    for device, root in enumerate((left, right)):
        place[0, device, :3, :3] = rotation
        place[0, device, :3, 3] = at(torch.tensor(HEAD) + torch.as_tensor(root)) - 0.08 * forward
    place[0, 2, :3, 3] = at(head)
    return place


AWAY = (3.0, 0.0, 0.0)


def begun(game: ImaginedBeats, place: torch.Tensor, time_s: float) -> None:
    everyone = torch.arange(game.n)
    game.start(
        everyone, place.expand(game.n, -1, -1, -1), torch.zeros(game.n, len(FIELDS)), everyone
    )
    game.lane.time_s[:] = time_s
    game.lane.level[:] = torch.arange(game.n) % len(game.lane.levels.speed)
    game.lane.box_gone[:], game.lane.mine_gone[:], game.lane.wall_gone[:] = False, False, False
    game._origin[:] = torch.tensor(HEAD)


def events(game: ImaginedBeats) -> dict[str, float]:
    return {name: n for name, n in zip(EVENTS, game.events.tolist(), strict=True) if n}


def test_points_by_hand() -> None:
    """5 m/s and more straight along; 2.75 m/s at 30 degrees; the least that counts."""
    worth = points(torch.tensor([5.0, 9.0, 2.75, 0.5]), torch.tensor([0.0, 0.0, 30.0, 60.0]))
    assert worth.tolist() == pytest.approx([200.0, 200.0, 125.0, 50.0])


def test_distances_from_a_box_by_hand() -> None:
    """A box of 0.35 m at the origin; blades along z, to the left, above, and at a corner."""
    roots = [[-0.5, 0.0, -0.5], [0.0, 0.30, -0.5], [0.4, 0.3, -0.5], [0.1, 0.0, -0.5]]
    root = torch.tensor(roots).reshape(2, 2, 1, 3)
    blades = Blades(root, torch.tensor([0.0, 0.0, 1.0]).expand_as(root))
    middles, half = torch.zeros(2, 1, 1, 3), torch.full((2, 1), 0.175)
    straight, turned = torch.tensor([1.0, 0.0]), torch.tensor([0.5, 0.5]).sqrt()
    apart, along = distances(blades, middles, straight.expand(2, 1, 2), half)
    corner = (0.225**2 + 0.125**2) ** 0.5
    expected = [0.325, 0.125, corner, -0.075]
    torch.testing.assert_close(apart.flatten(), torch.tensor(expected), atol=1e-3, rtol=0.0)
    assert along.flatten().tolist() == pytest.approx([0.5] * 4)
    apart, _ = distances(blades, middles, turned.expand(2, 1, 2), half)
    # Turned by 45 degrees an edge, 0.2475 m away, points at the first two.
    assert apart.flatten()[:2].tolist() == pytest.approx([0.5 - 0.2475, 0.3 - 0.2475], abs=2e-3)


def swings(hand: int, cut: int, speed_mps: float, across: Any = DOWNWARDS) -> dict[str, float]:
    """What happens when the right blade goes through the middle of a box in the cut plane."""
    game = rounds(1, level(box(2.0, 2.0, hand, cut)))
    middle = torch.tensor([0.2, -0.3, 0.3])
    way = torch.tensor(across) * speed_mps * STEP_S
    begun(game, placed(AWAY, middle - 0.5 * way), 1.975)
    game.play(placed(AWAY, middle + 0.5 * way), SOFT)
    return events(game)


def test_what_a_swing_is_by_the_rules() -> None:
    assert swings(RIGHT, DOWN, 3.0) == {"sliced": 1.0}
    assert swings(RIGHT, ANY, 3.0) == {"sliced": 1.0}
    assert swings(RIGHT, DOWN, 0.4) == {}  # too slow: the box goes on
    assert swings(RIGHT, UP, 3.0) == {"wrong direction": 1.0}
    assert swings(LEFT, DOWN, 3.0) == {"wrong hand": 1.0}
    assert swings(RIGHT, DOWN_RIGHT, 3.0) == {"sliced": 1.0}  # 45 degrees off
    assert swings(RIGHT, DOWN_RIGHT, 3.0, (-1.0, 0.0, 0.0)) == {"wrong direction": 1.0}  # 135
    # The way along the blade does not count: 3 m/s forward is no motion across it.
    assert swings(RIGHT, ANY, 3.0, (0.0, 0.0, 1.0)) == {}


def test_mines_and_walls_by_hand() -> None:
    mine = {"time_s": 2.0, "column": 2.0, "row": 1.0}
    wall = {"time_s": 2.0, "duration_s": 1.0, "column": 0, "row": 2, "width": 4, "height": 1}
    game = rounds(1, level(mines=[mine], walls=[wall]))
    begun(game, placed(AWAY, AWAY), 1.95)
    game.play(placed(AWAY, (0.2, -0.3, 0.3)), SOFT)  # the still blade is in the mine
    assert events(game) == {"mines": 1.0, "walls": 1.0}
    game.play(placed(AWAY, (0.2, -0.3, 0.3)), SOFT)  # once each
    assert events(game) == {"mines": 1.0, "walls": 1.0}
    # The wall's lower edge is 0.125 m below the eyes: 0.205 m down and the head is free.
    for down, walls in ((0.20, {"walls": 1.0}), (0.21, {})):
        game = rounds(1, level(walls=[wall]))
        place = placed(AWAY, AWAY, head=(0.0, 1.2 - down, 0.1))
        begun(game, place, 1.95)
        game.play(place, SOFT)
        assert events(game) == walls


def test_a_head_in_a_wall_pays_by_its_depth_in_every_step() -> None:
    """Lower edge 0.125 m below the eyes, radius of the head 0.08 m: at rest it is 0.205 m deep,
    with 6 cm to clear 0.265 m, at 20 points for every 0.1 m; 0.25 m down 1.5 cm are left."""
    wall = {"time_s": 2.0, "duration_s": 1.0, "column": 0, "row": 2, "width": 4, "height": 3}
    for down, cost in ((0.0, 53.0), (0.1, 33.0), (0.25, 3.0), (0.27, 0.0)):
        paid = []
        for wall_cost in (0.0, 20.0):
            game = rounds(
                1, level(walls=[wall]), settings=shaped(model_settings, wall_cost=wall_cost)
            )
            place = placed(AWAY, AWAY, head=(0.0, 1.2 - down, 0.1))
            begun(game, place, 2.1)
            paid.append([float(game.play(place, SOFT)) for _ in range(2)])
        assert [free - wall for free, wall in zip(*paid, strict=True)] == pytest.approx(
            [cost, cost], abs=1e-3
        )


def test_a_stroke_is_drawn_back_and_goes_through_the_box() -> None:
    """At 3 m/s down through (0.2, -0.3): 0.1 s before 0.3 m above it, 0.3 s before 0.4 m; on the
    stroke a step is worth 20 points, 0.25 m beside it 10, and half a second before nothing yet."""

    def reward(until_s: float, *away: float, hand: int = RIGHT) -> float:
        game = rounds(1, level(box(2.0, 2.0, hand, DOWN)))
        x, y = away
        place = placed(AWAY, (0.2 + x, -0.3 + y, 0.3))
        begun(game, place, 2.0 - until_s - STEP_S)
        with_it, without = (
            game.play(place, replace(SOFT, near=0.0, stroke=stroke)) for stroke in (20.0, 0.0)
        )
        return float(with_it - without)

    assert reward(0.1, 0.0, 0.3) == pytest.approx(20.0, abs=0.1)
    assert reward(0.3, 0.0, 0.4) == pytest.approx(20.0, abs=0.1)
    assert reward(0.1, 0.25, 0.3) == pytest.approx(10.0, abs=0.1)
    assert reward(0.6, 0.0, 0.4) == 0.0
    # The other hand's box: its own blade is 3 m to the right, half a metre costs 20 points.
    assert reward(0.1, 0.0, 0.3, hand=LEFT) < -80.0
    assert GameModelSettings(stroke_reward=20.0).relaxation(0.4).stroke == pytest.approx(10.0)
    assert GameModelSettings(stroke_reward=20.0).relaxation(0.9).stroke == 0.0


def test_the_gradient_is_that_of_finite_differences() -> None:
    """Of a swing past the box's edge, by where the blade goes."""
    cuts = replace(SOFT, near=0.0)
    start = torch.tensor([0.45, -0.2, 0.3])

    def total(ways: torch.Tensor) -> torch.Tensor:
        game = rounds(1, level(box(2.0, 2.0, RIGHT, DOWN)))
        begun(game, placed(AWAY, start.tolist()), 1.9)
        worth, root = torch.zeros(()), start
        for way in ways:
            place = placed(AWAY, AWAY)
            root = root + way
            shift = torch.zeros(1, 3, 4, 4)
            moved = at(root) - at(torch.tensor(AWAY))
            shift = shift.index_put((torch.tensor([0]), torch.tensor([1])), _column(moved)[None])
            worth = worth + game.play(place + shift, cuts).sum()
        return worth

    ways = torch.tensor([[-0.02, -0.05, 0.0], [-0.04, -0.08, 0.01]], requires_grad=True)
    total(ways).backward()
    assert ways.grad is not None
    direction = torch.tensor([[0.3, -0.5, 0.1], [-0.4, 0.2, 0.3]])
    with torch.no_grad():
        h = 1e-3
        slope = (total(ways + h * direction) - total(ways - h * direction)) / (2.0 * h)
    expected = float((ways.grad * direction).sum())
    assert abs(expected) > 1.0
    assert float(slope) == pytest.approx(expected, rel=0.03)


def _column(position: torch.Tensor) -> torch.Tensor:
    """(4, 4) zeros but for a position."""
    return torch.nn.functional.pad(position[:, None], (3, 0, 0, 1))
