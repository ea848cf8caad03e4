"""The figures of reports: who is who in every panel, numbers that a skipper reads."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from autopilot.report.page import COLOURS, Line, Panel, time_figure

pytest.importorskip("matplotlib", reason="needs the extra report")


def line(name: str, low: float = 0.3, high: float = 1.6, count: int = 3) -> Line:
    return Line(name, np.linspace(low, high, count), np.linspace(1.0, 2.0, count))


def test_a_name_has_one_colour_in_all_panels_and_six_names_have_six() -> None:
    names = ("a", "b", "c", "d", "e", "f")
    drawn = time_figure([Panel("K", [line(name, count=50) for name in names]), Panel("n", [line("f", count=50)])])
    curves = re.findall(r'clip-path[^>]*style="fill: none; stroke: (#[0-9a-f]{6}); stroke-width: 1.2', drawn)
    assert curves == [*COLOURS, COLOURS[5]] and len(set(COLOURS)) == 6


def test_who_is_who_stands_at_the_side_that_a_phone_shows_first() -> None:
    drawn = time_figure([Panel("K", [line("pid"), line("sliding")])])
    places = [float(at) for at in re.findall(r'x="([\d.]+)" [^>]*>(?:pid|sliding)<', drawn)]
    width = float(re.search(r'viewBox="0 0 ([\d.]+) ', drawn)[1])
    assert len(places) == 2 and max(places) < 0.5 * width


@pytest.mark.parametrize(("low", "high"), [(0.3, 1.6), (0.02, 40.0)])
def test_a_logarithmic_axis_has_plain_numbers(low: float, high: float) -> None:
    drawn = time_figure([Panel("rms", [line("pid", low, high)])], "travel", logarithmic=True)
    words = re.findall(r"<text[^>]*>([^<]*)</text>", drawn)
    between = [word for word in words if re.fullmatch(r"[\d.]+", word) and low <= float(word) <= high]
    assert len(between) >= 3 and "10" not in re.findall(r"<tspan[^>]*>([^<]*)</tspan>", drawn)


def test_a_figure_is_drawn_without_a_word_where_no_home_can_be_written() -> None:
    program = "from autopilot.report.page import *; time_figure([Panel('a', [Line('a', *np.eye(2))])])"
    without = {**os.environ, "HOME": "/proc", "XDG_CONFIG_HOME": "/proc", "XDG_CACHE_HOME": "/proc"}
    without.pop("MPLCONFIGDIR", None)
    done = subprocess.run([sys.executable, "-c", program], env=without, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_line_of_few_values_shows_each() -> None:
    assert time_figure([Panel("rms", [line("pid")])]).count("<use ") > time_figure(
        [Panel("rms", [line("pid", count=50)])]
    ).count("<use ")
