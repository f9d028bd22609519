"""Several people play: who plays which round, and means over people, not over rounds."""

import json
from pathlib import Path

import numpy as np
import pytest
from fake_people import FakePeople

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import Condition, describe_game
from sim2vr_harness.envs.config import EnvConfig, NoiseConfig, UserConfig
from sim2vr_harness.envs.people_preset import as_population, with_people
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.play.player import jobs_for
from sim2vr_harness.play.round import Round, round_result, summarise
from sim2vr_harness.users import PeopleSettings, Population

WHACAMOLE = describe_game("whacamole")


def result(points: float, person: int | None, episode: int = 0) -> Round:
    fields = None if person is None else Population(PeopleSettings()).number(person).as_dict()
    return round_result(
        WHACAMOLE,
        condition="medium",
        episode=episode,
        seed=1,
        steps=10,
        game_return=0.0,
        effort=0.0,
        person=fields,
        info={"termination": "finished"},
        log={"Points": points, "Misses": 0.0},
    )


def test_means_are_over_people_each_with_the_mean_of_its_rounds() -> None:
    rounds = [result(10.0, 0), result(20.0, 0), result(30.0, 0), result(50.0, 1)]
    summary = summarise(rounds, WHACAMOLE)
    assert (summary["persons"], summary["episodes"]) == (2, 4)
    # Persons have 20 and 50: mean 35, deviation 30 / sqrt(2). Over rounds it would be 27.5.
    assert summary["hits"] == pytest.approx(35.0)
    assert summary["hits_sd"] == pytest.approx(30.0 / np.sqrt(2.0))
    alone = summarise([result(10.0, 0), result(20.0, 0)], WHACAMOLE)
    assert (alone["hits"], alone["hits_sd"]) == (15.0, None)
    alike = summarise([result(10.0, None), result(20.0, None)], WHACAMOLE)
    assert "persons" not in alike and alike["hits_sd"] == pytest.approx(10.0 / np.sqrt(2.0))
    assert "person" not in result(1.0, None).as_dict()


def test_who_plays_which_round() -> None:
    jobs = jobs_for([Condition("easy", {}), Condition("hard", {})], 2, 10, people=3)
    easy = [(job.person, job.seed, job.episode) for job in jobs if job.condition == "easy"]
    assert easy == [(0, 10, 0), (0, 11, 1), (1, 12, 2), (1, 13, 3), (2, 14, 4), (2, 15, 5)]


def test_people_of_a_seed_play(trained: Path, tmp_path: Path) -> None:
    request = {"conditions": ["medium"], "people": 3, "episodes": 2, "seed": 7, "log": True}
    found = evaluate(trained, Request(**request, out=tmp_path), simulation=FakePeople)
    rows = json.loads((tmp_path / "results.json").read_text())["medium"]["rounds"]
    assert [row["person"] for row in rows] == [0, 0, 1, 1, 2, 2]
    # Longer rounds are those of higher numbers: each was played by whom the row says.
    assert [row["steps"] for row in rows] == [6, 6, 7, 7, 8, 8]
    everybody = Population(PeopleSettings(seed=7, strength=1.28))
    for row in rows:
        person = everybody.number(row["person"]).as_dict()
        assert row["person_fields"] == {key: person[key] for key in person if key != "index"}
        folder = tmp_path / row["log_folder"]
        assert folder.name == f"medium_person{row['person']}_seed{row['seed']}"
        assert json.loads((folder / "person.json").read_text()) == person
    summary = found.summaries["medium"]
    told = {key: summary[key] for key in ("people", "persons", "episodes", "seed")}
    assert told == {"people": 3, "persons": 3, "episodes": 2, "seed": 7}
    new = {line.partition(" ")[0] for line in found.unpractised}
    noise = {f"noise.{name}" for name in NoiseConfig.model_fields}
    assert new == {"people", *noise}
    with pytest.raises(InputError, match=r"with people 3, not 2, expected another folder"):
        evaluate(trained, Request(**request | {"people": 2}, out=tmp_path), simulation=FakePeople)
    batches = evaluate(
        trained, Request(**request, out=tmp_path / "other", batch=4), simulation=FakePeople
    )
    assert [one.values for one in batches.rounds] == [one.values for one in found.rounds]


def test_training_and_evaluation_have_the_same_people() -> None:
    """One average in strength and one motor noise; what a user has or ``--set`` names stays."""
    learned = as_population(UserConfig(), 12)
    played = with_people(ResolvedEnv(EnvConfig()), 12, 0).config.user
    assert played.people == learned.people
    assert played.noise == learned.noise != NoiseConfig()
    assert (played.person, played.head) == (UserConfig().person, UserConfig().head)
    silent = with_people(
        ResolvedEnv(EnvConfig()), 2, 5, ["env.user.noise.constant=null"]
    ).config.user
    assert silent.noise == NoiseConfig()
    own = ResolvedEnv(EnvConfig(user={"people": {"strength": 1.0, "spread": 0.5}}))
    user = with_people(own, 3, 7).config.user
    assert user.people == PeopleSettings(strength=1.0, spread=0.5, seed=7, count=3)
    assert user.noise == NoiseConfig()
