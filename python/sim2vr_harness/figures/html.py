"""One HTML file that opens without a network: answer, picture, table, then everything else."""

import base64
import re
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.optional import needed
from sim2vr_harness.client import AppError, AppRefused
from sim2vr_harness.client.webxr.browser import print_page
from sim2vr_harness.figures.figure import Figure
from sim2vr_harness.figures.matplotlib_backend import still_of
from sim2vr_harness.figures.plotly_backend import plotly_of

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1]),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
_NUMBER = re.compile(r"[-+−–<>]?\s*[\d.]|-$|–$|$")
_PAPER_PX = 1440.0
"""Width of a still that fills a page."""

Part = str | Figure
"""Of a page: text is a paragraph, :class:`Markup` stays as it is."""


def render(template: str, **values: Any) -> Markup:
    """Return a template of the package with these values; all but :class:`Markup` is escaped."""
    return Markup(_TEMPLATES.get_template(template).render(values))


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], bad: Collection[int] = ()
) -> Markup:
    """Return an HTML table, numbers at the right and texts at the left.

    Args:
        bad: Numbers of rows to point out.
    """
    rows = list(rows)
    columns = zip(*(map(_plain, row) for row in rows), strict=True)
    numbers = [all(map(_NUMBER.match, column)) and any(column) for column in columns]
    kinds = ["number" if number else "text" for number in numbers] or [""] * len(header)
    kinds[0] = ""
    return render("figures/table.html.jinja", header=header, rows=rows, bad=bad, kinds=kinds)


def _plain(cell: str) -> str:
    return cell.striptags() if isinstance(cell, Markup) else cell


def listed(texts: Iterable[str]) -> Markup:
    """Return a list of sentences."""
    return Markup("<ul>{}</ul>").format(
        Markup().join(Markup("<li>{}</li>").format(text) for text in texts)
    )


def image(content: bytes, about: str, kind: str = "png") -> Markup:
    """Return a picture; ``about`` says what is to be seen."""
    text = base64.b64encode(content).decode()
    return Markup('<img alt="{}" src="data:image/{};base64,{}">').format(about, kind, text)


def drawn(figure: Figure, *, still: bool = True) -> Markup:
    """Return a figure: its caption, plots for the screen and, if wanted, a still for paper."""
    content = still_of(figure, "png") if still else b""
    # PNG: the width stands behind eight bytes of signature and eight of the first block.
    width = round(100 * min(1.0, int.from_bytes(content[16:20], "big") / _PAPER_PX))
    values = {"still": base64.b64encode(content).decode(), "width": width}
    panels = [(panel, plotly_of(panel)) for panel in figure.panels]
    found = render("figures/figure.html.jinja", figure=figure, panels=panels, **values)
    return found if still else Markup('<div class="screen">{}</div>').format(found)


def save_page(
    file: Path,
    title: str,
    answer: str,
    first: Iterable[Part] = (),
    sections: Iterable[tuple[str, Iterable[Part]]] = (),
    *,
    printed: bool = False,
) -> list[Path]:
    """Write a page, and return its files.

    Args:
        file: The HTML file.
        title: The question.
        answer: One sentence, which stands first.
        first: What else is on the first screen: a picture and a table.
        sections: Headings and what is below them.
        printed: Whether to write a PDF of the same name, too, if a browser can.

    Raises:
        InputError: Plotly is not installed.
    """

    def shown(part: Part) -> Markup:
        if isinstance(part, Figure):
            return drawn(part)
        return part if isinstance(part, Markup) else Markup("<p>{}</p>").format(part)

    top = [shown(part) for part in first]
    rest = [(heading, [shown(part) for part in parts]) for heading, parts in sections]
    plotted = any(
        '<div class="plot"' in part for part in (*top, *(p for _, own in rest for p in own))
    )
    library = needed("plotly.offline", "studies", "report").get_plotlyjs() if plotted else ""
    values = {"title": title, "answer": answer, "first": top, "sections": rest}
    page = render("figures/page.html.jinja", plotly=Markup(library), **values)
    write_atomically(file, page.encode())
    files = [file]
    if printed:
        with suppress(AppRefused, AppError):
            files.append(print_page(file, file.with_suffix(".pdf")))
    return files
