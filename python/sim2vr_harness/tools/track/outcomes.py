"""Game outcomes of a tracked hand: the recorded round, replayed with the body's controller."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from sim2vr_harness.evaluation.replay.recordings import Event, Recording
from sim2vr_harness.evaluation.replay.replayer import replay
from sim2vr_harness.tools.track.paths import first_of_play
from sim2vr_harness.tools.track.registration import Placement
from sim2vr_harness.tools.track.tracking_controller import Followed

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrackingOutcome:
    """How a round of Whac-A-Mole went.

    Attributes:
        targets: that appeared.
        hits: of them.
        misses: that disappeared unhit.
        contacts: touches too slow for a hit.
    """

    targets: int
    hits: int
    misses: int
    contacts: int

    @property
    def hit_rate(self) -> float | None:
        """Of the targets that came and went."""
        over = self.hits + self.misses
        return self.hits / over if over else None


def outcomes(
    recording: Recording, placement: Placement, followed: Followed
) -> dict[str, TrackingOutcome]:
    """Return how the round went by who held the hammer.

    ``person``: as recorded. ``tracked``: the body's hand, turned as the person's was. ``tracked
    pose``: turned as the body's, which is not asked to turn as the person did.

    Targets appear as recorded: at the same times, in the same cells.

    Args:
        recording: the round.
        placement: of its world in the body's.
        followed: what the body did.
    """
    found = {"person": outcome_of(recording.events)}
    for name, turned in (("tracked", False), ("tracked pose", True)):
        played = replay(played_by_body(recording, placement, followed, turned=turned))
        found[name] = outcome_of(played.events)
    return found


def outcome_of(events: Iterable[Event]) -> TrackingOutcome:
    """Count what happened to the targets."""
    kinds = [event.kind for event in events]
    return TrackingOutcome(*(kinds.count(kind) for kind in ("spawn", "hit", "miss", "contact")))


def played_by_body(
    recording: Recording, placement: Placement, followed: Followed, *, turned: bool
) -> Recording:
    """Return the recording with the body's hand in the place of the person's.

    Frames before and after what was followed stay as they were.

    Args:
        recording: the round.
        placement: of its world in the body's.
        followed: what the body did.
        turned: whether rotations are the body's, too.
    """
    device = "controller_right" if recording.left is None else "controller_left"
    own = recording.right if recording.left is None else recording.left
    clock = recording.times_s - recording.times_s[first_of_play(recording.times_s)]
    inside = (clock >= followed.sampled_s[0]) & (clock <= followed.sampled_s[-1])
    times_s = clock[inside]
    poses = own.copy()
    positions, quats = followed.sampled[device]
    at = np.stack([np.interp(times_s, followed.sampled_s, p) for p in positions.T], axis=1)
    turns = Slerp(followed.sampled_s, Rotation.from_quat(quats[:, [1, 2, 3, 0]]))(times_s)
    body = placement.recorded(at, turns.as_quat()[:, [3, 0, 1, 2]])
    poses[inside, :3] = body[:, :3]
    if turned:
        poses[inside, 3:] = body[:, 3:]
    if recording.left is None:
        return replace(recording, right=poses)
    return replace(recording, left=poses)
