"""Trained users that go on in what a cell plays: the training, the study and who is refused."""

import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from fake_simulation import FakeSimulation
from test_runner import content

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.policies.registry import new_network
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.studies import run_study
from sim2vr_harness.training.ppo.fine_tune import adapting
from sim2vr_harness.training.run import trainer

LIFE = "env.app.options.life_seconds"
SMALL = {
    f"training.ppo.{key}": value
    for key, value in {"n_envs": 2, "n_steps": 10, "batch_size": 10, "n_epochs": 1}.items()
}


def stand_in(config: Any) -> FakeSimulation:
    return FakeSimulation(config.env, config.ppo.n_envs)


def weights_of(run: Path | str) -> dict[str, torch.Tensor]:
    user = find_user(run)
    fake = stand_in(user.config)
    policy = new_network(user, fake.observation_space, fake.action_space)
    user.load(policy)
    return {key: value.clone() for key, value in policy.state_dict().items()}


def study(trained: Path, **changes: Any) -> dict[str, Any]:
    return {
        "name": "adapted",
        "fixed": {"user": str(trained), "condition": "easy", LIFE: 0.7, **SMALL},
        "factors": {"steps": {"key": "adapt", "levels": {"as it is": 0, "gone on": 40}}},
        "episodes": 2,
        "measures": ["hits"],
        "comparisons": [{"factor": "steps"}],
        **changes,
    }


def test_a_user_that_goes_on_begins_with_its_weights(trained: Path, tmp_path: Path) -> None:
    """Also in the folder of a run of another rate; noise is that of the level."""
    changes = ["ppo.learning_rate=0.01", *_small()]
    other = adapting(find_user(trained), str(trained), changes)
    trainer.train(other, tmp_path / "run", timesteps=20, simulation=stand_in)
    # It goes on from its own checkpoint, also when whom it began with is gone.
    gone = other.model_copy(update={"from_user": str(tmp_path / "nowhere")})
    RunFolder(tmp_path / "run").store_config(gone)
    assert trainer.train(gone, tmp_path / "run", resume=True, simulation=stand_in).step == 40
    before, learned = weights_of(trained), weights_of(tmp_path / "run")
    assert not all(torch.equal(before[key], learned[key]) for key in before)
    with pytest.raises(InputError, match=r"RUN: got .*nowhere"):
        trainer.train(gone, tmp_path / "new", simulation=stand_in)
    assert not (tmp_path / "new").exists()
    same = ["ppo.learning_rate=0.0", "policy.log_std_init=-2.5", *_small()]
    config = adapting(find_user(trained), str(trained), same)
    trainer.train(config, tmp_path / "run", overwrite=True, simulation=stand_in)
    after = weights_of(tmp_path / "run")
    assert (after.pop("log_std") == -2.5).all() and (before.pop("log_std") != -2.5).all()
    assert all(torch.equal(before[key], after[key]) for key in before), "nothing was learned"


def _small() -> list[str]:
    small = [f"{key.removeprefix('training.')}={value}" for key, value in SMALL.items()]
    return ["total_timesteps=40", *small]


def test_a_study_adapts_its_user_to_what_it_plays(
    trained: Path, trainings: list[Any], tmp_path: Path
) -> None:
    found = run_study(study(trained), tmp_path / "one", jobs=1)
    ((config, _),) = trainings
    assert (config.recipe, config.total_timesteps, config.ppo.n_envs) == ("adapt", 40, 2)
    assert config.ppo.critic_first_updates == 0
    # What the cell plays: its options, those of its condition, no curriculum.
    options = config.env.app.options
    assert (options["life_seconds"], options["condition"]) == (0.7, "easy")
    assert options["adaptive"] is False
    data = found.data
    steps = dict(zip(data.cells["factor_steps"], data.cells["training"], strict=True))
    assert not isinstance(steps["as it is"], str) and steps["gone on"].startswith("trainings/")
    assert set(data.cells["user"]) == {str(trained)}
    # Before and after it is the same user: n = 1, a pair.
    assert data.episodes["unit"].nunique() == 1
    (result,) = data.statistics["results"]
    assert (result["test"], result["n"]) == ("paired-t", 1) and result["refused"]
    rows = data.episodes.groupby("factor_steps")["trained_steps"].unique()
    assert rows["as it is"].tolist() == [120] and rows["gone on"].tolist() == [40]
    # Again: nothing to do. A copy of the user elsewhere is the same user.
    before = content(tmp_path / "one")
    assert run_study(study(trained), tmp_path / "one", jobs=1).played == 0
    assert content(tmp_path / "one") == before
    shutil.copytree(trained, tmp_path / "elsewhere" / trained.name)
    moved = study(tmp_path / "elsewhere" / trained.name)
    assert run_study(moved, tmp_path / "one", jobs=1).played == 0
    assert len(trainings) == 1


@pytest.mark.parametrize(
    ("fixed", "message"),
    [
        ({"adapt": -1}, r"adapt: got -1, expected user steps, a whole number from 0"),
        # Another body senses and acts otherwise: that is another contract.
        (
            {"adapt": 40, "env.user.model": "mobl_arms_bimanual_motor"},
            r"environment: got user \"mobl_arms_bimanual_motor\".*, which the user in .* was tr",
        ),
        (
            {"adapt": 40, "training.policy.net_arch": [8]},
            r"policy\.net_arch: got \(8,\), expected \(16,\): the network of a user that goes on",
        ),
    ],
)
def test_who_cannot_go_on_is_refused_before_anything_is_trained(
    fixed: dict[str, Any], message: str, trained: Path, trainings: list[Any], tmp_path: Path
) -> None:
    tree = study(trained, factors={"life": {"key": LIFE, "levels": [0.5, 1.0]}}, comparisons=[])
    tree["fixed"] = {"user": str(trained), **fixed}
    with pytest.raises(InputError, match=message):
        run_study(tree, tmp_path / "none", jobs=1)
    assert not trainings and not (tmp_path / "none").exists()
