"""One round, three ways to the app: the same bits, whatever the transport and the threads."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import players
import pytest
import transports
from players import trace
from transports import ALONE

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import DevicePoses, InProcessApp, frame_time_ns, start_sim2vr_app
from sim2vr_harness.client.protocol2 import Protocol2Connection
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation

REMOTE = [case for case in transports.cases() if case[0] != ALONE]


def as_told(transport: str, rows: list[Any]) -> list[Any]:
    """What a transport passes on of a trace: protocol 1 has no words for vibrations and sounds."""
    if transport != "protocol1":
        return rows
    return [(replace(reply, haptics=(), sounds=()), *rest) for reply, *rest in rows]


def logs(folder: Path) -> dict[str, bytes]:
    """Every log file's content by its path from the round's folder on."""
    return {"/".join(file.parts[-2:]): file.read_bytes() for file in sorted(folder.rglob("*.csv"))}


@pytest.mark.parametrize(("transport", "game"), [*REMOTE, ("protocol2", "whacamole")])
def test_a_round_is_the_same_to_the_bit(transport: str, game: str, tmp_path: Path) -> None:
    player = players.whacker if game == "whacamole" else players.flailing
    rounds = {}
    for name in (ALONE, transport):
        with transports.TRANSPORTS[name](game, log_dir=tmp_path / name) as app:
            rounds[name] = [trace(app, player, seed=seed) for seed in (7, 8)]
    assert rounds[transport] == [as_told(transport, rows) for rows in rounds[ALONE]]
    own = logs(tmp_path / transport)
    assert own == logs(tmp_path / ALONE)
    if game == "whacamole":
        assert sum(name.endswith("events.csv") for name in own) == 2
        assert all(own.values())
        assert any(reply.reward > 5.0 for reply, _, _ in rounds[transport][0]), "no hit"


@pytest.mark.parametrize("kind", transports.TRANSPORTS)
def test_two_apps_on_two_threads_are_as_one_alone(kind: str) -> None:
    with InProcessApp("sample") as app:
        expected = [as_told(kind, trace(app, players.flailing, seed=seed)) for seed in (3, 4)]
    make = transports.TRANSPORTS[kind]
    with make("sample") as one, make("sample") as two, ThreadPoolExecutor(2) as pool:
        jobs = [
            pool.submit(trace, app, players.flailing, seed=seed)
            for app, seed in ((one, 3), (two, 4))
        ]
        assert [job.result() for job in jobs] == expected


def test_two_apps_in_one_message_are_as_one_alone() -> None:
    with InProcessApp("sample") as app:
        expected = [trace(app, players.flailing, seed=seed) for seed in (3, 4)]
    starting = start_sim2vr_app(app_executable(), ["--threads", "2"])
    connection = Protocol2Connection(starting.channel(60.0, 60.0), apps=2, game="sample")
    with connection.app(0) as one, connection.app(1) as two:
        found: list[list[Any]] = [[], []]
        for frame in range(40):
            poses = players.flailing(frame)
            if frame == 0:
                replies = [one.reset(3, poses), two.reset(4, poses)]
            else:
                for app in (one, two):
                    app.start_step(np.array([frame_time_ns(frame, 20)]), DevicePoses.stack([poses]))
                replies = [app.finish_step() for app in (two, one)][::-1]
            for rows, app, reply in zip(found, (one, two), replies, strict=True):
                rows.append((reply, app.image.tobytes(), app.state_hash()))
    assert found == expected


@pytest.mark.parametrize("transport", transports.REMOTE)
def test_frames_clocks_states_and_views_cross_transports(transport: str) -> None:
    """Five frames a step, on an absolute clock; then a saved state in the other app."""
    start = 12_000
    with InProcessApp("whacamole") as near, transports.TRANSPORTS[transport]("whacamole") as far:
        for app in (near, far):
            app.reset(5, players.whacker(0), time_ns=frame_time_ns(start, 100))
        for step in range(20):
            numbers = [5 * step + k for k in range(1, 6)]
            poses = DevicePoses.stack([players.whacker(number) for number in numbers])
            times = np.array([frame_time_ns(start + number, 100) for number in numbers])
            one, other = (app.step_frames(times, poses) for app in (near, far))
            assert one == other
            np.testing.assert_array_equal(far.image, near.image)
        saved = near.save()
        far.reset(6, players.whacker(0))
        far.load(saved)
        assert far.save() == saved
        assert far.state_hash() == near.state_hash()
        np.testing.assert_array_equal(
            far.render_third_person(90, 60, "recorder"),
            near.render_third_person(90, 60, "recorder"),
        )
        time_ns = frame_time_ns(start + 101, 100)
        one, other = (app.step(time_ns, players.whacker(101)) for app in (near, far))
        assert one == other
        assert far.state_hash() == near.state_hash()


def episode(config: EnvConfig, n: int) -> list[bytes]:
    """Rewards, ends and observations of N users who move at random."""
    rows = []
    simulation = Simulation(config, n)
    simulation.reset(seeds=list(range(n)))
    rng = np.random.default_rng(0)
    for _ in range(18):
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
