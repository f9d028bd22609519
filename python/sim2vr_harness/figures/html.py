"""One HTML file that opens without a network: words, tables, figures, all inside."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.optional import needed
from sim2vr_harness.figures.figure import Panel
from sim2vr_harness.figures.plotly_backend import plotly_of

_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parents[1]),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.policies["json.dumps_kwargs"] = {"separators": (",", ":")}


def render(template: str, **values: Any) -> Markup:
    """Return a template of the package with these values; all but :class:`Markup` is escaped."""
    return Markup(_TEMPLATES.get_template(template).render(values))


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    bad: Collection[int] = (),
    kind: Literal["", "wrap", "words"] = "",
) -> Markup:
    """Return an HTML table.

    Args:
        bad: Numbers of rows to point out.
        kind: ``wrap``: texts take several lines, so that a wide table fits; ``words``: they do,
            and begin at the left.
    """
    return render("figures/table.html.jinja", header=header, rows=rows, bad=bad, kind=kind)


def heading(text: str) -> Markup:
    """Return a heading within a page."""
    return Markup("<h2>{}</h2>").format(text)


def save_page(file: Path, title: str, parts: Iterable[str | Panel | Any]) -> Path:
    """Write a page.

    Args:
        file: The HTML file.
        title: Of the page.
        parts: From top to bottom: paragraphs of text, HTML (:class:`Markup`), panels, or Plotly's
            figures; both fill the width.

    Raises:
        InputError: Plotly is not installed.
    """
    shown: list[Markup] = []
    drawn = 0
    for part in parts:
        if isinstance(part, Markup):
            shown.append(part)
        elif isinstance(part, str):
            shown.append(Markup("<p>{}</p>").format(part))
        else:
            drawn += 1
            figure = needed("plotly.io", "studies", "--out").to_html(
                _with_title(part) if isinstance(part, Panel) else part,
                config={"responsive": True, "displaylogo": False},
                include_plotlyjs=drawn == 1,
                full_html=False,
                div_id=f"figure{drawn}",
                validate=False,
            )
            shown.append(Markup('<div class="figure">{}</div>').format(Markup(figure)))
    page = render("figures/page.html.jinja", title=title, parts=shown)
    write_atomically(file, page.encode())
    return file


def _with_title(panel: Panel) -> dict[str, Any]:
    """A panel with its title and legend, for Plotly."""
    found = plotly_of(panel)
    layout = found["layout"] | {"title": {"text": panel.title}, "showlegend": panel.legend}
    layout["margin"] |= {"t": 50}
    return {"data": found["data"], "layout": layout}
