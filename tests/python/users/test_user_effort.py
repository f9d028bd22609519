import numpy as np
import pytest

from python.users.bodies import body
from sim2vr_harness.users import CumulativeFatigue3CCr, make_effort

BODY = body()


def _fatigue(n: int = 1, muscles: int = 1, **params: float) -> CumulativeFatigue3CCr:
    return CumulativeFatigue3CCr(n, muscles, **params)


def _load(level: float, n: int = 1, muscles: int = 1) -> np.ndarray:
    return np.full((n, muscles), level)


def _compartments(model: CumulativeFatigue3CCr) -> list[float]:
    return [float(model.state_dict()[key][0, 0]) for key in ("MA", "MR", "MF")]


def test_build_up_and_development_rate() -> None:
    # TL 0.4 on rested muscles (MA 0, MR 1, MF 0): C = 10 (0.4 - 0) = 4.
    # Bounds: max(-0 + 0, 0/dt + 0) = 0 <= 4 <= min(1/dt, 1/dt) = 20: kept.
    # MA = 4*0.05 = 0.2, MR = 1 - 0.2 = 0.8, MF = F*0*dt = 0. Cost 0.1 |0.2 - 0.4| = 0.02.
    model = _fatigue()
    cost = model.update(_load(0.4), _load(0))
    assert _compartments(model) == pytest.approx([0.2, 0.8, 0.0], abs=1e-15)
    assert cost == pytest.approx([0.02], abs=1e-15)
    # Second step: C = 10 (0.4 - 0.2) = 2; MA += (2 - 0.0146*0.2)*0.05 = 0.1 - 0.000146;
    # MR -= 0.1; MF += 0.0146*0.2*0.05 = 0.000146.
    cost = model.update(_load(0.4), _load(0))
    assert _compartments(model) == pytest.approx([0.299854, 0.7, 0.000146], abs=1e-15)
    assert cost == pytest.approx([0.1 * 0.100146], abs=1e-15)


@pytest.mark.parametrize(
    ("compartments", "load", "expected"),
    [
        # Release: C = 10 (.1 - .5) = -4; rR = 7.5*.0022 = .0165.
        # Lower bound max(-.5/.05 + .0073, (.3-1)/.05 + .0033) = max(-9.9927, -13.9967): kept.
        # MA = .5 + (-4 - .0146*.5)*.05 = .5 - .2 - .000365 = .299635
        # MR = .3 + (4 + .0165*.2)*.05 = .3 + .2 + .000165 = .500165
        # MF = .2 + (.0073 - .0033)*.05 = .2002
        ((0.5, 0.3, 0.2), 0.1, [0.299635, 0.500165, 0.2002]),
        # Beyond the rested units: MR <= TL - MA, so C = 10*MR = 1 (not 4).
        # rR = R = .0022, since MA < TL. MA = .6 + (1 - .00876)*.05 = .649562;
        # MR = .1 + (-1 + .00066)*.05 = .050033; MF = .3 + (.00876 - .00066)*.05 = .300405.
        ((0.6, 0.1, 0.3), 1.0, [0.649562, 0.050033, 0.300405]),
    ],
)
def test_release_and_loads_beyond_the_rested_units(
    compartments: tuple[float, ...], load: float, expected: list[float]
) -> None:
    model = _fatigue()
    pairs = zip(model.state_dict(), (*compartments, 0.0), strict=True)
    model.load_state_dict({key: _load(value) for key, value in pairs})
    model.update(_load(load), _load(0))
    assert _compartments(model) == pytest.approx(expected, abs=1e-15)


def test_drive_is_clipped_so_that_no_compartment_leaves_its_range() -> None:
    # Gain 40: C = 40 min(1, 1) = 40, but MR/dt = 20 allows 20: MA becomes 1, MR 0.
    model = _fatigue(development=40.0)
    assert model.update(_load(1.0), _load(0)) == pytest.approx([0.0], abs=1e-15)
    assert _compartments(model) == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)
    # Gain 40 down to 0: C = -40, floor max(-1/.05 + .0146, -1/.05 + 0) = -19.9854.
    # MA = 1 + (-19.9854 - .0146)*.05 = 0; MR = 19.9854*.05 = .99927; MF = .00073.
    model.relaxation = 40.0
    model.update(_load(0.0), _load(0))
    assert _compartments(model) == pytest.approx([0.0, 0.99927, 0.00073], abs=1e-14)


def test_conservation_and_fatigue_metric() -> None:
    rng = np.random.default_rng(1)
    model = _fatigue(4, 32)
    history = []
    for _ in range(1200):
        model.update(rng.uniform(0, 1, (4, 32)), np.zeros((4, 32)))
        state = model.state_dict()
        total = state["MA"] + state["MR"] + state["MF"]
        np.testing.assert_allclose(total, 1.0, atol=1e-12)
        for key in ("MA", "MR", "MF"):
            assert state[key].min() > -1e-12
            assert state[key].max() < 1 + 1e-12
        history.append(state["MF"])
    expected = np.max(history, axis=0).mean(axis=1)
    np.testing.assert_allclose(model.max_fatigued(), expected, atol=1e-15)
    # A random load of 0.5 for 60 s tires about as much as the SIM2VR paper's users (0.2 to 0.27).
    assert 0.15 < expected.mean() < 0.4


def test_reset_and_update_of_some_users() -> None:
    model = _fatigue(3, 2)
    model.update(_load(1.0, 3, 2), _load(0, 3, 2))
    model.reset([1])
    assert model.state_dict()["MA"][:, 0].tolist() == [0.5, 0.0, 0.5]
    assert model.update(_load(0.5, 1, 2), _load(0, 1, 2), ids=np.array([2])).shape == (1,)
    assert model.state_dict()["MA"][0, 0] == 0.5
    assert model.state_dict()["MA"][2, 0] != 0.5
    assert model.max_fatigued()[1] == 0.0


def test_squares() -> None:
    # Neural: 1e-4 * 32 * 0.5^2 = 8e-4; muscle state: 2 * 32 * 0.25^2 = 4.
    neural, state = make_effort("neural", 2, BODY), make_effort("muscle_state", 2, BODY, weight=2)
    act, ctrl = _load(0.25, 2, 32), _load(0.5, 2, 32)
    assert neural.update(act, ctrl) == pytest.approx([8e-4, 8e-4])
    assert state.update(act, ctrl) == pytest.approx([4.0, 4.0])
    assert np.isnan(neural.max_fatigued()).all()
    assert neural.state_dict() == {}
    assert make_effort("zero", 2, BODY).update(act, ctrl).tolist() == [0.0, 0.0]


def test_consumed_endurance() -> None:
    # DELT1 at 40 % of its 1218.9 N: E = 1236.5 / 25^0.618 - 72.5.
    # ln 25 = 3.2188758, x 0.618 = 1.9892653, e^ = 7.310160; 1236.5 / 7.310160 = 169.14814;
    # E = 96.64814 s; cost = 0.01 * 100 * 0.05 / 96.64814 = 5.17341e-4.
    model = make_effort("consumed_endurance", 4, BODY)
    force = np.zeros((4, 32))
    force[0, BODY.muscles.index("DELT1")] = -0.4 * 1218.9
    force[1, BODY.muscles.index("DELT1")] = -0.15 * 1218.9  # endless endurance
    force[2, BODY.muscles.index("PECM1")] = -400.0  # does not lift
    force[3, BODY.muscles.index("TRImed")] = 3 * 717.5  # pushed beyond its peak: counts as 1
    cost = model.update(_load(0, 4, 32), _load(0, 4, 32), force)
    assert cost[:3] == pytest.approx([5.17341e-4, 0.0, 0.0], rel=1e-5)
    # E(1) = 1236.5 / 85^0.618 - 72.5; ln 85 = 4.4426513, x 0.618 = 2.7455585, e^ = 15.573310;
    # 1236.5 / 15.573310 = 79.39866; E = 6.89866 s; cost = 0.05 / 6.89866 = 7.24779e-3.
    assert cost[3] == pytest.approx(7.24779e-3, rel=1e-4)
    with pytest.raises(ValueError, match=r"force: got None, expected shape \(4, 32\)"):
        model.update(_load(0, 4, 32), _load(0, 4, 32))


@pytest.mark.parametrize(
    ("name", "params", "message"),
    [
        ("neural", {"weight": -1}, "weight: got -1, expected a finite number, at least 0"),
        ("cumulative_fatigue_3ccr", {"dt": 0}, "dt: got 0, expected a finite number above 0"),
        ("neural", {"rate": 1}, r"effort neural: got parameters \['rate'\]"),
    ],
)
def test_factory_errors(name: str, params: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_effort(name, 1, BODY, **params)
