"""Targets of a recorded session: where hands pressed a trigger or squeeze."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.targets import AuditTarget
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client.devices import input_named
from sim2vr_harness.sessions import Controller, read_session

_PRESSED = 0.5
_SAME_M = 0.05
"""Places nearer to each other are one target."""
_MOST = 100


def pressed_places(file: Path) -> list[AuditTarget]:
    """Return the places of a session's hands as trigger or squeeze were pressed, in order.

    Raises:
        InputError: It is no session, or nothing is pressed in it.
    """
    session = read_session(file)
    found: list[NDArray[np.float64]] = []
    presses = [
        each
        for hand, controller in (("left", session.left), ("right", session.right))
        if controller is not None
        for each in _presses(hand, controller)
    ]
    for _, place in sorted(presses, key=lambda press: press[0]):
        if not any(np.linalg.norm(place - other) < _SAME_M for other in found):
            found.append(place)
    if not found:
        expected = "one whose hands press a trigger or squeeze"
        raise InputError("--session", f"{file.name}, in which nothing is pressed", expected)
    return [
        AuditTarget(f"press {number}", place, how="press", radius_m=0.02)
        for number, place in enumerate(found[:_MOST], start=1)
    ]


def _presses(hand: str, controller: Controller) -> list[tuple[int, NDArray[np.float64]]]:
    """Frames in which an input begins to be pressed, and where the hand is then."""
    if controller.inputs is None:
        return []
    columns = [input_named(f"{hand}.{name}").column for name in ("trigger", "squeeze")]
    down = np.asarray((controller.inputs[:, columns] >= _PRESSED).any(axis=1))
    begins = np.flatnonzero(down & ~np.r_[False, down[:-1]])
    places = controller.grip[begins, :3]
    known = ~np.isnan(places).any(axis=1)
    return [(int(i), place) for i, place in zip(begins[known], places[known], strict=True)]
