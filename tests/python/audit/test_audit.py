"""Audits: designs made worse in known ways, geometry by hand, files that repeat."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sim2vr_harness.audit.auditing import AuditRequest, run
from sim2vr_harness.audit.judging import Judged, judge, places_of, seen
from sim2vr_harness.audit.population import NONE, Limitation, draw, groups_of
from sim2vr_harness.audit.reaching import Crowd, Rows
from sim2vr_harness.audit.remedies import GOAL, remedy
from sim2vr_harness.audit.report import findings, headline, write
from sim2vr_harness.audit.summary import cause, plain, proportion, shift_words
from sim2vr_harness.audit.targets import Target, found_targets, located, read_targets
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.statistics.intervals import wilson_interval
from sim2vr_harness.tools.users import environment_of
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay


@pytest.fixture(scope="module")
def crowd() -> Crowd:
    return Crowd(draw(6, 1), "seated", NONE)


def target(name: str, right: float, up: float, ahead: float, **more: Any) -> Target:
    return Target(name, np.array([right, up, ahead]), **more)


def posed(crowd: Crowd, angles: np.ndarray | None = None, **degrees: float) -> mujoco.MjData:
    """The first person in a posture, by MuJoCo; other joints are at 0."""
    body = crowd.subjects[0].body
    data = mujoco.MjData(body.physics_model)
    if angles is None:
        angles = np.radians([degrees.get(joint, 0.0) for joint in body.independent_joints])
    data.qpos[:] = body.coupled_qpos(angles)
    mujoco.mj_kinematics(body.physics_model, data)
    return data


def arm_length(crowd: Crowd) -> tuple[np.ndarray, float]:
    """Shoulder of the first person and how far its straight arm carries the grip."""
    data = posed(crowd, shoulder_elv=90.0, elv_angle=90.0)
    shoulder = data.body("humerus").xpos.copy()
    return shoulder, float(np.linalg.norm(data.site("controller_right").xpos - shoulder))


def test_a_straight_arm_ends_at_its_length(crowd: Crowd) -> None:
    shoulder, length = arm_length(crowd)
    shares = np.array([0.9, 1.15, 2.5])
    places = shoulder + shares[:, None] * [length, 0.0, 0.0]
    zeros = np.zeros(3, dtype=np.int64)
    found = crowd.solve(Rows(zeros, zeros.astype(bool), places, np.full(3, 0.001)))
    assert found.reached.tolist() == [True, True, False]
    assert found.leans[:2].tolist() == [False, True]


UPRIGHT = {f"trunk_{joint}": (0.0, 0.0) for joint in ("flexion", "bending", "rotation")}


def test_a_place_beyond_the_arm_s_length_lacks_the_difference(crowd: Crowd) -> None:
    """The trunk upright, 0.9 and 1.2 lengths of the arm straight ahead of the shoulder.

    Shoulder girdle and wrist make the straight arm up to 3 cm longer.
    """
    upright = Limitation("upright", limits_deg=UPRIGHT)
    shoulder, length = arm_length(crowd)
    places = position_to_app([shoulder + share * length * np.eye(3)[0] for share in (0.9, 1.2)])
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
    limits = UPRIGHT | {"shoulder_elv": (0.0, 90.0)}
    reached = []
    for limits_deg in (UPRIGHT, limits):
        limitation = Limitation("", limits_deg=limits_deg, one_hand=True)
        one = Crowd(crowd.subjects[:1], "seated", limitation)
        zero = np.zeros(1, dtype=np.int64)
        rows = Rows(zero, zero.astype(bool), place[None], np.full(1, 0.001))
        reached.append(bool(one.solve(rows).reached[0]))
    assert reached == [True, False]


def test_who_stands_reaches_the_same_places_from_higher_up(crowd: Crowd) -> None:
    """Eyes at 0.936 of the stature (Drillis and Contini)."""
    standing = Crowd(crowd.subjects, "standing", NONE)
    statures = [each.person.stature_m for each in crowd.subjects]
    np.testing.assert_allclose(standing.heads[:, 2], 0.936 * np.array(statures))
    lift = standing.heads[0] - crowd.heads[0]
    assert lift[2] > 0.2
    zero, close = np.zeros(1, dtype=np.int64), np.full(1, 0.001)
    place = np.array([[0.4, -0.2, 1.1]])
    seated = crowd.solve(Rows(zero, zero.astype(bool), place, close))
    higher = standing.solve(Rows(zero, zero.astype(bool), place + lift, close))
    np.testing.assert_allclose(higher.angles[0, 0], seated.angles[0, 0], atol=1e-9)
    np.testing.assert_allclose(higher.nearest - seated.nearest, lift[None], atol=1e-9)


def test_a_ray_of_the_app_s_own_hits_the_place(crowd: Crowd) -> None:
    """From 5 cm beside the grip, straight ahead of it: 60 degrees from WebXR's."""
    ray = DeviceRay(np.array([0.0, 0.05, 0.0]), np.array([1.0, 0.0, 0.0]))
    place, zero = np.array([3.0, 0.6, 1.6]), np.zeros(1, dtype=np.int64)
    rows = Rows(zero, zero.astype(bool), place[None], np.full(1, 0.001), ray)
    found = crowd.solve(rows)
    assert found.reached.all()
    site = posed(crowd, found.angles[0, 0]).site("controller_right")
    turn = site.xmat.reshape(3, 3)
    gap = place - site.xpos - turn @ ray.origin_m
    np.testing.assert_allclose(turn @ ray.direction, gap / np.linalg.norm(gap), atol=2e-3)


def test_the_other_hand_is_the_mirror_image(crowd: Crowd) -> None:
    place = np.array([[0.3, 0.35, 1.0], [0.3, -0.35, 1.0]])
    persons = np.zeros(2, dtype=np.int64)
    found = crowd.solve(Rows(persons, np.array([True, False]), place, np.full(2, 0.001)))
    np.testing.assert_allclose(found.angles[0, 0], found.angles[1, 0], atol=1e-9)


def test_neck_and_field_of_view_decide_what_is_seen(crowd: Crowd) -> None:
    # Neck: 70.65 degrees to a side, and 45 of the field of view.
    angles = np.radians([0.0, 115.0, 116.5, -115.0, -116.5, 180.0])
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    persons = np.zeros(6, dtype=np.int64)
    found = seen(crowd, persons, crowd.heads[persons] + 2.0 * around)
    assert found.tolist() == [True, True, False, True, False, False]


BAD = [
    (target("high", 0.2, 2.2, 0.3), "too high", 1, -1.0),
    (target("far", 0.2, 1.0, 1.4), "too far", 2, -1.0),
    (target("behind", 0.1, 1.1, -0.6), "behind", 2, 1.0),
]


@pytest.mark.parametrize(("bad", "why", "axis", "sign"), BAD, ids=lambda each: str(each)[:20])
def test_a_bad_place_is_named_with_its_remedy(
    crowd: Crowd, bad: Target, why: str, axis: int, sign: float
) -> None:
    judged = judge(crowd, [bad], NONE)
    assert {cause(judged, bad, i, 0) for i in range(len(crowd.subjects))} == {why}
    found = remedy(crowd, bad, judged, 0)
    assert found.shift_m is not None
    assert found.share >= GOAL
    assert np.sign(found.shift_m[axis]) == sign
    assert abs(found.shift_m[axis]) > 0.1


def test_a_heavy_thing_gets_a_lighter_load(crowd: Crowd) -> None:
    heavy = target("heavy", 0.2, 1.0, 0.45, how="grab", load_kg=40.0)
    judged = judge(crowd, [heavy], NONE)
    assert judged.reached.all()
    assert {cause(judged, heavy, i, 0) for i in range(len(crowd.subjects))} == {"too heavy"}
    found = remedy(crowd, heavy, judged, 0)
    assert found.load_kg is not None
    assert 0.0 < found.load_kg < 40.0


def test_two_hands_at_once_exclude_who_has_one() -> None:
    both = target("lever", 0.0, 1.0, 0.4, hand="both")
    one_hand = Limitation("one hand only", one_hand=True)
    subjects = draw(3, 1)
    free = judge(Crowd(subjects, "seated", NONE), [both], NONE)
    judged = judge(Crowd(subjects, "seated", one_hand), [both], one_hand)
    assert free.reached.all()
    assert [cause(judged, both, i, 0) for i in range(3)] == ["needs two hands"] * 3


def test_weaker_muscles_work_harder(crowd: Crowd) -> None:
    place = [target("front", 0.2, 1.1, 0.45)]
    full = judge(crowd, place, NONE)
    weak = judge(crowd, place, Limitation("weak", strength=0.5))
    assert (weak.share > full.share).all()
    assert np.median(weak.share / full.share) == pytest.approx(2.0, rel=0.1)


def test_higher_moles_tire_more(crowd: Crowd) -> None:
    medians = []
    for condition in ("low", "mid", "high"):
        env = environment_of("mobl_arms_wrist", game="whacamole", condition=condition)
        targets = found_targets(env, seconds=4.0)
        assert all(each.from_head for each in targets)
        judged: Judged = judge(crowd, targets, NONE)
        medians.append(float(np.nanmedian(judged.share)))
    assert medians == sorted(medians)
    assert medians[2] > 1.2 * medians[0]


@pytest.mark.parametrize(
    ("game", "condition", "names"),
    [
        ("sample", None, {"Ball"}),
        ("panel", "touch", {"Button"}),
    ],
)
def test_still_things_of_games_are_found(game: str, condition: str | None, names: set[str]) -> None:
    """Neither the ray and cursor of a hand, nor plates, floors and lights."""
    env = environment_of("mobl_arms_wrist", game=game, condition=condition)
    found = found_targets(env, seconds=1.0)
    assert {each.name.rstrip("0123456789 ") for each in found} == names
    assert len(found) == (12 if game == "panel" else 3), "a ball in each of three rounds"


def test_targets_that_nobody_reaches_or_only_looks_at_are_judged(crowd: Crowd) -> None:
    sign = target("sign", 0.0, 1.6, 4.0, how="look")
    shelf = target("shelf", 0.0, 1.6, 4.0)
    looked, beyond = (judge(crowd, [each], NONE, 10.0) for each in (sign, shelf))
    assert looked.seen.any() and not beyond.reached.any()
    for found in (looked, beyond):
        assert all(np.isnan(minutes).all() for minutes in found.paced.values())


def test_a_target_of_the_head_moves_with_it(crowd: Crowd) -> None:
    persons = np.arange(6)
    places = places_of(crowd, target("near", 0.0, -0.2, 0.4, from_head=True), persons)
    np.testing.assert_allclose(places - crowd.heads, np.tile([0.4, 0.0, -0.2], (6, 1)))


def test_wilson_intervals_are_the_published_ones() -> None:
    # Newcombe 1998, table I: 81 of 263, 15 of 148, 0 of 20.
    for successes, n, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605)):
        assert wilson_interval(successes, n) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert proportion(20, 29)["share"] is None


def test_groups_hold_persons_of_their_percentile() -> None:
    subjects = draw(60, 2)
    groups = {group.name: group.members.tolist() for group in groups_of(subjects)}
    assert sorted(groups["women"] + groups["men"]) == list(range(60))
    short = [subjects[i].person.stature_m for i in groups["women, stature below P25"]]
    # ANSUR II: women 1.629 m, SD 0.0665 in this population: P25 is 1.629 - 0.6745 SD.
    assert max(short) < 1.629 - 0.6745 * 0.0665 + 1e-3


def test_people_of_an_audit_are_not_cut() -> None:
    """Of 2,000 persons 5 % are below the fifth percentile of their sex, 1 % below the first."""
    percentiles = np.array([each.percentile for each in draw(2000, 3)])
    for percent in (1.0, 5.0, 50.0, 95.0, 99.0):
        share = 0.01 * percent
        within = 3.0 * np.sqrt(share * (1.0 - share) / len(percentiles))
        assert (percentiles < percent).mean() == pytest.approx(share, abs=within)


def test_the_same_seed_writes_the_same_files(tmp_path: Path) -> None:
    targets = [target("<near>", 0.2, 1.0, 0.4), target("ray", 0.4, 1.3, 3.0, how="point")]
    for name in ("a", "b"):
        done = run("x", targets, people=3, seed=4)
        write(done, tmp_path / name)
    values = plain(done)
    for file in ("report.html", "audit.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert headline(values) == "3 persons are too few to judge 2 targets: 30 at least."
    assert findings(values) == []
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    assert "Limits of the model" in page
    assert "&lt;near&gt;" in page
    assert '"mode":"markers+text"' in page


def test_shifts_in_words() -> None:
    assert shift_words(np.array([0.0, -0.12, 0.05])) == "12 cm down and 5 cm ahead"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("targets: 3", "list 'targets'"),
        ("targets: [{name: a}]", "place and object"),
        ("targets: [{name: a, place: [0, 1]}]", "place"),
        ("targets: [{name: a, place: [0, 1, 0], how: lick}]", "how"),
        ("targets: [{name: a, place: [0, 1, 0], load_kg: -1}]", "load_kg"),
        ("targets: [{name: a, place: [0, 1, 0]}, {name: a, place: [0, 1, 1]}]", "twice"),
        ("targets: [a]", "mapping"),
    ],
)
def test_bad_files_name_the_field(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "t.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_targets(file)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "--game, --page, --targets or --session: got none"),
        ({"game": "sample", "remote": {"page": "x"}}, "--page or --openxr: got it together"),
        ({"remote": {"game": "x"}}, "--openxr: got a program without --targets"),
        ({"targets": ["0,1,0"], "overrides": ["a=1"]}, "--set: got it without an app"),
        ({"targets": ["0,1,0"], "objects": "a"}, "--condition or --objects: got it without"),
        ({"game": "sample", "how": "grab"}, "--how: got 'grab', expected touch or point"),
        ({"game": "sample", "stance": "lying"}, "--stance: got 'lying'"),
        ({"game": "sample", "people": 0}, "--people: got 0, expected 1 to 10,000"),
        ({"game": "sample", "people": 3, "operate": 4}, "--operate: got 4, expected 0 to the 3"),
        ({"game": "sample", "seconds": 0.0}, "--seconds: got 0"),
        ({"game": "sample", "tool": "Tip"}, "--tool: got it without --user"),
        ({"user": "x", "tool": "Tip"}, "--tool: got it without --game"),
        ({"user": "x", "stance": "standing"}, "--stance: got it together with --user"),
        ({"user": "x", "cell": 0.5}, "--cell: got 0.5, expected 0.01 to 0.2 m"),
        ({"user": "x", "pose": "a=1", "game": "sample"}, "--game: got it together with --pose"),
        ({"user": "x", "load": 1.0}, "--load: got it without --pose"),
    ],
)
def test_options_that_do_not_go_together_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        AuditRequest(**options).check()


def test_an_object_needs_a_page(tmp_path: Path) -> None:
    file = tmp_path / "t.yaml"
    file.write_text("targets: [{name: a, object: Door}]")
    with pytest.raises(InputError, match="without --page"):
        located(read_targets(file), None)
