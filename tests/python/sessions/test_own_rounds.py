"""Rounds that our own app logged, replayed: the very same log must come out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.sessions import Session, read_session, read_sessions
from sim2vr_harness.sessions.agreement import Agreement, agreement_of
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.whacamole import timing_of, with_clock

PlayRound = Callable[..., Path]


def replayed(recorded: Session, closed_loop: bool = False, out: Path | None = None) -> Session:
    return replay_session(with_clock(recorded, closed_loop=closed_loop), log_dir=out).session


def replayed_log(folder: Path, out: Path, closed_loop: bool) -> tuple[Session, Agreement, Path]:
    recorded = read_session(folder)
    found = agreement_of(recorded, replayed(recorded, closed_loop, out))
    return recorded, found, next(out.iterdir())


def events_of(folder: Path) -> list[str]:
    """The lines of the log but the one that tells the options, such as spawns that were given."""
    lines = (folder / "events.csv").read_text().splitlines()
    return [line for line in lines if "game options" not in line]


@pytest.mark.parametrize(
    ("how", "closed_loop"),
    [
        ({"condition": "hard"}, False),
        ({"condition": "high-unconstrained", "seed": 3}, True),
        ({"rate_hz": 100, "frames_per_step": 5}, True),
        ({"rate_hz": 72}, False),
        # A later round of a run, whose clock has not been put back: times have fewer decimals.
        ({"start_ns": 20 * 61 * 49_999_997}, True),
    ],
    ids=str,
)
def test_the_log_of_the_replay_is_the_recorded_one_byte_for_byte(
    how: dict[str, object], closed_loop: bool, play_round: PlayRound, tmp_path: Path
) -> None:
    folder = play_round(**how)
    recorded, found, log = replayed_log(folder, tmp_path / "again", closed_loop)
    assert found.identical == 1.0
    assert timing_of(recorded).clock.fixed_step_tolerance_s == 0.0  # a lockstep clock
    assert sum(found.predicted.values()) > 10
    assert found.predicted["spawn"] and found.predicted["miss"]
    assert (log / "states.csv").read_bytes() == (folder / "states.csv").read_bytes()
    assert events_of(log) == events_of(folder)
    if closed_loop and "start_ns" not in how:
        assert (log / "events.csv").read_bytes() == (folder / "events.csv").read_bytes()


def test_the_log_tells_unusual_options(play_round: PlayRound, tmp_path: Path) -> None:
    weights = [1.0, 1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0]
    moved = {"area_height_m": -0.25, "area_distance_m": 0.31, "area_tilt_deg": 35.0}
    options = {"life_seconds": 0.6, "hammer_margin_m": 0.01, "spawn_weights": weights, **moved}
    folder = play_round(options=options)
    recorded, _, log = replayed_log(folder, tmp_path / "again", closed_loop=True)
    assert {name: recorded.app.options[name] for name in options} == {
        **options, "life_seconds": pytest.approx(0.6),
    }  # fmt: skip
    assert (log / "events.csv").read_bytes() == (folder / "events.csv").read_bytes()


def test_rounds_of_a_body_replay_from_seed_and_poses(tmp_path: Path) -> None:
    # A random mix of conditions and the adaptive curriculum, whose weights the log tells.
    config = EnvConfig(
        app=AppConfig(
            options={"condition": "random-easy-medium", "adaptive": True, "round_seconds": 4.0},
            renderer="null",
        ),
        cores=1,
    )
    simulation = Simulation(config, 2, log_dir=tmp_path)
    rng = np.random.default_rng(4)
    simulation.reset(seeds=[1, 2])
    for _ in range(3 * 81 - 1):
        batch = simulation.step(rng.uniform(-1, 1, (2, 32)))
        over = np.flatnonzero(batch.terminated | batch.truncated)
        if len(over):
            simulation.reset(over.tolist())
    simulation.close()
    recordings = [
        each
        for each in read_sessions(tmp_path)
        if any(event.kind == "episode_statistics" for event in each.events)
    ]
    assert len(recordings) == 4
    assert sum("spawn_weights" in each.app.options for each in recordings) >= 2
    for number, recorded in enumerate(recordings):
        assert recorded.path is not None
        out = tmp_path / f"again{number}"
        found = agreement_of(recorded, replayed(recorded, closed_loop=True, out=out))
        (log,) = out.glob("*/events.csv")
        assert log.read_bytes() == (recorded.path / "events.csv").read_bytes()
        assert found.identical == 1.0
