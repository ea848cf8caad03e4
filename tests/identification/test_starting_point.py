"""Where the fits start: the best linear model, however many stretches between gaps the recordings have."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from memory import measured
from zigzag_trials import zigzag

from autopilot.identification import identify, simulation
from autopilot.identification.identify import ROUGH_STEPS, initial_state, starting_point
from autopilot.identification.runs import Run, Segment, run_from_columns
from autopilot.identification.simulation import at_samples, forcing, linear_responses
from autopilot.models.norrbin import Norrbin


def with_gaps(gaps: int, without: str) -> Run:
    """A zigzag of which `gaps` bits are lost."""
    table = zigzag(0.2, 400.0, 0.1)
    time, random = table["time_s"], np.random.default_rng(3)
    kept = np.full(time.size, True)
    for begin in np.linspace(0.0, time[-1], gaps + 2)[1:-1]:
        kept[(time >= begin) & (time < begin + 1.0)] = False
    noisy = {name: values + 1e-3 * random.normal(size=time.size) for name, values in table.items() if name != "time_s"}
    return run_from_columns("gaps", {n: v[kept] for n, v in {**noisy, "time_s": time}.items() if n != without})


@pytest.mark.parametrize("without", ["heading_rad", "yaw_rate_rad_s"])
def test_the_own_unknowns_of_each_stretch_are_those_of_one_table(without: str) -> None:
    segments, T = with_gaps(12, without).segments, 4.0
    assert len(segments) == 13
    found = identify._linear_fit(segments, T, 5.0)
    steps = forcing(segments, T / ROUGH_STEPS)
    responses = linear_responses(Norrbin(1.0, T, reference_speed=5.0), steps)
    rows = []
    for s, segment in enumerate(segments):
        gain, trim, rate = (at_samples(motion[int(without != "heading_rad")], steps, s) for motion in responses)
        own = np.zeros((rate.size, 2 * len(segments)))
        own[:, 2 * s], own[:, 2 * s + 1] = rate, without != "heading_rad"
        measured = segment.rate if without == "heading_rad" else segment.heading - initial_state(segment)[1]
        rows.append(np.column_stack([gain, trim, own, measured]))
    table = np.concatenate(rows)
    best = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0]
    left = table[:, -1] - table[:, :-1] @ best
    assert (found.model.gain, -found.model.n0) == pytest.approx(best[:2].tolist(), rel=1e-9, abs=1e-12)
    others = table[:, 1:-1] @ np.linalg.lstsq(table[:, 1:-1], table[:, -1], rcond=None)[0]
    assert found.explained == pytest.approx(1.0 - np.sum(left**2) / np.sum((table[:, -1] - others) ** 2), abs=1e-9)


def test_hundreds_of_gaps_make_no_table_with_the_unknowns_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its least squares take the cube of their number: half an hour with a gap each few seconds took a minute."""
    solved: list[tuple[int, ...]] = []
    lstsq = np.linalg.lstsq

    def counted(columns: Any, *args: Any, **options: Any) -> Any:
        solved.append(columns.shape)
        return lstsq(columns, *args, **options)

    run = with_gaps(60, "")
    monkeypatch.setattr(np.linalg, "lstsq", counted)
    start = starting_point([run], 5.0)
    assert start.explained > 0.9
    assert solved and max(width for _, width in solved) <= 2 and max(height for height, _ in solved) <= 3 * 61


@pytest.mark.parametrize("without", ["heading_rad", "yaw_rate_rad_s", "nothing"])
def test_in_parts_the_start_is_the_same(without: str, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [with_gaps(1, without)]
    whole = starting_point(runs, 5.0)
    monkeypatch.setattr(simulation, "PART", 97)
    parts = starting_point(runs, 5.0)
    assert parts.model == pytest.approx(whole.model, rel=1e-9, abs=1e-12)
    assert parts.explained == pytest.approx(whole.explained, abs=1e-12)


def test_the_start_with_a_longer_log_takes_no_more_than_ten_times_its_columns() -> None:
    def begun(seconds: float) -> float:
        time = np.arange(0.0, seconds, 0.1)
        random, rudder = np.random.default_rng(4), 0.2 * np.sin(0.7 * time)
        day = Segment(time, np.cumsum(0.01 * rudder), 0.1 * rudder, rudder, 5.0 + 0.01 * random.normal(size=time.size))
        return measured(lambda: starting_point([Run("day", (day,))], 5.0))[1].peak

    assert begun(10_000.0) - begun(5_000.0) < 10.0 * 5.0 * 8.0 * 50_000
