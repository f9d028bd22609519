"""One way to say that an input cannot be used: field, got, expected."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["InputError", "closest", "unknown_name"]


class InputError(ValueError):
    """An input of the user cannot be used.

    Attributes:
        field: What the user wrote it in: a dotted configuration key, an option, a path.
        got: What was found there.
        expected: What would have been right.
    """

    def __init__(self, field: str, got: str, expected: str) -> None:
        self.field, self.got, self.expected = field, got, expected
        super().__init__(f"{field}: got {got}, expected {expected}")


def closest(name: str, names: Iterable[str]) -> str | None:
    """Return the one of ``names`` that ``name`` is most probably a slip of, or None."""
    found = difflib.get_close_matches(name, list(names), n=1, cutoff=0.5)
    return found[0] if found else None


def unknown_name(field: str, got: str, names: Iterable[str]) -> InputError:
    """Word the error for a name that is not among ``names``, the closest one pointed out."""
    known = list(names)
    best = closest(got, known)
    hint = f" (did you mean {best!r}?)" if best else ""
    return InputError(field, repr(got), f"one of {', '.join(known)}{hint}")
