"""A reward of one's own, described in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pydantic
from pydantic import Field

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.games.rewards import Formula, RewardTerms, Term


class _Term(Settings):
    """A part of the reward."""

    name: str = Field(min_length=1, max_length=60)
    when: Literal["step", "arrival", "absence"] = "step"
    value: float | str


class _Terms(Settings):
    """The file."""

    name: str = Field(default="own reward", min_length=1, max_length=60)
    start_m: float = Field(default=0.5, gt=0.0, le=10.0)
    reached_m: float = Field(default=0.025, ge=0.0, le=10.0)
    seconds: float = Field(default=1.0, ge=0.05, le=60.0)
    stays: bool = False
    terms: tuple[_Term, ...] = Field(min_length=1, max_length=20)


def read_terms(file: Path) -> RewardTerms:
    """Read a reward's terms.

    Raises:
        InputError: The file cannot be read; names the key and what was expected.
    """
    tree = read_yaml(file, "terms of a reward in YAML, with the list 'terms'")
    if not isinstance(tree, dict):
        raise InputError(file_name(file), type(tree).__name__, "a mapping with the list 'terms'")
    try:
        told = _Terms.model_validate(tree)
    except pydantic.ValidationError as error:
        raise first_problem(error, _Terms) from error
    if told.reached_m >= told.start_m:
        raise InputError("reached_m", f"{told.reached_m:g}", f"less than start_m, {told.start_m:g}")
    names = [term.name for term in told.terms]
    if len(set(names)) < len(names):
        raise InputError("terms", "a name twice", "every name once")
    terms = tuple(
        Term(term.name, term.when, Formula(term.value, f"terms.{i}.value"))
        for i, term in enumerate(told.terms)
    )
    rest = told.model_dump(exclude={"terms"})
    return RewardTerms(terms=terms, **rest)
