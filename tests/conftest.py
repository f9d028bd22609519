"""A skip is a failure where the part should be there; a run ends with what it left unproven."""

from collections import Counter
from typing import Any

import pytest

from parts import CLAIMS, RECORDINGS, REQUIRED

if unknown := REQUIRED - CLAIMS.keys():
    raise pytest.UsageError(f"SIM2VR_REQUIRE: got {unknown}, expected names of {list(CLAIMS)}")


def _reason(report: pytest.TestReport | pytest.CollectReport) -> tuple[str, str]:
    """The missing part, empty if the skip names none, and why it is missing."""
    text = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    part, _, why = text.removeprefix("Skipped: ").partition(": ")
    return (part, why) if part in CLAIMS else ("", text)


def _judged(report: Any) -> Any:
    if report.skipped and not hasattr(report, "wasxfail"):
        part, why = _reason(report)
        if part in REQUIRED or (REQUIRED and not part):
            report.outcome = "failed"
            report.longrepr = (
                f"skipped because {part} is missing ({why}), which SIM2VR_REQUIRE lists"
                if part
                else f"skipped without a part of tests/parts.py: {why}"
            )
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    return _judged((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    return _judged((yield))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = Counter(_reason(report) for report in terminalreporter.stats.get("skipped", ()))
    if not RECORDINGS.is_dir():
        skipped["recordings", "SIM2VR_RECORDINGS names no folder"] = 0
    terminalreporter.section("skipped, and what this run leaves unproven")
    for (part, why), count in sorted(skipped.items()):
        tests = f"{count} tests" if count else "tests/recordings"
        claim = CLAIMS.get(part, "no claim of tests/parts.py")
        terminalreporter.write_line(f"{part or 'other'}: {tests}: {why}\n    unproven: {claim}")
