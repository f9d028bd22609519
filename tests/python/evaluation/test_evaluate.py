import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_simulation import FakeSimulation
from rich.console import Console

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import GameFacts, describe_game, facts_of_outside
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation import evaluate as module
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.tables import results_table
from sim2vr_harness.evaluation.training_distribution import unpractised
from sim2vr_harness.play.environment import evaluation_env
from sim2vr_harness.play.round import Round, round_result, summarise
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder

WHACAMOLE = describe_game("whacamole")
METRICS = (
    *("hits", "misses", "contacts", "hit_rate", "hit_speed_mps", "hammer_depth_m"),
    *("max_fatigued", "exertion.nicer_right", "exertion.nicer_left"),
    *("exertion.consumed_endurance_right", "exertion.consumed_endurance_left"),
    *("action_change", "effort", "game_return", "return"),
)
"""Names in results that cards and people's scripts rely on."""


def play_with(trained: Path, request: Request, **how: Any) -> module.Evaluation:
    return evaluate(trained, request, simulation=FakeSimulation, **how)


def result(hits: float, misses: float, **log: float) -> Round:
    return round_result(
        WHACAMOLE,
        condition="medium",
        episode=0,
        seed=1,
        steps=1200,
        game_return=100.0,
        effort=20.0,
        info={"termination": "finished", "max_fatigued": 0.2},
        log={"Points": hits, "Misses": misses, "Contacts": 4.0, **log},
    )


def test_numbers_of_a_round_by_hand() -> None:
    values = result(30.0, 10.0, HitSpeed=1.5, HammerDepthZ=-0.05).values
    assert tuple(values) == METRICS
    expected = {"hit_rate": 0.75, "hit_speed_mps": 1.5, "hammer_depth_m": -0.05, "return": 80.0}
    assert expected.items() <= values.items() and values["max_fatigued"] == 0.2
    empty = result(0.0, 0.0, HitSpeed=0.0).values
    assert (empty["hit_rate"], empty["hit_speed_mps"]) == (None, None), "no hit has no speed"


def test_the_return_s_terms_add_up_and_cells_are_pooled() -> None:
    one = result(
        3.0, 1.0, DistanceRewardSum=-30.0, hitsTarget0=1.0, missesTarget0=3.0, hitsTarget2=2.0
    )
    other = result(3.0, 1.0, DistanceRewardSum=-50.0, hitsTarget0=2.0, missesTarget0=0.0)
    summary = summarise([one, other], WHACAMOLE)
    terms = summary["return_terms"]
    assert terms == {"rest": 140.0, "DistanceReward": -40.0, "effort": -20.0}
    assert sum(terms.values()) == summary["return"]
    assert summary["cell_hit_rates"] == [0.5, None, 1.0, *[None] * 6]


def test_summary_by_hand() -> None:
    summary = summarise(
        [result(30.0, 10.0, HitSpeed=1.5), result(0.0, 10.0, HitSpeed=0.0)], WHACAMOLE
    )
    assert summary["episodes"] == 2
    assert summary["hits"] == 15.0
    assert summary["hits_sd"] == pytest.approx(30.0 / np.sqrt(2))
    assert summary["hit_rate"] == 0.375, "mean of the rounds' rates, as in the study"
    assert summary["hit_rate_pooled"] == 30 / 50
    assert summary["hit_speed_mps"] == 1.5
    assert summary["hit_speed_mps_sd"] is None
    assert summary["hammer_depth_m"] is None


def test_seeds_decide_and_conditions_share_them(trained: Path) -> None:
    one = play_with(trained, Request(seed=5, episodes=2))
    again = play_with(trained, Request(seed=5, episodes=2))
    other = play_with(trained, Request(seed=6, episodes=2))
    assert one.summaries == again.summaries
    # Round k has seed + k.
    batch = play_with(trained, Request(seed=5, episodes=2, batch=1))
    assert batch.summaries == one.summaries, "however many are played side by side"
    first = [r.values for r in one.rounds if r.condition == "medium"]
    second = [r.values for r in other.rounds if r.condition == "medium"]
    assert first[1] == second[0]
    assert first[0] != second[1]
    sampled = one.summaries["medium"]["return"]
    mean = play_with(trained, Request(seed=5, episodes=2, deterministic=True)).summaries
    assert mean["medium"]["return"] != sampled


def test_defaults_come_from_the_run_and_results_are_stored(trained: Path) -> None:
    found = play_with(trained, Request())
    assert (list(found.summaries), found.step) == (["medium", "hard"], 120)
    summary = found.summaries["medium"]
    assert (summary["episodes"], summary["seed"], summary["deterministic"]) == (3, 1, False)
    file = trained / "evaluation" / "step_000000120" / "results.json"
    assert found.files == [file, file.with_name("data")]
    assert json.loads(file.read_text()) == found.summaries


def test_the_environment_can_be_another_than_the_training_s(trained: Path) -> None:
    config = RunFolder(trained).load_config()
    # The curriculum is switched off unless it is set.
    assert evaluation_env(config).config.app.options == {"condition": "medium", "adaptive": False}
    overrides = ["env.user.noise.constant=white", "env.app.options.adaptive=true"]
    changed = evaluation_env(config, overrides=overrides).config
    assert changed.user.noise.constant == "white"
    assert changed.app.options == {"condition": "medium", "adaptive": True}
    kept = changed.model_copy(update={"app": config.env.app, "user": config.env.user})
    assert kept == config.env
    found = play_with(trained, Request(overrides=overrides))
    assert found.summaries["medium"]["overrides"] == overrides
    assert found.summaries["medium"]["effort_weight"] == 0.1
    assert found.summaries["medium"]["game"] == "whacamole"
    folder = "user.noise.constant=white,app.options.adaptive=true"
    place = trained / "evaluation" / "step_000000120" / folder
    # Beside the results without changes.
    assert found.files == [place / "results.json", place / "data"]


def test_bad_requests(trained: Path, tmp_path: Path) -> None:
    for request, message in [
        (Request(episodes=0), r"^--episodes: got 0, expected at least 1"),
        (Request(overrides=["ppo.n_envs=4"]), r"^--set: got 'ppo.n_envs=4', expected env.KEY"),
        (Request(overrides=["env.action_frequency_hz=10"]), r"^environment: got .*trained with"),
        (Request(batch=10**6, episodes=10**6), r"^--batch: got 1,000,000 rounds .* GiB, expected"),
        (Request(conditions=["meduim"]), r"whacamole \(did you mean 'medium'\?\)$"),
        (Request(conditions=["easy", "easy"]), r"^--condition: .* every condition once"),
    ]:
        with pytest.raises(InputError, match=message):
            play_with(trained, request)
    shutil.copytree(trained, tmp_path / "run")
    for file in (tmp_path / "run" / "checkpoints").iterdir():
        file.unlink()
    with pytest.raises(InputError, match="which has no checkpoint yet"):
        play_with(tmp_path / "run", Request())


def test_progress_and_logs(trained: Path, tmp_path: Path) -> None:
    """Every round's log has a folder of its own, whoever played it when."""
    shares: list[float] = []

    class Logging(FakeSimulation):
        """Each app begins a folder per round, as ours do."""

        rounds = None

        def reset(self, ids=None, seeds=None, options=None):
            self.rounds = self.rounds or [0] * self.n
            infos = super().reset(ids, seeds, options)
            for i, seed, info in zip(ids, seeds, infos, strict=True):
                place = self.log_dir / f"user{i:03d}" / f"{self.rounds[i]:04d}-any"
                place.mkdir(parents=True)
                info["seed"] = 1000 + seed
                (place / "states.csv").write_text(f"{self.conditions[i]} {1000 + seed}")
                self.rounds[i] += 1
            return infos

    request = Request(conditions=["easy", "hard"], episodes=3, log=True, out=tmp_path, batch=4)
    found = evaluate(trained, request, simulation=Logging, on_progress=shares.append)
    assert sorted(place.name for place in (tmp_path / "logs").iterdir()) == [
        *("easy_seed1", "easy_seed2", "easy_seed3", "hard_seed1", "hard_seed2", "hard_seed3")
    ]
    for condition, summary in found.summaries.items():
        for row in summary["rounds"]:
            text = (tmp_path / row["log_folder"] / "states.csv").read_text()
            assert text == f"{condition} {row['game_seed']}"
            assert row["game_seed"] == 1000 + row["seed"]
    assert len(found.unread) == 6, "logs of a format of their own are kept, and not in the tables"
    assert found.unread[0].endswith("got 'easy 1001', expected 'condition C, random seed N'")
    assert 0.0 <= min(shares) <= max(shares) <= 1.0
    assert shares[-1] > 0.9


def test_results_are_added_and_never_lost(trained: Path, tmp_path: Path) -> None:
    file = tmp_path / "results.json"
    play_with(trained, Request(conditions=["easy"], episodes=2, out=tmp_path))
    easy = json.loads(file.read_text())["easy"]
    play_with(trained, Request(conditions=["hard"], episodes=3, out=tmp_path))
    content = json.loads(file.read_text())
    assert list(content) == ["easy", "hard"]
    assert content["easy"] == easy
    # The same again is the same.
    play_with(trained, Request(conditions=["easy"], episodes=2, out=tmp_path))
    assert json.loads(file.read_text()) == content
    message = r"^--out: got .* has results of easy with rounds 2, not 3, expected another folder"
    with pytest.raises(InputError, match=message):
        play_with(trained, Request(conditions=["easy"], episodes=3, out=tmp_path))
    shutil.copytree(trained, tmp_path / "other")
    with pytest.raises(InputError, match=r"with user \S+, not other/step_000000120"):
        play_with(tmp_path / "other", Request(conditions=["medium"], out=tmp_path))
    assert json.loads(file.read_text()) == content
    play_with(trained, Request(conditions=["easy"], episodes=3, out=tmp_path, overwrite=True))
    assert json.loads(file.read_text())["easy"]["episodes"] == 3


def test_what_was_never_practised_is_said(trained: Path) -> None:
    """The run practised medium."""
    assert play_with(trained, Request(conditions=["medium"], episodes=1)).unpractised == []
    overrides = [
        *("env.user.noise.constant=white", "env.app.options.life_seconds=2.0", "env.cores=1"),
        "env.user.effort.weight=0.5",  # counts otherwise, and is nothing to practise
    ]
    found = play_with(trained, Request(["medium", "hard"], episodes=1, overrides=overrides))
    assert found.unpractised == [
        "life_seconds = 2.0 (trained: 1.0)",
        "noise.constant = white",
        "condition hard (trained: medium)",
    ]
    # Other senses count, too.
    config = TrainingConfig(name="test")
    senses = [{"sense": "vision", "delay_ms": 100}, {"sense": "proprioception"}, {"sense": "time"}]
    vision = {"fovea": {"gaze": "ahead"}}
    env = EnvConfig.model_validate({"senses": senses, "vision": vision})
    own, resolved = ResolvedEnv(config.env), ResolvedEnv(env)
    assert unpractised(config, own, own, []) == []
    assert unpractised(config, own, resolved, []) == [
        "vision.delay_ms = 100.0 (trained: 0.0)",
        "vision.fovea = yes",
    ]


def test_an_app_that_publishes_nothing_is_measured_by_its_log() -> None:
    facts = facts_of_outside("some_unity_game")
    assert facts == GameFacts("some_unity_game", published=False)
    rounds = [
        round_result(
            facts, condition="a", episode=k, seed=k, steps=9, game_return=1.0, effort=0.5, info={},
            log={"Coins": 3.0 + k, "Lives": 1.0},
        )
        for k in range(2)
    ]  # fmt: skip
    summary = summarise(rounds, facts)
    assert (summary["Coins"], summary["Lives"], summary["return"]) == (3.5, 1.0, 0.5)
    # One that is the runtime's game by name and log is measured as that.
    log = {"Points": 3.0, "Misses": 1.0, "failrateTarget0": 0.0}
    known = facts_of_outside("whacamole").with_log(log)
    assert [measure.name for measure in known.scalars] == ["hits", "misses", "hit_rate"]


@pytest.mark.parametrize(
    ("app", "asked"), [({}, True), ({"transport": "protocol2", "executable": "app"}, False)]
)
def test_a_stranger_s_program_is_not_asked_for_logs(
    trained: Path, tmp_path: Path, app: dict[str, str], asked: bool
) -> None:
    places: list[Path | None] = []

    def simulation(env: Any, n: int, *, log_dir: Path | None = None) -> FakeSimulation:
        places.append(log_dir)
        return FakeSimulation(env, n, log_dir=log_dir)

    request = Request(["easy"], episodes=1, app=app, trust_app=True, out=tmp_path)
    evaluate(trained, request, simulation=simulation)
    assert [place is not None for place in places] == [asked]


def test_a_game_s_own_score_is_beside_the_name_of_its_score() -> None:
    """Beats has a measure ``score``; that name once replaced it, and no table was printed."""
    found = evaluate("beats_first_lazy", Request(episodes=1, conditions=["first"]))
    summary = found.summaries["first"]
    assert summary["score_measure"] == "slice_rate"
    assert summary["score"] == summary["rounds"][0]["log"]["Score"]
    console = Console(width=100, record=True, quiet=True)
    console.print(results_table(found.summaries, found.facts, "Title"))
