"""The commands do what the golden files keep, within the tolerance that golden.py states."""

import copy

import pytest

from golden import golden


@pytest.mark.parametrize("name", sorted(golden.SUBJECTS))
def test_the_numbers_are_those_of_the_golden_file(name: str) -> None:
    assert golden.differences(golden.stored(name), golden.made(name), bits=False) == []


def test_a_changed_value_is_found() -> None:
    kept = golden.stored("user_touch")
    changed = copy.deepcopy(kept)
    numbers = changed["results.json"]["numbers"]
    numbers["big/return"] += 0.01 + 0.1 * abs(numbers["big/return"]) + 0.05
    assert len(golden.differences(kept, changed, bits=False)) == 1
    changed = copy.deepcopy(kept)
    changed["results.json"]["sha256"] = "0"
    assert golden.differences(kept, changed, bits=False) == []
    assert golden.differences(kept, changed, bits=True)
