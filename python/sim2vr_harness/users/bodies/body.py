"""Bodies: everything that can be read off a compiled model, and what its parts are for."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.users.bodies.rules import RULES, Muscle

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

DEVICES: tuple[str, ...] = ("headset", "controller_right", "controller_left")
"""Devices that a body can wear, in the order in which they are reported to an app."""


def held(devices: Iterable[str]) -> tuple[str, ...]:
    """Return those of some devices that hands hold."""
    return tuple(name for name in devices if name != "headset")


@dataclass(frozen=True)
class ActuatorGroup:
    """Actuators that are worked by one action rule; see `rules.py`."""

    rule: str
    actuators: tuple[str, ...]


@dataclass(frozen=True)
class Coupling:
    """q_dependent = sum_k coefficients[k] * q_driver^k; no driver means q_dependent = c0.

    Angles in rad (lengths of slides in m).
    """

    dependent: str
    driver: str
    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class ResetRule:
    """Start state of an episode: every independent joint near a posture.

    Attributes:
        posture: start angles (rad, slides m) of joints; 0 for those left out.
        position_range: angles are uniform in +- this about the posture.
        velocity_range: velocities are uniform in +- this (rad/s, slides m/s).
        activation_range: range in which muscles' activations are uniform; [0, 1] in the reference.
        held: position servos whose first target is the angle of their joint; the targets of the
            others are uniform in their range, as in the reference.
        fit_couplings: True: the dependent joints satisfy their couplings at the start; the
            reference starts them at 0 and lets the soft couplings pull (User-in-the-Box).
    """

    posture: Mapping[str, float] = field(default_factory=dict)
    position_range: float = 0.05
    velocity_range: float = 0.05
    activation_range: tuple[float, float] = (0.0, 1.0)
    held: tuple[str, ...] = ()
    fit_couplings: bool = False


@dataclass(frozen=True)
class EffortInputs:
    """Data of a body that the effort models need.

    Attributes:
        lifting: actuators that hold the arm up, for consumed endurance.
        loads: motors whose force relative to its peak causes fatigue, as a muscle's activation
            does.
        peak_forces: peak force (N) or torque (Nm) of actuators whose model does not define it.
    """

    lifting: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    peak_forces: Mapping[str, float] = field(default_factory=dict)


MEAN_IPD_M = 0.063
"""Mean distance of adults' pupils (Dodgson 2004, Variation and extrema of human interpupillary
distance)."""

_JOINT = int(mujoco.mjtEq.mjEQ_JOINT)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def polynomial(coefficients: Sequence[float] | FloatArray, x: Any) -> Any:
    """Return a polynomial, lowest power first; NumPy's takes ten times as long."""
    value = coefficients[-1] + x * 0.0
    for coefficient in coefficients[-2::-1]:
        value = coefficient + value * x
    return value


@dataclass(frozen=True)
class BodyPlan:
    """Roles of the parts of a body.

    Attributes:
        name: name of the body in configurations and results.
        devices: names of the worn devices, from `DEVICES`.
        actuator_groups: groups of actuators; a policy's actions are theirs, in this order.
        end_effectors: sites whose positions the user senses.
        timestep: physics step in s.
        observed_joints: the joints that the user senses; None: the independent ones.
        reset_rule: start state of an episode.
        postures: name -> start angles (rad; slides m) of joints.
        effort_inputs: data for the effort models.
        nod: the hinge that tips the head forward, driven by a position servo; None: no neck.
        ipd_m: interpupillary distance.
        stance: seated or standing; empty: unknown.
        stature_m: body height; None: unknown.
    """

    name: str
    devices: tuple[str, ...]
    actuator_groups: tuple[ActuatorGroup, ...]
    end_effectors: tuple[str, ...]
    timestep: float
    observed_joints: tuple[str, ...] | None = None
    reset_rule: ResetRule = field(default_factory=ResetRule)
    postures: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    effort_inputs: EffortInputs = field(default_factory=EffortInputs)
    nod: str | None = None
    ipd_m: float = MEAN_IPD_M
    stance: str = ""
    stature_m: float | None = None


class Body:
    """A body that wears VR devices: a MuJoCo model and what its parts are for.

    Immutable. Every worn device is a body and a site of the model with the device's name: the body
    has the tracked device's orientation (x forward, y left, z up), the site is the pose that is
    reported to the app.

    Args:
        plan: what the parts of the body are for.
        build: makes a fresh specification, with drawn shapes or without, devices included.
        appearance: whether `spec` and `model` have drawn shapes, lights and cameras.

    Attributes:
        independent_joints: the J hinges and slides that move freely, in model order.

    Raises:
        ValueError: the plan names something that the specification does not have, or an actuator
            cannot follow its rule.
    """

    def __init__(
        self, plan: BodyPlan, build: Callable[[bool], mujoco.MjSpec], appearance: bool = True
    ) -> None:
        self.name = plan.name
        self.devices = plan.devices
        self.actuator_groups = plan.actuator_groups
        self.end_effectors = plan.end_effectors
        self.reset_rule = plan.reset_rule
        self.effort_inputs = plan.effort_inputs
        self.nod = plan.nod
        self.ipd_m, self.stance, self.stature_m = plan.ipd_m, plan.stance, plan.stature_m
        self.timestep = plan.timestep
        self.appearance = appearance
        self._build = build
        self._check(plan)
        model = self.physics_model
        follows = {coupling.dependent for coupling in self.couplings}
        scalar = [i for i in range(model.njnt) if model.jnt_type[i] in _SCALAR]
        self.independent_joints = tuple(
            n for n in (model.joint(i).name for i in scalar) if n not in follows
        )
        # Check that episodes can start in it: joints that move freely, within their limits.
        for name, angle in plan.reset_rule.posture.items():
            if name not in self.independent_joints:
                raise unknown_name("reset.posture", name, self.independent_joints)
            joint = self.physics_model.joint(name)
            low, high = joint.range.tolist() if joint.limited[0] else (-np.inf, np.inf)
            if not low <= angle <= high:
                raise ValueError(
                    f"reset.posture.{name}: got {angle:g}, expected an angle (rad; slides m) "
                    f"within the joint's limits, {low:.4g} to {high:.4g}"
                )
        self.observed_joints = (
            self.independent_joints if plan.observed_joints is None else plan.observed_joints
        )

    def spec(self) -> mujoco.MjSpec:
        """Returns a fresh, editable specification; the caller owns it."""
        return self._made(self.appearance)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model, made once. Shared: do not edit it, edit a `spec()` instead."""
        return self.spec().compile()

    @cached_property
    def physics_model(self) -> mujoco.MjModel:
        """The compiled model without drawn shapes: the same motion, faster to step."""
        return self._made(False).compile()

    def _made(self, appearance: bool) -> mujoco.MjSpec:
        spec = self._build(appearance)
        spec.option.timestep = self.timestep
        return spec

    def _check(self, plan: BodyPlan) -> None:
        model = self.physics_model
        joints = _names(model, "joint", model.njnt)
        actuators = _names(model, "actuator", model.nu)
        sites = _names(model, "site", model.nsite)
        wanted: list[tuple[str, Sequence[str], Sequence[str]]] = [
            ("observed_joints", plan.observed_joints or (), joints),
            ("end_effectors", plan.end_effectors, sites),
            ("devices", plan.devices, sites),
            ("reset held", plan.reset_rule.held, actuators),
            ("nod", (plan.nod,) if plan.nod else (), joints),
            ("effort lifting", plan.effort_inputs.lifting, actuators),
            ("effort loads", plan.effort_inputs.loads, actuators),
            ("effort peak_forces", tuple(plan.effort_inputs.peak_forces), actuators),
            *(("actuators", group.actuators, actuators) for group in plan.actuator_groups),
        ]
        for part, names, known in wanted:
            for name in names:
                if name not in known:
                    raise unknown_name(part, name, known)
        every = self.action_names
        twice = sorted({name for name in every if every.count(name) > 1})
        if twice:
            raise ValueError(f"actuators: got {twice[0]!r} twice, expected each at most once")
        for group in plan.actuator_groups:
            if group.rule not in RULES:
                raise unknown_name("rule", group.rule, RULES)
            RULES[group.rule](model, group.actuators)

    # --- actuators ---------------------------------------------------------------------------

    @cached_property
    def action_names(self) -> tuple[str, ...]:
        """(A,) the actuators in the order of the actions."""
        return tuple(name for group in self.actuator_groups for name in group.actuators)

    @property
    def action_size(self) -> int:
        """A, the number of actions: one per actuator of the groups."""
        return len(self.action_names)

    @cached_property
    def muscles(self) -> tuple[str, ...]:
        """(M,) the actuators with the rule "muscle", in the order of their actions."""
        groups = (g for g in self.actuator_groups if g.rule == Muscle.name)
        return tuple(name for group in groups for name in group.actuators)

    @cached_property
    def peak_forces(self) -> FloatArray:
        """(A,) peak forces in N (torques in Nm) of the actuators; NaN where unknown."""
        forces = np.array([self._peak_force(name) for name in self.action_names])
        forces.flags.writeable = False
        return forces

    def _peak_force(self, name: str) -> float:
        if name in self.effort_inputs.peak_forces:
            return self.effort_inputs.peak_forces[name]
        model, i = self.physics_model, self.physics_model.actuator(name).id
        if model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_MUSCLE:
            return muscle_peak_force(model, i)
        if model.actuator_forcelimited[i]:
            return float(np.abs(model.actuator_forcerange[i]).max())
        return float("nan")

    # --- joints ------------------------------------------------------------------------------

    @cached_property
    def dependent_joints(self) -> tuple[str, ...]:
        """The joints that follow by couplings, in model order."""
        follows = {coupling.dependent for coupling in self.couplings}
        names = _names(self.physics_model, "joint", self.physics_model.njnt)
        return tuple(name for name in names if name in follows)

    @cached_property
    def qpos_independent(self) -> IntArray:
        """(J,) addresses of the independent joints in qpos."""
        return self._addresses(self.independent_joints, "qposadr")

    @cached_property
    def qvel_independent(self) -> IntArray:
        """(J,) addresses of the independent joints in qvel and qacc."""
        return self._addresses(self.independent_joints, "dofadr")

    @cached_property
    def qpos_dependent(self) -> IntArray:
        """(D,) addresses of the dependent joints in qpos."""
        return self._addresses(self.dependent_joints, "qposadr")

    @cached_property
    def qvel_dependent(self) -> IntArray:
        """(D,) addresses of the dependent joints in qvel and qacc."""
        return self._addresses(self.dependent_joints, "dofadr")

    @cached_property
    def qpos_observed(self) -> IntArray:
        """Addresses of the observed joints in qpos."""
        return self._addresses(self.observed_joints, "qposadr")

    @cached_property
    def qvel_observed(self) -> IntArray:
        """Addresses of the observed joints in qvel and qacc."""
        return self._addresses(self.observed_joints, "dofadr")

    @cached_property
    def joint_ranges(self) -> FloatArray:
        """(J, 2) lower and upper limits of the independent joints in rad (slides m).

        A joint without limits counts as one of +-pi rad (+-1 m).
        """
        return self._ranges(self.independent_joints)

    @cached_property
    def observed_ranges(self) -> FloatArray:
        """Ranges of the observed joints."""
        return self._ranges(self.observed_joints)

    @cached_property
    def couplings(self) -> tuple[Coupling, ...]:
        """Couplings of the dependent joints, sorted so that drivers come first."""
        model = self.physics_model
        found: dict[str, Coupling] = {}
        for i in range(model.neq):
            if model.eq_type[i] == _JOINT and model.eq_active0[i]:
                # Reads an equality of joints; MuJoCo's polynomial is about the reference angles.
                dependent, driver = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
                coefficients = np.array(model.eq_data[i, :5])
                if driver < 0:
                    coefficients[1:] = 0.0
                start = float(model.qpos0[model.jnt_qposadr[dependent]])
                about = float(model.qpos0[model.jnt_qposadr[driver]]) if driver >= 0 else 0.0
                if about:
                    shifted = np.polynomial.Polynomial(coefficients)(
                        np.polynomial.Polynomial([-about, 1.0])
                    )
                    coefficients = np.resize(np.append(shifted.coef, np.zeros(5)), 5)
                coefficients[0] += start
                coupling = Coupling(
                    dependent=model.joint(dependent).name,
                    driver=model.joint(driver).name if driver >= 0 else "",
                    coefficients=tuple(coefficients.tolist()),
                )
                found[coupling.dependent] = coupling
        ordered: dict[str, Coupling] = {}
        while found:
            ready = [name for name, coupling in found.items() if coupling.driver not in found]
            if not ready:
                raise ValueError(f"couplings: got a circle of {sorted(found)}, expected none")
            ordered |= {name: found.pop(name) for name in ready}
        return tuple(ordered.values())

    def coupled_qpos(self, q_independent: NDArray[np.floating]) -> FloatArray:
        """Fills in the dependent joints from their couplings.

        Args:
            q_independent: (..., J) rad, in the order of `independent_joints`.

        Returns:
            (..., nq) full posture that satisfies every coupling exactly; joints that are neither
            (balls, free joints) are where the model has them.

        Raises:
            ValueError: the last axis does not have one entry per independent joint.
        """
        q = np.asarray(q_independent, dtype=np.float64)
        if q.ndim == 0 or q.shape[-1] != len(self.independent_joints):
            raise ValueError(
                f"q_independent: got shape {q.shape}, expected (..., "
                f"{len(self.independent_joints)}), one angle per independent joint"
            )
        full = np.empty((*q.shape[:-1], self.physics_model.nq))
        full[:] = self.physics_model.qpos0
        full[..., self.qpos_independent] = q
        address = self._qpos_address
        # A single posture in Python's numbers, which are the same and ten times as fast.
        angles: Any = full.tolist() if q.ndim == 1 else np.moveaxis(full, -1, 0)
        for coupling in self.couplings:
            driver = angles[address[coupling.driver]] if coupling.driver else 0.0
            angles[address[coupling.dependent]] = polynomial(coupling.coefficients, driver)
        return np.array(angles) if q.ndim == 1 else full

    @cached_property
    def _qpos_address(self) -> Mapping[str, int]:
        names = self.independent_joints + self.dependent_joints
        return {name: int(self.physics_model.joint(name).qposadr[0]) for name in names}

    def _ranges(self, joints: Sequence[str]) -> FloatArray:
        model = self.physics_model
        ranges = []
        for name in joints:
            joint = model.joint(name)
            widest = 1.0 if joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE else np.pi
            limited = bool(model.jnt_limited[joint.id])
            ranges.append(joint.range if limited else np.array([-widest, widest]))
        return np.array(ranges).reshape(-1, 2)

    def _addresses(self, joints: Sequence[str], field: str) -> IntArray:
        table = self.physics_model.joint
        found = np.array([int(getattr(table(j), field)[0]) for j in joints], dtype=np.int64)
        found.flags.writeable = False
        return found

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, devices={self.devices})"


def muscle_peak_force(model: mujoco.MjModel, i: int) -> float:
    """Peak isometric force of muscle i in N; MuJoCo derives it from acc0 where none is given."""
    given, scale = model.actuator_gainprm[i, 2:4]
    return float(given if given >= 0.0 else scale / max(model.actuator_acc0[i], 1e-15))


def _names(model: mujoco.MjModel, kind: str, count: int) -> list[str]:
    return [getattr(model, kind)(i).name for i in range(count)]
