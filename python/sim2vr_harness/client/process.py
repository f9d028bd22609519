"""An app's executable as a child process that never outlives this one."""

import os
import queue
import re
import select
import shutil
import signal
import stat
import subprocess
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sim2vr_harness.client.errors import AppDied, AppRefused, AppTimeout, ProtocolError
from sim2vr_harness.client.temporary import FOLDER_VARIABLE, GROUP_FILE, TemporaryFolder

BAD_USAGE = 2
"""Exit status by which sim2vr-app says that its arguments cannot be used."""

NOT_STARTED = (126, 127)
"""Exit statuses by which the helper that starts a program says that it could not."""

_NOTED = f'echo $$ >"$0/{GROUP_FILE}"; exec "$@"'
"""Script before a command that notes the process group in the folder named first."""

_MOVED_PIPES = " 3<&0 4>&1 0</dev/null 1>&2"
"""End of the script that makes standard input and output the descriptors 3 and 4."""

_POLL_S = 0.01
_KILL_S = 10.0
_MOST_SWEEPS = 20
_TAIL_BYTES = 4000
_TAIL_LINES = 12


def log_folder() -> Path:
    """Return the folder for the output and the sockets of child processes, made when missing.

    Raises:
        AppRefused: someone else has made it, and could read or replace what is put there.
    """
    folder = Path(tempfile.gettempdir()) / f"sim2vr-app-logs-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise AppRefused(
            f"temporary folder: got {folder}, which others own or may write, expected one of your "
            "own; remove it, or set TMPDIR to another place"
        )
    return folder


class AppProcess:
    """An executable in a process group of its own, its output in a file.

    It is ended, with everything it started, in whatever session or group, by :meth:`stop` or
    :meth:`kill`, when this object is forgotten, and when this process ends: in an orderly way by
    ``atexit``, after SIGKILL by a watcher (:mod:`~.temporary`), itself also by the kernel
    (PR_SET_PDEATHSIG). Ctrl-C in the terminal does not reach it.

    The output files are deleted after a clean end and kept in :func:`log_folder` after a failure,
    for people to read.

    Args:
        command: the executable and its arguments.
        environment: variables on top of this process's.
        extra_logs: files that the app writes by itself and that errors shall quote, too.
        at_end: called when it has ended, or could not be started.
        pipes: descriptors that become the app's 3 (to read from) and 4 (to write to); they stay
            this side's to close.
        stdin: descriptor of its standard input; None: it is empty.
        inherited: further descriptors that the app has under the same numbers; they stay this
            side's to close.
        home: the app's temporary folder and working directory, deleted with it; None: it works in
            this process's.

    Raises:
        AppRefused: the executable is missing or cannot be run.
    """

    def __init__(
        self,
        command: Sequence[str | os.PathLike[str]],
        *,
        environment: Mapping[str, str] | None = None,
        extra_logs: Sequence[Path] = (),
        at_end: Callable[[], object] | None = None,
        pipes: tuple[int, int] | None = None,
        stdin: int | None = None,
        inherited: Sequence[int] = (),
        home: TemporaryFolder | None = None,
    ) -> None:
        self.command = [os.fspath(part) for part in command]
        self._at_end = at_end or (lambda: None)
        path = self.command[0]
        self.name = Path(path).name
        try:
            if not Path(path).is_file():
                found = "a folder" if Path(path).is_dir() else "no file"
                raise AppRefused(f"executable: got {path!r}, which is {found}, expected a program")
            if not os.access(path, os.X_OK):
                raise AppRefused(
                    f"executable: got {path!r}, which may not be executed; run: chmod +x {path}"
                )
            log_folder()  # refused now rather than after a failure
        except AppRefused:
            self._at_end()
            raise
        self._folder = TemporaryFolder() if home is None else home
        self.log_file = self._folder.path / f"{self.name}.log"
        self._logs = [self.log_file, *extra_logs]
        self._keep_logs = False
        read_from = subprocess.DEVNULL if stdin is None else stdin
        note = _NOTED if pipes is None else _NOTED + _MOVED_PIPES
        noting = [*_dying_with_parent(), "sh", "-c", note, str(self._folder.path)]
        try:
            with self.log_file.open("xb") as log:
                self._popen = _spawner().start(
                    [*noting, *self.command],
                    stdin=read_from if pipes is None else pipes[0],
                    stdout=log if pipes is None else pipes[1],
                    stderr=log,
                    env={
                        **os.environ,
                        **(environment or {}),
                        FOLDER_VARIABLE: str(self._folder.path),
                    },
                    cwd=None if home is None else home.path,
                    start_new_session=True,
                    pass_fds=tuple(inherited),
                )
        except OSError as error:
            self._folder.remove()
            self._at_end()
            raise AppRefused(
                f"executable: got {path!r}, which cannot be started "
                f"({error.strerror}), expected a program for this machine"
            ) from error
        self._finalizer = weakref.finalize(
            self, _end_all, self._popen, self._folder.path, os.getpid()
        )

    @property
    def pid(self) -> int:
        """Process id, also that of the process group."""
        return self._popen.pid

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"

    # --- watching ----------------------------------------------------------------------------

    @property
    def exit_status(self) -> int | None:
        """None while the process runs; the negative number of the signal that killed it."""
        if self._popen.returncode is None:
            # Left a zombie, so that its process group cannot be anyone else's yet.
            found = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            if found is None:
                return None
            killed = found.si_code in (os.CLD_KILLED, os.CLD_DUMPED)
            return -found.si_status if killed else found.si_status
        return self._popen.returncode

    @property
    def running(self) -> bool:
        """True if the process exists; a stopped process does."""
        return self.exit_status is None

    def open_pidfd(self) -> int | None:
        """A file descriptor that becomes readable when the process ends; None without support.

        The caller closes it.
        """
        try:
            return os.pidfd_open(self.pid)
        except OSError:
            return None

    def wait(self, timeout_s: float) -> bool:
        """Waits for the end of the process; returns whether it came."""
        deadline = time.monotonic() + timeout_s
        descriptor = self.open_pidfd()
        if descriptor is None:
            while self.running and time.monotonic() < deadline:
                time.sleep(_POLL_S)
            return not self.running
        try:
            poll = select.poll()
            poll.register(descriptor, select.POLLIN)
            poll.poll(max(0.0, timeout_s) * 1000.0)
        finally:
            os.close(descriptor)
        return not self.running

    def wait_for_output(self, pattern: re.Pattern[str], timeout_s: float) -> re.Match[str]:
        """Waits until a line of the output matches.

        Raises:
            AppRefused: the app ended with the status for unusable arguments; says its own words.
            AppDied: the process ended otherwise.
            AppTimeout: the line did not come.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            running = self.running
            match = pattern.search(self.log_file.read_text(errors="replace"))
            if match is not None:
                return match
            if not running:
                raise self.death("while it started")
            if time.monotonic() > deadline:
                raise AppTimeout(
                    f"{self} was not ready within {timeout_s:g} s after its start{self.log_words()}"
                )
            time.sleep(_POLL_S)

    def death(self, when: str) -> AppDied | AppRefused:
        """The error to raise for a process that has ended; ``when`` goes into the message."""
        status = self.exit_status
        if status == BAD_USAGE:
            return AppRefused(
                f"{self.name} refused its arguments: {self.log_tail(3) or 'no words'}"
            )
        if status in NOT_STARTED:
            return AppRefused(
                f"executable: got {self.command[0]!r}, which cannot be started "
                f"({self.log_tail(3)}), expected a program for this machine"
            )
        return AppDied(f"{self} {end_words(status)} {when}{self.log_words()}")

    def log_tail(self, lines: int = _TAIL_LINES) -> str:
        """The last lines of what the app wrote."""
        texts = [tail for file in self._logs if (tail := _tail(file, lines))]
        return "\n".join(texts)

    def log_words(self) -> str:
        """The end of a message: where the log is and, from the next line on, how it ends."""
        # Move the log to where it outlives this process.
        self._keep_logs = True
        if self.log_file.parent == self._folder.path:
            handle, kept = tempfile.mkstemp(".log", f"{self.name}-", log_folder())
            os.close(handle)
            self.log_file = self._logs[0] = self.log_file.replace(kept)
        tail = self.log_tail()
        files = " and ".join(str(file) for file in self._logs if file.is_file())
        return f"; its log: {files}\n{tail}" if tail else f"; its log is empty: {files}"

    # --- ending ------------------------------------------------------------------------------

    def stop(self, grace_s: float = 5.0) -> None:
        """Ends a process that has to end: waits for it, then SIGTERM, then SIGKILL.

        Idempotent.

        Args:
            grace_s: how long to wait before SIGTERM, and again before SIGKILL.
        """
        self._keep_logs = False
        if self._finalizer.alive:
            self.wait(grace_s)
        self.terminate(grace_s)

    def terminate(self, grace_s: float) -> None:
        """Ends the process by SIGTERM, and by SIGKILL ``grace_s`` later; idempotent."""
        if self._finalizer.alive and self.running:
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGTERM)
            self.wait(grace_s)
        self.kill()

    def kill(self) -> None:
        """Ends the process and its group at once; idempotent."""
        self._finalizer()
        self._at_end()
        if not self._keep_logs:
            for file in self._logs:
                file.unlink(missing_ok=True)
        self._folder.remove()


class Conversation:
    """Talk with an app, given up after the first failure, which later calls repeat.

    Args:
        process: of the app; None: this side has not started it.

    Attributes:
        failure: why it does not go on; None while it does.
    """

    def __init__(self, process: AppProcess | None) -> None:
        self.process = process
        self.failure: str | None = None
        self._ended = None if process is None else process.open_pidfd()

    @property
    def app(self) -> str:
        """The app in words, for messages."""
        return str(self.process)

    @property
    def usable(self) -> bool:
        """True if the app answers requests."""
        return self.failure is None

    def require_open(self) -> None:
        """Raise AppDied after a failure."""
        if self.failure is not None:
            raise AppDied(f"{self.app} was given up: {self.failure}")

    def give_up(self, error: Exception) -> Exception:
        """End the conversation because of ``error``, which later calls repeat; returns it."""
        self.failure = self.failure or str(error)
        return error

    def malformed(self, what: object, doing: str = "") -> Exception:
        """Give up because of an answer, to what ``doing`` says, that cannot be used."""
        words = f"{self.app} answered {doing}".rstrip()
        return self.give_up(ProtocolError(f"{words} with another thing: {what}"))

    def silent(self, what: str, limit_s: float, hint: str = "") -> Exception:
        """Give up because an answer has not come in time."""
        return self.give_up(AppTimeout(f"{self.app} gave no {what} within {limit_s:g} s{hint}"))

    def died(self, when: str) -> Exception:
        """Give up because the process ended; its connection closes a moment before it does."""
        assert self.process is not None
        self.process.wait(1.0)
        return self.give_up(self.process.death(when))

    def close(self) -> None:
        """Ask nothing more; idempotent."""
        self.failure = self.failure or "it is closed; make a new one"
        if self._ended is not None:
            os.close(self._ended)
            self._ended = None


def end_words(status: int | None) -> str:
    """Return how a process ended: by itself or by a signal; None: it only fell silent."""
    if status is None:
        return "closed its connection"
    if status < 0:
        with suppress(ValueError):
            return f"was killed ({signal.Signals(-status).name})"
    return f"ended with exit status {status}"


def _tail(file: Path, lines: int) -> str:
    try:
        with file.open("rb") as stream:
            stream.seek(0, os.SEEK_END)
            stream.seek(max(0, stream.tell() - _TAIL_BYTES))
            text = stream.read().decode(errors="replace")
    except OSError:
        return ""
    return "\n".join(text.rstrip().splitlines()[-lines:])


def _end_all(popen: subprocess.Popen[bytes], folder: Path, owner: int) -> None:
    """Kills the process group and what left it, and takes the process's status."""
    if os.getpid() != owner:  # A fork of the owner; the child is not its own.
        return
    if popen.returncode is None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(popen.pid, signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):  # stuck in the kernel: gone when that lets go
            popen.wait(_KILL_S)
    entry = b"\0" + os.fsencode(f"{FOLDER_VARIABLE}={folder}") + b"\0"
    for _ in range(_MOST_SWEEPS):  # again, for those that were forked meanwhile
        # Kills the processes whose environment has an entry; returns whether there were any.
        found = False
        for process in Path("/proc").iterdir():
            if not process.name.isdigit():
                continue
            with suppress(OSError):  # another user's, or gone
                if entry not in b"\0" + (process / "environ").read_bytes():
                    continue
                number = int(process.name)
                descriptor = os.pidfd_open(number)
                try:
                    # The number may be another's by now; the descriptor's process has the entry.
                    if entry in b"\0" + (process / "environ").read_bytes():
                        signal.pidfd_send_signal(descriptor, signal.SIGKILL)
                        found = True
                finally:
                    os.close(descriptor)
        if not found:
            return


def _dying_with_parent() -> list[str]:
    """Words before a command that make the kernel kill it when its parent is gone."""
    setpriv = shutil.which("setpriv")
    return [] if setpriv is None else [setpriv, "--pdeathsig", "KILL", "--"]


class _Spawner:
    """Starts all child processes from one thread.

    The kernel's parent, for the signal that ends an orphan, is the thread that started it: a child
    started from a short-lived thread would be killed with it. This thread lives as long as the
    process.
    """

    def __init__(self) -> None:
        self.owner = os.getpid()
        self._jobs: queue.SimpleQueue[tuple[Callable[[], Any], queue.SimpleQueue[Any]]] = (
            queue.SimpleQueue()
        )
        threading.Thread(target=self._run, name="app-spawner", daemon=True).start()

    def _run(self) -> None:
        while True:
            job, answer = self._jobs.get()
            try:
                answer.put((job(), None))
            except BaseException as error:
                answer.put((None, error))

    def start(self, command: Sequence[str], **settings: Any) -> subprocess.Popen[bytes]:
        """``subprocess.Popen`` in the thread."""
        answer: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._jobs.put((lambda: subprocess.Popen(command, **settings), answer))
        popen, error = answer.get()
        if error is not None:
            raise error
        return popen


_spawner_lock = threading.Lock()
_the_spawner: _Spawner | None = None


def _spawner() -> _Spawner:
    global _the_spawner
    with _spawner_lock:
        if _the_spawner is None or _the_spawner.owner != os.getpid():
            _the_spawner = _Spawner()
        return _the_spawner
