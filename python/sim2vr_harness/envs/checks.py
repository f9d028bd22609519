"""Validation of requests to N users: persons, seeds and options of the game."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import shown
from sim2vr_harness.client import OptionValue
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.users import Person, Population


def checked_users(field: str, users: Any, n: int) -> list[int]:
    """The users that are meant: None for all, a whole number for one, or several of them.

    Raises:
        ValueError: they are no whole numbers from 0 to n - 1, or one comes twice.
    """
    if users is None:
        return list(range(n))
    given = [users] if _is_whole(users) or not isinstance(users, Iterable) else list(users)
    for user in given:
        if not _is_whole(user) or not 0 <= user < n:
            raise ValueError(f"{field}: got {shown(user)}, expected whole numbers 0 to {n - 1}")
    if len(set(given)) < len(given):
        raise ValueError(f"{field}: got {shown(given)}, expected each user at most once")
    return [int(user) for user in given]


def checked_seeds(seeds: Sequence[int | None] | None, count: int) -> list[int | None]:
    """Return one seed, or None, for each of ``count`` users.

    Raises:
        ValueError: another number of seeds, or one that is no whole number of 0 or above.
    """
    if seeds is None:
        return [None] * count
    if isinstance(seeds, (str, bytes)) or not isinstance(seeds, Iterable):
        raise ValueError(f"seeds: got {shown(seeds)}, expected {count}, one per user")
    given = list(seeds)
    if len(given) != count:
        raise ValueError(f"seeds: got {len(given)} seeds, expected {count}, one per user")
    for seed in given:
        if seed is not None and (not _is_whole(seed) or seed < 0):
            raise ValueError(f"seed: got {shown(seed)}, expected an integer of 0 or above")
    return [None if seed is None else int(seed) for seed in given]


def chosen_persons(
    people: Population | None, seeds: Sequence[int], numbers: Sequence[int | None] | None
) -> list[Person] | None:
    """Return the persons of these numbers, or of episodes with these seeds; None: no people.

    Raises:
        ValueError: numbers without people, or another number of them than of seeds.
    """
    given = [None] * len(seeds) if numbers is None else list(numbers)
    if people is None:
        if any(number is not None for number in given):
            raise ValueError("persons: got numbers, expected None: user.people is not set")
        return None
    if len(given) != len(seeds):
        raise ValueError(f"persons: got {len(given)}, expected {len(seeds)}, one per user")
    return [
        people.of_episode(seed) if number is None else people.number(number)
        for seed, number in zip(seeds, given, strict=True)
    ]


def checked_substeps(config: EnvConfig, timestep_s: float) -> int:
    """Return how many physics steps of this duration a user step has.

    Raises:
        ValueError: no whole number of them, or none that the frames of a step divide.
    """
    exact = 1.0 / (config.action_frequency_hz * timestep_s)
    substeps, frames = round(exact), config.frames_per_step
    if substeps < 1 or abs(exact - substeps) > 1e-9:
        raise ValueError(
            f"action_frequency_hz: got {config.action_frequency_hz}, expected a divisor of "
            f"{round(1.0 / timestep_s)} (one physics step is {timestep_s} s)"
        )
    if frames < 1 or substeps % frames:
        divisors = [str(k) for k in range(1, substeps + 1) if substeps % k == 0]
        raise ValueError(
            f"frames_per_step: got {frames}, expected {', '.join(divisors)} (a divisor of "
            f"the {substeps} physics steps of a user step)"
        )
    return substeps


def checked_options(options: Mapping[str, OptionValue] | None) -> dict[str, OptionValue]:
    """Options of a game; which ones it has, the game knows itself.

    Raises:
        ValueError: they are no mapping, or one has no name.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping) or not all(isinstance(name, str) for name in options):
        raise ValueError(f"options: got {shown(options)}, expected names of options and values")
    return dict(options)


def _is_whole(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)
