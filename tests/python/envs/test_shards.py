"""Users divided among processes: the same bits, and nothing left of processes that were killed."""

import copy
import os
import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from processes import until
from sim2vr_harness.envs import AppConfig, EnvConfig, Sim2VRVectorEnv, Simulation, UserConfig
from sim2vr_harness.envs.shards import ShardedSimulation, in_this_process, make_simulation

N = 5
APPS: dict[str, dict[str, Any]] = {
    "in process": {},
    "protocol 1": {"transport": "protocol1"},
    "protocol 2": {"transport": "protocol2", "processes": 4},
}


def config(transport: str = "in process", **settings: Any) -> EnvConfig:
    options = {"condition": "medium", "round_seconds": 0.8}
    return EnvConfig(app=AppConfig(options=options, **APPS[transport]), cores=4, **settings)


def actions(step: int) -> np.ndarray:
    return np.random.default_rng(step).uniform(-1.0, 1.0, (N, 32))


def played(users: Simulation, steps: range) -> list[Any]:
    """All that comes back from users who begin rounds anew, in another order than their own."""
    rows: list[Any] = []
    for step in steps:
        result = users.step(actions(step))
        rows += [result.reward.tobytes(), result.infos, result.logs.total("Contacts")]
        rows += [(name, values.tobytes()) for name, values in users.observation().items()]
        if ended := np.flatnonzero(result.over).tolist():
            rows.append(users.reset(ids=ended[::-1]))
    return [*rows, users.state_dict()["simulation"].tobytes()]


def descendants(pid: int) -> list[int]:
    """Processes that a process has started, and those that these have started."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rpartition(") ")[2].split()
        except OSError:
            continue
        if fields[0] != "Z":
            parents[int(entry.parent.name)] = int(fields[1])
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]


def running(pids: list[int]) -> list[int]:
    return [pid for pid in pids if Path(f"/proc/{pid}/exe").exists()]


PEOPLE = UserConfig(people={"left_handed": 0.5})
SETTINGS = [
    *((name, 2, {"frames_per_step": 5}) for name in APPS),
    ("in process", 4, {"user": PEOPLE}),
]


@pytest.mark.parametrize(("transport", "shards", "settings"), SETTINGS)
def test_users_play_the_same_in_any_number_of_processes(
    transport: str, shards: int, settings: dict[str, Any]
) -> None:
    given = config(transport, **settings)
    with (
        closing(Simulation(given, N)) as alone,
        closing(ShardedSimulation(given, N, shards)) as divided,
    ):
        starts = [users.reset(seeds=list(range(N))) for users in (alone, divided)]
        assert starts[0] == starts[1]
        assert played(alone, range(20)) == played(divided, range(20))
        for users in (alone, divided):
            with pytest.raises(ValueError, match="got 'x', expected"):
                users.reset(options={"condition": "x"})
        saved = divided.state_dict()
        expected = played(divided, range(20, 30))
        assert alone.load_state_dict(saved) == []
        assert played(alone, range(20, 30)) == expected
        assert divided.load_state_dict(saved) == []
        with closing(copy.deepcopy(divided)) as copied:
            assert played(copied, range(20, 30)) == expected


def test_an_app_that_fails_ends_the_round_of_its_user() -> None:
    with closing(ShardedSimulation(config("protocol 1"), N, 2)) as users:
        users.reset(seeds=list(range(N)))
        apps = [pid for pid in descendants(os.getpid()) if "sim2vr-app" in name_of(pid)]
        assert len(apps) == N
        os.kill(apps[-1], signal.SIGKILL)
        result = users.step(actions(0))
        (failed,) = np.flatnonzero(result.truncated).tolist()
        assert str(apps[-1]) in result.infos[failed]["app_error"]
        assert [failure.user for failure in users.app_failures] == [failed]
        assert users.renew(result) == [failed]
        assert not users.step(actions(1)).over.any()


def name_of(pid: int) -> str:
    return Path(f"/proc/{pid}/comm").read_text()


def test_the_end_of_a_worker_ends_the_simulation() -> None:
    before = descendants(os.getpid())
    users = ShardedSimulation(config("protocol 2"), N, 2)
    users.reset()
    started = [pid for pid in descendants(os.getpid()) if pid not in before]
    *_, worker = (pid for pid in started if name_of(pid).startswith("python"))
    os.kill(worker, signal.SIGKILL)
    words = rf"process {worker} \(users 2 to 4\) was killed \(SIGKILL\)"
    with pytest.raises(RuntimeError, match=words):
        users.step(actions(0))
    assert until(lambda: not running(started), 10.0)
    with pytest.raises(RuntimeError, match="closed"):
        users.reset()


_PLAY = """
from sim2vr_harness.envs import AppConfig, EnvConfig
from sim2vr_harness.envs.shards import ShardedSimulation
users = ShardedSimulation(EnvConfig(app=AppConfig(transport="protocol2", renderer="null")), 2, 2)
users.reset()
print(flush=True)
while True:
    users.renew(users.step([users.resting_action] * 2))
"""


def test_workers_and_their_apps_end_with_the_process_that_they_play_for(tmp_path: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", _PLAY]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as program:
        assert program.stdout is not None
        program.stdout.readline()
        started = descendants(program.pid)
        program.kill()
    assert len(started) >= 4
    assert until(lambda: not running(started), 10.0)
    assert until(lambda: not list(tmp_path.glob("sim2vr-[0-9]*")), 10.0)


def test_processes_by_cores_and_users() -> None:
    null = AppConfig(renderer="null")
    for cores, n, shards in ((8, 15, "auto"), (7, 16, "auto"), (8, 16, 1), (8, 1, 4)):
        with closing(make_simulation(EnvConfig(app=null, cores=cores, shards=shards), n)) as users:
            assert type(users) is Simulation
    with closing(Sim2VRVectorEnv(16, config=EnvConfig(app=null, cores=8))) as vector:
        vector.reset(seed=1)
        with pytest.raises(AttributeError, match=r"apps: .* expected env.shards=1"):
            _ = vector.simulation.apps
        with in_this_process(vector.simulation) as near:
            assert len(near.apps) == 16
