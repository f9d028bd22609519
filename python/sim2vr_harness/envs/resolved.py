"""An environment's configuration and the objects made from it, and the contract of a policy."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from gymnasium import spaces

from sim2vr_harness.client import (
    GameFacts,
    OptionValue,
    describe_game,
    facts_of_outside,
    list_games,
)
from sim2vr_harness.client.games import require_game_library
from sim2vr_harness.client.tasks import load_task, names_code, task_facts
from sim2vr_harness.envs.apps import facts_told, judged, knows_options
from sim2vr_harness.envs.checks import checked_substeps
from sim2vr_harness.envs.config import EnvConfig, UserConfig, people_of, with_options
from sim2vr_harness.envs.senses import make_actions, make_perception
from sim2vr_harness.perception import SENSES, Proprioception
from sim2vr_harness.users import (
    FEATURES,
    Body,
    Physique,
    Population,
    installed_bodies,
    load_body,
)

_OF_THE_BODY = ("skull_rotation_deg", "devices", "timestep_s", "torso", "reset")
"""Settings of ``user`` that its body has, besides ``model`` and ``person``."""


@dataclass(frozen=True)
class ResolvedEnv:
    """A configuration with its body, game facts, people, spaces and contract.

    Each of them is made once, when it is first read. Code that needs one receives this object
    instead of the configuration, and the methods that return another one share with it all parts
    that their change does not affect. Pickled, it is the configuration alone.
    """

    config: EnvConfig

    def __reduce__(self) -> Any:
        return type(self), (self.config,)

    @classmethod
    def of(cls, env: "EnvConfig | ResolvedEnv | None") -> "ResolvedEnv":
        """Return that of a configuration that may be resolved already; None: of the defaults."""
        if isinstance(env, ResolvedEnv):
            return env
        return cls(EnvConfig() if env is None else env)

    @classmethod
    def of_user(cls, user: UserConfig) -> "ResolvedEnv":
        """Return that of a user alone, whatever it plays."""
        return cls(EnvConfig(user=user))

    def sharing(self, config: EnvConfig) -> "ResolvedEnv":
        """Return that of another configuration, sharing equal parts of body and game."""
        if config is self.config:
            return self
        other, own = type(self)(config), self.config
        shared: list[str] = []
        if all(
            getattr(config.user, name) == getattr(own.user, name)
            for name in ("model", "person", *_OF_THE_BODY)
        ):
            shared = ["body"]
        if config.app.model_copy(update={"options": own.app.options}) == own.app:
            shared += ["facts", "facts_unasked"]
        vars(other).update({name: vars(self)[name] for name in shared if name in vars(self)})
        return other

    def changed(self, **settings: Any) -> "ResolvedEnv":
        """Return that of the configuration with other settings of it."""
        return self.sharing(self.config.model_copy(update=settings))

    @cached_property
    def body(self) -> Body:
        """The users' body, including rendered parts; for people, the parts that they share.

        Raises:
            ValueError: it cannot be used; see `load_body`.
        """
        return self.body_for(self.config.user.person)

    def body_for(self, physique: Physique) -> Body:
        """Return the users' body, cut to someone."""
        user = self.config.user
        settings: dict[str, Any] = {name: getattr(user, name) for name in _OF_THE_BODY}
        return load_body(user.model, person=physique, **settings)

    @cached_property
    def people(self) -> Population | None:
        """The population that users are drawn from; None: all are average."""
        return people_of(self.config.user)

    @cached_property
    def facts(self) -> GameFacts:
        """Facts about the game that the app plays.

        If a task judges the app, the task's facts replace those that the game publishes.

        Raises:
            ValueError: The runtime has no such game; the message names the nearest. Or a library of
                games is named whose code may not run.
            RuntimeError: The app does not answer.
        """
        return self._facts(ask=True)

    @cached_property
    def facts_unasked(self) -> GameFacts:
        """:attr:`facts`, without requests to a running app and without a task's code.

        Raises:
            ValueError: As of :attr:`facts`.
        """
        return self._facts(ask=False)

    def _facts(self, *, ask: bool) -> GameFacts:
        app = self.config.app
        if app.game_library is not None:
            require_game_library(app.game_library)
        if judged(app):
            if names_code(app.task) and not ask:
                return GameFacts(name=app.game, published=False)
            return task_facts(load_task(app.task), app.game)
        if knows_options(app) or (app.transport == "protocol2" and app.game in list_games()):
            return describe_game(app.game)
        told = facts_told(app) if ask and app.game not in list_games() else None
        return told or facts_of_outside(app.game)

    @cached_property
    def observation_space(self) -> spaces.Dict:
        """Observation space of the users."""
        body = self.body
        substeps = checked_substeps(self.config, body.timestep)
        actions = len(make_actions(self.config, 1, body).names)
        return make_perception(self.config, 1, Proprioception(body), substeps, actions).space

    @cached_property
    def action_space(self) -> spaces.Box:
        """Box(-1, 1, (A,)) of the body's own actions."""
        return spaces.Box(-1.0, 1.0, (self.body.action_size,), np.float32)

    def with_options(self, options: Mapping[str, OptionValue]) -> "ResolvedEnv":
        """Return the environment with further options of its game."""
        return self.sharing(with_options(self.config, options))

    def with_condition(self, condition: str | None) -> "ResolvedEnv":
        """Return the environment with the options of a condition of its game; None leaves it.

        Raises:
            ValueError: The game has no such condition; names the nearest.
        """
        if condition is None:
            return self
        return self.with_options(self.facts.condition(condition).options)

    def with_game(self, game: str | None) -> "ResolvedEnv":
        """Return the environment with another game; None: the same game.

        If the configuration names no body, the result has one that wears the game's devices, and if
        it names no inputs, those that the game reads.
        """
        if game is None or game == self.config.app.game:
            return self
        other = self.changed(app=self.config.app.model_copy(update={"game": game}))
        facts = other.facts_unasked
        return other._fitted(facts.needs("right"), facts.inputs)

    def with_task(self) -> "ResolvedEnv":
        """Return the environment with the inputs that the app reads, and a body for its task.

        As far as the configuration does not say which itself.

        Raises:
            InputError: the task cannot be used.
        """
        if not judged(self.config.app):
            return self._fitted((), self.facts_unasked.inputs)
        task = load_task(self.config.app.task)
        return self._fitted(tuple(task.devices), tuple(task.inputs))

    def _fitted(self, devices: tuple[str, ...], inputs: tuple[str, ...]) -> "ResolvedEnv":
        """Return the environment with a body that wears devices, and inputs, unless named."""
        user, changes = self.config.user, dict[str, Any]()
        if inputs and "inputs" not in user.model_fields_set:
            changes["inputs"] = inputs
        if devices and "model" not in user.model_fields_set:
            changes["model"] = _body_wearing(devices, user.model)
        return self.changed(user=user.model_copy(update=changes)) if changes else self

    def without_training(self, overrides: Sequence[str] = ()) -> "ResolvedEnv":
        """Return :meth:`with_task` for a user without depth, which few OpenXR programs submit.

        Args:
            overrides: ``KEY=VALUE`` that were given; channels among them are kept.
        """
        vision, given = self.config.vision, any("vision.channels" in one for one in overrides)
        if self.config.app.transport != "openxr" or given:
            return self.with_task()
        colours = tuple(name for name in vision.channels if name != "depth")
        return self.changed(vision=vision.model_copy(update={"channels": colours})).with_task()

    def with_hand(self) -> "ResolvedEnv":
        """Return the environment in which the game is played with the user's own hand.

        That is the person's `handedness`, as far as they wear a controller there, or the only hand
        with a controller. A hand among the game's options stays.

        Raises:
            ValueError: the user does not wear the controllers that the game is played with.
        """
        env, option, body = self, self.facts.hand_option, self.body
        if option is not None and option not in self.config.app.options:
            worn = [hand for hand in ("right", "left") if f"controller_{hand}" in body.devices]
            own = self.config.user.person.handedness
            hand = own if own in worn else next(iter(worn), "right")
            if hand == "left":
                env = self.with_options({option: hand})
        hand_played = env.config.app.options.get(option, "right") if option else "right"
        env.require_worn(str(hand_played))
        return env

    def require_worn(self, hand: str) -> None:
        """Check that the body wears the devices that its game needs, for this hand.

        Raises:
            ValueError: it does not.
        """
        facts, body = self.facts, self.body
        for device in facts.needs(hand):
            if device not in body.devices:
                how = f" with {facts.hand_option}={hand}" if facts.hand_option else ""
                raise ValueError(
                    f"user: got {body.name!r} wearing {', '.join(body.devices)}, expected "
                    f"{device}, which {facts.name}{how} is played with"
                )

    @cached_property
    def contract(self) -> dict[str, Any]:
        """The environment's side of a trained user's agreement, as plain values.

        Two environments with equal contracts can be played by the same policy. Effort, noise and
        the game's options are no part of it: they decide how well a user does, not whether it can
        act.
        """
        config, body, space = self.config, self.body, self.observation_space
        sight = config.sense("vision")
        buffer_s = None if sight is None else sight.history_s
        person = config.user.person.model_dump(exclude_defaults=True)
        return {
            "game": config.app.game,
            "user": body.name,
            "skull_rotation_deg": config.user.skull_rotation_deg,
            "muscles": list(body.muscles),
            **_beyond_muscles(body),
            **({"person": person} if person else {}),
            "action": "change of activation, -1 to 1",
            "action_frequency_hz": config.action_frequency_hz,
            "frames_per_step": config.frames_per_step,
            "image": [config.vision.width, config.vision.height],
            "channels": list(config.vision.channels),
            "buffer_s": list(buffer_s) if isinstance(buffer_s, tuple) else buffer_s,
            "observation": {
                key: [list(box.shape or ()), str(box.dtype)]
                for key, box in sorted(space.spaces.items())
            },
            **_beyond_the_default(config),
        }


@cache
def _body_wearing(devices: tuple[str, ...], usual: str) -> str:
    """Return the usual body, or the one with the fewest muscles that can wear the devices.

    It is the usual one, too, if no body can wear them. Without muscles the usual effort model has
    no input.
    """
    if set(devices) <= set(load_body(usual).devices):
        return usual
    able = {}
    for name in installed_bodies():
        body = load_body(name)
        if body.muscles and set(devices) <= set(body.devices):
            able[name] = len(body.muscles)
    return min(able, key=able.__getitem__, default=usual)


def _beyond_muscles(body: Body) -> dict[str, Any]:
    """Return a body's features other than muscles, a headset and a right controller."""
    terms: dict[str, Any] = {}
    if body.action_names != body.muscles:
        terms["actuators"] = [[group.rule, *group.actuators] for group in body.actuator_groups]
    if sorted(body.devices) != ["controller_right", "headset"]:
        terms["devices"] = sorted(body.devices)
    return terms


def _beyond_the_default(config: EnvConfig) -> dict[str, Any]:
    """Return terms that are named only if they are not the default.

    How late, noisy or coarse a sense is, is none of them: a policy can act with it.
    """
    terms: dict[str, Any] = {}
    kinds = {(one.name or SENSES[one.sense].key): one.sense for one in config.senses}
    if any(SENSES[kind].key != key for key, kind in kinds.items()):
        terms["senses"] = kinds
    if config.vision.eyes != 1:
        terms["eyes"] = config.vision.eyes
    if config.user.inputs:
        terms["inputs"] = list(config.user.inputs)
    if config.gaze_moves:
        terms["gaze"] = "moves"
    if config.sense("person") is not None:
        terms["person_features"] = list(FEATURES)
    return terms


def contract_hash(terms: dict[str, Any]) -> str:
    """16 hexadecimal digits; equal contracts have equal ones."""
    text = json.dumps(terms, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[tuple[str, Any, Any]]:
    """Return the terms in which two contracts differ: (name, of the one, of the other)."""
    return [
        (key, one.get(key), other.get(key))
        for key in [*one, *(key for key in other if key not in one)]
        if one.get(key) != other.get(key)
    ]


def worded(found: list[tuple[str, Any, Any]]) -> tuple[str, str]:
    """Word :func:`differences` for an error: the terms of the one, and of the other."""

    def short(value: Any) -> str:
        text = json.dumps(value)
        return text if len(text) <= 80 else f"{text[:77]}..."

    one = "; ".join(f"{key} {short(value)}" for key, value, _ in found)
    return one, "; ".join(f"{key} {short(value)}" for key, _, value in found)
