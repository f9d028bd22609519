"""Options of commands that say which app to play in, and what they mean as settings."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import option

_COMMAND = "PROGRAM, or 'PROGRAM ARGS'"


@dataclass(frozen=True, kw_only=True)
class PageFiles:
    """What a page is shown with."""

    map_: tuple[str, ...] = option(
        "Serve addresses under URL from FOLDER, or those of a map file of `page vendor`; may be "
        "repeated. All others are refused.",
        (),
        metavar="URL=FOLDER|FILE",
    )
    browser: str | None = option("The Chromium that shows pages.", metavar="PATH", shown="found")


@dataclass(frozen=True, kw_only=True)
class GameLibrary:
    """Games of others."""

    game_library: str | None = option(
        "Open a shared library of games and run its code.", metavar="FILE"
    )

    def library(self) -> dict[str, str]:
        """Load the library; return the setting of ``env.app`` that names it, if any does."""
        from sim2vr_harness.client import load_game_library

        if self.game_library is None:
            return {}
        load_game_library(Path(self.game_library).expanduser())  # who names it here, runs it
        return {"game_library": _absolute(self.game_library)}


@dataclass(frozen=True, kw_only=True)
class PageOptions(PageFiles, GameLibrary):
    """A page or an OpenXR program, for commands without protocols 1 and 2."""

    page: str | None = option(
        "Play a WebXR page: a file, a folder, or a mapped address; ?NAME=VALUE sets options.",
        metavar="FILE",
    )
    task: str | None = option(
        "Reward, end and measures of the app: a YAML file, or FILE.py:CLASS.", metavar="FILE"
    )
    openxr: str | None = option(
        "Play an OpenXR program; arguments in the same quotes.", metavar="PROGRAM"
    )
    virtual_clock: bool = option("Let the clocks of --openxr advance with the steps.", False)
    xvfb: bool = option("Give --openxr an X server of its own.", False)

    def remote(self) -> dict[str, Any]:
        """Return the settings of ``env.app`` that the options mean; none without any of them.

        Raises:
            InputError: options that do not go together.
        """
        return self._settings(AppOptions())

    def _settings(self, other: AppOptions) -> dict[str, Any]:
        """Return the settings of these options, and of ``other`` without a page or program."""
        page, openxr, app = self.page, self.openxr, other.app_
        if other.protocol not in (None, 1, 2):
            raise InputError("--protocol", str(other.protocol), "1 or 2")
        one = (("--app", app), ("--connect", other.connect), ("--page", page), ("--openxr", openxr))
        _require_one(*one)
        _require_one(("--page", page), ("--openxr", openxr), ("--protocol", other.protocol))
        for name, value, owner, owned in (
            ("--app-arg", other.app_arg, "--app", app or openxr),
            ("--map", self.map_, "--page", page),
            ("--browser", self.browser, "--page", page),
            ("--virtual-clock", self.virtual_clock, "--openxr", openxr),
            ("--xvfb", self.xvfb, "--openxr", openxr),
        ):
            if value and owned is None:
                raise InputError(name, f"it without {owner}", f"it together with {owner}")
        judged = {} if self.task is None else {"task": _absolute_task(self.task)}
        judged |= self.library()
        if page is not None:
            from sim2vr_harness.envs.config import page_name

            place, options = page_and_options(page)
            page_settings = {
                "transport": "webxr",
                "game": page_name(place),
                "page": place,
                "map": mapped_places(self.map_),
                "browser": self.browser,
                **({"options": options} if options else {}),
            }
            return {**page_settings, **judged}
        if openxr is not None:
            chosen = {name: True for name in ("virtual_clock", "xvfb") if getattr(self, name)}
            # Settings of an OpenXR program; its files are named by whole paths, for later runs.
            program = openxr
            from sim2vr_harness.envs.config import program_name

            try:
                words = [program] if Path(program).expanduser().is_file() else shlex.split(program)
            except ValueError as error:
                raise InputError("--openxr", f"{program!r} ({error})", _COMMAND) from error
            if not words:
                raise InputError("--openxr", "nothing", _COMMAND)
            found = (
                words[0] if "/" in words[0] or Path(words[0]).is_file() else shutil.which(words[0])
            )
            command = [_absolute(found or words[0])]
            for word in (*words[1:], *other.app_arg):
                file = "/" in word or word.endswith((".py", ".qml"))
                command.append(
                    _absolute(word) if file and Path(word).expanduser().exists() else word
                )
            program_settings = {
                "transport": "openxr",
                "game": program_name(command),
                "executable": command[0],
                "arguments": command[1:],
                "transport_options": dict(chosen),
            }
            return {**program_settings, **judged}
        if app is None and other.connect is None and other.protocol is None:
            return judged
        return {
            "transport": f"protocol{other.protocol or 1}",
            "executable": None if app is None else str(Path(app).expanduser().absolute()),
            "arguments": list(other.app_arg),
            "connect": other.connect,
            **judged,
        }


@dataclass(frozen=True, kw_only=True)
class AppOptions(PageOptions):
    """An app of any transport."""

    app_: str | None = option(
        "Play in this executable, such as a Unity build with SIM2VR.", metavar="PATH"
    )
    app_arg: tuple[str, ...] = option("An argument for --app; may be repeated.", (), metavar="ARG")
    connect: str | None = option("Play in an app that runs already.", metavar="HOST:PORT")
    protocol: int | None = option(
        "What --app or --connect speak: 1 (SIM2VR) or 2 (sim2vr-app).", shown="1"
    )

    def remote(self) -> dict[str, Any]:
        """As for pages."""
        return self._settings(self)


def _require_one(*given: tuple[str, Any]) -> None:
    """Refuse options of which only one may be given."""
    named = [option for option, value in given if value is not None]
    if len(named) > 1:
        raise InputError(named[1], f"it together with {named[0]}", "one of them")


def page_and_options(page: str) -> tuple[str, dict[str, Any]]:
    """Return a page's whole path, or its address, and the options in its query.

    A value is read as ``--set`` reads it.

    Raises:
        InputError: the query is no NAME=VALUE&NAME=VALUE, has a name twice, or a value that
            ``--set`` refuses.
    """
    from sim2vr_harness.runs.config import apply_overrides

    place, mark, query = page.partition("?")
    if mark and Path(page).expanduser().exists():
        return _absolute(page), {}
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError:
        pairs = []
    if mark and (not pairs or len(dict(pairs)) < len(pairs)):
        raise InputError("--page", repr(page), "PAGE?NAME=VALUE&NAME=VALUE, each name once")
    options = [f"env.app.options.{name}={value}" for name, value in pairs]
    try:
        found = apply_overrides({"env": {"app": {"page": place, "options": {}}}}, options)
    except InputError as error:
        raise InputError("--page", error.got, error.expected) from error
    return place if "://" in place else _absolute(place), found["env"]["app"]["options"]


def mapped_places(mapped: Sequence[str]) -> dict[str, str]:
    """Return the beginnings of addresses that ``--map`` names, with their folders.

    Raises:
        InputError: neither URL=FOLDER nor a map file.
    """
    from sim2vr_harness.client.webxr.vendor import read_map

    places = {}
    for pair in mapped:
        address, equals, place = pair.rpartition("=")
        if equals and "://" in address:
            places[address] = _absolute(place)
        elif pair.endswith(".json"):
            places |= read_map(Path(pair).expanduser())
        else:
            expected = (
                "URL=FOLDER, such as https://cdn.jsdelivr.net/npm/=node_modules, or a map file "
                "in JSON"
            )
            raise InputError("--map", repr(pair), expected)
    return places


def _absolute(path: str) -> str:
    return str(Path(path).expanduser().absolute())


def _absolute_task(task: str) -> str:
    file, colon, name = task.rpartition(".py:")
    return f"{_absolute(f'{file}.py')}:{name}" if colon else _absolute(task)
