"""Recorded rounds of any app: one format, readers and writers of others, and their replay."""

from sim2vr_harness.sessions.formats import read_session, write_session
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
    "read_session",
    "write_session",
]
