"""Check the words of the documentation and the package.

Rules:

- ``line``: a line of prose on a page has at most 120 characters
- ``docstring``: a module's docstring does not begin with What, Who, Where, How or Which
- ``word``: no word of tests/data/retired_words.txt in pages, configurations and the package

Tables, code blocks and docs/evidence/ are exempt. No file may break a rule.

Run: python tools/docs/prose.py [FILE ...] to list the problems
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORDS = "tests/data/retired_words.txt"

LINE_CHARACTERS = 120

EXEMPT = (
    "docs/evidence/",
    "docs/reference/settings.md",
    "docs/reference/command_line.md",
    "docs/reference/measures.md",
    "docs/reference/files.md",
)
"""Pages of figures and generated pages."""


@dataclass(frozen=True)
class Problem:
    """One place that breaks a rule."""

    path: str
    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        """Return the problem as compilers print theirs."""
        return f"{self.path}:{self.line}: {self.rule}: {self.text}"


# ---------------------------------------------------------------- pages


def prose(text: str) -> list[str]:
    """Return a page's lines; code blocks, comments, tables and definitions of links are empty."""

    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    text = re.sub(r"^( *)(```+|~~~+).*?^\1\2\s*$", blank, text, flags=re.S | re.M)
    text = re.sub(r"<!--.*?-->", blank, text, flags=re.S)
    return ["" if re.match(r"\s*\||\[\w+\]: ", line) else line for line in text.split("\n")]


def page_problems(path: str, text: str) -> Iterator[Problem]:
    """Yield what breaks the rules of pages."""
    for number, line in enumerate(prose(text), start=1):
        if len(line) > LINE_CHARACTERS:
            yield Problem(path, number, "line", f"{len(line)} characters: {line[:60]}...")


# ---------------------------------------------------------------- the package


def docstring_problems(path: str, text: str) -> Iterator[Problem]:
    """Yield a module's docstring that begins with a question word."""
    first = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    if re.match(r"(What|Who|Where|How|Which)\b", first):
        yield Problem(path, 1, "docstring", first)


# ---------------------------------------------------------------- words


def retired_words(text: str) -> dict[str, str]:
    """Return each retired phrase with its replacement, from ``phrase -> replacement`` lines."""
    rows = (line.partition("->") for line in text.splitlines() if line.strip() and line[0] != "#")
    return {phrase.strip(): better.strip() for phrase, _, better in rows}


def phrase_pattern(phrases: Sequence[str]) -> re.Pattern[str]:
    """Return a pattern for any of the phrases; ``*`` stands for the rest of a word."""
    gap = r"[ \t\n#*>\"'-]+"  # also over a line's end, in a comment or between two strings
    parts = [
        gap.join(re.escape(p).replace(r"\*", "[a-z]*") for p in each.split()) for each in phrases
    ]
    return re.compile(r"(?<![a-z])(?:" + "|".join(parts) + r")(?![a-z])")


def separated(text: str) -> str:
    """Return text in lower case with the words of names apart: ``GameTwin`` -> ``game twin``."""
    text = re.sub(r"(?<=[a-z\d])(?=[A-Z])", " ", text)
    return text.replace("_", " ").lower()


def word_problems(path: str, text: str, words: Mapping[str, str]) -> Iterator[Problem]:
    """Yield the retired words of a file, those in its name included."""
    pattern = phrase_pattern(list(words))
    for match in pattern.finditer(separated(Path(path).stem)):
        yield Problem(path, 1, "word", _advice(match[0], words) + " (in the file's name)")
    text = separated(text)
    for match in pattern.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        yield Problem(path, line, "word", _advice(match[0], words))


def _advice(found: str, words: Mapping[str, str]) -> str:
    better = next(b for phrase, b in words.items() if phrase_pattern([phrase]).fullmatch(found))
    found = " ".join(re.findall(r"[a-z]+", found))
    return f'"{found}": write {better}' if better else f'"{found}": say it in plain words'


# ---------------------------------------------------------------- all of it


def pages(root: Path = ROOT) -> list[Path]:
    """Return the pages that users read, research notes left out."""
    found = [root / "README.md", *sorted(root.glob("docs/**/*.md"))]
    own = [page for page in found if page.exists() and "node_modules" not in page.parts]
    return [page for page in own if "engines" not in page.parts and not _exempt(page, root)]


def _exempt(path: Path, root: Path) -> bool:
    return path.relative_to(root).as_posix().startswith(EXEMPT)


def find_problems(root: Path = ROOT) -> list[Problem]:
    """Return every problem of the pages, configurations and the package."""
    words = retired_words((root / WORDS).read_text(encoding="utf-8"))
    modules = sorted(root.glob("python/sim2vr_harness/**/*.py"))
    configs = [*sorted(root.glob("configs/*.yaml")), *sorted(root.glob("studies/*.yaml"))]
    problems = list[Problem]()
    for file in [*pages(root), *configs, *modules]:
        if _exempt(file, root):
            continue
        path, text = file.relative_to(root).as_posix(), file.read_text(encoding="utf-8")
        if file.suffix == ".md":
            problems += page_problems(path, text)
        if file.suffix == ".py":
            problems += docstring_problems(path, text)
        problems += word_problems(path, text, words)
    return problems


def main(arguments: Sequence[str] | None = None) -> int:
    """List the problems; 1 if there are any."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("files", nargs="*", metavar="FILE", help="list these files only")
    files = parser.parse_args(arguments).files
    problems = [p for p in find_problems() if not files or p.path in files]
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
