"""One headless browser: found, started without a way out, ended with everything it has."""

import os
import shutil
from pathlib import Path
from typing import Any

from sim2vr_harness.client.errors import AppDied, AppRefused
from sim2vr_harness.client.process import AppProcess
from sim2vr_harness.client.temporary import TemporaryFolder
from sim2vr_harness.client.webxr.pipe import DevTools
from sim2vr_harness.client.webxr.renderers import RENDERERS, drawing_by

BROWSERS = (
    "chromium-headless-shell",
    "chrome-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
)
"""What is looked for on the PATH, the lightest first; another is named by ``app.browser``."""

_ALWAYS = (
    "--headless",
    "--remote-debugging-pipe",
    "--use-gl=angle",  # renderers.py says how it draws
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
"""How long a browser may take to end by itself; it has nothing to save."""

_NO_SANDBOX = ("No usable sandbox", "Failed to move to new namespace", "credentials.cc")
"""What Chromium says when it is not allowed the namespaces that its sandbox is made of."""


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


class Browser:
    """A browser process with an empty, passing profile, and the conversation with it.

    Args:
        program: its path.
        start_timeout_s: how long it may take to answer.
        renderer: one of :data:`~.renderers.RENDERERS`.

    Raises:
        AppRefused: it cannot be started.
        AppDied, AppTimeout: it ends at once, or says nothing.
    """

    def __init__(self, program: str, start_timeout_s: float, renderer: str = RENDERERS[0]) -> None:
        folder = TemporaryFolder()
        self._home = str(folder.path)
        drawing = drawing_by(renderer, program, self._home)
        for name, content in drawing.files.items():
            Path(self._home, name).write_text(content)
        command = [program, *_ALWAYS, *drawing.flags, f"--user-data-dir={self._home}/profile"]
        if os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium's own cannot be had as root
        environment = {
            name: self._home for name in ("HOME", "TMPDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME")
        }
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


def read_script(name: str) -> str:
    """Return one of the scripts that pages are given."""
    return (Path(__file__).parent / "scripts" / name).read_text(encoding="utf-8")
