"""The glossary is sorted, and every term has one sentence and a link that leads somewhere."""

import re
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs/glossary.md"
TEXT = PAGE.read_text(encoding="utf-8")
ROWS = re.findall(r"^- \*\*(.+?)\*\*: (.+?)(?=^- |^## |^\[|\Z)", TEXT, flags=re.S | re.M)
LINKS = dict(re.findall(r"^\[(\w+)\]: (\S+)$", TEXT, flags=re.M))


def test_terms_are_sorted() -> None:
    terms = [term.lower() for term, _ in ROWS]
    assert len(terms) > 20
    assert terms == sorted(set(terms))


def test_terms_stand_below_their_letter() -> None:
    for letter, section in re.findall(r"^## (\w)\n(.*?)(?=^## |\Z)", TEXT, flags=re.S | re.M):
        terms = re.findall(r"^- \*\*(.)", section, flags=re.M)
        assert {term.upper() for term in terms} == {letter}


def test_each_term_has_one_sentence_and_a_link() -> None:
    for term, text in ROWS:
        sentence, link = " ".join(text.split()).rsplit(" (", 1)
        assert re.fullmatch(r"[^.]+\.", sentence), term
        found = re.fullmatch(r"\[.+\]\[(\w+)\]\)", link)
        assert found and found[1] in LINKS, term


def test_links_lead_somewhere() -> None:
    used = set(re.findall(r"\]\[(\w+)\]", TEXT))
    assert used == set(LINKS)
    assert [link for link in LINKS.values() if not (PAGE.parent / link).is_file()] == []
