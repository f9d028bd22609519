"""Transports are rows of one table: what a configuration may say goes by it."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import (
    AppClient,
    AppsWanted,
    AppUnsupported,
    InProcessApp,
    Transport,
    describe_game,
    register_transport,
    start_sim2vr_app,
    transports,
)
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from sim2vr_harness.envs.apps import app_factory
from sim2vr_harness.envs.resolved import ResolvedEnv


def loopback(wanted: AppsWanted) -> object:
    """Apps in this process, one by one, as a stranger's transport may have them."""

    def app(index: int, log_dir: Path | None) -> AppClient:
        assert 0 <= index < wanted.n
        radius = wanted.place.options["radius_m"]
        return InProcessApp(
            wanted.game,
            {**wanted.options, "ball_radius_m": radius},
            width=wanted.width,
            height=wanted.height,
            renderer=wanted.renderer,
        )

    return app


@pytest.fixture
def from_outside(monkeypatch: pytest.MonkeyPatch) -> Iterator[Transport]:
    monkeypatch.setattr(transports, "_TABLE", dict(transports._TABLE))
    transport = Transport(
        name="loopback",
        summary="for this test",
        apps=loopback,  # type: ignore[arg-type]
        reads=frozenset({"connect"}),
        options={"radius_m": "of the ball, metres"},
    )
    register_transport(transport)
    yield transport


def test_a_transport_from_outside_is_used_from_a_configuration(from_outside: Transport) -> None:
    app = AppConfig(
        game="sample",
        transport="loopback",
        transport_options={"radius_m": 0.1},
        renderer="null",
        options={},
    )
    simulation = Simulation(EnvConfig(app=app, vision=VisionConfig(width=12, height=8)), 2)
    simulation.reset(seeds=[1, 2])
    batch = simulation.step(np.zeros((2, simulation.action_space.shape[0])))
    assert batch.answered.all()
    assert all("Points" in batch.logs[i] for i in range(2))
    simulation.close()


@pytest.mark.usefixtures("from_outside")
def test_what_a_transport_does_not_read_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"transport: got 'protocl2', expected .*did you mean 'protocol2'"
    ):
        AppConfig(transport="protocl2")
    with pytest.raises(ValueError, match=r"got 'radius' for 'loopback'.*did you mean 'radius_m'"):
        AppConfig(transport="loopback", transport_options={"radius": 1})


def test_what_nobody_can_carry_is_said_before_anything_starts() -> None:
    two_eyes = EnvConfig(app=AppConfig(transport="protocol1"), vision=VisionConfig(eyes=2))
    with pytest.raises(
        AppUnsupported,
        match=r"two_eyes: vision.eyes: got 2, which the transport 'protocol1' cannot carry, "
        r"expected 'in_process' or 'protocol2' or 'webxr'",
    ):
        app_factory(two_eyes, 1)


def test_a_game_that_only_the_server_has_says_what_it_measures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of a server built from other sources; this client's runtime is made to lack the game."""
    monkeypatch.setattr("sim2vr_harness.envs.resolved.list_games", lambda: {"whacamole": ""})
    starting = start_sim2vr_app(
        app_executable(), ["--keep", "--renderer", "null", "--game", "sample"]
    )
    try:
        with closing(starting.channel(20.0, 20.0)) as channel:
            app = AppConfig(game="sample", transport="protocol2", connect=channel.endpoint)
            assert not ResolvedEnv(EnvConfig(app=app)).facts_unasked.published
            assert ResolvedEnv(EnvConfig(app=app)).facts == describe_game("sample")
    finally:
        starting.process.kill()
        starting.process.log_file.unlink(missing_ok=True)
