"""Names of the packages, repr of policies, and errors of what they are given."""

import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest

import sim2vr_harness
import sim2vr_harness.envs  # registers the games
from sim2vr_harness.base.errors import InputError

LAZY = "EnvConfig evaluate load_config load_user_policy read_data read_study run_study train"


def test_lazy_names_are_listed_and_cost_nothing() -> None:
    code = (
        "import sys, sim2vr_harness, sim2vr_harness.training as training;"
        "print(*dir(sim2vr_harness)); print(*dir(training)); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    top, training, loaded = done.stdout.splitlines()
    assert set(LAZY.split()) <= set(top.split())
    assert {"train", "load_config", "TrainingConfig", "SimulationVecEnv"} <= set(training.split())
    assert loaded == "False"


def test_an_unknown_keyword_is_told_what_is_taken() -> None:
    taken = "condition, config, render_mode, log_dir, game"
    with pytest.raises(InputError, match=f"^conditon: .* one of {taken} .*'condition'") as error:
        gymnasium.make("sim2vr/Sample-v0", conditon="big")
    assert "\n" not in str(error.value)
    with pytest.raises(
        InputError, match=r"^wrong: got an unknown keyword, expected one of num_env"
    ):
        gymnasium.make_vec("sim2vr/Sample-v0", num_envs=2, wrong=1)


@pytest.fixture(scope="module")
def user() -> Any:
    return sim2vr_harness.load_user_policy("whacamole_constrained")


def test_other_observations_are_refused_in_a_sentence(user: Any) -> None:
    one = {key: np.zeros(box.shape, box.dtype) for key, box in user.observation_space.items()}
    assert user.predict(one)[0].shape == (32,)
    many = {key: np.stack([value] * 3) for key, value in one.items()}
    assert user.predict(many)[0].shape == (3, 32)
    for wrong in (
        {**one, "vision": np.zeros((1, 80, 120), np.uint8)},
        {**many, "proprioception": np.zeros((3, 86), np.float32)},
        {"vision": one["vision"]},
        {},
    ):
        with pytest.raises(InputError) as error:
            user.predict(wrong)
        expected = "proprioception (56,), stateful_information (1,), vision (2, 80, 120)"
        assert str(error.value).startswith("observation: got ")
        assert str(error.value).endswith(f", expected {expected}")
