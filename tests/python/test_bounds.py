"""Every number of every configuration has bounds, and what is out of them is refused in words."""

from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import BaseModel

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.games.whacamole.settings import GameModelSettings
from sim2vr_harness.runs.config import TrainingConfig, parse_config
from sim2vr_harness.studies.config import StudyConfig
from sim2vr_harness.users import Physique
from sim2vr_harness.users.bodies.description import BodyDescription

MODELS = (TrainingConfig, BodyDescription, Physique, GameModelSettings, StudyConfig)
LOW, HIGH = {"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}
WRONG = (float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 2**63, -(2**63), 10**400, "x")
ODD = (-1, 0, 1e-9, 0.5, 1, 2**31)


def numbers(schema: dict[str, Any], at: str, top: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Every place of a number in a JSON schema, and its part of the schema."""
    if "$ref" in schema:
        schema = top["$defs"][schema["$ref"].rpartition("/")[2]]
    if schema.get("type") in ("integer", "number"):
        yield at, schema
    members = schema.get("anyOf", [])
    if {"type": "boolean"} in members:
        return  # an option of a game, which knows its own bounds
    for key, part in schema.get("properties", {}).items():
        yield from numbers(part, f"{at}.{key}" if at else key, top)
    inner = [
        schema.get("items"),
        schema.get("additionalProperties"),
        *schema.get("prefixItems", []),
    ]
    for part in [*members, *inner]:
        if isinstance(part, dict):
            yield from numbers(part, at, top)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_number_has_bounds(model: type[BaseModel]) -> None:
    schema = model.model_json_schema()
    found = dict(numbers(schema, "", schema))
    assert len(found) >= 3
    unbounded = [
        at
        for at, part in found.items()
        if "enum" not in part and not (LOW & part.keys() and HIGH & part.keys())
    ]
    assert unbounded == []


def keys() -> list[str]:
    schema = TrainingConfig.model_json_schema()
    return [at for at, _ in numbers(schema, "", schema) if not at.startswith("env.senses")]


def tree(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


@pytest.mark.parametrize("key", keys())
def test_a_number_is_refused_in_one_sentence_or_taken(key: str) -> None:
    for value in (*WRONG, *ODD):
        for given in (value, [value]):
            try:
                config = parse_config(tree(key, given))
            except InputError as error:
                assert error.field.startswith(key.rpartition(".")[0])
                assert str(error).isprintable()
                assert len(str(error)) < 400
            else:
                named = (key, value) == ("env.user.reset.posture", "x")  # a posture's name
                assert value in ODD or named, (key, value)
                assert parse_config(config.model_dump()) == config
