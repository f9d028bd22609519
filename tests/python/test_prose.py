"""Pages and the package keep to the rules of tools/docs/prose.py."""

import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_SPEC = importlib.util.spec_from_file_location("prose", ROOT / "tools/docs/prose.py")
assert _SPEC is not None and _SPEC.loader is not None
prose = importlib.util.module_from_spec(_SPEC)
sys.modules["prose"] = prose
_SPEC.loader.exec_module(prose)

SHORT = "A policy receives an observation and returns an action. "


def rules(text: str) -> list[str]:
    return [problem.rule for problem in prose.page_problems("page.md", text)]


def test_no_file_breaks_a_rule() -> None:
    assert [str(problem) for problem in prose.find_problems()] == []


def test_a_long_line_is_found() -> None:
    assert rules(SHORT * 5) == ["line"]
    assert rules("\n".join([SHORT] * 5)) == []


def test_tables_and_code_blocks_are_exempt() -> None:
    many = "1 2 3 4 " * 30
    assert rules(f"```\n{many}\n```\n| {many} |\n<!-- {many} -->\n[page]: {many}\n") == []


@pytest.mark.parametrize(
    ("first", "wrong"), [("What a user sees.", True), ("Whatever.", False), ("Senses.", False)]
)
def test_docstrings_that_begin_with_a_question_word(first: str, wrong: bool) -> None:
    assert bool(list(prose.docstring_problems("a.py", f'"""{first}"""\n'))) is wrong


def test_retired_words_in_text_names_and_file_names() -> None:
    words = prose.retired_words("# comment\nin vain -> without success\ntwin* -> game model\n")

    def lines(text: str, path: str = "a.py") -> list[int]:
        return [problem.line for problem in prose.word_problems(path, text, words)]

    assert lines("in vain") == [1]
    assert lines("a\n# waits in\n    # vain") == [2]
    assert lines("GameTwin\ngame_twins\nentwine(): invain") == [1, 2]
    assert lines("", "game_twin.py") == [1]
    problem = next(prose.word_problems("a.py", "\nTwins", words))
    assert str(problem) == 'a.py:2: word: "twins": write game model'


def test_every_retired_word_is_one_that_can_be_found() -> None:
    words = prose.retired_words((ROOT / prose.WORDS).read_text(encoding="utf-8"))
    assert len(words) > 40
    for phrase in words:
        assert list(prose.word_problems("a", phrase.replace("*", "s"), words)), phrase
