"""Measures of rounds that are made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from made_rounds import strikes

from sim2vr_harness.games.registry import behaviour_of
from sim2vr_harness.human_comparison import persons
from sim2vr_harness.human_comparison.grid import Track
from sim2vr_harness.human_comparison.persons import measure_round, persons_of, sparc

WHACAMOLE = behaviour_of("whacamole")


def values_of(*rounds):
    measured = [measure_round(played, WHACAMOLE) for played in rounds]
    ((person,),) = persons_of(measured, WHACAMOLE).values()
    return person.values


@pytest.mark.parametrize(("rate_hz", "tolerance"), [(20.0, 1e-6), (72.0, 0.008)])
def test_a_stroke_of_known_onset(rate_hz: float, tolerance: float) -> None:
    """The velocity jumps between the grid's middles at 0.175 s and 0.225 s after the spawn."""
    values = values_of(strikes(rate_hz))
    near = dict(abs=tolerance)
    assert values["vm_latency"] == pytest.approx(0.175 + 0.1 * 0.05, **near)
    assert values["vm_latency50"] == pytest.approx(0.175 + 0.5 * 0.05, **near)
    assert values["tth_median"] == pytest.approx(0.4, abs=1e-6)
    assert values["fast_hits"] == 0.0
    assert values["ihi_median"] == pytest.approx(0.8, abs=0.5 / rate_hz)
    # The approach speed is not quite constant: the line to a point beside the middle of a segment.
    assert values["strike_onset"] == pytest.approx(0.185, abs=tolerance + 1e-4)
    assert values["strike_time"] == pytest.approx(0.215, abs=tolerance + 1e-4)
    assert values["strike_early"] == 0.0
    assert values["still_at_spawn"] == 1.0
    assert values["depth_at_spawn"] == pytest.approx(-0.15)
    assert 0.178 - tolerance < values["rt_still"] < 0.192 + tolerance, "0.2 m/s of 0.75 to 1.2"
    assert values["wrist_ratio"] == pytest.approx(2.0)
    assert values["hit_speed_game"] == 1.5
    early = values_of(strikes(rate_hz, onset_s=0.05))  # in step with the stroke
    for name in ("vm_latency", "vm_latency50", "strike_onset", "tth_median"):
        assert early[name] - values[name] == pytest.approx(-0.15, abs=tolerance), name
    assert early["strike_early"] == 1.0


def test_speeds_and_places_of_a_stroke_to_the_middle() -> None:
    played = strikes()
    targets = played.targets
    middle = np.zeros(targets.n, dtype=np.int64) + 4
    straight = np.zeros_like(played.tool_m)
    straight[:, 2] = played.tool_m[:, 2]
    played = replace(
        played,
        tool_m=straight,
        root_m=straight / 2.0,
        targets=replace(targets, cell=middle, place_m=np.zeros((targets.n, 2))),
    )
    values = values_of(played)
    assert values["peak_speed"] == pytest.approx(0.15 / 0.2)
    assert values["peak_speed_cv"] == pytest.approx(0.0, abs=1e-9)
    assert values["hit_speed"] == pytest.approx(0.15 / 0.2 / 2.0), "of the root"
    assert values["retreat"] == pytest.approx(-0.15)
    assert values["overshoot"] == pytest.approx(0.0, abs=1e-9), "it turns back at the plane"
    assert values["endpoint_error"] == pytest.approx(0.0, abs=1e-9)
    assert "vm_latency" not in values, "one place has no effect"


def test_counts_by_hand() -> None:
    played = strikes()
    targets = played.targets
    values = values_of(played)
    assert values["hits"] == targets.hit.sum()
    assert values["hit_rate"] == targets.hit.sum() / targets.n
    assert values["contacts_per_hit"] == 7 / targets.hit.sum()
    rates = [targets.hit[targets.cell == c].mean() for c in range(9)]
    assert values["cell_hit_rates"] == pytest.approx(np.mean(rates))
    assert values["worst_cell"] == min(rates)


def moving(velocity, rate_hz: float = 100.0, seconds: float = 30.0) -> Track:
    """A tool with this velocity (T) -> (T, 3), m/s."""
    played = strikes(rate_hz, seconds=seconds)
    speed = velocity(played.times_s)
    path = np.cumsum(speed, axis=0) / rate_hz
    return Track(replace(played, tool_m=path, root_m=path))


def test_speed_and_smoothness_of_known_movements() -> None:
    steady, _ = persons.speeds(moving(lambda t: np.outer(np.ones_like(t), [0.3, 0.0, 0.4])))
    assert steady["mean_speed"] == pytest.approx(0.5)
    assert steady["slow_share"] == 0.0
    for hertz, share in ((1.0, 0.0), (6.0, 1.0)):
        shaking = moving(lambda t, f=hertz: np.outer(np.sin(2 * np.pi * f * t), [1.0, 0.0, 0.0]))
        assert persons.smoothness(shaking)[0]["hf_share"] == pytest.approx(share, abs=0.02)


def test_arc_length_tells_smooth_from_broken_movements() -> None:
    t = np.linspace(0.0, 1.0, 21)
    smooth = 30 * t**2 * (1 - t) ** 2
    broken = smooth * (1.0 + 0.9 * np.sin(2 * np.pi * 5 * t))
    assert -2.0 < sparc(smooth) < -1.4, "minimum jerk: about -1.6"
    assert sparc(broken) < sparc(smooth) - 0.3
    assert np.isnan(sparc(np.zeros(5)))


def test_turning_of_the_head() -> None:
    played = strikes()
    angle = np.radians(20.0) * np.sin(played.times_s)
    head = played.head.copy()
    head[:, 4], head[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
    head[::2, 3:] *= -1.0  # the same rotations
    values, _ = persons.head(Track(replace(played, head=head)))
    assert values["head_rot_p95"] == pytest.approx(20.0, abs=1.5)
    assert values["head_rot_speed"] == pytest.approx(20.0 * 2 / np.pi, abs=0.4)
    assert values["head_range"] == 0.0


def test_which_of_two_targets_is_taken() -> None:
    """Two are up at every hit, and it is the older one that is hit."""
    played = strikes()
    targets = played.targets
    hit = np.ones(targets.n, dtype=np.bool_)
    lasting = replace(targets, end_s=targets.spawn_s + 1.1, hit=hit, missed=~hit)
    values, _ = persons.choices(Track(replace(played, targets=lasting)), alive_after_s=0.1)
    assert values["oldest_first"] == pytest.approx(1.0)
    assert values["choices_share"] == pytest.approx(
        (targets.n - 3) / targets.n, abs=1.5 / targets.n
    )
    single, _ = persons.choices(Track(played), alive_after_s=0.1)
    assert "oldest_first" not in single
