"""Values as people write them behind ``--set KEY=``: as in YAML, or as text where a key is text."""

from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from sim2vr_harness.base.bounded_yaml import parse_yaml
from sim2vr_harness.base.errors import InputError

_NULLS = ("", "~", "null", "Null", "NULL")
"""Texts that YAML reads as null; a comment alone is not meant as null."""


def written_value(text: str, declared: Any) -> Any:
    """Return the value that a text stands for.

    A text key takes the text as it is, or what stands between quotes. A key that can be text or
    something else, such as a number, takes what YAML makes of it where that is something else.

    Args:
        text: What was written.
        declared: The annotation of the setting; None where it is not known.

    Raises:
        InputError: It is not YAML, and no text is expected.
    """
    plain = text.strip()
    kinds, words = _taken(declared)
    if plain in words:
        return plain
    try:
        value = parse_yaml(text, "", "")
    except InputError:
        if str not in kinds:
            raise
        return plain
    if value is None and plain not in _NULLS:
        return plain  # a comment
    quoted = isinstance(value, str) and plain[0] in "\"'"
    return value if quoted or str not in kinds or type(value) in kinds - {str} else plain


def _taken(declared: Any) -> tuple[set[type], set[str]]:
    """Return the types of YAML that a setting takes, and single words."""
    origin = get_origin(declared)
    if origin is Annotated:
        return _taken(get_args(declared)[0])
    kinds: set[type] = set()
    words: set[str] = set()
    if origin in (Union, UnionType):
        for member in get_args(declared):
            more = _taken(member)
            kinds |= more[0]
            words |= more[1]
    elif origin is Literal:
        kinds |= {type(word) for word in get_args(declared)}
        words |= {word for word in get_args(declared) if isinstance(word, str)}
    elif origin in (tuple, list):
        kinds.add(list)
    elif origin is dict or (isinstance(declared, type) and issubclass(declared, BaseModel)):
        kinds.add(dict)
    elif declared in (str, bool, int, float, NoneType):
        kinds |= {int, float} if declared is float else {declared}
    return kinds, words
