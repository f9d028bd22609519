"""Paths of the app executable and of what is installed beside it.

Three layouts are served alike: an installed wheel (``sim2vr_harness/bin`` and
``sim2vr_harness/share``), an editable install and a plain checkout (``build/``,
``shaders/`` and ``configs/`` of the repository).
"""

import os
import sys
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import NoReturn

APP_VARIABLE = "SIM2VR_APP"
"""Environment variable naming the ``sim2vr-app`` executable to use."""

_PACKAGE = Path(__file__).resolve().parents[1]


def package_dirs() -> Iterator[Path]:
    """Yield every folder of the package (an editable install can have two)."""
    import sim2vr_harness

    yield from dict.fromkeys([_PACKAGE, *(Path(entry) for entry in sim2vr_harness.__path__)])


def checkout_dir() -> Path | None:
    """Return the root of the repository this package runs from, or None when installed."""
    root = _PACKAGE.parents[1]
    return root if (root / "CMakeLists.txt").is_file() and (root / "app_runtime").is_dir() else None


def rebuild_command() -> str:
    """Return the command that brings back every part of the package that is built."""
    if checkout_dir() is not None:
        return "make setup"
    return "pip install --force-reinstall --no-deps sim2vr-harness"


def share_dir() -> Path:
    """Return the folder that holds ``shaders/`` and ``configs/``.

    Raises:
        FileNotFoundError: If the installation is incomplete.
    """
    root = checkout_dir()
    if root is not None:
        return root
    for package in package_dirs():
        if (package / "share").is_dir():
            return package / "share"
    raise FileNotFoundError(
        f"sim2vr-harness is incomplete: no 'share' folder in {_PACKAGE}. Run: {rebuild_command()}"
    )


def config_path(name: str | os.PathLike[str]) -> Path:
    """Return the configuration file called ``name``.

    Args:
        name: A path to a YAML file, or the name of a configuration that ships with the
            package, with or without ``configs/`` and ``.yaml``.

    Raises:
        FileNotFoundError: If there is no such file; the message lists those that exist.
    """
    given = Path(name)
    if given.is_file():
        return given
    shipped = share_dir() / "configs"
    candidate = shipped / given.with_suffix(".yaml").name
    if candidate.is_file() and given.parent in (Path(), Path("configs")):
        return candidate
    known = sorted(path.stem for path in shipped.glob("*.yaml"))
    near = get_close_matches(given.stem, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise FileNotFoundError(
        f"no configuration {str(name)!r}: it is neither a file nor one of the configurations "
        f"that ship with sim2vr-harness ({', '.join(known) or 'none'}){hint}"
    )


def trained_users_dir() -> Path:
    """Return the folder of the trained users that ship with the package."""
    return _PACKAGE / "trained_users"


def fetched_users_dir() -> Path:
    """Return the folder of trained users that this account has fetched (``users get``)."""
    base = os.environ.get("XDG_DATA_HOME", "")
    data = base if os.path.isabs(base) else os.path.expanduser("~/.local/share")
    return Path(data) / "sim2vr" / "users"


def app_executable() -> Path:
    """Return the path of the ``sim2vr-app`` executable; ``SIM2VR_APP`` takes precedence.

    Raises:
        FileNotFoundError: If ``SIM2VR_APP`` names no executable or none was built.
    """
    override = os.environ.get(APP_VARIABLE)
    if override:
        if not os.access(override, os.X_OK) or Path(override).is_dir():
            raise FileNotFoundError(
                f"{APP_VARIABLE} is {override!r}, which is no executable; unset it or correct it."
            )
        return Path(override)
    candidates = [package / "bin" / "sim2vr-app" for package in package_dirs()]
    root = checkout_dir()
    if root is not None:
        candidates.insert(0, root / "build" / "release" / "app_runtime" / "sim2vr-app")
        candidates += sorted((root / "build").glob("*/app_runtime/sim2vr-app"))
    for candidate in candidates:
        if os.access(candidate, os.X_OK):
            return candidate
    looked = ", ".join(str(path) for path in dict.fromkeys(candidates))
    raise FileNotFoundError(
        f"the sim2vr-app executable was not found in: {looked}. Run: {rebuild_command()}"
    )


def exec_app() -> NoReturn:
    """Become ``sim2vr-app``: the console script that puts the executable on ``PATH``."""
    try:
        executable = app_executable()
    except FileNotFoundError as error:
        sys.exit(f"sim2vr-app: {error}")
    os.execv(executable, [str(executable), *sys.argv[1:]])


def uri_unless_utf8(text: str) -> str:
    """Return ``text``, or its ``file:`` URI where it is a path that is not UTF-8.

    Python keeps the bytes of such a path as lone surrogates, which JSON, YAML and every text file
    refuse. A URI is ASCII and names the same file.
    """
    try:
        text.encode()
        return text
    except UnicodeEncodeError:
        pass
    try:
        return Path(text).absolute().as_uri()
    except UnicodeEncodeError:  # no bytes of a path either
        return text
