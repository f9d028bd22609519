"""Personal content of a session, and a copy without the parts that identify a person."""

from dataclasses import replace

import numpy as np

from sim2vr_harness.sessions.session import Controller, FloatArray, Session

HEAD_HEIGHT_M = 1.6
"""Median height of the head in sessions without a person's own."""


def personal_content(session: Session) -> list[str]:
    """Return a line per thing that a session says about its person."""
    low, middle, high = np.quantile(session.head[:, 1], [0.05, 0.5, 0.95])
    height = f"median {middle:.2f} m, {low:.2f} to {high:.2f} m (5 to 95 %); follows body height"
    if abs(middle - HEAD_HEIGHT_M) < 1e-9:
        height = f"removed; the median is {HEAD_HEIGHT_M:g} m"
    found = [
        f"head height: {height}",
        "head and hand movement: identifies people who were recorded elsewhere",
    ]
    reach = [
        float(np.nanquantile(np.linalg.norm(one.grip[:, :3] - session.head[:, :3], axis=1), 0.95))
        for one in session.controllers.values()
    ]
    if reach:
        found.append(f"reach: up to {max(reach):.2f} m from the head (95 %); follows arm length")
    for side, one in session.controllers.items():
        if one.joints is not None:
            known = int((~np.isnan(one.joints[:, 0, 0])).sum())
            found.append(f"{side} hand joints: {known:,} frames; size and shape of the hand")
    if session.person:
        found.append(f"a name for the person: {session.person!r}")
    if session.headset:
        found.append(f"headset: {session.headset}")
    return found


def stripped(session: Session) -> Session:
    """Return the session without hand joints, the person's name and head height.

    Everything that is tracked moves up or down by the same distance, so that the head's median
    height is :data:`HEAD_HEIGHT_M`. The app's objects stay where they are: a replay may differ.
    """
    shift = HEAD_HEIGHT_M - float(np.median(session.head[:, 1]))

    def moved(poses: FloatArray) -> FloatArray:
        raised = poses.copy()
        raised[:, 1] += shift
        return raised

    def bare(one: Controller | None) -> Controller | None:
        if one is None:
            return None
        aim = None if one.aim is None else moved(one.aim)
        return Controller(moved(one.grip), aim, one.inputs)

    return replace(
        session,
        head=moved(session.head),
        left=bare(session.left),
        right=bare(session.right),
        person="",
    )
