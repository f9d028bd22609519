"""YAML with bounds: what a text of some thousand bytes can ask for, and no more.

A few lines of aliases to aliases stand for billions of values, and lists within lists exhaust the
stack. PyYAML's safe loader bounds neither, and takes the last of two equal keys without a word.
"""

from typing import Any

import yaml

from sim2vr_harness.base.errors import InputError, reason, shown

MOST_DEPTH = 32
"""Mappings and lists within each other."""
MOST_VALUES = 20_000
"""Values in all, those of aliases counted wherever they are used."""
MOST_DIGITS = 300
"""Of a whole number: about what a binary64 number can hold."""


def parse_yaml(text: str, source: str, expected: str) -> Any:
    """Return what a YAML text holds: mappings with text as keys, lists and plain values.

    Args:
        text: the YAML; a single document.
        source: where it is from, for the error.
        expected: what it should be, for the error.

    Raises:
        InputError: it is no YAML, stands for too much, or has a key twice or one that is no text;
            names ``source`` and the line.
    """
    try:
        loader = _Limited(text)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = source if mark is None else f"{source}, line {mark.line + 1}"
        raise InputError(where, _problem(error), expected) from error
    except Exception as error:  # what a tag promises and its value breaks raises anything
        got = f"text that is not YAML ({reason(error)})"
        raise InputError(source, got, expected) from error


def _problem(error: yaml.MarkedYAMLError) -> str:
    if isinstance(error, _Refused):
        return str(error.problem)
    parts = [" ".join(str(part).split()) for part in (error.problem, error.context) if part]
    return f"text that is not YAML ({', '.join(parts) or 'nothing that can be read'})"


class _Refused(yaml.MarkedYAMLError):
    """YAML that we do not take; the problem is what was got."""

    def __init__(self, problem: str, mark: Any) -> None:
        super().__init__(problem=problem, problem_mark=mark)


class _Limited(yaml.SafeLoader):
    """The safe loader with bounds, and with text as the only keys."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        if self._depth > MOST_DEPTH:
            raise _Refused(f"more than {MOST_DEPTH} levels", self.get_mark())
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _count(node, {}, set())
        return node

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            if not isinstance(key, yaml.ScalarNode):
                raise _Refused(f"a {key.id} as a key", key.start_mark)
            if key.tag != "tag:yaml.org,2002:str":
                raise _Refused(f"the key {shown(key.value)}, which is no text", key.start_mark)
            if key.value in seen:
                raise _Refused(f"the key {shown(key.value)} twice", key.start_mark)
            seen.add(key.value)
        return node


def _count(node: yaml.Node, known: dict[int, int], above: set[int]) -> int:
    """Return how many values a node stands for, aliases followed."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) in above:
        raise _Refused("an anchor that is used inside itself", node.start_mark)
    if id(node) not in known:
        above.add(id(node))
        count = 1
        for child in node.value:
            for part in child if isinstance(child, tuple) else (child,):
                count += _count(part, known, above)
                if count > MOST_VALUES:
                    raise _Refused(f"more than {MOST_VALUES:,} values", node.start_mark)
        above.remove(id(node))
        known[id(node)] = count
    return known[id(node)]


def _whole_number(loader: _Limited, node: yaml.ScalarNode) -> int:
    if len(node.value) > MOST_DIGITS:
        raise _Refused(f"a number of {len(node.value):,} digits", node.start_mark)
    return int(loader.construct_yaml_int(node))


_Limited.add_constructor("tag:yaml.org,2002:int", _whole_number)
