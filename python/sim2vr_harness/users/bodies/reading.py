"""Models of others, read from an MJCF file or from a package."""

import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from sim2vr_harness.users.bodies.description import BodyDescription
from sim2vr_harness.users.bodies.mjcf import check_mjcf
from sim2vr_harness.users.bodies.packages import folder_of_package, package_of_models

_KINDS = {
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "site": "sites",
    "camera": "cameras",
    "light": "lights",
    "flex": "flexes",
    "skin": "skins",
    "tendon": "tendons",
    "actuator": "actuators",
    "sensor": "sensors",
    "equality": "equalities",
    "pair": "pairs",
    "exclude": "excludes",
    "key": "keys",
}
"""Kind of element -> the list of a specification that has them. Assets have their file's name."""


def read_model(description: BodyDescription, file: Path) -> mujoco.MjSpec:
    """Read the model that a description names; every element of it has a name.

    Args:
        description: of the body.
        file: where the description was read from.

    Raises:
        ValueError: there is no such model, or it cannot be read; names the key.
    """
    spec = _read(description, file)
    # Name the elements without names by kind and number, such as joint_0.
    for kind, many in _KINDS.items():
        elements = getattr(spec, many)
        taken = {element.name for element in elements}
        free = (name for i in itertools.count() if (name := f"{kind}_{i}") not in taken)
        for element in elements:
            if not element.name:
                element.name = next(free)
    return spec


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification without warnings about specifications attached to others."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return spec.compile()


def check_finite(model: mujoco.MjModel) -> None:
    """Check that no number of a model is NaN, wherever it came from (a mesh, a package).

    Raises:
        ValueError: one is; names MuJoCo's field and its row.
    """
    for prefix, owner in (("", model), ("opt.", model.opt)):
        for name in dir(owner):
            value = getattr(owner, name, None)
            if name.startswith("_") or not isinstance(value, float | np.ndarray):
                continue
            numbers = np.asarray(value)
            if numbers.dtype.kind == "f" and np.isnan(numbers).any():
                row = int(np.argwhere(np.isnan(numbers))[0][0]) if numbers.ndim else 0
                raise ValueError(
                    f"mjcf: got NaN in {prefix}{name}[{row}] of the compiled model, expected "
                    "finite numbers"
                )


def _read(description: BodyDescription, file: Path) -> mujoco.MjSpec:
    package = description.package
    folders = [file.parent / folder for folder in description.folders]
    if package is None:
        return _from_file(file.parent / str(description.mjcf), folders)
    if description.mjcf is not None:
        home = folder_of_package(package)
        return _from_file(home / description.mjcf, [home, *folders])
    module = package_of_models(package)
    if not hasattr(module, "load_spec"):
        raise ValueError(
            f"model: got {description.model!r} of {package!r}, which has no load_spec(name); "
            "expected 'mjcf' with a file of the package"
        )
    # Packages attach specifications to each other; MuJoCo warns of that, too, on the standard
    # error stream and in a file beside the caller.
    said = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return module.load_spec(description.model)
    except ValueError as error:
        raise ValueError(f"model: got {description.model!r}; {package}: {error}") from error
    finally:
        mujoco.set_mju_user_warning(said)


def _from_file(path: Path, folders: Sequence[Path]) -> mujoco.MjSpec:
    if not path.is_file():
        raise ValueError(f"mjcf: got {str(path)!r}, which is not there, expected an MJCF file")
    check_mjcf(path, folders)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ValueError(f"mjcf: got {str(path)!r}, which MuJoCo cannot read: {error}") from error
