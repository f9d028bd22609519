"""A recorded round in the coordinates of the targets' plane."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name
from sim2vr_harness.evaluation.replay.recordings import Recording
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.targets import Targets, targets_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PlayedRound:
    """What is measured: tool, hand and head of N frames, and what happened to the targets.

    Attributes:
        source: file or folder that it was read from.
        group: of people who play by the same rule.
        condition: as people call it.
        person: who played.
        times_s: (N,) times of the frames of play, game time.
        tool_m: (N, 3) the tool in the plane's frame: x right, y up, z along its normal away from
            the player.
        root_m: (N, 3) the point whose speed the game tests, in the same frame.
        controller: (N, 4) rotation of the controller that holds the tool, x y z w, app's world.
        head: (N, 7) pose of the head, app's world: m, x y z w.
        targets: what came up.
        contacts: touches that were too slow to count.
        ahead_m: of a session, (N, 3) the point 0.3 m ahead on the hand's ray; else None.
        other_m: of a session with two hands, (N, 3) the hand that moved less; else None.
    """

    source: Path
    group: str
    condition: str
    person: str
    times_s: FloatArray
    tool_m: FloatArray
    root_m: FloatArray
    controller: FloatArray
    head: FloatArray
    targets: Targets
    contacts: int
    ahead_m: FloatArray | None = None
    other_m: FloatArray | None = None


def round_of(recording: Recording, behaviour: Behaviour, person: str) -> PlayedRound | None:
    """Return a recorded round as it is measured; None of a condition that is not compared.

    Args:
        recording: As it was read.
        behaviour: Of the game.
        person: Who played, unless the recording says so itself.

    Raises:
        InputError: It is no round of this game, or something to be measured is missing in it.
    """
    known = behaviour.recognise(recording.condition)
    if known is None:
        return None
    source = file_name(recording.source)
    tool = recording.others.get(behaviour.tool)
    if tool is None:
        expected = f"columns {behaviour.tool}_pos_x ..., as in a log of {behaviour.game}"
        raise InputError(source, f"poses of {shown(sorted(recording.others))}", expected)
    if recording.plane is None:
        expected = f"the pose of the targets' plane, as in a log of {behaviour.game}"
        raise InputError(source, "none", expected)
    hand = recording.right if recording.left is None else recording.left
    root = np.array(behaviour.root_m)
    if recording.left is not None:  # held the other way round: mirrored
        root = root * (-1.0, 1.0, 1.0)
    at, turn = recording.plane[:3], recording.plane[3:] * (-1.0, -1.0, -1.0, 1.0)
    play = slice(1, None)  # frame 0 placed the target area
    return PlayedRound(
        source=recording.source,
        group=known[0],
        condition=known[1],
        person=recording.person or person,
        times_s=recording.times_s[play],
        tool_m=rotated(turn, tool[play, :3] - at),
        root_m=rotated(turn, hand[play, :3] + rotated(hand[play, 3:], root) - at),
        controller=hand[play, 3:],
        head=recording.head[play],
        targets=_targets(recording, behaviour),
        contacts=sum(event.kind == "contact" for event in recording.events),
    )


def rotated(turn: FloatArray, vectors: FloatArray) -> FloatArray:
    """Turn vectors (..., 3) by unit quaternions (..., 4), x y z w."""
    axis, real = turn[..., :3], turn[..., 3:]
    across = 2.0 * np.cross(axis, vectors)
    return np.asarray(vectors + real * across + np.cross(axis, across))


def _targets(recording: Recording, behaviour: Behaviour) -> Targets:
    known = dict(enumerate(behaviour.places_m)) | dict(recording.places_m)
    cells = {event.cell for event in recording.events}
    unknown = sorted(cells - known.keys())
    if unknown or not cells:
        got = f"cell {unknown[0]}" if unknown else "no target"
        expected = f"one of the {len(known)} of {behaviour.game}"
        if not cells:
            expected = f"targets that come up, as in a round of {behaviour.game}"
        raise InputError(file_name(recording.source), got, expected)
    return targets_of([event.session_event for event in recording.events], known)
