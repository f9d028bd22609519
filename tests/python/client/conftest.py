"""A stand-in for a Unity build, as an executable."""

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

FAKE_APP = Path(__file__).with_name("fake_app.py")


@pytest.fixture
def fake_app(tmp_path: Path) -> Path:
    """The stand-in's executable file."""
    file = tmp_path / "build.x86_64"
    file.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{FAKE_APP}" "$@" -home {tmp_path}\n')
    file.chmod(0o755)
    return file


def processes_with(word: str) -> list[int]:
    """Ids of processes whose command line holds ``word``; zombies have none."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                command = (entry / "cmdline").read_bytes().decode(errors="replace")
            except OSError:
                continue
            if word in command:
                found.append(int(entry.name))
    return found


@pytest.fixture
def no_orphans(tmp_path: Path) -> Iterator[Callable[[], list[int]]]:
    """Lists the processes started from this test's folder; none may be left at the end."""

    def running() -> list[int]:
        return processes_with(str(tmp_path))

    yield running
    assert running() == []
