"""How far users reach, against geometry worked out by hand."""

import csv
import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from sim2vr_harness.audit import hull
from sim2vr_harness.audit.hull import Measured, Reach, chosen_point, measure, people_margins
from sim2vr_harness.audit.postures import hold, posture_of, who_hold
from sim2vr_harness.audit.targets import (
    Resting,
    Target,
    alike,
    listed_targets,
    seen_targets,
    tool_point,
)
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import app
from sim2vr_harness.client import AppScene, DevicePoses, InProcessApp
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import with_people
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.tools.users import environment_of
from sim2vr_harness.users import Body, BodyPlan, PeopleSettings, Population, load_body
from sim2vr_harness.users.kinematics.forward import Linkage, Point

BODY = load_body("mobl_arms_wrist", appearance=False)

_ROD = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="torso" pos="0 0 1.2"><geom size=".01" mass="1"/>
    <body name="head"><geom size=".01" mass="1"/></body>
    <body name="humerus" pos="0 -.2 0">
      <joint name="lift" axis="0 -1 0" range="-2 2" limited="true"/>
      <inertial pos=".15 0 0" mass="2" diaginertia=".01 .01 .01"/>
      <body name="ulna" pos=".3 0 0"><inertial pos=".1 0 0" mass="1" diaginertia=".01 .01 .01"/>
        <body name="radius"><inertial pos=".1 0 0" mass=".5" diaginertia=".01 .01 .01"/>
          <body name="palm" pos=".25 0 0">
            <inertial pos="0 0 0" mass=".5" diaginertia="1e-3 1e-3 1e-3"/>
          </body></body></body>
    </body>
  </body></worldbody>
  <tendon><fixed name="up"><joint joint="lift" coef="-.03"/></fixed></tendon>
  <actuator><muscle name="deltoid" tendon="up" force="1000" lengthrange="-.1 .1"
    ctrllimited="true" ctrlrange="0 1" range=".75 1.05"/></actuator>
</mujoco>"""
"""An outstretched arm on a hinge: 2 kg at .15 m, 1 and .5 kg at .4 m, .5 kg at .55 m, and one
muscle with a moment arm of 3 cm."""


@pytest.fixture
def rod(tmp_path: Path) -> str:
    (tmp_path / "rod.xml").write_text(_ROD)
    file = tmp_path / "rod.yaml"
    file.write_text(
        "name: rod\nmjcf: rod.xml\ndevices:\n  headset: {body: head, weight: false}\n"
        "  controller_right: {body: palm, pos_m: [0, 0, 0], weight: false}\n"
        "actuators: [{names: [deltoid], rule: muscle}]\n"
    )
    return str(file)


def test_a_hinge_with_one_muscle_by_hand(rod: str) -> None:
    # 9.81 (2*.15 + 1.5*.4 + .5*.55) = 9.81 * 1.175 = 11.52675 Nm; 2 kg more hang from the
    # controller's tracked point, .053 m beyond the palm (users/data/hardware.json).
    # The muscle's length at 0 is the middle of its range: fibres at .9 of the optimum. Its force
    # at full activation is MuJoCo's; the activation is the torque over force times moment arm.
    (bare,), (heavy,) = hold(UserConfig(model=rod), "lift=0"), hold(UserConfig(model=rod), "", 2.0)
    assert bare.torque_nm == pytest.approx(11.52675, rel=1e-6)
    assert heavy.torque_nm == pytest.approx(11.52675 + 2.0 * 9.81 * 0.603, rel=1e-6)
    assert (bare.shoulder_deg, bare.elbow_deg) == pytest.approx((90.0, 180.0))
    muscle = [0.75, 1.05, 1000, 200, 0.5, 1.6, 1.5, 1.3, 1.2]
    gain = mujoco.mju_muscleGain(0.0, 0.0, [-0.1, 0.1], 1.0, muscle)
    passive = mujoco.mju_muscleBias(0.0, [-0.1, 0.1], 1.0, muscle)
    for held in (bare, heavy):
        activation = (held.torque_nm / 0.03 + passive) / -gain
        assert held.activations == {"deltoid": pytest.approx(activation, rel=1e-6)}
        assert held.share == pytest.approx(activation, rel=1e-6)
    # Chaffin's strength at 90 and 180 degrees: 83.98383 Nm; men's maximum of CE: 22.59087 Nm.
    assert bare.strength_share == pytest.approx(11.52675 / 83.98383, rel=1e-5)
    consumed = 1236.5 / (100 * 11.52675 / 22.59087 - 15) ** 0.618 - 72.5
    assert bare.endurance_s["Consumed Endurance"] == pytest.approx(consumed, rel=1e-5)


def test_a_muscle_that_is_too_weak(rod: str) -> None:
    (held,) = hold(UserConfig(model=rod), "lift=0", 20.0)
    assert held.share is not None
    assert held.share > 1.0
    assert held.endurance_s["3CC-r, shoulder"] == 0.0


def test_activations_balance_the_simulated_arm() -> None:
    """Applied to the model itself, they leave no acceleration of the free joints."""
    (held,) = hold(UserConfig(), "elv_angle=45,shoulder_elv=60,elbow_flexion=30")
    assert held.share is not None
    assert 0.1 < held.share < 1.0
    model = BODY.physics_model
    data = mujoco.MjData(model)
    data.qpos[:] = BODY.coupled_qpos(
        posture_of(BODY, "elv_angle=45,shoulder_elv=60,elbow_flexion=30")
    )
    for name, value in held.activations.items():
        data.act[int(model.actuator(name).actadr[0])] = value
    mujoco.mj_forward(model, data)
    fallen = data.qacc[BODY.qvel_independent].copy()
    data.act[:] = 0.0
    mujoco.mj_forward(model, data)
    loose = data.qacc[BODY.qvel_independent]
    assert np.abs(fallen).max() < 0.02 * np.abs(loose).max()


def test_load_shortens_endurance_and_strength_lengthens_it() -> None:
    pose = "elv_angle=45,shoulder_elv=60"
    strong = UserConfig.model_validate({"person": {"strength": 2.0}})
    (usual,), (loaded,), (better,) = (
        *(hold(UserConfig(), pose), hold(UserConfig(), pose, 1.0)),
        hold(strong, pose),
    )
    for name, time in usual.endurance_s.items():
        assert loaded.endurance_s[name] < time < better.endurance_s[name]


def test_people_s_published_strength_is_not_that_of_the_body_s_model() -> None:
    """Populations of weak and strong models hold as long, by NICER: only 3CC-r differs."""
    times = []
    for strength in (0.78, 1.28):
        user = UserConfig.model_validate({"people": {"strength": strength}})
        held = [
            hold(one, "elv_angle=45,shoulder_elv=60", strength=own)[0]
            for one, own in who_hold(user, 3)
        ]
        times.append([[each.endurance_s[name] for each in held] for name in held[0].endurance_s])
    np.testing.assert_allclose(times[0][-2:], times[1][-2:])
    assert (np.array(times[0][:2]) < np.array(times[1][:2])).all()


def test_two_arms_without_muscles_use_published_strength() -> None:
    right, left = hold(UserConfig.model_validate(MOTORS), "shoulder_elv=90,elv_angle=90")
    assert (right.side, left.side) == ("right", "left")
    assert right.torque_nm == pytest.approx(left.torque_nm, rel=1e-3)
    assert right.share == right.strength_share
    assert right.activations == {}


MOTORS = {"model": "mobl_arms_bimanual_motor", "effort": {"model": "neural"}}


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ("shoulder_elv", "--pose: got 'shoulder_elv', expected JOINT=DEGREES"),
        ("shoulder_elv=nan", "--pose: got 'shoulder_elv=nan'"),
        ("shoulder=90", "--pose: got 'shoulder'"),
        ("shoulder_elv=200", "--pose shoulder_elv: got 200, expected 0 to 180 degrees"),
    ],
)
def test_wrong_postures(pose: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        posture_of(BODY, pose)


def test_wrong_numbers() -> None:
    with pytest.raises(InputError, match="--load: got -1, expected 0 to 100 kg"):
        hold(UserConfig(), "", -1.0)
    with pytest.raises(InputError, match="--people: got 0, expected 1 to 200"):
        who_hold(UserConfig(), 0)


def test_command(tmp_path: Path) -> None:
    words = ["audit", "--user", "mobl_arms_wrist", "--pose", "elv_angle=45,shoulder_elv=60"]
    said = CliRunner().invoke(app, [*words, "--out", str(tmp_path)])
    assert said.exit_code == 0, said.output
    for text in ("share of maximum at the shoulder", "NICER", "Consumed Endurance", "3CC-r"):
        assert text in said.output
    ((arm,),) = json.loads((tmp_path / "postures.json").read_text())["persons"]
    (held,) = hold(UserConfig(), "elv_angle=45,shoulder_elv=60")
    assert arm["endurance_s"] == pytest.approx(dict(held.endurance_s))


UPPER, LOWER, BENT = 0.30, 0.25, 2.0 * np.pi / 3.0
FAR = UPPER + LOWER
NEAR = np.sqrt(UPPER**2 + LOWER**2 + 2.0 * UPPER * LOWER * np.cos(BENT))
"""Of an arm that turns about its shoulder every way, with an elbow that bends by 120 degrees."""


def ball_arm() -> Body:
    """Two rods from a shoulder 1 m up; the tip is drawn 5 cm below the site ``grip``."""

    def build(_appearance: bool) -> mujoco.MjSpec:
        return mujoco.MjSpec.from_string(f"""
            <mujoco><compiler angle="radian"/><worldbody>
              <body name="upper" pos="0 0 1">
                <joint name="yaw" axis="0 0 1" range="-3.15 3.15" limited="true"/>
                <joint name="pitch" axis="0 1 0" range="-3.15 3.15" limited="true"/>
                <geom type="capsule" fromto="0 0 0 {UPPER} 0 0" size=".02"/>
                <body name="lower" pos="{UPPER} 0 0">
                  <joint name="elbow" axis="0 1 0" range="0 {BENT}" limited="true"/>
                  <geom type="capsule" fromto="0 0 0 {LOWER} 0 0" size=".02"/>
                  <site name="grip" pos="{LOWER} 0 0"/>
                </body>
              </body>
            </worldbody></mujoco>""")

    return Body(BodyPlan("ball_arm", (), (), ("grip",), 0.002), build)


@pytest.fixture(scope="module")
def reach() -> Reach:
    return Reach(Linkage(ball_arm(), Point("grip")))


def test_extent_and_volume_are_those_of_a_shell(reach: Reach) -> None:
    low, high = reach.extent()
    np.testing.assert_allclose(high, [FAR, FAR, 1.0 + FAR], atol=1e-3)
    np.testing.assert_allclose(low, [-FAR, -FAR, 1.0 - FAR], atol=1e-3)
    volume = reach.fill(0.05)
    litres = 4000.0 / 3.0 * np.pi * (FAR**3 - NEAR**3)
    assert volume.litres == pytest.approx(litres, rel=0.02)
    middle = np.rint((np.array([0.0, 0.0, 1.0]) - volume.low_m) / 0.05).astype(int)
    assert not volume.reached[tuple(middle)], "too near to the shoulder for this elbow"
    vertices, triangles = hull.shell(volume)
    radii = np.linalg.norm(vertices - [0.0, 0.0, 1.0], axis=1)
    assert NEAR - 0.05 < radii.min() < NEAR + 0.02
    assert FAR - 0.03 < radii.max() < FAR + 0.04
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    outwards = np.einsum("tx,tx->t", np.cross(b - a, c - a), a - [0.0, 0.0, 1.0])
    outer = np.linalg.norm(a - [0.0, 0.0, 1.0], axis=1) > 0.45
    assert (outwards[outer] > 0.0).mean() > 0.99, "fronts are outside"


def test_margins_are_distances_to_the_shell_s_two_sides(reach: Reach) -> None:
    expected = {
        0.45: FAR - 0.45,  # nearer to the outer side
        0.33: 0.33 - NEAR,  # nearer to the inner one
        0.62: -0.07,
        0.20: -(NEAR - 0.20),
    }
    way = np.array([0.6, 0.64, 0.48])
    verdicts = reach.judge(np.array([[0.0, 0.0, 1.0] + radius * way for radius in expected]))
    found = [verdict.margin_m for verdict in verdicts]
    np.testing.assert_allclose(found, list(expected.values()), atol=2e-3)
    assert [verdict.inside for verdict in verdicts] == [True, True, False, False]
    np.testing.assert_allclose(verdicts[2].nearest_m, [0.0, 0.0, 1.0] + FAR * way, atol=1e-3)


def test_a_tool_is_part_of_the_arm() -> None:
    longer = Linkage(ball_arm(), Point("grip", (0.1, 0.0, 0.0)))
    (verdict,) = Reach(longer).judge(np.array([[0.62, 0.0, 1.0]]))
    assert verdict.margin_m == pytest.approx(0.03, abs=3e-3)
    with pytest.raises(InputError, match="--point: got 'world'"):
        measure(ball_arm(), Point("world"))
    with pytest.raises(InputError, match="did you mean 'grip'"):
        chosen_point(ball_arm(), "grp")


def test_targets_by_hand_from_files_and_from_logs(tmp_path: Path) -> None:
    file, log = tmp_path / "t.yaml", tmp_path / "events.csv"
    file.write_text("targets: [{name: sign, place: [0, 0.1, 4], relative_to: head, how: look}]")
    cup, sign = listed_targets(["cup=0.2,1.1,0.45", str(file)])
    assert (cup.name, cup.from_head, sign.from_head, sign.how) == ("cup", False, True, "look")
    np.testing.assert_array_equal(cup.place_m, [0.2, 1.1, 0.45])
    for text in ("1,2", "a,b,c", "x=1,2,nan", "nowhere.yaml"):
        with pytest.raises(InputError, match=r"^--targets: got .*, expected .*RIGHT,UP,AHEAD"):
            listed_targets([text])
    grid = listed_targets([str(Path(__file__).parents[2] / "data" / "whacamole_round")])
    assert len(grid) == 9
    np.testing.assert_array_equal(grid[0].place_m, [0.025, 1.225, 0.4])
    half = np.sqrt(0.5)
    log.write_text(
        f"0, target plane transform 0.1 1.0 0.5 0 {half} 0 {half}\n"
        "0, target_spawn, target ID 0, grid ID 3, block 0, trial 0, center 0.2 0.1\n"
        "1, target_spawn, target ID 1, grid ID 3, block 0, trial 1, center 0.2 0.1\n"
    )
    (target,) = listed_targets([str(log)])
    # A quarter turn about the vertical takes right to backwards (left-handed: z to x, x to -z).
    np.testing.assert_allclose(target.place_m, [0.1, 1.1, 0.3], atol=1e-12)
    log.write_text("0, game options {}\n")
    with pytest.raises(InputError, match=r"^--targets: got .*says of no target where it is"):
        listed_targets([str(log)])


def test_a_game_s_tool_lies_in_the_hand() -> None:
    head = np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0])
    turn = np.array([0.1, 0.2, 0.3, 0.9]) / np.linalg.norm([0.1, 0.2, 0.3, 0.9])
    offsets = []
    for pose in (np.array([0.3, 1.0, 0.3, 0, 0, 0, 1.0]), np.array([0.1, 0.9, 0.2, *turn])):
        with InProcessApp("pointing", renderer="null") as app:
            app.reset(1, DevicePoses(head, pose))
            scene: AppScene = app.scene()
        point = tool_point(scene, "Tip")
        assert point.part == "controller_right"
        offsets.append(point.offset_m)
        (tip,) = scene.named("Tip")
        if pose[6] == 1.0:  # unturned: the offset is the difference, in the app's frame
            np.testing.assert_allclose(
                position_to_app(point.offset_m), tip.pose[:3] - pose[:3], atol=1e-6
            )
    np.testing.assert_allclose(offsets[0], offsets[1], atol=1e-6)
    with pytest.raises(InputError, match=r"^--tool: got 'Hammer', which 0 objects .*/Tip'"):
        tool_point(scene, "Hammer")


@pytest.fixture(scope="module")
def found(reach: Reach) -> Measured:
    targets = (
        Target("near", np.array([0.0, 1.0, 0.45])),
        Target("<far>", np.array([0.0, 1.0, 0.62])),
    )
    point = Point("grip")
    people = np.array([[0.031, np.nan], [-0.025, np.nan], [0.2, np.nan]])
    return measure(ball_arm(), point, targets, people, cell_m=0.1)


def test_tables_and_page(found: Measured, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hull, "write_picture", lambda found, file: (file.write_bytes(b""), file)[1])
    written = [file.name for file in hull.write(found, tmp_path)]
    assert written == ["targets.csv", "hull.csv", "hull.html", "hull.png"]
    with (tmp_path / "targets.csv").open() as table:
        near, far = csv.DictReader(table)
    assert (near["inside"], far["inside"]) == ("1", "0")
    assert float(far["margin_cm"]) == pytest.approx(-7.0, abs=0.1)
    assert float(near["margin_cm"]) == pytest.approx(10.0, abs=0.2)
    assert float(far["nearest_ahead_m"]) == pytest.approx(FAR, abs=1e-3)
    text = (tmp_path / "hull.html").read_text()
    answer = "ball_arm cannot reach 1 of 2 targets with grip; out of reach: <far> by 7.0 cm."
    assert answer.replace("<far>", "&lt;far&gt;") in text and "outside by 7.0 cm" in text
    assert not re.search(r"<(script|link)[^>]*\b(src|href)=(?!.data:)", text), (
        "opens without a network"
    )
    inside = "  near: inside, 10.1 cm to spare; 2 of 3 participants, at worst outside by 2.5 cm"
    outside = "  <far>: outside by 7.0 cm; in no round of participants"
    lines = hull.told(found)
    assert lines[0] == answer and lines[5:] == [inside, outside]


def test_a_game_s_places_are_the_same_for_everybody() -> None:
    """Whac-A-Mole has a grid of 3 x 3, placed by the head, which people hold elsewhere."""
    env = environment_of("mobl_arms_wrist", game="whacamole", condition="low")
    places = seen_targets(alike(env), None, seconds=8.0, rounds=2)
    assert [place.name for place in places] == [f"Target {k}" for k in range(1, 10)]
    several = with_people(alike(env), 2, 1)
    own = seen_targets(several, None, seconds=8.0, rounds=1, person=1)
    matched = [[place.same_as(target) for place in places].count(True) for target in own]
    assert len(own) >= 8 and matched == [1] * len(own)
    moved = [target.place_m - places[0].place_m for target in own if target.same_as(places[0])]
    assert np.linalg.norm(moved[0]) > 0.01, "their heads are elsewhere"


def test_people_reach_what_their_own_arms_allow() -> None:
    env = environment_of("mobl_arms_wrist")
    point = Point("controller_right")
    body = load_body("mobl_arms_wrist", appearance=False)
    top_m = position_to_app(Reach(Linkage(body, point)).furthest(np.array([[0.0, 0.0, 1.0]])))[0]
    places = [Target("below", top_m - np.array([0.0, 0.25, 0.0])), Target("at", top_m)]
    asked: list[int] = []

    def look(_: ResolvedEnv, person: int) -> list[Target]:
        asked.append(person)
        return places

    margins = people_margins(env, point, places, 4, look)
    assert asked == [0, 1, 2, 3]
    people = Population(PeopleSettings(seed=1, count=4))
    statures = np.array([people.number(k).stature_m for k in range(4)])
    assert statures.min() < 1.70 < statures.max()
    # The average body is 1.70 m tall; shoulder and arm of taller people end higher.
    assert (margins[:, 1] > 0.0).tolist() == (statures > 1.70).tolist()
    assert (margins[:, 0] > margins[:, 1]).all()


def test_a_target_of_the_head_is_placed_from_where_it_rests() -> None:
    body = load_body("mobl_arms_wrist", torso=True, appearance=False)
    data = mujoco.MjData(body.physics_model)
    rest = [body.reset_rule.posture.get(joint, 0.0) for joint in body.independent_joints]
    data.qpos[:] = body.coupled_qpos(np.array(rest))
    mujoco.mj_kinematics(body.physics_model, data)
    ahead = Target("ahead", np.array([0.1, -0.2, 0.4]), from_head=True)
    (placed,) = measure(body, Point("controller_right"), [ahead], cell_m=0.2).targets
    head = position_to_app(data.site("headset").xpos)
    np.testing.assert_allclose(placed.place_m, head + ahead.place_m, atol=1e-9)


def test_an_object_that_is_put_elsewhere_counts_where_it_rests() -> None:
    rest = Resting(np.zeros(3))
    places = [np.zeros(3)] * 6 + [np.array([0.1, 0.0, 0.0])] * 6 + [np.zeros(3)] * 6
    came = [rest.add(place) for place in places]
    assert [number for number, each in enumerate(came) if each] == [10, 16]
    assert [each.tolist() for each in rest.others(np.zeros(3))] == [[0.1, 0.0, 0.0]]
    # One that moves on rests nowhere else.
    rest = Resting(np.zeros(3))
    path = [np.array([0.0, min(0.02 * step, 0.2), 0.0]) for step in range(30)]
    assert not any([rest.add(place) for place in path])
    assert rest.others(path[-1]) == []
