"""What the exertion models say of people's recorded rounds."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from parts import RECORDINGS
from sim2vr_harness.tools.track.paths import read_paths
from sim2vr_harness.users import load_body

ROOT = Path(__file__).parents[2]
ROUNDS = RECORDINGS / "human_rounds"
SECONDS = 10.0


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("exertion", ROOT / "tools/research/exertion.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_high_targets_tire_more_than_low_ones() -> None:
    """As people rated them (docs/evidence/body_and_alignment.md), by every model."""
    paths = []
    for name in ("01_low", "01_high"):
        (path,) = read_paths(ROUNDS / f"{name}.npz")
        some = path.times_s < path.times_s[0] + SECONDS
        hands = {device: poses[some] for device, poses in path.hands.items()}
        assert path.headset is not None
        paths.append(
            replace(path, times_s=path.times_s[some], hands=hands, headset=path.headset[some])
        )
    body = load_body("mobl_arms_wrist", appearance=False)
    low, high = _script().exertion_of(body, paths)
    for model, value in low.items():
        assert 0.0 < value < high[model]
