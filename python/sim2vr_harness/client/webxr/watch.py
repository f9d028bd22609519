"""Serve a page's requests; keep its errors, navigations, windows and memory in view."""

import base64
import logging
from collections.abc import Mapping
from typing import Any

from sim2vr_harness.client import limits
from sim2vr_harness.client.errors import AppDied
from sim2vr_harness.client.limits import Kept
from sim2vr_harness.client.webxr.browser import Browser
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.tab import Tab, worker_bundle

_LOG = logging.getLogger(__name__)
_noted: set[str] = set()
"""Notes that the log of this process has."""


class PageWatch:
    """Serves the requests of one tab and keeps what its page did wrong.

    Args:
        browser: of the tab.
        tab: to watch.
        files: what its page may load.

    Attributes:
        errors: what its scripts threw and did not catch, in this round.
        left: the address that it went to by itself; None: it stayed.
        loaded: whether it has loaded.
        loading: the address that the harness loads now; None: no such.
        requests: how many files it requested, in all rounds.
    """

    def __init__(self, browser: Browser, tab: Tab, files: PageFiles) -> None:
        self.errors = Kept()
        self.left: str | None = None
        self.loaded = False
        self.loading: str | None = None
        self.requests = 0
        self._address = ""
        self._seed = 0
        self._complaints = Kept()
        self._files = files
        self._tab = tab
        self._tools = browser.tools
        self._group = browser.process.pid
        self._tools.watch(self._check_memory)
        on = self._tools.on
        on("Target.targetCreated", self._close_other_window)
        on("Fetch.requestPaused", self._answer)
        on("Page.loadEventFired", self._note_loaded)
        on("Page.frameNavigated", self._note_navigation)
        on("Page.javascriptDialogOpening", self._dismiss)
        on("Runtime.exceptionThrown", self._note_error)
        on("Runtime.consoleAPICalled", self._note_complaint)
        on("Inspector.targetCrashed", self._end)
        on("Target.attachedToTarget", self._begin_worker)

    def clear(self, loading: str, seed: int) -> None:
        """Forget the round before: the harness is about to load an address."""
        self._seed = seed
        self.errors.clear()
        self._complaints.clear()
        self._files.clear()
        self.left, self.loaded, self.loading = None, False, loading
        self._address = loading

    # --- events --------------------------------------------------------------------------------

    def _tell(self, method: str, **parameters: Any) -> None:
        self._tools.send(method, parameters, self._tab.session, answered=False)

    def _answer(self, event: Mapping[str, Any]) -> None:
        """Serve a request from its file, or refuse it."""
        number, url = event["requestId"], event["request"]["url"]
        self.requests += 1
        answer = self._files.answer(url)
        if answer.status == 0:
            self._tell("Fetch.failRequest", requestId=number, errorReason="BlockedByClient")
            return
        headers = {
            "Content-Type": answer.mime,
            "Content-Length": str(len(answer.content)),
            "Access-Control-Allow-Origin": "*",
            "Cache-Control": "max-age=31536000",
        }
        self._tell(
            "Fetch.fulfillRequest",
            requestId=number,
            responseCode=answer.status,
            responseHeaders=[{"name": name, "value": value} for name, value in headers.items()],
            body=base64.b64encode(answer.content).decode(),
        )

    def _close_other_window(self, event: Mapping[str, Any]) -> None:
        """Close a window that the page got in spite of the browser's flag (not all know it)."""
        target = event["targetInfo"]
        ours = target.get("browserContextId") == self._tab.context
        if ours and target["type"] == "page" and target["targetId"] != self._tab.target:
            self._tools.send("Target.closeTarget", {"targetId": target["targetId"]}, answered=False)

    def _begin_worker(self, event: Mapping[str, Any]) -> None:
        """Give a worker, which waits for it, the scripts of virtual time; let all others go on."""
        session, send = event["sessionId"], self._tools.send
        if event["targetInfo"]["type"] == "worker":
            expression = worker_bundle(self._seed)
            send("Runtime.evaluate", {"expression": expression}, session, answered=False)
        if event.get("waitingForDebugger"):
            send("Runtime.runIfWaitingForDebugger", {}, session, answered=False)

    def _note_loaded(self, event: Mapping[str, Any]) -> None:
        self.loaded = True

    def _note_navigation(self, event: Mapping[str, Any]) -> None:
        frame = event["frame"]
        if "parentId" not in frame and self.loading is None and frame["url"] != "about:blank":
            self.left = str(frame["url"])[:200]

    def _dismiss(self, event: Mapping[str, Any]) -> None:
        self._tell("Page.handleJavaScriptDialog", accept=True)

    def _note_error(self, event: Mapping[str, Any]) -> None:
        self.errors.add(words_of(event["exceptionDetails"]))

    def _note_complaint(self, event: Mapping[str, Any]) -> None:
        if event["type"] in ("error", "warning", "assert"):
            words = [str(one.get("value", one.get("description", ""))) for one in event["args"]]
            self._complaints.add(" ".join(words).partition("\n")[0])

    def _end(self, event: Mapping[str, Any]) -> None:
        """Give up: what is asked of a crashed tab gets no answer."""
        raise self.died("its tab crashed (its process ended)")

    def _check_memory(self) -> None:
        used = limits.memory_of_group(self._group)
        if used > limits.MOST_MEMORY_BYTES:
            raise self.died(
                f"takes {used >> 20} MB of memory with its browser, expected at most "
                f"{limits.MOST_MEMORY_BYTES >> 20} MB"
            )

    # --- words ---------------------------------------------------------------------------------

    def died(self, what: str) -> Exception:
        """Return the error of a page that cannot go on; nothing more is asked of it."""
        return self._tools.give_up(AppDied(f"{self._files.name}: {what}"))

    @property
    def departure(self) -> str:
        """Where the page went by itself, as the beginning of a sentence."""
        if self.left == self._address[:200]:
            return "loaded itself again"
        return f"went to another address, {self.left}"

    @property
    def notes(self) -> list[str]:
        """What went wrong in this round that the page can do without, a sentence for each kind."""
        files, found = self._files, []
        if files.sources:
            found.append(
                f"loads {files.sources.listed()}, source code that no browser runs: build the "
                "page, as with `npm run build`, and name the page that this makes"
            )
        if files.refused:
            found.append(f"asks for {files.refused.listed()}, which app.map maps to no folder")
        if files.missing:
            outside = files.outside
            hint = f" (above the page's folder; it plays with {outside})" if outside else ""
            found.append(f"not found: {files.missing.listed()}{hint}")
        if self.errors:
            found.append(f"script error: {self.errors.listed()}")
        return found

    def hints(self) -> str:
        """Return the notes and what the page said last, in brackets; "" without any."""
        words = self.notes
        if self._complaints:
            words.append(f"it says: {self._complaints.last}")
        return f" ({'; '.join(words)})" if words else ""

    def log_notes(self, *, silent: bool = False) -> None:
        """Log the notes of this round that the log does not have.

        Args:
            silent: whether an error says the same.
        """
        for note in self.notes:
            line = f"{self._files.name}: {note}"
            if line not in _noted:
                _noted.add(line)
                if not silent:
                    _LOG.warning(line)


def words_of(details: Mapping[str, Any]) -> str:
    """Return what an exception says, in one line, and where it was thrown."""
    thrown = details.get("exception", {})
    text = thrown.get("description") or thrown.get("value") or details.get("text", "an error")
    line = " ".join(str(text).partition("\n    at ")[0].split())[:300]
    url = details.get("url") or ""
    where = url.rpartition("/")[2].partition("?")[0]
    return f"{line} ({where}:{details.get('lineNumber', 0) + 1})" if where else line
