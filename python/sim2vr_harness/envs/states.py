"""Saved states of a simulation: bytes of arrays and plain values."""

import io
import pickle
from typing import Any

from sim2vr_harness.base.errors import reason

_FORMAT = "sim2vr simulation state 4"


def packed(n: int, parts: dict[str, Any]) -> bytes:
    """The parts of a state of ``n`` users, arrays and plain values, as bytes."""
    return pickle.dumps({"format": _FORMAT, "n": n, **parts})


def unpacked(state: bytes, n: int, parts: tuple[str, ...]) -> dict[str, Any]:
    """The parts again.

    Raises:
        ValueError: the bytes are of something else, damaged, without one of these parts, or of
            another number of users.
    """
    try:
        saved = _PlainUnpickler(io.BytesIO(state)).load()
    except ValueError:
        raise
    except Exception as error:  # a damaged pickle raises anything
        got = f"damaged bytes ({reason(error)})"
        raise ValueError(f"state: got {got}, expected a '{_FORMAT}'") from error
    if not isinstance(saved, dict) or saved.get("format") != _FORMAT:
        raise ValueError(f"state: got other bytes, expected a '{_FORMAT}'")
    if any(part not in saved for part in ("n", *parts)):
        raise ValueError("state: got one that lacks a part, expected all of a simulation's")
    if saved["n"] != n:
        raise ValueError(f"state: got one of {saved['n']} users, expected {n}")
    return saved


class _PlainUnpickler(pickle.Unpickler):
    """Reads arrays and plain values only, so that a state file cannot run code."""

    _ALLOWED = frozenset(
        {
            ("numpy", "ndarray"),
            ("numpy", "dtype"),
            ("numpy._core.multiarray", "_reconstruct"),
            ("numpy._core.multiarray", "scalar"),
            ("numpy._core.numeric", "_frombuffer"),
        }
    )

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self._ALLOWED:
            raise ValueError(f"state: got an object of type {module}.{name}, expected plain data")
        return super().find_class(module, name)
