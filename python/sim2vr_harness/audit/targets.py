"""Targets of an audit: listed in YAML, found in a game, or located in a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.tools.reach.people import alike
from sim2vr_harness.tools.reach.targets import Target, seen_targets

FloatArray = NDArray[np.float64]
How = Literal["touch", "point", "press", "grab", "look"]
Hand = Literal["either", "preferred", "both"]

_FORM = "a list 'targets' of {name, place: [right, up, ahead] or object: NAME, ...}"
_MOST = 500
_STATURES_M = (1.55, 1.85)
"""Of two users in whose rounds a game's targets are looked for: do they follow the head?"""

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0)]


class TargetSettings(Settings):
    """One target in a file of targets."""

    name: str = Field(min_length=1, max_length=80)
    """What the report calls it."""
    place: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Right, up, ahead in m; origin on the floor below the body."""
    object: str | None = None
    """Or the name of an object of the page, which is where it is as the session begins."""
    relative_to: Literal["world", "head"] = "world"
    """``head``: `place` is measured from where each person's head is."""
    how: How = "touch"
    """``touch``, ``press``, ``grab``: the controller gets there; ``point``: its ray does; ``look``:
    it only has to be seen."""
    hand: Hand = "either"
    """``preferred``: the hand that the person prefers; ``both``: both hands at once."""
    hold_s: float = Field(default=1.0, ge=0.0, le=3600.0)
    """How long the posture is held, s."""
    load_kg: float = Field(default=0.0, ge=0.0, le=50.0)
    """Mass in each hand beside the controller, kg."""
    grip_n: float = Field(default=0.0, ge=0.0, le=2000.0)
    """Grip force that it takes beside that of holding the load, N; with ``grab`` only."""
    radius_m: float = Field(default=0.0, ge=0.0, le=2.0)
    """Size: coming so near is enough, m."""

    @model_validator(mode="after")
    def _one_place(self) -> TargetSettings:
        if (self.place is None) == (self.object is None):
            got = "none" if self.place is None else "both"
            raise ValueError(f"got {got} of place and object, expected one of them")
        if self.grip_n and self.how != "grab":
            raise ValueError(f"got grip_n with how: {self.how}, expected how: grab")
        return self


@dataclass(frozen=True)
class AuditTarget:
    """A target with its place.

    Attributes:
        name: For people.
        place_m: (3,) right, up, ahead, m, in the world or from the head.
        from_head: Whether it is from the head.
        how, hand, hold_s, load_kg, radius_m, grip_n: As of :class:`TargetSettings`.
        in_app: What was done to it in the app, and what the app did; empty: nothing was done.
        reacts: Whether the app reacted.
    """

    name: str
    place_m: FloatArray
    from_head: bool = False
    how: How = "touch"
    hand: Hand = "either"
    hold_s: float = 1.0
    load_kg: float = 0.0
    radius_m: float = 0.0
    grip_n: float = 0.0
    in_app: str = ""
    reacts: bool = True

    @classmethod
    def of(cls, settings: TargetSettings, objects: Mapping[str, Sequence[float]]) -> AuditTarget:
        """Return the target of settings, with the places of objects that they name."""
        place = settings.place if settings.object is None else objects[settings.object]
        return cls(
            settings.name,
            np.array(place, dtype=np.float64),
            settings.relative_to == "head",
            settings.how,
            settings.hand,
            settings.hold_s,
            settings.load_kg,
            settings.radius_m,
            settings.grip_n,
        )


def read_targets(file: Path) -> list[TargetSettings]:
    """Read a file of targets.

    Raises:
        InputError: It is no such file; names the target and the field.
    """
    tree = read_yaml(file, _FORM)
    listed = tree.get("targets") if isinstance(tree, dict) else None
    if not isinstance(listed, list) or not 1 <= len(listed) <= _MOST:
        raise InputError(file_name(file), shown(tree, 60), _FORM)
    found = [_target(file, number, each) for number, each in enumerate(listed)]
    names = [each.name for each in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{file_name(file)}: targets", f"{name!r} twice", "each name once")
    return found


def _target(file: Path, number: int, tree: Any) -> TargetSettings:
    where = f"{file_name(file)}: targets[{number}]"
    if not isinstance(tree, dict):
        raise InputError(where, shown(tree, 60), "a mapping with 'name' and 'place' or 'object'")
    try:
        return TargetSettings.model_validate(tree)
    except ValidationError as error:
        raise first_problem(error, TargetSettings, (where,)) from error


def found_targets(
    env: EnvConfig,
    *,
    objects: str | None = None,
    seconds: float = 10.0,
    how: How = "touch",
    look: Callable[..., list[Target]] = seen_targets,
) -> list[AuditTarget]:
    """Find the targets of a game, as a short and a tall user's rounds have them.

    A target at the same place from both heads follows the head.

    Args:
        env: User and game.
        objects: Pattern of the objects' names; None: those that come, go or move, and small ones.
        seconds: How long to look at each round.
        how: What is done with them.
        look: Plays rounds: (environment, pattern, ``seconds``, ``still``) -> targets.
    """
    short, tall = (
        look(_sized(env, stature), objects, seconds=seconds, still=True) for stature in _STATURES_M
    )
    found = []
    for target in short:
        other_place = next((each for each in tall if target.same_as(each)), None)
        moved = other_place is not None and bool(
            np.abs(other_place.place_m - target.place_m).max() > 0.01
        )
        follows = target.from_head_m is not None and moved
        place = target.from_head_m if follows and target.from_head_m is not None else target.place_m
        found.append(AuditTarget(target.name, place, follows, how))
    return [replace(each, name=each.name or f"target {i}") for i, each in enumerate(found)]


def _sized(env: EnvConfig, stature_m: float) -> EnvConfig:
    """The environment with a body of that stature."""
    plain = alike(env)
    person = plain.user.person.model_copy(update={"stature_m": stature_m})
    return plain.model_copy(
        update={"user": plain.user.model_copy(update={"person": person, "torso": True})}
    )
