"""From what users see, and a choice among it, to what their muscles do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid, rotation
from sim2vr_harness.policies.hierarchical.frame_history import FrameHistory
from sim2vr_harness.policies.hierarchical.options import PLAIN, OptionSet
from sim2vr_harness.policies.hierarchical.primitives import (
    OptionChoice,
    PrimitiveController,
    is_swing,
    points,
)

_STILL_M, _PATIENCE_S = 0.05, 1.0
"""Hands that come no farther than that in so long wait for something that does not come. (Speeds
tell less: what the other arm does shakes a hand that waits.)"""
_TO_COME_M = 0.3
"""So far beyond a hand's reach is what may come nearer, and is worth waiting for."""
_LEFT_M, _LEFT_S = 0.04, 0.3
"""How far around it, and how long, what a hand has waited at without effect is left alone."""
_PURSUED_M = 0.06
"""Cells so near to what a hand pursues show the same thing."""
_SAME_M, _SHORT_M, _MOST_VAIN = 0.15, 0.05, 3
"""Twice as far and as long each time that it comes back to about there and stops so far short
again, up to so many times. (Who has come where it wants to be may have reasons to stay.)"""


_OWN_M, _SAME_THING_M, _BEFORE_M, _PARTLY = 0.15, 0.03, 0.03, (0.4, 0.85)
"""What is so near to the tip of a tool may be the tool; how far beside the line of sight to a thing
it may hide it; how far before it, and how much of the thing's width is left where it does."""
Aims = tuple[Tensor, Tensor]
"""(N, H, 3) middles of things, and (N, H) their widths, m."""


@dataclass
class OptionScene:
    """What N users see and where they are, at a decision.

    Attributes:
        pictures: (N, 8, H, W) uint8, red, green, blue and depth now, and 0.2 s before.
        head: (N, 3) where the heads were when that was drawn, m.
        turned: (N, 9) their rotations.
        tips: (N, H, 3) m.
        velocities: (N, H, 3) theirs, m/s.
    """

    pictures: NDArray[np.uint8]
    head: NDArray[np.float32]
    turned: NDArray[np.float32]
    tips: NDArray[np.float32]
    velocities: NDArray[np.float32]


class ActionSelector:
    """N users who see places and do something with them.

    Args:
        simulation: the users.
        primitives: of their hands.
        past: what they see.
    """

    def __init__(
        self, simulation: Any, primitives: PrimitiveController, past: FrameHistory
    ) -> None:
        self._simulation, self.primitives, self._past = simulation, primitives, past
        vision = simulation.config.vision
        self.sight = DepthGrid(vision.height, vision.width)

    def _head(self) -> NDArray[np.float32]:
        head: NDArray[np.float32] = self._simulation.users.device_poses("headset")[0].astype("f4")
        return head

    def scene(self) -> OptionScene:
        """Return what the users see now."""
        head, quaternion = self._past.heads()
        layer = self.primitives.layer
        with torch.inference_mode():
            angles, speeds, _ = layer.motion(self._simulation.users)
            moving = [each.numpy() for each in self.primitives.tips(*layer.places(angles, speeds))]
        turned = rotation(quaternion).flatten(1).numpy()
        return OptionScene(self._past.observe(), head.astype("f4"), turned, *moving)

    def places(self, scene: OptionScene) -> Tensor:
        """(N, 3, rows, columns) of what is seen, world, m."""
        depth = torch.from_numpy(scene.pictures[:, 3])
        head, turned = torch.from_numpy(scene.head), torch.from_numpy(scene.turned)
        return self.sight.places(depth, head, turned.reshape(-1, 3, 3))

    def values(self, net: ActionValueMap, scene: OptionScene, places: Tensor) -> Tensor:
        """(N, H, choices) what a network says that choices are worth."""
        return net.values(*self.inputs(net, scene, places))

    def inputs(
        self, net: ActionValueMap, scene: OptionScene, places: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return what a network's layers take, the same for all networks."""
        known = (scene.pictures, scene.head, scene.tips, scene.velocities)
        pictures, *parts = (torch.from_numpy(part) for part in known)
        return net.inputs(pictures, places, *parts)

    def choose_best(self, net: ActionValueMap, choice: OptionChoice, hold: int = 0) -> None:
        """Put into effect what a network says is worth most now, for every user.

        Args:
            net: the network.
            choice: changed in place.
            hold: user steps for which a choice is kept, of users who leave a place where waiting
                earned nothing; 0: users without memory.
        """
        scene = self.scene()
        places = self.places(scene)
        with torch.inference_mode():
            values, something = self.values(net, scene, places), self.something(scene)
            if hold:
                something = mask_unreached(
                    choice, torch.from_numpy(scene.tips), something, places, hold, self.primitives
                )
            chosen = committed(values, something, choice, places, self.primitives).numpy()
        self.choose(choice, chosen, scene, places)

    def something(self, scene: OptionScene) -> Tensor:
        """(N, cells) whether anything is seen in a cell."""
        return self.sight.something(torch.from_numpy(scene.pictures[:, 3]))

    def best(self, values: Tensor, scene: OptionScene) -> Tensor:
        """(N, H) choices that are worth most, see :func:`best_choices`."""
        return best_choices(values, self.something(scene), self.primitives.options)

    def committed(
        self, values: Tensor, scene: OptionScene, choice: OptionChoice, places: Tensor
    ) -> Tensor:
        """(N, H) choices, see :func:`committed`."""
        return committed(values, self.something(scene), choice, places, self.primitives)

    def choose(
        self,
        choice: OptionChoice,
        chosen: NDArray[np.int64],
        scene: OptionScene,
        places: Tensor,
        changed: NDArray[np.bool_] | None = None,
    ) -> None:
        """Put choices into effect, see :func:`choose`."""
        aims = aims_of(
            self.sight,
            chosen,
            torch.from_numpy(scene.pictures),
            torch.from_numpy(scene.head),
            torch.from_numpy(scene.turned).reshape(-1, 3, 3),
        )
        head, tips = torch.from_numpy(scene.head), torch.from_numpy(scene.tips)
        aims = remembered(choice, aims, head, tips)
        choose(choice, chosen, places, self.primitives, changed, aims)

    def actions(self, choice: OptionChoice) -> NDArray[np.float32]:
        """(N, A) what the bodies do now for a choice."""
        layer = self.primitives.layer
        with torch.inference_mode():
            motion = layer.motion(self._simulation.users)
            placed = layer.places(*motion[:2])
        goals = self.primitives.goals(choice, torch.from_numpy(self._head()), *placed)
        body = layer.decide(motion, placed, goals)
        fingers = self.primitives.inputs(choice, placed[0])
        return np.concatenate([body, fingers], 1) if fingers.size else body


def best_choices(values: Tensor, something: Tensor, options: OptionSet = PLAIN) -> Tensor:
    """(N, H) choices that are worth most, of those that do something with something.

    Args:
        values: (N, H, choices).
        something: (N, cells) or (N, H, cells) whether anything is there.
        options: of the hands.
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
        values: (N, H, choices).
        something: as in :func:`best_choices`.
        choice: what hands do.
        places: (N, 3, rows, columns) of the cells, world, m.
        primitives: of the hands; their manner says how much is clearly.
    """
    options, worth = primitives.options, _of_things(values, something, primitives.options)
    most, best = worth.max(-1)
    if not primitives.manner.commitment:
        return best
    cells = places.flatten(2).transpose(1, 2)
    beside = (cells[:, None] - choice.seen[:, :, None]).norm(dim=-1) > _PURSUED_M
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
    """(N, H, cells) whether anything is in a cell that a hand has not just waited at.

    A hand that stops short of what it goes for would wait there for ever: it sees the same, and
    decides the same. While learning, tries get it out of there.

    Args:
        choice: what hands have been doing, changed in place.
        tips: (N, H, 3) where the tips of their tools are, m.
        something: (N, cells) whether anything is there.
        places: (N, 3, rows, columns) of the cells, world, m.
        hold: user steps for which a decision is seen through.
        primitives: of the hands.
    """
    # Where a hand that points is does not matter, but what it points at.
    aims = points(choice.move)[..., None]
    tips = torch.where(aims, choice.seen, tips)
    far = (choice.seen - choice.place).norm(dim=-1) > _TO_COME_M
    stays = (tips - choice.at).norm(dim=-1) < _STILL_M
    waits = stays & (choice.move >= 0) & ~far
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


def aims_of(
    sight: DepthGrid,
    chosen: NDArray[np.int64],
    pictures: Tensor,
    head: Tensor,
    turned: Tensor,
) -> Aims:
    """Return where the things are that are seen in the cells of choices, and how wide.

    A cell is larger than many a thing: 4 cm wide at arm's length.
    """
    return sight.things(pictures, torch.from_numpy(chosen) % sight.cells, head, turned)


def remembered(choice: OptionChoice, aims: Aims, head: Tensor, tips: Tensor) -> Aims:
    """Return aims, and of things that the user's own tool hides what was seen of them before.

    Args:
        choice: what hands have been doing.
        aims: of the present choices.
        head: (N, 3) m.
        tips: (N, H, 3) where the tips of the tools are, m.
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
) -> None:
    """Put choices into effect.

    Args:
        choice: of N users, changed in place.
        chosen: (N, H) move * cells + cell; moves * cells is to rest, options without a place
            follow.
        places: (N, 3, rows, columns) of the cells, world, m.
        primitives: knows what is within reach.
        changed: (N, H) whose choice is a new one; None: every user's.
        aims: of :func:`aims_of`; None: the places of the cells, whatever is there.
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
        choice.place[:, hand] = torch.where(moves, wanted, choice.place[:, hand])
        choice.seen[:, hand] = torch.where(moves, there, choice.seen[:, hand])
    if aims is not None:
        choice.width = torch.where(new & placed, aims[1], choice.width)
    choice.move = torch.where(new & placed, move, choice.move)
    choice.move = torch.where(new & (number == rest), -1, choice.move)
    if options.free:
        primitives.begin_free(choice, new & (number > rest), (number - rest - 1).clamp(min=0))
