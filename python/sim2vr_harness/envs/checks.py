"""What is asked of N users at once: who, with which seeds, with which options of the game."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import shown
from sim2vr_harness.client import OptionValue

__all__ = ["checked_options", "checked_seeds", "checked_users"]


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
    """One seed, or None, for each of so many users.

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
