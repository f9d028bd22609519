"""One small page with many versions of three.js and A-Frame, which npm brings."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from webxr_pages import NEEDS_BROWSER, ROOT, require_npm

pytestmark = NEEDS_BROWSER


def _matrix() -> ModuleType:
    file = ROOT / "tools" / "research" / "engine_matrix.py"
    spec = importlib.util.spec_from_file_location("engine_matrix", file)
    assert spec is not None and spec.loader is not None
    module = sys.modules["engine_matrix"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MATRIX = _matrix()


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require_npm()
    folder: Path = tmp_path_factory.mktemp("engines")
    return folder


@pytest.mark.parametrize("spec", MATRIX.VERSIONS)
def test_a_version_plays(packages: Path, spec: str) -> None:
    """The cube has its colour and depth, and the ray moves with the controller."""
    assert MATRIX.play(spec, packages) == "plays"
