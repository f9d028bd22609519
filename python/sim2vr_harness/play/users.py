"""Users that play: trained ones, and those that need no training."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import GameFacts, Measure, TaskedApp
from sim2vr_harness.client.tasks.events import EVENT_VALUE
from sim2vr_harness.envs.people_preset import as_population, with_people
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.play.environment import as_overrides, evaluation_env
from sim2vr_harness.play.player import Watcher, reward_per_minute
from sim2vr_harness.play.round import Round
from sim2vr_harness.policies.protocol import Policy
from sim2vr_harness.policies.registry import load_policy
from sim2vr_harness.policies.scripted import (
    ScriptedPolicy,
    is_script,
    read_steps,
    scripted_policy,
    with_inputs,
)
from sim2vr_harness.policies.store import TrainedUser, find_user, require_contract
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.runs.trust import require_trust

_UNTRAINED = "webxr"
"""Configuration of users without training."""

STEP_MEASURES = (
    Measure("steps_done", "Steps done", better="higher", digits=0),
    Measure("steps_failed", "Steps not done", better="lower", digits=0),
)
"""Of a script; steps that were not begun count as not done."""
PERSON_MEASURES = (
    Measure(
        "step_time",
        "Time per step",
        unit="s",
        better="lower",
        digits=2,
        description="Until a press, or the arrival: reaction time included",
    ),
    Measure(
        "step_misses",
        "Steps beside the target",
        unit="proportion",
        better="lower",
        digits=3,
        description="Steps done with hand or ray beside the object by more than half its width",
    ),
)
COMFORT_MEASURES = tuple(
    Measure(name, label, unit="degrees", better="none", digits=0, description=f"{what} of a step")
    for name, label, what in (
        ("head_flexion", "Head bent forward", "Below the horizon, at the end"),
        ("head_rotation", "Head turned aside", "To either side, at the end"),
        ("gaze_eccentricity", "Eyes turned", "Between head and object, at the end"),
    )
)
SCRIPT_MEASURES = (*STEP_MEASURES, *PERSON_MEASURES, *COMFORT_MEASURES)
"""Of a script; all but the first two are means over the steps that were done in a round."""

BASELINE_S = 6.0
"""Duration of the idle and of the random baseline, s: a few targets of a game."""
_COMPARED = 8
"""Users that are idle and that move at random where doing nothing is judged."""


@dataclass(frozen=True)
class SimulatedUser:
    """Simulated user that plays.

    Attributes:
        name: Folder and checkpoint of a run; of a user without training the name that was given.
        source: Name or path as given.
        config: Configuration of its training; without training the configuration ``webxr``.
        trained: Trained policy; None: it needs no training.
    """

    name: str
    source: str | Path
    config: TrainingConfig
    trained: TrainedUser | None = None

    @classmethod
    def find(cls, who: str | Path) -> SimulatedUser:
        """Return the user of a name: as of :func:`find_user`, ``still``, ``random`` or a script.

        Raises:
            InputError: There is no such user, or its script has another form.
        """
        text = str(who)
        if is_script(text):
            read_steps(text)
        if is_script(text) or text in ("still", "random"):
            return cls(text, text, load_config(_UNTRAINED, ["evaluation.episodes=2"]))
        trained = find_user(who, code=True)
        return cls(name_of(trained), who, trained.config, trained)

    def env(
        self,
        app: Mapping[str, Any] | None = None,
        overrides: Sequence[str] = (),
        *,
        game: str | None = None,
        trust_app: bool = False,
        file: str | Path | None = None,
        person: int | None = None,
        seed: int | None = None,
    ) -> ResolvedEnv:
        """Return the environment that it plays in; see :func:`.evaluation_env`.

        Args:
            app: Settings that replace those of ``env.app``.
            overrides: ``env.KEY=VALUE``, what else is different.
            game: Another game than the configuration's.
            trust_app: Whether the app that the user names may be started, though you never have.
            file: That says so, of a user without training; None: this user has typed it.
            person: Number, from 0, of the virtual participant who plays; None: as it says.
            seed: Of the virtual participants.

        Raises:
            InputError: They do not go together, or name a program that this user has never started.
        """
        if self.trained is not None:
            source = self.source
            env = evaluation_env(self.config, app, overrides, source=source, trust_app=trust_app)
            env = self.trained.env.sharing(env.config).with_game(game)
            return env if person is None else self.with_people(env, person + 1, seed, overrides)
        # Read as one: what is not set follows from the app and its task.
        for override in overrides:
            if not override.lstrip().startswith("env."):
                expected = "env.KEY=VALUE: a user without training learns nothing"
                raise InputError("--set", repr(override), expected)
        env = ResolvedEnv(load_config(_UNTRAINED, [*overrides, *as_overrides(app or {})]).env)
        if file is not None:
            require_trust(env.config, file, trust=trust_app)
        env = with_inputs(env.with_game(game).without_training(overrides), self.name)
        if person is not None:
            return self.with_people(env, person + 1, seed, overrides)
        return env if env.config.user.people is None else self.with_people(env)

    def with_people(
        self,
        env: ResolvedEnv,
        count: int | None = None,
        seed: int | None = None,
        overrides: Sequence[str] = (),
    ) -> ResolvedEnv:
        """Return its environment with so many participants of a seed; None: as it says.

        A script is carried out by the human motor policy of participants, with the hands and heads
        that it was trained with.
        """
        if not is_script(self.name) or self.trained is not None:
            return env if count is None else with_people(env, count, seed or 0, overrides)
        user = as_population(env.config.user, count)
        if user.people is not None and seed is not None:
            user = user.model_copy(update={"people": user.people.model_copy(update={"seed": seed})})
        return env.changed(user=user)

    def require_contract(self, env: ResolvedEnv) -> None:
        """Refuse an environment that it cannot play in; without training it plays in any.

        Raises:
            InputError: It senses or acts otherwise than in its training.
        """
        if self.trained is not None:
            require_contract(self.trained, env)

    def facts(self, facts: GameFacts) -> GameFacts:
        """Return what a game publishes, with the measures of a script if the user follows one."""
        if self.trained is not None or not is_script(self.name):
            return facts
        return replace(facts, measures=(*facts.measures, *SCRIPT_MEASURES))

    def policy(self, simulation: Any, facts: GameFacts) -> tuple[Policy, int]:
        """Return what acts for the users of a simulation, and the user steps of its training.

        Args:
            simulation: In its environment.
        """
        if self.trained is not None:
            spaces = simulation.observation_space, simulation.action_space
            return load_policy(self.trained, *spaces)
        if not is_script(self.name):
            return scripted_policy(self.name, simulation), 0
        app = simulation.apps[0]
        watched = {key for one in facts.scalars for key in (one.log_key, one.rate_with) if key}
        if isinstance(app, TaskedApp):
            watched |= {name for name in app.task.values if not name.startswith(EVENT_VALUE)}
        return _Script(simulation, read_steps(self.name), watched), 0


def name_of(user: TrainedUser) -> str:
    """Return a packed user's name, or the run's and the checkpoint's."""
    if "name" in user.card:
        return str(user.card["name"])
    return f"{Path(os.path.realpath(user.source)).parents[1].name}/{user.source.stem}"


class _Script(ScriptedPolicy, Watcher):
    """A script that adds to each round what its steps did."""

    def measured(self, index: int, result: Round) -> Round:
        """Add the outcomes of the steps, how many were done, and why none could be done."""
        steps, people = self.episodes[index].ended(), result.person is not None
        done = [step for step in steps if step.done]
        counts: dict[str, float | None] = {
            "steps_done": len(done),
            "steps_failed": len(steps) - len(done),
        }
        if people and not done:
            # Someone who cannot do the task is excluded from what is measured of it.
            why = steps[0].problem if steps else "the round ended before a step was begun"
            nothing = dict.fromkeys(result.values)
            return replace(result.with_values(nothing | counts), script=tuple(steps), excluded=why)
        if people:
            counts["step_time"] = float(np.mean([step.time_s for step in done]))
            counts["step_misses"] = float(np.mean([step.missed for step in done]))
            heads = [step.head_deg for step in done if step.head_deg is not None]
            means = np.mean(heads, axis=0).tolist() if heads else [None] * len(COMFORT_MEASURES)
            counts |= {one.name: x for one, x in zip(COMFORT_MEASURES, means, strict=True)}
        return replace(result.with_values(counts), script=tuple(steps))


def baseline_reward(simulation: Any, user: str, seed: int) -> tuple[float, float]:
    """Let all users play for :data:`BASELINE_S` without training.

    Args:
        simulation: Of the users; it is reset.
        user: ``still`` or ``random``.
        seed: Of the first user's round.

    Returns:
        Mean reward of the app and mean cost of effort, both per minute.
    """
    policy, seeds = scripted_policy(user, simulation), range(seed, seed + simulation.n)
    steps = round(BASELINE_S * simulation.config.action_frequency_hz)
    return reward_per_minute(simulation, policy, seeds, steps, deterministic=False)


def doing_nothing_pays(env: ResolvedEnv) -> str | None:
    """Return a sentence if an app pays idle users more than ones that move at random, else None.

    The cost of effort does not decide: random activation of all muscles costs more than any
    strategy that a user learns. Apps that are not of this package are not started for this: None.
    """
    app = env.config.app
    if app.connect is not None or app.executable is not None or app.page is not None:
        return None
    blind = env.changed(app=app.model_copy(update={"renderer": "null"}))
    with closing(Simulation(blind, _COMPARED)) as simulation:
        idle, random = (baseline_reward(simulation, user, 1) for user in ("still", "random"))
    return note_of_baselines(idle, random)


def note_of_baselines(idle: tuple[float, float], random: tuple[float, float]) -> str | None:
    """Return a sentence if idle users earn more than ones that move at random, else None.

    Args:
        idle, random: Their rewards and efforts, as of :func:`baseline_reward`.
    """
    if idle[0] <= random[0]:
        return None
    return (
        f"doing nothing pays: an idle user earns {idle[0]:.2f} per minute (effort {idle[1]:.2f}), "
        f"a user that moves at random {random[0]:.2f} (effort {random[1]:.2f})"
    )
