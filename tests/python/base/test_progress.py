"""Progress of parts is that of the whole."""

import pytest

from sim2vr_harness.base.progress import progress_of_part


def test_parts_follow_one_another() -> None:
    seen: list[float] = []
    for number in range(2):
        part = progress_of_part(seen.append, number, 2)
        part(0.0)
        part(0.5)
        part(1.0)
    assert seen == pytest.approx([0.0, 0.25, 0.5, 0.5, 0.75, 1.0])
