"""People: a distribution whose members do not depend on one another, and what acts of a person."""

import dataclasses

import numpy as np
import pytest

from python.users.bodies import body
from sim2vr_harness.users import (
    AVERAGE,
    FEATURES,
    Body,
    MotorNoiseSettings,
    PeopleSettings,
    Person,
    Physique,
    Population,
    UserBatch,
)

BODY = body()


def cut(physique: Physique) -> Body:
    return body(person=physique)


def users(n: int, people: Population, **settings: object) -> UserBatch:
    return UserBatch(BODY, n, threads=1, people=people, cut=cut, **settings)  # type: ignore[arg-type]


def start(batch: UserBatch, persons: list[Person], seed: int = 3) -> None:
    n = len(persons)
    batch.reset(range(n), [np.random.default_rng(seed) for _ in range(n)], persons=persons)


@pytest.fixture(scope="module")
def crowd() -> list[Person]:
    return [Population(PeopleSettings()).number(k) for k in range(2000)]


def test_a_number_is_one_person_whatever_else_varies() -> None:
    people = Population(PeopleSettings(seed=4))
    assert people.number(7) == Population(PeopleSettings(seed=4)).sample(4, 7)
    assert people.number(7) != people.number(8)
    assert people.number(7) != people.sample(5, 7)
    strong = Population(PeopleSettings(seed=4, vary=("strength",))).number(7)
    assert strong == dataclasses.replace(AVERAGE, index=7, strength=people.number(7).strength)


def test_people_are_as_the_sources_say(crowd: list[Person]) -> None:
    stature = np.array([one.stature_m for one in crowd])
    # Women 1.629 and men 1.756 m, each +- .0665 cut at 2 deviations (which leaves .88 of it).
    assert stature.mean() == pytest.approx(1.692, abs=0.006)
    assert stature.std() == pytest.approx(np.hypot(0.0635, 0.88 * 0.0665), abs=0.003)
    strength = np.log([one.strength for one in crowd])
    assert np.exp(strength.mean()) == pytest.approx(np.sqrt(31 / 51), abs=0.02)
    # The sexes' means are 2 x .249 apart: a strong person is rather a tall one.
    assert np.corrcoef(stature, strength)[0, 1] == pytest.approx(
        0.0635 * 0.249 / (np.hypot(0.0635, 0.0585) * np.hypot(0.249, 0.158)), abs=0.05
    )
    assert {round(one.visual_delay_s, 9) for one in crowd} == {0.09, 0.1, 0.11}
    noise = np.log([one.motor_noise for one in crowd])
    assert (noise.mean(), noise.std()) == pytest.approx((0.0, 0.88 * 0.12), abs=0.01)


def test_features_are_about_minus_one_to_one(crowd: list[Person]) -> None:
    features = np.array([one.features for one in crowd])
    assert features.shape == (2000, len(FEATURES)) and features.dtype == np.float32
    assert np.abs(features).max() <= 1.0
    shape = features[:, [FEATURES.index(name) for name in ("stature_m", "strength")]]
    assert shape.min() < -0.9 and shape.max() > 0.9
    tall = dataclasses.replace(AVERAGE, stature_m=1.692 + 0.1965)
    assert tall.features[0] == pytest.approx(1.0)


def test_spread_and_means_can_be_set() -> None:
    alike = Population(PeopleSettings(spread=0.0, visual_delay_s=0.15))
    assert dataclasses.replace(alike.number(1), index=2) == alike.number(2)
    assert alike.number(1).visual_delay_s == pytest.approx(0.15)
    wide = Population(PeopleSettings(spread=2.0))
    near = Population(PeopleSettings())
    assert wide.number(3).stature_m - 1.692 == pytest.approx(
        2.0 * (near.number(3).stature_m - 1.692)
    )
    assert near.longest("visual_delay_s") == pytest.approx(0.11)
    quick = Population(PeopleSettings(spread=2.0, visual_delay_s=0.0))
    assert {quick.number(k).visual_delay_s for k in range(50)} <= {0.0, 0.01, 0.02, 0.03}
    assert min(quick.number(k).visual_delay_s for k in range(50)) == 0.0
    few = Population(PeopleSettings(count=3))
    assert {few.of_episode(seed).index for seed in range(40)} == {0, 1, 2}


def test_a_body_of_its_own() -> None:
    people = Population(PeopleSettings())
    small, tall = (dataclasses.replace(AVERAGE, stature_m=s) for s in (1.53, 1.87))
    long = dataclasses.replace(AVERAGE, forearm_factor=1.1)
    batch = users(4, people)
    start(batch, [AVERAGE, small, tall, long])
    batch.turn_head(range(4), None)
    head = batch.device_poses("headset")[0]
    # Everything hangs on the root, whose height above the floor scales too: eye height goes along.
    assert head[1, 2] / head[0, 2] == pytest.approx(0.9, abs=1e-9)
    assert head[2, 2] / head[0, 2] == pytest.approx(1.1, abs=1e-9)
    np.testing.assert_allclose(head[3], head[0], atol=1e-12)
    models = [batch.who.body(i).physics_model for i in range(4)]
    arm = models[0].body("ulna").id
    masses = [model.body_mass[arm] for model in models]
    assert masses[1] / masses[0] == pytest.approx(0.81)  # constant body-mass index
    hand = [np.linalg.norm(model.body("radius").pos - 0) for model in models]
    assert hand[3] / hand[0] == pytest.approx(1.1)


def test_strength_noise_and_effort_act() -> None:
    people = Population(PeopleSettings(vary=("strength", "motor_noise", "effort_weight")))
    weak = dataclasses.replace(AVERAGE, strength=0.5)
    keen = dataclasses.replace(AVERAGE, effort_weight=0.25)
    batch = users(3, people)
    start(batch, [AVERAGE, weak, keen])
    np.testing.assert_allclose(batch.actuator_force[1], 0.5 * batch.actuator_force[0], rtol=1e-9)
    batch.step(np.full((3, 32), 0.2))
    assert batch.effort_cost[2] == 0.25 * batch.effort_cost[0] > 0.0
    np.testing.assert_array_equal(batch.qpos[2], batch.qpos[0])
    assert np.abs(batch.qpos[1] - batch.qpos[0]).max() > 1e-3

    noisy = users(3, people, noise=MotorNoiseSettings(constant=None))
    shaky, still = (dataclasses.replace(AVERAGE, motor_noise=f) for f in (2.0, 1e-9))
    start(noisy, [AVERAGE, shaky, still])
    clean = np.clip(noisy.act + 0.1, 0.0, 1.0)
    noisy.step(np.full((3, 32), 0.1))
    inside = (noisy.ctrl[1] > 0.0) & (noisy.ctrl[1] < 1.0) & (clean[0] < 0.9)
    off = (noisy.ctrl - clean)[:, inside]
    assert inside.sum() > 10
    np.testing.assert_allclose(off[1], 2.0 * off[0], atol=1e-12)
    assert np.abs(off[2]).max() < 1e-6 < np.abs(off[0]).max()
