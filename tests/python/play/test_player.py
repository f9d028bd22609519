"""The loop that plays rounds, its watchers, and who plays."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_simulation import FakeSimulation

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import GameFacts, describe_game
from sim2vr_harness.evaluation.evaluate import Evaluation, Request, evaluate
from sim2vr_harness.play.player import Job, Player, Watcher, play, reward_per_minute
from sim2vr_harness.play.round import Round
from sim2vr_harness.play.users import SimulatedUser
from sim2vr_harness.policies.protocol import FunctionPolicy

WHACAMOLE = describe_game("whacamole")


@pytest.mark.parametrize(("low", "expected"), [(-1.0, 1.5), (0.5, 0.0)])
def test_the_change_of_actions(low: float, expected: float) -> None:
    """A user who swings between two actions, and one who holds still."""
    turn = iter(range(10_000))
    results = play(
        lambda n: FakeSimulation(n=n),
        lambda _: lambda observation, rng: np.full(3, (low, 0.5)[next(turn) % 2], np.float32),
        [Job("easy", 0, 0)],
        WHACAMOLE,
        deterministic=True,
    )
    assert results[0].values["action_change"] == pytest.approx(expected)


def test_users_who_finish_early_rest_while_the_others_play_on() -> None:
    rests: list[list[int]] = []

    class Watched(FakeSimulation):
        def step(self, actions, resting=()):
            rests.append(list(resting))
            return super().step(actions)

    results = play(
        lambda n: Watched(n=n),
        lambda simulation: lambda observation, rng: rng.uniform(-1, 1, 3).astype(np.float32),
        [Job("easy", k, k) for k in range(4)],
        WHACAMOLE,
        deterministic=False,
    )
    assert [r.seed for r in results] == [0, 1, 2, 3]
    assert len({r.steps for r in results}) > 1
    for step, resting in enumerate(rests):
        assert resting == [k for k, r in enumerate(results) if r.steps <= step]


class Still(FunctionPolicy, Watcher):
    """A policy that looks on itself."""

    def measured(self, index: int, result: Round) -> Round:
        return result.with_values({"own": float(index), "both": 1.0})


class Later(Watcher):
    """Adds to what others measured, and notes the rounds as they are in the end."""

    def __init__(self) -> None:
        self.ends: list[tuple[int, Round]] = []

    def measured(self, index: int, result: Round) -> Round:
        return result.with_values({"both": (result.values["both"] or 0.0) + 1.0, "odd": np.inf})

    def ended(self, index: int, result: Round) -> None:
        self.ends.append((index, result))


def still(n: int) -> Still:
    return Still(lambda observation, rng: np.zeros(3, np.float32))


def test_watchers_measure_one_after_the_other_and_see_the_whole_round() -> None:
    later = Later()
    player = Player(FakeSimulation(n=3), still(3), WHACAMOLE, watchers=[later])
    rounds = player.play([Job("easy", k, k) for k in range(3)])
    assert [one.values["own"] for one in rounds] == [0.0, 1.0, 2.0]
    assert {(one.values["both"], one.values["odd"]) for one in rounds} == {(2.0, None)}
    assert sorted(later.ends, key=lambda end: end[0]) == list(enumerate(rounds))
    assert [k for k, _ in later.ends] == sorted(range(3), key=lambda k: rounds[k].steps)


def test_rewards_are_of_a_time_however_many_rounds_that_takes() -> None:
    """Rounds take 6 to 8 steps of 0.05 s; a still user is rewarded with minus its distance."""
    begun: list[int] = []
    distances: list[float] = []

    class Renewed(FakeSimulation):
        def renew(self, outcome: Any) -> list[int]:
            ended = np.flatnonzero(outcome.over).tolist()
            begun.extend(ended)
            distances.append(float(-outcome.game_reward.mean()))
            if ended:
                self.reset(ids=ended)
            return ended

    simulation = Renewed(type("Config", (), {"action_frequency_hz": 20}), 2)
    reward, effort = reward_per_minute(simulation, still(2), [1, 2], 30, deterministic=True)
    assert simulation.total_steps == 30 and len(begun) >= 6
    assert reward == pytest.approx(-np.sum(distances) / (30 / 20 / 60))
    assert effort == 0.0


SHORT = {"game": "sample", "renderer": "null", "options": {"round_seconds": 2.0}}


def played(tmp_path: Path | None, batch: int = 10, **how: Any) -> Evaluation:
    request = Request(["big"], episodes=1, people=2, app=SHORT, batch=batch, out=tmp_path, **how)
    return evaluate("touch Ball", request)


def test_two_persons_follow_a_script_each_for_itself(tmp_path: Path) -> None:
    """Tables, persons and outcomes, whether they play beside each other or not."""
    found, alone = played(tmp_path / "both", log=True), played(tmp_path / "alone", batch=1)
    summary = found.summaries["big"]
    assert (summary["persons"], summary["people"], summary["user"]) == (2, 2, "touch Ball")
    assert [one.person["index"] for one in found.rounds if one.person] == [0, 1]
    first, second = (one.script for one in found.rounds)
    assert first != second, "persons and places of the ball differ"
    assert first[0].changed["Points"][1] > 0.0 and second[0].changed["Points"][1] > 0.0
    for one, other in zip(found.rounds, alone.rounds, strict=True):
        assert (one.script, one.values, one.steps) == (other.script, other.values, other.steps)
    assert found.episodes["steps_done"].tolist() == [
        sum(step.done for step in steps) for steps in (first, second)
    ]
    assert len(found.steps) == sum(one.steps for one in found.rounds)


def test_who_plays_is_found_by_one_name() -> None:
    shipped = SimulatedUser.find("pretrained:whacamole_constrained")
    assert shipped.trained is not None and shipped.name == "whacamole_constrained"
    idle = SimulatedUser.find("still")
    assert idle.trained is None and idle.config.evaluation.episodes == 2
    facts = GameFacts("app")
    assert idle.facts(facts) is facts
    names = ["steps_done", "steps_failed", "step_time", "step_misses"]
    names += ["head_flexion", "head_rotation", "gaze_eccentricity"]
    assert [one.name for one in SimulatedUser.find("press key").facts(facts).measures] == names
    assert SimulatedUser.find("press key").env().config.user.inputs == ("right.trigger",)
    with pytest.raises(InputError, match=r"^--user: got 'touch', expected touch NAME"):
        SimulatedUser.find("touch")
    with pytest.raises(InputError, match=r"did you mean 'whacamole_constrained'"):
        SimulatedUser.find("whacamole_constraind")
