"""The ways to an app: one table, by which configurations, command line and tests go.

A new one is a file with a :class:`Transport` and a line here; one from outside the package is
registered with :func:`register_transport` before a configuration names it.
"""

import difflib

from sim2vr_harness.client.in_process_apps import IN_PROCESS
from sim2vr_harness.client.openxr import OPENXR
from sim2vr_harness.client.servers import PROTOCOL1, PROTOCOL2
from sim2vr_harness.client.transport import Transport
from sim2vr_harness.client.webxr import WEBXR

_TABLE: dict[str, Transport] = {
    transport.name: transport
    for transport in (
        IN_PROCESS,
        PROTOCOL1,
        PROTOCOL2,
        WEBXR,
        OPENXR,
    )
}


def list_transports() -> list[Transport]:
    """Return every transport, those of the package first."""
    return list(_TABLE.values())


def transport_named(name: str) -> Transport:
    """Return a transport by its name.

    Raises:
        ValueError: there is none; names those that are and the nearest one.
    """
    if name in _TABLE:
        return _TABLE[name]
    near = difflib.get_close_matches(name, _TABLE, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    known = ", ".join(map(repr, _TABLE))
    raise ValueError(f"transport: got {name!r}, expected one of {known}{hint}")


def register_transport(transport: Transport) -> None:
    """Add a transport to the table.

    Raises:
        ValueError: there is one of that name.
    """
    if transport.name in _TABLE:
        raise ValueError(f"transport: got {transport.name!r}, which is taken, expected a new name")
    _TABLE[transport.name] = transport
