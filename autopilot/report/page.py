"""One self-contained HTML file: headings, paragraphs, tables, figures as inline SVG, in daylight and at night.

Figures as SVG text, one look for all reports: time below, degrees at the side, what was wanted in grey.
"""

from __future__ import annotations

import io
import itertools
import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from autopilot import __version__

FloatArray = npt.NDArray[np.float64]
COLOURS = ("#0b5fa5", "#c8501e", "#2e7d32", "#7b4fa3", "#00838f", "#9a6a00")
WANTED = "#8a8f98"
SIZE = (9.0, 2.6)
LEAST_HEIGHT, TALLEST = 1.7, 6.8
"""Inches of a panel and of a figure: many panels are low, so that the verdict below is on the first sheet of paper."""
PLANE_SIZE = (9.0, 5.2)
LEGEND_COLUMNS = 4
DECADE = 10.0
COARSE, FINE = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
"""What is written at a logarithmic axis, in plain numbers; FINE where it spans no decade."""
FEW = 12
"""A line of at most so many values shows each of them as a dot."""


class Line(NamedTuple):
    """A curve: its name, times [s] and values, in the unit of its panel; `wanted` ones are grey and dashed.

    dots: single values, not joined. beside: half the width of a band around the curve.
    """

    name: str
    time: FloatArray
    values: FloatArray
    wanted: bool = False
    dots: bool = False
    band: FloatArray | None = None


SPEED_SPAN = 0.3
"""A panel of speed shows at least this share of the mean."""


class Panel(NamedTuple):
    """One diagram: the label of its ordinate, with the unit, and its lines; least: a span of the ordinate that is shown
    at least, so that noise does not fill the panel."""

    label: str
    lines: Sequence[Line]
    least: float = 0.0


@contextmanager
def _drawing() -> Iterator[Any]:
    """Give matplotlib's pyplot, set to draw alike everywhere; that it keeps no cache (no home) is no user's concern."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot

    with mpl.rc_context({"svg.hashsalt": "norrbin", "svg.fonttype": "none", "font.size": 9}):
        yield pyplot


def plane_figure(panel: Panel, abscissa: str, *, equal: bool = False) -> str:
    """Return one panel over an `abscissa` of its own, dots joined in the order given; `equal`: a chart, as SVG."""
    with _drawing() as pyplot:
        figure, axis = pyplot.subplots(figsize=PLANE_SIZE, layout="constrained")
        _draw(axis, panel, _colours((panel,)))
        axis.set_xlabel(abscissa)
        if equal:
            axis.set_aspect("equal", adjustable="datalim")
        text = _svg_of(figure)
        pyplot.close(figure)
    return text


def time_figure(panels: Sequence[Panel], abscissa: str = "time [s]", *, logarithmic: bool = False) -> str:
    """Return panels above each other, sharing the time axis or another `abscissa`, as SVG."""
    with _drawing() as pyplot:
        from matplotlib import ticker

        count = len(panels)
        size = SIZE[0], count * max(LEAST_HEIGHT, min(SIZE[1], TALLEST / count))
        figure, axes = pyplot.subplots(count, 1, sharex=True, squeeze=False, figsize=size, layout="constrained")
        colours = _colours(panels)
        for axis, panel in zip(axes[:, 0], panels, strict=True):
            _draw(axis, panel, colours)
        axes[-1, 0].set_xlabel(abscissa)
        if logarithmic:
            axes[-1, 0].set_xscale("log")
            low, high = axes[-1, 0].get_xlim()
            axes[-1, 0].xaxis.set_major_locator(ticker.LogLocator(subs=FINE if high < DECADE * low else COARSE))
            axes[-1, 0].xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
            axes[-1, 0].xaxis.set_minor_formatter(ticker.NullFormatter())
        text = _svg_of(figure)
        pyplot.close(figure)
    return text


def _colours(panels: Sequence[Panel]) -> dict[str, str]:
    """Return the colour of each name: the same in all panels of a figure."""
    names = dict.fromkeys(line.name for panel in panels for line in panel.lines if not line.wanted)
    return dict(zip(names, itertools.cycle(COLOURS), strict=False))


def _draw(axis: Any, panel: Panel, colours: dict[str, str]) -> None:
    for line in panel.lines:
        if line.wanted:
            axis.plot(line.time, line.values, color=WANTED, linestyle="--", linewidth=1.2, label=line.name)
        elif line.dots:
            axis.plot(line.time, line.values, "o", color=colours[line.name], markersize=6, label=line.name)
        else:
            colour, mark = colours[line.name], "." if len(line.values) <= FEW else ""
            axis.plot(line.time, line.values, mark + "-", color=colour, linewidth=1.2, label=line.name)
            if line.band is not None:
                low, high = line.values - line.band, line.values + line.band
                axis.fill_between(line.time, low, high, color=colour, alpha=0.18, linewidth=0.0)
    low, high = axis.get_ylim()
    if (short := 0.5 * (panel.least - (high - low))) > 0.0:
        axis.set_ylim(low - short, high + short)
    axis.set_ylabel(panel.label)
    axis.grid(True, color="#e3e6ea", linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    # above the panel: over no curve
    axis.legend(
        loc="lower left",  # a phone shows this side first
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.1,
        frameon=False,
        ncols=min(len(panel.lines), LEGEND_COLUMNS),
    )


def _svg_of(figure: Any) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<style>
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b1f24; }
header { display: flex; justify-content: space-between; align-items: baseline; gap: 1rem; }
header { border-bottom: 3px solid #0b3d66; }
header span { color: #4b5563; font-size: .9rem; white-space: nowrap; }
h1 { font-size: 1.7rem; margin: 0 0 .4rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
.verdict { font-size: 1.15rem; font-weight: 600; padding: .7rem 1rem; background: #f0f2f5; }
.verdict { border-left: .5rem solid #8a8f98; } .verdict::first-letter { text-transform: uppercase; }
.verdict.good { border-color: #2e7d32; } .verdict.start, .verdict.fair, .verdict.doubtful { border-color: #e08700; }
.verdict.poor, .verdict.refused, .verdict.not-enough { border-color: #b00d1e; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: .3rem .9rem; text-align: right; border-bottom: 1px solid #d8dde3; }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
.wide { overflow-x: auto; }
th button { font: inherit; font-weight: 600; color: inherit; background: none; border: 0; padding: 0; cursor: pointer; }
th[aria-sort=ascending] button::after { content: " \\2191"; }
th[aria-sort=descending] button::after { content: " \\2193"; }
figure { margin: 1rem 0; background: #fff; } figure svg { width: 100%; height: auto; }
ul { padding-left: 1.3rem; }
@media screen { td { white-space: nowrap; } } /* a number and its unit stay together: a wide table is pushed sideways */
figcaption, .note { color: #4b5563; font-size: .9rem; }
code { background: #f0f2f5; padding: .1rem .35rem; border-radius: 3px; }
@media screen and (prefers-color-scheme: dark) {
  body { background: #14171b; color: #e6e8eb; } code, .verdict { background: #252a31; } header span { color: #a9b1bb; }
  th, td { border-color: #333a43; } .note { color: #a9b1bb; } figure { padding: .3rem; } /* which stays white */
}
@media screen and (max-width: 34rem) {
  h1 { font-size: 1.25rem; line-height: 1.25; } th, td { padding: .25rem .3rem; font-size: .85rem; }
  th:first-child, td:first-child { white-space: normal; min-width: 4.5rem; }
  figure { overflow-x: auto; } figure svg { width: 40rem; } /* letters of a size that is read; it is pushed sideways */
  figcaption::after { content: " (slide it sideways)"; }
  .note code { overflow-wrap: anywhere; }
}
@page { size: A4; margin: 16mm 14mm; }
@media print {
  body { font-size: 10pt; max-width: none; margin: 0; padding: 0; color: #000; }
  h1 { font-size: 17pt; } h2 { font-size: 12.5pt; margin-top: 1.2rem; break-after: avoid; }
  header + figure svg { max-height: 150mm; } /* the verdict stands on the first page too */
  section, figure, table, .verdict { break-inside: avoid; } /* with its heading, where a sheet holds it */
  figure { break-before: avoid; } thead { display: table-header-group; } p { orphans: 3; widows: 3; }
  ul { margin: .2rem 0; } p { margin: .6rem 0; }
  .verdict { font-size: 12pt; print-color-adjust: exact; } .wide { overflow: visible; }
  table { width: 100%; font-size: 8.5pt; } th, td { padding: .15rem .35rem; }
  th button { font-size: inherit; } th button::after { content: "" !important; }
}
</style>
</head>
<body>
<main>
<header><h1>{{ title }}</h1><span>Norrbin {{ version }}</span></header>
{% if hero %}<figure tabindex="0">{{ hero.figure | safe }}
<figcaption>{{ hero.caption }}</figcaption></figure>{% endif %}
{% if verdict %}<p class="verdict {{ verdict[0] | replace(" ", "-") }}">{{ verdict[1] | replace("+-", "±") }}</p>
{% endif %}
<p>{{ lead }}</p>
<p class="note">Made by <code>{{ command }}</code> with Norrbin {{ version }} on {{ day }}.</p>
{% for section in sections %}
<section><h2>{{ section.title }}</h2>
{% if section.table %}<div class="wide"><table>
<thead><tr>{% for cell in section.table[0] %}
{% if cell %}<th>{{ cell }}</th>{% else %}<td></td>{% endif %}{% endfor %}</tr></thead><tbody>
{% for row in section.table[1:] %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>{% endif %}
{% for paragraph in section.text %}<p>{{ paragraph }}</p>{% endfor %}
{% for name, said in section.points %}<p>{{ name }}:</p>
<ul>{% for each in said %}<li>{{ each }}</li>{% endfor %}</ul>{% endfor %}
{% if section.figure %}<figure tabindex="0">{{ section.figure | safe }}
<figcaption>{{ section.caption }}</figcaption></figure>{% endif %}
</section>{% endfor %}
</main>
<script>
// a click on a head sorts its table: by the first number of each cell where all have one, else as text
const text = cell => cell?.textContent ?? "";
const number = cell => {
  const found = text(cell).replace("\\u2212", "-").match(/-?\\d+(\\.\\d+)?(e-?\\d+)?/);
  return found ? +found[0] : NaN;
};
for (const table of document.querySelectorAll("table")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => {
    if (!text(head)) return;
    const button = document.createElement("button");
    button.type = "button"; button.append(...head.childNodes); head.append(button);
    button.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending", rows = [...body.rows];
      const numeric = rows.every(row => !Number.isNaN(number(row.cells[column])));
      rows.sort((a, b) => { const [x, y] = [a.cells[column], b.cells[column]];
        return (up ? 1 : -1) * (numeric ? number(x) - number(y) : text(x).localeCompare(text(y))); });
      heads.forEach(other => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending"); body.append(...rows);
    });
  });
}
</script>
</body>
</html>
"""


class Section(NamedTuple):
    """A part of the report: a table (first row its heads), paragraphs, and a figure as SVG with its caption.

    points: names, and what is to be said of each, as lists below the paragraphs.
    """

    title: str
    table: Sequence[Sequence[str]] = ()
    text: Sequence[str] = ()
    figure: str = ""
    caption: str = ""
    points: Sequence[tuple[str, Sequence[str]]] = ()


class Opening(NamedTuple):
    """How a page begins: title, what it is about, the figure that says most, and the verdict, grade and sentence."""

    title: str
    lead: str
    hero: Section | None = None
    verdict: tuple[str, str] | None = None


def render(opening: Opening, sections: Sequence[Section], command: str) -> str:
    """Return the page; every text is escaped, figures are taken as they are."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    return environment.from_string(TEMPLATE).render(
        **opening._asdict(),
        sections=sections,
        command=command,
        version=__version__,
        day=time.strftime("%d %B %Y").lstrip("0"),
    )
