"""CONTRIBUTING.md is true: its commands make a game outside the repository, like any other.

The commands are run as the page has them, with these differences: the build that is there is
installed into a folder instead of the environment, and the training is cut short.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from python.cli.calls import call

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "release"
APP = BUILD / "app_runtime" / "sim2vr-app"

SHORTER = (
    "--set total_timesteps=500 --set skills.q_learning.users=2 "
    "--set skills.q_learning.user_steps=120 --set skills.q_learning.try_steps=60 "
    "--set student.n_envs=2 --set student.frames=64 --set ppo.n_envs=2 --set ppo.n_steps=250 "
    "--set ppo.batch_size=250 --set ppo.n_epochs=1 --set policy.net_arch=[16] "
    "--set evaluation.episodes_after_training=0 --set env.app.options.round_seconds=2.0"
)


def commands() -> list[str]:
    """The commands of "Add a game in an afternoon", in their order."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text.partition("## Add a game")[2].partition("\n## ")[0]
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", section, re.DOTALL | re.MULTILINE)
    return [line.strip() for line in "".join(blocks).splitlines()]


class Author:
    """Someone who writes a game beside the checkout."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.library = folder / "mygame" / "build" / "libmygame.so"
        prefix = folder / "environment"
        (prefix / "bin").mkdir(parents=True)
        install = ("cmake", "--install", str(BUILD), "--component", "development")
        subprocess.run([*install, "--prefix", str(prefix)], check=True, capture_output=True)
        self._environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith("SIM2VR_")},
            "PATH": f"{prefix}/bin:{Path(sys.executable).parent}:{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT / "python"),
            "XDG_STATE_HOME": str(folder / "state"),
            "OMP_NUM_THREADS": "1",
        }

    def run(self, command: str, *, fails: bool = False) -> str:
        """Output of a command of the page; an assertion shows it all when the command fails."""
        command = command.replace("../mygame", f"{self.folder}/mygame")
        command = re.sub(r" (runs|build)/mygame", rf" {self.folder}/\1/mygame", command)
        found = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command],
            cwd=ROOT,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        assert (found.returncode != 0) == fails, f"{command}\n{found.stdout[-6000:]}"
        return found.stdout


@pytest.fixture(scope="module")
def author(tmp_path_factory: pytest.TempPathFactory) -> Author:
    return Author(tmp_path_factory.mktemp("contributing"))


@pytest.fixture(scope="module")
def made(author: Author) -> None:
    """Run the commands up to the first picture, but for those that set the checkout up."""
    for command in commands()[3:-2]:
        author.run(command)
    pictures = {file.stem for file in (author.folder / "build" / "mygame").glob("*.png")}
    assert {"headset", "third_person", "recorder", "overview"} <= pictures


@pytest.mark.slow
@pytest.mark.usefixtures("made")
def test_the_game_is_trained_evaluated_and_filmed(author: Author) -> None:
    train, evaluate = commands()[-2:]
    trained = author.run(train.replace("--out runs/mygame", f"--out runs/mygame {SHORTER}"))
    assert "Saved user" in trained
    table = author.run(evaluate)
    for part in ("Points", "Distance to the ball (m)", "usual", "Muscle fatigue"):
        assert part in table
    run = author.folder / "runs" / "mygame"
    results = next((run / "evaluation").glob("step_*/episodes=2/results.json"))
    content = json.loads(results.read_text())
    assert list(content) == ["usual"]  # the one that it has met
    assert content["usual"]["distance_m"] > 0.0
    assert {file.name for file in results.parent.glob("*.mp4")} == {"usual_0.mp4"}


@pytest.mark.usefixtures("made")
def test_it_plays_as_the_sample_does_in_process_and_in_servers(author: Author) -> None:
    """The same rules in a library and in the runtime give the same numbers, to the bit."""
    code = f"""
import gymnasium, numpy
from sim2vr_harness.client import load_game_library
from sim2vr_harness.envs.config import AppConfig, EnvConfig
assert load_game_library("{author.library}") == ("mygame",)
found = []
for id in ("Mygame", "Sample"):
    for transport in ("in_process", "protocol2"):
        config = EnvConfig(app=AppConfig(transport=transport))
        env = gymnasium.make_vec(f"sim2vr/{{id}}-v0", num_envs=2, config=config, condition="small")
        env.reset(seed=1)
        rng = numpy.random.default_rng(1)
        steps = [env.step(rng.uniform(-1, 1, (2, 32)).astype("float32")) for _ in range(10)]
        found.append([step[1].tolist() for step in steps])
        env.close()
print("same" if found.count(found[0]) == 4 else found)
"""
    assert author.run(f"python -c '{code}'").strip().endswith("same")


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        (
            'const char* sim2vrBuild() { return "sim2vr 0.0.1, headers 0"; } void sim2vrGames() {}',
            "which was built against sim2vr 0.0.1, headers 0, expected",
        ),
        ("void _ZN6sim2vr4goneEv(); void* use = _ZN6sim2vr4goneEv;", "undefined symbol"),
        ("int unrelated;", "a library without games, expected"),
    ],
)
def test_a_library_that_does_not_fit_is_one_clear_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str, problem: str
) -> None:
    file = tmp_path / "other.so"
    (tmp_path / "other.c").write_text(source)
    command = ["cc", "-shared", "-fPIC", "-o", str(file), str(tmp_path / "other.c")]
    subprocess.run(command, check=True, capture_output=True)
    status, _, error = call(capsys, "games", "--game-library", str(file))
    assert (status, error.count("\n")) == (2, 1)
    assert error.startswith(f"error: game_library: got '{file}'") and problem in error
    command = [str(APP), "--game-library", str(file), "--list-games"]
    served = subprocess.run(command, capture_output=True, text=True, check=False)
    assert served.returncode == 2 and problem in served.stderr
