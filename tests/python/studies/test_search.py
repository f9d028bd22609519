"""Searches: what is chosen, told and kept; that a killed one goes on as if nothing had happened."""

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fake_simulation import FakeSimulation

from python.studies.quick_study import content, killed_after
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import read_json
from sim2vr_harness.base.finite import NotFinite
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.figures.figure import Line
from sim2vr_harness.studies import StudyConfig, run_study
from sim2vr_harness.studies import worker as work
from sim2vr_harness.studies.config import StopConfig, parse_study
from sim2vr_harness.studies.jobs import Pruning
from sim2vr_harness.studies.report import write_report
from sim2vr_harness.studies.report.search import figures_of_search, search_sentences, trial_table
from sim2vr_harness.studies.report.source import read_source
from sim2vr_harness.studies.search import Watch, reports_of

LIFE = "env.app.options.life_seconds"


def search(trained: Path, name: str = "found", **changes: Any) -> StudyConfig:
    wanted = {
        "parameters": {
            "life": {"key": LIFE, "low": 0.5, "high": 1.5},
            "difficulty": {"key": "condition", "levels": ["easy", "hard"]},
        },
        "objectives": {"max_fatigued": "min"},
        "constraints": {"hits": {"least": 8.0}},
        "trials": 24,
        **changes,
    }
    fixed = {"user": str(trained)}
    return parse_study(
        {"name": name, "fixed": fixed, "episodes": 1, "measures": ["hits"], "optimise": wanted}
    )


@pytest.fixture(scope="module")
def rounds(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """An evaluation of each condition with the stand-in."""
    out = tmp_path_factory.mktemp("rounds")
    for condition in ("easy", "hard"):
        request = Request(conditions=[condition], episodes=1, seed=1, out=out / condition)
        evaluate(str(trained), request, simulation=FakeSimulation)
    return {condition: out / condition for condition in ("easy", "hard")}


@pytest.fixture
def formula(rounds: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> list[dict[str, float]]:
    """Plays with the stand-in, whose hits and fatigue are formulas of what is tried."""
    played: list[dict[str, float]] = []

    def play(user: str, request: Any) -> None:
        pairs = (text.split("=") for text in request.overrides)
        options = {key.rpartition(".")[2]: float(value) for key, value in pairs}
        played.append(options)
        hard = request.conditions[0] == "hard"
        life = options["life_seconds"]
        shutil.copytree(rounds[request.conditions[0]], request.out)
        # Longer lives give more hits and tire more; hard is easier on the arm here.
        file = request.out / "data" / "episodes.parquet"
        table = pq.read_table(file)
        for name, value in (("hits", 10.0 * life), ("max_fatigued", life - 0.3 * hard)):
            column = table.schema.get_field_index(name)
            values = pa.array([value] * len(table), table.schema.field(column).type)
            table = table.set_column(column, table.schema.field(column), values)
        pq.write_table(table, file)

    monkeypatch.setattr(work, "evaluate", play)
    return played


def test_it_finds_the_best_that_keeps_the_limits(
    trained: Path, formula: list[dict[str, float]], tmp_path: Path
) -> None:
    found = run_study(search(trained, trials=30), tmp_path, jobs=1)
    trials = found.data.trials
    assert trials["trial"].tolist() == list(range(1, 31))
    best = trials[trials["chosen"]]
    assert len(best) == 1 and bool(best["keeps_limits"].iloc[0])
    # At 0.8 s the limit of 8 hits is just kept; steps are 0.01 s.
    assert best["parameter_difficulty"].iloc[0] == "hard"
    assert 0.8 <= best["parameter_life"].iloc[0] <= 0.85
    assert best["max_fatigued"].iloc[0] == pytest.approx(best["parameter_life"].iloc[0] - 0.3)
    kept = trials["hits"] >= 8.0
    assert (trials["keeps_limits"] == kept).all()
    # Later trials know what earlier ones gave: they crowd where it is good.
    error = (trials["parameter_life"] - 0.8).abs()
    assert error[16:].median() < error[:10].median()
    # A search is a study: its trials are cells of it.
    assert found.data.cells["factor_trial"].tolist() == [str(k) for k in range(1, 31)]
    own = found.data.of_cell(f"trial={best['trial'].iloc[0]}").episodes
    assert own["max_fatigued"].tolist() == best["max_fatigued"].tolist()
    columns = found.data.dictionary.query("table == 'trials'")["column"].tolist()
    assert columns == trials.columns.tolist()
    # Another search in the folder begins anew; a limit that no trial keeps chooses none.
    begin = [{"life": 1.0, "difficulty": "easy"}, {"difficulty": "hard"}]
    limits = {"hits": {"least": 99.0}}
    other = search(trained, begin=begin, trials=3, sampler="random", constraints=limits)
    trials = run_study(other, tmp_path, jobs=1).data.trials
    assert trials["parameter_life"].iloc[0] == 1.0
    assert trials["parameter_difficulty"].tolist()[:2] == ["easy", "hard"]
    assert not trials["chosen"].any() and not trials["keeps_limits"].any()


@pytest.mark.parametrize("sampler", ["tpe", "gp"])
def test_a_killed_search_goes_on_with_the_same_bytes(
    sampler: str, trained: Path, formula: list[dict[str, float]], tmp_path: Path
) -> None:
    wanted = search(trained, trials=12, sampler=sampler)
    run_study(wanted, tmp_path / "whole", jobs=1)
    whole = list(formula)
    formula.clear()
    parted = tmp_path / "parted"
    with pytest.raises(KeyboardInterrupt):
        run_study(wanted, parted, make_pool=killed_after(len(whole) - 1, formula))
    found = run_study(wanted, parted, jobs=1)
    assert formula == whole, "none was played twice, and none that would not have been"
    assert found.found >= len(whole) - 1
    assert content(parted) == content(tmp_path / "whole")
    if sampler != "tpe":
        return
    # One that goes on for longer is as if it had been longer from the beginning.
    run_study(search(trained, trials=14, sampler=sampler), parted, jobs=1)
    assert formula[: len(whole)] == whole
    run_study(search(trained, trials=14, sampler=sampler), tmp_path / "longer", jobs=1)
    assert content(parted).items() >= content(tmp_path / "longer").items()


def test_a_journal_may_end_anywhere(
    trained: Path, formula: list[dict[str, float]], tmp_path: Path
) -> None:
    wanted = search(trained, trials=6, at_once=2, sampler="nsga2", begin=[{"difficulty": "hard"}])
    run_study(wanted, tmp_path, jobs=1)
    before, played = content(tmp_path), len(formula)
    journal = tmp_path / "search.journal"
    lines = journal.read_bytes().splitlines(keepends=True)
    for kept in range(0, len(lines), 20):
        journal.write_bytes(b"".join(lines[:kept]) + lines[kept][:20])
        Path(f"{journal}.lock").symlink_to(journal)  # of whoever was killed
        run_study(wanted, tmp_path, jobs=1)
        assert content(tmp_path) == before and len(formula) == played
    journal.write_bytes(b"".join(lines[:2]) + b"no JSON\n" + b"".join(lines[2:]))
    with pytest.raises(InputError, match=r"search\.journal: got it damaged .* without the file"):
        run_study(wanted, tmp_path, jobs=1)
    journal.unlink()
    run_study(wanted, tmp_path, jobs=1)
    assert content(tmp_path) == before and len(formula) == played


def test_several_objectives_have_a_front(
    trained: Path, formula: list[dict[str, float]], tmp_path: Path
) -> None:
    both = {"max_fatigued": "min", "hits": "max"}
    asked = search(trained, objectives=both, constraints={}, sampler="nsga2", trials=20)
    trials = run_study(asked, tmp_path, jobs=1).data.trials
    source = read_source(tmp_path)
    figures = {figure.key: figure for figure in figures_of_search(source)}
    assert figures["search"].title == "The best compromises"
    (line,) = (x for x in figures["search"].panels[0].layers if isinstance(x, Line))
    chosen = trials[trials["chosen"]].sort_values("max_fatigued")
    assert list(line.x) == chosen["max_fatigued"].tolist()
    assert list(line.y) == chosen["hits"].tolist()
    front = trials[trials["chosen"]].sort_values("hits")
    # Hard costs nothing here, and every life of it is a compromise.
    hard = trials[trials["parameter_difficulty"] == "hard"]
    assert set(front["trial"]) >= set(hard.drop_duplicates("hits")["trial"])
    assert front["max_fatigued"].is_monotonic_increasing


def test_a_report_shows_what_was_tried(
    trained: Path, formula: list[dict[str, float]], tmp_path: Path
) -> None:
    wanted = search(trained, trials=8, begin=[{"life": 1.0, "difficulty": "easy"}])
    trials = run_study(wanted, tmp_path, jobs=1).data.trials
    source = read_source(tmp_path)
    best = trials[trials["chosen"]].iloc[0]
    assert [group.label for group in source.groups] == ["trial 1", f"trial {best['trial']}"]
    figures = {figure.key: figure for figure in figures_of_search(source)}
    progress = figures["search"].panels[0]
    (line,) = (layer for layer in progress.layers if isinstance(layer, Line))
    # Nothing is the best before a trial keeps the limits; then it only falls.
    so_far = trials["max_fatigued"].where(trials["keeps_limits"]).cummin().ffill()
    assert [value for value in line.y if value is not None] == so_far.dropna().tolist()
    first, *_ = search_sentences(source)
    assert first == (
        f"Trial {best['trial']} has the least muscle fatigue with hits >= 8, "
        f"{best['max_fatigued']:.3f}: life {best['parameter_life']:.5g}, "
        f"difficulty {best['parameter_difficulty']}."
    )
    assert trial_table(source).count("beyond a limit") == (~trials["keeps_limits"]).sum()
    page = write_report(tmp_path, stills=False).page.read_text(encoding="utf-8")
    assert page.index("<h2>Parallel coordinates") < page.index("<h2>Measures")


LIFE_BOUNDS = {"key": LIFE, "low": 0.5, "high": 1.5}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objectives": {"hitz": "min"}}, "optimise.objectives: got 'hitz', expected one of hits"),
        ({"objectives": {}}, "optimise.objectives: got 0, expected 1 to 4"),
        (
            {"parameters": {"life": {**LIFE_BOUNDS, "low": 1.5, "high": 0.5}}},
            "optimise.parameters.life: got an empty range, low 1.5 and high 0.5, expected low",
        ),
        (
            {"constraints": {"hits": {"least": 3, "most": 2}}},
            "optimise.constraints.hits: got least 3 and most 2, which nothing can keep",
        ),
        ({"constraints": {"hits": {}}}, "constraints.hits: got no limit, expected least or most"),
        ({"parameters": {"life": {**LIFE_BOUNDS, "low": -1.0}}}, "cell life=-1: env.app.options"),
        ({"begin": [{"life": 9}]}, "begin.0.life: got 9, expected 0.5 to 1.5"),
        (
            {"stop": {"report": "rollout/return", "at": [10]}},
            "optimise.stop: got it without a training",
        ),
    ],
)
def test_what_cannot_be_searched_for_is_said(
    change: dict[str, Any], message: str, trained: Path, tmp_path: Path
) -> None:
    tree = search(trained).model_dump(mode="json", exclude_defaults=True)
    tree["optimise"] |= change
    with pytest.raises(InputError, match=re.escape(message)):
        run_study(tree, tmp_path / "none", jobs=1)
    assert not list((tmp_path / "none" / "cells").glob("*")), "nothing was played"


# --- searches that train -------------------------------------------------------------------------


def tuning(trained: Path, folder: Path, **changes: Any) -> StudyConfig:
    """Which learning rate: the training's 120 steps are judged at 60."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(trained / "config.yaml", folder / "small.yaml")
    wanted = {
        "parameters": {
            "rate": {
                "key": "training.ppo.learning_rate.initial", "low": 1e-5, "high": 1e-2, "log": True,
            },
            "weight": {"key": "training.env.user.effort.weight", "levels": [0.01, 0.2]},
        },
        "objectives": {"return": "max"},
        "trials": 6,
        "at_once": 2,
        "sampler": "random",
        "stop": {"report": "train/value_loss", "better": "lower", "at": [60], "earlier": 2},
        **changes,
    }  # fmt: skip
    fixed = {"config": str(folder / "small.yaml"), "condition": "easy"}
    return parse_study({"name": "tuning", "fixed": fixed, "episodes": 2, "optimise": wanted})


def test_trainings_that_learn_little_are_stopped(
    trained: Path, trainings: list[Any], tmp_path: Path
) -> None:
    asked = tuning(trained, tmp_path / "config")
    found = run_study(asked, tmp_path / "whole", jobs=1)
    trials = found.data.trials
    assert len(trainings) == 6
    stopped = trials[trials["state"] == "stopped"]
    # Nobody to be compared with in the first batch, the better half of the complete ones then.
    assert set(trials["state"][:2]) == {"measured"} and 0 < len(stopped) < 4
    reports = [json.loads(text)["60"] for text in trials["reported"]]
    for batch in (2, 4):
        complete = trials["state"][:batch] == "measured"
        limit = np.median(np.array(reports[:batch])[complete])
        for row in (batch, batch + 1):
            assert (trials["state"][row] == "stopped") == (reports[row] > limit)
    assert stopped["design_cell"].isna().all() and stopped["return"].isna().all()
    assert len(found.data.cells) == 6 - len(stopped)
    assert trials["chosen"].sum() == 1
    marks = [
        read_json(file, "")
        for file in sorted((tmp_path / "whole").glob("trainings/*/trained.json"))
    ]
    assert [mark["stopped_at"] for mark in marks if "stopped_at" in mark] == [60] * len(stopped)
    for mark in marks:
        assert mark["checkpoint"] == (
            "step_000000060.zip" if "stopped_at" in mark else "step_000000120.zip"
        )
    # Again: nothing is trained twice, and the same trials are stopped.
    before = content(tmp_path / "whole")
    again = run_study(asked, tmp_path / "whole", jobs=1)
    assert (again.played, len(trainings)) == (0, 6)
    assert content(tmp_path / "whole") == before


def test_reports_are_the_best_so_far_at_each_step() -> None:
    rows = [{"step": step, "r": r} for step, r in ((20, 1.0), (40, 3.0), (60, 2.0), (80, None))]
    assert reports_of(rows, StopConfig(report="r", at=(30, 60, 90))) == {30: 3.0, 60: 3.0}
    assert reports_of(rows, StopConfig(report="r", at=(60,), better="lower")) == {60: 1.0}


@pytest.mark.parametrize(
    ("own", "changes", "stopped_at"),
    [
        (2.4, {}, 60),  # the median of 1, 2, 3 and 4 is 2.5
        (2.6, {}, None),
        (2.4, {"better": "lower"}, None),
        (2.6, {"better": "lower"}, 60),
        (1.8, {"keep": 0.75}, None),  # a quarter of the way: 1.75
        (1.7, {"keep": 0.75}, 60),
        (0.0, {"earlier": 5}, None),  # too few have come so far
    ],
)
def test_a_training_is_stopped_where_it_is_behind(
    own: float, changes: dict[str, Any], stopped_at: int | None
) -> None:
    stop = StopConfig(report="r", at=(30, 60), **changes)
    pruning = Pruning(stop, tuple(((60, float(k)),) for k in range(1, 5)))
    watch = Watch(pruning, [{"step": 40, "r": own}])
    assert not watch.stop(), "no one reported at 30"
    report = SimpleNamespace(number=1, stages=2, done=60, values={"r": own})
    watch.report(report)
    assert not watch.stop(), "only the last stage counts"
    report.number = 2
    watch.report(report)
    assert watch.stopped_at == stopped_at
    again = Watch(pruning, [{"step": 40, "r": own}, {"step": 60, "r": own}])
    assert again.stopped_at == stopped_at, "as a resumed one"


def test_trainings_that_diverge_are_trials_without_a_number(
    trained: Path, trainings: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in = work.trainer.train

    def diverge(config: Any, out: Path, **how: Any) -> Any:
        result = stand_in(config, out, **how)
        if config.ppo.learning_rate.initial > 1e-4:
            raise NotFinite("the weights are not finite")
        return result

    monkeypatch.setattr(work.trainer, "train", diverge)
    asked = tuning(trained, tmp_path / "config", stop=None, trials=4)
    trials = run_study(asked, tmp_path / "out", jobs=1).data.trials
    wild = trials["parameter_rate"] > 1e-4
    assert 0 < wild.sum() < 4
    assert (trials["state"] == "stopped").tolist() == wild.tolist()
    assert trials["return"].isna().tolist() == wild.tolist()
