import numpy as np
import pytest

from sim2vr_harness.users import MotorNoise, MotorNoiseSettings


def _run(settings: MotorNoiseSettings, ctrl: float, steps: int, seed: int = 3) -> np.ndarray:
    noise = MotorNoise(settings, 1, 32)
    noise.reset([0], [seed])
    return np.stack([noise.apply(np.full((1, 32), ctrl), [0])[0] for _ in range(steps)])


def test_signal_dependent_white_grows_with_the_control() -> None:
    settings = MotorNoiseSettings(signal_dependent="white", constant=None)
    for ctrl in (0.2, 0.5):
        # Standard deviation 0.103 * ctrl; 32 * 2000 draws settle it to about 0.3 %.
        assert (_run(settings, ctrl, 2000) - ctrl).std() == pytest.approx(0.103 * ctrl, rel=0.02)
    assert _run(settings, 0.0, 10).max() == 0.0


def test_red_noise_adds_up() -> None:
    def level(steps: int) -> float:
        ends = [
            _run(MotorNoiseSettings(None, "red", constant_level=0.001), 0.5, steps, seed)[-1, 0]
            for seed in range(300)
        ]
        return float(np.std(ends))

    # A random walk's spread grows with the square root of time: 0.001 * sqrt(steps).
    assert level(4) == pytest.approx(0.002, rel=0.2)
    assert level(16) == pytest.approx(0.004, rel=0.2)


def test_controls_stay_in_range() -> None:
    noisy = _run(MotorNoiseSettings("red", "red"), 0.9, 200)
    assert noisy.min() >= 0.0
    assert noisy.max() <= 1.0


def test_each_user_has_a_stream_of_its_own() -> None:
    settings = MotorNoiseSettings()
    pair, alone = MotorNoise(settings, 2, 4), MotorNoise(settings, 1, 4)
    pair.reset([0, 1], [5, 6])
    alone.reset([0], [6])
    ctrl = np.full((2, 4), 0.5)
    both = pair.apply(ctrl, [0, 1])
    assert (both[0] != both[1]).all()
    np.testing.assert_array_equal(both[1:], alone.apply(ctrl[:1], [0]))
    np.testing.assert_array_equal(ctrl, 0.5)  # the input is left alone
