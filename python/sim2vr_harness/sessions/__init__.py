"""Recorded rounds of any app: one format, readers and writers of others, and their replay."""

from sim2vr_harness.sessions.formats import (
    find_sessions,
    read_session,
    read_sessions,
    write_session,
)
from sim2vr_harness.sessions.session import (
    JOINT_NAMES,
    AppIdentity,
    Controller,
    Session,
    SessionEvent,
)

__all__ = [
    "JOINT_NAMES",
    "AppIdentity",
    "Controller",
    "Session",
    "SessionEvent",
    "find_sessions",
    "read_session",
    "read_sessions",
    "write_session",
]
