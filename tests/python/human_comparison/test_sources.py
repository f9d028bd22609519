"""Where rounds come from, and what cannot be used."""

import csv
import json
import re
import shutil
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.games.registry import behaviour_of
from sim2vr_harness.human_comparison import sources
from sim2vr_harness.human_comparison.sources import (
    Plays,
    Source,
    Sources,
    measured_people,
    measured_user,
    read_folders,
    read_people,
    read_sources,
    read_user,
)
from sim2vr_harness.studies.config import parse_study
from sim2vr_harness.studies.data import StudyData

WHACAMOLE = behaviour_of("whacamole")
ROUND = Path(__file__).parents[2] / "data" / "whacamole_round"
"""A round of six seconds, hard, seven hits."""
HARD = ("constrained", "hard")


def logged(folder: Path, *, earlier_s: float = 0.0, title: str = "condition hard") -> Path:
    """A copy of the round, its hits earlier by so much."""
    folder.mkdir(parents=True)
    states = (ROUND / "states.csv").read_text()
    (folder / "states.csv").write_text(states.replace("condition hard", title, 1))
    lines = (ROUND / "events.csv").read_text().splitlines()
    moved = [
        re.sub(r"^[^,]+", lambda time: f"{float(time[0]) - earlier_s:.5f}", line)
        if "target_hit" in line
        else line
        for line in lines
    ]
    (folder / "events.csv").write_text("\n".join(moved) + "\n")
    return folder


def evaluation(folder: Path, persons: dict[int | None, float]) -> Path:
    """Results of an evaluation with a round per person; who is None has none."""
    rows = []
    for i, (person, earlier_s) in enumerate(persons.items()):
        logged(folder / "logs" / f"hard_seed{i}", earlier_s=earlier_s)
        row: dict[str, Any] = {"log_folder": f"logs/hard_seed{i}", "max_fatigued": 0.1 + 0.1 * i}
        rows.append(row if person is None else {**row, "person": person})
    (folder / "results.json").write_text(json.dumps({"hard": {"rounds": rows}}))
    return folder


@pytest.fixture
def people(tmp_path: Path) -> Path:
    for i, name in enumerate("abc"):
        logged(tmp_path / "people" / name / "round", earlier_s=0.01 * i)
    return tmp_path / "people"


def measured(folder: Path) -> Source:
    return measured_user(folder.name, read_user(folder), WHACAMOLE)


def play(user: str, recorded: Path, out: Path, **how: Any) -> Sources:
    return read_sources([user], [recorded], Plays(**{"out": out, "seed": 5, "episodes": 2, **how}))


def test_people_with_logs_of_ours_are_the_folders_above_the_rounds(people: Path) -> None:
    source = measured_people(read_people(people), WHACAMOLE)
    assert [person.name for person in source.persons[HARD]] == ["a", "b", "c"]
    times = [person.values["tth_median"] for person in source.persons[HARD]]
    assert times[0] - times[2] == pytest.approx(0.02, abs=1e-4)
    assert source.persons[HARD][0].values["hits"] == 7


def test_rounds_of_an_evaluation_belong_to_its_persons(tmp_path: Path) -> None:
    folder = evaluation(tmp_path / "step_1", {0: 0.0, 1: 0.05})
    source = measured(folder)
    assert [(person.name, person.rounds) for person in source.persons[HARD]] == [("0", 1), ("1", 1)]
    assert source.fatigue[HARD] == pytest.approx({"0": 0.1, "1": 0.2})
    alone = measured(evaluation(tmp_path / "one", {None: 0.0}))
    assert [person.name for person in alone.persons[HARD]] == ["one"]
    # Without results all rounds are of one, except those that say whose they are.
    for name in "xyz":
        logged(tmp_path / "user" / name)
    (tmp_path / "user" / "y" / "person.json").write_text('{"index": 3}')
    found = {person.name: person.rounds for person in measured(tmp_path / "user").persons[HARD]}
    assert found == {"3": 1, "user": 2}


def test_a_user_plays_once(tmp_path: Path, people: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played = []

    def evaluate(user: str, request: Any, on_progress: Any) -> None:
        played.append(request)
        shutil.rmtree(request.out, ignore_errors=True)
        evaluation(request.out, {None: 0.0})

    monkeypatch.setattr(sources, "evaluate", evaluate)
    for _ in range(2):
        found = play("whacamole_constrained", people, tmp_path / "rounds")
        assert [each.name for each in found.users.values()] == ["whacamole_constrained"]
    assert len(played) == 1
    assert played[0].conditions == ["easy", "medium", "hard", "low", "high"]
    assert (played[0].episodes, played[0].seed, played[0].log) == (2, 5, True)
    play("whacamole_constrained", people, tmp_path / "rounds", episodes=3, people=4)
    assert (played[-1].episodes, played[-1].people) == (3, 4)


@pytest.mark.parametrize(
    ("title", "message"),
    [
        (None, r"--recordings: got '.*', expected a session, a folder with states"),
        (
            "condition expert",
            r"--recordings: got '.*' with conditions \['expert'\], expected rounds of whacamole: e",
        ),
        ("condition hard", r"--recordings: got one person \(a\), expected at least two"),
    ],
)
def test_people_that_cannot_be_used(tmp_path: Path, title: str | None, message: str) -> None:
    if title is not None:
        logged(tmp_path / "a" / "r", title=title)
    with pytest.raises(InputError, match=message):
        measured_people(read_people(tmp_path), WHACAMOLE)


def test_users_that_cannot_be_compared(tmp_path: Path, people: Path) -> None:
    place = logged(tmp_path / "a" / "r")
    events = (place / "events.csv").read_text().splitlines()
    for word, message in (
        ("plane", "got none, expected the pose of the targets' plane"),
        ("target_", "no target, expected targets that come up"),
    ):
        (place / "events.csv").write_text("\n".join(e for e in events if word not in e))
        with pytest.raises(InputError, match=message):
            measured(tmp_path / "a")
    folders = [evaluation(tmp_path / name, {None: 0.0}) for name in "bc"]
    with pytest.raises(InputError, match="'u', who played constrained hard in several cells"):
        read_folders("u", folders, WHACAMOLE)
    shutil.rmtree(folders[0] / "logs")
    with pytest.raises(InputError, match="which has rounds without, expected logs of every round"):
        read_user(folders[0])
    message = "'beats_first_lazy', who plays beats, expected a user of whacamole"
    with pytest.raises(InputError, match=message):
        play("beats_first_lazy", people, tmp_path)


def test_the_command(tmp_path: Path, people: Path, capsys: pytest.CaptureFixture[str]) -> None:
    user = evaluation(tmp_path / "user", {0: 0.0, 1: 0.3})
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as ended:
        main(["compare", str(user), "--recordings", str(people), "--out", str(out), "--every"])
    assert not ended.value.code
    shown = capsys.readouterr().out
    assert "hits per" in shown and "tth_median" not in shown
    found = json.loads((out / "comparison.json").read_text())
    (row,) = [r for r in found["users"]["user"]["measures"] if r["measure"] == "hits"]
    assert (row["value"], row["people_mean"], row["inside"], row["persons"]) == (7.0, 7.0, 1.0, 2)
    total = found["users"]["user"]["total"]
    rows = list(csv.DictReader((out / "measures.csv").read_text().splitlines()))
    assert len(rows) == total["cells"]
    inside = sum(float(r["inside"]) for r in rows) / len(rows)
    assert inside == pytest.approx(total["inside"])
    assert found["left_out"]["constrained"]["persons"].keys() == {"a", "b", "c"}
    assert (out / "time_to_hit.png").stat().st_size > 10_000
    assert not (out / "latency.png").exists(), "no condition with one target at a time"


def test_a_study_s_users_are_put_beside_people(
    tmp_path: Path,
    people: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Cells that differ in the condition alone are one user's."""
    factors = {
        "left_out": {"key": "env.frames_per_step", "levels": {"nothing": 5, "rate": 1}},
        "condition": {"key": "condition", "levels": ["easy", "hard"]},
    }
    tree = {"name": "parts", "fixed": {"user": "x"}, "factors": factors, "logs": True}
    cells, root = [], tmp_path / "study"
    for i, (part, condition) in enumerate(product(("nothing", "rate"), ("easy", "hard"))):
        title = f"condition {condition}"
        place = logged(root / f"cells/{i}/logs/r", earlier_s=0.1 * (i // 2), title=title)
        summary = {"rounds": [{"log_folder": str(place.relative_to(root / f"cells/{i}"))}]}
        (root / f"cells/{i}/results.json").write_text(json.dumps({condition: summary}))
        cells.append({"factor_left_out": part, "factor_condition": condition})
        cells[-1]["folder"] = f"cells/{i}"
    data = StudyData(root, parse_study(tree), {})
    data.__dict__["cells"] = pandas.DataFrame(cells)
    played = SimpleNamespace(data=data)
    monkeypatch.setattr("sim2vr_harness.studies.run_study", lambda *_, **__: played)
    file = tmp_path / "parts.yaml"
    file.write_text(json.dumps(tree))
    out = tmp_path / "out"
    command = ["compare", str(file), "--recordings", str(people), "--out", str(out), "--no-figures"]
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert not ended.value.code
    users = json.loads((out / "comparison.json").read_text())["users"]
    times = {
        name: next(row["value"] for row in user["measures"] if row["measure"] == "tth_median")
        for name, user in users.items()
    }
    assert times["nothing"] - times["rate"] == pytest.approx(0.1, abs=1e-4)
    file.write_text(json.dumps(tree | {"logs": False}))
    with pytest.raises(SystemExit):
        main(command)
    assert "got false, expected true: what is compared" in " ".join(capsys.readouterr().err.split())
