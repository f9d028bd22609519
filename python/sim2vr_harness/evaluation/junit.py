"""Write results of checks as JUnit XML, which services for continuous integration read."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from sim2vr_harness.base.errors import printable
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.evaluation.expectations import CheckResult


def write_junit(file: Path, suite: str, results: Sequence[CheckResult], seconds: float) -> None:
    """Write a test suite with a test case per check and condition or cell.

    Args:
        file: To write; its folder is made.
        suite: Name of the suite.
        results: Of the checks.
        seconds: The time that playing and checking took.
    """
    counts = {
        "tests": len(results),
        "failures": sum(one.failure is not None for one in results),
        "errors": 0,
        "skipped": sum(one.skipped is not None for one in results),
    }
    root = ElementTree.Element("testsuites")
    about = {key: str(count) for key, count in counts.items()} | {"time": f"{seconds:.3f}"}
    cases = ElementTree.SubElement(root, "testsuite", {"name": printable(suite), **about})
    for one in results:
        names = {"classname": printable(one.group), "name": printable(one.name), "time": "0"}
        case = ElementTree.SubElement(cases, "testcase", names)
        if one.failure is not None:
            message = printable(one.failure)
            failure = ElementTree.SubElement(case, "failure", {"message": message, "type": "check"})
            failure.text = message
        elif one.skipped is not None:
            ElementTree.SubElement(case, "skipped", {"message": printable(one.skipped)})
    ElementTree.indent(root)
    content = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    write_atomically(file, content + b"\n")
