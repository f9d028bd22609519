"""Our headset view looks like the published one, as headset_comparison.py shows."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "tools/research/headset_comparison.py"


@pytest.fixture(scope="module")
def script() -> Any:
    spec = importlib.util.spec_from_file_location("headset_comparison", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def views(script: Any) -> list[Any]:
    return [script.play(moment) for moment in script.MOMENTS]


# Colours of the published figure, read at the same spots. 6 of 255 levels: the figure was scaled
# and has a palette.
@pytest.mark.parametrize(
    ("moment", "x", "y", "color"),
    [
        pytest.param(0, 60, 40, (131, 151, 167), id="sky"),
        pytest.param(0, 60, 240, (202, 189, 164), id="ground"),
        pytest.param(0, 280, 147, (220, 240, 159), id="through the area, horizon"),
        pytest.param(1, 179, 129, (22, 234, 12), id="fresh target"),
        pytest.param(1, 179, 213, (112, 135, 10), id="middle-aged target"),
        pytest.param(1, 346, 133, (235, 31, 27), id="old target"),
    ],
)
def test_colours_are_those_of_the_published_picture(
    views: list[Any], moment: int, x: int, y: int, color: tuple[int, int, int]
) -> None:
    spot = views[moment][y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1))
    assert spot == pytest.approx(color, abs=6)
