"""The settings of a simulated population, the same for every app (docs/concepts/people.md)."""

from __future__ import annotations

from sim2vr_harness.envs.config import EnvConfig, NoiseConfig, UserConfig
from sim2vr_harness.users import PeopleSettings, Physique, load_body
from sim2vr_harness.users.bodies.options import JointOptions

_STRENGTH = 1.28
"""The body's raised arm is weak (docs/concepts/people.md#strength)."""
_LIGHT = JointOptions(armature=0.0, damping=0.03)
_HAND_JOINTS = ("flexion", "deviation", "pro_sup")
_NOISE = NoiseConfig(
    signal_dependent="white",
    signal_dependent_level=0.01,
    constant="white",
    constant_level=0.001,
)


def as_population(user: UserConfig) -> UserConfig:
    """Return a user's configuration with persons who differ, motor noise and light hands.

    Heads of bodies without a neck follow the hand and sway.

    What the configuration sets itself stays.
    """
    given = user.model_fields_set
    update: dict[str, object] = {}
    if user.people is None:
        update["people"] = PeopleSettings(strength=_STRENGTH)
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
