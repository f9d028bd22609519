"""A look at a page before anything else: what it asks for, what it is made of, whether it plays."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import AppError, AppRefused
from sim2vr_harness.client.runtime import frame_time_ns
from sim2vr_harness.client.transport import AppPlace, AppsWanted
from sim2vr_harness.client.webxr.app import WebXRApp
from sim2vr_harness.client.webxr.packages import package_of
from sim2vr_harness.client.webxr.replies import PageReport

FREQUENCY_HZ = 20


@dataclass(frozen=True)
class PageCheck:
    """What a look at a page found.

    Attributes:
        page: as it was named.
        failure: why it does not play, in one sentence; None: it plays.
        report: what it is made of; empty where it could not be asked.
        asked: addresses that it requested: 200, 404, or 0: mapped nowhere.
        notes: what it can do without.
    """

    page: str
    failure: str | None
    report: PageReport
    asked: Mapping[str, int]
    notes: tuple[str, ...]

    @property
    def missing(self) -> dict[str, str]:
        """Addresses without a file, each with what helps."""
        found = {}
        for address, status in self.asked.items():
            if status == 200:
                continue
            package = package_of(address)
            if status == 404 and package is None:
                found[address] = "put the file there"
            elif package is None:
                folder = address.rpartition("/")[0] + "/"
                found[address] = f"--map {folder}=FOLDER with the file"
            else:
                found[address] = f"npm package {package.spec}: sim2vr-harness page vendor"
        return found


def check_page(
    page: str,
    mapped: Mapping[str, str],
    browser: str | None = None,
    options: Mapping[str, OptionValue] | None = None,
    *,
    seconds: float = 2.0,
    timeout_s: float = 60.0,
) -> PageCheck:
    """Load a page behind the same walls as ever, play it a little, and say what it does.

    Args:
        page: a file, a folder or a mapped address.
        mapped: beginning of addresses -> local folder.
        browser: see :func:`find_browser`.
        options: the query of the page's address.
        seconds: how long to play.
        timeout_s: of the start and of every answer.

    Raises:
        AppRefused: there is no such page, or no browser.
    """
    place = AppPlace(
        page=page,
        map=dict(mapped),
        browser=browser,
        timeout_s=timeout_s,
        start_timeout_s=timeout_s,
    )
    head = np.array([0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0])
    right, left = (np.array([x, 1.2, 0.3, 0.0, 0.0, 0.0, 1.0]) for x in (0.2, -0.2))
    poses = DevicePoses(head, right_controller=right, left_controller=left)
    failure, report = None, PageReport()
    with WebXRApp(AppsWanted(n=1, game="page", place=place)) as app:
        try:
            app.reset(1, poses, options)
            for step in range(1, round(seconds * FREQUENCY_HZ)):
                app.step(frame_time_ns(step, FREQUENCY_HZ), poses)
        except (AppError, AppRefused) as error:
            failure = str(error)
        if app.usable:
            report = app.report()
        return PageCheck(page, failure, report, dict(app.asked), tuple(app.notes))
