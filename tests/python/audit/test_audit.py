"""Audits: designs made worse in known ways, numbers by hand, files that repeat."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.special import ndtr

from sim2vr_harness.audit.auditing import Parts, run
from sim2vr_harness.audit.judging import (
    can_grip,
    gaze,
    grip_share,
    grip_time,
    hold,
    judge,
    seen,
    steady,
)
from sim2vr_harness.audit.pacing import PACING, Paced, minutes_at_pace, path_loads
from sim2vr_harness.audit.pages import FoundThing, Way, things_as_targets
from sim2vr_harness.audit.population import LIMITATIONS, NONE, Limitation, draw, groups_of
from sim2vr_harness.audit.postures import BALANCE, Balancer
from sim2vr_harness.audit.reaching import Crowd, Rows
from sim2vr_harness.audit.remedies import GOAL, remedy
from sim2vr_harness.audit.report import (
    act_out,
    answers,
    headline,
    unanswered,
    write,
)
from sim2vr_harness.audit.request import AuditRequest
from sim2vr_harness.audit.summary import cause, plain, proportion
from sim2vr_harness.audit.targets import (
    Target,
    found_targets,
    located,
    pressed_places,
    read_targets,
)
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.sessions import Controller, Session, write_session
from sim2vr_harness.statistics.intervals import wilson_interval
from sim2vr_harness.tools.users import environment_of
from sim2vr_harness.users.exertion import Strength
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay

RAY = DeviceRay(np.array([0.0, 0.05, 0.0]), np.array([1.0, 0.0, 0.0]))
"""From 5 cm beside the grip, straight ahead of it: 60 degrees from WebXR's."""
UPRIGHT = {f"trunk_{joint}": (0.0, 0.0) for joint in ("flexion", "bending", "rotation")}


def target(name: str, right: float, up: float, ahead: float, **more: Any) -> Target:
    return Target(name, np.array([right, up, ahead]), **more)


def of_name(name: str) -> Limitation:
    return next(each for each in LIMITATIONS if each.name == name)


def posed(crowd: Crowd, angles: np.ndarray | None = None, **degrees: float) -> mujoco.MjData:
    """The first person in a posture, by MuJoCo; other joints are at 0."""
    body = crowd.subjects[0].body
    data = mujoco.MjData(body.physics_model)
    if angles is None:
        angles = np.radians([degrees.get(joint, 0.0) for joint in body.independent_joints])
    data.qpos[:] = body.coupled_qpos(angles)
    mujoco.mj_forward(body.physics_model, data)
    return data


def solved(crowd: Crowd, places: Any, mirrored: bool = False, ray: DeviceRay | None = None) -> Any:
    """What the first person reaches of places, MuJoCo's world."""
    n = len(places)
    rows = np.zeros(n, np.int64), np.full(n, mirrored), np.array(places), np.full(n, 0.001)
    return crowd.solve(Rows(*rows, ray))


# --- reach ---------------------------------------------------------------------------------------


def straight_arm(crowd: Crowd) -> tuple[np.ndarray, float]:
    """Shoulder of the first person and how far its straight arm carries the grip."""
    data = posed(crowd, shoulder_elv=90.0, elv_angle=90.0)
    shoulder = data.body("humerus").xpos.copy()
    return shoulder, float(np.linalg.norm(data.site("controller_right").xpos - shoulder))


def test_arms_are_as_long_as_stature_and_factors_say(crowd: Crowd) -> None:
    """The model of 1.70 m has an upper arm of .2904 m (docs/reference/bodies.md)."""
    for subject in crowd.subjects:
        model, person = subject.body.physics_model, subject.person
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        own = float(np.linalg.norm(data.body("ulna").xpos - data.body("humerus").xpos))
        expected = 0.2904 * person.stature_m / 1.70 * person.upper_arm_factor
        assert own == pytest.approx(expected, rel=2e-3)


def test_a_straight_arm_ends_at_its_length(crowd: Crowd) -> None:
    """With the trunk upright, 0.9 and 1.2 lengths of the arm straight ahead of the shoulder.

    Shoulder girdle and wrist make the straight arm up to 3 cm longer; the trunk adds some.
    """
    shoulder, length = straight_arm(crowd)
    found = solved(crowd, shoulder + np.outer([0.9, 1.15, 2.5], [length, 0.0, 0.0]))
    assert found.reached.tolist() == [True, True, False]
    assert found.leans[:2].tolist() == [False, True]
    upright = Limitation("upright", limits_deg=UPRIGHT)
    places = position_to_app(shoulder + np.outer([0.9, 1.2], [length, 0.0, 0.0]))
    targets = [target(name, *place) for name, place in zip("ab", places, strict=True)]
    judged = judge(Crowd(crowd.subjects[:1], "seated", upright), targets, upright)
    assert judged.reached[0].tolist() == [True, False]
    assert cause(judged, targets[1], 0, 1) == "too far"
    np.testing.assert_allclose(judged.needed_m[0, 1], [0.0, 0.0, -0.2 * length], atol=0.03)


def test_an_arm_raised_by_90_degrees_ends_a_forearm_above_the_shoulder(crowd: Crowd) -> None:
    """Then the elbow is no higher than the shoulder, and the hand no more than a forearm above."""
    data = posed(crowd, shoulder_elv=90.0, elv_angle=90.0)
    forearm = np.linalg.norm(data.site("controller_right").xpos - data.body("ulna").xpos)
    place = data.body("humerus").xpos + np.array([0.2, -0.1, 1.1 * forearm])
    reached = []
    for limits_deg in (UPRIGHT, UPRIGHT | {"shoulder_elv": (0.0, 90.0)}):
        limitation = Limitation("", limits_deg=limits_deg, one_hand=True)
        one = Crowd(crowd.subjects[:1], "seated", limitation)
        reached.append(bool(solved(one, place[None]).reached[0]))
    assert reached == [True, False]


def test_who_stands_or_sits_higher_reaches_the_same_places_from_higher_up(crowd: Crowd) -> None:
    """Eyes at 0.936 of the stature (Drillis and Contini); a wheelchair's seat is 5 cm higher."""
    standing = Crowd(crowd.subjects, "standing", NONE)
    statures = np.array([each.person.stature_m for each in crowd.subjects])
    np.testing.assert_allclose(standing.heads[:, 2], 0.936 * statures)
    chair = Crowd(crowd.subjects, "seated", of_name("wheelchair"))
    np.testing.assert_allclose(chair.heads - crowd.heads, [[0.0, 0.0, 0.05]] * 6, atol=1e-12)
    lift = standing.heads[0] - crowd.heads[0]
    assert lift[2] > 0.2
    place = np.array([[0.4, -0.2, 1.1]])
    seated, higher = solved(crowd, place), solved(standing, place + lift)
    np.testing.assert_allclose(higher.angles[0, 0], seated.angles[0, 0], atol=1e-9)
    np.testing.assert_allclose(higher.nearest - seated.nearest, lift[None], atol=1e-9)


def test_who_lies_reaches_up_as_others_reach_ahead_and_holds_it_by_less(crowd: Crowd) -> None:
    """About the hips, by 90 degrees: ahead becomes up; above the shoulder, weight has no moment."""
    lying, arm = Crowd(crowd.subjects[:1], "seated", of_name("lying on the back")), [0.45, 0.0, 0.0]
    hips = posed(crowd).joint("trunk_flexion").xanchor
    head, place = crowd.heads[0] - hips, straight_arm(crowd)[0] + arm - hips
    np.testing.assert_allclose(lying.heads[0], hips + np.array([-head[2], head[1], head[0]]))
    above = hips + np.array([-place[2], place[1], place[0]])
    raised = solved(lying, above[None])
    assert raised.reached.all()
    np.testing.assert_allclose(raised.nearest[0], above, atol=2e-3)
    joints = crowd.subjects[0].body.independent_joints
    straight = np.radians([90.0 * (j in ("shoulder_elv", "elv_angle")) for j in joints])
    loads = [each.subjects[0].holder.load(straight, 0.0).torque for each in (crowd, lying)]
    assert loads[1] < 0.1 * loads[0]


@pytest.mark.parametrize(
    ("how", "radius_m", "kept"),
    [
        ("touch", 0.005, False),  # inside for 2 / pi arcsin(1/2) = 1/3 of the time
        ("touch", 0.008, True),  # .59
        ("press", 0.008, False),  # .59, less 2 x 5 Hz x .1 s
        ("press", 0.010, True),
        ("press", 0.0, True),  # of unknown size
        ("point", 0.020, False),  # 1 cm at .35 m is 4 cm at 1.4 m
        ("point", 0.041, True),
    ],
)
def test_a_tremor_misses_targets_that_are_narrower(how: Any, radius_m: float, kept: bool) -> None:
    shaking, one = of_name("tremor: 1 cm at 5 Hz"), target("key", 0, 1, 1.4, radius_m=radius_m)
    assert steady(replace(one, how=how), np.array([1.4, 0.0, 1.0]), shaking) is kept


def test_a_ray_of_the_app_s_own_hits_the_place(crowd: Crowd) -> None:
    place = np.array([3.0, 0.6, 1.6])
    found = solved(crowd, place[None], ray=RAY)
    assert found.reached.all()
    site = posed(crowd, found.angles[0, 0]).site("controller_right")
    turn = site.xmat.reshape(3, 3)
    gap = place - site.xpos - turn @ RAY.origin_m
    np.testing.assert_allclose(turn @ RAY.direction, gap / np.linalg.norm(gap), atol=2e-3)


def test_the_other_hand_is_the_mirror_image(crowd: Crowd) -> None:
    left = solved(crowd, [[0.3, 0.35, 1.0]], mirrored=True)
    right = solved(crowd, [[0.3, -0.35, 1.0]])
    np.testing.assert_allclose(left.angles[0, 0], right.angles[0, 0], atol=1e-9)


def test_neck_and_field_of_view_decide_what_is_seen(crowd: Crowd) -> None:
    # Neck: 70.65 degrees to a side, and 45 of the field of view.
    angles = np.radians([0.0, 115.0, 116.5, -115.0, -116.5, 180.0])
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    persons = np.zeros(6, dtype=np.int64)
    found = seen(crowd, persons, crowd.heads[persons] + 2.0 * around)
    assert found.tolist() == [True, True, False, True, False, False]


def test_gaze_says_where_a_target_is_and_what_the_neck_bears(crowd: Crowd) -> None:
    away = np.array([[1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, 0.0, -1.0]])  # ahead, right, below
    persons = np.zeros(3, dtype=np.int64)
    right, up, share = gaze(crowd, persons, crowd.heads[persons] + away)
    np.testing.assert_allclose([right, up], [[0.0, 45.0, 0.0], [0.0, 0.0, -45.0]], atol=1e-9)
    # The seventh cervical vertebra carries head and headset at its lever beside the vertical.
    subject = crowd.subjects[0]
    body, model = subject.body, subject.body.physics_model
    angles = crowd.rest.copy()
    angles[body.independent_joints.index("neck_flexion")] = np.radians(45.0)
    data = mujoco.MjData(model)
    data.qpos[:] = body.coupled_qpos(angles)
    mujoco.mj_forward(model, data)
    joint = model.joint("neck_flexion").id
    part = model.jnt_bodyid[joint]
    ahead_m = data.subtree_com[part, 0] - data.xanchor[joint, 0]
    strength = model.actuator("neck_flexion_motor").forcerange
    need = -9.81 * model.body_subtreemass[part] * ahead_m
    assert share[2] == pytest.approx(need / strength[0], rel=0.02)
    assert share[2] > share[0]


# --- exertion ------------------------------------------------------------------------------------


def arms(share: Any, raised_s: float, cycle_s: float) -> Paced:
    """Arms with the elbow bent and the upper arm low, where NICER corrects nothing."""
    share = np.atleast_1d(share)
    n, maximum = len(share), float(Strength().shoulder_torque(30.0, 90.0))
    strength = Strength(man=np.ones(n, dtype=bool), factor=np.ones(n))
    posture = np.full(n, 30.0), np.full(n, 90.0)
    times = np.full(n, raised_s), np.full(n, cycle_s)
    return Paced(share, share * maximum, *posture, strength, *times)


def test_women_s_arms_are_held_by_women_s_constants() -> None:
    """A raised, outstretched arm at 150 degrees, 5 Nm, for a woman and a man.

    Maximum: (227.338 + .525 * 180 - .296 * 150) .1495 = 41.47728 Nm; * .2845 = 78.93130 Nm.
    Correction, a woman: .0095 * 1005 / (1 + e^((66.4 - 150) / 7.83)) - sin 150 / .11
    = 9.54728 - 4.54545 = 5.00183; a man: 11.68473 - .5 / .09 = 6.12917 Nm.
    14.86 (10.00183 / 41.47728)^-1.83 = 200.5 s; 14.86 (11.12917 / 78.93130)^-1.83 = 535.6 s.
    """
    load = (np.full(2, each) for each in (0.2, 5.0, 150.0, 180.0))
    strength = Strength(np.array([False, True]), np.ones(2))
    both = Paced(*load, strength, np.full(2, 10.0), np.full(2, 10.0))
    np.testing.assert_allclose(60.0 * minutes_at_pace(both)["NICER"], [200.5, 535.6], atol=0.5)


def test_endurance_of_the_shoulder_is_near_the_published_curves() -> None:
    # Frey-Law and Avin 2010, 194 publications: 14.86 f^-1.83. 3CC-r leaves it above .6.
    shares = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    found = minutes_at_pace(arms(shares, 10.0, 10.0))
    for model, within in (("3CC-r, shoulder", 0.16), ("NICER", 0.01)):
        held = 60.0 * found[model]
        np.testing.assert_allclose(held, 14.86 * shares**-1.83, rtol=within, atol=0.3)
    # Rohmert's curve, in steps of .25 s, of the maximum that Consumed Endurance assumes in every
    # posture: 101.6 N * .33 m less the arm's weight, 22.59087 Nm.
    torque = shares * float(Strength().shoulder_torque(30.0, 90.0)) / 22.59087
    consumed = 1236.5 / (100.0 * torque - 15.0) ** 0.618 - 72.5
    short = consumed < 60.0 * PACING.most_minutes
    held = 60.0 * found["Consumed Endurance"]
    np.testing.assert_allclose(held[short], np.maximum(consumed[short], 0.25), atol=0.26)


def test_what_a_posture_takes_is_the_weight_s_moment(crowd: Crowd) -> None:
    """Of the arm about the shoulder, and of trunk, head and arm about the flexed trunk's hinge.

    Both from masses and centres of mass. The motor of the trunk's flexion resists 1 / .5 as much
    for a person of half the strength.
    """
    subject = crowd.subjects[0]
    body, model = subject.body, subject.body.physics_model
    degrees = {
        "elv_angle": 60.0,
        "shoulder_elv": 70.0,
        "elbow_flexion": 40.0,
        "trunk_flexion": 25.0,
    }
    angles = np.radians([degrees.get(joint, 0.0) for joint in body.independent_joints])
    data = posed(crowd, **degrees)

    def moment(part: int, anchor: np.ndarray) -> np.ndarray:
        below = [i for i in range(model.nbody) if part in ancestors(model, i)]
        arms_m = data.xipos[below] - anchor
        return np.cross(arms_m, model.body_mass[below, None] * model.opt.gravity).sum(axis=0)

    found = hold(subject, angles, 0.0, NONE)
    shoulder = model.body("humerus").id
    about = np.linalg.norm(moment(shoulder, data.xpos[shoulder]))
    assert found[3] == pytest.approx(about, rel=1e-6)
    hinge = model.joint("trunk_flexion").id
    bent = float(moment(int(model.jnt_bodyid[hinge]), data.xanchor[hinge]) @ data.xaxis[hinge])
    low, high = model.actuator("trunk_flexion_motor").forcerange
    assert found[2] == pytest.approx(-bent / (high if bent < 0.0 else low), rel=1e-6)
    half = hold(subject, angles, 0.0, of_name("strength: 50 %"))
    assert half[2] == pytest.approx(2.0 * found[2])
    assert half[1] == pytest.approx(2.0 * found[1])
    # 2 kg hang from the controller, elsewhere than at the shoulder's height.
    lever = np.cross(
        data.site("controller_right").xpos - data.xpos[shoulder], 2.0 * model.opt.gravity
    )
    more = np.linalg.norm(moment(shoulder, data.xpos[shoulder]) + lever)
    assert hold(subject, angles, 2.0, NONE)[3] == pytest.approx(more, rel=1e-6)


def ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    found = [body]
    while found[-1]:
        found.append(int(model.body_parentid[found[-1]]))
    return found


def test_above_the_shoulder_is_worse_than_below(crowd: Crowd) -> None:
    # Li et al. 2024 (NICER), Hincapie-Ramos et al. 2014: Borg ratings by height of targets.
    heights = [target(str(y), 0.15, y, 0.42, from_head=True) for y in (-0.55, 0.05)]
    places = crowd.places(heights[0], np.arange(6))  # which move with the head
    np.testing.assert_allclose(places - crowd.heads, np.tile([0.42, -0.15, -0.55], (6, 1)))
    judged = judge(crowd, heights, NONE)
    assert judged.reached.all()
    assert (judged.share[:, 1] > judged.share[:, 0]).all()
    assert (judged.published_share[:, 1] > judged.published_share[:, 0]).all()
    for minutes in judged.minutes.values():
        low, high = np.median(minutes, axis=0)
        assert high < 0.8 * low
    weak = judge(crowd, heights[:1], Limitation("weak", strength=0.5))
    assert np.median(weak.share / judged.share[:, :1]) == pytest.approx(2.0, rel=0.1)


def test_a_longer_path_takes_more_torque(crowd: Crowd) -> None:
    subject, rest = crowd.subjects[0], crowd.rest
    raised = rest.copy()
    raised[subject.body.independent_joints.index("shoulder_elv")] = np.radians(80.0)
    still, up = path_loads(subject, [rest, rest, raised], NONE)
    assert up[1] > 2.0 * still[1]
    assert still[0] == pytest.approx(still[1])


def fastest(crowd: Crowd, angles: np.ndarray, activations: np.ndarray) -> float:
    """Largest acceleration of the arm's joints, the trunk's motors holding against gravity."""
    body, data = crowd.subjects[0].body, posed(crowd, angles)
    model = body.physics_model
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


def test_activations_hold_the_posture_and_weak_muscles_do_not(crowd: Crowd) -> None:
    body, place, near = crowd.subjects[0].body, np.array([0.4, -0.15, 1.1]), BALANCE.near_m
    best = Balancer(body).search(place, crowd.rest[None], near)[0]
    assert best.holds(near)
    assert best.gap_m <= near
    assert ((best.activations >= 0.0) & (best.activations <= 1.0)).all()
    still = fastest(crowd, best.angles, best.activations)
    assert still < 0.1 * fastest(crowd, best.angles, 0.0 * best.activations)
    for strength, load_kg in ((0.02, 0.0), (1.0, 30.0)):
        weak = Balancer(body, strength, load_kg)
        assert not any(each.holds(near) for each in weak.search(place, crowd.rest[None], near))
        assert not weak.holds(best.angles)


def test_verdicts_name_what_the_model_is_too_weak_for() -> None:
    """A feasible posture replaces one for which the muscles are too weak."""
    two = Crowd(draw(2, 3), "seated", NONE)
    front, high = target("front", 0.15, 1.1, 0.4), target("high", 0.15, 1.45, 0.3)
    heavy = replace(front, name="heavy", how="grab", load_kg=30.0)
    judged = judge(two, [front, heavy, high], NONE, muscles=True)
    without = judge(two, [front, heavy, high], NONE)
    assert judged.reached.all()
    assert judged.feasible[:, :2].tolist() == [[True, False]] * 2
    assert without.feasible.all(), "nothing was searched"
    assert (judged.share <= without.share).all()
    assert (judged.share[judged.feasible] < 1.05).all()


# --- grip ----------------------------------------------------------------------------------------


def lever(**more: Any) -> Target:
    return target("lever", 0.2, 1.0, 0.4, how="grab", **more)


def test_a_load_takes_grip_by_friction(crowd: Crowd) -> None:
    # 10 kg between two surfaces of friction .5 need 98.1 N a side, 137.3 N with the margin. A man's
    # median is 51 kg, 500.3 N; a woman's 31 kg, 304.1 N.
    man, woman = (replace(crowd.subjects[0], strength=Strength(man=man)) for man in (True, False))
    heavy = lever(load_kg=10.0)
    assert grip_share(man, heavy, NONE) == pytest.approx(0.2745, abs=1e-4)
    assert grip_share(woman, heavy, NONE) == pytest.approx(0.4516, abs=1e-4)
    half = of_name("strength: 50 %")
    assert grip_share(woman, heavy, half) == pytest.approx(0.9032, abs=1e-4)
    assert grip_share(man, lever(grip_n=50.03), NONE) == pytest.approx(0.1, abs=1e-4)
    assert grip_share(man, lever(), NONE) == 0.0
    # 33.55 x .5^-1.61 = 33.55 x 3.0525 s.
    assert float(grip_time(0.5)) == pytest.approx(102.4, abs=0.1)
    assert can_grip([0.0, 0.5, 0.5, 1.01], 100.0).tolist() == [True, True, True, False]
    assert not can_grip(0.5, 103.0)


def test_as_many_grip_as_the_distribution_of_strength_says() -> None:
    """Grip is log-normal, 18 % in a sex, about 31 kg (women) and 51 kg (men; Dodds et al. 2014)."""
    subjects = draw(1000, 5)
    for man, median_kg in ((False, 31.0), (True, 51.0)):
        own = [each for each in subjects if each.man == man]
        for newton in (250.0, 304.1, 400.0, 500.3):
            able = np.mean([grip_share(each, lever(grip_n=newton), NONE) <= 1.0 for each in own])
            expected = float(ndtr(np.log(9.81 * median_kg / newton) / 0.18))
            within = 3.0 * np.sqrt(expected * (1.0 - expected) / len(own)) + 1e-3
            assert able == pytest.approx(expected, abs=within)


def test_a_hard_grip_is_named_with_its_remedy(crowd: Crowd) -> None:
    hard = lever(grip_n=900.0)
    judged = judge(crowd, [hard], NONE)
    assert judged.reached.all()
    assert {cause(judged, hard, i, 0) for i in range(6)} == {"grip too weak"}
    found = remedy(crowd, hard, judged, 0)
    assert found.shift_m is None
    assert found.grip_n is not None
    eased = judge(crowd, [replace(hard, grip_n=found.grip_n)], NONE)
    assert eased.usable.mean() >= GOAL
    weak, medium = Limitation("weak", strength=0.3), replace(hard, grip_n=150.0)
    tired = judge(Crowd(crowd.subjects, "seated", weak), [medium], weak)
    assert tired.held.sum() < judge(crowd, [medium], NONE).held.sum()


# --- verdicts and remedies -----------------------------------------------------------------------

BAD = [
    (target("high", 0.2, 2.2, 0.3), "too high", 1, -1.0),
    (target("far", 0.2, 1.0, 1.4), "too far", 2, -1.0),
    (target("behind", 0.1, 1.1, -0.6), "behind", 2, 1.0),
]


@pytest.mark.parametrize(("bad", "why", "axis", "sign"), BAD, ids=[each[1] for each in BAD])
def test_a_bad_place_is_named_with_its_remedy(
    crowd: Crowd, bad: Target, why: str, axis: int, sign: float
) -> None:
    judged = judge(crowd, [bad], NONE)
    assert {cause(judged, bad, i, 0) for i in range(6)} == {why}
    found = remedy(crowd, bad, judged, 0)
    assert found.shift_m is not None
    assert found.share >= GOAL
    assert np.sign(found.shift_m[axis]) == sign
    assert abs(found.shift_m[axis]) > 0.1
    # Moved so, the audit finds it usable.
    moved = replace(bad, place_m=bad.place_m + found.shift_m)
    assert judge(crowd, [moved], NONE).usable.mean() >= GOAL


def test_a_heavy_thing_gets_a_lighter_load(crowd: Crowd) -> None:
    heavy = target("heavy", 0.2, 1.0, 0.45, how="grab", load_kg=40.0)
    judged = judge(crowd, [heavy], NONE)
    assert judged.reached.all()
    assert {cause(judged, heavy, i, 0) for i in range(6)} == {"too heavy"}
    found = remedy(crowd, heavy, judged, 0)
    assert found.load_kg is not None
    assert 0.0 < found.load_kg < 40.0
    assert judge(crowd, [replace(heavy, load_kg=found.load_kg)], NONE).held.mean() >= GOAL


def test_two_hands_at_once_exclude_who_has_one(crowd: Crowd) -> None:
    both, one_hand = target("lever", 0.0, 1.0, 0.4, hand="both"), of_name("one hand only")
    judged = judge(Crowd(crowd.subjects[:3], "seated", one_hand), [both], one_hand)
    assert judge(crowd, [both], NONE).reached.all()
    assert [cause(judged, both, i, 0) for i in range(3)] == ["needs two hands"] * 3


def test_targets_that_nobody_reaches_or_only_looks_at_are_judged(crowd: Crowd) -> None:
    sign, shelf = target("sign", 0.0, 1.6, 4.0, how="look"), target("shelf", 0.0, 1.6, 4.0)
    looked, beyond = (judge(crowd, [each], NONE, 10.0) for each in (sign, shelf))
    assert looked.seen.any() and not beyond.reached.any()
    for found in (looked, beyond):
        assert all(np.isnan(minutes).all() for minutes in found.paced.values())


@pytest.mark.slow
def test_higher_moles_tire_more(crowd: Crowd) -> None:
    two, medians = Crowd(crowd.subjects[:2], "seated", NONE), []
    for condition in ("low", "mid", "high"):
        env = environment_of("mobl_arms_wrist", game="whacamole", condition=condition)
        targets = found_targets(env, seconds=4.0)
        assert all(each.from_head for each in targets)
        medians.append(float(np.nanmedian(judge(two, targets, NONE).share)))
    assert medians == sorted(medians)
    assert medians[2] > 1.2 * medians[0]


# --- acting it out -------------------------------------------------------------------------------


def test_near_places_are_reached_by_muscles_and_far_ones_not(crowd: Crowd) -> None:
    steps: list[Any] = []
    place = np.array([0.4, -0.2, 1.0])
    assert act_out(crowd.subjects[0], place, lambda *moment: steps.append(moment))[0]
    assert 0.2 < 0.05 * len(steps) < 3.0
    there, gap_m = act_out(crowd.subjects[0], place + np.array([1.6, 0.0, 0.0]))
    assert not there and gap_m > 0.5


# --- targets -------------------------------------------------------------------------------------


def test_places_of_a_session_are_where_something_is_pressed(tmp_path: Path) -> None:
    pose, file = np.zeros((6, 7)), tmp_path / "round.json"
    pose[:, 6], pose[:, 0] = 1.0, 0.1 * np.arange(6)
    inputs, times = np.zeros((6, 13)), 50_000_000 * np.arange(6)
    write_session(Session(times, pose, right=Controller(pose, inputs=inputs)), file)
    with pytest.raises(InputError, match="nothing is pressed"):
        pressed_places(file)
    inputs[[1, 2, 4], 0] = 1.0
    write_session(Session(times, pose, right=Controller(pose, inputs=inputs)), file)
    found = pressed_places(file)
    assert [each.place_m[0] for each in found] == pytest.approx([0.1, 0.4])
    assert {each.how for each in found} == {"press"}


@pytest.mark.parametrize(
    ("game", "condition", "names", "count"),
    [("sample", None, {"Ball"}, 3), ("panel", "touch", {"Button"}, 12)],
)
def test_still_things_of_games_are_found(
    game: str, condition: str | None, names: set[str], count: int
) -> None:
    """Neither the ray and cursor of a hand, nor plates, floors and lights; a ball a round."""
    env = environment_of("mobl_arms_wrist", game=game, condition=condition)
    found = found_targets(env, seconds=1.0)
    assert {each.name.rstrip("0123456789 ") for each in found} == names
    assert len(found) == count


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("targets: 3", "list 'targets'"),
        ("targets: [{name: a, place: [0, 1, 0], how: lick}]", "how"),
        ("targets: [{name: a, place: [0, 1, 0], load_kg: -1}]", "load_kg"),
        ("targets: [{name: a, place: [0, 1, 0]}, {name: a, place: [0, 1, 1]}]", "twice"),
        (
            "targets: [{name: a, place: [0, 1, 0], how: touch, grip_n: 20}]",
            "grip_n with how: touch, expected how: grab",
        ),
        ("targets: [{name: a, object: Door}]", "without --page"),
    ],
)
def test_bad_files_name_the_field(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "t.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        located(read_targets(file), None)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "--game, --page, --targets or --session: got none"),
        ({"game": "sample", "app": {"page": "x"}}, "--page or --openxr: got it together"),
        ({"app": {"game": "x"}}, "--openxr: got a program without --targets"),
        ({"targets": ["0,1,0"], "objects": "a"}, "--condition or --objects: got it without"),
        ({"game": "sample", "how": "grab"}, "--how: got 'grab', expected touch or point"),
        ({"game": "sample", "stance": "lying"}, "--stance: got 'lying'"),
        ({"game": "sample", "operate": 4}, "--operate: got 4, expected it with a script"),
        ({"game": "sample", "recline": 95.0}, "--recline: got 95, expected 0 to 90 degrees"),
        ({"game": "sample", "tool": "Tip"}, "--tool: got it without --user"),
        ({"user": "x", "stance": "standing"}, "--stance: got it together with --user"),
        ({"user": "x", "cell": 0.5}, "--cell: got 0.5, expected 0.01 to 0.2 m"),
        ({"user": "x", "pose": "a=1", "game": "sample"}, "--game: got it together with --pose"),
    ],
)
def test_options_that_do_not_go_together_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        AuditRequest(**options).check()


# --- population ----------------------------------------------------------------------------------


def test_groups_hold_persons_of_their_percentile() -> None:
    subjects = draw(60, 2)
    groups = {group.name: group.members.tolist() for group in groups_of(subjects)}
    assert sorted(groups["women"] + groups["men"]) == list(range(60))
    short = [subjects[i].person.stature_m for i in groups["women, stature below P25"]]
    # ANSUR II: women 1.629 m, SD 0.0665 in this population: P25 is 1.629 - 0.6745 SD.
    assert max(short) < 1.629 - 0.6745 * 0.0665 + 1e-3


def test_people_of_an_audit_are_those_of_the_table() -> None:
    """ANSUR II (Gordon et al. 2014): men 1.756 +- .069 m, women 1.629 +- .064 m, none cut off."""
    subjects = draw(1000, 3)
    for man, mean, sd in ((True, 1.756, 0.069), (False, 1.629, 0.064)):
        statures = np.array([each.person.stature_m for each in subjects if each.man == man])
        for z in (-2.33, -1.645, 0.0, 1.645, 2.33):
            share = float(ndtr(z))
            # One SD is used for both sexes, 4 % from each; three standard errors of the sample.
            within = 3.0 * np.sqrt(share * (1.0 - share) / len(statures))
            within += 0.04 * abs(z) * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
            assert (statures < mean + z * sd).mean() == pytest.approx(share, abs=within)
    percentiles = np.array([each.percentile for each in subjects])
    for percent in (1.0, 5.0, 50.0, 95.0, 99.0):
        share = 0.01 * percent
        within = 3.0 * np.sqrt(share * (1.0 - share) / len(percentiles))
        assert (percentiles < percent).mean() == pytest.approx(share, abs=within)


def test_wilson_intervals_are_the_published_ones() -> None:
    # Newcombe 1998, table I: 81 of 263, 15 of 148, 0 of 20.
    for successes, n, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605)):
        assert wilson_interval(successes, n) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert proportion(20, 29)["share"] is None


# --- report --------------------------------------------------------------------------------------


def test_processes_change_no_result_and_the_same_seed_writes_the_same_files(tmp_path: Path) -> None:
    assert Parts(1).run(np.sin, range(5)) == Parts(2).run(np.sin, range(5))
    targets = [target("<near>", 0.2, 1.0, 0.4), target("sign", 0.4, 1.3, 3.0, how="look")]
    for processes, name in enumerate("ab", start=1):
        done = run("x", targets, people=1, seed=4, processes=processes)
        write(done, tmp_path / name, film=False)
    values = plain(done)
    for file in ("report.html", "audit.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert headline(values) == "1 participants are too few to judge 2 targets: 30 are needed."
    assert answers(values) == []
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    for text in ("What limits this answer", "&lt;near&gt;", '"mode":"markers+text"'):
        assert text in page


def test_the_report_says_which_things_did_not_react() -> None:
    place, half = np.zeros(3), (0.1, 0.1, 0.1)
    key = FoundThing("key", "point", place, half, False, True, ("changes", "vibrates"))
    key.way = Way("point", "left", "trigger")
    stone = FoundThing("stone", "touch", place, half, False, True, obstacle="gone")
    targets = things_as_targets([key, stone])
    assert targets[0].in_app == "point + left trigger: changes, vibrates"
    rows = [{"name": t.name, "in_app": t.in_app, "app_reacts": t.reacts} for t in targets]
    said = unanswered({"targets": rows})
    assert said.startswith("The app reacts to 1 of 2 targets when they are operated.")
    assert "stone (gone)" in said
    assert unanswered({"targets": rows[:1]}) == ""
