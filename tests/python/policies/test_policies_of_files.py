"""Policies in Python files (``FILE.py:CLASS``) are evaluated like trained users."""

from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import describe_game
from sim2vr_harness.evaluation.evaluate import Request, evaluate
from sim2vr_harness.evaluation.playing import load_user_policy
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.studies.runner import run_study

EXAMPLES = Path(__file__).resolve().parents[3] / "docs" / "examples"

COUNTING = """
import numpy as np

class Counting:
    config = {"env": {"app": {"game": "sample"}, "max_episode_seconds": 0.5}}
    steps = 7

    def __init__(self, observation_space, action_space):
        self.size = action_space.shape[0]

    def begin(self, n):
        return [0] * n

    def restart(self, memory, users):
        for user in users:
            memory[user] = 0

    def act(self, observations, memory, rngs):
        memory[:] = [count + 1 for count in memory]
        return np.tile(np.array(memory, np.float32)[:, None] / 100, self.size)

    def state_dict(self):
        return {}

class Bare:
    config = Counting.config
    def __init__(self, observation_space, action_space): ...
    def act(self, observations, memory, rngs): ...

class Placeless(Counting):
    config = 3
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(COUNTING)
    return path


def test_a_class_of_a_file_is_evaluated_with_a_memory_per_episode(
    file: Path, tmp_path: Path
) -> None:
    condition = describe_game("sample").default_condition
    request = Request(conditions=[condition], episodes=2, out=tmp_path / "out")
    found = evaluate(f"{file}:Counting", request)
    assert found.step == 7
    assert [len(each) for _, each in found.steps.groupby("episode")] == [10, 10]
    policy = load_user_policy(f"{file}:Counting")
    env = policy.make_env()
    observation, _ = env.reset(seed=0)
    action, memory = policy.predict(observation)
    later, _ = policy.predict(observation, memory)
    env.close()
    assert action[0] == np.float32(0.01)
    assert later[0] == np.float32(0.02)  # the second act of the same episode
    both = {key: np.stack([value, value]) for key, value in observation.items()}
    _, memory = policy.predict(both)
    actions, _ = policy.predict(both, memory, episode_start=np.array([False, True]))
    assert actions[:, 0].tolist() == [np.float32(0.02), np.float32(0.01)]


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Bare", "without begin, restart, state_dict"),
        ("Placeless", "with config 3, expected config"),
    ],
)
def test_what_is_missing_is_named(file: Path, tmp_path: Path, name: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        evaluate(f"{file}:{name}", Request(episodes=1, out=tmp_path / "out"))


def test_a_file_cannot_make_one_run(file: Path, tmp_path: Path) -> None:
    file.write_text(
        COUNTING + f"\nfrom pathlib import Path\nPath({str(tmp_path / 'ran')!r}).touch()\n"
    )
    with pytest.raises(InputError, match=r"Python code.*--trust-app"):
        find_user(f"{file}:Counting")
    study = {
        "name": "mine",
        "fixed": {"user": f"{file}:Counting"},
        "factors": {"seed": {"key": "env.max_episode_seconds", "levels": [0.2, 0.4]}},
        "episodes": 1,
        "measures": ["return"],
    }
    with pytest.raises(InputError, match=r"Python code.*--trust-app"):
        run_study(study, tmp_path / "study", jobs=1)
    assert not (tmp_path / "ran").exists()
    assert run_study(study, tmp_path / "study", jobs=1, trust_app=True).played == 2
