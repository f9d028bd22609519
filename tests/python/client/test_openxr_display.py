"""The X server of ``--xvfb``: reached by cookie only, and nothing of it stays."""

import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from parts import needs
from processes import gone
from sim2vr_harness.client.openxr.program import Display

NEEDS_XVFB = needs("openxr", shutil.which("Xvfb"), "no Xvfb")
SERVE = """
import time
from sim2vr_harness.client.openxr.program import Display
display = Display(30.0)
print(display.number, flush=True)
time.sleep(600)
"""


def files_of(number: int) -> list[Path]:
    return [Path(f"/tmp/.X{number}-lock"), Path(f"/tmp/.X11-unix/X{number}")]


def connect(number: int) -> bytes:
    """The first byte of the server's answer to a client without a cookie: 0 refuses it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.connect(f"/tmp/.X11-unix/X{number}")
        client.sendall(b"l\0\x0b\0\0\0\0\0\0\0\0\0")
        return client.recv(1)


@NEEDS_XVFB
def test_a_display_is_there_for_those_who_have_its_cookie_and_goes() -> None:
    display, other = Display(30.0), Display(30.0)
    assert display.number != other.number
    assert files_of(display.number)[1].exists()
    authority = Path(display.environment["XAUTHORITY"])
    assert authority.stat().st_mode & 0o777 == 0o600
    assert connect(display.number) == b"\0"
    display.close()
    display.close()
    assert not any(file.exists() for file in [*files_of(display.number), authority])
    assert files_of(other.number)[1].exists()
    number = other.number
    del other
    assert not any(file.exists() for file in files_of(number))


@NEEDS_XVFB
@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_stays_when_the_harness_ends(end: signal.Signals) -> None:
    harness = subprocess.Popen([sys.executable, "-c", SERVE], stdout=subprocess.PIPE)
    assert harness.stdout is not None
    files = files_of(int(harness.stdout.readline()))
    harness.send_signal(end)
    harness.wait(30.0)
    assert all(gone(file, 20.0) for file in files)
    harness.stdout.close()
