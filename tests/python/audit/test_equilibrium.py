"""Postures that the model's muscles hold: equilibrium by MuJoCo's forward dynamics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim2vr_harness.audit.equilibrium import NEAR_M, Balancer
from sim2vr_harness.audit.judging import judge
from sim2vr_harness.audit.population import NONE, Subject, draw
from sim2vr_harness.audit.reaching import Crowd
from sim2vr_harness.audit.report import too_weak
from sim2vr_harness.audit.targets import Target

FRONT = np.array([0.4, -0.15, 1.1])


@pytest.fixture(scope="module")
def subject() -> Subject:
    return draw(1, 3)[0]


def rest_of(subject: Subject) -> np.ndarray:
    return Crowd([subject], "seated", NONE).rest


def fastest(subject: Subject, angles: np.ndarray, activations: np.ndarray) -> float:
    """Largest acceleration of the arm's joints, the trunk's motors holding against gravity."""
    body = subject.body
    model = body.physics_model
    data = mujoco.MjData(model)
    data.qpos[:] = body.coupled_qpos(angles)
    for name, value in zip(body.muscles, activations, strict=True):
        data.act[int(model.actuator_actadr[model.actuator(name).id])] = value
    mujoco.mj_forward(model, data)
    for joint in body.independent_joints:
        if joint.startswith(("trunk", "neck")):
            dof = int(model.joint(joint).dofadr[0])
            data.qfrc_applied[dof] = (data.qfrc_bias - data.qfrc_passive)[dof]
            data.qfrc_applied[dof] -= data.qfrc_actuator[dof]
    mujoco.mj_forward(model, data)
    return float(np.abs(data.qacc[body.qvel_independent]).max())


def test_activations_hold_the_posture(subject: Subject) -> None:
    (best, *_) = Balancer(subject).search(FRONT, rest_of(subject)[None], NEAR_M)
    assert best.holds(NEAR_M)
    assert best.gap_m <= NEAR_M
    assert (best.activations >= 0.0).all()
    assert (best.activations <= 1.0).all()
    still = fastest(subject, best.angles, best.activations)
    assert still < 0.1 * fastest(subject, best.angles, 0.0 * best.activations)


def test_a_hand_ends_where_the_body_has_it(subject: Subject) -> None:
    (best, *_) = Balancer(subject).search(FRONT, rest_of(subject)[None], NEAR_M)
    hand = Crowd([subject], "seated", NONE).hand(0, best.angles)
    assert np.linalg.norm(hand - FRONT) == pytest.approx(best.gap_m, abs=1e-9)


@pytest.mark.parametrize(("strength", "load_kg"), [(0.02, 0.0), (1.0, 30.0)])
def test_weak_muscles_and_heavy_loads_fail(
    subject: Subject, strength: float, load_kg: float
) -> None:
    found = Balancer(subject, strength, load_kg).search(FRONT, rest_of(subject)[None], NEAR_M)
    assert not any(each.holds(NEAR_M) for each in found)
    assert not Balancer(subject, strength, load_kg).holds(
        Balancer(subject).search(FRONT, rest_of(subject)[None], NEAR_M)[0].angles
    )


def test_verdicts_name_what_the_model_is_too_weak_for() -> None:
    crowd = Crowd(draw(2, 3), "seated", NONE)
    front = Target("front", np.array([0.15, 1.1, 0.4]))
    heavy = Target("heavy", front.place_m, how="grab", load_kg=30.0)
    judged = judge(crowd, [front, heavy], NONE, muscles=True)
    assert judged.reached.all()
    assert judged.feasible.tolist() == [[True, False]] * 2
    assert judge(crowd, [heavy], NONE).feasible.all(), "nothing was searched"


def test_a_feasible_posture_takes_no_more_than_all_of_the_muscles() -> None:
    """It replaces one for which the muscles are too weak."""
    crowd = Crowd(draw(2, 3), "seated", NONE)
    high = [Target("high", np.array([0.15, 1.45, 0.3]))]
    without, with_it = judge(crowd, high, NONE), judge(crowd, high, NONE, muscles=True)
    assert (with_it.share <= without.share).all()
    assert (with_it.share[with_it.feasible] < 1.05).all()


def test_the_report_says_where_the_model_is_too_weak() -> None:
    share = {"n": 40, "share": 0.5, "low": 0.35, "high": 0.65}
    values = {
        "targets": [
            {"name": "shelf", "muscles_suffice": share},
            {"name": "door", "muscles_suffice": share | {"share": 1.0}},
            {"name": "lamp", "muscles_suffice": share | {"n": 3, "share": None}},
        ]
    }
    assert too_weak(values).endswith("95 % of those who reach shelf (50 % [35, 65]).")
    assert too_weak({"targets": values["targets"][1:]}) == ""
