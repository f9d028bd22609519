"""The preloaded virtual clock: times, sleeps and waits of a program, with Python in it."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from openxr_programs import hands, manifest, open_program, program
from parts import needs
from sim2vr_harness.client import frame_time_ns
from sim2vr_harness.client.openxr.program import START_NS, VirtualClock
from sim2vr_harness.client.openxr.runtime_files import CLOCK_LIBRARY, find_library

pytestmark = needs("runtime", find_library(CLOCK_LIBRARY), f"no {CLOCK_LIBRARY}")

READ = """
import ctypes, json, select, threading, time
config = hello()
memory = session(config)
set_time = ctypes.CDLL(None).sim2vr_clock_advance
begun = time.time()
late = []
def wait():
    time.sleep(0.3)
    late.append(time.monotonic_ns())
while True:
    frames, image = step()
    for frame in frames:
        set_time(ctypes.c_int64(frame[0]))
    if len(late) == 0 and frames[-1][0] == config["start_time_ns"]:
        threading.Thread(target=wait, daemon=True).start()
        time.sleep(0.01)  # moves this thread's time on: no real time passes
    now = [time.clock_gettime_ns(clock) for clock in (1, 4, 6, 7, 0, 5)]
    print("now", json.dumps([now, time.time_ns(), begun, late]), flush=True)
    answer(frames, 0)
"""


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIM2VR_OPENXR_RUNTIME", str(manifest(tmp_path)))


def played(tmp_path: Path, steps: int, pause_s: float = 0.0) -> list[list[object]]:
    """What the program read in each step."""
    file = program(tmp_path, READ)
    found = []
    with open_program(file, options={"virtual_clock": True}, renderer="null") as app:
        for step in range(steps):
            if step == 0:
                app.reset(1, hands())
            else:
                app.step(frame_time_ns(step, 20), hands())
            time.sleep(pause_s)
            lines = app._program.lines()  # type: ignore[union-attr]
            found += [json.loads(line[4:]) for line in lines if line.startswith("now ")]
    return found


def test_clocks_stand_still_between_steps_and_move_with_them(tmp_path: Path) -> None:
    rows = played(tmp_path, 4, pause_s=0.05)
    assert len(rows) == 4
    epoch_ns = 1_767_225_600 * 10**9
    for step, (clocks, day, begun, _) in enumerate(rows):
        assert isinstance(clocks, list)
        expected = START_NS + frame_time_ns(step, 20) + (10_000_000 if step == 0 else 0)
        assert clocks[:4] == [expected] * 4
        assert clocks[4:] == [expected + epoch_ns] * 2
        assert day == expected + epoch_ns
        assert begun == pytest.approx((START_NS - 10 * 10**9 + epoch_ns) * 1e-9)


def test_a_sleep_of_another_thread_ends_when_steps_have_brought_its_time(tmp_path: Path) -> None:
    rows = played(tmp_path, 12, pause_s=0.03)
    ends = [late for _, _, _, late in rows if late]
    assert not rows[5][3], "0.25 s of virtual time, 0.18 s and more of real time"
    assert ends and START_NS + 300_000_000 <= ends[0][0] <= START_NS + 400_000_000  # type: ignore[index]
    assert played(tmp_path, 2, pause_s=0.5)[-1][3] == [], "real time does not end it"


HANG = """
import select, threading, time
kind = sys.argv[1]
wake = threading.Event()
if kind == "spin":
    end = time.monotonic() + 0.2
    while time.monotonic() < end:
        pass
elif kind == "sleep":
    time.sleep(0.2)
elif kind == "select":
    select.select([], [], [], 0.2)
elif kind == "poll":
    select.poll().poll(200)
elif kind == "epoll":
    select.epoll().poll(0.2)
elif kind == "wait":
    assert not wake.wait(0.2)
elif kind == "woken":
    threading.Timer(0.05, wake.set).start()
    assert wake.wait(30.0)
print(time.monotonic_ns())
"""


@pytest.mark.parametrize("kind", ["spin", "sleep", "select", "poll", "epoll", "wait", "woken"])
def test_no_wait_hangs_while_a_program_starts(kind: str) -> None:
    """Virtual time moves on by as much as was waited; a loop of reads gets real time after 1 s."""
    clock = VirtualClock()
    library = find_library(CLOCK_LIBRARY)
    environment = {"LD_PRELOAD": str(library), "SIM2VR_CLOCK": str(clock.descriptor)}
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{HANG}", kind],
        pass_fds=[clock.descriptor],
        env=environment,
        capture_output=True,
        text=True,
        timeout=20.0,
        check=True,
    )
    clock.close()
    passed_s = (int(done.stdout) - (START_NS - 10 * 10**9)) * 1e-9
    least = 0.05 if kind == "woken" else 0.2
    assert least - 1e-6 <= passed_s < (31.0 if kind == "woken" else 1.5)
    assert time.monotonic() - began < 10.0
