"""Settings of a game's model whose shaping has other values than those that ship."""

from types import ModuleType
from typing import Any


def shaped(settings: ModuleType, **values: float) -> Any:
    """Return settings with these values of shaping.

    Args:
        settings: the game's module.
        values: of its ``Shaping``; the others are the defaults.
    """

    class Shaped(settings.GameModelSettings):  # type: ignore[name-defined, misc]
        @property
        def values(self) -> Any:
            return settings.Shaping(**values)

    return Shaped()
