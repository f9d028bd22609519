"""The YAML file that describes a body made of someone's MJCF: its keys and what they mean."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pydantic
from pydantic import Field, model_validator

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.users.bodies.options import ActivationRange, Angle, PhysicsStep
from sim2vr_harness.users.bodies.posture import Posture

Metres = Annotated[float, Field(ge=-100.0, le=100.0)]
Share = Annotated[float, Field(ge=-1.001, le=1.001)]
Three = tuple[Metres, Metres, Metres]
Four = tuple[Share, Share, Share, Share]
Names = Annotated[tuple[str, ...], Field(min_length=1)]


class PlaceDescription(Settings):
    """Pose of the whole body in the world (x forward, y left, z up)."""

    pos_m: Three = (0.0, 0.0, 0.0)
    yaw_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    """Rotation about the vertical, applied first; positive to the left."""


class DeviceDescription(Settings):
    """Frame of a worn device (x forward, y left, z up)."""

    site: str | None = None
    """Site of the model with this frame; give either this or ``body``."""
    body: str | None = None
    """Segment that wears the device; give either this or ``site``."""
    pos_m: Three = (0.0, 0.0, 0.0)
    """Position in the frame of the segment or site."""
    quat_wxyz: Four = (1.0, 0.0, 0.0, 0.0)
    weight: bool = True
    """False: the device has a pose, but no mass."""

    @model_validator(mode="after")
    def _one_place(self) -> DeviceDescription:
        if (self.site is None) == (self.body is None):
            got = "neither" if self.site is None else f"'{self.site}' and a body"
            raise ValueError(f"site: got {got}, expected either a site or a body")
        norm = sum(x * x for x in self.quat_wxyz) ** 0.5
        if not abs(norm - 1.0) < 1e-3:
            raise ValueError(
                f"quat_wxyz: got {list(self.quat_wxyz)}, expected 4 numbers w x y z of norm 1"
            )
        return self


class ActuatorsDescription(Settings):
    """A group of actuators."""

    names: Names
    """Names or patterns such as ``BIC*``."""
    rule: Literal["muscle", "motor", "direct"] | None = None
    """Rule from actions to controls; None: ``muscle`` for muscles, ``motor`` for the others."""


class ResetDescription(Settings):
    """Start state of an episode."""

    posture: dict[str, Angle] = Field(default_factory=dict)
    """Start angles (rad; slides m) of joints; 0 for those left out."""
    position_range: float = Field(default=0.05, ge=0.0, le=10.0)
    velocity_range: float = Field(default=0.05, ge=0.0, le=100.0)
    activation_range: ActivationRange = (0.0, 1.0)
    """Range in which activations of muscles are uniform."""
    fit_couplings: bool = True


class EffortDescription(Settings):
    """Data of the body for the effort models."""

    lifting: tuple[str, ...] = ()
    """Actuators (or patterns) that hold the arm up."""
    peak_forces: dict[str, Annotated[float, Field(gt=0.0, le=1e6)]] = Field(default_factory=dict)
    """Peak forces (N; motors Nm) of actuators whose model does not define them."""


class SegmentDescription(Settings):
    """A segment whose length can differ between persons."""

    bodies: Names
    start: str
    """Body or site at its beginning; its length is the distance from there to ``end``."""
    end: str

    @model_validator(mode="after")
    def _has_a_length(self) -> SegmentDescription:
        if self.start == self.end:
            raise ValueError(f"end: got {self.end!r}, as start; expected another body or site")
        return self


class AnatomyDescription(Settings):
    """Anatomy of the persons whose body was measured."""

    stature_m: float | None = Field(default=None, ge=0.3, le=3.0)
    mass_kg: float | None = Field(default=None, ge=1.0, le=500.0)
    segments: dict[str, SegmentDescription] = Field(default_factory=dict)


class BodyDescription(Settings):
    """A body made of an MJCF file, or of a model that an installed package has."""

    name: str | None = Field(default=None, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    """None takes the file's name."""
    mjcf: str | None = None
    """File, relative to this one; inside the package if there is one."""
    package: str | None = Field(
        default=None, pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$", max_length=100
    )
    """Python package with the model, such as ``myo_sim``."""
    model: str | None = None
    """The model's name, for a package that offers ``load_spec(name)``."""
    folders: tuple[str, ...] = ()
    """Folders, relative to this file, where files that the MJCF names may lie; its own always is
    one, and so is the package's."""
    contacts: bool = True
    """False: bodies pass through each other and everything else."""
    timestep_s: PhysicsStep | None = None
    """Physics step; None takes the model's own."""
    place: PlaceDescription = PlaceDescription()
    devices: dict[Literal["headset", "controller_right", "controller_left"], DeviceDescription]
    posture: Posture | None = None
    """Posture of a body with legs: root and legs are locked in it, and actuators that move only
    these are removed."""
    locked_joints: dict[str, Angle] = Field(default_factory=dict)
    """Joints (or patterns) that are locked, and their angles (rad; slides m); 0 locks free joints
    and balls at their pose in the model."""
    actuators: tuple[ActuatorsDescription, ...] | None = Field(default=None, min_length=1)
    """None: all there are. Those left out are taken away; at least one stays."""
    observed_joints: Names | None = None
    """Joints (or patterns) that the user senses; None: all that move freely."""
    end_effectors: Names | None = None
    """Sites that the user senses; None: those of the controllers."""
    reset: ResetDescription = ResetDescription()
    effort: EffortDescription = EffortDescription()
    anatomy: AnatomyDescription = AnatomyDescription()
    ipd_m: float | None = Field(default=None, gt=0.03, lt=0.1)
    """Distance of the pupils; None: 0.063 m."""

    @model_validator(mode="after")
    def _one_source(self) -> BodyDescription:
        if (self.mjcf is None) == (self.model is None):
            raise ValueError("mjcf: got both or neither of mjcf and model, expected one of them")
        if self.model is not None and self.package is None:
            raise ValueError(f"package: got none for model {self.model!r}, expected a package")
        if "headset" not in self.devices:
            raise ValueError(
                f"devices: got {sorted(self.devices)}, expected a headset among them: it is what "
                "the user sees with"
            )
        return self


def read_description(file: Path) -> BodyDescription:
    """Reads and checks a body's description.

    Raises:
        ValueError: the file is missing or not YAML, or has a key or value that cannot be used;
            names the file, the key, what was got and what was expected.
    """
    expected = "the description of a body in YAML, a mapping of keys to values"
    tree = read_yaml(file, expected)
    if not isinstance(tree, dict):
        raise InputError(file_name(file), f"YAML of {shown(tree, 40)}", expected)
    try:
        return BodyDescription.model_validate(tree)
    except pydantic.ValidationError as error:
        problem = first_problem(error, BodyDescription)
        field = f"{file_name(file)}: {problem.field}"
        raise InputError(field, problem.got, problem.expected) from error
