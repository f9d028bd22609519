"""Writes docs/reference/settings.md, command_line.md, measures.md and files.md from the package.

Run: make reference
"""

import ast
import inspect
import math
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
import typer.main
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from sim2vr_harness.cli.command import HEADINGS
from sim2vr_harness.cli.main import app
from sim2vr_harness.client import describe_game, list_games, list_options
from sim2vr_harness.client.openxr.app import OPENXR
from sim2vr_harness.client.tasks.rules import TaskRules
from sim2vr_harness.client.webxr.app import WEBXR
from sim2vr_harness.games.registry import imagined_games, imagined_settings
from sim2vr_harness.human_comparison.measures import EVERY_MEASURE
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.studies.config import StudyConfig
from sim2vr_harness.studies.effects import EffectsConfig
from sim2vr_harness.users.bodies.description import BodyDescription

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = ROOT / "docs/reference/settings.md"
COMMAND_LINE = ROOT / "docs/reference/command_line.md"
MEASURES = ROOT / "docs/reference/measures.md"
FILES = ROOT / "docs/reference/files.md"

INTRODUCTION = """\
# Settings

All keys of a training configuration. Set a key in the YAML file of the configuration, or on the
command line:

```sh
sim2vr-harness train sample --set env.action_frequency_hz=20
```

Nested keys are written with dots. `NAME` stands for a name that you choose, `[]` for each entry of
a list. A value outside its range is an error that names the key. `make reference` writes this page
from the configuration models; edit their docstrings, not this file.
"""

UNITS = {
    "per_s": "1/s",
    "mps": "m/s",
    "ms": "ms",
    "s": "s",
    "seconds": "s",
    "m": "m",
    "kg": "kg",
    "deg": "deg",
    "hz": "Hz",
    "pixels": "px",
    "timesteps": "user steps",
    "steps": "user steps",
    "frames": "user steps",
    "cycles": "cycles",
    "updates": "updates",
    "minibatches": "minibatches",
    "episodes": "episodes",
    "rounds": "rounds",
    "channels": "channels",
}
"""Suffix of a key -> unit."""


@dataclass(frozen=True)
class Setting:
    """One key of a configuration, as the table shows it."""

    key: str
    type: str
    unit: str
    default: str
    range: str
    meaning: str

    def row(self) -> str:
        """Return the table's row."""
        cells = [f"`{self.key}`", self.type, self.unit, self.default, self.range, self.meaning]
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


# ---------------------------------------------------------------- docstrings


def docstrings(model: type[BaseModel]) -> dict[str, str]:
    """Return the docstring below each field of a model, inherited ones included."""
    found: dict[str, str] = {}
    for each in reversed(model.__mro__):
        if not (issubclass(each, BaseModel) and each.__module__.startswith("sim2vr_harness")):
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(each))).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, below in pairwise(body.body):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value)):
                    found[name] = str(value)
    return found


def sentence(text: str) -> str:
    """Return the first sentence of a docstring as Markdown; pages named in it become links."""
    text = re.split(r"(?<=[.])\s+(?=[\"'`(]*[A-Z])", " ".join(text.split()))[0]
    text = re.sub(r":\w+:`[~.]?([\w.]+)`", r"`\1`", text.replace("``", "`"))
    return re.sub(r"docs/([\w/]+\.md)", r"[\1](../\1)", text)


# ---------------------------------------------------------------- types and values


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the configuration models that a field may hold."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def type_name(annotation: Any) -> str:
    """Return a type in words, such as ``list of numbers``."""
    origin, args = get_origin(annotation), get_args(annotation)
    names = {str: "text", int: "integer", float: "number", bool: "true or false", NoneType: "none"}
    if annotation in names:
        return names[annotation]
    if origin is Annotated:
        return type_name(args[0])
    if origin is Literal:
        return " or ".join("true" if each is True else f"`{each}`" for each in args)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(type_name(each) for each in args))
    if origin in (tuple, list):
        return "list of " + plural(type_name(args[0]))
    if origin is dict:
        return "mapping of names to " + plural(type_name(args[1]))
    return "mapping"


def plural(name: str) -> str:
    """Return the plural of a type's name; of alternatives, each one's."""
    words = {"text": "texts", "integer": "integers", "number": "numbers", "mapping": "mappings"}
    return " or ".join(words.get(part, part) for part in name.split(" or "))


def bounds(field: FieldInfo) -> str:
    """Return the range of a number, such as ``0 to 1``; of a list, the one of its entries."""
    found = [*field.metadata, *_metadata(field.annotation)]
    low = high = ""
    for each in found:
        if isinstance(each, annotated_types.Ge):
            low = low or number(each.ge)
        elif isinstance(each, annotated_types.Gt):
            low = low or "above " + number(each.gt)
        elif isinstance(each, annotated_types.Le):
            high = high or number(each.le)
        elif isinstance(each, annotated_types.Lt):
            high = high or "below " + number(each.lt)
    return f"{low} to {high}" if low and high else low or high


def _metadata(annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) is Annotated:
        for each in get_args(annotation)[1:]:
            yield from each.metadata if isinstance(each, FieldInfo) else [each]
    if get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from _metadata(part)


def number(value: Any) -> str:
    """Return a bound in few characters: powers of ten above 10,000 as 1e6, of two as 2^31."""
    if isinstance(value, int) and value > 10**4 and math.log2(value) % 1 == 0:
        return f"2^{int(math.log2(value))}"
    if abs(value) > 10**4:
        power = round(math.log10(abs(value)))
        if abs(value) == 10**power:
            return f"{'-' * (value < 0)}1e{power}"
    return str(value) if isinstance(value, int) else f"{value:g}"


def shown(value: Any) -> str:
    """Return a default in YAML's words."""
    if value is None or value == "":
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(shown(each) for each in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {shown(each)}" for key, each in value.items()) + "}"
    return f"`{value}`"


def unit(key: str) -> str:
    """Return the unit that the suffix of a key names."""
    name = key.rpartition(".")[2]
    suffix = next((s for s in UNITS if name == s or name.endswith("_" + s)), "")
    return UNITS.get(suffix, "")


# ---------------------------------------------------------------- walking


def settings(model: type[BaseModel], defaults: Any, at: str = "") -> Iterator[Setting]:
    """Yield every key of a model in order, nested ones after their parent.

    Args:
        model: the configuration model.
        defaults: an instance with the default values; None: the fields' own.
        at: the dotted key of the model.
    """
    texts = docstrings(model)
    for name, field in model.model_fields.items():
        key = f"{at}.{name}" if at else name
        value = (
            field.get_default(call_default_factory=True)
            if defaults is None
            else getattr(defaults, name)
        )
        inner = models_in(field.annotation)
        kind = type_name(field.annotation)
        numeric = "number" in kind or "integer" in kind
        if not (inner and isinstance(value, BaseModel)):
            default = "required" if field.is_required() else shown_default(value)
            yield Setting(
                key,
                kind,
                unit(key) if numeric else "",
                default,
                bounds(field) if numeric else "",
                sentence(texts.get(name, "")),
            )
        for each in inner:
            container = get_origin(_without_none(field.annotation))
            below = {tuple: f"{key}[]", list: f"{key}[]", dict: f"{key}.NAME"}.get(container, key)
            yield from settings(each, value if isinstance(value, each) else None, below)


def _without_none(annotation: Any) -> Any:
    parts = [part for part in get_args(annotation) if part is not NoneType]
    return parts[0] if get_origin(annotation) in (Union, UnionType) and parts else annotation


def shown_default(value: Any) -> str:
    """Return a default; of a list of models the names of its entries."""
    if isinstance(value, tuple) and any(isinstance(each, BaseModel) for each in value):
        return (
            "[" + ", ".join(f"`{next(iter(each.model_dump().values()))}`" for each in value) + "]"
        )
    return shown(value)


def game_settings() -> Iterator[tuple[str, list[Setting]]]:
    """Yield each game with the keys of ``teacher.imagined.game``."""
    for game in imagined_games():
        model = imagined_settings(game)
        assert model is not None
        yield game, list(settings(model, model(), "teacher.imagined.game"))


# ---------------------------------------------------------------- the page


def section(key: str) -> str:
    """Return the heading under which a key stands: its first two parts at most."""
    parts = re.split(r"[.\[]", key)[:-1]
    return ".".join(parts[: 2 if parts[:1] in (["env"], ["teacher"], ["skills"]) else 1])


def table(rows: list[Setting]) -> str:
    """Return rows as a Markdown table."""
    head = "| Key | Type | Unit | Default | Range | Meaning |\n|---|---|---|---|---|---|\n"
    return head + "\n".join(row.row() for row in rows) + "\n"


def settings_page() -> str:
    """Return the page of settings."""
    groups: dict[str, list[Setting]] = {}
    for each in settings(TrainingConfig, TrainingConfig()):
        groups.setdefault(section(each.key), []).append(each)
    texts = {name: sentence(text) for name, text in docstrings(TrainingConfig).items()}
    parts = [INTRODUCTION]
    for name, rows in groups.items():
        title = f"`{name}`" if name else "The run"
        parts.append(f"## {title}\n" + (f"\n{texts[name]}\n" if name in texts else ""))
        parts.append(table(rows))
    for game, rows in game_settings():
        parts.append(f"## `teacher.imagined.game` of `{game}`\n")
        parts.append(table(rows))
    return "\n".join(parts)


# ---------------------------------------------------------------- the command line

COMMANDS_INTRODUCTION = """\
# Command line

All commands of `sim2vr-harness`. `sim2vr-harness COMMAND --help` prints the same options
and examples.
`make reference` writes this page from the commands; edit their help, not this file.
"""


def option_row(parameter: Any) -> str:
    """Return the row of an argument or an option."""
    if parameter.param_type_name == "argument":
        name = f"`{(parameter.metavar or parameter.name).strip('[]').upper()}`"
        default = "required" if parameter.required else shown_option(parameter)
    else:
        value = "" if parameter.is_flag else f" {parameter.metavar or option_type(parameter)}"
        spellings = [*parameter.opts, *parameter.secondary_opts]
        name = ", ".join(f"`{each}{value}`" for each in spellings)
        default = "required" if parameter.required else shown_option(parameter)
    text = re.sub(r"docs/([\w/]+\.md)", r"[\1](../\1)", " ".join((parameter.help or "").split()))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in (name, default, text)) + " |"


def option_type(parameter: Any) -> str:
    """Return the placeholder of an option's value."""
    annotation = parameter.type_descriptor.annotation
    names = {int: "INTEGER", float: "NUMBER", Path: "PATH"}
    return names.get(annotation, "TEXT")


def shown_option(parameter: Any) -> str:
    """Return the default of an option; of flags without one nothing."""
    value = parameter.default
    if isinstance(parameter.show_default, str):
        return parameter.show_default
    if value is None or value is False or value == [] or callable(value):
        return ""
    if parameter.secondary_opts and value is True:
        return f"`{parameter.opts[0]}`"
    return shown(getattr(value, "value", value))


def command_section(name: str, command: Any) -> Iterator[str]:
    """Yield the section of a command and those of the commands below it."""
    yield f"## `{name}`\n\n{' '.join((command.help or '').split())}\n"
    rows = [option_row(each) for each in command.params if not getattr(each, "hidden", False)]
    if rows:
        yield "| Option | Default | Meaning |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    yield "```sh\n" + "\n".join(command.examples) + "\n```\n"
    for below, each in getattr(command, "commands", {}).items():
        if not each.hidden:
            yield from command_section(f"{name} {below}", each)


def command_line_page() -> str:
    """Return the page of commands, in the groups of ``--help``."""
    main_command: Any = typer.main.get_command(app)
    known = {name: each for name, each in main_command.commands.items() if not each.hidden}
    parts = [COMMANDS_INTRODUCTION, "| Group | Commands |\n|---|---|"]
    groups = {
        heading: [name for name, each in known.items() if each.rich_help_panel == heading]
        for heading in HEADINGS
    }
    for heading, names in groups.items():
        parts[-1] += f"\n| {heading} | {', '.join(f'[`{name}`](#{name})' for name in names)} |"
    parts[-1] += "\n"
    for name in (name for names in groups.values() for name in names):
        parts += command_section(name, known[name])
    return "\n".join(parts)


# ---------------------------------------------------------------- games, measures, files

WRITTEN = "`make reference` writes this page from the package; edit its texts, not this file.\n"


def rows(head: str, cells: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; `head` has the names of its columns, separated by commas."""
    names = head.split(", ")
    lines = [names, ["---"] * len(names), *cells]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n"


def measures_page() -> str:
    """Return the page of the games' facts and of the measures of behaviour."""
    parts = [f"# Conditions, options and measures\n\n{WRITTEN}"]
    for game in sorted(list_games()):
        facts = describe_game(game)
        parts.append(f"## `{game}`\n\n{facts.description}.\n")
        parts.append(
            rows("Condition, Content", [(c.name, c.description) for c in facts.conditions])
        )
        found = [
            (f"`{m.name}`", m.unit, m.better, m.description or m.label) for m in facts.measures
        ]
        parts.append(rows("Measure, Unit, Better, Meaning", found) if found else "")
        options = [(f"`{o.name}`", o.type, shown(o.default), o.range) for o in list_options(game)]
        parts.append(rows("Option, Type, Default, Range", options))
    people = [(f"`{m.name}`", m.family, m.unit, m.where.value, m.label) for m in EVERY_MEASURE]
    parts.append("## Measures of behaviour\n\nThe [method](human_measures.md) of `compare`.\n")
    return "\n".join([*parts, rows("Measure, Family, Unit, Where, Meaning", people)])


def files_page() -> str:
    """Return the page of the keys of studies, bodies, tasks and transports."""
    parts = [f"# Keys of files\n\n{WRITTEN}"]
    for model in (StudyConfig, EffectsConfig, BodyDescription, TaskRules):
        title = re.sub(r"Config|Description|Rules", "", model.__name__)
        parts.append(f"## {title}\n\n{table(list(settings(model, None)))}")
    for transport in (WEBXR, OPENXR):
        found = [(f"`{name}`", text) for name, text in transport.options.items()]
        parts.append(f"## Options of `{transport.name}`\n\n{rows('Option, Meaning', found)}")
    return "\n".join(parts)


PAGES = {
    SETTINGS: settings_page,
    COMMAND_LINE: command_line_page,
    MEASURES: measures_page,
    FILES: files_page,
}
"""Page -> the function that writes it."""


def main() -> int:
    """Write the pages."""
    for path, page in PAGES.items():
        path.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
