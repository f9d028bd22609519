"""``sim2vr-harness doctor``: what is missing of an installation, and how to mend it; or a trial.

Code that could take the process down (graphics drivers, compiled modules) is tried in a child
process with a deadline.
"""

from __future__ import annotations

import dataclasses
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim2vr_harness import __version__
from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming, read_json
from sim2vr_harness.base.requests import option
from sim2vr_harness.cli.options import JsonOutput, print_json

if TYPE_CHECKING:
    from sim2vr_harness.client import AppTrial

Status = Literal["ok", "info", "warning", "missing"]

_PROBE_DEADLINE_S = 60.0


@dataclass(frozen=True)
class Check:
    """One row of the report.

    Attributes:
        name: What was looked at.
        status: ``ok``; ``info`` (absent, and that is fine); ``warning`` (something
            optional does not work); ``missing`` (something essential does not work).
        found: What was found, in a few words.
        mend: The command that mends it, or "".
    """

    name: str
    status: Status
    found: str
    mend: str = ""


def _probe(code: str, **environment: str) -> tuple[bool, str]:
    """Run Python code in a child process; return success and its last line of output."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            timeout=_PROBE_DEADLINE_S,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return False, f"no answer within {_PROBE_DEADLINE_S:.0f} s"
    if done.returncode < 0:
        return False, f"crashed with signal {-done.returncode}"
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    return done.returncode == 0, lines[-1] if lines else ""


def _package_checks() -> Iterator[Check]:
    """Look for packages; pip installs all of them with the harness."""
    yield Check("sim2vr-harness", "ok", f"{__version__}, Python {platform.python_version()}")
    for package in ("mujoco", "gymnasium", "stable-baselines3", "torch", "pyzmq"):
        try:
            yield Check(package, "ok", version(package))
        except PackageNotFoundError:
            pip = f"{sys.executable} -m pip install {package}"
            mend = pip if paths.checkout_dir() is None else "make setup"
            yield Check(package, "missing", "not installed", mend)


def _app_checks() -> Iterator[Check]:
    """Look for the app in its two forms, and for what draws its images."""
    module, mend = "sim2vr_harness._app_runtime", paths.rebuild_command()
    imported, answer = _probe(
        f"import {module} as m; print(getattr(m, '__version__', 'no version'), m.__file__)"
    )
    name = "app runtime (in process)"
    if not imported:
        yield Check(name, "missing", answer, mend)
    elif answer.split()[0] != __version__:
        found = f"version {answer.split()[0]}, but the Python side is {__version__}"
        yield Check(name, "warning", found, mend)
    else:
        yield Check(name, "ok", answer)
    name = "app runtime (executable)"
    try:
        yield Check(name, "ok", str(paths.app_executable()))
    except FileNotFoundError as error:
        yield Check(name, "missing", str(error).partition(" Run: ")[0], mend)
    if imported:
        drawn, answer = _probe(f"import {module} as m; print(m.gl_renderer())")
        mend = "" if drawn else _apt("libegl1 libgl1-mesa-dri")
        yield Check("headset renderer", "ok" if drawn else "missing", answer, mend)


def _mujoco_gl_check() -> Iterator[Check]:
    """Look for a way to draw the simulated user (videos); training does without."""
    code = (
        "import mujoco\n"
        "context = mujoco.GLContext(64, 64); context.make_current()\n"
        "from OpenGL import GL\n"
        "print(GL.glGetString(GL.GL_RENDERER).decode())\n"
        "import os, sys; sys.stdout.flush(); os._exit(0)\n"
    )
    chosen = os.environ.get("MUJOCO_GL")
    answers = []
    for backend in [chosen] if chosen else ["egl", "osmesa"]:
        drawn, answer = _probe(code, MUJOCO_GL=backend)
        if drawn:
            chooses = "from MUJOCO_GL" if chosen else "MUJOCO_GL would choose another"
            yield Check("MuJoCo renderer", "ok", f"{backend}: {answer} ({chooses})")
            return
        answers.append(f"{backend}: {answer}")
    yield Check("MuJoCo renderer", "warning", "; ".join(answers), _apt("libegl1 libgl1-mesa-dri"))


def _browser_check() -> Iterator[Check]:
    """Look for a browser that plays WebXR pages, and what draws in it."""
    from sim2vr_harness.client.errors import AppRefused
    from sim2vr_harness.client.webxr.browser import BROWSERS, find_browser

    try:
        program = find_browser()
    except AppRefused:
        found = f"none of {', '.join(BROWSERS)}; needed by WebXR pages (docs/reference/webxr.md)"
        yield Check("browser for WebXR pages", "info", found)
        return
    works, answer = _probe(
        "from sim2vr_harness.client.webxr.browser import describe_browser as describe\n"
        f"print(describe({program!r}))"
    )
    usable = works and "no WebGL 2" not in answer
    yield Check(
        "browser for WebXR pages",
        "ok" if usable else "warning",
        f"{program}: {answer}",
        "" if usable else _apt("chromium-sandbox" if "sandbox" in answer else BROWSERS[0]),
    )


_GRAPHICS = {
    "XR_KHR_opengl_enable": "OpenGL (X11)",
    "XR_MNDX_egl_enable": "OpenGL (EGL)",
    "XR_KHR_vulkan_enable2": "Vulkan",
}
"""Extension of the OpenXR runtime -> what a program may then draw with."""


def runtime_graphics(manifest: Path) -> str:
    """Return what programs may draw with in an OpenXR runtime, asked as a loader asks.

    Raises:
        OSError, ValueError: its library cannot be loaded, or is no runtime.
    """
    import ctypes
    import struct

    name = read_json(manifest, "the manifest of a runtime")["runtime"]["library_path"]
    library = ctypes.CDLL(str((manifest.parent / name).resolve()))
    # XrNegotiateLoaderInfo and XrNegotiateRuntimeRequest of interface 1, OpenXR 1.0 to 1.x.
    most = (1 << 48) | (0x3FF << 32) | 0xFFFFFFFF
    loader = struct.pack("IINIIQQ", 1, 1, 40, 1, 1, 1 << 48, most)
    request = ctypes.create_string_buffer(struct.pack("IINI4xQP", 3, 1, 40, 0, 0, 0), 40)
    if library.xrNegotiateLoaderRuntimeInterface(loader, request) != 0:
        raise ValueError(f"{library._name}: refuses the loader's interface 1")
    (place,) = struct.unpack_from("P", request, 32)
    get = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)(place)
    found = ctypes.c_void_p()
    get(None, b"xrEnumerateInstanceExtensionProperties", ctypes.addressof(found))
    enumerate_them = ctypes.CFUNCTYPE(
        *(ctypes.c_int, ctypes.c_char_p, ctypes.c_uint32, ctypes.c_void_p, ctypes.c_void_p)
    )(found.value or 0)
    count = ctypes.c_uint32()
    enumerate_them(None, 0, ctypes.addressof(count), None)
    one = struct.Struct("i4xP128sI4x")  # XrExtensionProperties, of type 2
    properties = ctypes.create_string_buffer(one.pack(2, 0, b"", 0) * count.value)
    enumerate_them(None, count.value, ctypes.addressof(count), ctypes.addressof(properties))
    names = [row[2].rstrip(b"\0").decode() for row in one.iter_unpack(properties.raw[:-1])]
    return ", ".join(words for name, words in _GRAPHICS.items() if name in names) or "nothing"


def _openxr_check() -> Iterator[Check]:
    """Look for the OpenXR runtime, what programs may draw with, its layer, and the clock."""
    from sim2vr_harness.client.errors import AppRefused
    from sim2vr_harness.client.openxr.runtime_files import (
        CLOCK_LIBRARY,
        LAYER_LIBRARY,
        MODES_LIBRARY,
        find_library,
        find_runtime,
    )

    name = "OpenXR runtime"
    try:
        manifest = find_runtime()
    except AppRefused as error:
        yield Check(name, "missing", str(error).partition("; run: ")[0], paths.rebuild_command())
    else:
        works, answer = _probe(
            "from pathlib import Path\n"
            "from sim2vr_harness.cli.doctor import runtime_graphics\n"
            f"print(runtime_graphics(Path({str(manifest)!r})))"
        )
        usable = works and answer != "nothing"
        without = [words for words in _GRAPHICS.values() if words not in answer] if usable else []
        found = f"{manifest}: {answer}" + (f"; without {', '.join(without)}" if without else "")
        packages = "libgl-dev libegl-dev libvulkan-dev libx11-dev libopenxr-dev"
        mend = "" if usable else f"{_apt(packages)}, then {paths.rebuild_command()}"
        yield Check(name, "ok" if usable else "missing", found, mend)
    for library, use in (
        (LAYER_LIBRARY, "OpenXR recording layer"),
        (CLOCK_LIBRARY, "virtual clock of programs"),
        (MODES_LIBRARY, "display of programs (--xvfb)"),
    ):
        file = find_library(library)
        if file is None:
            yield Check(use, "missing", f"no {library}", paths.rebuild_command())
        elif library == MODES_LIBRARY and shutil.which("Xvfb") is None:
            yield Check(use, "info", f"no Xvfb: {_apt('xvfb')}")
        else:
            yield Check(use, "ok", str(file))


def _gpu_check() -> Iterator[Check]:
    """Look for a GPU, and whether this torch can use it."""
    name = "NVIDIA GPU"
    try:
        found = subprocess.run(
            ["nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader"],
            capture_output=True,
            text=True,
            timeout=_PROBE_DEADLINE_S,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        yield Check(name, "info", "none; training runs on the CPU")
        return
    gpus = "; ".join(found.stdout.strip().splitlines())
    if _probe("import torch; print(torch.cuda.is_available())") == (True, "True"):
        yield Check(name, "ok", gpus)
    else:
        mend = f"{sys.executable} -m pip install --force-reinstall torch"
        yield Check(name, "warning", f"{gpus}, but this torch cannot use it", mend)


def _apt(packages: str) -> str:
    sudo = "" if os.geteuid() == 0 else "sudo "
    return f"{sudo}apt-get install -y --no-install-recommends {packages}"


def _debian_checks() -> Iterator[Check]:
    if shutil.which("dpkg-query") is None:
        yield Check("Debian packages", "info", "no dpkg here; packages.txt names what is needed")
        return
    try:
        lines = (paths.share_dir() / "packages.txt").read_text(encoding="utf-8").splitlines()
    except FileNotFoundError as error:
        yield Check("Debian packages", "warning", str(error), paths.rebuild_command())
        return
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    installed = _installed_debian_packages([package for _, package in rows])
    for kind in ("runtime", "build"):
        wanted = [package for row_kind, package in rows if row_kind == kind]
        absent = [package for package in wanted if package not in installed]
        name = f"Debian packages ({kind})"
        if not absent:
            yield Check(name, "ok", f"all {len(wanted)} installed")
        else:
            # A warning only: the rows above say whether it matters.
            yield Check(name, "warning", "missing: " + " ".join(absent), _apt(" ".join(absent)))


def _installed_debian_packages(packages: list[str]) -> set[str]:
    listing = subprocess.run(
        ["dpkg-query", "-W", "-f", "${db:Status-Status} ${Package}\n", *packages],
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    return {line.split()[1] for line in listing.splitlines() if line.startswith("installed ")}


def collect() -> list[Check]:
    """Run every check and return the rows in the order of the report."""
    groups = (
        *(_package_checks, _app_checks, _mujoco_gl_check, _browser_check, _openxr_check),
        *(_gpu_check, _debian_checks),
    )
    return [check for group in groups for check in group()]


_MARKS: dict[Status, str] = {
    "ok": "[green]ok[/]",
    "info": "[dim]-[/]",
    "warning": "[yellow]warning[/]",
    "missing": "[red]missing[/]",
}


def _try_app(request: DoctorRequest, executable: Path) -> int:
    """Play ten steps in an app, save its picture and print a report."""
    from sim2vr_harness.client import try_app
    from sim2vr_harness.play.render import parse_size

    size, picture = parse_size(request.size), request.out
    trials = try_app(executable, request.app_arg, size=size, timeout_s=request.timeout)
    # Save an (H, W, 4) image as colour beside depth.
    image = trials[0].images[-1]
    import numpy as np
    from PIL import Image

    depth = image[..., 3:].repeat(3, axis=2)
    picture.parent.mkdir(parents=True, exist_ok=True)
    with naming(picture):
        Image.fromarray(np.concatenate([image[..., :3], depth], axis=1)).save(picture, "PNG")
    if request.json:
        rows = [_trial_row(trial) for trial in trials]
        print_json({"app": str(executable), "picture": str(picture), "trials": rows})
        return 0
    for trial in trials:
        changes = "changes" if trial.picture_changes else "never changes"
        sys.stdout.write(
            f"Protocol {trial.protocol}: handshake, reset and {trial.steps} steps work; "
            f"{trial.steps_per_s:.0f} steps/s, the picture {changes}, reward {trial.reward:.4g}\n"
        )
        sys.stdout.writelines(f"  warning: {warning}\n" for warning in trial.warnings())
    sys.stdout.write(f"Picture: {picture} (colour left, depth right)\n")
    return 0


def _trial_row(trial: AppTrial) -> dict[str, Any]:
    return {
        "protocol": trial.protocol,
        "steps": trial.steps,
        "steps_per_s": trial.steps_per_s,
        "reward": trial.reward,
        "picture_changes": trial.picture_changes,
        "warnings": trial.warnings(),
    }


@dataclass(frozen=True, kw_only=True)
class DoctorRequest(JsonOutput):
    """What to check."""

    app: str | None = option(
        "Try this app instead: handshake, reset, ten steps, one picture.", metavar="PATH"
    )
    app_arg: tuple[str, ...] = option("An argument for --app; may be repeated.", (), metavar="ARG")
    out: Path = option("PNG file for the picture of --app.", Path("app.png"), place="file to write")
    size: str = option("WIDTHxHEIGHT of the pictures of --app.", "120x80")
    timeout: float = option("Seconds that the start and every answer of --app may take.", 60.0)


def doctor(request: DoctorRequest) -> int:
    """Check what is installed and how to mend it; or try an app.

    Examples:
        sim2vr-harness doctor
        sim2vr-harness doctor --app build/MyGame.x86_64
    """
    if request.app is not None:
        return _try_app(request, Path(request.app).expanduser().absolute())
    if request.app_arg:
        raise InputError("--app-arg", "it without --app", "it together with --app")
    checks = collect()
    ok = all(check.status != "missing" for check in checks)
    if request.json:
        print_json({"ok": ok, "checks": [dataclasses.asdict(check) for check in checks]})
    else:
        console = Console()
        table = Table(title="sim2vr-harness doctor", title_justify="left")
        table.add_column("")
        table.add_column("What", no_wrap=True)
        table.add_column("Found", overflow="fold")
        for table_check in checks:
            table.add_row(_MARKS[table_check.status], table_check.name, escape(table_check.found))
        console.print(table)
        commands = [
            (table_check.name, table_check.mend) for table_check in checks if table_check.mend
        ]
        if commands:
            console.print("To mend:")
            for name, command in commands:
                console.print(f"  {name}:", highlight=False, markup=False)
                console.print(f"    {command}", highlight=False, markup=False, soft_wrap=True)
        elif all(table_check.status != "missing" for table_check in checks):
            console.print("Everything needed is here.")
    return 0 if ok else 1
