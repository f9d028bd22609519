"""One pattern for the names of test files in each language."""

import re
from pathlib import Path

TESTS = Path(__file__).resolve().parents[2]


def test_cpp_tests_end_in_test_and_python_tests_begin_with_it() -> None:
    cpp = [file for file in TESTS.rglob("*.cpp") if re.search(r"^TEST", file.read_text(), re.M)]
    assert len(cpp) > 50
    assert [file.name for file in cpp if not file.name.endswith("_test.cpp")] == []
    python = [f for f in TESTS.rglob("*.py") if re.search(r"^def test_", f.read_text(), re.M)]
    assert len(python) > 40
    assert [file.name for file in python if not file.name.startswith("test_")] == []
