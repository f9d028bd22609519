"""Pages for tests, and a browser to show them, where there is one."""

import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from parts import missing, needs
from sim2vr_harness.client import AppPlace, AppRefused, AppsWanted, DevicePoses, WebXRApp
from sim2vr_harness.client.webxr.browser import find_browser

__all__ = [
    "HEAD",
    "NEEDS_BROWSER",
    "NEEDS_ENGINES",
    "PAGES",
    "ROOT",
    "hands",
    "open_page",
    "page_with",
    "require_npm",
]

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "tests" / "data" / "webxr"
ENGINES = ROOT / "docs" / "examples" / "webxr" / "engines"
CDN = "https://cdn.jsdelivr.net/npm/"
HEAD = np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0])


def _no_browser() -> str:
    try:
        find_browser()
    except AppRefused as error:
        return str(error)
    return ""


NEEDS_BROWSER = needs("browser", not _no_browser(), _no_browser())
NEEDS_ENGINES = needs("npm", ENGINES.is_dir(), "docs/examples/webxr/engines.sh was not run")


@cache
def _without_npm() -> str:
    """Why npm brings no packages; empty if it does."""
    if shutil.which("npm") is None:
        return "npm is not installed"
    asked = ["npm", "view", "three", "version", "--fetch-retries=0", "--fetch-timeout=10000"]
    try:
        answer = subprocess.run(asked, capture_output=True, text=True, timeout=60.0)
    except subprocess.TimeoutExpired:
        return "npm gave no answer within 60 s"
    return "" if answer.returncode == 0 else f"npm reaches no packages: {answer.stderr[:200]}"


def require_npm() -> None:
    """Skip a test where npm cannot be reached."""
    if why := _without_npm():
        missing("npm", why)


def hands(frame: int) -> DevicePoses:
    """Both hands in front of the head, the right one circling."""
    turn = 0.3 * frame
    right = [0.15 + 0.1 * np.cos(turn), 1.1 + 0.1 * np.sin(turn), 0.35, 0.0, 0.0, 0.0, 1.0]
    left = [-0.15, 1.1, 0.35, 0.0, 0.0, 0.0, 1.0]
    return DevicePoses(HEAD, np.array(right), np.array(left))


def open_page(page: Path | str, **changes: Any) -> WebXRApp:
    """A page in a browser of its own; settings of the place and of what is wanted by name."""
    place = {name: changes.pop(name) for name in ("map", "browser", "options") if name in changes}
    times = {name: changes.pop(name, 30.0) for name in ("timeout_s", "start_timeout_s")}
    if page in ("buttons", "drawer", "balls"):
        page, place["map"] = ROOT / "docs" / "examples" / "webxr" / str(page), {CDN: str(ENGINES)}
    wanted = AppsWanted(n=1, game="page", place=AppPlace(page=str(page), **times, **place))
    return WebXRApp(wanted.__class__(**{**vars(wanted), **changes}))


def page_with(folder: Path, script: str, name: str = "page.html") -> Path:
    """A page of one script, a module beside boxes.js."""
    shutil.copy(PAGES / "boxes.js", folder)
    file = folder / name
    file.write_text(f"<!doctype html><body></body>\n<script type=module>\n{script}\n</script>\n")
    return file
