"""Runs of the benchmark: rows, ratios, and what the command line says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sim2vr_harness.bench import plan as plans
from sim2vr_harness.bench import scene
from sim2vr_harness.bench.memory import memory_rows
from sim2vr_harness.bench.rows import BenchRow
from sim2vr_harness.bench.run import check_hashes
from sim2vr_harness.bench.turns import Turn, in_turns, paired_ratio, spread, timed_turn
from sim2vr_harness.cli.main import main
from sim2vr_harness.runs.config import TrainingConfig, parse_config

FAST = ["--set", "env.vision.width=32", "--set", "env.vision.height=24", "--seconds", "0.05"]
TINY = ["--set", "policy.net_arch=[8]", "--set", "policy.vision_features=4"]

FIELDS = {
    "scene", "rate_per_s", "spread", "turns", "cpu_us_per_step", "transport", "n", "threads",
    "variant", "unit", "state_hash", "observation_hash", "parts", "ratios", "memory_mb", "extra",
    "run", "version", "commit", "dirty", "renderer", "cpu", "cores", "memory_total_mb",
    "load_average", "system", "image", "channels", "game", "options", "effort",
    "physics_steps_per_user_step", "frames_per_step", "torch_threads", "device", "gpu", "seconds",
    "versions",
}  # fmt: skip


@pytest.fixture(autouse=True)
def short_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene, "WARM_UP_STEPS", 5)


def bench(capsys: Any, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_:
        main(["bench", *arguments])
    out, err = capsys.readouterr()
    return int(exit_.value.code or 0), out, err


class Counted:
    """A scene whose rate is its number of turns."""

    def __init__(self, log: list[str], name: str, most_turns: int) -> None:
        self.log, self.name, self.most_turns = log, name, most_turns

    def measure(self, seconds: float) -> Turn:
        self.log.append(self.name)
        assert seconds == 0.5
        return Turn(float(len(self.log)), 1.0)


def test_scenes_take_turns() -> None:
    log: list[str] = []
    pair = {"a": Counted(log, "a", 5), "b": Counted(log, "b", 2)}
    found = in_turns(pair, 1.5, turns=3)
    assert log == ["a", "b", "a", "b", "a"]
    assert [turn.rate_per_s for turn in found["a"]] == [1.0, 3.0, 5.0]
    assert len(found["b"]) == 2


def test_numbers_over_turns() -> None:
    # Ratios 2, 0.5, 3; the ratio of the medians would be 4 / 4 = 1.
    assert paired_ratio([4.0, 2.0, 12.0], [2.0, 4.0, 4.0]) == 2.0
    assert spread([8.0, 10.0, 13.0]) == pytest.approx(0.5)


def test_a_turn_measures_one_call_at_least() -> None:
    calls: list[int] = []
    turn = timed_turn(lambda: calls.append(1), users=3, seconds=0.0)
    assert len(calls) == 2  # one before the clock starts
    assert turn.rate_per_s > 0.0
    assert turn.cpu_us >= 0.0


def test_rows_have_their_fields(capsys: Any, tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    status, out, err = bench(
        capsys, *FAST, "--scene", "physics,env", "--scene", "render", "--n", "1,2", "--threads",
        "1,2", "--json", "--output", str(file),
    )  # fmt: skip
    assert status == 0, err
    rows = [json.loads(line) for line in out.splitlines()]
    assert [(row["n"], row["threads"], row["scene"]) for row in rows] == [
        (n, threads, scene)
        for n in (1, 2)
        for threads in (1, 2)
        for scene in ("physics", "render", "env")
    ]
    for row in rows:
        assert set(row) == FIELDS
        assert row["rate_per_s"] > 0.0
        assert len(row["turns"]) == 5
        assert len(row["state_hash"]) == 16
        assert row["memory_mb"] > 1.0
        assert row["image"] == [32, 24]
        assert row["run"] == rows[0]["run"]
    envs = {(row["n"], row["threads"]): row for row in rows if row["scene"] == "env"}
    assert set(envs[2, 2]["ratios"]) == {"physics", "physics, cpu", "1 thread", "1 thread, cpu"}
    assert set(envs[2, 1]["ratios"]) == {"physics", "physics, cpu"}
    assert envs[2, 1]["state_hash"] == envs[2, 2]["state_hash"] != envs[1, 1]["state_hash"]
    assert [json.loads(line) for line in file.read_text().splitlines()] == rows


def test_the_table_names_scenes_and_ratios(capsys: Any, tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    options = ["--scene", "env,physics", "--n", "2", "--threads", "1", "--output", str(file)]
    status, out, err = bench(capsys, *FAST, *options)
    assert status == 0, err
    assert bench(capsys, *FAST, *options)[0] == 0
    for part in ("physics", "env", "env, N=2, 1 thread ", " x physics (", f"Written: {file}"):
        assert part in out
    assert len(file.read_text().splitlines()) == 4  # the second run's rows come after the first's


def test_training_is_split(capsys: Any) -> None:
    status, out, err = bench(
        capsys, *FAST, *TINY, "--scene", "train", "--n", "2", "--train-steps", "8", "--json"
    )
    assert status == 0, err
    (row,) = [json.loads(line) for line in out.splitlines()]
    assert row["extra"] == {"train_steps": 8, "batch_size": 8, "n_epochs": 10}
    # In every turn each part alone is faster than both together.
    assert row["rate_per_s"] < min(row["parts"].values())
    assert row["state_hash"] is None


def config() -> TrainingConfig:
    return parse_config({"env": {"vision": {"width": 32, "height": 24}}})


def test_a_plan_knows_every_transport_and_the_threads_of_the_configuration() -> None:
    ways = plans.transports()
    assert ways[0] == "in_process"
    assert {"protocol1", "protocol2"} <= set(ways)
    plan = plans.BenchPlan(
        parse_config({"env": {"cores": 3}}), ["all"], n="8,2,8", transport=["all"]
    )
    chosen = [spec for spec in plans.specs(plan) if not spec.variant]  # those are of senses
    found = [(spec.scene, spec.transport, spec.n, spec.threads) for spec in chosen]
    expected = [("physics", None), *(("render", way) for way in ways)]
    expected += [*(("env", way) for way in ways), ("train", "in_process")]
    assert found == [(name, way, n, 3) for n in (8, 2) for name, way in expected]


def test_rows_that_must_play_alike_are_compared() -> None:
    rows = [
        BenchRow("env", "in_process", 2, 1, state_hash="a"),
        BenchRow("env", "protocol1", 2, 1, state_hash="b"),
    ]
    with pytest.raises(
        RuntimeError, match=r"hash a in 'env, in_process, N=2, .*', b in 'env, prot"
    ):
        check_hashes(rows)
    others = [
        BenchRow("env", "in_process", 3, 1, state_hash="b"),
        BenchRow("physics", None, 2, 1, state_hash="c"),
    ]
    check_hashes([rows[0], *others])


def test_memory_of_fresh_processes() -> None:
    few, more = memory_rows(config(), [1, 5], 1)
    assert few.memory_mb is not None
    assert more.memory_mb is not None
    assert 20.0 < few.memory_mb < 4000.0
    # Four users of 32x24 pixels take some 100 kB each; the driver's own memory varies more.
    per_user_mb = (more.memory_mb - few.memory_mb) / 4
    assert more.extra["memory_mb_per_user"] == pytest.approx(per_user_mb, abs=1e-3)
    assert few.extra == {}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--n", "0"], "--n: got 0, expected at least 1"),
        (["--n", "4,x"], "--n: got '4,x', expected whole numbers with commas, such as 16,64"),
        (["--threads", "0"], "--threads: got 0, expected at least 1"),
        (["--seconds", "0"], "--seconds: got 0, expected more than 0"),
        (["--seconds", "nan"], "--seconds: got nan, expected a finite number"),
        (["--train-steps", "0"], "--train-steps: got 0, expected at least 1"),
        (["--scene", "physic"], "--scene: got 'physic', expected one of all, physics, render, "),
        (["--transport", "protocol3"], "--transport: got 'protocol3', expected one of all, in_pr"),
        (["--output", "{tmp}"], "--output: got '{tmp}', which is a folder, expected a file"),
        (["--seconds", "-1"], "--seconds: got -1, expected more than 0"),
    ],
)
def test_bad_input(capsys: Any, tmp_path: Path, arguments: list[str], message: str) -> None:
    status, out, err = bench(capsys, *(argument.format(tmp=tmp_path) for argument in arguments))
    assert (status, out) == (2, "")
    assert err.startswith(f"error: {message.format(tmp=tmp_path)}")
    assert len(err.splitlines()) == 1
