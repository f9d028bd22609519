"""Times of a stage's parts."""

from __future__ import annotations

import time

import pytest

from sim2vr_harness.training.run.stopwatch import Stopwatch


def test_parts_that_alternate_are_added_up() -> None:
    watch = Stopwatch()
    for _ in range(2):
        watch.begin("sleeping")
        watch.begin("sleeping")
        time.sleep(0.05)
        watch.begin("computing")
        began = time.process_time()
        while time.process_time() - began < 0.05:
            pass
    watch.stop()
    assert list(watch.parts) == ["preparing", "sleeping", "computing"]
    sleeping, computing = watch.parts["sleeping"], watch.parts["computing"]
    assert sleeping.seconds >= 0.1
    assert sleeping.cpu_seconds < 0.05
    assert computing.cpu_seconds == pytest.approx(0.1, abs=0.04)
