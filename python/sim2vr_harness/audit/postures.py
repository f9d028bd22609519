"""Postures that an arm holds: activations, torques, the time until exhaustion, and equilibria.

To hold a posture the largest muscle activation is made as small as possible while all joints of the
arm are in equilibrium: static optimisation by the min/max criterion (Rasmussen, Damsgaard, Voigt
2001). :class:`Balancer` looks for a posture in equilibrium as near to a place as possible: unknown
are the joints' angles and the muscles' activations. Activations are a bounded least squares problem
in each posture; angles follow by Levenberg-Marquardt steps, with the activations between their
bounds left free to follow (variable projection).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.people_preset import as_population
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.users import FATIGUE_PRESETS, Body, Population
from sim2vr_harness.users.bodies.rules import moment_arms
from sim2vr_harness.users.exertion import (
    Arm,
    ArmDynamics,
    ArmLoad,
    Strength,
    arms_of,
    consumed_endurance_time,
    endurance_time,
    fatigue_endurance_time,
    nicer_correction,
)
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import bounded_least_squares

FloatArray = NDArray[np.float64]

_STEP = 1e-5
_NO_MOMENT = 1e-6
"""Nm at full activation below which a muscle does not move a joint."""
_SPARING = 1e-6
"""Weight of the sum of activations relative to the largest: of equal optima the least is
selected."""
_AT_LIMIT = 1e-4
"""rad from a joint's limit within which it rests there."""
_MOST_PEOPLE = 200


@dataclass(frozen=True)
class Held:
    """A posture that one arm holds.

    Attributes:
        side: ``right`` or ``left``.
        torque_nm: of gravity about the shoulder.
        shoulder_deg: between upper arm and straight down.
        elbow_deg: between upper arm and forearm; 180: outstretched.
        share: of the maximum at the shoulder: the least largest activation of its muscles. Above
            1, the muscles are too weak. For a body without muscles ``strength_share``. None: no
            muscle forces of any size balance the posture.
        strength_share: the torque as a share of people's published strength in this posture.
        activations: of the arm's muscles.
        endurance_s: seconds until exhaustion by model; infinite: unlimited.
    """

    side: str
    torque_nm: float
    shoulder_deg: float
    elbow_deg: float
    share: float | None
    strength_share: float
    activations: Mapping[str, float]
    endurance_s: Mapping[str, float]


def posture_of(body: Body, text: str) -> FloatArray:
    """Return the angles (J,) of the independent joints that ``JOINT=DEGREES,...`` stands for.

    Other joints stay where episodes start. A name without its side means both arms.

    Raises:
        InputError: A joint is unknown or beyond its limits, or the text is something else.
    """
    joints = body.independent_joints
    angles = np.array([body.reset_rule.posture.get(name, 0.0) for name in joints])
    for part in filter(None, text.split(",")):
        name, _, number = (piece.strip() for piece in part.partition("="))
        try:
            degrees = float(number)
        except ValueError:
            degrees = np.nan
        if not np.isfinite(degrees):
            raise InputError("--pose", repr(part), "JOINT=DEGREES, for example shoulder_elv=90")
        meant = [i for i, joint in enumerate(joints) if joint in (name, f"{name}_r", f"{name}_l")]
        if not meant:
            raise unknown_name("--pose", name, joints)
        for i in meant:
            low, high = np.degrees(body.joint_ranges[i])
            if not low - 1e-3 <= degrees <= high + 1e-3:
                expected = f"{low:.0f} to {high:.0f} degrees of {body.name}"
                raise InputError(f"--pose {joints[i]}", f"{degrees:g}", expected)
            angles[i] = np.radians(degrees)
    return np.clip(angles, *body.joint_ranges.T)


def who_hold(user: UserConfig, people: int | None) -> list[tuple[UserConfig, Strength | None]]:
    """Return the user alone, or as many participants of its population, with their strength.

    Raises:
        InputError: Another number of people than 1 to 200.
    """
    if people is None:
        return [(user, None)]
    if not 1 <= people <= _MOST_PEOPLE:
        raise InputError("--people", str(people), f"1 to {_MOST_PEOPLE}")
    settings = as_population(user, people).people
    assert settings is not None
    population = Population(settings, user.person)
    persons = [population.number(i) for i in range(people)]
    return [
        (
            user.model_copy(update={"person": population.physique(person), "people": None}),
            population.shoulder(person),
        )
        for person in persons
    ]


def hold(
    user: UserConfig, pose: str, load_kg: float = 0.0, strength: Strength | None = None
) -> list[Held]:
    """Hold a posture with every arm of a user.

    Args:
        user: user with body and muscles.
        pose: as of :func:`posture_of`.
        load_kg: mass in each hand, in addition to the controller's.
        strength: of the shoulders, for published torques; None: a man's, times the user's.

    Raises:
        InputError: The posture or load cannot be used, or the body has no arm.
    """
    if not 0.0 <= load_kg <= 100.0:
        raise InputError("--load", f"{load_kg:g}", "0 to 100 kg")
    body = ResolvedEnv.of_user(user).body
    arms = arms_of(body)
    if not arms:
        expected = "a body whose controller hangs from parts named humerus, ulna and radius"
        raise InputError("USER", body.name, expected)
    angles = posture_of(body, pose)
    strength = strength or Strength(factor=user.person.strength)
    return [PostureHolder(body, arm).hold(angles, load_kg, strength) for arm in arms]


def plain(held: Held) -> dict[str, object]:
    """Return an arm for JSON, which has no infinity: endless endurance is null."""
    times = held.endurance_s.items()
    finite_times = {name: time if time < np.inf else None for name, time in times}
    return {**vars(held), "endurance_s": finite_times}


def told(arms: Sequence[Held], load_kg: float) -> list[str]:
    """Return lines on the same arm of one or several participants."""
    first = arms[0]
    many = f", {len(arms)} participants: median (least to most)" if len(arms) > 1 else ""
    shares = [np.inf if arm.share is None else arm.share for arm in arms]
    rows = {
        "torque at the shoulder (Nm)": ([arm.torque_nm for arm in arms], 1, ""),
        "share of maximum at the shoulder": (shares, 2, "too weak"),
        "share of published strength": ([arm.strength_share for arm in arms], 2, ""),
    }
    for name in first.endurance_s:
        times = [arm.endurance_s[name] for arm in arms]
        rows[f"exhausted by {name} (s)"] = (times, 0, "endless")
    lines = [
        f"{first.side.capitalize()} arm, shoulder {first.shoulder_deg:.0f}, elbow "
        f"{first.elbow_deg:.0f} degrees, {load_kg:g} kg in the hand{many}"
    ]
    for label, (values, digits, infinite) in rows.items():
        median, least, most = (
            infinite if value == np.inf else f"{value:.{digits}f}"
            for value in (np.median(values), min(values), max(values))
        )
        spread = f" ({least} to {most})" if len(arms) > 1 else ""
        lines.append(f"  {label:40} {median}{spread}")
    if len(arms) == 1 and first.activations:
        highest = sorted(first.activations.items(), key=lambda item: -item[1])[:4]
        lines.append("  most active: " + ", ".join(f"{name} {x:.2f}" for name, x in highest))
    return lines


@dataclass(frozen=True)
class Mechanics:
    """Torques that P postures require of K joints, and torques that M muscles produce in them.

    Attributes:
        hands: (P, 3) position of the first arm's hand, m.
        needed: (P, K) torques against gravity and passive forces, Nm.
        effects: (P, M, K) torques of fully active muscles, Nm.
        inertia: (K, K) of the last posture.
    """

    hands: FloatArray
    needed: FloatArray
    effects: FloatArray
    inertia: FloatArray


class ArmMuscles:
    """Statics of a body, with passive forces of joints and muscles, and with coupled joints.

    Args:
        body: The body with its muscles.
    """

    def __init__(self, body: Body) -> None:
        model = body.physics_model
        self._body, self._model, self._data = body, model, mujoco.MjData(model)
        self._sites = [int(model.site(each.device).id) for each in arms_of(body)]
        self._muscles = np.array([model.actuator(name).id for name in body.muscles], dtype=int)

    def gravity(self, qpos: FloatArray) -> FloatArray:
        """Return torques of gravity at the joints, (nv,), which they have to balance."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = qpos, 0.0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        return np.array(data.qfrc_bias)

    def mechanics(
        self, angles: FloatArray, columns: NDArray[np.int64], load_kg: float, strength: float
    ) -> Mechanics:
        """Return the mechanics of postures.

        Args:
            angles: (P, J) of the independent joints, rad.
            columns: (K,) indices of the joints to include.
            load_kg: Mass in each hand, in addition to the controller's.
            strength: Factor on the forces of the muscles beyond those at rest.
        """
        model, data, coupled = self._model, self._data, self._body.coupled_qpos
        count, k = len(angles), len(columns)
        # (P, nv, K) how all joints follow these; all are hinges or slides.
        shifts = np.zeros((k, angles.shape[1]))
        shifts[np.arange(k), columns] = _STEP
        rise = coupled(angles[:, None] + shifts) - coupled(angles[:, None] - shifts)
        slopes = np.swapaxes(rise, 1, 2) / (2.0 * _STEP)
        hands, needed = np.zeros((count, 3)), np.zeros((count, k))
        effects = np.zeros((count, len(self._muscles), k))
        mass, push = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
        for i, qpos in enumerate(coupled(angles)):
            torques = self.gravity(qpos) - data.qfrc_passive
            slack, full = self._forces(0.0), self._forces(1.0)
            arms = moment_arms(model, data)[self._muscles] @ slopes[i]
            hands[i] = data.site_xpos[self._sites[0]]
            for site in self._sites:
                mujoco.mj_jacSite(model, data, push, None, site)
                torques = torques - load_kg * model.opt.gravity @ push
            needed[i] = torques @ slopes[i] - slack @ arms
            effects[i] = strength * (full - slack)[:, None] * arms
        mujoco.mj_fullM(model, data, mass)
        return Mechanics(hands, needed, effects, slopes[-1].T @ mass @ slopes[-1])

    def _forces(self, activation: float) -> FloatArray:
        """(M,) of muscles that are all active alike."""
        self._data.act[:] = activation
        mujoco.mj_fwdActuation(self._model, self._data)
        return np.array(self._data.actuator_force)[self._muscles]


class PostureHolder:
    """Holds postures with one arm of a body.

    Args:
        body: The body with its muscles.
        arm: Of that body.
    """

    def __init__(self, body: Body, arm: Arm) -> None:
        model = body.physics_model
        self._body, self._arm, self._muscles = body, arm, ArmMuscles(body)
        self._dynamics, self._still = ArmDynamics(model, arm), np.zeros(model.nv)
        joints, moved = body.independent_joints, Linkage(body, Point(arm.device)).joints
        over, part = Linkage(body, Point(arm.forearm)).joints, model.body(arm.forearm)
        of_elbow = [model.joint(part.jntadr[0] + i).name for i in range(part.jntnum[0])]
        self._moved = np.array([joint in moved for joint in joints])
        self._above = np.array([joint in over and joint not in of_elbow for joint in joints])

    def load(self, angles: FloatArray, load_kg: float) -> ArmLoad:
        """Return torque and posture of the arm; arguments as of :meth:`hold`."""
        qpos = self._body.coupled_qpos(angles)
        return self._dynamics.load(qpos, self._still, self._still, held_kg=load_kg)

    def gravity(self, angles: FloatArray) -> FloatArray:
        """Return torques of gravity at the joints, (nv,), which they have to balance."""
        return self._muscles.gravity(self._body.coupled_qpos(angles))

    def hold(
        self,
        angles: FloatArray,
        load_kg: float,
        strength: Strength,
        *,
        limits_bear: bool = False,
        muscle_strength: float = 1.0,
    ) -> Held:
        """Hold a posture.

        Args:
            angles: (J,) of the independent joints, rad.
            load_kg: Mass in the hand, in addition to the controller's.
            strength: For the published strength of the shoulder.
            limits_bear: True: a joint at its limit rests there, without muscles.
            muscle_strength: Factor on the forces of the body's muscles beyond those at rest.
        """
        load = self.load(angles, load_kg)
        maximum = strength.shoulder_torque(load.shoulder_deg, load.elbow_deg)
        corrected = load.torque + nicer_correction(load.shoulder_deg, load.elbow_deg, strength.man)
        published = float(load.torque / maximum)
        found = self._activations(angles, load_kg, limits_bear, muscle_strength)
        own, activations = (published, {}) if found is None else found
        times = {
            f"3CC-r, {name}": 0.0
            if own is None
            else float(fatigue_endurance_time(own, rates["fatigue"], rates["recovery"]))
            for name, rates in FATIGUE_PRESETS.items()
        }
        times["NICER"] = float(endurance_time(corrected / maximum))
        consumed = load.torque / strength.consumed_endurance_torque
        times["Consumed Endurance"] = float(consumed_endurance_time(consumed))
        return Held(
            side=self._arm.side,
            torque_nm=load.torque,
            shoulder_deg=load.shoulder_deg,
            elbow_deg=load.elbow_deg,
            share=own,
            strength_share=published,
            activations=activations,
            endurance_s=times,
        )

    def _activations(
        self, angles: FloatArray, load_kg: float, limits_bear: bool, strength: float
    ) -> tuple[float | None, dict[str, float]] | None:
        """Return the least largest activation of the shoulder's muscles, and all activations.

        Muscles that do not cross the shoulder are activated up to 1. None for the first: no
        activations balance the arm; for both: no muscle moves it.
        """
        body = self._body
        found = self._muscles.mechanics(angles[None], np.arange(len(angles)), load_kg, strength)
        effects = found.effects[0]
        # Columns of joints that muscles move, and rows of muscles that move one of them.
        rows = self._moved & (np.abs(effects).max(axis=0, initial=0.0) > _NO_MOMENT)
        moving = np.abs(effects[:, rows]).max(axis=1, initial=0.0) > _NO_MOMENT
        crosses = np.abs(effects[:, rows & self._above]).max(axis=1, initial=0.0) > _NO_MOMENT
        names = [name for name, moves in zip(body.muscles, moving, strict=True) if moves]
        if not names:
            return None
        at_limits = np.abs(angles[:, None] - body.joint_ranges) < _AT_LIMIT
        stops = at_limits @ np.array([1.0, -1.0]) * limits_bear
        resting = np.diag(stops)[rows][:, rows & (stops != 0.0)]
        n, shoulder = len(names), crosses[moving].astype(float)
        bounds = [(0.0, None if crosses else 1.0) for crosses in shoulder]
        bounds += [(0.0, None)] * (1 + resting.shape[1])
        solution = linprog(
            np.r_[np.full(n, _SPARING), 1.0, np.zeros(resting.shape[1])],
            A_ub=np.c_[np.diag(shoulder), -shoulder, np.zeros((n, resting.shape[1]))],
            b_ub=np.zeros(n),
            A_eq=np.c_[effects[moving][:, rows].T, np.zeros(rows.sum()), resting],
            b_eq=found.needed[0, rows],
            bounds=bounds,
        ).x
        if solution is None:
            return None, {}
        return float(solution[n]), dict(zip(names, solution.tolist(), strict=False))


@dataclass(frozen=True)
class BalanceSettings:
    """Settings of the search for postures in static equilibrium, with its tolerances."""

    near_m: float = 0.02
    """Distance that counts as near, also for simulated reaches."""
    left_nm: float = 0.1
    """Torque that may stay unbalanced."""
    swing_nm: float = 12.0
    """Torque that may be lacking on the way, for which the arm's swing compensates. Fitted to
    simulated reaches of 290 pairs of a participant and a place (docs/evidence/audit.md)."""
    place_m: float = 0.01
    """Distance that counts as much as one unit of unbalanced torque."""
    unit: float = 10.0
    """Weight of torques, in the metric of kinetic energy."""
    ease: float = 0.02
    """Weight of activations relative to unbalanced torques."""
    way_points: int = 6
    """Number of postures on the way from rest that are checked."""
    iterations: int = 20
    tries: int = 4
    """Dampings tried for each step."""
    gain: float = 1e-3
    small: float = 1e-2
    """The search ends when it gains less than ``gain`` times the cost, or times ``small``."""
    damping: tuple[float, float, float] = (1e-2, 1e-7, 1e5)
    """At first, at least and at most."""


BALANCE = BalanceSettings()
_BOUND = 1e-9
"""Distance from a bound within which an activation is at the bound."""
_ARM_DEG = {"elv_angle": 60.0, "shoulder_elv": 60.0, "shoulder_rot": -20.0, "elbow_flexion": 90.0}
_TRUNK = ("trunk_flexion", "trunk_bending", "trunk_rotation")
_LEANS_DEG = [
    (flexion, bending, rotation)
    for flexion in (5.0, 35.0)
    for bending, rotation in ((0.0, 0.0), (-20.0, -15.0), (20.0, 15.0))
]
"""Further initial postures of trunk and arm for the search."""


@dataclass(frozen=True)
class Balance:
    """Muscle equilibrium of a posture.

    Attributes:
        angles: (J,) of the independent joints.
        gap_m: Distance of the hand from the place.
        left_nm: Largest torque that stays unbalanced.
        way_nm: Largest torque that muscles lack on the way there; infinite: not near, or
            unbalanced.
        activations: (M,) of the muscles.
    """

    angles: FloatArray
    gap_m: float
    left_nm: float
    way_nm: float
    activations: FloatArray

    @property
    def balanced(self) -> bool:
        """Return whether the posture is in equilibrium."""
        return self.left_nm <= BALANCE.left_nm

    def holds(self, close_m: float) -> bool:
        """Return whether muscles bring the hand within ``close_m`` and hold it there."""
        return self.balanced and self.gap_m <= close_m and self.way_nm <= BALANCE.swing_nm

    def rank(self, close_m: float) -> tuple[bool, bool, float]:
        """Order of postures, the best first."""
        near = self.gap_m <= close_m
        return not (near and self.balanced), not near, self.way_nm if near else self.gap_m


class Balancer:
    """Finds postures of the right arm and trunk in static equilibrium.

    Args:
        body: The body with its muscles and trunk motors.
        strength: Factor on both.
        load_kg: Mass in the hand, in addition to the controller's.

    Attributes:
        columns: (K,) of the joints that move the hand, among the independent ones.
        limits: (K, 2) of these joints, rad.
        motor_low, motor_high: (K,) torques of the motors that move them, Nm.
        motors: Number of motors.
    """

    def __init__(self, body: Body, strength: float = 1.0, load_kg: float = 0.0) -> None:
        self._muscles, self._load_kg, self._strength = ArmMuscles(body), load_kg, strength
        chain = Linkage(body, Point("controller_right")).joints
        joints = body.independent_joints
        self._rest = np.array([body.reset_rule.posture.get(joint, 0.0) for joint in joints])
        # (S, J) postures with the elbow bent and the trunk leaning to several sides.
        self._starts = np.repeat(self._rest[None], len(_LEANS_DEG), axis=0)
        for joint, degrees in _ARM_DEG.items():
            self._starts[:, joints.index(joint)] = np.radians(degrees)
        trunk = [joints.index(joint) for joint in _TRUNK]
        self._starts[:, trunk] = np.radians(_LEANS_DEG)
        self.columns = np.array([joints.index(joint) for joint in chain])
        self.limits: FloatArray = np.asarray(body.joint_ranges)[self.columns]
        self.motor_low, self.motor_high = np.zeros((2, len(chain)))
        for i, joint in enumerate(chain):
            if joint.startswith("trunk_"):
                span = body.physics_model.actuator(f"{joint}_motor").forcerange
                self.motor_low[i], self.motor_high[i] = strength * span
        self.motors = int((self.motor_high > 0.0).sum())

    def mechanics(self, angles: FloatArray) -> Mechanics:
        """Return torques that postures (P, J) require, and those that muscles produce."""
        return self._muscles.mechanics(angles, self.columns, self._load_kg, self._strength)

    def holds(self, angles: FloatArray) -> bool:
        """Return whether muscles bring the arm to a posture (J,) and hold it."""
        still = _State(self, np.array(angles), np.zeros(3)).left_nm <= BALANCE.left_nm
        return still and self._on_the_way(angles) <= BALANCE.swing_nm

    def search(self, place: FloatArray, postures: FloatArray, close_m: float) -> list[Balance]:
        """Return postures that the search found, the best first.

        It ends with the first that muscles bring near enough and hold.

        Args:
            place: (3,) MuJoCo's world, in the body's own frame, m.
            postures: (C, J) to begin with; leaning postures follow.
            close_m: How near is enough.
        """
        found: list[Balance] = []
        for start in (*postures, *self._starts):
            found.append(self._nearest(place, start, close_m))
            if found[-1].holds(close_m):
                break
        return sorted(found, key=lambda each: each.rank(close_m))

    def _nearest(self, place: FloatArray, angles: FloatArray, close_m: float) -> Balance:
        """Return the equilibrium nearest to a place that is found from a posture (J,)."""
        angles = np.array(angles, dtype=np.float64)
        angles[self.columns] = np.clip(angles[self.columns], *self.limits.T)
        state, (damping, least, most) = _State(self, angles, place), BALANCE.damping
        for _ in range(BALANCE.iterations):
            if state.left_nm <= BALANCE.left_nm and state.gap_m <= 0.5 * close_m:
                break
            slope, tried = state.slope(), state
            for _ in range(BALANCE.tries):
                moved = state.angles[self.columns] + self._step(state, slope, damping)
                changed = state.angles.copy()
                changed[self.columns] = np.clip(moved, *self.limits.T)
                tried = _State(self, changed, place)
                if tried.cost < state.cost:
                    damping = max(0.2 * damping, least)
                    break
                damping = min(8.0 * damping, most)
            gain = state.cost - tried.cost
            if gain <= 0.0:
                break
            state = tried
            if gain < BALANCE.gain * max(tried.cost, BALANCE.small):
                break
        way = np.inf
        if state.left_nm <= BALANCE.left_nm and state.gap_m <= close_m:
            way = self._on_the_way(state.angles)
        return Balance(state.angles, state.gap_m, state.left_nm, way, state.activations)

    def _on_the_way(self, angles: FloatArray) -> float:
        """Largest torque that muscles lack on the straight way from rest to a posture."""
        parts = np.linspace(0.0, 1.0, BALANCE.way_points + 1)[1:, None]
        way = self._rest + parts * (angles - self._rest)
        return max(_State(self, each, np.zeros(3)).left_nm for each in way)

    def _step(self, state: _State, slope: FloatArray, damping: float) -> FloatArray:
        """Return the Levenberg-Marquardt step, (K,); joints stop at their limits."""
        q, (low, high) = state.angles[self.columns], self.limits.T
        free = np.ones(len(q), dtype=bool)
        step = np.zeros(len(q))
        for _ in range(3):
            part = slope[:, free]
            normal = part.T @ part + damping * np.eye(part.shape[1])
            step[:] = 0.0
            step[free] = -np.linalg.solve(normal, part.T @ state.error)
            below = (q + step < low) & (q <= low + _AT_LIMIT)
            out = below | ((q + step > high) & (q >= high - _AT_LIMIT))
            if not (out & free).any():
                break
            free &= ~out
        return step


class _State:
    """A posture with the activations that balance it best.

    Args:
        balancer: The search with its body.
        angles: (J,) of the independent joints.
        place: (3,) desired position of the hand.
    """

    def __init__(self, balancer: Balancer, angles: FloatArray, place: FloatArray) -> None:
        self.angles, self._by = angles, balancer
        found = balancer.mechanics(angles[None])
        # (S, K) torques of the trunk's motors, from the lowest up, and of joints at limits.
        motors = np.diag(balancer.motor_high - balancer.motor_low)
        (low, high), q = balancer.limits.T, angles[balancer.columns]
        stops = (q <= low + _AT_LIMIT).astype(float) - (q >= high - _AT_LIMIT)
        others = np.concatenate([motors[motors.any(axis=1)], np.diag(stops)[stops != 0.0]])
        needed = found.needed[0] - balancer.motor_low
        muscles, pulling = len(found.effects[0]), np.concatenate([found.effects[0], others])
        scale = BALANCE.unit * np.linalg.inv(np.linalg.cholesky(found.inertia))
        ease = BALANCE.unit * BALANCE.ease * np.eye(muscles, len(pulling))
        most = np.ones(len(pulling))
        most[muscles + balancer.motors :] = np.inf
        part = bounded_least_squares(
            np.concatenate([scale @ pulling.T, ease]),
            np.concatenate([scale @ needed, np.zeros(muscles)]),
            most,
        )
        self.activations = part[:muscles]
        left, gap = needed - pulling.T @ part, found.hands[0] - place
        self.left_nm, self.gap_m = float(np.abs(left).max()), float(np.linalg.norm(gap))
        self.error = np.concatenate([scale @ left, gap / BALANCE.place_m])
        self.cost = float(self.error @ self.error)
        self._scale, free = scale, (part > _BOUND) & (part < most - _BOUND)
        self._following = scale @ pulling[free].T

    def slope(self) -> FloatArray:
        """Return the derivatives of unbalanced torques and gap by the angles, (K + 3, K)."""
        k = len(self._by.columns)
        around = np.repeat(self.angles[None], k + 1, axis=0)
        around[1 + np.arange(k), self._by.columns] += _STEP
        found = self._by.mechanics(around)
        left = found.needed - np.einsum("pmk,m->pk", found.effects, self.activations)
        rise = self._scale @ ((left[1:] - left[0]) / _STEP).T
        basis, sizes, _ = np.linalg.svd(self._following, full_matrices=False)
        basis = basis[:, sizes > 1e-6 * sizes.max(initial=1e-3)]
        rise -= basis @ (basis.T @ rise)
        way = (found.hands[1:] - found.hands[0]) / _STEP
        return np.concatenate([rise, way.T / BALANCE.place_m])
