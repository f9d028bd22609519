"""Game outcomes of a tracked hand: the recorded round, replayed with the body's controller."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from sim2vr_harness.sessions import Controller, Session
from sim2vr_harness.sessions.logs import TargetEvent, target_events
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.whacamole import with_clock
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
    recording: Session, placement: Placement, followed: Followed
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
    found = {"person": outcome_of(target_events(recording))}
    for name, turned in (("tracked", False), ("tracked pose", True)):
        played = played_by_body(recording, placement, followed, turned=turned)
        done = replay_session(with_clock(played, closed_loop=False))
        found[name] = outcome_of(target_events(done.session))
    return found


def outcome_of(events: Iterable[TargetEvent]) -> TrackingOutcome:
    """Count what happened to the targets."""
    kinds = [event.kind for event in events]
    return TrackingOutcome(*(kinds.count(kind) for kind in ("spawn", "hit", "miss", "contact")))


def played_by_body(
    recording: Session, placement: Placement, followed: Followed, *, turned: bool
) -> Session:
    """Return the recording with the body's hand in the place of the person's.

    Frames before and after what was followed stay as they were.

    Args:
        recording: the round.
        placement: of its world in the body's.
        followed: what the body did.
        turned: whether rotations are the body's, too.
    """
    side: Literal["left", "right"] = "right" if recording.left is None else "left"
    hand = recording.controllers[side]
    times_s = recording.time_ns / 1e9
    clock = times_s - times_s[first_of_play(times_s)]
    inside = (clock >= followed.sampled_s[0]) & (clock <= followed.sampled_s[-1])
    now_s = clock[inside]
    poses = hand.grip.copy()
    positions, quats = followed.sampled[f"controller_{side}"]
    at = np.stack([np.interp(now_s, followed.sampled_s, p) for p in positions.T], axis=1)
    turns = Slerp(followed.sampled_s, Rotation.from_quat(quats[:, [1, 2, 3, 0]]))(now_s)
    body = placement.recorded(at, turns.as_quat()[:, [3, 0, 1, 2]])
    poses[inside, :3] = body[:, :3]
    if turned:
        poses[inside, 3:] = body[:, 3:]
    moved = Controller(poses)
    return replace(recording, left=moved) if side == "left" else replace(recording, right=moved)
