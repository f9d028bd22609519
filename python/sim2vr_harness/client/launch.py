"""Starts app executables and connects to them: our sim2vr-app, or any that speaks protocol 1."""

from __future__ import annotations

import json
import os
import re
import secrets
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from sim2vr_harness.base.notices import notice_once
from sim2vr_harness.client.base import OptionValue, plain_options
from sim2vr_harness.client.channel import Channel, checked_duration_s
from sim2vr_harness.client.games import describe_game, loaded_game_libraries
from sim2vr_harness.client.process import AppProcess, log_folder
from sim2vr_harness.client.runtime import list_games

_FLAGS = ("adaptive", "sparse")
"""Options of the reference that are flags."""
_LISTENING = re.compile(r"^sim2vr-app: listening on (.+)$", re.MULTILINE)
_CONDITION = re.compile(r"--?condition(?:[= ](.*))?", re.DOTALL)
_MAX_PATH_BYTES = 107
"""Longest path of a Unix socket."""
_ABANDONED_S = 60.0
"""A socket's file that is older and that no one listens on was left behind by a killed server."""
_SILENCE_S = 24 * 3600
"""Time for which our server waits for the next message, s: a learner's update may take long, and a
lost client is detected by its connection."""


def is_sim2vr_app(executable: Path) -> bool:
    """Return whether an executable, by its name, is our server, with other options than Unity's."""
    return executable.name.startswith("sim2vr-app")


def connect(address: str, timeout_s: float) -> Channel:
    """A channel to an app that runs already; nothing is sent yet.

    Args:
        address: ``HOST:PORT``, or a ZeroMQ endpoint such as ``ipc:///tmp/app``.
        timeout_s: deadline of every answer.
    """
    endpoint = address if "://" in address else f"tcp://{address}"
    return Channel(endpoint, timeout_s=timeout_s)


class StartingApp:
    """A process that was started and is not known to listen yet.

    Args:
        process: of the app.
        endpoint: where it has to listen; None: it says itself where it does.
    """

    def __init__(self, process: AppProcess, endpoint: str | None = None) -> None:
        self.process, self._endpoint = process, endpoint

    def channel(self, timeout_s: float, start_timeout_s: float) -> Channel:
        """A channel to the app; waits until it listens where it says so.

        Args:
            timeout_s: deadline of every answer.
            start_timeout_s: deadline of the start.

        Raises:
            AppRefused: the app does not take its arguments; says its own words.
            AppTimeout, AppDied: it does not start.
            ValueError: a deadline is no time to wait.
        """
        try:
            checked_duration_s("start_timeout_s", start_timeout_s)
            endpoint = self._endpoint
            if endpoint is None:
                endpoint = self.process.wait_for_output(_LISTENING, start_timeout_s).group(1)
            return Channel(endpoint, timeout_s=timeout_s, process=self.process)
        except BaseException:
            self.process.kill()
            raise


def start_sim2vr_app(executable: Path, arguments: Sequence[str]) -> StartingApp:
    """Start our server where this user's processes alone can reach it.

    It listens on a Unix socket in the folder of the logs, or, where that path is too long for one,
    on a TCP port of this machine that it picks itself.

    Raises:
        AppRefused: there is no such program.
    """
    # Delete the files of sockets whose servers were killed together with their clients.
    for sockets_file in log_folder().glob("*.socket"):
        with suppress(OSError):
            if time.time() - sockets_file.stat().st_mtime < _ABANDONED_S:
                continue
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
                try:
                    probe.connect(str(sockets_file))
                except ConnectionRefusedError:
                    sockets_file.unlink()
    file: Path | None = log_folder() / f"{secrets.token_hex(8)}.socket"
    if len(os.fsencode(file)) > _MAX_PATH_BYTES:  # type: ignore[arg-type]
        file = None
    place = ["--port", "0"] if file is None else ["--bind", f"ipc://{file}"]
    command = [str(executable), *place, "--timeout", str(_SILENCE_S), *arguments]
    unlink = None if file is None else partial(file.unlink, missing_ok=True)
    return StartingApp(AppProcess(command, at_end=unlink))


def named_condition(arguments: Sequence[str]) -> str | None:
    """Return the value of ``-condition`` among an app's arguments; None without it."""
    for word, after in zip(arguments, [*arguments[1:], ""], strict=False):
        match = _CONDITION.fullmatch(word)
        if match is not None:
            return after if match[1] is None else match[1]
    return None


def options_beside(
    game: str, options: Mapping[str, OptionValue], arguments: Sequence[str]
) -> dict[str, OptionValue]:
    """Return the options of our server's game that its arguments do not set.

    Args:
        options: of the configuration.
        arguments: given by the user; ``-condition``, ``-adaptive`` and ``-sparse`` win.
    """
    condition = named_condition(arguments)
    known = describe_game(game).conditions if game in list_games() else ()
    own = {key for one in known if one.name == condition for key in one.options}
    own |= {name for name in _FLAGS if {f"-{name}", f"--{name}"} & set(arguments)}
    return {key: value for key, value in options.items() if key not in own}


def sim2vr_arguments(
    game: str,
    options: Mapping[str, OptionValue],
    *,
    width: int,
    height: int,
    renderer: str,
    log_dir: Path | None,
) -> list[str]:
    """Arguments of our server for one app, as ``InProcessApp`` takes them."""
    arguments = [
        "--game",
        game,
        "--options",
        json.dumps(plain_options(options)),
        "--renderer",
        renderer,
    ]
    for library in loaded_game_libraries():
        arguments += ["--game-library", library]
    arguments += ["--width", str(width), "--height", str(height)]
    return arguments if log_dir is None else [*arguments, "--log-dir", str(log_dir)]


def unity_arguments(
    options: Mapping[str, OptionValue], arguments: Sequence[str], log_dir: Path | None
) -> list[str]:
    """Arguments of a SIM2VR app for game options, as far as the reference has them.

    Args:
        options: ``condition`` becomes ``-condition``; ``adaptive`` and ``sparse`` that are true
            become the flags of that name; others have no argument, which is said once.
        arguments: given by the user; what stands here is not added again.
        log_dir: folder for the app's logs, or None.
    """
    added = []
    if "condition" in options and named_condition(arguments) is None:
        added += ["-condition", str(options["condition"])]
    for name in _FLAGS:
        if options.get(name) is True and f"-{name}" not in arguments:
            added.append(f"-{name}")
    dropped = sorted(set(options) - {"condition", *_FLAGS})
    if dropped:
        names = ", ".join(f"env.app.options.{name}" for name in dropped)
        notice_once(f"note: a Unity build has no argument for {names}; its own value holds")
    if log_dir is not None and "-logging" not in arguments:
        added += ["-logging"]
        if "-outputFolder" not in arguments:
            added += ["-outputFolder", str(log_dir)]
    return [*arguments, *added]


def start_unity_app(executable: Path, arguments: Sequence[str]) -> StartingApp:
    """Starts a SIM2VR app, as the reference does.

    Args:
        executable: a Unity build with the SIM2VR asset, or another program that takes
            ``-simulated -port N -logFile FILE`` and speaks protocol 1.
        arguments: added to these.

    Raises:
        AppRefused: there is no such program.
    """
    port = PortReservation()
    own_log = log_folder() / f"{executable.name}-{os.getpid()}-{port.number}.unity.log"
    command = [str(executable), "-simulated", "-port", str(port.number), "-logFile", str(own_log)]
    environment = {} if os.environ.get("DISPLAY") else {"DISPLAY": ":0"}
    process = AppProcess(
        [*command, *arguments],
        environment=environment,
        extra_logs=[own_log],
        at_end=port.release,
    )
    return StartingApp(process, f"tcp://127.0.0.1:{port.number}")


class PortReservation:
    """A free TCP port of this machine that no other program is given meanwhile.

    The reference asks for a free port and lets go of it before the app takes it, so that two
    workers can be given the same one. A socket that is bound but does not listen keeps the port
    from being handed out, and lets the app, which binds it by number with SO_REUSEADDR (as ZeroMQ
    and .NET do), listen on it all the same.
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind(("127.0.0.1", 0))
        self.number: int = self._socket.getsockname()[1]

    def release(self) -> None:
        """Lets the port go; idempotent."""
        self._socket.close()
