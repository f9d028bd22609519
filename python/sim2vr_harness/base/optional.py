"""Import of optional packages, with an error that names the extra to install."""

import importlib
from typing import Any

from sim2vr_harness.base.errors import InputError


def needed(package: str, extra: str, option: str) -> Any:
    """Import a package.

    Args:
        package: Its name.
        extra: Of this project, that brings it.
        option: What the user requested, that needs it.

    Raises:
        InputError: It is not installed.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        root = package.partition(".")[0]
        raise InputError(
            option,
            f"it without the package {root!r}",
            f"it to be installed: pip install 'sim2vr-harness[{extra}]'",
        ) from error
