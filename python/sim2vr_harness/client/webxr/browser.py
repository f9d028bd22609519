"""One headless browser: found, started without a way out, its tabs, ended with all that it has."""

import base64
import json
import os
import re
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from sim2vr_harness.base.files import naming
from sim2vr_harness.client.errors import AppDied, AppRefused
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.temporary import TemporaryFolder
from sim2vr_harness.client.webxr.pipe import DevTools, RefusedRequest

BROWSERS = (
    "chromium-headless-shell",
    "chrome-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
)
"""Browsers that are searched on the PATH, the lightest first; ``app.browser`` names another."""

_ALWAYS = (
    "--headless",
    "--remote-debugging-pipe",
    "--use-gl=angle",
    "--ignore-gpu-blocklist",
    "--disable-gpu-watchdog",
    # No way out: names lead nowhere, and what needs none goes to a proxy that is not there.
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--proxy-server=127.0.0.1:9",
    "--proxy-bypass-list=<-loopback>",
    "--force-webrtc-ip-handling-policy=disable_non_proxied_udp",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-domain-reliability",
    "--disable-sync",
    "--no-pings",
    # Nothing that comes of itself.
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-extensions",
    "--disable-default-apps",
    "--disable-breakpad",
    "--disable-crash-reporter",
    "--disable-hang-monitor",
    "--block-new-web-contents",  # no window but the page's own
    "--disable-background-timer-throttling",
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
    "--disable-dev-shm-usage",
    "--disable-features=Translate,MediaRouter,OptimizationHints,PaintHolding",
    "--enable-features=NetworkServiceInProcess2",  # it has nothing to do; 20 MB less
    "--js-flags=--max-semi-space-size=2",  # MB for new objects; 10 MB less
    "--autoplay-policy=no-user-gesture-required",
    "--mute-audio",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
    "--force-device-scale-factor=1",
)

_STOP_S = 1.0
"""Deadline for a browser to end by itself, s; it has nothing to save."""

_NO_SANDBOX = ("No usable sandbox", "Failed to move to new namespace", "credentials.cc")
"""Messages of Chromium if it may not create the namespaces of its sandbox."""


def find_browser(named: str | None = None) -> str:
    """Return the path of the browser to start.

    Args:
        named: a path or a name on the PATH; None takes the first of :data:`BROWSERS`.

    Raises:
        AppRefused: there is none; says how to get one.
    """
    if named is not None:
        found = shutil.which(
            os.path.abspath(os.path.expanduser(named)) if os.sep in named else named
        )
        if found is None:
            raise AppRefused(
                f"app.browser: got {named!r}, which is no program here, expected the path of "
                "Chromium or Chrome"
            )
        return found
    for name in BROWSERS:
        if found := shutil.which(name):
            return found
    raise AppRefused(
        f"app.browser: got none, and there is no {BROWSERS[0]} on the PATH, expected a browser: "
        f"apt-get install {BROWSERS[0]}, or name a Chromium or Chrome"
    )


# --- drawing -------------------------------------------------------------------------------------

RENDERERS = ("swiftshader", "mesa")

_LIBRARY = "libvk_swiftshader.so"
_LONGEST_SCRIPT_BYTES = 1 << 16


@dataclass(frozen=True)
class Drawing:
    """Start parameters of a browser for rendering.

    Attributes:
        flags: flags of its command line.
        environment: environment variables.
        files: name -> content of the files in its working directory.
    """

    flags: tuple[str, ...]
    environment: dict[str, str]
    files: dict[str, str]


def drawing_by(renderer: str, program: str, folder: str) -> Drawing:
    """Return how a browser is started to draw with a renderer.

    SwiftShader is the browser's own: the same pictures with any driver, or without. By itself it
    has a thread for each core, which wait for each other in loops. A file in the working directory
    gives it one, but ANGLE enters the browser's folder before SwiftShader looks for that; loaded as
    a Vulkan driver of ours, it looks here. Mesa's llvmpipe draws in the thread that asks.

    Args:
        renderer: one of :data:`RENDERERS`.
        program: the browser's path, or that of a script that starts it.
        folder: the working directory.

    Raises:
        AppRefused: there is no such renderer.
    """
    if renderer == "mesa":
        environment = {
            "LP_NUM_THREADS": "0",
            "EGL_PLATFORM": "surfaceless",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "GALLIUM_DRIVER": "llvmpipe",
        }
        return Drawing(("--use-angle=gl-egl",), environment, {})
    if renderer != RENDERERS[0]:
        raise AppRefused(
            f"app.transport_options.renderer: got {renderer!r}, expected one of "
            f"{', '.join(RENDERERS)}"
        )
    # SwiftShader lies beside the browser, or beside what a script starts.
    folders = [Path(program).resolve().parent]
    with Path(program).open("rb") as stream:
        start = stream.read(_LONGEST_SCRIPT_BYTES)
    if start.startswith(b"#!"):
        for name in re.findall(r"/[\w./+-]+", start.decode(errors="replace")):
            folders += [Path(name), Path(name).parent]
    library = next((one / _LIBRARY for one in folders if (one / _LIBRARY).is_file()), None)
    allowed = "--enable-unsafe-swiftshader"
    if library is None:
        return Drawing(("--use-angle=swiftshader", allowed), {}, {})
    driver = {
        "file_format_version": "1.0.0",
        "ICD": {"library_path": str(library), "api_version": "1.0.5"},
    }
    found = f"{folder}/driver.json"
    return Drawing(
        ("--use-angle=vulkan", allowed),
        {"VK_DRIVER_FILES": found, "VK_ICD_FILENAMES": found},
        {"driver.json": json.dumps(driver), "SwiftShader.ini": "[Processor]\nThreadCount=1\n"},
    )


# --- the browser ---------------------------------------------------------------------------------


class Browser:
    """A browser process with an empty, passing profile, and the conversation with it.

    Args:
        program: its path.
        start_timeout_s: how long it may take to answer.
        renderer: one of :data:`RENDERERS`.

    Attributes:
        home: its temporary folder.
        version: what it says that it is.

    Raises:
        AppRefused: it cannot be started.
        AppDied, AppTimeout: it ends at once, or says nothing.
    """

    def __init__(self, program: str, start_timeout_s: float, renderer: str = RENDERERS[0]) -> None:
        folder = TemporaryFolder()
        self.home = folder.path
        drawing = drawing_by(renderer, program, str(self.home))
        for name, content in drawing.files.items():
            (self.home / name).write_text(content)
        command = [program, *_ALWAYS, *drawing.flags, f"--user-data-dir={self.home}/profile"]
        if os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium's own cannot be had as root
        own = ("HOME", "TMPDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME")
        environment = dict.fromkeys(own, str(self.home))
        environment |= {"TZ": "UTC", "LANG": "C.UTF-8"}  # what a page shows is the same everywhere
        (theirs_in, ours_out), (ours_in, theirs_out) = os.pipe(), os.pipe()
        try:
            self.process = AppProcess(
                [*command, "about:blank"],
                environment=environment | drawing.environment,
                pipes=(theirs_in, theirs_out),
                home=folder,
            )
        except BaseException:
            for descriptor in (ours_out, ours_in):
                os.close(descriptor)
            raise
        finally:
            os.close(theirs_in)
            os.close(theirs_out)
        self.tools = DevTools(self.process, ours_out, ours_in)
        try:
            version = self.tools.request("Browser.getVersion", timeout_s=start_timeout_s)
        except AppDied as error:
            self.kill()
            if any(words in str(error) for words in _NO_SANDBOX):
                raise AppRefused(
                    f"app.browser: got {program}, whose sandbox this machine does not let a user "
                    "have, expected user namespaces or the package chromium-sandbox; in a "
                    "container: --security-opt seccomp=unconfined (docs/reference/webxr.md)"
                ) from error
            raise
        except BaseException:
            self.kill()
            raise
        self.version = str(version.get("product", "a browser"))

    def request(self, method: str, timeout_s: float, **parameters: Any) -> Any:
        """Ask the browser itself; see :meth:`DevTools.request`."""
        return self.tools.request(method, parameters, timeout_s=timeout_s)

    def stop(self) -> None:
        """End the browser in an orderly way; idempotent."""
        if self.tools.usable:
            self.tools.send("Browser.close", answered=False)
            self.tools.close()
            self.process.wait(_STOP_S)
        self.kill()

    def kill(self) -> None:
        """End the browser at once; idempotent."""
        self.tools.close()
        self.process.kill()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


# --- tabs ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tab:
    """A tab of a browser: its session, its target and the context that keeps it from others."""

    browser: Browser
    session: str
    target: str
    context: str

    def ask(self, method: str, timeout_s: float, **parameters: Any) -> Mapping[str, Any]:
        """Ask the tab; see :meth:`DevTools.request`."""
        return self.browser.tools.request(method, parameters, self.session, timeout_s=timeout_s)

    def value(self, expression: str, timeout_s: float) -> Any:
        """Return the value of an expression; None if it throws."""
        found = self.ask("Runtime.evaluate", timeout_s, expression=expression, returnByValue=True)
        return found["result"].get("value")


def open_tab(browser: Browser, timeout_s: float) -> Tab:
    """Open an empty tab that stores and downloads nothing.

    Args:
        browser: to open it in.
        timeout_s: of every answer.
    """
    ask = browser.request
    context = ask("Target.createBrowserContext", timeout_s)["browserContextId"]
    with suppress(RefusedRequest):
        ask("Browser.setDownloadBehavior", timeout_s, behavior="deny", browserContextId=context)
    target = ask("Target.createTarget", timeout_s, url="about:blank", browserContextId=context)
    ours = set(ask("Target.getBrowserContexts", timeout_s)["browserContextIds"])
    for other in ask("Target.getTargets", timeout_s)["targetInfos"]:
        if other["type"] == "page" and other["browserContextId"] not in ours:  # it started with it
            ask("Target.closeTarget", timeout_s, targetId=other["targetId"])
    attached = ask("Target.attachToTarget", timeout_s, targetId=target["targetId"], flatten=True)
    return Tab(browser, attached["sessionId"], target["targetId"], context)


RENDERER = """(() => {
  const gl = document.createElement('canvas').getContext('webgl2');
  if (!gl) return 'no WebGL 2';
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return name;
})()"""


def describe_browser(program: str, timeout_s: float = 30.0) -> str:
    """Return the version of a browser and what draws WebGL 2 in it; starts and ends it.

    Raises:
        AppRefused, AppDied, AppTimeout: it cannot be started.
    """
    with Browser(program, timeout_s) as browser:
        drawn_by = open_tab(browser, timeout_s).value(RENDERER, timeout_s) or "no WebGL 2"
        return f"{browser.version}, {drawn_by}"


_LOADED = """new Promise((loaded) => {
  if (document.readyState === 'complete') loaded();
  else addEventListener('load', () => loaded());
})"""


def print_page(page: Path, file: Path, *, timeout_s: float = 60.0) -> Path:
    """Print an HTML file on A4 as a PDF.

    Args:
        page: The HTML file, which needs no network.
        file: The PDF.
        timeout_s: Of the browser.

    Raises:
        AppRefused: There is no browser.
        AppDied, AppTimeout: It ends, or does not answer.
    """
    with Browser(find_browser(), timeout_s) as browser:
        tab = open_tab(browser, timeout_s)
        tab.ask("Page.enable", timeout_s)
        tab.ask("Emulation.setEmulatedMedia", timeout_s, media="print")
        tab.ask("Page.navigate", timeout_s, url=page.resolve().as_uri())
        tab.ask("Runtime.evaluate", timeout_s, expression=_LOADED, awaitPromise=True)
        paper = {"paperWidth": 8.27, "paperHeight": 11.69, "scale": 0.75}
        printed = tab.ask("Page.printToPDF", timeout_s, printBackground=True, **paper)
        with naming(file):
            file.write_bytes(base64.b64decode(str(printed["data"])))
        return file
