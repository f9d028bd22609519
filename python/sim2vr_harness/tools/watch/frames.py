"""Frames to watch: of a user, a recording or a person."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import (
    AppClient,
    AppScene,
    DevicePoses,
    GameFacts,
    InProcessApp,
    frame_time_ns,
)
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.play.environment import make_simulation
from sim2vr_harness.play.player import Job, Player
from sim2vr_harness.play.users import SimulatedUser
from sim2vr_harness.policies.protocol import Act, Policy
from sim2vr_harness.users import Body

HEADSET_SIZE = (240, 160)
"""Of the headset's picture, pixels."""


@dataclass(frozen=True)
class ViewerFrame:
    """Content of one frame of the viewer.

    Attributes:
        time_s: since the round began.
        scene: of the app.
        headset: (H, W, 3) uint8.
        text: the game's present numbers, as text.
        events: events since the frame before, one line each.
        qpos: (nq,) of the user's body; None: the body is unknown.
        activations: (M,) of its muscles.
        bars: name -> 0 to 1.
        numbers: name -> value, to be plotted: reward, effort, the game's log.
    """

    time_s: float
    scene: AppScene
    headset: NDArray[np.uint8]
    text: str
    events: tuple[str, ...] = ()
    qpos: NDArray[np.float64] | None = None
    activations: NDArray[np.float64] | None = None
    bars: Mapping[str, float] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass
class Playlist:
    """A source of frames, made when they are requested.

    Attributes:
        title: name that is shown.
        frequency_hz: frames per second.
        moments: yields frames until the round is over; closes what it opened.
        body: of the user; None: only the player's objects in the app are known.
        hands: poses of a person's head and hands; None: no person can take part.
    """

    title: str
    frequency_hz: float
    moments: Callable[[], Iterator[ViewerFrame]]
    body: Body | None = None
    hands: Hands | None = None


@dataclass
class Hands:
    """A person's head and hands, app frame; a viewer moves them.

    Attributes:
        poses: device -> (7,) position x y z (m), rotation x y z w.
    """

    poses: dict[str, NDArray[np.float64]]

    def devices(self) -> DevicePoses:
        """Return them as device poses for an app."""
        return DevicePoses(
            self.poses["head"],
            self.poses.get("right_controller"),
            self.poses.get("left_controller"),
        )


class Counters:
    """Text for the game's numbers, and for changes in them."""

    def __init__(self, facts: GameFacts) -> None:
        self._facts = facts
        self._before: dict[str, float] = {}

    def told(self, log: Mapping[str, float], time_s: float) -> tuple[str, tuple[str, ...]]:
        """Return the numbers in a line, and a line for each that went up."""
        parts, events = [], []
        for measure in self._facts.with_log(log).counters:
            value = log.get(measure.log_key)
            if value is None:
                continue
            label = measure.label.partition(" (")[0]
            parts.append(f"{label} {value:.4g}")
            before = self._before.get(measure.log_key, 0.0)
            if value == round(value) and value > before:
                events.append(f"{time_s:5.2f} s  {label} {value:.0f}")
            self._before[measure.log_key] = value
        return "   ".join(parts), tuple(events)


def look(app: AppClient) -> tuple[AppScene, NDArray[np.uint8]]:
    """Return an app's scene, empty if the app does not report it, and its headset image."""
    scene = app.scene() if "scene" in app.capabilities else AppScene((), ())
    if "views" in app.capabilities:
        return scene, np.ascontiguousarray(app.render_headset(*HEADSET_SIZE)[..., :3])
    image = (app.image if app.image.ndim == 3 else app.image[0])[..., :3]
    larger = max(1, HEADSET_SIZE[0] // image.shape[1])
    return scene, np.ascontiguousarray(image.repeat(larger, axis=0).repeat(larger, axis=1))


def user_show(
    user: SimulatedUser | None,
    env: ResolvedEnv,
    *,
    seed: int = 1,
    deterministic: bool | None = None,
    person: int | None = None,
    simulation: Callable[..., Any] = make_simulation,
) -> Playlist:
    """Return a round of a user.

    Args:
        user: the player; None: the body of ``env`` with small random actions.
        env: the environment.
        seed: of body, policy and game.
        deterministic: True: actions are the policy's mean; None: as in the user's configuration.
        person: number of the virtual participant who plays; None: as the environment says.
        simulation: makes the user: (ResolvedEnv, n) -> simulation.
    """
    facts, config = env.facts, env.config
    mean = deterministic
    if mean is None:
        mean = user is not None and user.config.evaluation.deterministic
    # The body of a running simulation, drawn shapes included.
    waiting = [simulation(env, 1)]

    def moments() -> Iterator[ViewerFrame]:
        with closing(waiting.pop() if waiting else simulation(env, 1)) as users:
            size = users.action_space.shape[0]

            def gently(_: Any, rng: np.random.Generator | None) -> Any:
                drawn = (rng or np.random.default_rng()).standard_normal(size)
                return 0.2 * drawn.clip(-1.0, 1.0)

            policy: Policy | Act = gently
            if user is not None:
                policy, _ = user.policy(users, facts)
            player = Player(users, policy, facts, deterministic=mean and user is not None)
            player.begin([Job("", 0, seed, person=person)])
            counters, most = Counters(facts), 1e-9
            for outcome in player.steps():
                info = outcome.infos[0]
                if info.get("termination") == "app_failed":
                    return
                most = max(most, info["effort_cost"])
                yield _frame(player, outcome.reward[0], info, counters, most)

    condition = facts.condition_of(config.app.options)
    name = "no particular person" if user is None else user.name
    body: Body = waiting[0].body
    return Playlist(f"{name}: {facts.name} {condition}", config.action_frequency_hz, moments, body)


def _frame(
    player: Player, reward: float, info: Mapping[str, Any], counters: Counters, most: float
) -> ViewerFrame:
    """Return the frame of a player's one user after a step.

    Args:
        player: after the step.
        reward: of the step.
        info: of the step.
        counters: of the game.
        most: largest effort of a step so far.
    """
    users, log = player.simulation.users, info.get("log", {})
    text, events = counters.told(log, player.seconds)
    scene, headset = look(player.simulation.apps[0])
    act_now = np.array(users.act[0])
    bars = {
        "Effort of this step, of the greatest so far": info["effort_cost"] / most,
        "Mean activation of the muscles": float(act_now.mean()) if act_now.size else 0.0,
    }
    fatigued = float(users.effort.max_fatigued()[0])
    if np.isfinite(fatigued):
        bars["Fatigued motor units"] = fatigued
    return ViewerFrame(
        player.seconds,
        scene,
        headset,
        f"{text}   return {player.returns[0]:.1f}",
        events,
        np.array(users.qpos[0]),
        act_now,
        bars,
        {"reward": float(reward), "effort": info["effort_cost"], **log},
    )


def person_show(env: ResolvedEnv, *, seed: int = 1) -> Playlist:
    """Return a round that a person plays with head and hands that a viewer moves.

    Args:
        env: the game and its options.
        seed: of the game.
    """
    facts, config = env.facts, env.config
    level = [0.0, 0.0, 0.0, 1.0]
    poses = {"head": np.array([0.0, 1.17, 0.12, *level])}
    for device, place in (
        ("right_controller", [0.2, 0.95, 0.3]),
        ("left_controller", [-0.2, 0.95, 0.3]),
    ):
        if f"controller_{device.partition('_')[0]}" in facts.needs("right"):
            poses[device] = np.array([*place, *level])
    hands = Hands(poses)
    rate = config.action_frequency_hz

    def moments() -> Iterator[ViewerFrame]:
        counters = Counters(facts)
        times = ((frame_time_ns(frame, rate), hands.devices()) for frame in count())
        with InProcessApp(config.app.game, config.app.options) as app:
            for frame, reply in enumerate(app.play(seed, times)):
                if frame == 0:
                    continue
                text, events = counters.told(reply.log, frame / rate)
                scene, headset = look(app)
                yield ViewerFrame(
                    frame / rate, scene, headset, text, events, numbers=dict(reply.log)
                )

    condition = facts.condition_of(config.app.options)
    return Playlist(f"You play {facts.name} {condition}".strip(), rate, moments, hands=hands)
