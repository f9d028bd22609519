"""Parts that tests need beyond the package, and what a run leaves unproven where one is missing.

A test that cannot run without a part is skipped with ``NAME: why``. Parts that SIM2VR_REQUIRE lists
(`runtime,browser,openxr,npm` in .ci/run) have to be there: a skip for want of one is a failure.
"""

import os
from pathlib import Path
from typing import NoReturn

import pytest

CLAIMS = {
    "runtime": "compiled parts (sim2vr-app, the OpenXR runtime, the virtual clock) and OpenGL work",
    "browser": "WebXR pages play and are measured; reports and viewers work in a browser",
    "openxr": "unmodified OpenXR programs play without a headset or a screen",
    "npm": "pages with engines of others play; recordings agree with IWER",
    "gpu": "networks train on a GPU",
    "extras": "packages that make setup does not install agree: RLlib, moviepy",
    "recordings": "replays and measures agree with recordings of people, which are not included",
}
REQUIRED = frozenset(filter(None, os.environ.get("SIM2VR_REQUIRE", "").split(",")))
RECORDINGS = Path(os.environ.get("SIM2VR_RECORDINGS") or "none")
"""A folder with human_rounds, simulated_rounds and beats_replays; tests/recordings needs it."""


def needs(part: str, found: object, why: str) -> pytest.MarkDecorator:
    """Mark tests that are skipped where a part is not found."""
    assert part in CLAIMS
    return pytest.mark.skipif(not found, reason=f"{part}: {why}")


def missing(part: str, why: str) -> NoReturn:
    """Skip the running test."""
    assert part in CLAIMS
    pytest.skip(f"{part}: {why}")
