"""Runs of the benchmark: rows, ratios, scaling, profile and what the command line says."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.bench import plan as plans
from sim2vr_harness.bench import scenes
from sim2vr_harness.bench.memory import memory_rows
from sim2vr_harness.bench.rows import Row
from sim2vr_harness.bench.stages import StageClock, timed_stages
from sim2vr_harness.bench.turns import Turn, in_turns, paired_ratio, spread, timed_turn
from sim2vr_harness.cli.main import main
from sim2vr_harness.training.config import TrainingConfig, parse_config

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
    monkeypatch.setattr(scenes, "WARM_UP_STEPS", 5)


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
        capsys, *FAST, "--scene", "physics,env", "--scene", "game", "--n", "1,2", "--threads",
        "1,2", "--json", "--output", str(file),
    )  # fmt: skip
    assert status == 0, err
    rows = [json.loads(line) for line in out.splitlines()]
    assert [(row["n"], row["threads"], row["scene"]) for row in rows] == [
        (n, threads, scene)
        for n in (1, 2)
        for threads in (1, 2)
        for scene in ("physics", "game", "env")
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


def test_scaling_takes_targets_once() -> None:
    plan = plans.Plan.from_options(config(), "scaling")
    chosen = plans.specs(plan)
    plain = {(spec.scene, spec.n) for spec in chosen if not spec.variant}
    assert plain == {(scene, n) for scene in ("physics", "env") for n in plans.SCALING_N}
    variants = [(spec.scene, spec.variant, spec.n) for spec in chosen if spec.variant]
    assert len(variants) == len(set(variants))
    assert ("env", "condition=hard", 64) in variants
    assert ("render", "targets=27", 64) in variants


def test_standing_targets_are_seen() -> None:
    from sim2vr_harness.envs.simulation import Simulation

    plan = plans.Plan.from_options(config(), "usual", ["targets"], "1", "1")
    pictures = []
    for spec in plans.specs(plan):
        if spec.scene != "render" or spec.variant == "targets=27":  # these share nine cells
            continue
        with closing(Simulation(spec.env(), 1)) as simulation:
            simulation.reset(seeds=[0])
            for _ in range(15):
                simulation.step(np.zeros((1, 32)))
            pictures.append(simulation.observation()["vision"][0, 0].astype(int))
    changed = [int((np.abs(picture - pictures[0]) > 8).sum()) for picture in pictures]
    assert changed[0] == 0
    assert changed == sorted(set(changed))  # 0, 1, 3, 5, 9 targets: more and more pixels


def test_threads_double_up_to_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    for count, expected in ((1, [1]), (2, [1, 2]), (6, [1, 2, 4, 6])):
        monkeypatch.setattr(plans, "cores", lambda count=count: count)
        assert plans.doubling_threads() == expected


def test_rows_that_must_play_alike_are_compared() -> None:
    rows = [
        Row("env", "in_process", 2, 1, state_hash="a"),
        Row("env", "protocol1", 2, 1, state_hash="b"),
    ]
    with pytest.raises(
        RuntimeError, match=r"hash a in 'env, in_process, N=2, .*', b in 'env, prot"
    ):
        plans.check_hashes(rows)
    others = [
        Row("env", "in_process", 3, 1, state_hash="b"),
        Row("physics", None, 2, 1, state_hash="c"),
    ]
    plans.check_hashes([rows[0], *others])


def test_memory_of_fresh_processes() -> None:
    few, more = memory_rows(config(), [1, 5], 1)
    assert few.memory_mb is not None
    assert more.memory_mb is not None
    assert 20.0 < few.memory_mb < 4000.0
    # Four users of 32x24 pixels take some 100 kB each; the driver's own memory varies more.
    per_user_mb = (more.memory_mb - few.memory_mb) / 4
    assert more.extra["memory_mb_per_user"] == pytest.approx(per_user_mb, abs=1e-3)
    assert few.extra == {}


def test_profile_splits_the_step(capsys: Any, tmp_path: Path) -> None:
    file = tmp_path / "profile.txt"
    status, out, err = bench(
        capsys, *FAST, *TINY, "--profile", "--n", "2", "--train-steps", "8", "--profile-file",
        str(file), "--json",
    )  # fmt: skip
    assert status == 0, err
    env, train = (json.loads(line) for line in out.splitlines())
    # A function that was renamed is no longer timed: mend bench/stages.py.
    assert env["extra"]["not_timed"] == train["extra"]["not_timed"] == []
    for row in (env, train):
        stages = row["extra"]["stages_us"]
        assert sum(stages.values()) == pytest.approx(1e6 / row["rate_per_s"], rel=0.01)
        cpu = row["extra"]["stages_cpu_us"]
        assert sum(cpu.values()) == pytest.approx(row["cpu_us_per_step"], rel=0.01)
        assert {"physics", "game", "drawing", "effort", "perception"} <= set(stages)
        assert stages["physics"] > 0.0
    assert {"policy, acting", "buffer", "update, backward"} <= set(train["extra"]["stages_us"])
    text = file.read_text()
    for part in ("physics", "update, backward", "How to read it", "tottime"):
        assert part in text


def test_stages_do_not_count_what_is_inside_them() -> None:
    wall = iter([0.0, 1.0, 4.0, 6.0, 10.0, 13.0])
    cpu = iter([0.0, 0.5, 1.0, 3.0, 3.0, 4.0])
    clock = StageClock(lambda: next(wall), lambda: next(cpu))
    with clock.stage("outer"), clock.stage("inner"):
        pass
    with clock.stage("outer"):
        pass
    # outer: 0 to 1, 4 to 6 and 10 to 13; inner: 1 to 4.
    assert clock.times == {"outer": (1.0 + 2.0 + 3.0, 0.5 + 2.0 + 1.0), "inner": (3.0, 0.5)}


def test_timers_are_taken_away_again() -> None:
    from mujoco.batch import Batch

    from sim2vr_harness.envs import simulation
    from sim2vr_harness.users.effort import CumulativeFatigue3CCr, Zero

    before = [Batch.step, CumulativeFatigue3CCr.update, Zero.update, simulation.pose_to_app]
    with timed_stages(StageClock()):
        during = [Batch.step, CumulativeFatigue3CCr.update, Zero.update, simulation.pose_to_app]
        assert all(a is not b for a, b in zip(before, during, strict=True))
    after = [Batch.step, CumulativeFatigue3CCr.update, Zero.update, simulation.pose_to_app]
    assert all(a is b for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--n", "0"], "--n: got 0, expected at least 1"),
        (["--n", "4,x"], "--n: got '4,x', expected whole numbers with commas, such as 16,64"),
        (["--threads", "0"], "--threads: got 0, expected at least 1"),
        (["--seconds", "0"], "--seconds: got 0.0, expected more than 0"),
        (["--seconds", "nan"], "--seconds: got nan, expected more than 0"),
        (["--train-steps", "0"], "--train-steps: got 0, expected at least 1"),
        (["--scene", "physic"], "--scene: got 'physic', expected one of all, physics, game, "),
        (["--transport", "protocol3"], "--transport: got 'protocol3', expected one of all, in_pr"),
        (["--output", "{tmp}/no/rows.jsonl"], "--output: got '{tmp}/no/rows.jsonl', expected a"),
        (["--profile", "--scaling"], "--profile: got it together with --scaling, expected one"),
        (["--profile", "--scene", "game"], "--scene: got 'game' with --profile, expected env and"),
        (
            ["--scene", "targets", "--set", "env.app.game=sample", "--set", "env.app.options={{}}"],
            "--scene: got 'targets' with game 'sample', expected the game whacamole",
        ),
    ],
)
def test_bad_input(capsys: Any, tmp_path: Path, arguments: list[str], message: str) -> None:
    status, out, err = bench(capsys, *(argument.format(tmp=tmp_path) for argument in arguments))
    assert (status, out) == (2, "")
    assert err.startswith(f"error: {message.format(tmp=tmp_path)}")
    assert len(err.splitlines()) == 1
