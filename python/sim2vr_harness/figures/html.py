"""One HTML file that opens without a network: words, tables, figures, all inside."""

import json
from collections.abc import Sequence
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any

from sim2vr_harness.base.files import naming
from sim2vr_harness.base.optional import needed
from sim2vr_harness.figures.figure import Panel
from sim2vr_harness.figures.plotly_backend import plotly_of

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#1c1f24;margin:0 auto;max-width:1200px;padding:0 16px}
h1{font-size:1.5rem;margin:1rem 0 .3rem}h2{font-size:1.15rem;margin:1.4rem 0 .3rem}
p{margin:.4rem 0}.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.9rem}
th,td{padding:.2rem .7rem;text-align:right;border-bottom:1px solid #dde1e6;white-space:nowrap}
th:first-child,td:first-child{text-align:left}.bad{color:#b3201f;font-weight:600}
.warn{background:#fff4d6;border-left:4px solid #e0a100;padding:.4rem .8rem;margin:.4rem 0}
.answer td,.answer th{white-space:normal;text-align:left;vertical-align:top}
.wrap td,.wrap th{white-space:normal}
.figure{width:100%}
"""


def embedded_json(value: Any) -> str:
    """Return JSON for a ``<script>`` of a page; no text in it can end or swallow the script."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


@lru_cache
def plotly_code(option: str) -> str:
    """Return Plotly's JavaScript for a ``<script>`` of a page.

    Args:
        option: What the user requested, for the message when Plotly is missing.

    Raises:
        InputError: Plotly is not installed.
    """
    code: str = needed("plotly.offline", "studies", option).get_plotlyjs()
    return code.replace("</script", "<\\/script")


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    bad: Sequence[int] = (),
    *,
    wrap: bool = False,
) -> str:
    """Return an HTML table.

    Args:
        header: Names of the columns.
        rows: Texts.
        bad: Numbers of rows to point out.
        wrap: Whether texts take several lines, so that a wide table fits.
    """
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = ""
    for number, row in enumerate(rows):
        mark = ' class="bad"' if number in bad else ""
        body += f"<tr{mark}>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
    kind = "wide wrap" if wrap else "wide"
    return f'<div class="{kind}"><table><tr>{head}</tr>{body}</table></div>'


def save_page(file: Path, title: str, parts: Sequence[str | Panel | Any]) -> Path:
    """Write a page.

    Args:
        file: The HTML file.
        title: Of the page.
        parts: From top to bottom: HTML, panels, or Plotly's figures; both fill the width.

    Raises:
        InputError: Plotly is not installed.
    """
    body, drawn = "", 0
    for part in parts:
        if isinstance(part, str):
            body += part
            continue
        if not drawn:
            body += f"<script>{plotly_code('--out')}</script>"
        drawn += 1
        figure = _panel(part) if isinstance(part, Panel) else json.loads(part.to_json())
        figure |= {"config": {"responsive": True, "displaylogo": False}}
        draw = f'Plotly.newPlot("figure{drawn}",{embedded_json(figure)})'
        body += f'<div class="figure" id="figure{drawn}"></div><script>{draw}</script>'
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>"
        f"<body><h1>{escape(title)}</h1>{body}</body></html>"
    )
    with naming(file):
        file.write_text(page, encoding="utf-8")
    return file


def _panel(panel: Panel) -> dict[str, Any]:
    """A panel with its title and legend, for Plotly."""
    found = plotly_of(panel)
    layout = found["layout"] | {"title": {"text": panel.title}, "showlegend": panel.legend}
    layout["margin"] |= {"t": 50}
    return {"data": found["data"], "layout": layout}
