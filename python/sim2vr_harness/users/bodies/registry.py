"""Every body there is, by name or by the file that describes it."""

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from sim2vr_harness.base.notices import noticed
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.described import DESCRIPTIONS, described_body
from sim2vr_harness.users.bodies.description import read_description
from sim2vr_harness.users.bodies.from_tables import table_body
from sim2vr_harness.users.bodies.options import BodyOptions, Physique, ResetOptions
from sim2vr_harness.users.bodies.packages import is_known
from sim2vr_harness.users.name_errors import unknown_name

_TABLES: dict[str, Callable[[BodyOptions], Body]] = {
    "mobl_arms_wrist": table_body,
    "mobl_arms_bimanual": table_body,
    "mobl_arms_bimanual_motor": table_body,
}


def list_bodies() -> tuple[str, ...]:
    """Returns the names that `load_body` accepts; it also takes a YAML file."""
    return tuple(sorted({*_TABLES, *(file.stem for file in DESCRIPTIONS.glob("*.yaml"))}))


def installed_bodies() -> tuple[str, ...]:
    """Return those of `list_bodies` whose model is there: some need a package of others."""
    needed = {
        name: read_description(DESCRIPTIONS / f"{name}.yaml").package
        for name in list_bodies()
        if name not in _TABLES
    }
    return tuple(
        name
        for name in list_bodies()
        if (package := needed.get(name)) is None or find_spec(package) is not None
    )


def load_body(
    name: str | Path,
    *,
    skull_rotation_deg: float = 10.0,
    devices: Sequence[str] | None = None,
    person: Physique | None = None,
    appearance: bool = True,
    timestep_s: float | None = None,
    torso: bool = False,
    reset: ResetOptions | None = None,
) -> Body:
    """Loads a body.

    Args:
        name: one of `list_bodies()`, or a body's YAML file (docs/reference/bodies.md).
            "mobl_arms_wrist" is the right arm with 7 independent joints and 32 muscles (Saul et
            al. 2015), the SIM2VR paper's Whac-A-Mole user; "mobl_arms_bimanual_motor" has both
            arms and 14 motors, the SIM2VR paper's Beats user; "mobl_arms_bimanual" the first one's
            arm on both sides, 64 muscles.
        skull_rotation_deg: how far the head, and with it the headset, looks down, degrees; with a
            torso at the start only, as the neck moves.
        devices: names of the devices to wear, of those that the body can; None for all of them.
        person: stature, mass, segment lengths, strength and handedness; None for the body as it is.
        appearance: whether the model has drawn (massless, contact-free) shapes, lights, cameras.
        timestep_s: physics step; None takes the body's own (2 ms). At 5 ms a user step costs less
            than half and ends within a millimetre (median, random controls) of where it would.
        torso: whether trunk and neck move, by six motors more.
        reset: how episodes begin, where that differs from the body's own way.

    Raises:
        ValueError: an unknown body, device or part of one, or an option that it cannot have.
    """
    options = BodyOptions(
        name=str(name),
        skull_rotation_deg=skull_rotation_deg,
        devices=None if devices is None else tuple(devices),
        person=person or Physique(),
        appearance=appearance,
        timestep_s=timestep_s,
        torso=torso,
        reset=reset or ResetOptions(),
    )
    if options.name in _TABLES:
        return _TABLES[options.name](options)
    if not is_file(name) and options.name not in list_bodies():
        raise ValueError(unknown_name("user model", options.name, list_bodies()))
    file = Path(name) if is_file(name) else DESCRIPTIONS / f"{options.name}.yaml"
    with noticed(f"Loading the body {options.name}; one with 400 muscles takes half a minute."):
        return described_body(file, options)


def foreign_package(name: str | Path) -> str | None:
    """Return the Python package that loading a body would import and that no one vouches for.

    None where there is none. A file that cannot be read has none: loading it says what is wrong.
    """
    if str(name) in _TABLES or not is_file(name):
        return None
    try:
        description = read_description(Path(name))
    except ValueError:
        return None
    package = description.package if description.model is not None else None
    return None if package is None or is_known(package) else package


def is_file(name: str | Path) -> bool:
    """Whether a body's name is that of a file."""
    return Path(name).suffix.lower() in (".yaml", ".yml")
