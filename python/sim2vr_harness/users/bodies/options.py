"""Options of a body: person, worn devices and initial posture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from sim2vr_harness.base.settings import Chance, Settings

LEAST_STEP_S, MOST_STEP_S = 1e-4, 0.02

PhysicsStep = Annotated[float, Field(ge=LEAST_STEP_S, le=MOST_STEP_S)]
"""Physics step, s. Above its range simulations diverge; below, a user step takes minutes."""

Length = Annotated[float, Field(gt=0.0, le=1000.0)]
"""Length, m; a body has narrower bounds for its segments."""
SegmentFactor = Annotated[float, Field(ge=0.5, le=2.0)]
Angle = Annotated[float, Field(ge=-100.0, le=100.0)]
"""Angle, rad; for slides a position, m."""


def _in_order(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"got {list(limits)}, expected the lower one first")
    return limits


ActivationRange = Annotated[tuple[Chance, Chance], AfterValidator(_in_order)]
"""Lowest and highest activation, within [0, 1]."""


class JointOptions(Settings):
    """Passive properties of a joint; None keeps the body's own."""

    armature: float | None = Field(default=None, ge=0.0, le=100.0)
    """Inertia about the joint's axis in addition to the segments', kg m^2 (of a slide kg)."""
    damping: float | None = Field(default=None, ge=0.0, le=1e4)
    """Damping of the joint, Nms/rad (of a slide Ns/m)."""
    stiffness: float | None = Field(default=None, ge=0.0, le=1e6)
    """Stiffness towards the joint's rest position, Nm/rad (of a slide N/m)."""


class Physique(Settings):
    """A person's differences from the one that the body models (docs/reference/bodies.md)."""

    stature_m: float | None = Field(default=None, ge=1.0, le=2.5)
    """Body height; every length scales with it. None keeps the body's own."""
    mass_kg: float | None = Field(default=None, ge=20.0, le=300.0)
    """Body mass; every segment keeps its share. None keeps the body-mass index: mass grows with
    the square of the stature."""
    segment_lengths_m: dict[str, Length] = Field(default_factory=dict)
    """Lengths of single segments, such as ``upper_arm: 0.31``; the others follow the stature."""
    segment_factors: dict[str, SegmentFactor] = Field(default_factory=dict)
    """Or how many times as long as the stature makes them, such as ``forearm: 1.04``."""
    strength: float = Field(default=1.0, gt=0.0, le=10.0)
    """Factor on the peak forces of muscles and the torques of motors."""
    joints: dict[str, JointOptions] = Field(default_factory=dict)
    """Armature, damping and stiffness of single joints, such as ``flexion: {damping: 0.03}``."""
    handedness: Literal["right", "left"] | None = None
    """The hand that plays; the other one than the body's own mirrors it. None leaves it."""
    ipd_m: float | None = Field(default=None, gt=0.03, lt=0.1)
    """Distance of the pupils; None keeps the body's own."""

    @model_validator(mode="after")
    def _one_length_a_segment(self) -> Physique:
        for name in self.segment_factors:
            if name in self.segment_lengths_m:
                raise ValueError(
                    f"segment_factors: got {name!r}, which segment_lengths_m has too, expected it "
                    "in one of the two"
                )
        return self


class ResetOptions(Settings):
    """Changes to the body's start state of episodes (docs/reference/bodies.md)."""

    posture: str | None = None
    """Name of one of the body's postures as start posture; None keeps the body's own."""
    angles: dict[str, Angle] = Field(default_factory=dict)
    """Angles (rad; slides m) of single joints in this posture."""
    position_range: float | None = Field(default=None, ge=0.0, le=10.0)
    """Angles are uniform in +- this about the posture."""
    velocity_range: float | None = Field(default=None, ge=0.0, le=100.0)
    """Velocities are uniform in +- this (rad/s; slides m/s)."""
    activation_range: ActivationRange | None = None
    """Range in which muscles' activations are uniform."""
    hold: bool = False
    """Position servos begin aiming at their joints' angles; without, anywhere in their range."""


@dataclass(frozen=True)
class BodyOptions:
    """Arguments of `load_body`, which says what they mean."""

    name: str
    skull_rotation_deg: float
    devices: tuple[str, ...] | None
    person: Physique
    appearance: bool
    timestep_s: float | None
    torso: bool = False
    reset: ResetOptions = field(default_factory=ResetOptions)

    def __post_init__(self) -> None:
        step = self.timestep_s
        if step is not None and not LEAST_STEP_S <= step <= MOST_STEP_S:
            expected = f"a number from {LEAST_STEP_S:g} to {MOST_STEP_S:g} (s)"
            raise ValueError(f"timestep_s: got {step}, expected {expected}")
        if not -90.0 <= self.skull_rotation_deg <= 90.0:
            raise ValueError(
                f"skull_rotation_deg: got {self.skull_rotation_deg}, expected -90 to 90 degrees"
            )
        worn = self.devices or ()
        if len(set(worn)) != len(worn):
            raise ValueError(f"devices: got {worn}, expected each device at most once")
