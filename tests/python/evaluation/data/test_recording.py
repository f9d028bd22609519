"""Real rounds of several games, played by users who know nothing, in tables."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import Condition, GameFacts, describe_game
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.data import EvaluationData
from sim2vr_harness.evaluation.evaluate import DataRecorder
from sim2vr_harness.play.player import jobs_for, play
from sim2vr_harness.play.recorders import RoundLogs
from sim2vr_harness.play.round import Round

STEPS = 30
TWO_HANDS = {"model": "mobl_arms_bimanual_motor", "effort": {"model": "neural"}}
SETTINGS = {"user": "nobody", "deterministic": False, "overrides": []}


def played(
    game: str, out: Path, episodes: int = 2, **options: Any
) -> tuple[list[Round], EvaluationData, GameFacts]:
    env = EnvConfig.model_validate(
        {
            "app": {"game": game, "options": options, "renderer": "null"},
            "user": TWO_HANDS if game == "beats" else {},
            "senses": [{"sense": "proprioception"}],
            "max_episode_seconds": STEPS / 20,
        }
    )
    facts = describe_game(game)
    logs = RoundLogs(out / "logs")
    recorder = DataRecorder(out, facts, env, moments=True)

    def act(simulation: Simulation) -> Any:
        size = simulation.action_space.shape
        return lambda observation, rng: rng.uniform(-1, 1, size).astype(np.float32)

    rounds = play(
        lambda n: Simulation(env, n, log_dir=logs.folder()),
        act,
        jobs_for([Condition("any")], episodes, 1),
        facts,
        deterministic=False,
        watchers=[logs, *recorder.watchers],
    )
    rounds = logs.settle(rounds, out)
    recorder.take_logs(rounds)
    recorder.finish(rounds, SETTINGS, 0.1)
    assert recorder.unread == []
    return rounds, EvaluationData(recorder.root), facts


@pytest.mark.parametrize("game", ["whacamole", "beats", "pointing", "sample"])
def test_every_game_s_rounds_become_tables(game: str, tmp_path: Path) -> None:
    rounds, data, facts = played(game, tmp_path)
    episodes = data.episodes.set_index("episode")
    assert list(episodes.index) == ["any_seed1", "any_seed2"]
    steps = data.steps()
    for result in rounds:
        row = episodes.loc[result.key]
        own = steps[steps["episode"] == result.key]
        assert own["step"].tolist() == list(range(1, STEPS + 1))
        assert own["time_s"].iloc[-1] == pytest.approx(STEPS / 20)
        # What the steps add up to is what the episode says.
        assert own["effort_cost"].sum() == pytest.approx(row["effort"], rel=1e-5)
        assert own["game_reward"].sum() == pytest.approx(row["game_return"], rel=1e-5, abs=1e-5)
        assert own["reward"].sum() == pytest.approx(row["return"], rel=1e-5, abs=1e-5)
        for measure in facts.scalars:
            assert measure.name in episodes.columns
        for term in facts.reward_terms:
            told = result.log.get(term.sum_key)
            if told is not None:
                total = own[f"term_{term.log_key.lower()}"].sum()
                # Pointing's sum has the frame of the reset, too, before the first step.
                before = -0.1 if game == "pointing" and term.log_key == "DistanceReward" else 0.0
                assert total == pytest.approx(told - before, abs=1e-3)
    if game != "sample":  # which writes no log of poses; those of the others say the same
        both = data.frames().merge(steps, on=["episode", "step"], suffixes=("", "_step"))
        assert len(both) == 2 * STEPS
        for name in ("head_x_m", "right_x_m", "right_z_m", "right_qw"):
            np.testing.assert_array_equal(both[name], both[f"{name}_step"])
    told = data.dictionary
    for name, table in (("episodes", data.episodes), ("steps", steps)):
        assert told[told["table"] == name]["column"].tolist() == table.columns.tolist()
    assert (told["description"] != "").all()


def test_joints_muscles_and_fatigue(tmp_path: Path) -> None:
    _, data, _ = played("whacamole", tmp_path, episodes=1)
    steps = data.steps()
    assert steps["q_elbow_flexion"].between(-0.2, 2.5).all()
    assert np.ptp(steps["q_elbow_flexion"]) > 0.01
    assert steps["act_DELT1"].between(0.0, 1.0).all()
    assert steps["force_DELT1"].max() <= 0.0, "muscles pull"
    # Motor units are active, resting or fatigued.
    whole = steps["active_DELT1"] + steps["resting_DELT1"] + steps["fatigued_DELT1"]
    np.testing.assert_allclose(whole, 1.0, atol=1e-5)
    assert (np.diff(steps["most_fatigued_DELT1"]) >= 0.0).all()
    worst = steps.filter(regex="^most_fatigued_").iloc[-1].mean()
    assert worst == pytest.approx(data.episodes["max_fatigued"].iloc[0], rel=1e-5)
    # The velocity is the angle's slope, to first order.
    slope = np.gradient(steps["q_elbow_flexion"], 0.05)
    assert np.corrcoef(slope[1:-1], steps["qd_elbow_flexion"][1:-1])[0, 1] > 0.8


def test_items_of_a_round_agree_with_its_measures(tmp_path: Path) -> None:
    rounds, data, _ = played("whacamole", tmp_path, episodes=1, condition="hard", life_seconds=0.2)
    events = data.events
    ends = events["outcome"].value_counts()
    assert ends.get("miss", 0) == rounds[0].values["misses"] > 0
    assert ends.get("hit", 0) == rounds[0].values["hits"]
    missed = events[events["outcome"] == "miss"]
    # Grows for 0.1 s, lives for 0.2 s; the log's times are frames' and fixed steps'.
    assert missed["latency_s"].between(0.25, 0.35).all()
    assert events["cell"].between(0, 8).all()
    assert events[["x_m", "y_m", "z_m"]].notna().all().all()
