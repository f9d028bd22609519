"""A stand-in for a Unity build, and pages that share a browser."""

import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from sim2vr_harness.client import WebXRApp
from webxr_pages import open_page, page_with

FAKE_APP = Path(__file__).with_name("fake_app.py")


@pytest.fixture
def fake_app(tmp_path: Path) -> Path:
    """The stand-in's executable file."""
    file = tmp_path / "build.x86_64"
    file.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{FAKE_APP}" "$@" -home {tmp_path}\n')
    file.chmod(0o755)
    return file


@pytest.fixture
def no_orphans(tmp_path: Path) -> Iterator[Callable[[], list[int]]]:
    """Lists the processes started from this test's folder; none may be left at the end."""

    def running() -> list[int]:
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != os.getpid():
                try:
                    command = (entry / "cmdline").read_bytes().decode(errors="replace")
                except OSError:
                    continue
                if str(tmp_path) in command:
                    found.append(int(entry.name))
        return found

    yield running
    assert running() == []


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., WebXRApp]]:
    """Opens a page of a script in the browser of an earlier one with the same settings.

    Files that lie beside it are given by name; the app stays the fixture's.
    """
    apps: dict[str, tuple[WebXRApp, Path]] = {}

    def opened(script: str, *, beside: dict[str, str] | None = None, **changes: Any) -> WebXRApp:
        key = json.dumps(changes, sort_keys=True)
        if key in apps and not apps[key][0].usable:
            apps.pop(key)[0].close()
        if key not in apps:
            while len(apps) > 1:  # each takes 150 MB
                apps.pop(next(iter(apps)))[0].close()
            folder = tmp_path_factory.mktemp("pages")
            apps[key] = open_page(page_with(folder, ""), **changes), folder
        app, folder = apps[key]
        page_with(folder, script)
        for name, text in (beside or {}).items():
            (folder / name).write_text(text)
        return app

    yield opened
    for app, _ in apps.values():
        app.close()
