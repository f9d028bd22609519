"""SAC as a stage of a run: learns, is stopped and resumed exactly, and its user plays and packs."""

from __future__ import annotations

import io
import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from fake_simulation import FakeSimulation
from rich.console import Console
from test_trainer import member, rows_without_times

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.finite import NotFinite
from sim2vr_harness.cli.main import main
from sim2vr_harness.policies.registry import SquashedPolicy, load_policy, new_network
from sim2vr_harness.policies.store import find_user, open_packed, pack
from sim2vr_harness.runs.config import TrainingConfig, parse_config
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.run import trainer
from sim2vr_harness.training.sac import stage as sac

QUIET = Console(file=io.StringIO())


def tiny(**changes: Any) -> TrainingConfig:
    tree = {
        "recipe": "sac",
        "total_timesteps": 600,
        "device": "cpu",
        "policy": {"net_arch": [16], "vision_features": 8, "proprioception_features": 8},
        "ppo": {"n_envs": 3},
        "sac": {"buffer_size": 150, "learning_starts": 20, "batch_size": 8, "train_freq": 2},
        "checkpoint": {"every_steps": 60},
    }
    return parse_config(tree | changes)


def run(folder: Path, stop: int, config: TrainingConfig | None = None, **how) -> Any:
    """Train; ``at_step`` is called before every step of the users, ``reward`` for what it earns."""
    at_step = how.pop("at_step", lambda made: None)
    reward = how.pop("reward", None)

    def simulation(settings: TrainingConfig) -> FakeSimulation:
        made = FakeSimulation(settings.env, settings.ppo.n_envs)
        step = made.step

        def noted(actions: np.ndarray) -> Any:
            at_step(made)
            result = step(actions)
            if reward is not None:
                result.reward[:] = reward(actions)
            return result

        made.step = noted
        return made

    return trainer.train(
        config or tiny(), folder, timesteps=stop, console=QUIET, simulation=simulation, **how
    )


def assert_same(one: Any, other: Any, at: str = "") -> None:
    """Compare nested mappings and lists of tensors and values, to the bit."""
    if isinstance(one, torch.Tensor):
        assert torch.equal(one, other), at
    elif isinstance(one, dict):
        assert one.keys() == other.keys(), at
        for key in one:
            assert_same(one[key], other[key], f"{at}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), at
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{at}.{k}")
    else:
        assert one == other, at


def assert_same_learner(one: Path, other: Path) -> None:
    for name in ("policy.pth", "policy.optimizer.pth"):
        assert_same(member(one, name), member(other, name))
    replays = [next(file.parent.glob("replay_*.npz")) for file in (one, other)]
    assert replays[0].name == replays[1].name
    with np.load(replays[0]) as a, np.load(replays[1]) as b:
        assert set(a.files) == set(b.files)
        for key in a.files:
            np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def test_resumed_equals_uninterrupted_bit_for_bit(tmp_path: Path) -> None:
    """Stopped in the warm-up, by Ctrl-C within an iteration, and at an end; 180 steps overflow
    the replay buffer of 150."""
    whole = run(tmp_path / "whole", 240)
    parts = tmp_path / "parts"
    assert run(parts, 12).step == 12

    def interrupt(made: FakeSimulation) -> None:
        if made.total_steps == 31:  # 93 user steps later, in the second half of an iteration of 6
            os.kill(os.getpid(), signal.SIGINT)

    cut = run(parts, 240, at_step=interrupt, resume=True)
    assert cut.interrupted
    assert (cut.step, cut.lost_steps) == (12 + 96, 0), "the iteration that was begun counts"
    last = run(parts, 240, resume=True)
    assert last.step == whole.step == 240
    assert_same_learner(whole.checkpoint, last.checkpoint)
    assert rows_without_times(tmp_path / "whole") == rows_without_times(parts)
    assert [s["status"] for s in RunFolder(parts).metadata()["sessions"]] == [
        "finished",
        "interrupted",
        "finished",
    ]


def test_a_crash_goes_back_to_the_last_checkpoint(tmp_path: Path) -> None:
    def crash(made: FakeSimulation) -> None:
        if made.total_steps == 45:
            raise RuntimeError("engine fault")

    whole = run(tmp_path / "whole", 180)
    with pytest.raises(RuntimeError, match="engine fault"):
        run(tmp_path / "run", 180, at_step=crash)
    assert RunFolder(tmp_path / "run").step == 120
    again = run(tmp_path / "run", 180, resume=True)
    assert_same_learner(whole.checkpoint, again.checkpoint)


def test_what_a_run_holds(tmp_path: Path) -> None:
    result = run(tmp_path / "run", 200, tiny(checkpoint={"every_steps": 60, "keep": 2}))
    assert result.step == 204, "rounded up to iterations of 6 user steps"
    files = sorted(file.name for file in result.folder.checkpoint_dir.iterdir())
    assert files == ["replay_000000204.npz", "step_000000180.zip", "step_000000204.zip"]
    rows = result.folder.metrics()
    assert rows[-1]["step"] == 204
    # 20 steps of warm-up end with the fourth iteration, an update of one minibatch each follows.
    assert rows[-1]["train/n_updates"] == 204 / 6 - 3
    assert {"rollout/ep_rew_mean", "rollout/ep_Points_mean"} <= rows[-1].keys()


def test_the_user_plays_and_is_packed(tmp_path: Path) -> None:
    result = run(tmp_path / "run", 120)
    user = find_user(result.folder.path)
    fake = FakeSimulation(n=1)
    fake.reset(seeds=[5])
    observation = {key: value[0] for key, value in fake.observation().items()}
    policy, steps = load_policy(user, fake.observation_space, fake.action_space)
    assert steps == 120
    assert isinstance(policy, SquashedPolicy)
    network: Any = new_network(user, fake.observation_space, fake.action_space)
    user.load(network)
    batch = {key: torch.from_numpy(value[None]) for key, value in observation.items()}
    with torch.no_grad():
        _, log_std, _ = network.get_action_dist_params(batch)
        own = network(batch, deterministic=True)[0].numpy()
    np.testing.assert_allclose(policy.act(observation, None, None), own, rtol=1e-6)
    drawn = [policy.act(observation, None, np.random.default_rng(k)) for k in range(4000)]
    spread = np.arctanh(np.clip(drawn, -1 + 1e-6, 1 - 1e-6)).std(axis=0)
    np.testing.assert_allclose(spread, log_std.exp()[0], rtol=0.06)
    pack(user, network, tmp_path / "packed", "tester", {"recipe": "sac"})
    packed, _ = load_policy(
        open_packed(tmp_path / "packed"), fake.observation_space, fake.action_space
    )
    np.testing.assert_allclose(packed.act(observation, None, None), own, atol=0.01)


def test_the_seed_decides(tmp_path: Path) -> None:
    same = [run(tmp_path / name, 60).checkpoint for name in "ab"]
    assert_same_learner(*same)
    other = run(tmp_path / "c", 60, tiny(seed=2)).checkpoint
    with pytest.raises(AssertionError):
        assert_same_learner(same[0], other)


def test_it_learns(tmp_path: Path) -> None:
    """A step earns its first action: 0 in the mean of random ones, 1 at best, of 6 to 8 steps."""
    config = tiny(
        total_timesteps=2400,
        sac={"learning_rate": 1e-2, "learning_starts": 900, "batch_size": 64, "ent_coef": 0.01},
        checkpoint={"every_steps": 2400},
    )
    rows = run(
        tmp_path / "run", 2400, config, reward=lambda actions: actions[:, 0]
    ).folder.metrics()
    means = [row["rollout/ep_rew_mean"] / row["rollout/ep_len_mean"] for row in rows[3:]]
    played = [row["step"] for row in rows[3:]]
    assert abs(means[played.index(900)]) < 0.15
    assert means[-1] > 0.7


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"buffersize": 5}, r"^sac\.buffersize: got an unknown key, expected .*'sac\.buffer_size'"),
        ({"policy": "x"}, r"^sac\.policy: got an unknown key"),
        ({"tau": 2.0}, r"^sac\.tau: got 2\.0, expected a number from 0 to 1$"),
        ({"batch_size": 2.5}, r"^sac\.batch_size: got 2\.5, expected a whole number from 1"),
        ({"gamma": "high"}, r"^sac\.gamma: got 'high', expected a number"),
        ({"ent_coef": "manual"}, r"^sac\.ent_coef: got 'manual', expected .*, or auto$"),
        ({"train_freq": True}, r"^sac\.train_freq: got True, expected a whole number"),
    ],
)
def test_wrong_arguments_are_named(tmp_path: Path, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(tmp_path / "run", 60, tiny(sac=arguments))
    assert not (tmp_path / "run").exists()


def test_arguments_reach_sac() -> None:
    found = sac.checked_arguments({"learning_rate": "1e-3", "ent_coef": "auto_0.1", "tau": 1})
    assert found == {"learning_rate": 0.001, "ent_coef": "auto_0.1", "tau": 1.0}


def test_a_replay_buffer_that_no_machine_holds(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^sac\.buffer_size: got 1,000,000,000, which needs"):
        run(tmp_path / "run", 60, tiny(sac={"buffer_size": 1_000_000_000}))


def test_a_damaged_replay_buffer_is_set_aside(tmp_path: Path) -> None:
    result = run(tmp_path / "run", 60)
    replay = next(result.folder.checkpoint_dir.glob("replay_*.npz"))
    replay.write_bytes(replay.read_bytes()[:100])
    with pytest.raises(InputError, match=r"replay_000000060\.npz.*--set-aside"):
        run(tmp_path / "run", 120, resume=True)
    assert run(tmp_path / "run", 120, resume=True, set_aside=True).step == 120
    assert replay.with_name(replay.name + ".aside").is_file()


def test_weights_that_are_not_finite_are_not_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path / "run", 60)
    original = sac._SAC.train

    def spoil(self: sac._SAC, *args: Any, **more: Any) -> None:
        original(self, *args, **more)
        next(iter(self.critic.parameters())).data.fill_(float("nan"))

    monkeypatch.setattr(sac._SAC, "train", spoil)
    with pytest.raises(NotFinite, match=r"not finite after 72 user steps.*step_000000060\.zip"):
        run(tmp_path / "run", 240, resume=True)
    assert RunFolder(tmp_path / "run").step == 60


def test_a_user_of_sac_cannot_go_on_with_ppo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = run(tmp_path / "run", 60).folder
    with pytest.raises(SystemExit) as ended:
        main(["train", "--from", str(folder.path), "--out", str(tmp_path / "more")])
    assert ended.value.code != 0
    assert "from_user" in capsys.readouterr().err
    assert json.loads((folder.path / "run.json").read_text())["sessions"]
