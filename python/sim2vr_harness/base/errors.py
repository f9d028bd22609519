"""One way to say that an input cannot be used: field, got, expected."""

import difflib
from collections.abc import Iterable
from pathlib import Path

_LONGEST = 100
"""Characters of a value or a reason that a sentence quotes."""
_LISTED = 60
"""More names than these are counted, not listed."""


class InputError(ValueError):
    """An input of the user cannot be used; says so in one line, whatever is in the input.

    Attributes:
        field: What the user wrote it in: a dotted configuration key, an option, a path.
        got: What was found there.
        expected: What would have been right.
    """

    def __init__(self, field: str, got: str, expected: str) -> None:
        self.field, self.got, self.expected = field, got, expected
        text = f"{_short(field, 4 * _LONGEST)}: got {got}, expected {expected}"
        super().__init__(printable(text))


class UnusableFile(InputError):
    """A file of a run cannot be used: cut off, damaged, not finite, of another network.

    Attributes:
        reason: why.
        instead: the newest one of the same kind that can be used; None without any.
    """

    def __init__(self, file: Path, reason: str, expected: str, instead: Path | None = None) -> None:
        self.file, self.reason, self.instead = file, reason, instead
        hint = "" if instead is None else f"; the last good one is {str(instead)!r}"
        super().__init__("RUN", f"{str(file)!r} ({reason})", expected + hint)
        self.expected = expected  # without the hint, for those who say it in other words


def shown(value: object, longest: int = _LONGEST) -> str:
    """Return what Python writes for a value, cut in the middle where it is long."""
    return _short(repr(value), longest)


def reason(error: BaseException) -> str:
    """Return what an error of someone else's says, in one short line; its kind if it is silent."""
    system = isinstance(error, OSError) and error.strerror
    text = " ".join((str(system) if system else str(error)).split())
    text = printable(text)
    text = text[:1].lower() + text[1:] if system else text
    return _short(text, _LONGEST) or type(error).__name__


def printable(text: str) -> str:
    """Escape line breaks and control characters, which a terminal would act upon."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in text)


def _short(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    return f"{text[: longest * 2 // 3]}...{text[-longest // 4 :]}"


def closest(name: str, names: Iterable[str]) -> str | None:
    """Return the one of ``names`` that ``name`` is most probably a slip of, or None."""
    found = difflib.get_close_matches(name, list(names), n=1, cutoff=0.5)
    return found[0] if found else None


def unknown_name(field: str, got: str, names: Iterable[str]) -> InputError:
    """Word the error for a name that is not among ``names``, the closest one pointed out."""
    known = list(names)
    best = closest(got, known)
    hint = f" (did you mean {best!r}?)" if best else ""
    listed = ", ".join(known) if len(known) <= _LISTED else f"{len(known)} names"
    return InputError(field, repr(got), f"one of {listed or 'none'}{hint}")


def counted(n: int, what: str) -> str:
    """Return a number of things: ``1 round``, ``2 rounds``."""
    return f"{n:,} {what}" if n == 1 else f"{n:,} {what}s"
