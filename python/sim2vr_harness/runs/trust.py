"""Programs and Python that a file names run only if this user has said so.

A run's folder, a packed user, a study or a configuration that someone else has written may name
any program of this machine, with any arguments, as the app to play in; any shared library as its
games; any Python file as its task;
and a body whose model an installed package makes. What this user has named on a command line, or
trained with, is remembered outside all of these, a file for each in
``$XDG_STATE_HOME/sim2vr/trusted_apps`` (``~/.local/state/...``).
"""

import hashlib
import json
import os
import shlex
import stat
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.client import load_game_library
from sim2vr_harness.client.tasks import TaskRules, names_code
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.users.bodies import allow_package, foreign_package, origin_of

_KEYS = ("executable", "arguments", "game_library", "connect", "page", "map", "browser", "task")
_told: list[dict[str, Any]] = []
"""Trust remembered in this process only, for homes that cannot be written to."""


def state_folder() -> Path | None:
    """Return where trust is remembered; None if this user has no home."""
    base = os.environ.get("XDG_STATE_HOME", "")
    if os.path.isabs(base):  # the specification: anything else is to be ignored
        return Path(base) / "sim2vr" / "trusted_apps"
    with suppress(RuntimeError):
        return Path.home() / ".local" / "state" / "sim2vr" / "trusted_apps"
    return None


def require_trust(
    env: EnvConfig, source: str | Path, *, named: Collection[str] = (), trust: bool = False
) -> None:
    """Check that this user trusts the code that a file's environment runs or connects to.

    The library of its game is opened afterwards.

    Args:
        env: the environment; nothing else of it is started, imported or opened here.
        source: the file, or its folder, for messages.
        named: settings of the app that were given on the command line.
        trust: True if this user confirms it (``--trust-app``), which is remembered.

    Raises:
        InputError: the code is not trusted; prints what would be started.
    """
    _require_app(env.app, source, named, trust)
    require_trusted_body(env.user.model, source, trust=trust)
    if env.app.game_library is not None:
        load_game_library(env.app.game_library)


def require_trusted_body(model: str, source: str | Path, *, trust: bool = False) -> None:
    """Check that this user trusts the Python package that a body's file names.

    Args:
        model: a body's name or file.
        source, trust: as of :func:`require_trust`.

    Raises:
        InputError: it is not trusted, and nothing has been imported.
    """
    package = foreign_package(model)
    if package is None:
        return
    entry = {"package": package, "real": os.path.realpath(origin_of(package))}
    if trust:
        _note(entry, Path(source), Path(model))
    elif not _known(entry):
        raise InputError(
            "env.user.model",
            f"the package {package!r} in {model!r}, code that you have not run before",
            "--trust-app, if you know where it comes from",
        )
    allow_package(package)


def answered(env: EnvConfig) -> None:
    """Accept an environment in a worker process, because this user has accepted it before.

    The acceptance does not extend to apps that other files name.
    """
    _told.append(_entry(env.app))
    if env.app.game_library is not None:
        load_game_library(env.app.game_library)
    if (package := foreign_package(env.user.model)) is not None:
        allow_package(package)


def _require_app(app: AppConfig, source: str | Path, named: Collection[str], trust: bool) -> None:
    wanted = _entry(app)
    from_file = [key for key in _KEYS if wanted.get(key) and key not in named]
    if not from_file:
        return
    if trust:
        remember(app, Path(source))
        return
    # Arguments were trusted together with their program.
    whose = {"executable"} if "arguments" in from_file else set()
    if not _knows(wanted, [key for key in _KEYS if key not in named or key in whose]):
        raise _unknown(app, source, from_file)


def named_app(overrides: Sequence[str], app: Mapping[str, Any] | None = None) -> set[str]:
    """Return the settings of the app that a command line sets itself.

    Args:
        overrides: ``key=value`` of ``--set``.
        app: settings of ``env.app`` that other options set.
    """
    env = apply_overrides({}, overrides).get("env")
    settings = env.get("app") if isinstance(env, dict) else None
    return {*(settings if isinstance(settings, dict) else ()), *(app or ())}


def remember(app: AppConfig, folder: Path) -> None:
    """Note that this user has started this app, or connected to it.

    Args:
        folder: of the run, or the configuration's file; a program or library that lies in the same
            folder came with it and is requested every time.
    """
    entry = _entry(app)
    if any(entry.get(key) for key in _KEYS):
        _note(entry, folder)


def _note(entry: dict[str, Any], *sources: Path) -> None:
    """Store an entry; one that arrived with a source is kept for this process only."""
    if _known(entry):
        return
    _told.append(entry)
    place = state_folder()
    code = (entry["real"], entry.get("game_library"))
    if place is None or any(_lies_in(file, source) for file in code for source in sources):
        return
    name = hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()[:32]
    with suppress(OSError):  # asked again next time
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(place / f"{name}.json", (json.dumps(entry, indent=2) + "\n").encode())


def _lies_in(real: str | None, source: Path) -> bool:
    """Return whether a program or library lies in a folder, or in the folder of a file."""
    if not real or not source.exists():
        return False
    return Path(real).is_relative_to(
        os.path.realpath(source.parent if source.is_file() else source)
    )


def _entry(app: AppConfig) -> dict[str, Any]:
    """Return what is trusted: the program by its path and its resolved path, and its arguments.

    A library of games is trusted by its resolved path. A page is trusted by its path, what it may
    load, the browser, and its task's rules, which have JavaScript. For any app, the file of a task
    in Python is included.
    """
    program = None if app.executable is None else os.path.abspath(app.executable)
    entry: dict[str, Any] = {
        "executable": program,
        "real": None if program is None else os.path.realpath(program),
        "arguments": list(app.arguments),
        "connect": app.connect,
    }
    if app.game_library is not None:
        entry["game_library"] = os.path.realpath(app.game_library)
    if app.page is not None:
        entry["page"] = app.page if "://" in app.page else os.path.realpath(app.page)
        if app.map:
            entry["map"] = {key: os.path.realpath(place) for key, place in app.map.items()}
        if app.browser is not None:
            entry["browser"] = app.browser
    if isinstance(app.task, str) and names_code(app.task):
        file, _, name = app.task.rpartition(":")
        entry["task"] = f"{os.path.realpath(file)}:{name}"
    elif app.page is not None and isinstance(app.task, str):
        entry["task"] = os.path.realpath(app.task)
    elif app.page is not None and isinstance(app.task, TaskRules):
        entry["task"] = app.task.model_dump(mode="json", exclude_defaults=True)
    return entry


def _known(entry: dict[str, Any]) -> bool:
    return any(entry == known for known in _entries())


def _knows(wanted: dict[str, Any], keys: Collection[str]) -> bool:
    """Return whether a remembered app is the same in everything that a file names."""
    same = [*keys, *(["real"] if "executable" in keys else [])]
    return any(all(known.get(key) == wanted.get(key) for key in same) for known in _entries())


def _entries() -> list[dict[str, Any]]:
    """Return the remembered entries from files that no one else could have written."""
    entries, place = list(_told), state_folder()
    if place is None or not _own(place):
        return entries
    for file in sorted(place.glob("*.json")):
        with suppress(OSError, ValueError):
            if _own(file):
                entries.append(json.loads(file.read_text(encoding="utf-8")))
    return [entry for entry in entries if isinstance(entry, dict)]


def _own(path: Path) -> bool:
    try:
        found = path.stat()
    except OSError:
        return False
    return found.st_uid == os.getuid() and not stat.S_IMODE(found.st_mode) & 0o022


def _unknown(app: AppConfig, source: str | Path, from_file: Collection[str]) -> InputError:
    if names_code(app.task) or list(from_file) == ["task"]:
        what = app.task if isinstance(app.task, str) else "rules with JavaScript of a page"
        key, option = "task", "--task with the same path"
        doing = "code that you have not run before"
    elif "game_library" in from_file:
        key, what, option = (
            "game_library",
            str(app.game_library),
            "--game-library with the same path",
        )
        doing = "code that you have not run before"
    elif app.page is not None:
        key, what, option = "page", app.page, "--page with the same path"
        doing = "a page, or with a task, that you have not opened before"
    elif app.connect is not None:
        key, what, option = "connect", app.connect, "--connect with the same address"
        doing = "an address that was never connected to by you"
    else:
        command = ["sim2vr-app" if app.executable is None else app.executable, *app.arguments]
        program = "--openxr" if app.transport == "openxr" else "--app"
        key, what, option = "executable", shlex.join(command), f"{program} with the same path"
        doing = "a program that you have not started before"
    return InputError(
        f"env.app.{key}",
        f"{what!r} in {str(source)!r}, {doing}",
        f"--trust-app, if you know where it comes from, or {option}",
    )
