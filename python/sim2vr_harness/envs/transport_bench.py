"""``sim2vr-harness bench --transport``: how many frames per second an app answers, by transport.

The app alone is measured, and whole users with their bodies; no learner. The transports take turns,
several times, and the medians are reported, so that other programs slow them all alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

from sim2vr_harness.client import AppClient, DevicePoses, frame_time_ns
from sim2vr_harness.envs.apps import app_factory
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.simulation import Simulation

__all__ = ["TRANSPORTS", "transport_bench"]

Transport = Literal["in_process", "protocol1", "protocol2"]
TRANSPORTS: tuple[Transport, ...] = get_args(Transport)
ROUNDS = 5
_POSES = 64  # different ones, played in a circle


def transport_bench(
    config: EnvConfig,
    transports: Sequence[Transport] = TRANSPORTS,
    *,
    n: int = 1,
    seconds: float = 3.0,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> dict[str, Any]:
    """Measures exchanges (poses there; reward, log and image back) per second.

    Args:
        config: game, image size and renderer.
        transports: which of :data:`TRANSPORTS`.
        n: apps that are stepped side by side; over protocol 2 as many as share a server travel in
            one message. The rates count every app's exchange.
        seconds: per transport and kind of image.
        on_stage: told what is measured now.

    Returns:
        ``exchanges_per_s``: transport -> ``image`` (drawn by the configured renderer) and ``null``
        (no drawing); ``env_steps_per_s``: transport -> user steps; ``ratios`` of the exchanges over
        ``protocol2`` to those over the others, where they were measured; ``state_hash`` after each
        transport's first 100 exchanges, which must be equal.

    Raises:
        ValueError: a number that cannot be used.
        RuntimeError: an app cannot be started or failed, or the hashes differ.
    """
    if n < 1:
        raise ValueError(f"n: got {n}, expected at least 1")
    rates: dict[str, dict[str, float]] = {name: {} for name in transports}
    renderers: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for kind in ("image", "null"):
        with ExitStack() as stack:
            players = {}
            for name in transports:
                apps = _apps(_config(config, name, kind == "null"), n, stack)
                renderers.setdefault(kind, apps[0].renderer_description.partition(" (proto")[0])
                players[name] = _Player(apps, config.action_frequency_hz)
                hashes[name] = f"{players[name].warm_up():016x}"
            steps = {name: player.exchange for name, player in players.items()}
            for name, rate in _in_turns(steps, n, seconds, kind, on_stage).items():
                rates[name][kind] = rate
    if len(set(hashes.values())) > 1:
        raise RuntimeError(f"the transports played different rounds: state hashes {hashes}")
    return {
        "exchanges_per_s": rates,
        "env_steps_per_s": _env_rates(config, transports, n, seconds, on_stage),
        "ratios": _ratios(rates),
        "state_hash": next(iter(hashes.values())),
        "n": n,
        "image": [config.vision.width, config.vision.height],
        "renderer": renderers,
        "seconds_per_measurement": seconds,
    }


def _in_turns(
    steps: Mapping[Transport, Callable[[], None]],
    n: int,
    seconds: float,
    what: str,
    on_stage: Callable[[str], None],
) -> dict[Transport, float]:
    """Calls per second of each, times ``n``: medians over some turns."""
    found: dict[Transport, list[float]] = {name: [] for name in steps}
    for turn in range(ROUNDS):
        for name, step in steps.items():
            on_stage(f"{name}, {what} ({turn + 1} of {ROUNDS})")
            count, began = 0, time.perf_counter()
            while (elapsed := time.perf_counter() - began) < seconds / ROUNDS:
                step()
                count += 1
            found[name].append(count * n / elapsed)
    return {name: round(float(np.median(rates)), 1) for name, rates in found.items()}


def _env_rates(
    config: EnvConfig,
    transports: Sequence[Transport],
    n: int,
    seconds: float,
    on_stage: Callable[[str], None],
) -> dict[Transport, float]:
    """User steps per second of whole users, bodies included."""
    with ExitStack() as stack:
        steps = {}
        for name in transports:
            simulation = Simulation(_config(config, name, blind=False), n)
            stack.callback(simulation.close)
            simulation.reset(seeds=list(range(n)))
            steps[name] = partial(_user_step, simulation, np.random.default_rng(0))
        return _in_turns(steps, n, seconds, "users", on_stage)


def _user_step(simulation: Simulation, rng: np.random.Generator) -> None:
    shape = (simulation.n, *simulation.action_space.shape)
    outcome = simulation.step(rng.uniform(-1.0, 1.0, shape))
    ended = np.flatnonzero(outcome.terminated | outcome.truncated)
    if len(ended):
        simulation.reset(ids=ended.tolist())


def _config(config: EnvConfig, transport: Transport, blind: bool) -> EnvConfig:
    settings = config.app.model_dump(include={"game", "options", "renderer", "processes"})
    if blind:
        settings["renderer"] = "null"
    return config.model_copy(update={"app": AppConfig(**settings, transport=transport)})


def _apps(config: EnvConfig, n: int, stack: ExitStack) -> list[AppClient]:
    make = app_factory(config, n)
    apps = []
    for index in range(n):
        apps.append(make(config, index, None))
        stack.callback(apps[-1].close)
    return apps


class _Player:
    """Moves head and hand in ``n`` apps at once, round after round."""

    def __init__(self, apps: Sequence[AppClient], frequency_hz: int) -> None:
        self._apps = apps
        self._frequency_hz = frequency_hz
        self._frame = 0
        self._over = True
        turns = np.linspace(0.0, 2.0 * np.pi, _POSES, endpoint=False)
        self._poses = [_pose(float(turn)) for turn in turns]

    def warm_up(self) -> int:
        """A hundred exchanges; the state of the first app afterwards."""
        for _ in range(100):
            self.exchange()
        return self._apps[0].state_hash()

    def exchange(self) -> None:
        """A reset where a round is over, else a step, of every app."""
        poses = self._poses[self._frame % _POSES]
        if self._over:
            start = DevicePoses(poses.head[0], poses.right_controller[0])  # type: ignore[index]
            for seed, app in enumerate(self._apps):
                app.reset(seed, start)
            self._frame, self._over = 0, False
            return
        self._frame += 1
        times = np.array([frame_time_ns(self._frame, self._frequency_hz)], dtype=np.int64)
        for app in self._apps:
            app.start_step(times, poses)
        self._over = any([app.finish_step().finished for app in self._apps])


def _pose(turn: float) -> DevicePoses:
    """Head and right hand, (1, 7) each: the hand circles in front of the body."""
    head = [0.01 * np.sin(turn), 1.17, 0.0, 0.0, 0.0, 0.0, 1.0]
    hand = [0.15 + 0.1 * np.cos(turn), 1.07 + 0.1 * np.sin(turn), 0.35, 0.0, 0.0, 0.0, 1.0]
    return DevicePoses(np.array([head]), np.array([hand]))


def _ratios(rates: dict[str, dict[str, float]]) -> dict[str, float]:
    """Protocol 2 against the others, by kind of image."""
    return {
        f"protocol2_to_{other}_{kind}": round(rates["protocol2"][kind] / rates[other][kind], 3)
        for other in ("in_process", "protocol1")
        for kind in ("image", "null")
        if "protocol2" in rates and other in rates
    }
