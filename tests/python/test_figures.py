"""The package does not grow back: its figures stay below the limits of tests/figures.yaml."""

import importlib.util
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("figures", ROOT / "tools" / "dev" / "figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_figure_rises_without_a_reason(tool) -> None:
    limits = yaml.safe_load((ROOT / "tests" / "figures.yaml").read_text("utf-8"))
    now = tool.figures(ROOT / "python" / "sim2vr_harness", ROOT / "tests")
    assert set(limits) == set(now)
    risen = [
        f"{name}: got {value:g}, expected at most {limits[name]['limit']:g}; make the package "
        f"plainer, or raise the limit in tests/figures.yaml and say the reason there"
        for name, value in now.items()
        if value > limits[name]["limit"]
    ]
    assert not risen, "\n".join(risen)
    assert all(entry["reason"].strip() for entry in limits.values())


def test_figures_are_counted_as_by_hand(tool, tmp_path: Path) -> None:
    package, tests = tmp_path / "thing", tmp_path / "tests"
    package.mkdir()
    tests.mkdir()
    (package / "__init__.py").write_text("from thing.a import f\n")
    (package / "a.py").write_text(
        "import os\n\ndef f(env):\n    return env.step(_g()) + _h() + _h()\n\n"
        "def _g():\n    return os.name\n\ndef _h():\n    return ResolvedEnv(1)\n"
    )
    (tests / "test_a.py").write_text("\n\n\n")
    assert tool.figures(package, tests) == {
        "lines of the package": 11,
        "lines of Python tests": 3,
        "imports, % of lines": round(100 * 2 / 11, 1),
        "private functions used once, % of functions": round(100 / 3, 1),  # _g of f, _g, _h
        "modules with one importer": 1,
        "places that resolve an environment": 1,
        "calls of step of simulations, users and apps": 1,
        "methods that name state otherwise than state_dict": 0,
    }
