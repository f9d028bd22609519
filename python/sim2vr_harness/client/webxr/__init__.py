"""WebXR pages in lockstep: a headless browser, a device and a clock of our own."""

from pathlib import Path

from sim2vr_harness.client.base import AppClient
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.transport import AppSource, AppsWanted, Transport
from sim2vr_harness.client.webxr.app import CAPABILITIES, WebXRApp
from sim2vr_harness.client.webxr.browser import find_browser
from sim2vr_harness.client.webxr.tab import describe_browser

__all__ = ["WEBXR", "WebXRApp", "describe_browser", "find_browser"]


def _apps(wanted: AppsWanted) -> AppSource:
    def app(index: int, log_dir: Path | None) -> AppClient:
        if log_dir is not None:
            raise AppRefused("logs: got a folder, but a page writes none, expected no --log")
        return WebXRApp(wanted)

    return app


WEBXR = Transport(
    name="webxr",
    summary="a WebXR page as it is, in a headless browser",
    apps=_apps,
    capabilities=CAPABILITIES,
    reads=frozenset({"page", "map", "browser", "timeout_s", "start_timeout_s"}),
    options={
        "profile": "controllers: oculus-touch (default) or generic-trigger",
        "enter": "CSS selector of what to click to enter VR; found out by default",
        "script_errors": "ignore (default: a note) or fail at errors that the page does not catch",
        "renderer": "swiftshader (default: the browser's own) or mesa (the system's llvmpipe)",
        "window_frames": "frames of the window in VR: stop (default: as on a headset) or run",
    },
    text_options=frozenset({"profile", "enter", "script_errors", "renderer", "window_frames"}),
    users_per_connection=1,
    needs="page",
    reports_reward=False,
)
