"""``sim2vr-harness doctor``: what is installed, what is missing, and how to mend it.

Every check is a small function that returns :class:`Check` rows. Code that could
take the process down (graphics drivers, compiled modules) is tried in a child
process with a deadline. With ``--app`` it tries an app instead.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, features
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim2vr_harness import __version__
from sim2vr_harness.base import paths
from sim2vr_harness.base.files import naming
from sim2vr_harness.cli.options import print_json

if TYPE_CHECKING:
    from sim2vr_harness.client import AppTrial

Status = Literal["ok", "info", "warning", "missing"]

_PROBE_DEADLINE_S = 60.0


@dataclasses.dataclass(frozen=True)
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


def _install_command(package: str) -> str:
    if paths.checkout_dir() is not None:
        return "make setup"
    return f"{sys.executable} -m pip install '{package}'"


def _python_checks() -> Iterator[Check]:
    yield Check("sim2vr-harness", "ok", __version__)
    yield Check("Python", "ok", f"{platform.python_version()} ({sys.executable})")
    for package, requirement in [
        ("mujoco", "mujoco>=4,<5"),
        ("gymnasium", "gymnasium>=1.4"),
        ("stable-baselines3", "stable-baselines3>=2.9"),
        ("torch", "torch>=2.6"),
        ("pyzmq", "pyzmq>=25"),
    ]:
        try:
            yield Check(package, "ok", version(package))
        except PackageNotFoundError:
            yield Check(package, "missing", "not installed", _install_command(requirement))


def _app_checks() -> Iterator[Check]:
    module = "sim2vr_harness._app_runtime"
    imported, answer = _probe(
        f"import {module} as m; print(getattr(m, '__version__', 'no version'), m.__file__)"
    )
    if not imported:
        yield Check("app runtime (in process)", "missing", answer, paths.rebuild_command())
    elif answer.split()[0] != __version__:
        found = f"version {answer.split()[0]}, but the Python side is {__version__}"
        yield Check("app runtime (in process)", "warning", found, paths.rebuild_command())
    else:
        yield Check("app runtime (in process)", "ok", answer)

    try:
        executable = paths.app_executable()
    except FileNotFoundError as error:
        found = str(error).partition(" Run: ")[0]
        yield Check("app runtime (executable)", "missing", found, paths.rebuild_command())
    else:
        yield Check("app runtime (executable)", "ok", str(executable))

    if imported:
        drawn, answer = _probe(f"import {module} as m; print(m.gl_renderer())")
        if drawn:
            yield Check("headset renderer", "ok", answer)
        else:
            yield Check("headset renderer", "missing", answer, _apt("libegl1 libgl1-mesa-dri"))


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
        "from sim2vr_harness.client.webxr import describe_browser as describe\n"
        f"print(describe({program!r}))"
    )
    usable = works and "no WebGL 2" not in answer
    yield Check(
        "browser for WebXR pages",
        "ok" if usable else "warning",
        f"{program}: {answer}",
        "" if usable else _apt("chromium-sandbox" if "sandbox" in answer else BROWSERS[0]),
    )


def _openxr_check() -> Iterator[Check]:
    """Look for the OpenXR runtime, what programs may draw with, its layer, and the clock."""
    from sim2vr_harness.client.errors import AppRefused
    from sim2vr_harness.client.openxr.describe import GRAPHICS
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
            "from sim2vr_harness.client.openxr.describe import graphics_of\n"
            f"print(graphics_of(Path({str(manifest)!r})))"
        )
        usable = works and answer != "nothing"
        without = [words for words in GRAPHICS.values() if words not in answer] if usable else []
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


def _looking_checks() -> Iterator[Check]:
    """Look for what people look with: letters in pictures, films, windows, a viewer of bodies."""
    drawn = bool(features.check("freetype2"))
    found = "Pillow's own" if drawn else "Pillow without FreeType: letters in pictures are tiny"
    mend = "" if drawn else f"{sys.executable} -m pip install --force-reinstall pillow"
    yield Check("font", "ok" if drawn else "warning", found, mend)
    try:
        import imageio_ffmpeg

        yield Check("ffmpeg", "ok", str(imageio_ffmpeg.get_ffmpeg_exe()))
    except (ImportError, RuntimeError) as error:
        yield Check("ffmpeg", "warning", str(error), _install_command("imageio-ffmpeg>=0.5"))
    absent = [name for name in ("pygame", "moviepy") if importlib.util.find_spec(name) is None]
    yield Check(
        "windows and RecordVideo",
        "info" if absent else "ok",
        f"no {' and '.join(absent)}; pip install 'sim2vr-harness[video]' brings them"
        if absent
        else "pygame and moviepy",
    )
    studio = shutil.which("mujoco-studio", path=os.path.dirname(sys.executable))
    studio = studio or shutil.which("mujoco-studio")
    yield Check(
        "viewer of bodies",
        "ok" if studio else "info",
        "mujoco-studio FILE.xml, for what `users export` writes (--gfx web without a display)"
        if studio
        else "no mujoco-studio; it comes with mujoco 4",
    )


def _machine_checks() -> Iterator[Check]:
    cores = len(os.sched_getaffinity(0))
    yield Check("CPU cores", "ok" if cores > 1 else "warning", f"{cores} usable")
    memory_gib = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    yield Check("memory", "ok" if memory_gib >= 4 else "warning", f"{memory_gib:.1f} GiB")
    yield _gpu_check()


def _gpu_check() -> Check:
    if shutil.which("nvidia-smi") is None:
        return Check("NVIDIA GPU", "info", "none; training runs on the CPU")
    try:
        listing = subprocess.run(
            ["nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader"],
            capture_output=True,
            text=True,
            timeout=_PROBE_DEADLINE_S,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return Check("NVIDIA GPU", "info", "nvidia-smi is there, but finds no GPU")
    gpus = "; ".join(listing.splitlines())
    usable, answer = _probe("import torch; print(torch.cuda.is_available())")
    if usable and answer == "True":
        return Check("NVIDIA GPU", "ok", gpus)
    mend = f"{sys.executable} -m pip install --force-reinstall torch"
    return Check("NVIDIA GPU", "warning", f"{gpus}, but this torch cannot use it", mend)


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
    groups: list[Callable[[], Iterator[Check]]] = [
        _python_checks,
        _app_checks,
        _mujoco_gl_check,
        _browser_check,
        _openxr_check,
        _looking_checks,
        _machine_checks,
        _debian_checks,
    ]
    return [check for group in groups for check in group()]


_MARKS: dict[Status, str] = {
    "ok": "[green]ok[/]",
    "info": "[dim]-[/]",
    "warning": "[yellow]warning[/]",
    "missing": "[red]missing[/]",
}


def _print_table(checks: list[Check], console: Console) -> None:
    table = Table(title="sim2vr-harness doctor", title_justify="left")
    table.add_column("")
    table.add_column("What", no_wrap=True)
    table.add_column("Found", overflow="fold")
    for check in checks:
        table.add_row(_MARKS[check.status], check.name, escape(check.found))
    console.print(table)
    commands = [(check.name, check.mend) for check in checks if check.mend]
    if commands:
        console.print("To mend:")
        for name, command in commands:
            console.print(f"  {name}:", highlight=False, markup=False)
            console.print(f"    {command}", highlight=False, markup=False, soft_wrap=True)
    elif all(check.status != "missing" for check in checks):
        console.print("Everything needed is here.")


def check_app(
    executable: Path,
    arguments: Sequence[str],
    picture: Path,
    *,
    size: tuple[int, int] = (120, 80),
    timeout_s: float = 60.0,
    json: bool = False,
) -> int:
    """Play ten steps in an app, save its picture and print a report.

    Args:
        executable: The app.
        arguments: Its arguments.
        picture: PNG file for the last picture, colour left and depth right.
        size: (width, height) of the app's picture, pixels.
        timeout_s: How long the start and every answer may take.
        json: Print one JSON object instead of text.

    Returns:
        The exit status, 0; failures raise the errors of :func:`sim2vr_harness.client.try_app`.
    """
    from sim2vr_harness.client import try_app

    trials = try_app(executable, arguments, size=size, timeout_s=timeout_s)
    _save_picture(trials[0].images[-1], picture)
    if json:
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


def _save_picture(image: NDArray[np.uint8], file: Path) -> None:
    """Save an (H, W, 4) image as colour beside depth."""
    depth = image[..., 3:].repeat(3, axis=2)
    file.parent.mkdir(parents=True, exist_ok=True)
    with naming(file):
        Image.fromarray(np.concatenate([image[..., :3], depth], axis=1)).save(file, "PNG")


def run_doctor(json: bool = False) -> int:
    """Print a report about this installation.

    Args:
        json: Print one JSON object (``{"ok": bool, "checks": [...]}``) instead of a table.

    Returns:
        The exit status: 0, or 1 if something essential is missing.
    """
    checks = collect()
    ok = all(check.status != "missing" for check in checks)
    if json:
        report = {"ok": ok, "checks": [dataclasses.asdict(check) for check in checks]}
        print_json(report)
    else:
        _print_table(checks, Console())
    return 0 if ok else 1
