"""Measure which of a game's places people reach who differ in size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EnvConfig, SenseConfig, UserConfig, body_of, people_of
from sim2vr_harness.envs.people_preset import with_people
from sim2vr_harness.tools.reach.extent import Reach
from sim2vr_harness.tools.reach.targets import Target, in_mujoco
from sim2vr_harness.users.kinematics.forward import Linkage, Point

_SEED = 1
"""Of the people, as of an evaluation's."""

Look = Callable[[EnvConfig, int | None], list[Target]]
"""Plays rounds: (environment, number of the person) -> targets."""


@dataclass(frozen=True)
class PeopleReach:
    """How far people reach beyond places, or fall short.

    Attributes:
        margins_m: (N, T) margin of each person at each place, see :class:`.Verdict`; NaN where the
            person's rounds did not have the place.
    """

    margins_m: NDArray[np.float64]

    def words(self, place: int) -> str:
        """Return who reaches a place: ``9 of 10 people, at worst outside by 2.5 cm``."""
        from sim2vr_harness.tools.reach.page import margin_words

        known = self.margins_m[:, place]
        known = known[~np.isnan(known)]
        if not len(known):
            return "in no round of people"
        inside = int((known >= 0.0).sum())
        return f"{inside} of {len(known)} people, at worst {margin_words(float(known.min()))}"


def alike(env: EnvConfig) -> EnvConfig:
    """Return the environment with the average user and the cheapest sense."""
    user = env.user.model_copy(update={"people": None})
    return env.model_copy(update={"user": user, "senses": (SenseConfig(sense="time"),)})


def people_reach(
    env: EnvConfig, point: Point, places: Sequence[Target], count: int, look: Look
) -> PeopleReach:
    """Measure which places people reach, each with their own body and targets.

    Args:
        env: User and app.
        point: What is to get there.
        places: Of the average user.
        count: How many people, as an evaluation with as many has them.
        look: Plays rounds.

    Raises:
        InputError: ``count`` is not positive.
    """
    several = with_people(alike(env), count, _SEED)
    population = people_of(several.user)
    assert population is not None
    margins = np.full((count, len(places)), np.nan)
    for person in range(count):
        physique = population.physique(population.number(person))
        own = several.user.model_dump() | {"person": physique.model_dump(), "people": None}
        reach = Reach(Linkage(body_of(UserConfig(**own)), point))
        targets = look(several, person)
        found = [next((i for i, p in enumerate(places) if p.same_as(t)), None) for t in targets]
        kept = [(i, t) for i, t in zip(found, targets, strict=True) if i is not None]
        if kept:
            verdicts = reach.judge(in_mujoco([target for _, target in kept]))
            for (i, _), verdict in zip(kept, verdicts, strict=True):
                margins[person, i] = verdict.margin_m
    return PeopleReach(margins)
