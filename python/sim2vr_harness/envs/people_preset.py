"""The settings of a simulated population, the same for every app (docs/concepts/people.md)."""

from collections.abc import Sequence

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import EnvConfig, NoiseConfig, UserConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.users import PeopleSettings, Physique, load_body
from sim2vr_harness.users.bodies.options import JointOptions

STRENGTH = 1.28
"""Median factor on the published arm's peak forces, whose raised arm is weak
(docs/concepts/people.md#strength)."""
_LIGHT = JointOptions(armature=0.0, damping=0.03)
_HAND_JOINTS = ("flexion", "deviation", "pro_sup")
_NOISE = NoiseConfig(
    signal_dependent="white",
    signal_dependent_level=0.01,
    constant="white",
    constant_level=0.001,
)


def as_population(user: UserConfig, count: int | None = None) -> UserConfig:
    """Return a user's configuration with virtual participants, motor noise and light hands.

    Heads of bodies without a neck follow the hand and sway. Settings of the configuration itself
    are kept. ``count`` is the number of persons, if it is given.
    """
    given = user.model_fields_set
    people = user.people or PeopleSettings(strength=STRENGTH)
    if count is not None:
        people = PeopleSettings(**(people.model_dump() | {"count": count}))
    update: dict[str, object] = {"people": people}
    if "noise" not in given:
        update["noise"] = _NOISE
    body = load_body(user.model)
    if "head" not in given and body.nod is None and not user.torso:
        update["head"] = "reflex"
    if not user.person.joints:
        names = body.independent_joints
        joints = {name: _LIGHT for name in names if name.startswith(_HAND_JOINTS)}
        update["person"] = Physique(
            **{**user.person.model_dump(exclude_unset=True), "joints": joints}
        )
    return user.model_copy(update=update)


def with_people(
    env: ResolvedEnv, count: int, seed: int, overrides: Sequence[str] = ()
) -> ResolvedEnv:
    """Return an environment with a number of persons of a seed.

    Users that were trained with persons play with their own population. All others play with that
    of :func:`as_population`, with its strength and motor noise; their hands and heads stay those of
    the body that they were trained with. ``overrides`` may set another noise, or none.

    Raises:
        InputError: The number is 0, or the configuration sets a property that people differ in.
    """
    if count < 1:
        raise InputError("--people", str(count), "at least 1")
    given = env.config.user
    user = given.model_dump()
    if given.people is None:
        user["people"] = PeopleSettings(strength=STRENGTH).model_dump()
        named = any(override.strip().startswith("env.user.noise") for override in overrides)
        if given.noise == NoiseConfig() and not named:
            user["noise"] = _NOISE
    user["people"] |= {"seed": seed, "count": count}
    return env.changed(user=UserConfig(**user))


def with_measured_body(env: EnvConfig) -> EnvConfig:
    """Return an environment with the measured body in the place of persons.

    It has no motor noise and holds its head still.
    """
    if env.user.people is None:
        return env
    plain: dict[str, object] = {
        "people": None,
        "noise": NoiseConfig(),
        "person": Physique(),
        "head": "fixed",
    }
    senses = tuple(sense for sense in env.senses if sense.sense != "person")
    user = env.user.model_copy(update=plain)
    return env.model_copy(update={"user": user, "senses": senses})
