"""From what users see, and a choice among it, to what their muscles do."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid, Fovea
from sim2vr_harness.policies.hierarchical.options import PLAIN, OptionSet
from sim2vr_harness.policies.hierarchical.primitives import (
    OptionChoice,
    PrimitiveController,
    is_strike,
    is_swing,
    points,
)

_STILL_M, _PATIENCE_S = 0.05, 1.0
"""Distance (m) and time (s) of the test for a hand that waits without effect: it moved less than
this in that time. Speed is a weaker criterion, because the other arm shakes a hand that waits."""
_TO_COME_M = 0.3
"""Distance beyond a hand's reach up to which an object may come nearer and is worth waiting for."""
_LEFT_M, _LEFT_S = 0.08, 0.3
"""Radius (m) and time (s) for which a hand avoids an object at which it waited without effect.
Positions of cells lie on the fronts of objects, some cm before their middles, and neighbouring
cells show the same object."""
_PURSUED_M = 0.06
"""Distance from a hand's target within which cells show the same object."""
_COMES_M = 0.6
"""Distance from where a thing that comes was to be, m, within which what is seen is this thing."""
_SAME_M, _SHORT_M, _MOST_VAIN = 0.15, 0.05, 3
"""Rule for repeated waiting: radius and time double each time that the hand returns to within
_SAME_M and again stops at least _SHORT_M short, at most _MOST_VAIN times. A hand that reached its
target is exempt, because it may have reasons to stay."""


_OWN_M, _SAME_THING_M, _BEFORE_M, _PARTLY = 0.15, 0.03, 0.03, (0.4, 0.95)
"""Thresholds for occlusion by the own tool: distance from the tip within which a surface may be the
tool (m), distance beside the line of sight within which the tool may hide an object (m), distance
before the object (m), and the visible proportion of the object's width (from, to)."""
Aims = tuple[Tensor, Tensor, Tensor]
"""(N, H, 3) middles of things, (N, H) their widths, m, and (N, H, 3) velocities of those that come
and are struck, m/s."""
NOW_S, _HERE = torch.zeros(1), torch.eye(4)[None]
"""The age of what is known as it is, and a head that has not moved."""
BEFORE_S = 0.2
"""Time between the two images of an observation, s."""


@dataclass
class OptionScene:
    """Images and positions of N users at a decision.

    Attributes:
        sight: geometry of the images.
        pictures: (N, 8, H, W) uint8, red, green, blue and depth now, and 0.2 s before.
        head: (N, 3) positions of the heads when the images were rendered, m.
        turned: (N, 3, 3) rotations of the heads at that time.
        tips: (N, H, 3) positions of the tips, m.
        velocities: (N, H, 3) velocities of the tips, m/s.
        fovea: pictures around the gazes; None: users have none.
        before: (N, 4, 4) poses of the heads when the earlier images were rendered.
        late_s: (N,) how old the images are, s.
    """

    sight: DepthGrid
    pictures: Tensor
    head: Tensor
    turned: Tensor
    tips: Tensor
    velocities: Tensor
    fovea: Fovea | None = None
    before: Tensor = _HERE
    late_s: Tensor = NOW_S

    @cached_property
    def places(self) -> Tensor:
        """(N, 3, rows, columns) of what is seen, world, m."""
        return self.sight.places(self.pictures[:, 3], self.head, self.turned)

    @cached_property
    def something(self) -> Tensor:
        """(N, cells) True for cells with a visible surface."""
        return self.sight.something(self.pictures[:, 3])

    def inputs(self, net: ActionValueMap) -> tuple[Tensor, Tensor, Tensor]:
        """Return what the layers of a network take, the same for all networks."""
        return net.inputs(self.pictures, self.places, self.head, self.tips, self.velocities)

    def aims(self, choice: OptionChoice, chosen: NDArray[np.int64], options: OptionSet) -> Aims:
        """Return where the things are that are seen in the cells of choices, how wide, how fast.

        A cell is larger than many a thing: 7 cm wide at arm's length. What the user's own tool
        hides is where it was before.
        """
        number = torch.from_numpy(chosen)
        option, cells = number // self.sight.cells, number % self.sight.cells
        place, width = self.sight.things(self.pictures, cells, self.head, self.turned, self.fovea)
        velocity = torch.zeros_like(place)
        placed = option < len(options.placed)
        strikes = placed & is_strike(options.numbers[option.clamp(max=len(options.placed) - 1)])
        if strikes.any():
            user = torch.nonzero(strikes)[:, 0]
            poses = (self.head[user], self.turned[user], self.before[user])
            velocity[strikes] = self.sight.coming(
                self.pictures[user], place[strikes], *poses, BEFORE_S
            )
        return (*remembered(choice, (place, width), self.head, self.tips), velocity)


def best_choices(values: Tensor, something: Tensor, options: OptionSet = PLAIN) -> Tensor:
    """(N, H) choices that are worth most, of those that do something with something.

    Args:
        something: (N, cells) or (N, H, cells) whether anything is there.
    """
    return _of_things(values, something, options).argmax(-1)


def _of_things(values: Tensor, something: Tensor, options: OptionSet) -> Tensor:
    """(N, H, choices) values, minus infinity of what would be done with nothing."""
    each = something if something.ndim == 3 else something[:, None]
    always = torch.ones_like(each[..., :1]).repeat(1, 1, 1 + len(options.free))
    there = torch.cat([each.repeat(1, 1, len(options.placed)), always], 2)
    return values.masked_fill(~there, -torch.inf)


def committed(
    values: Tensor,
    something: Tensor,
    choice: OptionChoice,
    places: Tensor,
    primitives: PrimitiveController,
) -> Tensor:
    """(N, H) choices: what hands pursue, unless another choice is worth clearly more.

    Hands that rest pursue nothing.

    Args:
        something: as in :func:`best_choices`.
        places: (N, 3, rows, columns) of the cells, world, m.
        primitives: of the hands; their manner says how much is clearly.
    """
    options, worth = primitives.options, _of_things(values, something, primitives.options)
    most, best = worth.max(-1)
    if not primitives.manner.commitment:
        return best
    cells = places.flatten(2).transpose(1, 2)
    # A thing that comes is nearer than it was when it was last looked at.
    within = _PURSUED_M + BEFORE_S * choice.velocity.norm(dim=-1, keepdim=True)
    beside = (cells[:, None] - choice.seen[:, :, None]).norm(dim=-1) > within
    count, rest = cells.shape[1], options.rest(cells.shape[1])
    same = options.numbers == choice.move[..., None]
    of_places = worth[..., :rest].reshape(*most.shape, len(options.placed), count)
    own = of_places.masked_fill(~same[..., None] | beside[:, :, None], -torch.inf).flatten(2)
    pursued, number = own.max(-1)
    return torch.where(pursued >= most - primitives.manner.commitment, number, best)


def mask_unreached(
    choice: OptionChoice,
    tips: Tensor,
    something: Tensor,
    places: Tensor,
    hold: int,
    primitives: PrimitiveController,
) -> Tensor:
    """Return (N, H, cells) True for cells with a surface that a hand has not just waited at.

    A hand that stops short of its target would wait there for ever, because the same observation
    leads to the same decision. In training, exploration resolves this.

    Args:
        choice: current options of the hands, changed in place.
        tips: (N, H, 3) positions of the tips of their tools, m.
        something: (N, cells) True for cells with a surface.
        places: (N, 3, rows, columns) positions of the cells, world, m.
        hold: user steps for which an option is executed.
    """
    # Where a hand that points is does not matter, but what it points at.
    aims = points(choice.move)[..., None]
    tips = torch.where(aims, choice.seen, tips)
    far = (choice.seen - choice.place).norm(dim=-1) > _TO_COME_M
    stays = (tips - choice.at).norm(dim=-1) < _STILL_M
    waits = stays & (choice.move >= 0) & ~far & choice.due_s.isnan()
    choice.rested += hold
    choice.rested[~waits] = 0
    choice.at[~waits] = tips[~waits]
    choice.leaving -= hold
    leaves = choice.rested >= round(_PATIENCE_S / primitives.layer.step_s)
    short = (tips - choice.place).norm(dim=-1) > _SHORT_M
    again = short & ((choice.seen - choice.left).norm(dim=-1) < _SAME_M)
    choice.vain[leaves] = torch.where(again, (choice.vain + 1).clamp(max=_MOST_VAIN), 0)[leaves]
    choice.left[leaves] = choice.seen[leaves]
    choice.leaving[leaves] = round(_LEFT_S / primitives.layer.step_s) * 2 ** choice.vain[leaves]
    choice.rested[leaves] = 0
    if not (choice.leaving > 0).any():
        return something[:, None].expand(-1, choice.leaving.shape[1], -1)
    cells = places.flatten(2).transpose(1, 2)
    around = _LEFT_M * 2.0**choice.vain
    near = (cells[:, None] - choice.left[:, :, None]).norm(dim=-1) < around[..., None]
    return something[:, None] & ~(near & (choice.leaving > 0)[..., None])


def remembered(
    choice: OptionChoice, aims: tuple[Tensor, Tensor], head: Tensor, tips: Tensor
) -> tuple[Tensor, Tensor]:
    """Return aims, with the last visible ones for objects that the user's own tool occludes.

    Args:
        choice: current options of the hands.
        aims: aims of these options.
        head: (N, 3) positions of the heads, m.
        tips: (N, H, 3) positions of the tips of the tools, m.
    """
    place, width = aims
    before = choice.seen - head[:, None]
    far = before.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    way = place - head[:, None]
    along = (way * before).sum(-1, keepdim=True) / far
    beside = (way - along * before / far).norm(dim=-1)
    own = ((place - tips).norm(dim=-1) < _OWN_M) & (choice.move >= 0) & (beside < _SAME_THING_M)
    share = width / choice.width
    partly = (share > _PARTLY[0]) & (share < _PARTLY[1])
    hidden = own & (((far - along)[..., 0] > _BEFORE_M) | partly)
    return torch.where(hidden[..., None], choice.seen, place), torch.where(
        hidden, choice.width, width
    )


def choose(
    choice: OptionChoice,
    chosen: NDArray[np.int64],
    places: Tensor,
    primitives: PrimitiveController,
    changed: NDArray[np.bool_] | None = None,
    aims: Aims | None = None,
    late_s: Tensor = NOW_S,
) -> None:
    """Put choices into effect.

    Args:
        choice: of N users, changed in place.
        chosen: (N, H) move * cells + cell; moves * cells is to rest, options without a place
            follow.
        places: (N, 3, rows, columns) of the cells, world, m.
        primitives: knows what is within reach.
        changed: (N, H) whose choice is a new one; None: every user's.
        aims: of :meth:`OptionScene.aims`; None: the places of the cells, whatever is there.
        late_s: (N,) how old they are, s.
    """
    flat = places.flatten(2).transpose(1, 2)
    cells = flat.shape[1]
    number = torch.from_numpy(chosen)
    options = primitives.options
    rest = options.rest(cells)
    placed = number < rest
    move = options.numbers[(number // cells).clamp(max=len(options.placed) - 1)]
    new = torch.ones_like(placed) if changed is None else torch.from_numpy(changed)
    users = torch.arange(len(chosen))
    for hand in range(chosen.shape[1]):
        there = flat[users, number[:, hand] % cells]
        if aims is not None:
            there = aims[0][:, hand]
        wanted = primitives.within_reach(hand, there, is_swing(move[:, hand]))
        wanted = torch.where(points(move[:, hand])[:, None], there, wanted)
        moves = (new & placed)[:, hand, None]
        if aims is not None:
            speed = aims[2][:, hand]
            wanted, due_s = primitives.meeting(hand, move[:, hand], there, speed, wanted, late_s)
            # What is where a thing was to come by now is this thing, which is met as was planned
            # if it is not seen to come, and else where both estimates say in the mean.
            before_s, velocity = choice.due_s[:, hand], choice.velocity[:, hand]
            by_now = choice.place[:, hand] - velocity * (before_s + late_s)[:, None]
            same = (choice.move == move)[:, hand] & ((there - by_now).norm(dim=-1) < _COMES_M)
            both = same & ~due_s.isnan()
            wanted = torch.where(both[:, None], 0.5 * (wanted + choice.place[:, hand]), wanted)
            speed = torch.where(both[:, None], 0.5 * (speed + velocity), speed)
            due_s = torch.where(both, 0.5 * (due_s + before_s), due_s)
            moves = moves & (~same | both)[:, None]
            choice.due_s[:, hand] = torch.where(moves[:, 0], due_s, choice.due_s[:, hand])
            choice.velocity[:, hand] = torch.where(moves, speed, choice.velocity[:, hand])
        choice.place[:, hand] = torch.where(moves, wanted, choice.place[:, hand])
        choice.seen[:, hand] = torch.where(moves, there, choice.seen[:, hand])
    if aims is not None:
        choice.width = torch.where(new & placed, aims[1], choice.width)
    choice.move = torch.where(new & placed, move, choice.move)
    choice.move = torch.where(new & (number == rest), -1, choice.move)
    choice.due_s = torch.where(is_strike(choice.move), choice.due_s, torch.nan)
    if options.free:
        primitives.begin_free(choice, new & (number > rest), (number - rest - 1).clamp(min=0))
