"""The scripts that pages get: linted, and their own parts run in Node."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from parts import needs
from sim2vr_harness.client.webxr import page
from webxr_pages import require_npm

SCRIPTS = Path(page.__file__).parent / "scripts"
RECORDER = SCRIPTS.parents[2] / "tools" / "record" / "recorder.js"
HARNESS = Path(__file__).with_name("page_scripts.mjs")
BIOME = "@biomejs/biome@2.6.8"
RULES = {
    "recommended": False,
    "correctness": {
        "recommended": True,
        "noUnusedVariables": "error",
        "noUnusedFunctionParameters": "error",
        "noUndeclaredVariables": "error",
        "noConstructorReturn": "off",
        "noUnreachableSuper": "off",
    },
    "suspicious": {
        "recommended": True,
        "noAssignInExpressions": "off",
        "noShadowRestrictedNames": "off",  # own.js keeps built-ins under their names
        "useIterableCallbackReturn": "off",
    },
}
pytestmark = needs("npm", shutil.which("node"), "no node")


def asked(scripts: str, case: str, *values: object) -> Any:
    """What a case of ``page_scripts.mjs`` says after scripts ran, which ``own`` precedes."""
    command = ["node", HARNESS, SCRIPTS, f"own,{scripts}", case, json.dumps(values)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


# --- as a whole -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """What a page and a worker get, and the recorder, as files."""
    folder = tmp_path_factory.mktemp("bundles")
    (folder / "page.js").write_text(page.bundle({"seed": 1}, {}))
    (folder / "worker.js").write_text(page.worker_bundle(1))
    (folder / "recorder.js").write_text(f"((window, sim) => {{\n{RECORDER.read_text()}}})();")
    return sorted(folder.glob("*.js"))


def test_the_linter_finds_nothing(bundles: list[Path]) -> None:
    require_npm()
    folder = bundles[0].parent
    settings = {"linter": {"rules": RULES}, "javascript": {"globals": ["arguments"]}}
    (folder / "biome.json").write_text(json.dumps(settings))
    # The worker has the page's own.js, of which it uses a part.
    files = [file.name for file in bundles if file.name != "worker.js"]
    command = ["npm", "exec", "--yes", f"--package={BIOME}", "--", "biome", "lint", *files]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


# --- parts ------------------------------------------------------------------------------------


def test_timers_run_in_the_order_in_which_they_are_due() -> None:
    found = asked("clock", "timers")
    times = {"a": 10, "b": 10, "within": 11, "every": 12, "late": 30}
    expected = [[name, ms, ms] for name, ms in times.items()]
    expected.insert(4, ["every", 24, 24])
    assert found["log"] == [*expected, ["every", 36, 36], ["frame", 45]]
    assert found["errors"] == ["Error: odd"]
    # Still for 100,000 reads in a turn, then 0.01 ms with each.
    assert found["moved"] == pytest.approx((100_102 - 100_000) * 0.01, abs=0.03)


def test_poses_are_those_of_matrices() -> None:
    """Of the app's left-handed frame in WebXR's right-handed one, z mirrored."""
    rng = np.random.default_rng(3)
    rows = [[*rng.normal(size=3), *Rotation.random(random_state=k).as_quat()] for k in range(2)]
    mirror = np.diag([1.0, 1.0, -1.0, 1.0])

    def matrix(row: list[float]) -> np.ndarray:
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = Rotation.from_quat(row[3:]).as_matrix(), row[:3]
        return mirror @ found @ mirror

    a, b = map(matrix, rows)
    found = asked("spaces", "spaces", *rows)
    columns = {name: np.reshape(found[name], (4, 4)).T for name in ("both", "back")}
    np.testing.assert_allclose(columns["both"], a @ b, atol=1e-6)
    np.testing.assert_allclose(columns["back"], np.linalg.inv(a), atol=1e-6)


def test_objects_are_where_the_user_finds_them() -> None:
    """A rig that is twice as large, turned by 90 degrees about y and carried to (3, 0, 1)."""
    found = asked("spaces,objects", "three")
    # From the rig (2, 2, 0) in the world: turned back (0, 2, 2), half as large (0, 1, 1), mirrored.
    assert found[0] == pytest.approx([0.0, 1.0, -1.0])
    assert found[1] == 'no object "bell"; objects with names: ball'


def test_a_step_runs_frames_and_reads_values() -> None:
    found = asked("random,steps", "steps")
    values = {row[0]: row[1:] for row in found["first"]["values"]}
    assert values == {
        "number": [2.5],
        "truth": [True],
        "nothing": [None],
        "list": [[1, 2, 3]],
        "vector": [[1, 2, -3]],  # a page's is right-handed
        "wrong": [0, "is NaN, expected a finite number"],
        "text": [0, "is string, expected a number, true or false, or x y z"],
    }
    assert (found["first"]["failure"], found["first"]["places"]) == (None, [[1, 2, 3], None])
    assert found["calls"] == [False, True, False, False]
    assert found["now"] == pytest.approx(1000 / 60 + 2100)  # ms from the session's first frame
    # The session went without a frame for 2 s.
    assert found["later"]["failure"] == ["idle", "asks for no more frames"]
