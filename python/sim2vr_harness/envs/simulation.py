"""N simulated users in N apps, in lockstep: the one code path behind every environment."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.errors import reason
from sim2vr_harness.client import AppClient, DevicePoses, OptionValue, frame_times_ns
from sim2vr_harness.client.devices import input_named
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.client.in_process import LogRows
from sim2vr_harness.envs.actions import Actions, gaze_slopes
from sim2vr_harness.envs.app_group import AppFailure, AppGroup, MirroredGroup, app_group
from sim2vr_harness.envs.apps import AppFactory
from sim2vr_harness.envs.checks import (
    checked_options,
    checked_seeds,
    checked_substeps,
    checked_users,
    chosen_persons,
)
from sim2vr_harness.envs.config import EnvConfig, motor_noise
from sim2vr_harness.envs.late_hands import LateHands, app_options
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.senses import Senses, make_actions, make_perception
from sim2vr_harness.perception import Delayed, Proprioception, Sense
from sim2vr_harness.users import Body
from sim2vr_harness.users.actuation import Actuation
from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.bodies import DEVICES

_FORMAT = "sim2vr simulation state 5"


def packed(users: Sequence[bytes]) -> dict[str, NDArray[np.uint8]]:
    """Return the state of users, bytes each, as one array of bytes."""
    state = pickle.dumps({"format": _FORMAT, "users": list(users)})
    return {"simulation": np.frombuffer(state, np.uint8)}


def unpacked(state: Mapping[str, ArrayLike], n: int) -> list[bytes]:
    """The users' bytes again.

    Raises:
        ValueError: the state is of something else, damaged, or of another number of users.
    """
    saved = _plain(np.asarray(state["simulation"]).tobytes())
    if not isinstance(saved, dict) or saved.get("format") != _FORMAT:
        raise ValueError(f"state: got other bytes, expected a '{_FORMAT}'")
    if len(saved["users"]) != n:
        raise ValueError(f"state: got one of {len(saved['users'])} users, expected {n}")
    return list(saved["users"])


def _plain(state: bytes) -> Any:
    """Return arrays and plain values that were pickled.

    Raises:
        ValueError: the bytes are of something else, or damaged.
    """
    try:
        return _PlainUnpickler(io.BytesIO(state)).load()
    except ValueError:
        raise
    except Exception as error:  # a damaged pickle raises anything
        got = f"damaged bytes ({reason(error)})"
        raise ValueError(f"state: got {got}, expected a '{_FORMAT}'") from error


class _PlainUnpickler(pickle.Unpickler):
    """Reads arrays and plain values only, so that a state file cannot run code."""

    _ALLOWED = frozenset(
        {
            ("numpy", "ndarray"),
            ("numpy", "dtype"),
            ("numpy._core.multiarray", "_reconstruct"),
            ("numpy._core.multiarray", "scalar"),
            ("numpy._core.numeric", "_frombuffer"),
        }
    )

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self._ALLOWED:
            raise ValueError(f"state: got an object of type {module}.{name}, expected plain data")
        return super().find_class(module, name)


@dataclass
class StepBatch:
    """Results of one user step for each of N users.

    Attributes:
        reward: (N,) float64, the game's reward minus the effort cost.
        terminated: (N,) bool, the game is over or the simulation diverged.
        truncated: (N,) bool, ``max_episode_seconds`` are over, or the app failed.
        game_reward: (N,) float64, 0 if the app received no request or did not answer.
        effort_cost: (N,) float64.
        answered: (N,) bool, True if the app played the step: False for a user whose simulation
            diverged or whose app failed.
        logs: the games' named numbers, ``logs[i]`` of user i.
        ends: users whose episode ended here -> ``termination`` (``finished``, ``diverged``,
            ``max_steps_reached``, ``app_left`` or ``app_failed``) and ``max_fatigued``; after
            ``app_left`` also ``app_left``, how the app ended its session by itself; after
            ``app_failed`` also ``app_error``, what happened; if MuJoCo warned in the episode,
            ``warnings``, the number of warnings by kind (see :attr:`UserBatch.warnings`).
    """

    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    game_reward: NDArray[np.float64]
    effort_cost: NDArray[np.float64]
    answered: NDArray[np.bool_]
    logs: LogRows
    ends: dict[int, dict[str, Any]] = field(default_factory=dict)

    @property
    def over(self) -> NDArray[np.bool_]:
        """(N,) True if the episode ended in this step, for any reason."""
        return self.terminated | self.truncated

    def info(self, i: int) -> dict[str, Any]:
        """User i's part of the step as a dictionary.

        Returns:
            ``game_reward``, ``effort_cost``, ``log`` if the app answered, and the user's entries of
            :attr:`ends`.
        """
        info: dict[str, Any] = {
            "game_reward": float(self.game_reward[i]),
            "effort_cost": float(self.effort_cost[i]),
        }
        if self.answered[i]:
            info["log"] = self.logs[i]
        return info | self.ends.get(i, {})

    @cached_property
    def infos(self) -> list[dict[str, Any]]:
        """:meth:`info` of all users; made when first requested."""
        return [self.info(i) for i in range(len(self.reward))]


Observation = dict[str, NDArray[Any]]
IntArray = NDArray[np.int64]


class Simulation:
    """N users playing in N apps, without automatic reset.

    One user step: muscle control -> MuJoCo substeps -> device poses at the end of the step -> one
    app frame (collisions, game, reward, image) -> effort subtracted -> observation. With
    ``frames_per_step`` K the app gets the poses of K moments, evenly spread over the step, in one
    exchange, runs a frame for each and draws the last, or the one that a delayed sight asks for.
    An episode depends on its seed and actions only, not on N, the position in the batch or the
    threads.

    Simulations can be pickled and copied, by way of :meth:`state_dict`: the copy goes on in apps
    of its own, as exactly as these save their rounds. It writes no episode logs.

    An app outside this process may fail. Its user's episode is truncated there (``app_failed``),
    the others go on, and the user's next reset starts another app.

    Args:
        config: user, app and perception.
        log_dir: root of the apps' episode logs, or None.
        make_app: how to get the app of each user; None goes by ``config.app.transport``.

    Raises:
        ValueError: a setting that cannot be used; names it, what was got and what was expected.
        RuntimeError: the app or its renderer cannot be started.
    """

    observation_space: spaces.Dict

    def __init__(
        self,
        config: EnvConfig | ResolvedEnv,
        n: int = 1,
        *,
        log_dir: Path | None = None,
        make_app: AppFactory | None = None,
    ) -> None:
        self.n, self._make_app, self._closed = n, make_app, False
        self.resolved = ResolvedEnv.of(config)
        self.body: Body = self.resolved.body
        self._hand_option: str | None = None
        if make_app is None:
            self.resolved = self.resolved.with_hand()
            self._hand_option = self.resolved.facts.hand_option
        self.config = self.resolved.config
        self.people = self.resolved.people
        """The population that users are drawn from; None: all are average."""
        self.proprioception = Proprioception(self.body)
        self.actions = make_actions(self.config, n, self.body)
        self.action_space = self.actions.space
        seconds = self.config.max_episode_seconds
        self.max_steps = max(1, round(seconds * self.config.action_frequency_hz))
        self._over = np.ones(n, dtype=bool)
        self._open(log_dir)

    def _open(self, log_dir: Path | None) -> None:
        """Make bodies, apps and senses."""
        config, user, n = self.config, self.config.user, self.n
        substeps = checked_substeps(config, self.body.timestep)
        self.users = UserBatch(
            self.body,
            n,
            threads=budget(config.cores),
            effort=user.effort.model,
            effort_params=user.effort.options(),
            noise=motor_noise(user.noise),
            substeps=substeps,
            people=self.people,
            cut=self.resolved.body_for,
            head=user.head,
        )
        perception = make_perception(
            config, n, self.proprioception, substeps, len(self.actions.names), self.users.who
        )
        self.observation_space = perception.space
        self._group = app_group(config, n, log_dir, self._make_app, self.body.ipd_m)
        self._mirrored = self._both_hands(self._group)
        self._group = self._mirrored or self._group
        try:
            if config.user.inputs:
                for app in self.apps:
                    app.require("inputs")
            self._senses = Senses(perception, self.users, self._group, self.actions)
            self._apps = AppSteps(config, self.users, self._group, self.actions, self.max_steps)
        except BaseException:
            self._group.close()
            raise
        if self._apps.late_hands.frames:
            self.watch(self._apps.late_hands)
        self._seeds = [np.random.default_rng() for _ in range(n)]
        self._steps = np.zeros(n, dtype=np.int64)

    @cached_property
    def resting_action(self) -> NDArray[np.float32]:
        """Action of the idle baseline, (A,), read-only: muscles relax, fingers press no input."""
        body, names = Actuation(self.body).rest, self.config.user.inputs
        action = np.zeros(self.action_space.shape[0], np.float32)
        action[: len(body)] = body
        for k, name in enumerate(names, start=len(body)):
            if input_named(name).low == 0.0:
                action[k] = -1.0
        action.flags.writeable = False
        return action

    @property
    def over(self) -> NDArray[np.bool_]:
        """(N,) True if the episode has ended, or never began."""
        return self._over.copy()

    def reset(
        self,
        ids: Sequence[int] | None = None,
        seeds: Sequence[int | None] | None = None,
        options: Mapping[str, OptionValue] | None = None,
        postures: Sequence[NDArray[np.float64] | None] | None = None,
        persons: Sequence[int | None] | None = None,
    ) -> list[dict[str, Any]]:
        """Start new episodes.

        Args:
            ids: (K,) users to reset; None for all.
            seeds: K seeds that restart the users' streams of episodes; None: the streams continue.
            options: game options for these users from this round on.
            postures: K postures to start in (see `UserBatch.reset`); None: all are sampled.
            persons: K persons of the population (`Population.number`); None: sampled by the seed.

        Returns:
            K dictionaries: ``seed`` of the app's round, ``log``, ``person`` if users are people.

        Raises:
            ValueError: an option, a seed or a user that does not exist; rounds are unchanged.
            RuntimeError: the simulation is closed.
        """
        self._require_open()
        rows = checked_users("ids", ids, self.n)
        given = checked_seeds(seeds, len(rows))
        for name, each in (("postures", postures), ("persons", persons)):
            if each is not None and len(each) != len(rows):
                raise ValueError(f"{name}: got {len(each)}, expected {len(rows)}, one per user")
        options = app_options(checked_options(options))
        if not rows:
            return []
        if self._hand_option in options:
            self.resolved.require_worn(str(options[self._hand_option]))
        return self._reset(rows, given, options, postures, persons)

    def step(self, actions: ArrayLike, resting: Sequence[int] | IntArray = ()) -> StepBatch:
        """Advance every user and app by one user step.

        Args:
            actions: (N, A) in [-1, 1]: those of the body (of muscles, changes of activation), then
                those of fingers and eyes, if the user has any (:class:`Actions`).
            resting: users whose episodes are over and who skip this step: their apps, senses and
                counts do not change, and their reward is 0.

        Raises:
            ValueError: actions of another shape or not finite.
            RuntimeError: a user's episode is over (reset it first), or the simulation is closed.
        """
        self._require_open()
        # (N,) users that take a step; the episodes of the others have to be over.
        active = np.ones(self.n, dtype=bool)
        if len(resting):
            active[checked_users("resting", resting, self.n)] = False
        if (self._over == active).any():
            over = np.flatnonzero(self._over & active).tolist()
            if over:
                raise RuntimeError(f"step: the episodes of users {over} are over; reset them first")
            wrong = np.flatnonzero(~self._over & ~active).tolist()
            raise ValueError(f"resting: got users {wrong}, expected only ones that are over")
        return self._step(actions, active)

    def renew(self, outcome: StepBatch) -> list[int]:
        """Start new episodes for users without one after a step; returns which."""
        ended = np.flatnonzero(outcome.over).tolist()
        if ended:
            self.reset(ids=ended)
        return ended

    def state_dict(self) -> dict[str, NDArray[np.uint8]]:
        """Everything the future depends on, mid-episode included: random streams, bodies, apps.

        Returns:
            ``simulation``: one array of bytes, since an app's own part is bytes.

        Raises:
            RuntimeError: some user was never reset, or the simulation is closed.
        """
        self._require_open()
        return packed(self.user_states())

    def load_state_dict(self, state: Mapping[str, ArrayLike]) -> list[int]:
        """Continue from :meth:`state_dict` of a simulation with the same configuration and N.

        Returns:
            The users whose apps could not save their rounds; they have started new ones.

        Raises:
            ValueError: the state is of something else or of another number of users.
            RuntimeError: an app rejects its part, or the simulation is closed.
        """
        self._require_open()
        return self.load_user_states(unpacked(state, self.n))

    def __getstate__(self) -> dict[str, Any]:
        """Return the configuration, and the state if rounds have begun, for pickle and copy."""
        return {
            "config": self.resolved,
            "n": self.n,
            "make_app": self._make_app,
            "state": self.state_dict() if self.begun else None,
        }

    def __setstate__(self, made: dict[str, Any]) -> None:
        """Make the simulation again, with apps of its own, and continue from the state."""
        self.__init__(made["config"], made["n"], make_app=made["make_app"])  # type: ignore[misc]
        if made["state"] is not None:
            self.load_state_dict(made["state"])

    def _require_open(self) -> None:
        if self._closed:
            raise RuntimeError("the simulation is closed; make a new one")

    @property
    def apps(self) -> list[AppClient]:
        """The app of each user."""
        return self._group.apps

    @property
    def app_failures(self) -> list[AppFailure]:
        """Every app that failed so far, the oldest first."""
        return self._group.failures

    @property
    def renderer_description(self) -> str:
        """The GL renderer that draws the headset images."""
        return self.apps[0].renderer_description

    def watch(self, sense: Sense) -> None:
        """Add a sense that records the users, from the next reset on.

        Args:
            sense: see :meth:`Perception.watch`; a saved state holds its past, too.
        """
        self._senses.perception.watch(sense)

    @property
    def late_pictures(self) -> Delayed | None:
        return self._senses.perception.late_pictures

    # --- episodes ----------------------------------------------------------------------------

    def _reset(
        self,
        rows: Sequence[int],
        seeds: Sequence[int | None],
        options: Mapping[str, OptionValue],
        postures: Sequence[NDArray[np.float64] | None] | None,
        persons: Sequence[int | None] | None,
    ) -> list[dict[str, Any]]:
        streams = [
            copy.deepcopy(self._seeds[i]) if seed is None else np.random.default_rng(seed)
            for i, seed in zip(rows, seeds, strict=True)
        ]
        round_seeds = [int(stream.integers(2**32)) for stream in streams]
        users, numbers = (np.array(each, dtype=np.int64) for each in (rows, round_seeds))
        chosen = chosen_persons(self.people, round_seeds, persons)
        # Asked first: an option that the game refuses leaves everything as it was.
        requests = self._group.head_requests(users, numbers, options)
        self.users.reset(rows, streams, postures, chosen)
        for i, stream in zip(rows, streams, strict=True):
            self._seeds[i] = stream
        # Turn heads as the game requests (degrees), and let left-handers play mirrored.
        if not np.isnan(requests).all():
            self.users.turn_head(users, requests)  # type: ignore[arg-type]
        if self._mirrored is not None:
            self._mirrored.mirror(users, self._left_handers()[users])
        self.actions.reset(users)
        self._apps.look(users)
        self._group.reset(users, numbers, self._apps.poses(users, -1), options)
        self._steps[users] = 0
        self._over[users] = False
        self._senses.reset(users, numbers)
        logs, started = self._group.logs(), zip(rows, round_seeds, strict=True)
        return [{"seed": seed, "log": logs[i], **self._who(i)} for i, seed in started]

    def _both_hands(self, group: AppGroup) -> MirroredGroup | None:
        """Return apps for both hands; None: all users play with the same one.

        Raises:
            ValueError: the game is played with one hand only.
        """
        people, option = self.people, self._hand_option
        if people is None or not people.settings.left_handed:
            return None
        if self.config.vision.fovea is not None:
            group.close()
            raise ValueError(
                f"people.left_handed: got {people.settings.left_handed:g} with vision.fovea, "
                "expected 0: gazes are not mirrored"
            )
        if option is None:
            group.close()
            raise ValueError(
                f"people.left_handed: got {people.settings.left_handed:g} with the game "
                f"{self.config.app.game!r}, expected 0: it has no option for the hand that plays"
            )
        hand = str(self.config.app.options.get(option, "right"))
        return MirroredGroup(group, self.n, option, hand, self.config.vision.eyes)

    def _left_handers(self) -> NDArray[np.bool_]:
        """(N,) True if the user plays with another hand than the users' body."""
        assert self.people is not None
        own = self.people.alike.handedness
        return np.array([person.handedness != own for person in self.users.persons])

    def _who(self, i: int) -> dict[str, Any]:
        """User i's person for an info dictionary, where users are people."""
        return {} if self.people is None else {"person": self.users.persons[i].as_dict()}

    @property
    def person_features(self) -> NDArray[np.float32]:
        """(N, F) `Person.features` of the users as they are now."""
        return self.users.person_features

    @property
    def logs(self) -> LogRows:
        """The games' named numbers now."""
        return self._group.logs()

    def observation(self) -> Observation:
        """The present observation of all users: fresh arrays, first axis N.

        An entry per sense of ``config.senses``; by default ``vision`` (N, C, H, W) uint8,
        ``proprioception`` (N, P) float32, ``stateful_information`` (N, 1) float32 (the game's
        time feature).
        """
        return self._senses.perception.observe()

    def _step(self, actions: ArrayLike, active: NDArray[np.bool_]) -> StepBatch:
        body = self.actions.take(actions)
        pauses, drawn = self._senses.pauses, self._senses.perception.drawn_frame
        with self._apps.step(active, self._steps + active, drawn, whole=bool(pauses)) as apps:
            self.users.step(
                body,
                pose_samples=self.config.frames_per_step,
                pauses=pauses,
                shares=apps.shares,
                moved=apps.moved,
            )
            self.actions.remember(actions)
            diverged = self.users.diverged & active
            asked = active & ~diverged
            weight = self.config.user.effort.finger_effort
            finger_cost = weight * self.actions.finger_use() if weight else 0.0
            cost = np.where(asked, self.users.effort_cost + finger_cost, 0.0)
            self._steps += active
            # A diverged user's app stays where it was, as does its last finite observation.
            users = apps.answered()
        answered = np.zeros(self.n, dtype=bool)
        answered[users] = True
        game_reward = np.where(answered, self._group.reward, 0.0).astype(np.float64)
        terminated = diverged | (answered & (self._group.finished != 0))
        late = self._steps >= self.max_steps
        late[list(self._group.failed)] = True
        truncated = active & ~terminated & late
        ended = terminated | truncated
        self._over = ended | ~active
        self._senses.take(users)
        return StepBatch(
            game_reward - cost,
            terminated,
            truncated,
            game_reward,
            cost,
            answered,
            self._group.logs(),
            self._ends(ended, terminated, diverged),
        )

    def _ends(
        self,
        ended: NDArray[np.bool_],
        terminated: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
    ) -> dict[int, dict[str, Any]]:
        ends: dict[int, dict[str, Any]] = {}
        if not ended.any():
            return ends
        fatigued = self.users.effort.max_fatigued()
        warnings = {name: counts for name, counts in self.users.warnings.items() if counts.any()}
        for i in np.flatnonzero(ended).tolist():
            end = "diverged" if diverged[i] else "finished"
            ends[i] = {
                "termination": end if terminated[i] else "max_steps_reached",
                "max_fatigued": float(fatigued[i]),
                **self._who(i),
            }
            warned = {name: int(counts[i]) for name, counts in warnings.items() if counts[i]}
            if warned:
                ends[i]["warnings"] = warned
            if i in self._group.left and ends[i]["termination"] == "finished":
                ends[i] |= {"termination": "app_left", "app_left": self._group.left[i]}
            if i in self._group.failed:
                ends[i] |= {"termination": "app_failed", "app_error": self._group.failed[i]}
        return ends

    # --- saved states ------------------------------------------------------------------------

    def user_states(self) -> list[bytes]:
        """Return the N parts of :meth:`state_dict`."""
        return [
            pickle.dumps(
                {
                    "seed": self._seeds[i].bit_generator.state,
                    "user": self.users.state_dict(i),
                    "actions": self.actions.state_dict(i),
                    "senses": self._senses.state_dict(i),
                    "app": self._group.save(i, int(self._steps[i])),
                    "step": int(self._steps[i]),
                    "over": bool(self._over[i]),
                }
            )
            for i in range(self.n)
        ]

    @property
    def exact_states(self) -> bool:
        """Return whether :meth:`state_dict` includes the episodes.

        Third-party SIM2VR apps cannot save theirs.
        """
        return all("save" in app.capabilities for app in self.apps)

    def load_user_states(self, states: Sequence[bytes]) -> list[int]:
        """Continue from the parts of a state; see :meth:`load_state_dict`."""
        anew = []
        for i, state in enumerate(states):
            saved = _plain(state)
            self._seeds[i].bit_generator.state = saved["seed"]
            self.users.load_state_dict(i, saved["user"])
            self.actions.load_state_dict(i, saved["actions"])
            if saved["app"] is None:
                anew.append(i)
            else:
                self.apps[i].load(saved["app"])
            self._senses.load_state_dict(i, saved["senses"])
            self._steps[i], self._over[i] = saved["step"], saved["over"]
        if self._mirrored is not None:
            self._mirrored.resume(self._left_handers())
        if anew:
            self.reset(ids=anew)
        return anew

    @property
    def begun(self) -> bool:
        """Whether every user has been reset."""
        return not (self._over & (self._steps == 0)).any()

    def close(self) -> None:
        """End the apps; idempotent. Later calls raise RuntimeError."""
        self._closed = True
        self._apps.beside.shutdown()
        self._group.close()


_SHARES = (0.5, 0.25, 0.25)
"""Parts of the users whose bodies move one after the other, beside a GPU that draws for the part
before: a picture takes it six tenths of the time that sixteen cores take for a body."""


class AppSteps:
    """Sends users' device poses to their apps, and advances those.

    A GPU renders while the processor moves the bodies of other users. Results are identical with
    and without this overlap.

    Args:
        actions: of the fingers.
        max_steps: user steps of an episode.
    """

    def __init__(
        self, config: EnvConfig, users: UserBatch, group: AppGroup, actions: Actions, max_steps: int
    ) -> None:
        self._config, self._users, self._group = config, users, group
        self._actions, self._max_steps = actions, max_steps
        self.late_hands = LateHands(config, users.n)
        """Delayed hand poses, a sense to be watched if it has frames."""
        self.shares: tuple[float, ...] = _SHARES if group.drawn_by_gpu else (1.0,)
        """Parts of the users to move one after the other."""
        self.beside = ThreadPoolExecutor(1, "apps")
        """The thread that apps play in while bodies move; it begins with the first of them."""

    @contextmanager
    def step(
        self, active: NDArray[np.bool_], steps: IntArray, drawn: int | IntArray, *, whole: bool
    ) -> Iterator[_Step]:
        """Run a user step; after the context, no app is moving any more.

        Args:
            active: (N,) True for users that take part.
            steps: (N,) number of this user step in the round.
            drawn: index of the drawn frame, -1 the last; (N,) if users differ.
            whole: all bodies have to move before the first app does.
        """
        one = _Step(self, active, steps, drawn, (1.0,) if whole else self.shares)
        try:
            yield one
        finally:
            if one.running:
                wait(one.running)

    def play(self, ids: IntArray, steps: IntArray, drawn: int | IntArray) -> IntArray:
        """Step the apps of these users; return those whose apps have answered."""
        frames = self._config.frames_per_step
        # From the step count, so that rounding never accumulates.
        numbers = ((steps - 1) * frames + 1)[:, None] + np.arange(frames)
        times_ns = frame_times_ns(numbers, self._config.action_frequency_hz * frames)
        poses = self.step_poses(ids)
        self.look(ids)
        return self._group.step(ids, times_ns, poses, steps, self._max_steps, drawn=drawn)

    def look(self, ids: IntArray) -> None:
        """Direct the pictures around the gaze of these users, where they have any."""
        if self._actions.gaze_deg.size and self._group.fovea.size:
            self._group.gaze[ids] = gaze_slopes(self._actions.gaze_deg[ids])

    def poses(self, ids: IntArray, sample: int) -> DevicePoses:
        """Return the poses of these users' devices, (K, 7); see :meth:`UserBatch.device_poses`."""
        return DevicePoses(**{part: rows[:, 0] for part, rows in self._rows(ids, [sample]).items()})

    def step_poses(self, ids: IntArray) -> DevicePoses:
        """Return the poses of these users' devices in the F frames of the last step, (K, F, 7)."""
        frames = self._config.frames_per_step
        rows = self._rows(ids, range(frames)) | self._actions.input_rows(ids, frames)
        return self.late_hands.late(DevicePoses(**rows), ids)

    def _rows(self, ids: IntArray, samples: Sequence[int]) -> dict[str, NDArray[np.float64]]:
        found = {}
        for part, name in zip(
            ("head", "right_controller", "left_controller"), DEVICES, strict=True
        ):
            if name in self._users.body.devices:
                poses = [pose_to_app(*self._users.device_poses(name, k)) for k in samples]
                rows = poses[0][:, None] if len(poses) == 1 else np.stack(poses, axis=1)
                found[part] = rows[ids]
        return found


class _Step:
    """A user step in progress.

    Attributes:
        shares: parts of the users whose bodies are moved one after the other.
        running: steps of apps that run at the same time.
    """

    def __init__(
        self,
        apps: AppSteps,
        active: NDArray[np.bool_],
        steps: IntArray,
        drawn: int | IntArray,
        shares: tuple[float, ...],
    ) -> None:
        self._apps, self._active = apps, active
        self._steps, self._drawn, self.shares = steps, drawn, shares
        self._ids = np.zeros(0, dtype=np.int64)
        self.running: list[Future[IntArray]] = []

    def moved(self, ids: IntArray) -> None:
        """Advance the apps of users whose bodies have moved; in one part, only when requested."""
        ids = ids[self._active[ids]]
        if len(self.shares) == 1:
            self._ids = ids
        elif len(ids):
            self.running.append(self._apps.beside.submit(self._play, ids))

    def answered(self) -> IntArray:
        """Return the users whose apps have answered."""
        if len(self.shares) == 1:
            return self._play(self._ids)
        wait(self.running)
        return np.concatenate([self._ids, *(each.result() for each in self.running)])

    def _play(self, ids: IntArray) -> IntArray:
        drawn = self._drawn if isinstance(self._drawn, int) else self._drawn[ids]
        return self._apps.play(ids, self._steps[ids], drawn)
