"""Figures as SVG text, one look for all reports: time below, degrees at the side, what was wanted in grey."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
COLOURS = ("#0b5fa5", "#c8501e", "#2e7d32", "#7b4fa3")
WANTED = "#8a8f98"
SIZE = (9.0, 2.6)
PLANE_SIZE = (9.0, 5.2)
LEGEND_COLUMNS = 3


class Line(NamedTuple):
    """A curve: its name, times [s] and values, in the unit of its panel; `wanted` ones are grey and dashed.

    dots: single values, not joined. beside: half the width of a band around the curve.
    """

    name: str
    time: FloatArray
    values: FloatArray
    wanted: bool = False
    dots: bool = False
    beside: FloatArray | None = None


class Panel(NamedTuple):
    """One diagram: the label of its ordinate, with the unit, and its lines."""

    label: str
    lines: Sequence[Line]


def plane_figure(panel: Panel, abscissa: str, *, equal: bool = False) -> str:
    """Return one panel over an `abscissa` of its own, dots joined in the order given; `equal`: a chart, as SVG."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot

    with mpl.rc_context({"svg.hashsalt": "norrbin", "svg.fonttype": "none", "font.size": 9}):
        figure, axis = pyplot.subplots(figsize=PLANE_SIZE, layout="constrained")
        _draw(axis, panel)
        axis.set_xlabel(abscissa)
        if equal:
            axis.set_aspect("equal", adjustable="datalim")
        text = _svg_of(figure)
        pyplot.close(figure)
    return text


def time_figure(panels: Sequence[Panel], abscissa: str = "time [s]", *, logarithmic: bool = False) -> str:
    """Return panels above each other, sharing the time axis or another `abscissa`, as SVG."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot

    with mpl.rc_context({"svg.hashsalt": "norrbin", "svg.fonttype": "none", "font.size": 9}):
        figure, axes = pyplot.subplots(
            len(panels), 1, sharex=True, squeeze=False, figsize=(SIZE[0], SIZE[1] * len(panels)), layout="constrained"
        )
        for axis, panel in zip(axes[:, 0], panels, strict=True):
            _draw(axis, panel)
        axes[-1, 0].set_xlabel(abscissa)
        if logarithmic:
            axes[-1, 0].set_xscale("log")
        text = _svg_of(figure)
        pyplot.close(figure)
    return text


def _draw(axis: Any, panel: Panel) -> None:
    colours = iter(COLOURS * 4)
    for line in panel.lines:
        if line.wanted:
            axis.plot(line.time, line.values, color=WANTED, linestyle="--", linewidth=1.2, label=line.name)
        elif line.dots:
            axis.plot(line.time, line.values, ".", color=next(colours), markersize=5, label=line.name)
        else:
            colour = next(colours)
            axis.plot(line.time, line.values, color=colour, linewidth=1.2, label=line.name)
            if line.beside is not None:
                low, high = line.values - line.beside, line.values + line.beside
                axis.fill_between(line.time, low, high, color=colour, alpha=0.18, linewidth=0.0)
    axis.set_ylabel(panel.label)
    axis.grid(True, color="#e3e6ea", linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(loc="best", frameon=False, ncols=min(len(panel.lines), LEGEND_COLUMNS))


def _svg_of(figure: Any) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]
