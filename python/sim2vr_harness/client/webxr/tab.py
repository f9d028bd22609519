"""A tab of a browser that stores and downloads nothing, and the scripts that its pages get."""

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from sim2vr_harness.client.webxr.browser import Browser, read_script
from sim2vr_harness.client.webxr.pipe import RefusedRequest

_SCRIPTS = (
    "own.js",
    "random.js",
    "clock.js",
    "loads.js",
    "elements.js",
    "workers.js",
    "animations.js",
    "sound.js",
    "messages.js",
    "observers.js",
    "spaces.js",
    "controllers.js",
    "gl.js",
    "solid.js",
    "picture.js",
    "session.js",
    "objects.js",
    "things.js",
    "signs.js",
    "boxes.js",
    "report.js",
    "steps.js",
)
"""In the order in which they build on each other; ``walls.js`` is for the frames within, too."""

_WORKER_SCRIPTS = ("own.js", "random.js", "clock.js", "loads.js", "worker.js")

PageSettings = Mapping[str, Any]
"""What the scripts receive: seed, size, eyes and so on (:class:`~.app.WebXRApp`)."""


class Tab(NamedTuple):
    """A tab of a browser: its session, its target and the context that keeps it from others."""

    session: str
    target: str
    context: str


def open_tab(browser: Browser, timeout_s: float) -> Tab:
    """Open an empty tab that stores and downloads nothing.

    Args:
        timeout_s: of every answer.
    """
    ask = browser.request
    context = ask("Target.createBrowserContext", timeout_s)["browserContextId"]
    with suppress(RefusedRequest):
        ask("Browser.setDownloadBehavior", timeout_s, behavior="deny", browserContextId=context)
    target = ask("Target.createTarget", timeout_s, url="about:blank", browserContextId=context)
    ours = set(ask("Target.getBrowserContexts", timeout_s)["browserContextIds"])
    for other in ask("Target.getTargets", timeout_s)["targetInfos"]:
        if other["type"] == "page" and other["browserContextId"] not in ours:
            ask(
                "Target.closeTarget", timeout_s, targetId=other["targetId"]
            )  # with which it started
    attached = ask("Target.attachToTarget", timeout_s, targetId=target["targetId"], flatten=True)
    return Tab(attached["sessionId"], target["targetId"], context)


def describe_browser(program: str, timeout_s: float = 30.0) -> str:
    """Return the version of a browser and what draws WebGL 2 in it; starts and ends it.

    Raises:
        AppRefused, AppDied, AppTimeout: it cannot be started.
    """
    browser = Browser(program, timeout_s)
    try:
        tab = open_tab(browser, timeout_s).session
        asked = {"expression": RENDERER, "returnByValue": True}
        told = browser.tools.request("Runtime.evaluate", asked, tab, timeout_s=timeout_s)
        return f"{browser.version}, {told['result'].get('value', 'no WebGL 2')}"
    finally:
        browser.stop()


RENDERER = """(() => {
  const gl = document.createElement('canvas').getContext('webgl2');
  if (!gl) return 'no WebGL 2';
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return name;
})()"""


def worker_bundle(seed: int) -> str:
    """Return the scripts of a worker as one, which runs before its own."""
    parts = "\n".join(read_script(name) for name in _WORKER_SCRIPTS)
    return f"((window) => {{ const sim = {{ settings: {{ seed: {seed} }} }};\n{parts}\n}})(self)"


def bundle(settings: PageSettings, values: Mapping[str, str]) -> str:
    """The scripts as one, which runs before any of the page's."""
    parts = "\n".join(read_script(name) for name in _SCRIPTS)
    reads = "\n".join(
        f"sim.values.set({json.dumps(name)}, (locate) => ({expression}\n));"
        for name, expression in values.items()
    )
    return (
        f"{{ if (window === window.top) {{ const sim = {{ settings: {json.dumps(settings)} }};\n"
        "Object.defineProperty(window, '__sim2vr', { value: sim });\n"
        f"{{ {parts}\n}}\n{reads}\n}} }}\n{read_script('walls.js')}"
    )
