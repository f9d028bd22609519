"""Rounds that our own app logged, replayed: the very same log must come out."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.cli.main import main
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.sessions import Session, read_session, read_sessions
from sim2vr_harness.sessions.agreement import Agreement, agreement_of
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.whacamole import timing_of, with_clock

PlayRound = Callable[..., Path]
FIXTURE = Path(__file__).resolve().parents[2] / "data" / "whacamole_round"


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


@pytest.mark.parametrize("closed_loop", [False, True])
@pytest.mark.parametrize(
    "how",
    [
        {"condition": "hard"},
        {"condition": "low", "seed": 12},
        {"condition": "high-unconstrained", "seed": 3},
        {"rate_hz": 100, "frames_per_step": 5},
        {"rate_hz": 72},
    ],
    ids=lambda how: "-".join(f"{value}" for value in how.values()),
)
def test_the_log_of_the_replay_is_the_recorded_one_byte_for_byte(
    how: dict[str, object], closed_loop: bool, play_round: PlayRound, tmp_path: Path
) -> None:
    folder = play_round(**how)
    recorded, found, log = replayed_log(folder, tmp_path / "again", closed_loop)
    assert timing_of(recorded).clock.fixed_step_tolerance_s == 0.0  # a lockstep clock
    assert sum(found.predicted.values()) > 10
    assert found.predicted["spawn"] and found.predicted["miss"]
    assert (log / "states.csv").read_bytes() == (folder / "states.csv").read_bytes()
    assert events_of(log) == events_of(folder)
    if closed_loop:
        assert (log / "events.csv").read_bytes() == (folder / "events.csv").read_bytes()


def test_a_later_round_on_the_references_running_clock(
    play_round: PlayRound, tmp_path: Path
) -> None:
    # Round 3 of a run, say: the clock has not been put back. Times then have fewer decimals, so
    # that the poses of two frames could fall on one time; they are still told apart.
    folder = play_round(start_ns=20 * 61 * 49_999_997)
    _, found, _ = replayed_log(folder, tmp_path / "again", closed_loop=True)
    assert found.identical == 1.0
    assert found.targets > 5


@pytest.mark.parametrize("closed_loop", [False, True])
def test_the_fixture(closed_loop: bool, tmp_path: Path) -> None:
    _, figures, log = replayed_log(FIXTURE, tmp_path, closed_loop)
    assert (figures.targets, figures.recorded["hit"], figures.identical) == (18, 7, 1.0)
    assert events_of(log) == events_of(FIXTURE)


def test_the_log_tells_unusual_options(play_round: PlayRound, tmp_path: Path) -> None:
    weights = [1.0, 1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0]
    folder = play_round(
        options={"life_seconds": 0.6, "hammer_margin_m": 0.01, "spawn_weights": weights}
    )
    recorded, _, log = replayed_log(folder, tmp_path / "again", closed_loop=True)
    assert recorded.app.options["life_seconds"] == pytest.approx(0.6)
    assert recorded.app.options["spawn_weights"] == weights
    assert (log / "events.csv").read_bytes() == (folder / "events.csv").read_bytes()


def test_the_log_tells_where_the_area_was(play_round: PlayRound, tmp_path: Path) -> None:
    moved = {"area_height_m": -0.25, "area_distance_m": 0.31, "area_tilt_deg": 35.0}
    folder = play_round(options=moved)
    recorded, _, log = replayed_log(folder, tmp_path / "again", closed_loop=True)
    assert {name: recorded.app.options[name] for name in moved} == moved
    assert (log / "events.csv").read_bytes() == (folder / "events.csv").read_bytes()


def test_another_seed_is_another_round(tmp_path: Path) -> None:
    text = (FIXTURE / "states.csv").read_text().replace("random seed 42", "random seed 43")
    folder = tmp_path / "other"
    folder.mkdir()
    (folder / "states.csv").write_text(text)
    (folder / "events.csv").write_bytes((FIXTURE / "events.csv").read_bytes())
    recorded = read_session(folder)
    closed = agreement_of(recorded, replayed(recorded, closed_loop=True))
    assert closed.identical == 0.0
    assert closed.first_divergence_s is not None
    # With the spawns of the log the seed does not matter.
    assert agreement_of(recorded, replayed(recorded)).identical == 1.0


def test_an_unfinished_round_is_replayed_as_far_as_it_goes(tmp_path: Path) -> None:
    folder = tmp_path / "cut"
    folder.mkdir()
    states = (FIXTURE / "states.csv").read_text().splitlines(keepends=True)
    (folder / "states.csv").write_text("".join(states[:63]) + states[63][:40])
    # Of frames 0 to 60, 3 s; the line after them was cut.
    kept = [
        line
        for line in (FIXTURE / "events.csv").read_text().splitlines(keepends=True)
        if float(line.split(",")[0]) <= 3.0
    ]
    (folder / "events.csv").write_text("".join(kept))
    recorded = read_session(folder)
    assert timing_of(recorded).round_s == 3600.0
    assert len(recorded) == 61
    found = agreement_of(recorded, replayed(recorded, closed_loop=True))
    assert found.identical == 1.0
    assert found.targets == sum("spawn" in line for line in kept)


def test_rounds_of_one_name_are_told_apart(play_round: PlayRound, capsys: Any) -> None:
    folders = [play_round(name, round_s=1.0) for name in ("user000", "user001")]
    with pytest.raises(SystemExit):
        main(["replay", str(folders[0].parent.parent), "--json"])
    names = [each["name"] for each in json.loads(capsys.readouterr().out)["rounds"]]
    assert names == ["user000/0000-hard", "user001/0000-hard"]


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
