"""The page: one HTML file with everything in it, which opens without a network."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from sim2vr_harness.base.errors import counted
from sim2vr_harness.figures.figure import Figure
from sim2vr_harness.figures.html import embedded_json, plotly_code
from sim2vr_harness.figures.plotly_backend import plotly_of
from sim2vr_harness.games.published import Published
from sim2vr_harness.studies.report.body import BodyPicture
from sim2vr_harness.studies.report.media import Example
from sim2vr_harness.studies.report.methods import BIBTEX, PlayedBy
from sim2vr_harness.studies.report.search import trial_table
from sim2vr_harness.studies.report.sentences import (
    MOST_SENTENCES,
    Sentence,
    n_sentence,
)
from sim2vr_harness.studies.report.source import ReportSource
from sim2vr_harness.studies.report.tables import (
    beside_table,
    glossary,
    measure_table,
    published_tests,
    test_table,
    user_table,
)

_HERE = Path(__file__).parent


@dataclass(frozen=True)
class Content:
    """What a page is made of.

    Attributes:
        source: What was measured.
        published: What is known of others.
        sentences: The summary.
        figures: In the order of the page.
        bodies: Pictures for the figure ``body``.
        examples: Films.
        users: Who played.
        methods: The paragraph.
    """

    source: ReportSource
    published: Published
    sentences: Sequence[Sentence]
    figures: Sequence[Figure]
    bodies: Sequence[BodyPicture]
    examples: Sequence[Example]
    users: Sequence[PlayedBy]
    methods: str


def page_of(content: Content) -> str:
    """Return the page."""
    panels: list[dict] = []
    searched = [figure for figure in content.figures if figure.key.startswith("search")]
    first = [figure for figure in content.figures if figure.key == "measures"]
    others = [figure for figure in content.figures if figure not in (*searched, *first)]
    sections = [
        ("summary", "In plain words", _summary(content)),
        *(
            (
                f.key,
                f.title,
                _figure(f, panels)
                + (trial_table(content.source) if f.key == "search_parallel" else ""),
            )
            for f in searched
        ),
        *(
            (
                f.key,
                f.title,
                (_figure(f, panels) + measure_table(content.source, content.published)),
            )
            for f in first
        ),
        *((f.key, f.title, _figure(f, panels, _bodies(content, f))) for f in others),
        ("examples", "Examples", _examples(content)),
        ("beside", "Beside people and publications", _beside(content)),
        ("n", "What n is, and what was tested", _tests(content)),
        ("methods", "Methods", _methods(content)),
    ]
    written = [(key, title, html) for key, title, html in sections if html]
    links = " ".join(f'<a href="#{key}">{escape(title)}</a>' for key, title, _ in written)
    body = "\n".join(
        f'<section id="{key}"><h2>{escape(title)}</h2>{html}</section>'
        for key, title, html in written
    )
    title = escape(content.source.title)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>
{(_HERE / "style.css").read_text(encoding="utf-8")}</style>
</head>
<body>
<header><h1>{title}</h1><p class="lead">{escape(_lead(content))}</p><nav>{links}</nav></header>
<main>
{body}
</main>
<footer><p>Written by sim2vr-harness report.</p></footer>
<script>{plotly_code("report")}</script>
<script type="application/json" id="panels">{embedded_json(panels)}</script>
<script>
{(_HERE / "page.js").read_text(encoding="utf-8")}</script>
</body>
</html>
"""


def _lead(content: Content) -> str:
    source = content.source
    rounds = sum(len(group.episodes) for group in source.groups)
    about = f"{source.facts.description}. " if source.facts.description else ""
    return f"{about}{counted(rounds, 'round')} of {source.facts.name} by {', '.join(source.users)}."


def _summary(content: Content) -> str:
    items = [
        f'<li>{escape(one.text)}<span class="numbers">{escape(one.numbers)}</span></li>'
        for one in content.sentences
    ]
    first, more = items[:MOST_SENTENCES], "".join(items[MOST_SENTENCES:])
    html = f'<ul class="summary">{"".join(first)}</ul>'
    if more:
        html += f'<details><summary>More</summary><ul class="summary">{more}</ul></details>'
    return html


def _figure(figure: Figure, panels: list[dict], more: str = "") -> str:
    parts = []
    for panel in figure.panels:
        number = len(panels)
        panels.append(plotly_of(panel))
        wide = " wide" if panel.wide else ""
        name = escape(panel.title or figure.title, quote=True)
        heading = f"<h3>{escape(panel.title)}</h3>" if panel.title else ""
        parts.append(
            f'<div class="panel{wide}">{heading}<div class="keys"></div>'
            f'<div class="plot" id="plot{number}" role="img" aria-label="{name}"></div></div>'
        )
    caption = f'<p class="caption">{escape(figure.caption)}</p>'
    roomy = " roomy" if any(panel.crowded for panel in figure.panels) else ""
    return f'{caption}{more}<div class="panels{roomy}">{"".join(parts)}</div>'


def _bodies(content: Content, figure: Figure) -> str:
    if figure.key != "body" or not content.bodies:
        return ""
    pictures = "".join(
        f'<div class="panel"><h3>{escape(one.label)}</h3>'
        f'<img alt="Body of {escape(one.label, quote=True)}, muscles coloured by their load" '
        f'src="data:image/png;base64,{one.png}"></div>'
        for one in content.bodies
    )
    highest = content.bodies[0].highest
    left_out = len(content.source.groups) - len(content.bodies)
    if left_out > 0:
        pictures += f'<p class="people">No pictures of {left_out} more, which the tables have.</p>'
    scale = f'<div class="scale">0 <i></i> {highest:.2f}</div>'
    return f'<div class="panels">{pictures}</div>{scale}'


def _examples(content: Content) -> str:
    parts = []
    for one in content.examples:
        shown = ""
        if one.video is not None:
            source = f"data:video/mp4;base64,{one.video}"
            poster = f' poster="data:image/jpeg;base64,{one.poster}"' if one.poster else ""
            shown = f'<video controls muted loop playsinline{poster} src="{source}"></video>'
        else:
            pictures = "".join(
                f'<img alt="Picture {i + 1}" src="data:image/jpeg;base64,{picture}">'
                for i, picture in enumerate(one.strip)
            )
            shown = f'<div class="strip">{pictures}</div>'
        told = f'<p class="people">From {escape(one.name)}</p>'
        parts.append(f'<div class="panel"><h3>{escape(one.label)}</h3>{shown}{told}</div>')
    if not parts:
        return ""
    return (
        '<p class="caption">The beginning of the first round: body and game in one scene, muscles '
        "coloured by their activation (blue to red), and what the headset shows.</p>"
        f'<div class="panels roomy">{"".join(parts)}</div>'
    )


def _beside(content: Content) -> str:
    published = content.published
    ours = beside_table(content.source, published)
    if ours is None:
        return ""
    parts = []
    if published.people is not None:
        people = published.people
        parts.append(f'<p class="caption">{escape(people.title)}: {escape(people.citation)}.</p>')
    parts.append(ours)
    tests = published_tests(published)
    if tests is not None:
        parts.append(f"<h3>Published tests</h3>{tests}")
    if published.differences:
        items = "".join(f"<li>{escape(text)}</li>" for text in published.differences)
        parts.append(f"<h3>Why they differ</h3><ul>{items}</ul>")
    return "".join(parts)


def _tests(content: Content) -> str:
    told = n_sentence(content.source)
    parts = [f"<p>{escape(told.text)} <span class='people'>{escape(told.numbers)}</span></p>"]
    tested = test_table(content.source)
    if tested is None:
        parts.append(
            "<p class='caption'>No comparison was requested: a study's file has them "
            "(sim2vr-harness study).</p>"
        )
    else:
        parts.append(tested)
    return "".join(parts)


def _methods(content: Content) -> str:
    return (
        f'<p class="methods">{escape(content.methods)}</p>{user_table(content.users)}'
        f"<h3>Measures</h3>{glossary(content.source)}"
        f"<h3>BibTeX</h3><pre>{escape(BIBTEX)}</pre>"
    )
