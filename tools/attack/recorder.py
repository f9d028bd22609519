"""Attacks a running ``session record``: no frame that the page sent may be lost.

Four attacks after another, each on recorders of its own, which the script plays the page for:

- ``slow``: strangers without the token hold connections open, silent or with a byte now and then,
  and open new ones all the time. The page's parts must be taken meanwhile, each within
  ``--answer`` seconds.
- ``disk``: the recorder may write files of at most ``--disk`` bytes (``RLIMIT_FSIZE``), too few
  for the session. It must keep the parts; a recorder with room must then write all frames.
- ``kills``: SIGHUP, SIGQUIT, SIGTERM, SIGINT or SIGKILL after some parts. The file, or the one that
  the next recorder recovers, must have their frames, and no parts may be left.
- ``servers``: two recorders with the same ``--out``, and a file that appears there while one
  records. The second recorder must be refused, and the file must stay as it is.

Prints one JSON line per attack with counts; ends with status 1 when something broke.

Run: python tools/attack/recorder.py --kills 50
"""

import argparse
import http.client
import json
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from sim2vr_harness.sessions import read_session

SESSION = "0" * 32
FRAMES_IN_PART = 5
ENDS_S = 60.0


class Recorder:
    """A ``session record`` of an empty page, and the page's side of it.

    Args:
        folder: With the page and the files to write.
        out: Name of the file.
        most_bytes: That it may write to one file.
    """

    def __init__(self, folder: Path, out: str, most_bytes: int | None = None) -> None:
        (folder / "page.html").write_text("<p>")

        def restrict() -> None:
            for way in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT):  # a shell's jobs ignore some
                signal.signal(way, signal.SIG_DFL)
            if most_bytes is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, resource.RLIM_INFINITY))

        command = [sys.executable, "-m", "sim2vr_harness.cli.main", "session", "record"]
        command += ["--page", "page.html", "--out", out, "--port", "0"]
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=restrict,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        self.address = urlsplit(line.split()[-1]) if line else None
        if self.address:
            self.process.stdout.readline()  # the seed: it is waiting

    def send(self, part: int, *, last: bool = False) -> int:
        """Send a part of some frames; return the status of the answer."""
        assert self.address is not None and self.address.port is not None
        token = self.address.path.split("/")[1]
        first = part * FRAMES_IN_PART
        times = range(first * 10**7, (first + FRAMES_IN_PART) * 10**7, 10**7)
        lines = [json.dumps({"t": t, "head": [0, 1.5, 0, 0, 0, 0, 1]}) for t in times]
        if part == 0:
            lines.insert(0, '{"format":"sim2vr-session","version":1,"app":{"kind":"page"}}')
        connection = http.client.HTTPConnection("127.0.0.1", self.address.port, timeout=30.0)
        query = f"session={SESSION}&part={part}&last={int(last)}"
        origin = f"http://127.0.0.1:{self.address.port}"
        body = "".join(f"{line}\n" for line in lines)
        try:
            connection.request("POST", f"/{token}/__sim2vr/part?{query}", body, {"Origin": origin})
            return connection.getresponse().status
        finally:
            connection.close()

    def end(self) -> tuple[int, str]:
        """Wait for its end; return the status and the errors."""
        _, errors = self.process.communicate(timeout=ENDS_S)
        return self.process.returncode, errors


@contextmanager
def recording(folder: Path, out: str, most_bytes: int | None = None) -> Iterator[Recorder]:
    """A recorder, killed at the end."""
    made = Recorder(folder, out, most_bytes)
    try:
        yield made
    finally:
        made.process.kill()
        made.process.communicate()


def recover(folder: Path) -> str:
    """Start and stop a recorder; return what it said of earlier recordings."""
    with recording(folder, "next.jsonl") as made:
        made.process.send_signal(signal.SIGINT)
        return made.end()[1]


def check(folder: Path, out: str, parts: int) -> None:
    """Compare a file's frames with those that were sent, and see that no parts are left."""
    times = read_session(folder / out).time_ns.tolist()
    assert times == [n * 10**7 for n in range(parts * FRAMES_IN_PART)], f"{len(times)} frames"
    assert not list(folder.glob("*.parts")), "parts are left"


def slow(folder: Path, strangers: int, chance: random.Random, answer_s: float) -> Counter[str]:
    """Hold connections while a page records."""
    counts: Counter[str] = Counter()
    over = threading.Event()
    with recording(folder, "slow.jsonl") as made, ExitStack() as held:
        assert made.address is not None and made.address.port is not None
        place = ("127.0.0.1", made.address.port)

        def hold() -> None:
            open_: list[socket.socket] = []
            while not over.wait(0.002):
                try:
                    if len(open_) < strangers:
                        open_.append(held.enter_context(socket.create_connection(place, 5.0)))
                    chance.choice(open_).send(b"G")
                except OSError:  # the recorder has closed it
                    counts["closed"] += 1
                    held.pop_all().close()
                    open_.clear()

        stranger = threading.Thread(target=hold)
        stranger.start()
        try:
            for part in range(20):
                asked_s = time.monotonic()
                while (left_s := answer_s + asked_s - time.monotonic()) > 0:
                    try:
                        status = made.send(part, last=part == 19)
                        break
                    except (OSError, http.client.HTTPException):
                        counts["sent again"] += 1  # as the page does
                        time.sleep(0.1)
                assert left_s > 0 and status == 204, f"part {part} is blocked"
                slowest = round(1000 * (time.monotonic() - asked_s))
                counts["slowest_ms"] = max(counts["slowest_ms"], slowest)
                time.sleep(0.1)
        finally:
            over.set()
            stranger.join()
        assert made.end()[0] == 0
    check(folder, "slow.jsonl", 20)
    return counts


def disk(folder: Path, most_bytes: int) -> Counter[str]:
    """Send a session that is larger than what the recorder may write."""
    with recording(folder, "disk.jsonl", most_bytes) as made:
        for part in range(20):
            assert made.send(part, last=part == 19) == 204
        status, errors = made.end()
    assert status != 0 and "disk.jsonl.parts" in errors, errors
    assert not (folder / "disk.jsonl").exists(), "half a file"
    assert "Recovered: " in recover(folder)
    check(folder, "disk.jsonl", 20)
    with recording(folder, "full.jsonl", 100) as made:  # too few for a part
        assert made.send(0) == 507
        made.process.send_signal(signal.SIGINT)
        assert made.end()[0] != 0
    assert not list(folder.glob("full.jsonl*")), "half a part is left"
    return Counter(sessions=2)


def kills(folder: Path, number: int, chance: random.Random) -> Counter[str]:
    """End recorders in the middle of a session."""
    counts: Counter[str] = Counter()
    ways = [signal.SIGHUP, signal.SIGQUIT, signal.SIGKILL, signal.SIGTERM, signal.SIGINT]
    for n in range(number):
        way, out = ways[n % len(ways)], f"kill{n}.jsonl"
        with recording(folder, out) as made:
            parts = chance.randint(1, 20)
            for part in range(parts):
                assert made.send(part) == 204
            time.sleep(chance.choice([0.0, 0.001, 0.1]))
            made.process.send_signal(way)
            status, _ = made.end()
        if way == signal.SIGKILL:
            assert f"Recovered: {folder / out}" in recover(folder)
        else:
            assert status == 0, f"status {status} after {way.name}"
        check(folder, out, parts)
        counts[way.name] += 1
    return counts


def servers(folder: Path) -> Counter[str]:
    """Let two write the same file."""
    with recording(folder, "two.jsonl") as made:
        with recording(folder, "two.jsonl") as second:
            status, errors = second.end()
        assert status == 2 and "another recording is running" in errors, errors
        (folder / "two.jsonl").write_text("mine")
        assert made.send(0, last=True) == 204
        status, errors = made.end()
    assert status != 0 and (folder / "two.jsonl").read_text() == "mine", "overwritten"
    assert "two.jsonl.parts" in errors, errors
    said = recover(folder)
    assert "rename" in said and (folder / "two.jsonl").read_text() == "mine", said
    (folder / "two.jsonl").unlink()
    recover(folder)
    check(folder, "two.jsonl", 1)
    return Counter(refused=1, kept=1)


def main() -> int:
    """Run the attacks; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--strangers", type=int, default=64, help="connections held")
    parser.add_argument("--answer", type=float, default=5.0, help="longest time for a part, s")
    parser.add_argument("--disk", type=int, default=2000, help="largest file, bytes")
    parser.add_argument("--kills", type=int, default=20, help="recorders to end")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    attacks: dict[str, Callable[[Path, random.Random], Counter[str]]] = {
        "slow": lambda folder, chance: slow(folder, asked.strangers, chance, asked.answer),
        "disk": lambda folder, chance: disk(folder, asked.disk),
        "kills": lambda folder, chance: kills(folder, asked.kills, chance),
        "servers": lambda folder, chance: servers(folder),
    }
    broken = 0
    for name, attack in attacks.items():
        with tempfile.TemporaryDirectory() as folder:
            try:
                counts: dict[str, Any] = dict(
                    attack(Path(folder), random.Random(f"{asked.seed} {name}"))
                )
            except (AssertionError, OSError, subprocess.TimeoutExpired) as error:
                counts, broken = {"broke": f"{type(error).__name__}: {error}"}, broken + 1
        print(json.dumps({"attack": name, **counts}), flush=True)
    return min(broken, 1)


if __name__ == "__main__":
    sys.exit(main())
