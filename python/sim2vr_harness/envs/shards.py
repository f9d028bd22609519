"""Users divided among worker processes, which play their shares at the same time.

Actions, results and observations lie in memory that all of them share. In a step, every worker is
woken by one message and answers by one, in which nothing is pickled unless an episode has ended.
Workers are forks of one process, which loads packages and the body for all of them.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import os
import pickle
import re
import signal
import socket
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.signals import interrupts_deferred
from sim2vr_harness.client import AppProcess, OptionValue, load_game_library
from sim2vr_harness.client.games import loaded_game_libraries
from sim2vr_harness.client.in_process import LogRows
from sim2vr_harness.client.process import end_words
from sim2vr_harness.client.temporary import FOLDER_VARIABLE
from sim2vr_harness.envs.app_group import AppFailure
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Observation, Simulation, StepBatch
from sim2vr_harness.perception import SENSES
from sim2vr_harness.users.batch import checked_action

_RESULTS = ("reward", "terminated", "truncated", "game_reward", "effort_cost", "answered")
"""Fields of `StepBatch` that are shared."""
_STEP = b"one step"  # of eight bytes, so that the numbers behind it are aligned
_CLOSE = b"close"
_ALIGNED = 64
_GRACE_S, _PR_SET_PDEATHSIG = 5.0, 1


def make_simulation(
    env: EnvConfig | ResolvedEnv, n: int, *, log_dir: Path | None = None
) -> Simulation:
    """Return N users in their apps, divided among processes as ``env.shards`` says.

    Args:
        log_dir: root of the apps' episode logs, for which one process plays all users; or None.
    """
    resolved = ResolvedEnv.of(env)
    config = resolved.config
    few = min(budget(config.cores) // 4, n // 8)
    count = few if config.shards == "auto" else min(config.shards, n)
    if count > 1 and log_dir is None and config.app.connect is None:
        return ShardedSimulation(resolved, n, count)
    return Simulation(resolved, n, log_dir=log_dir)


@contextmanager
def in_this_process(simulation: Any) -> Iterator[Any]:
    """Give a simulation whose bodies and apps can be read: this one, or another of as many users.

    Either is to be reset before the next step.
    """
    if not isinstance(simulation, ShardedSimulation):
        yield simulation
        return
    with closing(Simulation(simulation.resolved, simulation.n)) as other:
        yield other


class ShardedSimulation(Simulation):
    """N users divided among processes, with the bits of a simulation in one.

    Bodies and apps are out of reach; where they are needed, ``env.shards`` has to be 1. The end of
    a worker ends the simulation, and the end of this process ends the workers.

    Args:
        config: user, app and perception.
        n: number of users N.
        shards: number of processes, at most N.

    Raises:
        ValueError: a setting that cannot be used; names it, what was got and what was expected.
        RuntimeError: an app or its renderer cannot be started.
    """

    def __init__(self, config: EnvConfig | ResolvedEnv, n: int, shards: int) -> None:
        self._process: AppProcess | None = None
        self._shards = shards
        # Of each worker: its pipe, its users, and the logs of their games.
        self._pipes: list[Connection] = []
        self._users: list[slice] = []
        self._logs: list[LogRows] = []
        super().__init__(config, n)

    def _open(self, log_dir: Path | None) -> None:
        n, shards = self.n, self._shards
        memory = os.memfd_create("sim2vr-shards")
        space = self.observation_space = self.resolved.observation_space
        self._shared = _shared_arrays(n, self.action_space.shape[0], space, memory)
        cores, rest = divmod(budget(self.config.cores), shards)
        bounds = np.linspace(0, n, shards + 1).astype(int).tolist()
        pairs = [socket.socketpair() for _ in range(shards)]
        shares = []
        for k, (ours, _) in enumerate(pairs):
            app, own = self.config.app, max(1, cores + (k < rest))
            if app.processes:
                app = app.model_copy(update={"processes": max(1, app.processes // shards)})
            shares.append((slice(bounds[k], bounds[k + 1]), {"app": app, "cores": own}))
            self._pipes.append(Connection(ours.detach()))
            self._users.append(shares[k][0])
            self._logs.append(LogRows([], np.zeros((bounds[k + 1] - bounds[k], 0))))
        inherited = (memory, *(theirs.fileno() for _, theirs in pairs))
        code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; "
        try:
            self._process = AppProcess(
                [sys.executable, "-c", f"{code}serve{inherited}"], inherited=inherited
            )
            for _, theirs in pairs:
                theirs.close()
            self._call({0: (self.resolved, n, shares, loaded_game_libraries())})
            self._call(dict.fromkeys(range(1, shards)))
        except BaseException:
            self.close()
            raise
        finally:
            os.close(memory)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"{name}: the users' bodies and apps are in other processes, expected env.shards=1"
        )

    # --- what all simulations do ---------------------------------------------------------------

    def _reset(
        self,
        rows: Sequence[int],
        seeds: Sequence[int | None],
        options: Mapping[str, OptionValue],
        postures: Sequence[NDArray[np.float64] | None] | None,
        persons: Sequence[int | None] | None,
    ) -> list[dict[str, Any]]:
        calls, places = {}, {}
        for k, users in enumerate(self._users):
            places[k] = own = [j for j, i in enumerate(rows) if users.start <= i < users.stop]
            given = [
                None if each is None else [each[j] for j in own]
                for each in (seeds, postures, persons)
            ]
            if own:
                ids = [rows[j] - users.start for j in own]
                calls[k] = ("reset", (ids, given[0], options, *given[1:]))
        found = self._call(calls)
        infos = {j: info for k in found for j, info in zip(places[k], found[k], strict=True)}
        return [infos[j] for j in range(len(rows))]

    def _step(self, actions: ArrayLike, active: NDArray[np.bool_]) -> StepBatch:
        shared = self._shared
        shared["actions"][...] = checked_action(actions, self.n, self.actions.names)
        shared["active"][...] = active
        ends: dict[int, dict[str, Any]] = {}
        for k, found in self._call(dict.fromkeys(range(self._shards), _STEP)).items():
            if found:
                ends |= {i + self._users[k].start: end for i, end in found.items()}
        results = {name: shared[name].copy() for name in _RESULTS}
        return StepBatch(**results, logs=self.logs, ends=ends)

    def observation(self) -> Observation:
        # In the order of the senses, which a space does not keep.
        names = [sense.name or SENSES[sense.sense].key for sense in self.config.senses]
        return {name: self._shared[f"sees {name}"].copy() for name in names}

    @property
    def logs(self) -> LogRows:
        """The games' named numbers now."""
        found = self._logs
        if all(log.names == found[0].names for log in found):
            return LogRows(found[0].names, np.concatenate([log.rows for log in found]))
        return LogRows.of([log[i] for log in found for i in range(len(log.rows))])

    def user_states(self) -> list[bytes]:
        return [state for found in self._call_all("user_states") for state in found]

    def load_user_states(self, states: Sequence[bytes]) -> list[int]:
        calls = {k: ("load_user_states", (states[users],)) for k, users in enumerate(self._users)}
        return [i + self._users[k].start for k, anew in self._call(calls).items() for i in anew]

    @property
    def exact_states(self) -> bool:
        """Return whether :meth:`state_dict` includes the episodes."""
        return all(self._call_all("exact_states"))

    @property
    def app_failures(self) -> list[AppFailure]:
        """Every app that failed so far, shard by shard, the oldest first."""
        return [
            replace(failure, user=failure.user + users.start)
            for users, found in zip(self._users, self._call_all("app_failures"), strict=True)
            for failure in found
        ]

    @property
    def renderer_description(self) -> str:
        """The GL renderer that draws the headset images."""
        return str(self._call({0: ("renderer_description", ())})[0])

    @property
    def begun(self) -> bool:
        return all(self._call_all("begun"))

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"shards": self._shards}

    def __setstate__(self, made: dict[str, Any]) -> None:
        self.__init__(made["config"], made["n"], made["shards"])  # type: ignore[misc]
        if made["state"] is not None:
            self.load_state_dict(made["state"])

    def close(self) -> None:
        self._closed = True
        for pipe in self._pipes:
            with suppress(OSError):  # closed, here or there
                pipe.send_bytes(_CLOSE)
            pipe.close()
        if self._process is not None:
            self._process.stop(_GRACE_S)

    # --- conversation ----------------------------------------------------------------------------

    def _call_all(self, name: str) -> list[Any]:
        """Return what a method or an attribute of every worker's simulation gives."""
        return list(self._call({k: (name, ()) for k in range(self._shards)}).values())

    def _call(self, calls: Mapping[int, Any]) -> dict[int, Any]:
        """Let workers do something at the same time; return their answers.

        Args:
            calls: worker -> name and arguments, :data:`_STEP`, or None to wait for its start.

        Raises:
            RuntimeError: a worker has ended.
            Exception: the first error of a worker, after all have answered.
        """
        answers: dict[int, Any] = {}
        errors = []
        try:
            with interrupts_deferred():
                for k, call in calls.items():
                    if call is not None:
                        self._pipes[k].send_bytes(call if call is _STEP else pickle.dumps(call))
                for k in calls:
                    given, log, error = self._pipes[k].recv_bytes(), self._logs[k], None
                    if given.startswith(_STEP):
                        answers[k], names = None, log.names
                        rows = np.frombuffer(given, np.float64, offset=len(_STEP))
                    else:
                        answers[k], error, names, rows = pickle.loads(given)
                    self._logs[k] = LogRows(names, rows.reshape(len(log.rows), len(names)))
                    errors += [] if error is None else [error]
        except (EOFError, OSError):
            process = self._process
            assert process is not None
            process.wait(_GRACE_S)
            tail = process.log_tail(3) or f"process {process.pid} {end_words(process.exit_status)}"
            self.close()
            raise RuntimeError(f"env.shards: {tail}; the simulation is closed") from None
        self._over[...] = self._shared["over"]
        if errors:
            raise errors[0]
        return answers


def _shared_arrays(n: int, actions: int, space: Any, file: int) -> dict[str, NDArray[Any]]:
    """Return arrays of N users in a file without a name, which vanishes with the last process.

    Args:
        n: number of users N.
        actions: number of actions.
        space: observation space of a user.
        file: its descriptor.
    """
    flags = ("active", "over", "terminated", "truncated", "answered")
    fields: dict[str, tuple[tuple[int, ...], DTypeLike]] = {
        "actions": ((n, actions), np.float64),
        **dict.fromkeys(("reward", "game_reward", "effort_cost"), ((n,), np.float64)),
        **dict.fromkeys(flags, ((n,), bool)),
        **{f"sees {name}": ((n, *box.shape), box.dtype) for name, box in space.items()},
    }
    sizes = [int(np.prod(shape)) * np.dtype(dtype).itemsize for shape, dtype in fields.values()]
    ends = np.cumsum([-(-size // _ALIGNED) * _ALIGNED for size in sizes]).tolist()
    os.ftruncate(file, ends[-1])
    memory = mmap.mmap(file, ends[-1])
    return {
        name: np.ndarray(shape, dtype, memory, place)
        for (name, (shape, dtype)), place in zip(fields.items(), [0, *ends], strict=False)
    }


# --- in a worker ------------------------------------------------------------------------------


def serve(memory: int, *descriptors: int) -> None:
    """Fork a worker for each pipe; end with a line about the first that does not end well."""
    # Its apps and their watcher are a worker's own, and end by themselves after it.
    os.environ.pop(FOLDER_VARIABLE, None)
    pipes = [Connection(descriptor) for descriptor in descriptors]
    resolved, n, shares, libraries = pipes[0].recv()
    for file in libraries:
        load_game_library(file)
    _ = resolved.body
    gc.freeze()
    playing = {}
    for pipe, (users, settings) in zip(pipes, shares, strict=True):
        if (pid := os.fork()) == 0:
            try:
                ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
                for other in pipes:
                    if other is not pipe:
                        other.close()
                _play(memory, pipe, resolved.changed(**settings), n, users)
            except BaseException:
                traceback.print_exc()
            os._exit(1)  # without the clean-up of the process that it was forked from
        playing[pid] = f"process {pid} (users {users.start} to {users.stop - 1})"
    for pipe in pipes:
        pipe.close()
    for _ in pipes:
        pid, status = os.wait()
        if status:
            ended = end_words(os.waitstatus_to_exitcode(status))
            sys.stderr.write(f"{playing[pid]} {ended}\n")
            os._exit(1)
    os._exit(0)


def _play(memory: int, pipe: Connection, config: ResolvedEnv, n: int, users: slice) -> None:
    """Play a share of ``n`` users until the other side closes the connection."""
    try:
        simulation = Simulation(config, users.stop - users.start)
    except Exception as error:
        pipe.send((None, _sendable(error, users), [], np.zeros((users.stop - users.start, 0))))
        os._exit(0)
    size = simulation.action_space.shape[0]
    shared = _shared_arrays(n, size, simulation.observation_space, memory)
    names: Sequence[str] | None = None
    call: Any = pickle.dumps(("exact_states", ()))
    with suppress(EOFError, OSError):
        while call != _CLOSE:
            value: Any = None
            failure: Exception | None = None
            try:
                if call == _STEP:
                    resting = np.flatnonzero(~shared["active"][users])
                    batch = simulation.step(shared["actions"][users], resting)
                    for name in _RESULTS:
                        shared[name][users] = getattr(batch, name)
                    value = batch.ends or None
                else:
                    name, arguments = pickle.loads(call)
                    found = getattr(simulation, name)
                    value = found(*arguments) if callable(found) else found
            except Exception as error:
                failure = _sendable(error, users)
            for name, rows in simulation.observation().items():
                shared[f"sees {name}"][users] = rows
            shared["over"][users] = simulation.over
            logs = simulation.logs
            if value is None and failure is None and logs.names == names:
                pipe.send_bytes(_STEP + logs.rows.tobytes())
            else:
                names = logs.names
                pipe.send((value, failure, names, logs.rows))
            call = pipe.recv_bytes()
    simulation.close()
    os._exit(0)  # threads of renderers are not waited for


def _sendable(error: Exception, users: slice) -> Exception:
    """Return an error with its user's number among all, as words where it cannot be pickled."""
    words = re.sub(r"^(user|app) (\d+)", lambda m: f"{m[1]} {int(m[2]) + users.start}", str(error))
    try:
        if words != str(error):
            error = type(error)(words)
        pickle.loads(pickle.dumps(error))
    except Exception:
        return ValueError(words) if isinstance(error, ValueError) else RuntimeError(words)
    return error
