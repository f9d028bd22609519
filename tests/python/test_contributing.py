"""CONTRIBUTING.md is true: its commands make a game, which is then like any other.

The commands are run as the page has them, in a copy of the sources, with these differences: what is
set up already is configured instead, only what is asked for below is built and tested, and the
training is cut short.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PYTHON = sys.executable

pytestmark = pytest.mark.skipif(
    not (ROOT / ".git").exists() or shutil.which("ccache") is None or shutil.which("cmake") is None,
    reason="a checkout, cmake and ccache are needed (it builds the runtime in a copy)",
)

SHORTER = {
    "make setup": f"cmake --preset release -DPython_EXECUTABLE={PYTHON} -DSIM2VR_BUILD_BINDINGS=ON",
    "cmake --build --preset release": "cmake --build --preset release --parallel 2 "
    "--target _app_runtime --target sim2vr-app --target test_games",
    "ctest --preset release": "build/release/tests/cpp/games/test_games "
    "--gtest_filter='Registry.*'",
    ".venv/bin/python -m pytest tests/contract": f"{PYTHON} -m pytest -q -p no:cacheprovider "
    "tests/contract/test_app_contract.py -k mygame",
    "--out runs/mygame": "--out runs/mygame --set total_timesteps=500 "
    "--set skills.q_learning.users=2 --set skills.q_learning.user_steps=120 "
    "--set skills.q_learning.try_steps=60 "
    "--set student.n_envs=2 --set student.frames=64 "
    "--set ppo.n_envs=2 --set ppo.n_steps=250 "
    "--set ppo.batch_size=250 --set ppo.n_epochs=1 --set policy.net_arch=[16] "
    "--set evaluation.episodes_after_training=1 --set env.app.options.round_seconds=2.0",
    ".venv/bin/sim2vr-app": "build/release/app_runtime/sim2vr-app",
    ".venv/bin/sim2vr-harness": f"{PYTHON} -m sim2vr_harness.cli.main",
}


def commands() -> list[str]:
    """The commands of "Add a game in an afternoon", in their order."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text.partition("## Add a game")[2].partition("\n## ")[0]
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", section, re.DOTALL | re.MULTILINE)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [line.strip() for line in lines]


class Workplace:
    """A copy of the sources in which commands are run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        listed = ["git", "ls-files", "-co", "--exclude-standard"]
        files = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True)
        for name in files.stdout.splitlines():
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        # An editable install finds this checkout's package before any path is looked at.
        (folder / "python" / "sitecustomize.py").write_text(
            "import sys\n"
            "sys.meta_path[:] = [finder for finder in sys.meta_path\n"
            "                    if not type(finder).__module__.startswith('_editable_')]\n"
        )
        self._environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith("SIM2VR_")},
            "PYTHONPATH": str(folder / "python"),
            "OMP_NUM_THREADS": "1",
        }

    def run(self, command: str) -> str:
        """Output of a shell command; an assertion shows it all when the command fails."""
        found = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command],
            cwd=self.folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        assert found.returncode == 0, f"{command}\n{found.stdout[-6000:]}"
        return found.stdout


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Workplace, dict[str, str]]]:
    place = Workplace(tmp_path_factory.mktemp("contributing"))
    said = {}
    for number, command in enumerate(commands()):
        shorter = command
        for long, short in SHORTER.items():
            shorter = shorter.replace(long, short)
        if number in (1, 2):  # nothing is built yet in the copy; the checkout's was looked at
            continue
        said[command] = place.run(shorter)
    yield place, said
    shutil.rmtree(place.folder / "build", ignore_errors=True)


def test_the_page_has_the_commands() -> None:
    assert commands()[0] == "make setup"
    assert any("snapshot --game mygame" in command for command in commands())


def test_the_game_is_trained_evaluated_and_filmed(
    outputs: tuple[Workplace, dict[str, str]],
) -> None:
    place, said = outputs
    trained = next(text for command, text in said.items() if " train mygame" in command)
    assert "Saved user" in trained
    table = next(text for command, text in said.items() if " evaluate runs/mygame" in command)
    assert "Reward of the app per minute" in trained
    for part in ("Points", "Distance to the ball (m)", "usual", "Muscle fatigue"):
        assert part in table
    for foreign in ("Hit", "hit rate", "Hammer"):
        assert foreign not in table + trained
    run = place.folder / "runs" / "mygame"
    results = next((run / "evaluation").glob("step_*/episodes=2/results.json"))
    content = json.loads(results.read_text())
    assert list(content) == ["usual"]  # the one that it has met
    assert content["usual"]["distance_m"] > 0.0
    assert {file.name for file in results.parent.glob("*.mp4")} == {"usual_0.mp4"}
    pictures = {file.stem for file in (place.folder / "build" / "mygame").glob("*.png")}
    assert {"headset", "third_person", "recorder", "overview"} <= pictures


def test_it_has_an_environment_and_a_server(outputs: tuple[Workplace, dict[str, str]]) -> None:
    place, _ = outputs
    code = """
import gymnasium, numpy, sim2vr_harness.envs
from sim2vr_harness.envs.config import AppConfig, EnvConfig
both = []
for transport in ("in_process", "protocol2"):
    config = EnvConfig(app=AppConfig(transport=transport))
    env = gymnasium.make_vec("sim2vr/Mygame-v0", num_envs=2, config=config, condition="small")
    env.reset(seed=1)
    rng = numpy.random.default_rng(1)
    steps = [env.step(rng.uniform(-1, 1, (2, 32)).astype("float32")) for _ in range(10)]
    both.append([step[1].tolist() for step in steps])
    env.close()
print("same" if both[0] == both[1] else both)
"""
    assert place.run(f"{PYTHON} -c '{code}'").strip() == "same"
