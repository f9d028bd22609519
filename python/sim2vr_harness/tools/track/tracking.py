"""Tracking of a recording: from the file to errors and muscle loads."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.sessions import Controller, Session
from sim2vr_harness.sessions.logs import TargetEvent, target_events
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.whacamole import is_recorded_round, with_clock
from sim2vr_harness.tools.track.paths import RecordedPath, first_of_play
from sim2vr_harness.tools.track.postures import REACHED_M, beyond_reach_m
from sim2vr_harness.tools.track.registration import (
    Placement,
    estimated_stature_m,
    head_height_m,
    place,
)
from sim2vr_harness.tools.track.tracking_controller import Followed, follow, wanted_of
from sim2vr_harness.users import Body, UserBatch

FloatArray = NDArray[np.float64]
_PERCENT = 0.95


@dataclass(frozen=True)
class TrackingSettings:
    """Settings for tracking a recording.

    Attributes:
        refined: True: trajectory optimisation of the muscles follows, for the path and low effort.
        yaw: degrees to the right of the recorded forward that the person faces, or ``head``.
        scale: of distances from the person's head.
        offset_m: further shift of the recording in the body's world: forward, left, up.
        stature_m: of the person; None: estimated from the recording.
        mass_kg: of the person; None: computed from the stature.
        pointed: True: the hands' directions are tracked, too.
        seed: of all random numbers.
        play: True: the recorded game is played by the body's hand.
    """

    refined: bool = True
    yaw: float | Literal["head"] = 0.0
    scale: float = 1.0
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stature_m: float | None = None
    mass_kg: float | None = None
    pointed: bool = False
    seed: int = 1
    play: bool = True


@dataclass(frozen=True)
class TrackingOutcome:
    """Outcome of a round of Whac-A-Mole.

    Attributes:
        targets: number of targets that appeared.
        hits: number of targets that were hit.
        misses: number of targets that disappeared without a hit.
        contacts: number of touches that were too slow for a hit.
    """

    targets: int
    hits: int
    misses: int
    contacts: int

    @property
    def hit_rate(self) -> float | None:
        """Hit rate over the targets that were hit or disappeared."""
        over = self.hits + self.misses
        return self.hits / over if over else None


@dataclass(frozen=True)
class HandError:
    """Tracking error of a hand, at the ends of the user steps.

    Attributes:
        hand: the device.
        median_m: over all steps.
        most_m: 95th percentile over all steps.
        unreachable: proportion of the steps whose place lies beyond the joints' limits by more than
            ``REACHED_M``.
        reachable_median_m: over the other steps; None if there are none.
        reachable_most_m: 95th percentile over these.
        layer_median_m: of the motor layer alone, all steps and hands.
        layer_most_m: the same, 95th percentile.
    """

    hand: str
    median_m: float
    most_m: float
    unreachable: float
    reachable_median_m: float | None
    reachable_most_m: float | None
    layer_median_m: float
    layer_most_m: float


@dataclass(frozen=True)
class MuscleLoad:
    """Load of a muscle.

    Attributes:
        muscle: its name.
        mean: mean activation.
        most: 95th percentile of the activation.
        fatigued: proportion of its motor units that are fatigued at the end (3CC-r); None: unknown.
    """

    muscle: str
    mean: float
    most: float
    fatigued: float | None


@dataclass(frozen=True)
class Tracked:
    """A recording that a body has tracked.

    Attributes:
        path: the recording.
        body: the tracking body.
        stature_m: stature that the body was scaled to; None: its own.
        estimated: True if that is an estimate.
        placement: of the recorded world in the body's.
        followed: motion of the body.
        beyond_m: (K, H) distance of the reference places beyond reach; 0 for hands that rest.
        hands: their tracking errors.
        muscles: their loads, the most loaded first.
        outcomes: of the game, by player; empty if none was recorded.
        settings: of the tracking.
    """

    path: RecordedPath
    body: Body
    stature_m: float | None
    estimated: bool
    placement: Placement
    followed: Followed
    beyond_m: FloatArray
    hands: tuple[HandError, ...]
    muscles: tuple[MuscleLoad, ...]
    outcomes: dict[str, TrackingOutcome]
    settings: TrackingSettings

    @property
    def fatigued(self) -> float | None:
        """Mean share of fatigued motor units at the end."""
        known = self.followed.fatigued
        return None if known is None or known.shape[1] == 0 else float(known[-1].mean())

    def summary(self) -> dict[str, Any]:
        """Everything that is a number or a word, for ``summary.json``."""
        followed, path = self.followed, self.path
        return {
            "name": path.name,
            "source": str(path.source),
            "body": self.body.name,
            "stature_m": self.stature_m,
            "stature_estimated": self.estimated,
            "head_height_m": head_height_m(path),
            "duration_s": path.duration_s,
            "steps": len(followed.values),
            "scale": self.placement.scale,
            "turned_left_deg": float(np.degrees(self.placement.left_rad)),
            "notes": list(self.placement.notes),
            "passes": [asdict(one) for one in followed.passes],
            "hands": [asdict(one) for one in self.hands],
            "effort": float(followed.effort.sum()),
            "effort_per_s": float(followed.effort.sum() / path.duration_s),
            "fatigued": self.fatigued,
            "muscles": [asdict(one) for one in self.muscles],
            "game": {
                name: asdict(one) | {"hit_rate": one.hit_rate}
                for name, one in self.outcomes.items()
            },
            "settings": asdict(self.settings),
        }


def track(
    path: RecordedPath,
    env: ResolvedEnv,
    layer_for: Callable[[Body, float], MotorPolicy],
    settings: TrackingSettings,
    *,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Tracked:
    """Track a recording with a body, without motor noise.

    Args:
        env: the user's: body, person, effort.
        layer_for: motor layer of a body, for user steps of this many seconds.

    Raises:
        InputError: no motor layer fits the body, or it has none of the recorded hands.
    """
    own = env.config.user.person.stature_m
    stature, cut_estimated = settings.stature_m, False
    if stature is None and own is None:
        stature = estimated_stature_m(path)
        cut_estimated = stature is not None
    changes = {"stature_m": stature, "mass_kg": settings.mass_kg}
    cut_known = {key: value for key, value in changes.items() if value is not None}
    if not cut_known:
        stature_m, estimated = own, False
    else:
        user = env.config.user
        person = user.person.model_validate({**user.person.model_dump(), **cut_known})
        env = env.changed(user=user.model_copy(update={"person": person}))
        stature_m, estimated = person.stature_m, cut_estimated
    try:
        body = env.body
    except ValueError as error:
        expected = "a body that can be cut to size"
        raise InputError("--stature, --mass", str(error), expected) from error
    step_s = 1.0 / env.config.action_frequency_hz
    layer = layer_for(body, step_s)
    bodies = partial(_bodies, env, step_s)
    users = bodies(1)
    placement = place(
        path,
        users.device_poses("headset")[0][0],
        yaw=settings.yaw,
        scale=settings.scale,
        offset_m=np.array(settings.offset_m),
    )
    followed = follow(
        users,
        layer,
        wanted_of(path, placement, layer.hands, step_s, pointed=settings.pointed),
        many=bodies if settings.refined else None,
        seed=settings.seed,
        on_progress=on_progress,
    )
    # (K, H) how far the wanted places are beyond reach, m; 0 of hands that rest.
    beyond, wanted = np.zeros(followed.errors_m.shape), followed.wanted
    for hand in np.flatnonzero(wanted.followed):
        targets = followed.targets[:, hand]
        beyond[:, hand] = beyond_reach_m(
            body, wanted.hands[hand], targets, followed.angles, settings.seed
        )
    known = path.session is not None and is_recorded_round(path.session)
    game = path.session if settings.play and known else None
    return Tracked(
        *(path, body, stature_m, estimated, placement, followed, beyond),
        *(_hands(followed, beyond), _muscles(body, followed)),
        outcomes=outcomes(game, placement, followed) if game is not None and game.events else {},
        settings=settings,
    )


def _bodies(env: ResolvedEnv, step_s: float, n: int) -> UserBatch:
    """Return n of a body, without motor noise."""
    return UserBatch(
        env.body,
        n,
        threads=1 if n == 1 else budget(env.config.cores),
        effort=env.config.user.effort.model,
        effort_params=env.config.user.effort.options(),
        substeps=round(step_s / env.body.timestep),
    )


def _hands(followed: Followed, beyond_m: FloatArray) -> tuple[HandError, ...]:
    found = []
    alone = followed.passes[0]
    for hand in np.flatnonzero(followed.wanted.followed):
        errors, beyond = followed.errors_m[:, hand], beyond_m[:, hand] > REACHED_M
        near = errors[~beyond]
        found.append(
            HandError(
                followed.wanted.hands[hand],
                float(np.median(errors)),
                float(np.quantile(errors, _PERCENT)),
                float(beyond.mean()),
                float(np.median(near)) if len(near) else None,
                float(np.quantile(near, _PERCENT)) if len(near) else None,
                alone.median_m,
                alone.most_m,
            )
        )
    return tuple(found)


def _muscles(body: Body, followed: Followed) -> tuple[MuscleLoad, ...]:
    found = []
    for i, name in enumerate(body.muscles):
        active = followed.activations[:, i]
        tired = None if followed.fatigued is None else float(followed.fatigued[-1, i])
        found.append(
            MuscleLoad(name, float(active.mean()), float(np.quantile(active, _PERCENT)), tired)
        )
    return tuple(sorted(found, key=lambda load: -load.mean))


# --- the game, played by the body's hand ----------------------------------------------------------


def outcomes(
    recording: Session, placement: Placement, followed: Followed
) -> dict[str, TrackingOutcome]:
    """Return the outcomes of the round, by the pose of the hammer.

    ``person``: as recorded. ``tracked``: the body's hand, with the person's rotation. ``tracked
    pose``: with the body's own rotation, which is not required to follow the person's.

    Targets appear as recorded: at the same times, in the same cells.

    Args:
        placement: of its world in the body's.
    """
    found = {"person": outcome_of(target_events(recording))}
    for name, turned in (("tracked", False), ("tracked pose", True)):
        played = played_by_body(recording, placement, followed, turned=turned)
        done = replay_session(with_clock(played, closed_loop=False))
        found[name] = outcome_of(target_events(done.session))
    return found


def outcome_of(events: Iterable[TargetEvent]) -> TrackingOutcome:
    """Count the outcomes of the targets."""
    kinds = [event.kind for event in events]
    return TrackingOutcome(*(kinds.count(kind) for kind in ("spawn", "hit", "miss", "contact")))


def played_by_body(
    recording: Session, placement: Placement, followed: Followed, *, turned: bool
) -> Session:
    """Return the recording with the body's hand instead of the person's.

    Frames before and after the tracked period are not changed.

    Args:
        placement: of its world in the body's.
        turned: True: rotations are the body's, too.
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
