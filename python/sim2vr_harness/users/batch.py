"""N simulated users stepped in parallel on a thread pool.

A user's motion depends on its own seed and actions only: neither the number of threads nor the
other users of the batch change a single bit of it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.users.actuation import Actuation
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.effort import EffortModel, effort_for
from sim2vr_harness.users.head_reflex import HeadMotion, HeadReflex, head_reflex, moved_head
from sim2vr_harness.users.noise import MotorNoise, MotorNoiseSettings
from sim2vr_harness.users.people import Person, Persons, Population
from sim2vr_harness.users.physics import Physics, WornDevices

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_HEAD = 0x48656164
"""Key of the head's random stream, which separates it from that of the motor noise."""


class UserBatch:
    """N users, each a simulation of its own: copies of one body, or people who differ.

    All arrays are float64, user first, in MuJoCo's world frame (z up, x forward, y left).
    Properties return copies that stay valid after the next call. M muscles, A actuators (muscles
    and motors) in the order of the actions.

    Poses, `qpos`, `qvel`, `act` and `end_effector_pos` describe the end of the last step. `qacc`
    and the forces of the effort model are those of the last 2 ms substep, the accelerations that
    led to this state. The reference reports poses one substep late as well (by 2.5 mm at median),
    which computing the kinematics once more per step avoids, at 2 % of the step's time; recomputing
    the accelerations too would cost 3.5 % and describe controls that will not be applied.

    A user whose simulation breaks is flagged in `diverged`, and every warning of MuJoCo's is
    counted in `warnings`; MuJoCo also notes the first one in MUJOCO_LOG.TXT in the working
    directory.

    Args:
        n: number of users N.
        threads: worker threads, 0 for one per CPU.
        effort: name for `make_effort`, or a ready model for N users.
        effort_weight: factor on the effort cost; None takes the model's default.
        effort_params: parameters of the effort model, `weight` too.
        noise: motor noise settings of the muscles; None for none.
        substeps: simulation steps of `body.timestep` per `step`: 25 make 0.05 s (20 Hz).
        people: the population whose persons `reset` may be given; None: all users are average.
        cut: makes the body of a person's physique, with the joints and actuators of `body`; None:
            persons do not differ in their bodies.
        head: "reflex" has the headset follow the hand and sway (`head.py`).

    Raises:
        ValueError: a number out of range, an unknown effort model, or one that the body lacks
            something for.
    """

    def __init__(
        self,
        body: Body,
        n: int,
        *,
        threads: int = 0,
        effort: str | EffortModel = "cumulative_fatigue_3ccr",
        effort_weight: float | None = None,
        effort_params: Mapping[str, Any] | None = None,
        noise: MotorNoiseSettings | None = None,
        substeps: int = 25,
        people: Population | None = None,
        cut: Callable[[Physique], Body] | None = None,
        head: HeadMotion = "fixed",
    ) -> None:
        for field, value, least in (
            ("n", n, 1),
            ("threads", threads, 0),
            ("substeps", substeps, 1),
        ):
            if int(value) != value or value < least:
                raise ValueError(f"{field}: got {value}, expected a whole number, at least {least}")
        self.body = body
        self.n = n
        self.substeps = substeps
        self.dt = substeps * body.timestep
        self.muscle_count = len(body.muscles)
        self.action_size = body.action_size
        self._actuation = Actuation(body)
        self.effort = effort_for(effort, n, body, self.dt, effort_weight, effort_params)
        self.noise = MotorNoise(noise, n, self.muscle_count) if noise else None

        self._physics = Physics(body, n, threads, self._actuation)
        self._worn = WornDevices(body, self._physics.batch)
        self.who = Persons(body, self._physics.batch, people, cut)
        self._head = head_reflex(head, body, n, substeps)
        self._cost = np.zeros(n)
        self.reset(np.arange(n), [np.random.default_rng(i) for i in range(n)])

    # --- episode -----------------------------------------------------------------------------

    def reset(
        self,
        ids: Sequence[int] | NDArray[np.integer],
        rngs: Sequence[np.random.Generator],
        postures: Sequence[FloatArray | None] | None = None,
        persons: Sequence[Person] | None = None,
    ) -> None:
        """Starts a new episode for some users, looking ahead as their bodies hold their heads.

        Independent joint angles and velocities are uniform about the body's reset posture
        (`Body.reset_rule`; +-0.05 rad and rad/s about 0 in the reference), activations and motors
        uniform in [0, 1]; motors that the rule holds aim at where their joints are. Each generator
        is asked in this order: angles, velocities, activations, motors, seed of the motor noise
        (also when there is none, so that noise does not change the start).

        Args:
            ids: (K,) distinct user indices, in any order.
            rngs: K random generators, one per entry of `ids`.
            postures: K postures to start in, (J,) angles of the independent joints in rad, to
                which the dependent joints are fitted; None for a drawn one.
            persons: new persons of these users, K of them; None: the previous ones.

        Raises:
            ValueError: an index out of range or given twice, or another number of generators,
                postures or persons.
        """
        ids = _checked_ids(ids, self.n)
        chosen = [None] * len(ids) if postures is None else postures
        _require_each("rngs", rngs, ids)
        _require_each("postures", chosen, ids)
        if persons is not None:
            _require_each("persons", persons, ids)
            self.who.become(ids, persons)
        if len(ids) == 0:
            return
        order = np.argsort(ids)
        ids, physics = ids[order], self._physics
        physics.reset(ids)
        starts = zip(ids.tolist(), order, strict=True)
        noise_seeds = [self._draw_start(i, rngs[k], chosen[k]) for i, k in starts]
        if self.noise is not None:
            self.noise.reset(ids, noise_seeds)
        self._worn.head_pitch_deg[ids] = np.nan
        physics.start(ids)
        self._worn.copy(ids, slice(None))
        if self._head is not None:
            seeds = [seed ^ _HEAD for seed in noise_seeds]
            self._head.reset(ids, seeds, self._worn.hands(-1)[ids])
        self.effort.reset(ids)
        self._update_effort(ids)

    def _draw_start(self, i: int, rng: np.random.Generator, posture: FloatArray | None) -> int:
        """Put a user into a state to start in; return the seed of its motor noise."""
        body, rule, physics = self.who.body(i), self.body.reset_rule, self._physics
        joints, dofs = body.qpos_independent, body.qvel_independent
        angles = rng.uniform(-rule.position_range, rule.position_range, len(joints))
        if rule.posture:
            angles += [rule.posture.get(name, 0.0) for name in body.independent_joints]
        physics.qpos[i, joints] = angles
        if rule.fit_couplings:
            physics.qpos[i] = body.coupled_qpos(angles)
        physics.qvel[i, dofs] = rng.uniform(-rule.velocity_range, rule.velocity_range, len(dofs))
        activations = rng.uniform(*rule.activation_range, self.muscle_count)
        physics.act[i, self._actuation.activations] = activations
        physics.motor[i] = rng.uniform(0.0, 1.0, physics.motor.shape[1])
        noise_seed = int(rng.integers(2**63))
        if posture is not None:
            physics.qpos[i] = body.coupled_qpos(posture)
        self._actuation.hold(physics.motor[i], physics.qpos[i])
        return noise_seed

    def turn_head(
        self,
        ids: Sequence[int] | NDArray[np.integer],
        pitch_deg: float | Sequence[float | None] | None,
    ) -> None:
        """Has these users look up or down.

        A body with a neck (`Body.nod`) begins its episode so, as far as the neck goes: call this
        after a reset. From there on its motors move the head. Without one, what is answered is the
        reported rotation alone, until the next reset: a pure pitch of the headset about where it
        is, as in the reference (SIM2VR paper's release).

        Args:
            ids: (K,) distinct user indices.
            pitch_deg: degrees, up positive, for all of them or (K,); None: as the body holds it.

        Raises:
            ValueError: an index out of range, another number of pitches, a pitch beyond +-90
                degrees, or a body without a headset.
        """
        ids = _checked_ids(ids, self.n)
        given = [pitch_deg] * len(ids) if pitch_deg is None or np.isscalar(pitch_deg) else pitch_deg
        pitches = np.array([np.nan if p is None else p for p in given], dtype=np.float64)  # type: ignore[union-attr]
        _require_each("pitch_deg", pitches, ids)
        wrong = np.abs(pitches) > 90.0
        if wrong.any():
            raise ValueError(f"pitch_deg: got {pitches[wrong][0]}, expected -90 to 90 degrees")
        if "headset" not in self.body.devices and not np.isnan(pitches).all():
            raise ValueError(f"pitch_deg: got {pitch_deg} for a body without a headset")
        if self.body.nod is None:
            self._worn.head_pitch_deg[ids] = pitches
        else:
            asked = ~np.isnan(pitches)
            self._nod(ids[asked], pitches[asked], self.body.nod)

    def _nod(self, ids: IntArray, pitches_deg: FloatArray, joint: str) -> None:
        """Bends necks until the headsets look as asked, and has the motor keep them there."""
        if len(ids) == 0:
            return
        hinge = self.body.physics_model.joint(joint)
        low, high = hinge.range
        w, x, y, z = self._worn.poses("headset", -1)[1][ids].T
        looking_up = np.arcsin(np.clip(2.0 * (x * z - w * y), -1.0, 1.0))
        physics = self._physics
        angles = physics.qpos[ids, hinge.qposadr[0]] + looking_up - np.radians(pitches_deg)
        physics.qpos[ids, hinge.qposadr[0]] = np.clip(angles, low, high)
        for i in ids:
            self._actuation.hold(physics.motor[i], physics.qpos[i])
        physics.start(ids)
        self._worn.copy(ids, slice(None))
        self.effort.reset(ids)
        self._update_effort(ids)

    def step(
        self,
        action: ArrayLike,
        *,
        pose_samples: int = 1,
        pauses: Mapping[int, Callable[[], None]] | None = None,
        shares: Sequence[float] = (1.0,),
        moved: Callable[[IntArray], None] = lambda ids: None,
    ) -> None:
        """Advances every user by one step of `dt` seconds.

        Each group of actuators has a rule (`bodies/rules.py`); muscles: ctrl = clip(act + action).

        Args:
            action: (N, A) numbers; values outside [-1, 1] are clipped to it.
            pose_samples: how many device poses to keep, evenly spread over the step, the last one
                at its end. Must divide `substeps`; the motion is the same to the bit.
            pauses: substep (1 to `substeps`) -> what to call when all users are at its end. Every
                property then describes that moment, and `device_poses` too (sample -1), but the
                effort, which is of the last whole step. Changes no bit of the motion.
            shares: parts of the users to move one after the other.
            moved: called after each part with the users that have not diverged.

        Raises:
            ValueError: the action has another shape or is not finite, a wrong `pose_samples`, or
                a pause at no substep.
        """
        action = checked_action(action, self.n, self.body.action_names)
        stops = _checked_stops(self.substeps, pose_samples, pauses or {})
        ids = np.flatnonzero(~self._physics.diverged)
        before = self._physics.kept(ids)
        self._apply(np.clip(action[self._physics.rows(ids)], -1.0, 1.0), ids)
        if self._head is not None:
            pos, quat = self._worn.poses("headset", -1)
            hands = self._worn.hands(-1)
            factors = self.who.head_movement[ids]
            self._head.begin(ids, (pos[ids], quat[ids]), hands[ids], factors)
        self._worn.resize(pose_samples)
        cuts = [round(float(cut)) for cut in np.cumsum(shares[:-1]) * len(ids)]
        for begin, end in pairwise([0, *cuts, len(ids)]):
            part = slice(begin, end)
            self._move(ids[part], tuple(each[part] for each in before), stops, pauses or {})
            moved(self._alive(ids[part]))
        self._update_effort(self._alive(ids))

    def _alive(self, ids: IntArray) -> IntArray:
        """Return those of these users who have not diverged."""
        diverged = self._physics.diverged
        return ids[~diverged[ids]] if diverged.any() else ids

    def _move(
        self,
        ids: IntArray,
        before: tuple[FloatArray, ...],
        stops: Sequence[int],
        pauses: Mapping[int, Callable[[], None]],
    ) -> None:
        """Go on to the step's end; those that break are put back to where they were before."""
        physics, done, sample, alive = self._physics, 0, 0, ids
        for stop in stops:
            physics.advance(alive, stop - done)
            done, alive = stop, self._alive(alive)
            if self._head is not None:
                self._head.reached = stop
            self._worn.copy(alive, slice(sample, None))
            if stop in pauses:
                physics.copy_forces(alive)
                pauses[stop]()
            sample += (stop * self._worn.samples) % self.substeps == 0
        if len(alive) < len(ids):
            lost = physics.diverged[ids]
            physics.put_back(ids[lost], tuple(part[lost] for part in before))
            self._worn.copy(ids[lost], slice(None))
        physics.copy_forces(alive)

    def _apply(self, action: FloatArray, ids: IntArray) -> None:
        """Sets the controls of these users."""
        physics = self._physics
        rows = physics.rows(ids)
        memory = physics.motor[rows]
        ctrl = self._actuation.controls(action, physics.act[rows], memory)
        physics.motor[rows] = memory
        if self.noise is not None:
            muscles = self._actuation.muscles
            ctrl[:, muscles] = self.noise.apply(ctrl[:, muscles], ids, self.who.motor_noise[ids])
        if isinstance(rows, slice):
            physics.ctrl[:, self._actuation.actuators] = ctrl
        else:
            physics.ctrl[np.ix_(rows, self._actuation.actuators)] = ctrl

    def _update_effort(self, ids: IntArray) -> None:
        if len(ids):
            actuators, physics = self._actuation.actuators, self._physics
            rows = physics.rows(ids)
            # Of the strength that they have: forces count as shares of the body's peak forces.
            force = physics.force[rows].take(actuators, axis=1) / self.who.strength[rows, None]
            act = physics.act[rows].take(self._actuation.activations, axis=1)
            ctrl = physics.ctrl[rows].take(actuators, axis=1)
            cost = self.effort.update(self._actuation.loads(act, force), ctrl, force, ids)
            self._cost[ids] = self.who.effort_weight[ids] * cost

    # --- what the simulation says ------------------------------------------------------------

    @property
    def persons(self) -> tuple[Person, ...]:
        """(N,) persons of the users; all `AVERAGE` without a population."""
        return self.who.now

    @property
    def person_features(self) -> NDArray[np.float32]:
        """(N, F) `Person.features` of the users."""
        return self.who.features.copy()

    def device_poses(self, name: str, sample: int = -1) -> tuple[FloatArray, FloatArray]:
        """Returns where a device is, as its OpenXR runtime would report it.

        Args:
            name: one of `body.devices`: "headset", "controller_right", "controller_left".
            sample: which of the last step's `pose_samples`; -1 is the end of the step.

        Returns:
            (N, 3) positions in m and (N, 4) unit quaternions w x y z, MuJoCo world frame.

        Raises:
            ValueError: the user does not wear that device, or there is no such sample.
        """
        pos, quat = self._worn.poses(name, sample)
        if name != "headset" or self._head is None:
            return pos, quat
        return moved_head(pos, quat, self._head_offsets(self._head, sample))

    def _head_offsets(self, head: HeadReflex, sample: int) -> FloatArray:
        count = self._worn.samples
        every = self.substeps // count
        substep = head.reached if sample == -1 else (sample % count + 1) * every
        return head.offsets(self._worn.hands(sample), substep)

    @property
    def head_offsets(self) -> FloatArray:
        """(N, 5) displacement of the heads by the reflex, zeros without one.

        The columns are left, down, tilt (rad), forward and left (m).
        """
        return np.zeros((self.n, 5)) if self._head is None else self._head_offsets(self._head, -1)

    @property
    def act(self) -> FloatArray:
        """(N, M) muscle activations in [0, 1]."""
        return np.array(self._physics.act[:, self._actuation.activations])

    @property
    def motor(self) -> FloatArray:
        """(N, S) smoothed targets of the motors, 0 to 1 of their control ranges."""
        return self._physics.motor.copy()

    @property
    def ctrl(self) -> FloatArray:
        """(N, A) controls, with motor noise: of muscles in [0, 1]."""
        return np.array(self._physics.ctrl[:, self._actuation.actuators])

    @property
    def qpos(self) -> FloatArray:
        """(N, nq) joint angles in rad."""
        return np.array(self._physics.qpos)

    @property
    def qvel(self) -> FloatArray:
        """(N, nv) joint velocities in rad/s."""
        return np.array(self._physics.qvel)

    @property
    def qacc(self) -> FloatArray:
        """(N, nv) joint accelerations of the last substep in rad/s^2."""
        return self._physics.qacc.copy()

    @property
    def actuator_force(self) -> FloatArray:
        """(N, A) forces of the last substep in N (motors Nm); a pulling muscle's is negative."""
        return self._physics.force[:, self._actuation.actuators]

    @property
    def end_effector_pos(self) -> FloatArray:
        """(N, 3 E) positions of the E end effectors in m; of the wrist model the fingertip."""
        return self._worn.end_effectors.reshape(self.n, -1).copy()

    @property
    def effort_cost(self) -> FloatArray:
        """(N,) weighted effort cost of the last step, to be subtracted from the reward."""
        return self._cost.copy()

    @property
    def time(self) -> FloatArray:
        """(N,) seconds since the user's last reset."""
        return np.array(self._physics.time)

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """(N,) True for simulations that diverged; these users keep their last finite state."""
        return self._physics.diverged.copy()

    @property
    def warnings(self) -> dict[str, IntArray]:
        """(N,) numbers of MuJoCo warnings since the last reset, by kind.

        `badqpos`, `badqvel`, `badqacc` and `badctrl` make a user diverge. `inertia` (nearly
        singular), `contactfull` and `cnstrfull` (more than the model has room for) do not: the
        simulation continues, but its motion is not reliable.
        """
        return self._physics.warnings

    # --- save and restore --------------------------------------------------------------------

    def state_dict(self, i: int) -> dict[str, Any]:
        """Return the complete state of user i as arrays and bytes.

        It includes activations, motors, solver warm start, fatigue, noise streams and the target
        direction of the head, so that a restored user continues with identical bits. The last
        step's extra pose samples are not included.
        """
        i = int(_checked_ids([i], self.n)[0])
        state: dict[str, Any] = {
            **self._physics.state_dict(i),
            "head_pitch_deg": np.array(self._worn.head_pitch_deg[i]),
            "effort_cost": self._cost[i].copy(),
        }
        state.update({f"effort/{k}": v[i].copy() for k, v in self.effort.state_dict().items()})
        if self.noise is not None:
            state.update({f"noise/{k}": v for k, v in self.noise.state_dict(i).items()})
        if self._head is not None:
            state.update({f"head/{k}": v for k, v in self._head.state_dict(i).items()})
        if self.who.people is not None:
            state["person"] = self.who.state_dict(i)
        return state

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned, into any user of a batch with the same settings.

        Raises:
            ValueError: an index out of range, a state of another model, effort or noise, or one
                that is not finite.
        """
        i = int(_checked_ids([i], self.n)[0])
        _require_state(state, self.state_dict(i))
        ids = np.array([i])
        if self.who.people is not None:
            self.who.load_state_dict(i, state["person"])
        self._physics.load_state_dict(i, state)
        self._worn.head_pitch_deg[i] = state["head_pitch_deg"]
        self._worn.copy(ids, slice(None))
        self._cost[i] = state["effort_cost"]
        effort = {k: state[f"effort/{k}"][None] for k in self.effort.state_dict()}
        self.effort.load_state_dict(effort, ids)
        if self.noise is not None:
            keys = self.noise.state_dict(i)
            self.noise.load_state_dict(i, {k: state[f"noise/{k}"] for k in keys})
        if self._head is not None:
            keys = self._head.state_dict(i)
            self._head.load_state_dict(i, {k: state[f"head/{k}"] for k in keys})

    def set_motion(
        self, qpos: FloatArray, qvel: FloatArray, act: FloatArray, motor: FloatArray
    ) -> None:
        """Set every user's state of motion: N rows, as the properties of these names return them.

        Diverged users become valid again. Effort, noise and head do not change, and devices keep
        their poses until the next step.

        Raises:
            ValueError: another shape, or a number that is not finite.
        """
        self._physics.set_motion(qpos, qvel, act, motor)


def _checked_ids(ids: Sequence[int] | NDArray[np.integer], n: int) -> NDArray[np.int64]:
    """(K,) distinct users of n.

    Raises:
        ValueError: they are no indices, one is out of range or comes twice.
    """
    given = np.asarray(ids)
    if given.ndim != 1 or (given.size and not np.issubdtype(given.dtype, np.integer)):
        raise ValueError(f"ids: got {ids!r}, expected a list of user indices")
    wrong = given[(given < 0) | (given >= n)]
    if wrong.size:
        raise ValueError(f"ids: got {int(wrong[0])}, expected 0 to {n - 1}")
    if len(np.unique(given)) != len(given):
        raise ValueError(f"ids: got {given.tolist()}, expected each user at most once")
    return given.astype(np.int64)


def _checked_stops(substeps: int, pose_samples: int, pauses: Iterable[int]) -> list[int]:
    """The substeps of a user step, in order, at whose ends something is to be done.

    Raises:
        ValueError: samples that do not divide the step, or a pause at no substep.
    """
    if pose_samples < 1 or substeps % pose_samples:
        raise ValueError(
            f"pose_samples: got {pose_samples}, expected a divisor of substeps={substeps}"
        )
    wrong = [stop for stop in pauses if stop not in range(1, substeps + 1)]
    if wrong:
        raise ValueError(f"pauses: got substep {wrong[0]}, expected 1 to {substeps}")
    every = substeps // pose_samples
    return sorted({*range(every, substeps + 1, every), *pauses})


def _require_each(field: str, given: Sized, ids: Sized) -> None:
    """Raise ValueError unless there is one of something for each id."""
    if len(given) != len(ids):
        raise ValueError(f"{field}: got {len(given)}, expected {len(ids)}, one per id")


def _require_state(state: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Raise ValueError unless a state has the keys and shapes of another, and finite numbers."""
    if set(state) != set(expected):
        raise ValueError(f"state: got keys {sorted(state)}, expected {sorted(expected)}")
    for key, value in expected.items():
        if isinstance(value, np.ndarray) and np.shape(state[key]) != value.shape:
            raise ValueError(
                f"state {key}: got shape {np.shape(state[key])}, expected {value.shape}"
            )
    if not np.isfinite(state["simulation"]).all():
        raise ValueError("state simulation: got NaN or infinity, expected finite numbers")


def checked_action(action: ArrayLike, n: int, names: Sequence[str]) -> NDArray[np.float64]:
    """(N, A) finite actions of n users, one for each name.

    Raises:
        ValueError: another shape, or numbers that are not real and finite.
    """
    shape = (n, len(names))
    try:
        given = np.asarray(action)
    except ValueError as error:
        raise ValueError(f"action: got rows of several lengths, expected {shape}") from error
    if given.shape != shape:
        raise ValueError(f"action: got shape {given.shape}, expected {shape}")
    if not np.issubdtype(given.dtype, np.number) or np.iscomplexobj(given):
        raise ValueError(f"action: got dtype {given.dtype}, expected real numbers")
    given = given.astype(np.float64)
    if not np.isfinite(given).all():
        i, j = (int(k) for k in np.argwhere(~np.isfinite(given))[0])
        raise ValueError(
            f"action[{i}, {j}] ({names[j]}): got {given[i, j]}, expected a finite number in [-1, 1]"
        )
    return given
