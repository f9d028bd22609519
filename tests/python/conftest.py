import io
import signal
import sys
from pathlib import Path

import pytest
import torch
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parent / "training"))  # fake_simulation, true_users
sys.path.insert(0, str(Path(__file__).parent / "play"))  # fake_body, fake_people
sys.path.insert(0, str(Path(__file__).parent / "studies"))  # pool_tasks
sys.path.insert(0, str(Path(__file__).parent / "training" / "run"))  # test_trainer
sys.path.insert(0, str(Path(__file__).parent / "policies"))  # test_visual_actor_critic


@pytest.fixture(autouse=True)
def few_threads():
    """Tiny networks are quickest on one thread, and other tests may run next to these."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(autouse=True, scope="session")
def own_state_folder(tmp_path_factory: pytest.TempPathFactory):
    """Nothing of the tests is remembered in the home of who runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))
        yield


@pytest.fixture(autouse=True, scope="session")
def interruptible():
    """Shells start what runs in the background with SIGINT ignored; tests send it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of the quick stand-in."""
    from fake_simulation import FakeSimulation

    from sim2vr_harness.runs.config import parse_config
    from sim2vr_harness.training.run import trainer

    config = parse_config(
        {
            "total_timesteps": 120,
            "policy": {"net_arch": [16], "vision_features": 8, "proprioception_features": 8},
            "ppo": {"n_envs": 3, "n_steps": 20, "batch_size": 15, "n_epochs": 1},
            "evaluation": {"conditions": ["medium", "hard"], "episodes": 3},
            "env": {"app": {"options": {"condition": "medium", "adaptive": True}}},
        }
    )
    folder = tmp_path_factory.mktemp("runs") / "run"
    trainer.train(
        config,
        folder,
        console=Console(file=io.StringIO()),
        simulation=lambda settings: FakeSimulation(settings.env, settings.ppo.n_envs),
    )
    return folder
