"""Writes the report of an evaluation or a study: a page, and its figures for papers."""

import base64
import csv
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from sim2vr_harness.base.errors import InputError, counted
from sim2vr_harness.base.files import naming
from sim2vr_harness.client import Measure
from sim2vr_harness.figures.figure import (
    GREY,
    Bars,
    Figure,
    Heat,
    Layer,
    Line,
    Panel,
    Points,
    Ranges,
    colour_of,
)
from sim2vr_harness.figures.html import Part, listed, render, save_page
from sim2vr_harness.figures.matplotlib_backend import write_stills
from sim2vr_harness.games.published import Published, published_of
from sim2vr_harness.studies.report.body import (
    BodyPicture,
    body_pictures,
    body_with,
    figures_of_body,
    load_of,
    trained_users_of,
)
from sim2vr_harness.studies.report.methods import BIBTEX, PlayedBy, methods_of, played_by
from sim2vr_harness.studies.report.search import figures_of_search, search_sentences, trial_table
from sim2vr_harness.studies.report.sentences import (
    asked,
    difference_words,
    headline,
    limits_of,
    n_sentence,
    p_words,
    place_of,
    sentences_of,
)
from sim2vr_harness.studies.report.source import (
    Group,
    ReportSource,
    known,
    read_source,
    summary_of,
    with_spread,
)
from sim2vr_harness.studies.report.strategy import figures_of_strategy
from sim2vr_harness.studies.report.tables import (
    beside_tables,
    glossary,
    group_table,
    measure_table,
    published_tests,
    test_table,
    user_table,
)

_WIDTH = 720
_SECONDS = 10.0
_POSTER_S = 3.0
"""Time after which the arms have risen from their hanging start posture, s."""
_QUALITY = 30  # of H.264: larger is smaller
_MOST_BYTES = 3_000_000
"""Of all excerpts together."""


@dataclass(frozen=True)
class Example:
    """A film of a round.

    Attributes:
        label: Of the group.
        name: Of the whole film's file, relative to the report's folder.
        video: An excerpt as MP4, Base64.
        poster: What is shown before it plays, and on paper, JPEG, Base64.
    """

    label: str
    name: str
    video: str
    poster: str


def examples_of(groups: Sequence[Group], root: Path) -> list[Example]:
    """Return what was filmed (``--record``), a film per group, as far as they are small."""
    found: list[Example] = []
    left = _MOST_BYTES
    for group in groups:
        film = _film_of(group)
        video = None if film is None else _excerpt(film)
        if film is None or video is None or len(video) > left:
            continue
        left -= len(video)
        name = film.relative_to(root) if film.is_relative_to(root) else Path(film.name)
        text = base64.b64encode(video).decode()
        found.append(Example(group.label, str(name), text, _poster(film)))
    return found


def _film_of(group: Group) -> Path | None:
    for data, _ in group.parts:
        for film in sorted(data.root.parent.glob("*.mp4")):
            if film.stem.rpartition("_")[0] == group.condition:
                return film
    return None


def _excerpt(film: Path) -> bytes | None:
    """The first seconds, smaller; None where that fails."""
    how = ["-t", f"{_SECONDS:g}", "-vf", f"scale={_WIDTH}:-2", "-an", "-c:v", "libx264"]
    how += ["-crf", str(_QUALITY), "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    made = _ffmpeg(film, how, "excerpt.mp4")
    return made[0] if made else None


def _poster(film: Path) -> str:
    """A picture from the middle of the excerpt; empty where that fails."""
    how = ["-vf", f"select=gte(t\\,{_POSTER_S:g}),scale={_WIDTH}:-2", "-frames:v", "1", "-q:v", "6"]
    made = _ffmpeg(film, how, "poster.jpg")
    return base64.b64encode(made[0]).decode() if made else ""


def _ffmpeg(film: Path, how: Sequence[str], name: str) -> list[bytes]:
    """Files that ffmpeg makes of a film, in the order of their names; none where it fails."""
    import imageio_ffmpeg

    with tempfile.TemporaryDirectory() as folder:
        start = [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-loglevel", "error"]
        command = [*start, "-i", str(film), *how, str(Path(folder) / name)]
        done = subprocess.run(command, capture_output=True, check=False)
        if done.returncode != 0:
            return []
        return [file.read_bytes() for file in sorted(Path(folder).iterdir())]


_MOST_POINTS = 400
"""Of items in a panel; more would only cover each other."""
_MOST_COUNTS = 6
"""Most counts that are listed one by one."""
_GREY = " Grey: the range of the recorded people, and their mean (diamond)."
_MOST_MEASURES = 4
"""In the table of the first screen."""
_SPREAD = 0.5
"""Of a group's rounds, in the distance of two groups."""


def figures_of_outcomes(source: ReportSource, published: Published) -> Iterator[Figure]:
    """Yield the figures of measures, grids, places and outcomes that these data allow."""
    panels = [
        _measure_panel(source.groups, measure, published)
        for measure in source.measures
        if any(any(known(group.values(measure.name))) for group in source.groups)
    ]
    if panels:
        people = _GREY if _people(source, published) else ""
        yield Figure(
            "measures",
            "Measures",
            "Small dots are rounds, large ones means over rounds or participants." + people,
            panels,
        )
    for grid in source.grids:
        yield _grid(source.groups, grid, published)
    yield from _places(source.groups)
    if any(group.events["outcome"].notna().any() for group in source.groups):
        yield _outcomes(source.groups)


def _people(source: ReportSource, published: Published) -> bool:
    return any(
        published.people_in(group.condition, measure.name)
        for group in source.groups
        for measure in source.measures
    )


def _measure_panel(groups: Sequence[Group], measure: Measure, published: Published) -> Panel:
    layers: list[Layer] = []
    people = [published.people_in(group.condition, measure.name) for group in groups]
    places = [place for place, values in enumerate(people) if values]
    if places:
        lows, highs = ([f(people[i]) for i in places] for f in (min, max))
        means = [float(np.mean(people[i])) for i in places]
        texts = [
            f"{len(people[i])} people: {mean:.{measure.digits}f}, "
            f"{low:.{measure.digits}f} to {high:.{measure.digits}f}"
            for i, mean, low, high in zip(places, means, lows, highs, strict=True)
        ]
        layers.append(Ranges("people's range", places, lows, highs, text=texts))
        layers.append(
            Points(
                "people's mean",
                places,
                means,
                "#6b7075",
                9,
                "diamond",
                text=texts,
                key="people's mean",
            )
        )
    layers += _pairs(groups, measure)
    several = any(len(set(group.units)) > 1 for group in groups)
    over = "participants or users" if several else "rounds"
    for place, group in enumerate(groups):
        colour = colour_of(place)
        values = known(group.values(measure.name))
        beside = [place + _SPREAD * ((k + 0.5) / len(values) - 0.5) for k in range(len(values))]
        layers.append(Points(f"{group.label}, rounds", beside, values, colour, 4, key="round"))
        found = summary_of(group, measure.name)
        if found is not None:
            text = (
                f"{group.label}: {found.mean:.{measure.digits}f}, {counted(found.rounds, 'round')}"
            )
            layers.append(
                Points(group.label, [place], [found.mean], colour, 11, text=[text],
                       spread=None if found.spread is None else [found.spread],
                       key="mean" if found.spread is None else f"mean ± SD over {over}")
            )  # fmt: skip
    return Panel(
        measure.label, layers, y_label=measure.unit, ticks=[group.label for group in groups]
    )


def _pairs(groups: Sequence[Group], measure: Measure) -> list[Layer]:
    """A thin line per participant or user through its rounds in all groups, where n is above 1."""
    lines: dict[str, tuple[list[float], list[float]]] = {}
    for place, group in enumerate(groups):
        values = group.values(measure.name)
        own = [(u, v) for u, v in zip(group.units, values, strict=True) if v is not None]
        for unit in dict.fromkeys(unit for unit, _ in own):
            rounds = [k for k, (other, _) in enumerate(own) if other == unit]
            x, y = lines.setdefault(unit, ([], []))
            middle = (float(np.mean(rounds)) + 0.5) / len(own) - 0.5
            x.append(place + _SPREAD * middle)
            y.append(float(np.mean([own[k][1] for k in rounds])))
    paired = [(unit, *line) for unit, line in lines.items() if len(line[0]) == len(groups)]
    if len(groups) < 2 or len(paired) < 2:
        return []
    return [Line(unit, x, y, GREY, width=0.6, key="same participant") for unit, x, y in paired]


def _grid(groups: Sequence[Group], grid: Measure, published: Published) -> Figure:
    assert grid.grid is not None
    rows, columns = grid.grid
    tables: list[tuple[str, list[float | None]]] = []
    for group in groups:
        means = [known(group.values(f"{grid.name}_{i}")) for i in range(rows * columns)]
        tables.append((group.label, [float(np.mean(v)) if v else None for v in means]))
    theirs: dict[str, list[float | None]] = {}
    for group in groups:
        people = published.grid_of(group.condition, grid.name)
        if people is not None and len(people) == rows * columns:
            theirs.setdefault(f"people, {published.people_s_name(group.condition)}", list(people))
    values = known([value for _, table in (*tables, *theirs.items()) for value in table])
    low, high = 0.0, 1.0
    if values and max(values) > 1.0:
        low, high = min(values), max(values)
    panels = [
        Panel(
            title,
            [
                Heat(
                    [table[row * columns : (row + 1) * columns] for row in range(rows)],
                    _sides(columns, ("left", "middle", "right")),
                    _sides(rows, ("top", "middle", "bottom")),
                    low,
                    high,
                )
            ],
        )
        for title, table in (*tables, *theirs.items())
    ]
    caption = "As the player sees it; mean over rounds. Darker: higher."
    return Figure(f"grid_{grid.name}", grid.heading, caption, panels)


def _sides(count: int, three: tuple[str, str, str]) -> list[str]:
    return list(three) if count == 3 else [str(i + 1) for i in range(count)]


def _places(groups: Sequence[Group]) -> Iterator[Figure]:
    """Items in the plane that faces the player, where they lie at more than a few places."""
    panels = []
    for group in groups:
        rows = group.events.dropna(subset=["x_m", "y_m", "success"])
        if len(rows) < 2 or rows["cell"].notna().any():
            continue
        rows = rows.iloc[:: -(-len(rows) // _MOST_POINTS)]
        good = rows[rows["success"].astype(bool)]
        bad = rows[~rows["success"].astype(bool)]
        layers = [
            Points(name, list(part["x_m"]), list(part["y_m"]), colour, 7, symbol)
            for name, part, colour, symbol in (
                ("reached", good, "#009e73", "circle"), ("not", bad, "#d55e00", "x"),
            )
            if len(part)
        ]  # fmt: skip
        labels = ("right (m)", "up (m)")
        panels.append(Panel(group.label, layers, *labels, square=True, legend=True))
    if panels:
        text = "Where items were when they were decided, as the game's log has it."
        yield Figure("places", "Reach: which items were reached", text, panels)


def _outcomes(groups: Sequence[Group]) -> Figure:
    """Return the figure of outcomes of targets, as proportions."""
    panels = []
    names = list(dict.fromkeys(name for g in groups for name in g.events["item"].dropna()))
    for name in names:
        own = [group.events[group.events["item"] == name] for group in groups]
        ends = list(dict.fromkeys(end for rows in own for end in rows["outcome"].dropna()))
        if not ends:
            continue
        layers = [
            Bars(
                end,
                [group.label for group in groups],
                [
                    float((rows["outcome"] == end).sum() / max(1, rows["outcome"].notna().sum()))
                    for rows in own
                ],
                colour,
            )
            for end, colour in _coloured(own, ends)
        ]
        numbers = [int(rows["outcome"].notna().sum()) for rows in own]
        counts = ", ".join(map(str, numbers))
        if len(numbers) > _MOST_COUNTS:
            counts = f"{min(numbers)} to {max(numbers)} in each"
        panels.append(
            Panel(f"{_several(name)} ({counts})", layers, y_label="proportion", stacked=True,
                  legend=True, y_range=(0.0, 1.02))
        )  # fmt: skip
    text = "Proportion of each outcome among the items that had one; titles have their numbers."
    return Figure("outcomes", "Outcomes of items", text, panels)


def _several(name: str) -> str:
    """``target`` -> ``Targets``, ``box`` -> ``Boxes``."""
    return f"{name.capitalize()}{'es' if name.endswith(('s', 'x', 'z', 'ch', 'sh')) else 's'}"


def _coloured(own: Sequence[Any], ends: Sequence[str]) -> list[tuple[str, str]]:
    """Outcomes with colours, successes first: these are green and blue."""
    good = [
        end
        for end in ends
        if any(rows[rows["outcome"] == end]["success"].astype(bool).any() for rows in own)
    ]
    bad = [end for end in ends if end not in good]
    wins, losses = ("#009e73", "#0072b2", "#56b4e9"), ("#d5d9de", "#d55e00", "#e69f00", "#cc79a7")
    return [
        *((end, wins[i % len(wins)]) for i, end in enumerate(good)),
        *((end, losses[i % len(losses)]) for i, end in enumerate(bad)),
    ]


_SYMBOLS = str.maketrans(
    {"<": "$<$", ">": "$>$", "±": r"$\pm$", "–": "--", "−": "$-$", "×": r"$\times$"}
)
"""Letters that pandas leaves as they are, for LaTeX without Unicode fonts."""
_DIFFERENCE = ("estimate", "low", "high")

Rows = list[list[str]]


def write_tables(source: ReportSource, folder: Path) -> Iterator[Path]:
    """Write measures and tests as ``NAME.csv`` (all digits) and ``NAME.tex``; yield the files."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [["measure", "unit", "group", "mean", "sd", "n", "rounds"]]
    for measure in source.measures:
        for group in source.groups:
            found = summary_of(group, measure.name)
            if found is not None:
                measures_numbers = (found.mean, found.spread, found.n, found.rounds)
                rows.append(
                    [measure.name, measure.unit, group.label, *map(_text, measures_numbers)]
                )
    measures_rows = [["", *(group.label for group in source.groups)]]
    for measure in source.measures:
        cells = [
            with_spread(summary_of(group, measure.name), measure, len(set(group.units)))
            for group in source.groups
        ]
        measures_rows.append([measure.heading, *cells])
    tables = {"table_measures": (rows, measures_rows)}
    if source.comparisons:
        tests_numbers = ("statistic", "p", "p_holm", "effect")
        names = ["measure", "compared", "within", "n", "test", *_DIFFERENCE, *tests_numbers]
        tests_rows = [[*names, "effect_name"]]
        for one in source.comparisons:
            difference = dict(one.get("difference") or {})
            difference.setdefault("estimate", difference.get("mean"))
            tests_rows.append([
                str(one["measure"]),
                " - ".join(map(str, one.get("levels") or ())),
                place_of(one).strip(" ()"),
                _count(one["n"]),
                str(one["test"]),
                *(_text(difference.get(key)) for key in _DIFFERENCE),
                *(_text(one.get(key)) for key in tests_numbers),
                str(one.get("effect_name") or ""),
            ])  # fmt: skip
        tables["table_tests"] = (tests_rows, _shown_tests(source))
    for name, (numbers, shown) in tables.items():
        file = folder / f"{name}.csv"
        with naming(file), file.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows(numbers)
        yield file
        file = folder / f"{name}.tex"
        with naming(file):
            file.write_text(latex_table(shown[0], shown[1:]), encoding="utf-8")
        yield file


def latex_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a ``tabular`` with rules of the package booktabs; texts are escaped."""
    cells = pd.DataFrame([header, *rows]).replace(r"(?<!\w)-(?=\d)", "−", regex=True)
    table = cells.T.set_index(0).T.to_latex(
        index=False, escape=True, column_format="l" + "r" * (len(header) - 1)
    )
    return "% needs \\usepackage{booktabs}\n" + table.translate(_SYMBOLS)


def _shown_tests(source: ReportSource) -> Rows:
    rows = [["Measure", "Compared", "Difference [95 %]", "n", "Test", "p", "Effect size"]]
    for one in source.comparisons:
        measure = source.measure(str(one["measure"]))
        p = one.get("p") if one.get("p_holm") is None else one["p_holm"]
        rows.append([
            f"{measure.label if measure else one['measure']}{place_of(one)}",
            " – ".join(map(str, one.get("levels") or ())),
            difference_words(one, measure),
            _count(one["n"]),
            str(one["test"]),
            "–" if p is None else p_words(p),
            "–" if one.get("effect") is None else f"{one['effect']:.2f}",
        ])  # fmt: skip
    return rows


def _count(n: int | Sequence[int]) -> str:
    return str(n) if isinstance(n, int) else "+".join(map(str, n))


def _text(value: float | None) -> str:
    return "" if value is None else repr(value)


def figures_of_effort(source: ReportSource) -> Iterator[Figure]:
    """Yield how the return splits into the game's terms and the cost of effort."""
    labels = [group.label for group in source.groups]
    parts = [_parts(source, group) for group in source.groups]
    names = list(dict.fromkeys(name for own in parts for name in own))
    if not names:
        return
    layers = [
        Bars(
            name,
            labels,
            [own.get(name) for own in parts],
            GREY if name == "effort" else colour_of(i),
        )
        for i, name in enumerate(names)
    ]
    panels = [Panel("What a round brought", layers, y_label="reward", stacked=True, legend=True)]
    shares = [effort_share(group) for group in source.groups]
    if any(share is not None for share in shares):
        bars = Bars("effort", labels, shares, GREY)
        panels.append(
            Panel("Effort cost against the game's reward", [bars], y_label="share of the reward")
        )
    before = [_exertion(group) for group in source.groups]
    weights = {w for g in source.groups for w in known(g.values("effort_weight"))}
    if len(weights) > 1 and any(value is not None for value in before):
        bars = Bars("effort", labels, before, GREY)
        panels.append(Panel("Effort before its weight", [bars], y_label="cost / weight"))
    text = (
        "Means over rounds. Gains are positive and costs negative; they add up to the return."
        + (" Users paid for effort by different weights: compare it before its weight."
           if len(weights) > 1 else "")
    )  # fmt: skip
    yield Figure("effort", "Effort and reward", text, panels)


def effort_share(group: Group) -> float | None:
    """The mean cost of effort as a share of the mean reward of the game; None if there is none."""
    effort, game = known(group.values("effort")), known(group.values("game_return"))
    if not effort or not game or np.mean(game) <= 0:
        return None
    return float(np.mean(effort) / np.mean(game))


def _exertion(group: Group) -> float | None:
    effort, weight = known(group.values("effort")), known(group.values("effort_weight"))
    return float(np.mean(effort) / weight[0]) if effort and weight and weight[0] else None


def _parts(source: ReportSource, group: Group) -> dict[str, float]:
    """Name of a term -> its mean over rounds."""
    game, effort = known(group.values("game_return")), known(group.values("effort"))
    if not game or not effort:
        return {}
    columns = [name for name in group.columns("steps") if name.startswith("term_")]
    labels = {f"term_{t.log_key.lower()}": t.label for t in source.facts.reward_terms}
    sums: dict[str, list[float]] = {}
    for rows in group.moments("steps", columns):
        for column in columns:
            sums.setdefault(column, []).append(float(np.nansum(rows[column])))
    terms = {labels.get(column, column): float(np.mean(own)) for column, own in sums.items()}
    rest = float(np.mean(game)) - sum(terms.values())
    return {source.facts.reward_rest: rest, **terms, "effort": -float(np.mean(effort))}


@dataclass(frozen=True)
class Content:
    """Content of a page; ``methods`` is a paragraph and ``examples`` are videos."""

    answer: str
    source: ReportSource
    published: Published
    sentences: Sequence[str]
    figures: Sequence[Figure]
    bodies: Sequence[BodyPicture]
    examples: Sequence[Example]
    users: Sequence[PlayedBy]
    methods: str


def write_page(content: Content, file: Path, *, printed: bool = False) -> list[Path]:
    """Write the page, and as PDF, too, if it is to be printed.

    Figures of a search come first, then the measures; the tables of statistics are last.
    """
    source, published = content.source, content.published
    limits = limits_of(source)
    answers = [text for text in content.sentences if text not in limits]
    below = {
        "search_parallel": trial_table(source),
        "measures": measure_table(source, published),
    }
    figures = sorted(
        content.figures,
        key=lambda figure: (not figure.key.startswith("search"), figure.key != "measures"),
    )
    sections: list[tuple[str, list[Part]]] = [("What limits this answer", [listed(limits)])]
    for figure in figures:
        parts: list[Part] = [figure, below[figure.key]] if figure.key in below else [figure]
        if figure.key == "body" and content.bodies:
            left_out = len(source.groups) - len(content.bodies)
            parts.insert(0, _media(bodies=content.bodies, left_out=left_out))
        sections.append((figure.title, parts))
    if content.examples:
        sections.append(("Examples", [_media(examples=content.examples)]))
    beside: list[Part] = []
    if people := published.people:
        beside.append(f"{people.title}: {people.citation}.")
    for measure, rows in beside_tables(source, published):
        beside += [_heading(measure), rows]
    if tests := published_tests(published):
        beside += [_heading("Published tests"), tests]
    if published.differences:
        beside += [_heading("Why they differ"), listed(published.differences)]
    if len(beside) > 1:
        sections.append(("Beside people and publications", beside))
    untested = "No comparison was requested: a study's file has them (sim2vr-harness study)."
    sections += [
        ("All answers", [listed(answers)]),
        ("n and tests", [n_sentence(source), test_table(source) or untested]),
        ("Methods", [
            Markup('<p class="methods">{}</p>').format(content.methods),
            user_table(content.users), _heading("Measures"), glossary(source),
            _heading("BibTeX"), Markup("<pre>{}</pre>").format(BIBTEX),
        ]),
    ]  # fmt: skip
    shown = asked(source)
    if len(shown) == 1:
        shown = [*shown, *(one for one in source.measures if one not in shown)]
    table = group_table(source, shown[:_MOST_MEASURES]) + _about(source)
    first: list[Part] = [_picture(source, published), table]
    return save_page(file, source.title, content.answer, first, sections, printed=printed)


def _media(**values: Any) -> Markup:
    values = {"bodies": (), "left_out": 0, "examples": ()} | values
    return render("studies/report/media.html.jinja", **values)


def _heading(text: str) -> Markup:
    return Markup("<h3>{}</h3>").format(text)


def _picture(source: ReportSource, published: Published) -> Figure:
    """Return the figure of the first screen: the measure that the report answers for."""
    measure = asked(source)[0]
    panel = _measure_panel(source.groups, measure, published)
    better = {"lower": " Less is better.", "higher": " More is better."}.get(measure.better, "")
    lines = any(isinstance(layer, Line) for layer in panel.layers)
    caption = f"{measure.label}: small dots are rounds, large ones their means.{better}"
    caption += " A line joins the rounds of one participant or user." if lines else ""
    caption += _GREY if _people(source, published) else ""
    return Figure("answer", measure.label, caption, [replace(panel, title="", wide=True)])


def _about(source: ReportSource) -> Markup:
    rounds = counted(sum(len(group.episodes) for group in source.groups), "round")
    text = f"{rounds} of {source.facts.name} by {', '.join(source.users)}; mean ± SD."
    about = f" {source.facts.description}." if source.facts.description else ""
    return Markup('<p class="small">{}{}</p>').format(text, about)


PAGE = "report.html"
"""In the folder of the evaluation or study."""


@dataclass(frozen=True)
class StudyReport:
    """Files of a written report.

    Attributes:
        answer: The answer of the page's first screen.
        page: The HTML file.
        pdf: The same on paper; None without a browser.
        figures: PNG and PDF files, and tables as CSV and LaTeX, in the folder ``figures`` beside
            ``report.html``, ``NAME_figures`` beside a page of another name.
    """

    answer: str
    page: Path
    pdf: Path | None
    figures: tuple[Path, ...]


def write_report(
    folder: str | Path, out: str | Path | None = None, *, stills: bool = True
) -> StudyReport:
    """Write the report of an evaluation or a study.

    Args:
        folder: Of the evaluation or the study.
        out: The HTML file; None: ``report.html`` in the folder.
        stills: Whether to write the page as PDF and figures as PNG and PDF, too.

    Raises:
        InputError: There are no tables, or ``out`` is no HTML file.
    """
    page = Path(folder) / PAGE if out is None else Path(out)
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError("--out", repr(str(page)), "a file name that ends in .html")
    source = read_source(folder)
    duration_s = max(float(group.episodes["duration_s"].median()) for group in source.groups)
    # No one else has played what a search has made of the game.
    known = published_of(source.facts.name if source.search is None else "")
    published = known.beside_rounds_of(duration_s)
    loads = [load_of(group) for group in source.groups]
    body = body_with([own for _, _, own in trained_users_of(source)], loads)
    figures = [
        *figures_of_search(source),
        *figures_of_outcomes(source, published),
        *figures_of_body(source, loads, body),
        *figures_of_strategy(source, published),
        *figures_of_effort(source),
    ]
    users = played_by(source)
    sentences = [*search_sentences(source), *sentences_of(source, published)]
    content = Content(
        headline(source) if source.search is None else sentences[0],
        source,
        published,
        sentences,
        figures,
        body_pictures(source.groups, loads, body),
        examples_of(source.groups, source.root),
        users,
        methods_of(source, users),
    )
    _, *pdf = write_page(content, page, printed=stills)
    # Two reports in a folder do not share their figures.
    name = "figures" if page.name == PAGE else f"{page.stem}_figures"
    beside = page.with_name(name)
    drawn = [*write_stills(figures, beside), *write_tables(source, beside)] if stills else []
    return StudyReport(content.answer, page, next(iter(pdf), None), tuple(drawn))
