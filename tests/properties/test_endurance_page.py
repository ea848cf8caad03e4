"""The figures of an endurance run: slopes with their errors, and the page."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _benchmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


def test_the_slope_is_that_of_the_second_half_with_its_error() -> None:
    from endurance_page import Reading, slope

    noise = np.random.default_rng(1).normal(0.0, 2.0, 400)
    readings = [Reading(0.1 * i, 900.0 if i < 200 else 5.0 * 0.1 * i + noise[i], math.nan, 7) for i in range(400)]
    found, error = slope(readings, "resident_kb")
    assert found == pytest.approx(5.0, abs=4.0 * error)
    # sigma / sqrt(sum (x - mean)^2), of 200 readings over 20 h
    assert error == pytest.approx(2.0 / math.sqrt(200 * 20.0**2 / 12.0), rel=0.15)
    assert slope(readings, "descriptors") == pytest.approx((0.0, 0.0), abs=1e-9)
    assert all(math.isnan(value) for value in slope(readings[:3], "descriptors"))


def test_the_page_tells_and_draws_what_was_read(monkeypatch: pytest.MonkeyPatch) -> None:
    from endurance_page import Reading, page

    monkeypatch.setattr("sys.argv", ["endurance.py", "real", "--minutes", "1"])
    readings = [Reading(0.5 * i, 40000.0 + i, math.nan, 7) for i in range(8)]
    text = page("Endurance <of> a test", ["no release missed"], readings, np.array([0.05, 0.05, 0.075]))
    assert "Endurance &lt;of&gt; a test" in text
    assert "no release missed" in text
    assert "python benchmarks/endurance.py real --minutes 1" in text
    assert "slope of resident_kb  +2.000 +- 0.000 kB an hour, second half" in text
    assert text.count("<svg") == 2
    assert "Python memory blocks" not in text, "nothing was read of them"
