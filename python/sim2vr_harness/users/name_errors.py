"""Words for names that are not known, with the nearest that is."""

import difflib
from collections.abc import Iterable

_MOST = 30  # more names than this are not listed


def nearest(got: object, names: Iterable[str]) -> str | None:
    """Returns the known name that is most like `got`, or None if none is."""
    known = sorted(names)
    close = difflib.get_close_matches(str(got), known, n=1, cutoff=0.4)
    if close:
        return close[0]
    folded = {name.lower(): name for name in reversed(known)}
    close = difflib.get_close_matches(str(got).lower(), sorted(folded), n=1, cutoff=0.4)
    return folded[close[0]] if close else None


def unknown_name(field: str, got: object, expected: Iterable[str]) -> str:
    """Words the error for a name that is not in a registry, with the closest match if any."""
    names = sorted(expected)
    listed = ", ".join(map(repr, names)) if len(names) <= _MOST else f"{len(names)} names"
    close = nearest(got, names)
    hint = f"; did you mean {close!r}?" if close else ""
    return f"{field}: got {got!r}, expected one of {listed or 'none'}{hint}"
