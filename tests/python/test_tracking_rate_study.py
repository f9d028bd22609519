"""tools/research/tracking_rate.py still runs, and its strikes are what it says they are."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

SCRIPT = Path(__file__).resolve().parents[2] / "tools/research/tracking_rate.py"


@pytest.fixture(scope="module")
def study() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tracking_rate", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["tracking_rate"] = module  # its dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module


def test_tables_and_figure(study, tmp_path, capsys) -> None:
    figure = tmp_path / "figure.png"
    study.main(["--strikes", "2", "--speeds", "1", "8", "--out", str(figure)])
    printed = capsys.readouterr().out
    rows = [line for line in printed.splitlines() if line.startswith("  8.00")]
    assert len(rows) == 3  # one per stroke
    assert len(rows[0].split()) == 1 + 4 * 4  # noticed, hits, mean and SD at four rates
    with Image.open(figure) as picture:
        assert picture.size == (1000, 750)


def test_a_strike_through_is_noticed_as_often_as_a_frame_falls_into_it(study) -> None:
    by_rate = {t.hz: study.strike(study.through, 8.0, t, 41) for t in study.TRACKING}
    # Hammer (10 cm) and target (2.5 cm) overlap for 12.5 cm / 8 m/s = 15.6 ms of the 50 ms frame.
    assert by_rate[20].noticed == pytest.approx(0.0156 / 0.050, abs=1 / 41)
    assert by_rate[50].noticed == pytest.approx(0.0156 / 0.020, abs=1 / 41)
    assert by_rate[100].noticed == by_rate[72].noticed == 1.0
    assert all(strikes.hits == strikes.noticed for strikes in by_rate.values())


def test_the_speed_at_the_first_touch(study) -> None:
    """A strike through at 2.5 m/s takes 60 ms to the target; v <- v + 0.5 (raw - v) per frame."""
    at_100_hz = study.strike(study.through, 2.5, study.TRACKING[3], 31)
    # A fraction f of a frame, then 6 whole ones, or 5: 1 - 0.5^6 (1 - f / 2) at least 1 - 0.5^6.
    assert at_100_hz.ratio_mean == pytest.approx(1.0 - 0.5**6 * 0.75, abs=0.25 * 0.5**6)
    person = {t.hz: study.strike(study.bell, 1.5, t, 17).ratio_mean for t in study.TRACKING}
    assert person[20] < 0.75 < person[50] < person[72] < person[100] < 1.0


def test_strokes_by_hand(study) -> None:
    t = np.array([0.0, 0.05, 0.1])
    np.testing.assert_allclose(study.through(t, 2.0), [-0.15, -0.05, 0.05])
    # 5 cm behind the front after 0.1 s, back in front after 0.2 s.
    t = np.array([0.1, 0.2, 0.5])
    np.testing.assert_allclose(study.there_and_back(t, 2.0), [0.05, -0.15, -0.15])
    # 20 cm in 0.25 s: 1.5 m/s in the middle of the way.
    t = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 1.0])
    depth = study.bell(t, 1.5)
    np.testing.assert_allclose(depth, [-0.1, 0.0, 0.1, 0.0, -0.1, -0.1], atol=1e-12)
    speed = np.diff(study.bell(np.array([0.1249, 0.1251]), 1.5)) / 0.0002
    assert speed[0] == pytest.approx(1.5, rel=1e-4)


def test_resampling_by_hand(study) -> None:
    poses = np.array([[0, 1, 2, 0, 0, 0, 1], [1, 1, 4, 0, np.sqrt(0.5), 0, np.sqrt(0.5)]])
    middle = study.resample(np.array([0.0, 2.0]), poses, np.array([1.0]))
    # Half of 90 degrees about y.
    expected = [0.5, 1, 3, 0, np.sin(np.pi / 8), 0, np.cos(np.pi / 8)]
    np.testing.assert_allclose(middle, [expected], atol=1e-12)
