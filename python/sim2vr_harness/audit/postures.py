"""Postures that arms hold: activations, torques and the time until exhaustion.

The largest muscle activation is made as small as possible while all joints of the arm are in
equilibrium: static optimisation by the min/max criterion (Rasmussen, Damsgaard, Voigt 2001).
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
from sim2vr_harness.users.bodies.moments import moment_arms
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

FloatArray = NDArray[np.float64]

_STEP = 1e-6
_NO_MOMENT = 1e-6
"""Nm at full activation below which a muscle does not move a joint."""
_SPARING = 1e-6
"""Weight of the sum of activations beside the largest: of equal optima the least is taken."""
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
            1, the muscles are too weak. Without muscles ``strength_share``. None: no muscles'
            forces balance the posture, however strong they were.
        strength_share: the torque as a share of people's published strength in this posture.
        activations: of the arm's muscles.
        endurance_s: seconds until exhaustion by model; infinite: endless.
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
    """Return the user alone, or as many persons of its population, with their strength.

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
        user: whose body and muscles count.
        pose: as of :func:`posture_of`.
        load_kg: mass in each hand, beside the controller's.
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
    values = vars(held)
    times = values["endurance_s"]
    finite_times = {name: time if time < float("inf") else None for name, time in times.items()}
    return {**values, "endurance_s": finite_times}


def told(arms: Sequence[Held], load_kg: float) -> list[str]:
    """Return lines on the same arm of one or several persons."""
    first = arms[0]
    many = f", {len(arms)} persons: median (least to most)" if len(arms) > 1 else ""
    lines = [
        f"{first.side.capitalize()} arm, shoulder {first.shoulder_deg:.0f}, elbow "
        f"{first.elbow_deg:.0f} degrees, {load_kg:g} kg in the hand{many}"
    ]
    shares = [float("inf") if arm.share is None else arm.share for arm in arms]
    rows = {
        "torque at the shoulder (Nm)": _spread([arm.torque_nm for arm in arms], 1),
        "share of maximum at the shoulder": _spread(shares, 2, "too weak"),
        "share of published strength": _spread([arm.strength_share for arm in arms], 2),
    }
    for name in first.endurance_s:
        times = [arm.endurance_s[name] for arm in arms]
        rows[f"exhausted by {name} (s)"] = _spread(times, 0, "endless")
    lines += [f"  {label:40} {text}" for label, text in rows.items()]
    if len(arms) == 1 and first.activations:
        most = sorted(first.activations.items(), key=lambda item: -item[1])[:4]
        lines.append("  most active: " + ", ".join(f"{name} {x:.2f}" for name, x in most))
    return lines


def _spread(values: list[float], digits: int, infinite: str = "") -> str:
    """The median, with the extremes of several."""

    def text(value: float) -> str:
        return infinite if value == float("inf") else f"{value:.{digits}f}"

    ordered = sorted(values)
    middle, even = divmod(len(ordered), 2)
    median = ordered[middle] if even else (ordered[middle - 1] + ordered[middle]) / 2.0
    if len(ordered) == 1:
        return text(median)
    return f"{text(median)} ({text(ordered[0])} to {text(ordered[-1])})"


class PostureHolder:
    """Holds postures with one arm of a body.

    Passive forces of joints and muscles count; dependent joints follow their couplings.

    Args:
        body: Whose muscles count.
        arm: Of that body.
    """

    def __init__(self, body: Body, arm: Arm) -> None:
        model = body.physics_model
        self._body, self._arm, self._model = body, arm, model
        self._data = mujoco.MjData(model)
        self._dynamics, self._still = ArmDynamics(model, arm), np.zeros(model.nv)
        self._sites = [model.site(each.device).id for each in arms_of(body)]
        self._actuators = np.array([model.actuator(name).id for name in body.muscles], dtype=int)
        joints, moved = body.independent_joints, Linkage(body, Point(arm.device)).joints
        over, of_elbow = Linkage(body, Point(arm.forearm)).joints, _joints_of(model, arm.forearm)
        self._moved = np.array([joint in moved for joint in joints])
        self._above = np.array([joint in over and joint not in of_elbow for joint in joints])

    def load(self, angles: FloatArray, load_kg: float) -> ArmLoad:
        """Return torque and posture of the arm.

        Args:
            angles: (J,) of the independent joints, rad.
            load_kg: Mass in the hand, beside the controller's.
        """
        qpos = self._body.coupled_qpos(angles)
        return self._dynamics.load(qpos, self._still, self._still, held_kg=load_kg)

    def torques(self, angles: FloatArray) -> FloatArray:
        """Return gravity's torques at the joints, (nv,), which they have to balance."""
        data = self._data
        data.qpos[:], data.qvel[:] = self._body.coupled_qpos(angles), 0.0
        mujoco.mj_fwdPosition(self._model, data)
        mujoco.mj_fwdVelocity(self._model, data)
        return np.array(data.qfrc_bias)

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
            load_kg: Mass in the hand, beside the controller's.
            strength: For the published strength of the shoulder.
            limits_bear: Whether a joint at its limit rests there, without muscles.
            muscle_strength: Factor on the forces of the body's muscles beyond those at rest.
        """
        load = self.load(angles, load_kg)
        maximum = strength.shoulder_torque(load.shoulder_deg, load.elbow_deg)
        corrected = load.torque + nicer_correction(load.shoulder_deg, load.elbow_deg, strength.man)
        own: float | None = float(load.torque / maximum)
        activations: dict[str, float] = {}
        balance = self._balance(angles, load_kg, limits_bear, muscle_strength)
        if balance.muscles:
            own, activations = balance.solve()
        times = {
            f"3CC-r, {name}": 0.0
            if own is None
            else float(fatigue_endurance_time(own, rates["fatigue"], rates["recovery"]))
            for name, rates in FATIGUE_PRESETS.items()
        }
        consumed = load.torque / strength.consumed_endurance_torque
        times["NICER"] = float(endurance_time(corrected / maximum))
        times["Consumed Endurance"] = float(consumed_endurance_time(consumed))
        return Held(
            self._arm.side,
            load.torque,
            load.shoulder_deg,
            load.elbow_deg,
            own,
            float(load.torque / maximum),
            activations,
            times,
        )

    def _balance(
        self, angles: FloatArray, load_kg: float, limits_bear: bool, strength: float
    ) -> _Balance:
        body, model, data = self._body, self._model, self._data
        # (nv, J) how all joints follow the independent ones; all are hinges or slides.
        by = _STEP * np.eye(len(angles))
        rise: FloatArray = body.coupled_qpos(angles + by) - body.coupled_qpos(angles - by)
        slope = rise.T / (2.0 * _STEP)
        needed = self.torques(angles) - data.qfrc_passive
        for site in self._sites:
            push = np.zeros((3, model.nv))
            mujoco.mj_jacSite(model, data, push, None, site)
            needed = needed - load_kg * model.opt.gravity @ push
        data.act[:] = 0.0
        mujoco.mj_fwdActuation(model, data)
        passive, slack = np.array(data.qfrc_actuator), np.array(data.actuator_force)
        data.act[:] = 1.0
        mujoco.mj_fwdActuation(model, data)
        moments = moment_arms(model, data)
        forces = (data.actuator_force - slack)[self._actuators, None]
        effects = strength * (forces * moments[self._actuators]) @ slope
        at_limits = np.abs(angles[:, None] - body.joint_ranges) < _AT_LIMIT
        stops = at_limits @ np.array([1.0, -1.0]) * limits_bear
        pulled = np.abs(effects).max(axis=0, initial=0.0) > _NO_MOMENT
        rows = self._moved & pulled
        moving = np.abs(effects[:, rows]).max(axis=1, initial=0.0) > _NO_MOMENT
        crosses = np.abs(effects[:, rows & self._above]).max(axis=1, initial=0.0) > _NO_MOMENT
        return _Balance(
            tuple(name for name, moves in zip(body.muscles, moving, strict=True) if moves),
            effects[moving][:, rows],
            crosses[moving],
            (slope.T @ (needed - passive))[rows],
            np.diag(stops)[rows][:, rows & (stops != 0.0)],
        )


@dataclass(frozen=True)
class _Balance:
    """Equilibrium of an arm: what its joints need, and what each muscle can do.

    Attributes:
        muscles: M, that move the arm.
        effects: (M, R) on its joints, Nm.
        shoulder: (M,) whether they cross the shoulder.
        needed: (R,) Nm.
        stops: (R, S) directions in which joints rest at their limits.
    """

    muscles: tuple[str, ...]
    effects: FloatArray
    shoulder: NDArray[np.bool_]
    needed: FloatArray
    stops: FloatArray

    def solve(self) -> tuple[float | None, dict[str, float]]:
        """Return the least largest activation of the shoulder's muscles, and all activations.

        Muscles that do not cross the shoulder go up to 1. None: nothing balances the arm.
        """
        n, stops = len(self.muscles), self.stops.shape[1]
        bounds = [(0.0, None if crosses else 1.0) for crosses in self.shoulder]
        bounds += [(0.0, None)] * (1 + stops)
        shoulder = self.shoulder.astype(float)
        found = linprog(
            np.r_[np.full(n, _SPARING), 1.0, np.zeros(stops)],
            A_ub=np.c_[np.diag(shoulder), -shoulder, np.zeros((n, stops))],
            b_ub=np.zeros(n),
            A_eq=np.c_[self.effects.T, np.zeros(self.effects.shape[1]), self.stops],
            b_eq=self.needed,
            bounds=bounds,
        )
        if found.x is None:
            return None, {}
        values = found.x.tolist()
        return values[n], dict(zip(self.muscles, values, strict=False))


def _joints_of(model: mujoco.MjModel, part: str) -> list[str]:
    found = model.body(part)
    first, count = int(found.jntadr[0]), int(found.jntnum[0])
    return [model.joint(j).name for j in range(first, first + count)]
