"""The YAML file that describes a body made of somebody's MJCF: its keys and what they mean."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
import yaml
from pydantic import Field, model_validator

from sim2vr_harness.settings import Settings
from sim2vr_harness.users.names import nearest

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]


class PlaceDescription(Settings):
    """Where the body is: moved as a whole in the world (x forward, y left, z up)."""

    pos_m: Three = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0
    """Turned about the vertical first, to the left positive."""


class DeviceDescription(Settings):
    """Where a device is worn: the frame (x forward, y left, z up) of the tracked device."""

    site: str | None = None
    """A site of the model that has this frame; or else:"""
    body: str | None = None
    """The body that wears it."""
    pos_m: Three = (0.0, 0.0, 0.0)
    """In the frame of the body or site."""
    quat_wxyz: Four = (1.0, 0.0, 0.0, 0.0)
    weight: bool = True
    """False: only its pose is known, it weighs nothing."""

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

    names: tuple[str, ...]
    """Names or patterns such as ``BIC*``."""
    rule: Literal["muscle", "motor", "direct"] | None = None
    """What an action does; None: ``muscle`` for muscles, ``motor`` for the others."""


class ResetDescription(Settings):
    """How an episode starts."""

    posture: dict[str, float] = Field(default_factory=dict)
    """Angles (rad; slides m) to start near; 0 for joints left out."""
    position_range: float = Field(default=0.05, ge=0.0)
    velocity_range: float = Field(default=0.05, ge=0.0)
    fit_couplings: bool = True


class EffortDescription(Settings):
    """What the effort models look at."""

    lifting: tuple[str, ...] = ()
    """Actuators (or patterns) that hold the arm up."""
    peak_forces: dict[str, Annotated[float, Field(gt=0.0)]] = Field(default_factory=dict)
    """Peak forces (N; motors Nm) of those that do not say so themselves."""


class SegmentDescription(Settings):
    """A segment that a person can have longer or shorter."""

    bodies: tuple[str, ...]
    start: str
    """Body or site where it begins; its length is from there to ``end``."""
    end: str


class AnatomyDescription(Settings):
    """Whom the body was measured on."""

    stature_m: float | None = Field(default=None, gt=0.0)
    mass_kg: float | None = Field(default=None, gt=0.0)
    segments: dict[str, SegmentDescription] = Field(default_factory=dict)


class BodyDescription(Settings):
    """A body made of an MJCF file, or of a model that an installed package has."""

    name: str | None = Field(default=None, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    """None takes the file's name."""
    mjcf: str | None = None
    """File, relative to this one; inside the package if there is one."""
    package: str | None = None
    """Python package with the model, such as ``myo_sim``."""
    model: str | None = None
    """The model's name, for a package that offers ``load_spec(name)``."""
    contacts: bool = True
    """False: bodies pass through each other and everything else."""
    timestep_s: float | None = Field(default=None, gt=0.0)
    """Physics step; None takes the model's own."""
    place: PlaceDescription = PlaceDescription()
    devices: dict[Literal["headset", "controller_right", "controller_left"], DeviceDescription]
    locked_joints: dict[str, float] = Field(default_factory=dict)
    """Joints (or patterns) that do not move, and their angles (rad; slides m)."""
    actuators: tuple[ActuatorsDescription, ...] = ()
    """None: all there are. Those left out are taken away."""
    observed_joints: tuple[str, ...] | None = None
    """Joints (or patterns) that the user senses; None: all that move freely."""
    end_effectors: tuple[str, ...] | None = None
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
    try:
        tree: Any = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        reason = error.strerror
        raise ValueError(f"user model: got {str(file)!r} ({reason}), expected a file") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(
            f"{file}: got a file that is not YAML, expected YAML ({reason})"
        ) from error
    if not isinstance(tree, dict):
        raise ValueError(f"{file}: got a {type(tree).__name__}, expected a mapping of keys")
    try:
        return BodyDescription.model_validate(tree)
    except pydantic.ValidationError as error:
        problems = sorted(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
        raise ValueError(f"{file}: {_worded(problems[0])}") from error


def _worded(problem: Any) -> str:
    """One of pydantic's problems: key, got, expected."""
    location = [str(part) for part in problem["loc"] if part != "[key]"]
    key = ".".join(location)
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        known = _keys(location[:-1])
        close = nearest(location[-1], known)
        hint = f" (did you mean {close!r}?)" if close else ""
        return f"{key}: got an unknown key, expected one of {', '.join(known)}{hint}"
    if problem["type"] == "value_error" and ": got " in message:
        return f"{key}.{message}" if key else message
    if problem["type"] == "missing":
        return f"{key}: got nothing, expected a value: this key is needed"
    expected = message.removeprefix("Input should be ")
    return f"{key}: got {problem['input']!r}, expected {expected[:1].lower() + expected[1:]}"


def _keys(location: list[str]) -> list[str]:
    tables: dict[str, type[Settings]] = {
        "place": PlaceDescription,
        "devices": DeviceDescription,
        "actuators": ActuatorsDescription,
        "reset": ResetDescription,
        "effort": EffortDescription,
        "segments": SegmentDescription,
        "anatomy": AnatomyDescription,
    }
    for part in reversed(location):
        if part in tables:
            return list(tables[part].model_fields)
    return list(BodyDescription.model_fields)
