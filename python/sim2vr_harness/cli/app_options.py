"""Options of commands that say which app to play in, and what they mean as settings."""

from __future__ import annotations

import functools
import inspect
import math
import shlex
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import parse_qsl

import typer

from sim2vr_harness.base.errors import InputError

AppOption = Annotated[
    str | None,
    typer.Option(
        "--app", metavar="PATH", help="Play in this executable, such as a Unity build with SIM2VR."
    ),
]
AppArgOption = Annotated[
    list[str] | None,
    typer.Option("--app-arg", metavar="ARG", help="An argument for --app; may be repeated."),
]
ConnectOption = Annotated[
    str | None,
    typer.Option("--connect", metavar="HOST:PORT", help="Play in an app that runs already."),
]
ProtocolOption = Annotated[
    int | None,
    typer.Option(
        "--protocol",
        help="What --app or --connect speak: 1 (SIM2VR) or 2 (sim2vr-app).",
        show_default="1",
    ),
]
PageOption = Annotated[
    str | None,
    typer.Option(
        "--page",
        metavar="FILE",
        help="Play a WebXR page: a file, a folder, or a mapped address; ?NAME=VALUE sets options.",
    ),
]
MapOption = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="URL=FOLDER|FILE",
        help="Where a page finds addresses that begin so, or a map file of `page vendor`; may be "
        "repeated. All others are refused.",
    ),
]
TaskOption = Annotated[
    str | None,
    typer.Option(
        "--task", metavar="FILE", help="What the app is worth: FILE.py:CLASS, or rules in YAML."
    ),
]
OpenXROption = Annotated[
    str | None,
    typer.Option(
        "--openxr", metavar="PROGRAM", help="Play an OpenXR program; arguments in the same quotes."
    ),
]
VirtualClockOption = Annotated[
    bool | None,
    typer.Option(
        "--virtual-clock", help="Let clocks of --openxr advance with steps.", show_default=False
    ),
]
XvfbOption = Annotated[
    bool | None,
    typer.Option("--xvfb", help="Give --openxr an X server of its own.", show_default=False),
]
BrowserOption = Annotated[
    str | None,
    typer.Option(
        "--browser", metavar="PATH", help="The Chromium that shows pages.", show_default="found"
    ),
]
GameLibraryOption = Annotated[
    str | None,
    typer.Option(
        "--game-library", metavar="FILE", help="A shared library of games, whose code is run."
    ),
]


_COMMAND = "PROGRAM, or 'PROGRAM ARGS'"
_PAGE_OPTIONS: dict[str, Any] = {
    "page": PageOption,
    "mapped": MapOption,
    "task": TaskOption,
    "browser": BrowserOption,
    "openxr": OpenXROption,
    "virtual_clock": VirtualClockOption,
    "xvfb": XvfbOption,
    "game_library": GameLibraryOption,
}
_APP_OPTIONS: dict[str, Any] = {
    "app": AppOption,
    "arguments": AppArgOption,
    "connect": ConnectOption,
    "protocol": ProtocolOption,
    **_PAGE_OPTIONS,
}


def with_app_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command ``--app``, ``--connect``, ``--page`` and what belongs to them.

    The function gets the settings of ``env.app`` as its argument ``remote``.
    """
    return _with_options(function, _APP_OPTIONS)


def with_page_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command ``--page``, ``--map``, ``--task`` and ``--browser``; see above."""
    return _with_options(function, _PAGE_OPTIONS)


def _with_options(function: Callable[..., Any], options: Mapping[str, Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def run(**given: Any) -> Any:
        chosen = {name: given.pop(name) for name in options}
        return function(**given, remote=app_settings(**chosen))

    signature = inspect.signature(function, eval_str=True)
    own = [each for each in signature.parameters.values() if each.name != "remote"]
    more = [
        inspect.Parameter(name, own[0].kind, default=None, annotation=annotation)
        for name, annotation in options.items()
    ]
    run.__signature__ = signature.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in (*own, *more)}
    return run


def app_settings(
    app: str | None = None,
    arguments: list[str] | None = None,
    connect: str | None = None,
    protocol: int | None = None,
    page: str | None = None,
    mapped: list[str] | None = None,
    task: str | None = None,
    browser: str | None = None,
    openxr: str | None = None,
    virtual_clock: bool | None = None,
    xvfb: bool | None = None,
    game_library: str | None = None,
) -> dict[str, Any]:
    """Return the settings of ``env.app`` that the options mean; none without any of them.

    Raises:
        InputError: options that do not go together.
    """
    if protocol not in (None, 1, 2):
        raise InputError("--protocol", str(protocol), "1 or 2")
    _require_one(("--app", app), ("--connect", connect), ("--page", page), ("--openxr", openxr))
    _require_one(("--page", page), ("--openxr", openxr), ("--protocol", protocol))
    for option, value, owner, owned in (
        ("--app-arg", arguments, "--app", app or openxr),
        ("--map", mapped, "--page", page),
        ("--browser", browser, "--page", page),
        ("--virtual-clock", virtual_clock, "--openxr", openxr),
        ("--xvfb", xvfb, "--openxr", openxr),
    ):
        if value and owned is None:
            raise InputError(option, f"it without {owner}", f"it together with {owner}")
    judged = {} if task is None else {"task": _absolute_task(task)}
    if game_library is not None:
        from sim2vr_harness.client import load_game_library

        load_game_library(Path(game_library).expanduser())  # who names it here, runs it
        judged["game_library"] = _absolute(game_library)
    if page is not None:
        return {**_page_settings(page, mapped or [], browser), **judged}
    if openxr is not None:
        options = {"virtual_clock": virtual_clock, "xvfb": xvfb}
        chosen = {name: True for name, value in options.items() if value}
        return {**_program_settings(openxr, arguments or [], chosen), **judged}
    if app is None and connect is None and protocol is None:
        return judged
    return {
        "transport": f"protocol{protocol or 1}",
        "executable": None if app is None else str(Path(app).expanduser().absolute()),
        "arguments": list(arguments or []),
        "connect": connect,
        **judged,
    }


def _require_one(*given: tuple[str, Any]) -> None:
    """Refuse options of which only one may be given."""
    named = [option for option, value in given if value is not None]
    if len(named) > 1:
        raise InputError(named[1], f"it together with {named[0]}", "one of them")


def _page_settings(page: str, mapped: list[str], browser: str | None) -> dict[str, Any]:
    from sim2vr_harness.envs.config import page_name

    place, options = page_and_options(page)
    return {
        "transport": "webxr",
        "game": page_name(place),
        "page": place,
        "map": mapped_places(mapped),
        "browser": browser,
        **({"options": options} if options else {}),
    }


def page_and_options(page: str) -> tuple[str, dict[str, Any]]:
    """Return a page's whole path, or its address, and the options in its query.

    A number that is written as Python writes it is a number, as with ``--set``.

    Raises:
        InputError: the query is no NAME=VALUE&NAME=VALUE, or has a name twice.
    """
    place, mark, query = page.partition("?")
    if mark and Path(page).expanduser().exists():
        return _absolute(page), {}
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError:
        pairs = []
    if mark and (not pairs or len(dict(pairs)) < len(pairs)):
        raise InputError("--page", repr(page), "PAGE?NAME=VALUE&NAME=VALUE, each name once")
    return place if "://" in place else _absolute(place), {k: _plain(v) for k, v in pairs}


def _plain(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            if str(kind(text)) == text and math.isfinite(kind(text)):
                return kind(text)
        except (ValueError, OverflowError):
            continue
    return text


def _program_settings(
    program: str, arguments: list[str], options: dict[str, Any]
) -> dict[str, Any]:
    """Settings of an OpenXR program; its files are named by whole paths, for later runs."""
    from sim2vr_harness.envs.config import program_name

    try:
        words = [program] if Path(program).expanduser().is_file() else shlex.split(program)
    except ValueError as error:
        raise InputError("--openxr", f"{program!r} ({error})", _COMMAND) from error
    if not words:
        raise InputError("--openxr", "nothing", _COMMAND)
    found = words[0] if "/" in words[0] or Path(words[0]).is_file() else shutil.which(words[0])
    command = [_absolute(found or words[0])]
    for word in (*words[1:], *arguments):
        file = "/" in word or word.endswith((".py", ".qml"))
        command.append(_absolute(word) if file and Path(word).expanduser().exists() else word)
    return {
        "transport": "openxr",
        "game": program_name(command),
        "executable": command[0],
        "arguments": command[1:],
        "transport_options": options,
    }


def mapped_places(mapped: list[str]) -> dict[str, str]:
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
