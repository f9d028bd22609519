"""A simulated user: body model, muscles and worn VR hardware, by name."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import appearance as looks
from sim2vr_harness.users.model import build_spec
from sim2vr_harness.users.tables import (
    CouplingRow,
    DeviceRow,
    ModelTables,
    load_device_rows,
    load_model_tables,
)

HEAD_10_DEG_DOWN_WXYZ: tuple[float, float, float, float] = (0.9961947, 0.0, 0.0, -0.0871557)
"""Skull in thorax, looking 10 degrees down: the SIM2VR paper's Whac-A-Mole user."""

DEFAULT_HARDWARE: tuple[str, ...] = ("headset", "controller_right")

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]


class User:
    """A body model with muscles and VR devices. Immutable; make one with `load_user`.

    Attributes:
        name: registry name, e.g. "mobl_arms_wrist".
        hardware: names of the worn devices; each is a body and a site of the model.
        independent_joints: the 7 joints that muscles move freely, in model order.
        dependent_joints: the 14 joints that follow by couplings, in model order.
        muscles: the 32 muscles in actuator order.
        peak_forces: (M,) peak isometric forces in N.
        end_effector: site at the tip of the index finger.
    """

    def __init__(
        self,
        name: str,
        tables: ModelTables,
        devices: Sequence[DeviceRow],
        skull_rotation_wxyz: Sequence[float] | None,
        appearance: bool,
        timestep_s: float | None = None,
    ) -> None:
        self.name = name
        self.hardware = tuple(device.name for device in devices)
        self.independent_joints = tuple(j.name for j in tables.joints if j.independent)
        self.dependent_joints = tuple(j.name for j in tables.joints if not j.independent)
        self.muscles = tuple(muscle.name for muscle in tables.muscles)
        self.peak_forces: FloatArray = np.array([m.peak_force for m in tables.muscles])
        self.peak_forces.flags.writeable = False
        self.end_effector: str = tables.settings["end_effector"]["name"]
        self.timestep: float = tables.settings["timestep_s"] if timestep_s is None else timestep_s
        self.appearance = appearance
        self._tables = tables
        self._devices = tuple(devices)
        self._skull_rotation_wxyz = skull_rotation_wxyz

    def spec(self) -> mujoco.MjSpec:
        """Returns a fresh, editable specification; the caller owns it."""
        spec = build_spec(self._tables, self._devices, self._skull_rotation_wxyz)
        spec.option.timestep = self.timestep
        if self.appearance:
            looks.dress(spec, self._tables, self._devices)
        return spec

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model, made once. Shared: do not edit it, edit a `spec()` instead."""
        return self.spec().compile()

    @cached_property
    def physics_model(self) -> mujoco.MjModel:
        """The compiled model without drawn shapes: the same motion to the bit, faster to step."""
        spec = build_spec(self._tables, self._devices, self._skull_rotation_wxyz)
        spec.option.timestep = self.timestep
        return spec.compile()

    @cached_property
    def qpos_independent(self) -> IntArray:
        """(7,) addresses of the independent joints in qpos."""
        return self._addresses(self.independent_joints, "qposadr")

    @cached_property
    def qvel_independent(self) -> IntArray:
        """(7,) addresses of the independent joints in qvel and qacc."""
        return self._addresses(self.independent_joints, "dofadr")

    @cached_property
    def qpos_dependent(self) -> IntArray:
        """(14,) addresses of the dependent joints in qpos."""
        return self._addresses(self.dependent_joints, "qposadr")

    @cached_property
    def qvel_dependent(self) -> IntArray:
        """(14,) addresses of the dependent joints in qvel and qacc."""
        return self._addresses(self.dependent_joints, "dofadr")

    @property
    def couplings(self) -> tuple[CouplingRow, ...]:
        """How the dependent joints follow, drivers before what they drive."""
        return tuple(self._tables.couplings)

    @cached_property
    def joint_ranges(self) -> FloatArray:
        """(7, 2) lower and upper limits of the independent joints in rad."""
        joints = self.physics_model.joint
        return np.array([joints(name).range for name in self.independent_joints])

    def coupled_qpos(self, q_independent: NDArray[np.floating]) -> FloatArray:
        """Fills in the dependent joints from their couplings.

        Args:
            q_independent: (..., 7) rad, in the order of `independent_joints`.

        Returns:
            (..., nq) full posture in rad that satisfies every coupling exactly.

        Raises:
            ValueError: the last axis does not have one entry per independent joint.
        """
        q = np.asarray(q_independent, dtype=np.float64)
        if q.ndim == 0 or q.shape[-1] != len(self.independent_joints):
            raise ValueError(
                f"q_independent: got shape {q.shape}, expected (..., "
                f"{len(self.independent_joints)}), one angle per independent joint"
            )
        full = np.zeros((*q.shape[:-1], self.physics_model.nq))
        full[..., self.qpos_independent] = q
        address = self._qpos_address
        for coupling in self._tables.couplings:
            driver = full[..., address[coupling.driver]] if coupling.driver else 0.0
            full[..., address[coupling.dependent]] = np.polynomial.polynomial.polyval(
                driver, coupling.coefficients
            )
        return full

    @cached_property
    def _qvel_address(self) -> dict[str, int]:
        names = self.independent_joints + self.dependent_joints
        return {name: int(self.physics_model.joint(name).dofadr[0]) for name in names}

    @cached_property
    def _qpos_address(self) -> dict[str, int]:
        names = self.independent_joints + self.dependent_joints
        return {name: int(self.physics_model.joint(name).qposadr[0]) for name in names}

    def _addresses(self, joints: Sequence[str], field: str) -> IntArray:
        table = self.physics_model.joint
        found = np.array([int(getattr(table(j), field)[0]) for j in joints], dtype=np.int64)
        found.flags.writeable = False
        return found

    def __repr__(self) -> str:
        return f"User({self.name!r}, hardware={self.hardware})"


def _load_tables(folder: str) -> Callable[[], ModelTables]:
    return lambda: load_model_tables(folder)


_USERS: dict[str, Callable[[], ModelTables]] = {
    "mobl_arms_wrist": _load_tables("mobl_arms_wrist"),
}


def list_users() -> tuple[str, ...]:
    """Returns the names that `load_user` accepts."""
    return tuple(sorted(_USERS))


def load_user(
    name: str,
    *,
    skull_rotation_wxyz: Sequence[float] | None = HEAD_10_DEG_DOWN_WXYZ,
    hardware: Sequence[str] = DEFAULT_HARDWARE,
    appearance: bool = True,
    timestep_s: float | None = None,
) -> User:
    """Loads a simulated user.

    Args:
        name: one of `list_users()`. "mobl_arms_wrist" is the right arm with 7 independent joints
            and 32 muscles (Saul et al. 2015), the SIM2VR paper's Whac-A-Mole user.
        skull_rotation_wxyz: unit quaternion of the skull in the thorax frame (y up, x forward,
            z right); the default looks 10 degrees down, None looks straight ahead.
        hardware: devices to wear: "headset" (0.571 kg), "controller_right" (0.129 kg).
        appearance: whether the model has drawn (massless, contact-free) shapes, lights, cameras.
        timestep_s: physics step; None takes the model's 2 ms. At 5 ms a user step costs less than
            half and ends within a millimetre (median, random controls) of where it would.

    Raises:
        ValueError: unknown user or device, a skull rotation that is not a unit quaternion, or a
            physics step that is not above 0.
    """
    if name not in _USERS:
        raise ValueError(unknown_name("user name", name, list_users()))
    known = load_device_rows()
    for device in hardware:
        if device not in known:
            raise ValueError(unknown_name("hardware", device, known))
    if len(set(hardware)) != len(hardware):
        raise ValueError(f"hardware: got {tuple(hardware)}, expected each device at most once")
    if timestep_s is not None and not timestep_s > 0.0:
        raise ValueError(f"timestep_s: got {timestep_s}, expected a number above 0")
    rotation: tuple[float, ...] | None = None
    if skull_rotation_wxyz is not None:
        rotation = tuple(float(x) for x in skull_rotation_wxyz)
        norm = float(np.linalg.norm(rotation))
        if len(rotation) != 4 or not abs(norm - 1.0) < 1e-3:
            raise ValueError(
                f"skull_rotation_wxyz: got {rotation}, expected 4 numbers w x y z of norm 1"
            )
    devices = [known[device] for device in hardware]
    return User(name, _USERS[name](), devices, rotation, appearance, timestep_s)


def unknown_name(field: str, got: object, expected: Sequence[str] | dict[str, DeviceRow]) -> str:
    """Words the error for a name that is not in a registry, with the closest match if any."""
    names = sorted(expected)
    close = difflib.get_close_matches(str(got), names, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"{field}: got {got!r}, expected one of {', '.join(map(repr, names))}{hint}"
