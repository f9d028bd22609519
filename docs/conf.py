"""Settings of the documentation's site (``make docs``)."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

project = "sim2vr"
author = "the sim2vr authors"
release = version = (Path(__file__).parents[1] / "VERSION").read_text(encoding="utf-8").strip()

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["examples"]
suppress_warnings = ["ref.python"]  # an attribute's name that several classes have

html_theme = "furo"
html_title = f"sim2vr {release}"
html_copy_source = False
html_static_path = html_css_files = ["site.css"]
smartquotes = False  # --option stays as it is typed

myst_heading_anchors = 4  # links to headings, as on GitHub
myst_enable_extensions = ["dollarmath"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_use_ivar = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False

SECTIONS = {
    "Guide": "guide/install guide/first_user guide/gallery guide/audit guide/study guide/report "
    "guide/evaluate guide/train guide/gpu guide/look guide/own_* guide/*",
    "Tutorials": "tutorials/*",
    "Reference": "reference/* reference/games/*",
    "Concepts": "concepts/* architecture",
    "Evidence": "evidence/*",
    "Glossary": "glossary",
}
"""Section of the site -> its pages, as patterns below docs/. A page in no section is an error."""

SAMPLES = {
    "study": "study --game panel --user 'press lit by ray' --vary button_m=0.04,0.12 --people 6 "
    "--set env.app.options.round_seconds=8",
    "audit": "audit --game whacamole --condition low --people 30",
}
"""Samples of docs/guide/gallery.md -> the options of the command that plays them."""

DOCS = Path(__file__).resolve().parent


def toctrees() -> str:
    """Return a hidden table of contents for each section that has pages."""
    parts = []
    for section, patterns in SECTIONS.items():
        found = (page for each in patterns.split() for page in sorted(DOCS.glob(f"{each}.md")))
        pages = list(dict.fromkeys(found))
        names = [page.relative_to(DOCS).with_suffix("").as_posix() for page in pages]
        head = f"```{{toctree}}\n:caption: {section}\n:maxdepth: 1\n:hidden:\n\n"
        parts += [head + "\n".join(names) + "\n```\n"] if names else []
    return "\n".join(parts)


def without_outside_links(text: str, folder: Path) -> str:
    """Return a page with links to folders, and to pages that the site lacks, as their text."""

    def replaced(match: re.Match[str]) -> str:
        target = (folder / match[2]).resolve()
        outside = target.suffix == ".md" and not target.is_relative_to(DOCS)
        return match[1] if target.exists() and (outside or target.is_dir()) else match[0]

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)#:\s]+)(?:#[^)\s]*)?\)", replaced, text)


def prepare(app: Any, name: str, source: list[str]) -> None:
    """Change a page's text before Sphinx reads it."""
    source[0] = without_outside_links(source[0], (DOCS / name).parent)
    if name == "index":
        source[0] += "\n" + toctrees()


def add_samples(app: Any, error: Exception | None) -> None:
    """Copy the sample reports to the site, with the tag ``samples``; play missing ones before."""
    for name, options in SAMPLES.items() if error is None and app.tags.has("samples") else ():
        folder = DOCS.parent / "build/samples" / name
        if not (folder / "report.html").is_file():
            command = [Path(sys.executable).with_name("sim2vr-harness"), *shlex.split(options)]
            subprocess.run([*command, "--out", folder], check=True)
        kept = shutil.ignore_patterns("cells", "data")
        shutil.copytree(
            folder, Path(app.outdir) / "samples" / name, ignore=kept, dirs_exist_ok=True
        )


def setup(app: Any) -> None:
    """Connect to Sphinx."""
    app.connect("source-read", prepare)
    app.connect("build-finished", add_samples)
