"""Interface of bodies: one protocol, and its plain data."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

DEVICES: tuple[str, ...] = ("headset", "controller_right", "controller_left")
"""What a body can wear, in the order in which it is reported to an app."""


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
    """How an episode starts: every independent joint near a posture.

    Attributes:
        posture: angles (rad, slides m) of joints to start near; 0 for those left out.
        position_range: angles are uniform in +- this about the posture.
        velocity_range: velocities are uniform in +- this (rad/s, slides m/s).
        activation_range: muscles' activations are uniform in it; [0, 1] in the reference.
        held: position servos that begin aiming at the angle that their joint has; the targets of
            the others are uniform in their range, as in the reference.
        fit_couplings: whether the dependent joints follow their couplings at the start; the
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
    """What the effort models need to know of a body.

    Attributes:
        lifting: actuators that hold the arm up, for consumed endurance.
        loads: motors whose share of their peak force tires as a muscle's activation does.
        peak_forces: peak force (N) or torque (Nm) of actuators that do not say so themselves.
    """

    lifting: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    peak_forces: Mapping[str, float] = field(default_factory=dict)


class Body(Protocol):
    """A body that wears VR devices: a MuJoCo model and what its parts are for.

    Immutable. Every worn device is a body and a site of the model with the device's name: the body
    has the tracked device's orientation (x forward, y left, z up), the site is the pose that is
    reported to the app. `SpecBody` has everything but the specification itself.

    Attributes:
        name: what configurations and results call it.
        appearance: whether `spec` and `model` have drawn shapes, lights and cameras.
        devices: names of the worn devices, from `DEVICES`.
        actuator_groups: groups of actuators; a policy's actions are theirs, in this order.
        independent_joints: the J hinges and slides that move freely, in model order.
        observed_joints: the joints that the user senses.
        end_effectors: sites whose positions the user senses.
        reset_rule: how an episode starts.
        effort_inputs: what the effort models need.
        nod: the hinge that tips the head forward, worked by a position servo; None: no neck.
        ipd_m: distance of the pupils.
        timestep: physics step in s.
    """

    name: str
    appearance: bool
    devices: tuple[str, ...]
    actuator_groups: tuple[ActuatorGroup, ...]
    independent_joints: tuple[str, ...]
    observed_joints: tuple[str, ...]
    end_effectors: tuple[str, ...]
    reset_rule: ResetRule
    effort_inputs: EffortInputs
    nod: str | None
    ipd_m: float
    timestep: float

    def spec(self) -> mujoco.MjSpec:
        """Returns a fresh, editable specification; the caller owns it."""

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model. Shared: do not edit it, edit a `spec()` instead."""

    @property
    def physics_model(self) -> mujoco.MjModel:
        """The compiled model without drawn shapes, faster to step."""

    @property
    def action_size(self) -> int:
        """A, the number of actions: one per actuator of the groups."""

    @property
    def action_names(self) -> tuple[str, ...]:
        """(A,) the actuators in the order of the actions."""

    @property
    def muscles(self) -> tuple[str, ...]:
        """(M,) the actuators with the rule "muscle", in the order of their actions."""

    @property
    def peak_forces(self) -> FloatArray:
        """(A,) peak forces in N (torques in Nm) of the actuators; NaN where unknown."""

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """How dependent joints follow, drivers before what they drive."""

    @property
    def joint_ranges(self) -> FloatArray:
        """(J, 2) lower and upper limits of the independent joints in rad (slides m)."""

    @property
    def observed_ranges(self) -> FloatArray:
        """The same of the observed joints."""

    @property
    def qpos_independent(self) -> IntArray:
        """(J,) addresses of the independent joints in qpos."""

    @property
    def qvel_independent(self) -> IntArray:
        """(J,) addresses of the independent joints in qvel and qacc."""

    @property
    def qpos_observed(self) -> IntArray:
        """Addresses of the observed joints in qpos."""

    @property
    def qvel_observed(self) -> IntArray:
        """Addresses of the observed joints in qvel and qacc."""

    def coupled_qpos(self, q_independent: NDArray[np.floating]) -> FloatArray:
        """Returns (..., nq) postures that satisfy the couplings, of (..., J) independent joints."""
