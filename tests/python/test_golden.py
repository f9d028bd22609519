"""The commands do what the golden files keep, within the tolerance that golden.py states."""

import pytest

from golden import golden


@pytest.mark.parametrize("name", sorted(golden.SUBJECTS))
def test_the_numbers_are_those_of_the_golden_file(name: str) -> None:
    assert golden.differences(golden.stored(name), golden.made(name), bits=False) == []
