"""Studies of the quick stand-in: what is done, kept, gone on with; what if something fails."""

import errno
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from python.studies.quick_study import content, killed_after, study
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.evaluation.data import DataFolder, read_data
from sim2vr_harness.evaluation.data.columns import Column, number_table
from sim2vr_harness.studies import read_study, run_study
from sim2vr_harness.studies import worker as work
from sim2vr_harness.studies.jobs import hashes_of
from sim2vr_harness.studies.runner import StudyProgress


def test_cells_become_tables_with_the_factors(
    trained: Path, quick: list[str], tmp_path: Path
) -> None:
    told: list[StudyProgress] = []
    found = run_study(study(trained), tmp_path / "out", jobs=1, on_progress=told.append)
    assert quick == ["easy", "easy", "hard", "hard"]
    assert [(one.done, one.total) for one in told] == [(k, 4) for k in range(5)]
    assert told[-1].label == "cell difficulty=hard,noise=on"
    data = found.data
    assert len(data.cells) == 4 and len(data.episodes) == 8
    rows = data.episodes.query("factor_difficulty == 'hard' and factor_noise == 'on'")
    assert rows["design_cell"].unique().tolist() == ["difficulty=hard,noise=on"]
    assert rows["condition"].tolist() == ["hard", "hard"]
    assert rows["seed"].tolist() == [1, 2]
    assert "env.user.noise.constant" in rows["changes"].iloc[0]
    # The same numbers as the cell's own.
    own = data.of_cell("difficulty=hard,noise=on").episodes
    assert own["hits"].tolist() == rows["hits"].tolist()
    columns = data.dictionary.query("table == 'episodes'")["column"].tolist()
    assert columns == data.episodes.columns.tolist()
    # One user has no p value.
    results = data.statistics["results"]
    assert [(one["measure"], one["unit"], one["p"]) for one in results] == [
        ("hits", "user", None), ("return", "user", None),
    ]  # fmt: skip


def test_a_study_goes_on_after_a_kill_and_has_the_same_bytes(
    trained: Path, quick: list[str], tmp_path: Path
) -> None:
    run_study(study(trained), tmp_path / "whole", jobs=1)
    quick.clear()

    parted = tmp_path / "parted"
    with pytest.raises(KeyboardInterrupt):
        run_study(study(trained), parted, make_pool=killed_after(3, quick))
    (parted / "cells" / ".of_the_fourth.1.part" / "data").mkdir(parents=True)
    assert quick == ["easy", "easy", "hard"]
    found = run_study(study(trained), parted, jobs=1)
    assert quick == ["easy", "easy", "hard", "hard"], "none was played twice"
    assert (found.found, found.played) == (3, 1)
    assert content(parted) == content(tmp_path / "whole")
    again = run_study(study(trained), parted, jobs=1)
    assert (again.found, again.played, len(quick)) == (4, 0, 4)


def test_a_study_that_grows_keeps_what_is_there(
    trained: Path, quick: list[str], tmp_path: Path
) -> None:
    small = study(trained, cells=[{"difficulty": "easy", "noise": "off"}], comparisons=[])
    run_study(small, tmp_path, jobs=1)
    assert run_study(study(trained), tmp_path, jobs=1).found == 1
    assert len(quick) == 4
    with pytest.raises(InputError, match=r"--out: got .* which has the study 'quick', expected an"):
        run_study(study(trained, name="another"), tmp_path, jobs=1)
    other = tmp_path / "full"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"--out: got .*which has other files, expected a folder"):
        run_study(study(trained), other, jobs=1)
    assert [file.name for file in other.iterdir()] == ["notes.txt"]
    # The configuration's own way of choosing actions counts, unless the study says another.
    user = shutil.copytree(trained, tmp_path / "user" / "run")
    tree = yaml.safe_load((user / "config.yaml").read_text())
    tree |= {"evaluation": {"deterministic": True}}
    (user / "config.yaml").write_text(yaml.safe_dump(tree))
    for told, expected in ({}, True), ({"deterministic": False}, False):
        found = run_study(study(user, **told), tmp_path / f"drawn{len(told)}", jobs=1)
        assert set(found.data.episodes["deterministic"]) == {expected}


def test_cells_that_fail_leave_the_others(
    trained: Path, quick: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = work.evaluate

    def fail_on(condition: str, error: Exception) -> Callable[..., Any]:
        def play(user: str, request: Any) -> Any:
            if request.conditions == [condition]:
                raise error
            return played(user, request)

        return play

    full = OSError(errno.ENOSPC, "No space left on device", "episodes.parquet")
    monkeypatch.setattr(work, "evaluate", fail_on("hard", full))
    message = (
        r"^cell difficulty=hard,noise=off: got episodes.parquet: no space left on device "
        r"\(and 1 more\), expected every cell to be played; 2 of 4 tasks are kept, run the study "
    )
    with pytest.raises(InputError, match=message):
        run_study(study(trained), tmp_path, jobs=1)
    assert not list((tmp_path / "cells").glob(".*"))
    monkeypatch.setattr(work, "evaluate", played)
    assert run_study(study(trained), tmp_path, jobs=1).found == 2


def test_people_are_the_units(trained: Path, quick: list[str], tmp_path: Path) -> None:
    factors = {"actions": {"key": "deterministic", "levels": {"mean": True, "drawn": False}}}
    asked = {"people": 4, "factors": factors, "measures": ["return"]}
    fixed = {"user": str(trained), "condition": "easy"}
    comparisons = [{"factor": "actions", "alternative": "greater"}]
    asked |= {"fixed": fixed, "comparisons": comparisons}
    found = run_study(study(trained, **asked), tmp_path, jobs=1)
    episodes = found.data.episodes
    assert sorted(episodes["unit"].unique()) == [f"person {k}" for k in range(4)]
    assert found.data.about["unit"] == "person"
    summary = found.data.statistics["summaries"][0]
    assert (summary["n"], summary["rounds"], summary["unit"]) == (4, 8, "person")
    (result,) = found.data.statistics["results"]
    assert (result["test"], result["n"], result["refused"]) == ("paired-t", 4, None)
    # Each person counts with the mean of its two rounds.
    means = episodes.groupby(["unit", "factor_actions"])["return"].mean().unstack()
    assert result["means"] == pytest.approx([means["mean"].mean(), means["drawn"].mean()])
    assert result["difference"]["high"] is None, "a one-sided test bounds one side"
    assert "person_stature_m" in episodes


def test_a_plan_says_how_many_persons_a_difference_needs(
    trained: Path,
    quick: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    factors = {"actions": {"key": "deterministic", "levels": {"mean": True, "drawn": False}}}
    tree = {
        "name": "quick", "fixed": {"user": str(trained), "condition": "easy"}, "factors": factors,
        "people": 4, "episodes": 2, "measures": ["return"], "comparisons": [{"factor": "actions"}],
    }  # fmt: skip
    file.write_text(yaml.safe_dump(tree))

    def planned(*options: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as exit_:
            main(["study", str(file), "--out", str(out), *options])
        return int(exit_.value.code or 0), "".join(capsys.readouterr())

    code, text = planned("--plan")
    assert code == 0 and not out.exists() and quick == [], "nothing is played"
    # G*Power: 34, 15 and 8 pairs by t for d_z = 0.5, 0.8 and 1.2; ranks need 1 / .955 of the first.
    rows = [line.split() for line in text.splitlines() if "drawn - mean" in line]
    assert [(row[-3], row[-1]) for row in rows] == [("0.50", "35"), ("0.80", "15"), ("1.20", "8")]
    assert "SD: unknown: no earlier results" in text
    episodes = run_study(file, out, jobs=1).data.episodes
    means = episodes.groupby(["unit", "factor_actions"])["return"].mean().unstack()
    sd = (means["mean"] - means["drawn"]).std(ddof=1)
    code, text = planned("--plan", "--difference", f"return={sd / 2}")
    row = next(line.split() for line in text.splitlines() if "drawn - mean" in line)
    assert row[3:] == ["return", f"{sd:.3g}", f"{sd / 2:.3g}", "0.50", "1", "35"]


def test_a_factor_may_need_training(trained: Path, trainings: list[Any], tmp_path: Path) -> None:
    """Effort's weight times the training's seed: four trainings, whose seeds are the units."""
    shutil.copy(trained / "config.yaml", tmp_path / "small.yaml")
    factors = {
        "effort": {
            "key": "training.env.user.effort.weight",
            "levels": {"lazy": 0.2, "eager": 0.01},
        },
        "seed": {"key": "training.seed", "levels": [1, 2]},
    }
    fixed = {"config": str(tmp_path / "small.yaml"), "condition": "easy"}
    asked = study(
        trained, factors=factors, fixed=fixed, comparisons=[{"factor": "effort"}], measures=["hits"]
    )
    found = run_study(asked, tmp_path / "out", jobs=1)
    assert len({out for _, out in trainings}) == len(trainings) == 4
    data = found.data
    assert data.about["unit"] == "seed"
    assert sorted(data.episodes["unit"].unique()) == ["1", "2"]
    assert data.episodes.groupby("factor_effort")["effort_weight"].unique().to_dict() == {
        "lazy": [0.2], "eager": [0.01],
    }  # fmt: skip
    result = data.statistics["results"][0]
    # Trainings of two weights have nothing in common, whatever their seeds are called.
    assert (result["test"], result["n"]) == ("welch-t", [2, 2])
    before = content(tmp_path / "out")
    run_study(asked, tmp_path / "out", jobs=1)
    assert len(trainings) == 4
    assert content(tmp_path / "out") == before


def test_a_study_is_exported_for_opensim_by_cell(
    trained: Path, quick: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    levels = {"a/b": "easy", "a b": "hard"}
    wanted = {"which": {"key": "condition", "levels": levels}}
    found = run_study(study(trained, factors=wanted, comparisons=[]), tmp_path / "out", jobs=1)
    export = ["export", str(tmp_path / "out"), "--out", str(tmp_path / "sto")]
    joint = Column("q_elbow", "number", "rad", "Angle")
    time = Column("time_s", "number", "s", "Time")
    for cell in found.data.cells["folder"]:
        tables = DataFolder(tmp_path / "out" / cell / "data")
        rows = read_data(tables.root).episodes.to_dict("records")
        for row in rows:
            values = np.full((1, 1), np.radians(10.0 * row["seed"]))
            times = [(time, np.array([0.05]))]
            tables.write_moments(
                "steps", row["episode"], number_table(row["episode"], times, values, [joint])
            )
        dictionary = b"table,column,type,unit,description\nsteps,q_elbow,number,rad,Angle\n"
        (tables.root / "dictionary.csv").write_bytes(dictionary)
        mark = tmp_path / "out" / cell / "cell.json"
        about = json.loads(mark.read_text())
        mark.unlink()
        mark.write_text(json.dumps(about | {"sha256": hashes_of(mark.parent)}))
    with pytest.raises(SystemExit):
        main(export)
    written = sorted((tmp_path / "sto").rglob("*.mot"))
    assert [str(file.relative_to(tmp_path / "sto")) for file in written] == [
        *("which=a_b/easy_seed1_joints.mot", "which=a_b/easy_seed2_joints.mot"),
        *("which=a_b_1/hard_seed1_joints.mot", "which=a_b_1/hard_seed2_joints.mot"),
    ]
    assert written[3].read_text().splitlines()[-1].split() == ["0.050000", "20"]


def test_checks_of_cells_decide_the_exit_status(
    trained: Path, quick: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out, junit = tmp_path / "study.yaml", tmp_path / "out", tmp_path / "checks.xml"
    tree = {
        "name": "quick", "fixed": {"user": str(trained)}, "people": 3, "measures": ["hits"],
        "factors": {"difficulty": {"key": "condition", "levels": ["easy", "hard"]}},
    }  # fmt: skip
    file.write_text(yaml.safe_dump(tree))

    def checked(*options: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as exit_:
            main(["study", str(file), "--out", str(out), "--jobs", "1", "--no-report", *options])
        return int(exit_.value.code or 0), capsys.readouterr().err

    code, text = checked("--expect", "hit >= 1")
    assert (code, text) == (
        2, "error: --expect: got 'hit', expected a measure (did you mean 'hits'?)\n"
    )  # fmt: skip
    assert not out.exists() and quick == [], "nothing is played"

    bound = "difficulty=hard:hits > 1e6"
    code, text = checked("--expect", "hits >= 0", "--expect", bound, "--junit", str(junit))
    hits = read_study(out).episodes.query("factor_difficulty == 'hard'")["hits"].mean()
    assert code == 1 and text.splitlines()[-2:] == [
        f"failed: difficulty=hard: hits is {hits:.4g} (n = 3, unit: person), expected > 1e+06",
        "1 of 3 checks failed",
    ]
    assert junit.read_text().count("<testcase ") == 3
    kept = tmp_path / "baseline.json"
    shutil.copy(out / "statistics.json", kept)
    assert checked("--against", str(kept))[0] == 0
    before = json.loads(kept.read_text())
    before["summaries"][1]["mean"] += 1e6
    kept.write_text(json.dumps(before))
    code, text = checked("--against", str(kept))
    assert code == 1 and "failed: difficulty=hard: hits is" in text
