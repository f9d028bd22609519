"""Exertion as people rate it: endurance of the shoulder by load, and two measures of arm fatigue.

Sources:

- Consumed Endurance: Hincapie-Ramos, Guo, Moghadasian, Irani (CHI 2014). Constants as in the
  authors' published code.
- NICER: Li et al. (ACM Trans. Graph. 43, 4, 2024). Constants as in the authors' published code.
- Endurance of the shoulder: Frey-Law and Avin (2010), the curve that NICER uses.
- Strength of the shoulder by posture: Chaffin, Andersson, Martin (2006), as NICER quotes it.
- 3CC-r: Looft, Herkert, Frey-Law (2018), held at a constant load.

Angles are in degrees, torques in Nm, times in s; arrays broadcast.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.users.bodies.body import Body

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ExertionSettings:
    """Published constants of endurance and of the measures of fatigue."""

    endurance_s: float = 14.86
    endurance_power: float = 1.83
    """Shoulders hold a share f ``endurance_s f^-endurance_power`` s (Frey-Law and Avin 2010)."""
    corrected_from_deg: tuple[float, float] = (90.0, 145.0)
    """NICER: least angles of shoulder and elbow at which the torque is corrected."""
    resting_deg: tuple[float, float] = (25.0, 125.0)
    """NICER: an arm rests with the shoulder up to the first and the elbow from the second on."""
    recovery_per_s: float = 0.04
    """NICER: with which the value decays at rest."""
    gravity_mps2: float = 9.8
    """Consumed Endurance: in the weight of the arm."""


EXERTION = ExertionSettings()


@dataclass(frozen=True)
class Strength:
    """Strength of an arm.

    Attributes:
        man: (N,) or one; True: men's published constants, False: women's.
        factor: (N,) or one: factor on the torques, the strength relative to the median of the sex.
    """

    man: ArrayLike = True
    factor: ArrayLike = 1.0

    def shoulder_torque(self, shoulder_deg: ArrayLike, elbow_deg: ArrayLike) -> FloatArray:
        """Return the largest torque at the shoulder in a posture, Nm (Chaffin et al.)."""
        scale = np.where(self.man, 0.2845, 0.1495)
        torque = 227.338 + 0.525 * np.asarray(elbow_deg) - 0.296 * np.asarray(shoulder_deg)
        return np.asarray(torque * scale * np.asarray(self.factor), dtype=np.float64)

    @property
    def consumed_endurance_torque(self) -> FloatArray:
        """The torque that Consumed Endurance counts as the maximum, in every posture, Nm.

        A force at the elbow times the upper arm, less the weight of the outstretched arm.
        """
        men = _consumed_endurance_torque(101.6, (0.33, 0.269, 0.191), (2.1, 1.2, 0.4))
        women = _consumed_endurance_torque(87.2, (0.31, 0.234, 0.183), (1.7, 1.0, 0.4))
        torque = np.where(self.man, men, women) * np.asarray(self.factor)
        return np.asarray(torque, dtype=np.float64)


def _consumed_endurance_torque(
    force: float, lengths: tuple[float, float, float], masses: tuple[float, float, float]
) -> float:
    upper, fore, hand = lengths
    arms = (0.452 * upper, upper + 0.424 * fore, upper + fore + 0.397 * hand)
    return force * upper - EXERTION.gravity_mps2 * sum(
        m * arm for m, arm in zip(masses, arms, strict=True)
    )


def endurance_time(share: ArrayLike) -> FloatArray:
    """Return how long people's shoulders hold a share of their maximum, s.

    ``14.86 share^-1.83``, from 194 publications (Frey-Law and Avin 2010); endless at 0.
    """
    share = np.asarray(share, dtype=np.float64)
    with np.errstate(divide="ignore"):
        return np.asarray(EXERTION.endurance_s * share**-EXERTION.endurance_power)


def consumed_endurance_time(share: ArrayLike) -> FloatArray:
    """Return the endurance of Consumed Endurance, s: endless up to .15 of the maximum.

    ``1236.5 / (100 share - 15)^0.618 - 72.5``, Rohmert's curve; at least 0, beyond the maximum.
    """
    percent = 100.0 * np.asarray(share, dtype=np.float64) - 15.0
    tiring = percent > 0.0
    time = 1236.5 / np.where(tiring, percent, 1.0) ** 0.618 - 72.5
    return np.where(tiring, np.maximum(time, 0.0), np.inf)


def fatigue_endurance_time(share: ArrayLike, fatigue: float, recovery: float) -> FloatArray:
    """Return how long 3CC-r holds a share of the maximum, s; endless where recovery keeps up.

    As long as a load f is met, fatigued units follow dMF/dt = F f - R MF. It can no longer be met
    when they are 1 - f: after ``-ln(1 - (1 - f) R / (F f)) / R``.

    Args:
        share: f.
        fatigue: F, 1/s.
        recovery: R, 1/s.
    """
    share = np.asarray(share, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        if recovery == 0.0:
            time = (1.0 - share) / (fatigue * share)
        else:
            left = 1.0 - (1.0 - share) * recovery / (fatigue * share)
            time = np.where(left > 0.0, -np.log(left) / recovery, np.inf)
    return np.where(share <= 0.0, np.inf, np.maximum(time, 0.0))


def nicer_correction(
    shoulder_deg: ArrayLike, elbow_deg: ArrayLike, man: ArrayLike = True
) -> FloatArray:
    """Return what NICER adds to the torque of a raised, outstretched arm, Nm.

    Gravity's torque falls above 90 degrees, the measured activity of the muscles does not.

    Args:
        shoulder_deg: between upper arm and straight down: 90 is horizontal.
        elbow_deg: between upper arm and forearm: 180 is outstretched.
        man: whether men's constants count, or women's.
    """
    shoulder, elbow = np.asarray(shoulder_deg), np.asarray(elbow_deg)
    gain, slope = np.where(man, 1230.0, 1005.0), np.where(man, 0.09, 0.11)
    activity = 0.0095 * gain / (1.0 + np.exp((66.40 - shoulder) / 7.83))
    raised = (shoulder >= EXERTION.corrected_from_deg[0]) & (
        elbow >= EXERTION.corrected_from_deg[1]
    )
    return np.where(raised, activity - np.sin(np.radians(shoulder)) / slope, 0.0)


class ConsumedEnduranceMeter:
    """Consumed Endurance of N arms: elapsed time as a percentage of the endurance.

    The endurance is that of the mean torque since the start; nothing recovers.

    Args:
        n: number of arms N.
        strength: how strong they are.
    """

    def __init__(self, n: int, strength: Strength | None = None) -> None:
        self._strength = strength or Strength()
        self._impulse, self._time = np.zeros((2, n))

    def update(self, torque: FloatArray, dt: float) -> None:
        """Add steps: (N,) or (T, N) torques at the shoulder, Nm, that acted for ``dt`` s each."""
        for impulse in np.reshape(torque * dt, (-1, len(self._time))):
            self._impulse += impulse
            self._time += dt

    @property
    def value(self) -> FloatArray:
        """(N,) per cent; 100 is exhaustion. 0 before the first step."""
        mean = self._impulse / np.maximum(self._time, 1e-12)
        share = mean / self._strength.consumed_endurance_torque
        with np.errstate(divide="ignore"):
            return np.asarray(100.0 * self._time / consumed_endurance_time(share))


class NicerMeter:
    """NICER of N arms: elapsed time as a percentage of the endurance, with recovery at rest.

    The endurance is that of the mean corrected torque as a share of the strength in the present
    posture. At rest the value decays by 0.04/s; afterwards the mean torque is the one whose
    value that is.

    Args:
        n: number of arms N.
        strength: how strong they are.
    """

    def __init__(self, n: int, strength: Strength | None = None) -> None:
        self._strength = strength or Strength()
        self._rested_value, self._mean, self._time = np.zeros((3, n))
        self._maximum = np.ones(n)
        self._rested = np.zeros(n, dtype=bool)

    def update(
        self, torque: FloatArray, shoulder_deg: FloatArray, elbow_deg: FloatArray, dt: float
    ) -> None:
        """Add a step, or T steps.

        Args:
            torque: (N,) or (T, N) at the shoulder, Nm.
            shoulder_deg, elbow_deg: the same shape, as of `nicer_correction`.
            dt: duration of a step in s.
        """
        shape = (-1, len(self._time))
        torque, shoulder, elbow = (
            np.reshape(each, shape) for each in (torque, shoulder_deg, elbow_deg)
        )
        resting = (shoulder <= EXERTION.resting_deg[0]) & (elbow >= EXERTION.resting_deg[1])
        corrected = torque + nicer_correction(shoulder, elbow, self._strength.man)
        maximum = self._strength.shoulder_torque(shoulder, elbow)
        for step in zip(resting, corrected * dt, maximum, strict=True):
            self._add(*step, dt)

    def _add(
        self, resting: NDArray[np.bool_], impulse: FloatArray, maximum: FloatArray, dt: float
    ) -> None:
        before, mean = self._time, self._mean
        time = before + dt
        if self._rested.any():
            value = self._rested_value / 100.0
            with np.errstate(divide="ignore", invalid="ignore"):
                share = (before / value / EXERTION.endurance_s) ** (-1.0 / EXERTION.endurance_power)
            resumed = np.where(value > 0.0, share * self._maximum, 0.0)
            mean = np.where(self._rested, resumed, mean)
        mean = (impulse + mean * before) / time
        if resting.any():
            decayed = self.value * np.exp(-EXERTION.recovery_per_s * dt)
            self._rested_value = np.where(resting, decayed, self._rested_value)
            mean = np.where(resting, self._mean, mean)
            maximum = np.where(resting, self._maximum, maximum)
        self._mean, self._maximum, self._time, self._rested = mean, maximum, time, resting

    @property
    def value(self) -> FloatArray:
        """(N,) per cent; 100 is exhaustion. 0 before the first step."""
        active = 100.0 * self._time / endurance_time(self._mean / self._maximum)
        return np.where(self._rested, self._rested_value, active)


@dataclass(frozen=True)
class Arm:
    """An arm that holds a controller; names of the model's bodies.

    Attributes:
        side: ``right`` or ``left``.
        upper_arm: whose origin is the centre of the shoulder.
        forearm: whose origin is the elbow.
        wrist: whose origin is the wrist.
    """

    side: str
    upper_arm: str
    forearm: str
    wrist: str

    @property
    def device(self) -> str:
        """Name of the controller that the arm holds."""
        return f"controller_{self.side}"


def arms_of(body: Body) -> tuple[Arm, ...]:
    """Return the arms of a body, right before left.

    An arm is a chain of bodies up from a controller, in which the upper arm is called
    ``humerus...``, the forearm ``ulna...`` and ``radius...``, as in OpenSim's models; a controller
    without them has none.
    """
    found = []
    for side in ("right", "left"):
        if f"controller_{side}" not in body.devices:
            continue
        site = f"controller_{side}"
        names, part = [], int(body.physics_model.site(site).bodyid[0])
        while part:
            names.append(body.physics_model.body(part).name)
            part = int(body.physics_model.body_parentid[part])
        chain = names
        upper = [name for name in chain if name.startswith("humerus")]
        fore = [name for name in chain if name.startswith("ulna")]
        bones = [i for i, name in enumerate(chain) if name.startswith(("ulna", "radius"))]
        if upper and fore and bones and bones[0] > 0:
            found.append(Arm(side, upper[0], fore[0], chain[bones[0] - 1]))
    return tuple(found)


@dataclass(frozen=True)
class ArmLoad:
    """Load and posture of an arm at one time.

    Attributes:
        torque: magnitude of the moment at the shoulder, Nm.
        shoulder_deg: angle between upper arm and straight down.
        elbow_deg: angle between upper arm and forearm; 180: outstretched.
    """

    torque: float
    shoulder_deg: float
    elbow_deg: float


class ArmDynamics:
    """Inverse dynamics of arms: of each, everything from the humerus to the controller.

    The moment is the one between the segments, of weight and acceleration.
    Contacts that support the arm are not subtracted.

    Args:
        model: of the body.
        arms: A of them.
    """

    def __init__(self, model: mujoco.MjModel, *arms: Arm) -> None:
        self._model, self._arms = model, arms
        self._data = data = mujoco.MjData(model)
        self._motion = (data.qpos, data.qvel, data.qacc)
        self._told: list[FloatArray] = []
        for arm in arms:
            parts = [model.body(part).id for part in (arm.upper_arm, arm.forearm, arm.wrist)]
            # A wrench about the centre of mass of the whole tree: torque, then force. Live arrays.
            self._told += [data.cfrc_int[parts[0]], data.subtree_com[model.body_rootid[parts[0]]]]
            self._told += [data.xpos[part] for part in parts]

    def moments(self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> FloatArray:
        """Return a moment of motion as :func:`arm_loads` takes it, (A, 18).

        Args:
            qpos: (nq,) angles, rad.
            qvel: (nv,) rad/s.
            qacc: (nv,) rad/s^2.
        """
        model, data = self._model, self._data
        for live, given in zip(self._motion, (qpos, qvel, qacc), strict=True):
            live[:] = given
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        return np.concatenate(self._told).reshape(len(self._arms), 18)

    def load(
        self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray, *, held_kg: float = 0.0
    ) -> ArmLoad:
        """Return torque and posture of the first arm.

        ``held_kg`` more hang from the controller, at rest.
        """
        moment = self.moments(qpos, qvel, qacc)[0]
        shoulder, hand = moment[9:12], self._data.site(self._arms[0].device).xpos
        moment[:3] -= np.cross(hand - shoulder, held_kg * self._model.opt.gravity)
        return ArmLoad(*map(float, arm_loads(moment)))


def arm_loads(moments: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what arms do at moments, as the attributes of :class:`ArmLoad`, (...) each.

    Args:
        moments: (..., 18) torque, force, the point that they act about, shoulder, elbow and wrist.
    """
    torque, force, about, shoulder, elbow, wrist = np.moveaxis(
        np.reshape(moments, (*np.shape(moments)[:-1], 6, 3)), -2, 0
    )
    total = torque + np.cross(about - shoulder, force)
    upper = elbow - shoulder
    down = np.array([0.0, 0.0, -1.0])
    return (
        np.linalg.norm(total, axis=-1),
        _angle(upper, down),
        180.0 - _angle(upper, wrist - elbow),
    )


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    cosine = (a * b).sum(axis=-1) / np.maximum(lengths, 1e-12)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
