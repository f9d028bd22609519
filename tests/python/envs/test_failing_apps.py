"""Apps outside this process that die, hang or talk nonsense while users play in them."""

import os
import signal
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import (
    AppProcess,
    Channel,
    Protocol1App,
    start_sim2vr_app,
)
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation

N = 3
OPTIONS = {"condition": "medium", "round_seconds": 60.0}
TRANSPORTS = {
    "protocol 1": {"transport": "protocol1"},
    "protocol 2": {"transport": "protocol2", "processes": N},
}


def config(**settings: Any) -> EnvConfig:
    return EnvConfig(app=AppConfig(options=OPTIONS, renderer="null", **settings), cores=1)


def channel_of(app: Any) -> Channel:
    return app._channel if isinstance(app, Protocol1App) else app._connection.channel


def process_of(app: Any) -> AppProcess:
    process = channel_of(app).process
    assert process is not None
    return process


def actions(step: int) -> np.ndarray:
    return np.random.default_rng(step).uniform(-1.0, 1.0, (N, 32))


def undisturbed(steps: int) -> list[np.ndarray]:
    simulation = Simulation(config(), N)
    simulation.reset(seeds=[1, 2, 3])
    rewards = [simulation.step(actions(step)).reward for step in range(steps)]
    simulation.close()
    return rewards


@pytest.fixture(params=TRANSPORTS)
def simulation(request: pytest.FixtureRequest) -> Iterator[Simulation]:
    made = Simulation(config(**TRANSPORTS[request.param]), N)
    made.reset(seeds=[1, 2, 3])
    first = [process_of(app) for app in made.apps]
    yield made
    last = [process_of(app) for app in made.apps]
    made.close()
    assert not any(process.running for process in (*first, *last))


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_users_round_ends_and_the_others_go_on(
    simulation: Simulation, number: signal.Signals
) -> None:
    expected = undisturbed(8)
    for step in range(5):
        np.testing.assert_array_equal(simulation.step(actions(step)).reward, expected[step])
    before = simulation.observation()
    failed = process_of(simulation.apps[1])
    if number == signal.SIGSTOP:
        channel_of(simulation.apps[1]).timeout_s = 0.5
    os.kill(failed.pid, number)
    batch = simulation.step(actions(5))
    assert batch.truncated.tolist() == [False, True, False]
    assert batch.terminated.tolist() == [False] * N
    info = batch.infos[1]
    assert info["termination"] == "app_failed"
    assert str(failed.pid) in info["app_error"]
    assert info["game_reward"] == 0.0
    assert batch.reward[1] == -info["effort_cost"]
    after = simulation.observation()
    for key, rows in after.items():
        np.testing.assert_array_equal(rows[1], before[key][1])
    assert not failed.running
    assert [(failure.user, failure.step) for failure in simulation.app_failures] == [(1, 6)]
    # The next round of the user is played in another process; the others noticed nothing.
    simulation.reset(ids=[1])
    assert process_of(simulation.apps[1]).pid != failed.pid
    for step in range(6, 8):
        batch = simulation.step(actions(step))
        assert not batch.truncated.any()
        np.testing.assert_array_equal(batch.reward[[0, 2]], expected[step][[0, 2]])
    # The new app plays the same rounds as the old one.
    simulation.reset(seeds=[1, 2, 3])
    for step in range(3):
        np.testing.assert_array_equal(simulation.step(actions(step)).reward, expected[step])


def test_an_app_that_dies_between_rounds_or_while_it_is_saved(simulation: Simulation) -> None:
    os.kill(process_of(simulation.apps[0]).pid, signal.SIGKILL)
    simulation.reset(seeds=[1, 2, 3])
    assert len(simulation.app_failures) == 1
    simulation.step(actions(0))
    os.kill(process_of(simulation.apps[2]).pid, signal.SIGKILL)
    saved = simulation.state_dict()
    batch = simulation.step(actions(1))
    assert batch.infos[2]["termination"] == "app_failed"
    simulation.reset(ids=[2])
    other = Simulation(config(), N)
    assert other.load_state_dict(saved) == [2]  # its round could not be saved
    other.step(actions(1))
    other.close()


def test_users_of_one_server_fail_and_return_together() -> None:
    simulation = Simulation(config(transport="protocol2", processes=1), N)
    simulation.reset(seeds=[1, 2, 3])
    failed = process_of(simulation.apps[0])
    assert all(process_of(app) is failed for app in simulation.apps)
    os.kill(failed.pid, signal.SIGKILL)
    batch = simulation.step(actions(0))
    assert [info["termination"] for info in batch.infos] == ["app_failed"] * N
    simulation.reset(seeds=[1, 2, 3])
    assert len({process_of(app).pid for app in simulation.apps}) == 1
    for step, expected in enumerate(undisturbed(4)):
        np.testing.assert_array_equal(simulation.step(actions(step)).reward, expected)
    process = process_of(simulation.apps[0])
    simulation.close()
    assert not process.running


def test_apps_that_run_already() -> None:
    starting = start_sim2vr_app(app_executable(), ["--keep", "--renderer", "null"])
    with closing(starting.channel(20.0, 20.0)) as channel:
        address = channel.endpoint.removeprefix("tcp://")
    settings = config(transport="protocol2", connect=address)
    expected = Simulation(config(), N)
    expected.reset(seeds=[1, 2, 3], options=OPTIONS)
    wanted = [expected.step(actions(step)).reward for step in range(5)]
    expected.close()
    for _ in range(2):  # the server waits for the next client
        simulation = Simulation(settings, N)
        simulation.reset(seeds=[1, 2, 3], options=OPTIONS)
        for step in range(5):
            reward = simulation.step(actions(step)).reward
            np.testing.assert_array_equal(reward, wanted[step])
        simulation.close()
        assert starting.process.running
    # One that is gone cannot be started again from here.
    simulation = Simulation(settings, N)
    simulation.reset(seeds=[1, 2, 3])
    channel = channel_of(simulation.apps[0])
    starting.process.kill()
    batch = simulation.step(actions(0))
    assert [info["termination"] for info in batch.infos] == ["app_failed"] * N
    assert address in batch.infos[0]["app_error"]
    assert not channel.usable
    simulation.close()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"executable": "x"}, "transport: got 'in_process' together with executable"),
        ({"transport": "protocol1", "connect": "h:0"}, "connect: got 'h:0', expected HOST"),
        ({"transport": "protocol1", "connect": "h:1"}, "for 2 users.*serves one user"),
        ({"transport": "protocol2", "executable": "game.x86_64"}, "only sim2vr-app speaks"),
        ({"transport": "protocol1", "executable": "nosuch"}, "which is no file"),
    ],
)
def test_settings_that_do_not_go_together(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Simulation(config(**settings), 2)
