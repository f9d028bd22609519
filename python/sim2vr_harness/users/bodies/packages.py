"""Python packages that have models of bodies: found without being run, imported if known."""

import importlib
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

_KNOWN = {"myo_sim": "pip install 'sim2vr-harness[myo]'"}
"""Packages that this one's own bodies come from, and how each is installed."""

_allowed: set[str] = set()


def is_known(package: str) -> bool:
    """Return whether importing a package runs nothing that the user has not chosen to run."""
    return package in _KNOWN or package in _allowed or package in sys.modules


def allow_package(package: str) -> None:
    """Let body files of this process import a package: the user has said so."""
    _allowed.add(package)


def package_of_models(package: str) -> ModuleType:
    """Import a package whose ``load_spec(name)`` makes models.

    Raises:
        ValueError: It is not installed, or it is code that the user has not agreed to run.
    """
    if not is_known(package):
        raise ValueError(
            f"package: got {package!r}, code that you have not run before; expected --trust-app, "
            f"if you know where it comes from, or, in Python, 'import {package}' before"
        )
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise _missing(package) from error


def folder_of_package(package: str) -> Path:
    """Return where the files of a package are, importing nothing of it.

    Raises:
        ValueError: It is not installed, or has no folder of files.
    """
    head, *rest = package.split(".")
    for place in _places(head):
        if (folder := Path(place).joinpath(*rest)).is_dir():
            return folder
    if not rest and origin_of(head):
        raise ValueError(
            f"package: got {package!r}, a module without files of its own; expected a package "
            "with models of bodies"
        )
    raise _missing(package)


def origin_of(package: str) -> str:
    """Return the file or folder that a package would be imported from; empty if there is none."""
    head = package.partition(".")[0]
    try:
        spec = find_spec(head)
    except (ImportError, ValueError):
        return ""
    return "" if spec is None else spec.origin or next(iter(_places(head)), "")


def _places(head: str) -> list[str]:
    try:
        spec = find_spec(head)  # of a name without dots: imports nothing
    except (ImportError, ValueError):
        return []
    return [] if spec is None else list(spec.submodule_search_locations or ())


def _missing(package: str) -> ValueError:
    hint = _KNOWN.get(package, f"install the package that has {package!r}")
    return ValueError(
        f"package: got {package!r}, which is not installed; expected it to be: {hint}"
    )
