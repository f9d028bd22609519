"""Measures of recorded people, against figures that were published of the same recordings."""

import numpy as np
import pytest

from parts import RECORDINGS
from sim2vr_harness.games.registry import behaviour_of
from sim2vr_harness.human_comparison.comparing import left_out, total
from sim2vr_harness.human_comparison.sources import (
    Source,
    measured_people,
    measured_user,
    read_people,
    read_user,
)

ROUNDS = RECORDINGS / "human_rounds"
WHACAMOLE = behaviour_of("whacamole")

# (condition, measure): mean, least and greatest of six people, facts "How people play".
CONSTRAINED = {
    ("easy", "hits"): (70.8, 58, 82),
    ("easy", "tth_median"): (0.458, 0.395, 0.511),
    ("easy", "vm_latency"): (0.193, 0.183, 0.203),
    ("easy", "vm_latency50"): (0.271, 0.246, 0.326),
    ("easy", "strike_early"): (0.0743, 0, 0.274),
    ("easy", "strike_onset"): (0.302, 0.229, 0.356),
    ("easy", "strike_time"): (0.145, 0.11, 0.164),
    ("easy", "forward_at_spawn"): (-0.383, -0.689, -0.141),
    ("easy", "still_at_spawn"): (0.117, 0.025, 0.314),
    ("easy", "fitts_slope"): (0.0912, -0.312, 0.479),
    ("medium", "hit_rate"): (0.841, 0.65, 0.995),
    ("medium", "worst_cell"): (0.626, 0.174, 0.962),
    ("medium", "contacts_per_hit"): (0.273, 0.0424, 0.666),
    ("medium", "ihi_cv"): (0.335, 0.182, 0.535),
    ("medium", "hit_speed"): (1.61, 1.17, 2.17),
    ("medium", "hit_speed_game"): (1.55, 1.15, 2.06),
    ("medium", "peak_speed"): (3.71, 3.05, 4.71),
    ("medium", "mean_speed"): (1.83, 1.52, 2.27),
    ("medium", "retreat"): (-0.134, -0.17, -0.0955),
    ("medium", "overshoot"): (0.0855, 0.061, 0.0999),
    ("medium", "path_per_hit"): (0.784, 0.666, 1),
    ("medium", "peaks_per_hit"): (2.13, 1.58, 2.69),
    ("medium", "sparc"): (-2.44, -2.82, -2.18),
    ("medium", "ldlj"): (-6.53, -7.65, -5.82),
    ("medium", "rms_acc"): (50.4, 39.1, 68.2),
    ("medium", "hf_share"): (0.374, 0.277, 0.472),
    ("medium", "ctrl_rot_speed"): (413, 371, 547),
    ("medium", "wrist_ratio"): (1.81, 1.62, 2.05),
    ("medium", "head_range"): (0.0394, 0.026, 0.0507),
    ("medium", "head_rot_p95"): (6.06, 4.05, 7.89),
    ("medium", "oldest_first"): (0.767, 0.523, 0.914),
    ("medium", "choices_share"): (0.796, 0.71, 0.921),
    ("medium", "swing_cv"): (0.169, 0.118, 0.202),
    ("hard", "d_depth"): (0.00272, -0.0253, 0.0323),
    ("hard", "d_mean_speed"): (-0.0467, -0.171, 0.041),
    ("low", "depth_p5"): (-0.172, -0.213, -0.14),
    ("high", "range_y"): (0.338, 0.31, 0.384),
    ("high", "d_peak_speed"): (-0.0392, -0.18, 0.0271),
}


@pytest.fixture(scope="module")
def people() -> Source:
    return measured_people(read_people(ROUNDS), WHACAMOLE)


def test_people_s_numbers(people: Source) -> None:
    wrong = {}
    for (condition, measure), published in CONSTRAINED.items():
        persons = people.persons["constrained", condition]
        values = [person.values[measure] for person in persons]
        found = np.array([np.mean(values), min(values), max(values)])
        # Three digits are published; one target of a round is the least that can differ.
        if np.abs(found - published).max() > 0.012 * np.abs(published).max():
            wrong[condition, measure] = (found, published)
    assert wrong == {}


def test_one_of_the_people_is_inside_the_others_range_as_published(people: Source) -> None:
    found = left_out(people.persons, WHACAMOLE)["constrained"]
    totals = [total(compared.rows) for compared in found.values()]
    assert len(totals) == 6
    assert np.mean([each.inside for each in totals]) == pytest.approx(0.675, abs=0.002)
    assert np.mean([each.distance for each in totals]) == pytest.approx(1.14, abs=0.01)


def test_published_simulated_users_do_not_wait_for_the_target() -> None:
    folder = RECORDINGS / "simulated_rounds"
    source = measured_user("simulated", read_user(folder), WHACAMOLE)
    (user,) = source.persons["constrained", "easy"]
    assert user.values["vm_latency"] < 0.1
    assert user.values["strike_early"] == 1.0
