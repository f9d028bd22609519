"""One round, three ways to the app: the same bits, whatever the transport and the threads."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import players
import pytest
import transports
from transports import ALONE

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import (
    AppClient,
    DevicePoses,
    InProcessApp,
    frame_time_ns,
    start_sim2vr_app,
)
from sim2vr_harness.client.protocol2 import Protocol2Connection
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation

Player = Callable[[int], DevicePoses]
PLAYERS = {"scripted": players.whacker, "random": players.flailing}
REMOTE = [case for case in transports.cases() if case[0] != ALONE]
FRAMES = 60


def trace(app: AppClient, player: Player, seed: int, frames: int = FRAMES) -> list[Any]:
    """(reply, image bytes, state hash) of each frame; the round's end may come before the last."""
    rows = []
    for frame in range(frames):
        if frame == 0:
            reply = app.reset(seed, player(0))
        else:
            reply = app.step(frame_time_ns(frame, 20), player(frame))
        rows.append((reply, app.image.tobytes(), app.state_hash()))
        if reply.finished:
            break
    return rows


def as_told(transport: str, rows: list[Any]) -> list[Any]:
    """What a transport passes on of a trace: protocol 1 has no words for vibrations and sounds."""
    if transport != "protocol1":
        return rows
    return [(replace(reply, haptics=(), sounds=()), *rest) for reply, *rest in rows]


def logs(folder: Path) -> dict[str, bytes]:
    """Every log file's content by its path from the round's folder on."""
    return {"/".join(file.parts[-2:]): file.read_bytes() for file in sorted(folder.rglob("*.csv"))}


@pytest.mark.parametrize("player", PLAYERS)
@pytest.mark.parametrize(("transport", "game"), [*REMOTE, ("protocol2", "whacamole")])
def test_a_round_is_the_same_to_the_bit(
    transport: str, game: str, player: str, tmp_path: Path
) -> None:
    rounds = {}
    for name in (ALONE, transport):
        with transports.TRANSPORTS[name](game, log_dir=tmp_path / name) as app:
            rounds[name] = trace(app, PLAYERS[player], 7) + trace(app, PLAYERS[player], 8)
    assert rounds[transport] == as_told(transport, rounds[ALONE])
    own, other = logs(tmp_path / transport), logs(tmp_path / ALONE)
    assert own == other
    if game == "whacamole":
        assert sum(name.endswith("events.csv") for name in own) == 2
        assert all(own.values())
        if player == "scripted":
            assert any(reply.reward > 5.0 for reply, _, _ in rounds[transport]), "no hit"


@contextmanager
def two_apps(kind: str, game: str) -> Iterator[list[AppClient]]:
    """Two apps of a game; ``kind`` says where they run."""
    with ExitStack() as stack:
        if kind.startswith("one server"):
            threads = kind.split()[2]
            starting = start_sim2vr_app(app_executable(), ["--threads", threads])
            connection = Protocol2Connection(starting.channel(60.0, 60.0), apps=2, game=game)
            yield [stack.enter_context(connection.app(i)) for i in range(2)]
        else:
            make = transports.TRANSPORTS[kind]
            yield [stack.enter_context(make(game)) for _ in range(2)]


@pytest.mark.parametrize(("kind", "game"), transports.cases())
def test_two_apps_on_two_threads_are_as_one_alone(kind: str, game: str) -> None:
    with InProcessApp(game) as app:
        expected = [as_told(kind, trace(app, players.flailing, seed)) for seed in (3, 4)]
    with two_apps(kind, game) as apps, ThreadPoolExecutor(2) as pool:
        jobs = [
            pool.submit(trace, app, players.flailing, seed)
            for app, seed in zip(apps, (3, 4), strict=True)
        ]
        assert [job.result() for job in jobs] == expected


@pytest.mark.parametrize("game", transports.TWO_GAMES)
@pytest.mark.parametrize("kind", ["one server 1 thread", "one server 2 threads"])
def test_two_apps_in_one_message_are_as_one_alone(kind: str, game: str) -> None:
    with InProcessApp(game) as app:
        expected = [trace(app, players.flailing, seed) for seed in (3, 4)]
    with two_apps(kind, game) as apps:
        found: list[list[Any]] = [[], []]
        for frame in range(FRAMES):
            poses = players.flailing(frame)
            if frame == 0:
                replies = [app.reset(seed, poses) for app, seed in zip(apps, (3, 4), strict=True)]
            else:
                playing = [app for app in apps if not replies[apps.index(app)].finished]
                for app in playing:
                    app.start_step(np.array([frame_time_ns(frame, 20)]), one_frame(poses))
                for app in reversed(playing):
                    replies[apps.index(app)] = app.finish_step()
            for rows, app, reply in zip(found, apps, replies, strict=True):
                if not (rows and rows[-1][0].finished):
                    rows.append((reply, app.image.tobytes(), app.state_hash()))
    assert found == expected


def one_frame(poses: DevicePoses) -> DevicePoses:
    return frames_of([poses])


def frames_of(moments: list[DevicePoses]) -> DevicePoses:
    """The devices of several moments as those of one step."""
    rows = {
        name: None if first is None else np.stack([getattr(poses, name) for poses in moments])
        for name, first in vars(moments[0]).items()
    }
    return DevicePoses(**rows)


@pytest.mark.parametrize("transport", transports.REMOTE)
def test_the_frames_of_a_step(transport: str) -> None:
    def play(app: AppClient) -> list[Any]:
        rows = [(app.reset(5, players.flailing(0)), app.image.tobytes(), app.state_hash())]
        for step in range(20):
            numbers = [5 * step + k for k in range(1, 6)]
            poses = frames_of([players.flailing(number) for number in numbers])
            times = np.array([frame_time_ns(number, 100) for number in numbers])
            rows.append((app.step_frames(times, poses), app.image.tobytes(), app.state_hash()))
        return rows

    with InProcessApp("whacamole") as app:
        expected = play(app)
    with transports.TRANSPORTS[transport]("whacamole") as app:
        assert play(app) == expected


@pytest.mark.parametrize("transport", transports.REMOTE)
def test_states_and_views_cross_transports(transport: str) -> None:
    with InProcessApp("whacamole") as near, transports.TRANSPORTS[transport]("whacamole") as far:
        trace(near, players.whacker, 9)
        saved = near.save()
        far.load(saved)
        assert far.save() == saved
        assert far.state_hash() == near.state_hash()
        np.testing.assert_array_equal(far.image, near.image)
        np.testing.assert_array_equal(
            far.render_third_person(90, 60, "recorder"),
            near.render_third_person(90, 60, "recorder"),
        )
        poses = players.whacker(FRAMES)
        time_ns = frame_time_ns(FRAMES, 20)
        assert far.step(time_ns, poses) == near.step(time_ns, poses)
        assert far.state_hash() == near.state_hash()


@pytest.mark.parametrize("transport", transports.REMOTE)
def test_a_round_on_an_absolute_clock(transport: str) -> None:
    start = frame_time_ns(2400, 20)
    with InProcessApp("whacamole") as near, transports.TRANSPORTS[transport]("whacamole") as far:
        for app in (near, far):
            app.reset(9, players.whacker(0), time_ns=start)
        for frame in range(1, 30):
            time_ns = frame_time_ns(2400 + frame, 20)
            one, other = (app.step(time_ns, players.whacker(frame)) for app in (near, far))
            assert one == other
        assert near.state_hash() == far.state_hash()


def episode(config: EnvConfig, n: int) -> list[bytes]:
    """Rewards, ends and observations of N users who move at random."""
    rows = []
    simulation = Simulation(config, n)
    simulation.reset(seeds=list(range(n)))
    rng = np.random.default_rng(0)
    for _ in range(25):
        batch = simulation.step(rng.uniform(-1.0, 1.0, (n, 32)))
        observation = simulation.observation()
        rows += [batch.reward.tobytes(), batch.terminated.tobytes(), batch.truncated.tobytes()]
        rows += [value.tobytes() for value in observation.values()]
        over = np.flatnonzero(batch.terminated | batch.truncated)
        if len(over):
            simulation.reset(ids=over.tolist())
    rows.append(simulation.state_dict()["simulation"].tobytes())
    simulation.close()
    return rows


@pytest.mark.parametrize(
    "settings",
    [
        {"transport": "protocol1"},
        {"transport": "protocol2", "processes": 1},
        {"transport": "protocol2", "processes": 2},
    ],
    ids=["protocol 1", "protocol 2, one server", "protocol 2, two servers"],
)
def test_users_do_not_notice_the_transport(settings: dict[str, Any]) -> None:
    app = {"options": {"condition": "medium", "round_seconds": 0.8}}
    expected = episode(EnvConfig(app=AppConfig(**app), frames_per_step=5), 3)
    found = episode(EnvConfig(app=AppConfig(**app, **settings), frames_per_step=5), 3)
    assert found == expected
