"""Recordings with samples that were never so: the right model, or one sentence that says what is wrong."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from zigzag_trials import RECORDINGS, noisy, run_of, zigzag

from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.runs import FloatArray, run_from_columns, without_freezes, without_spikes
from autopilot.logs.csv_log import read_csv

Table = dict[str, FloatArray]


@functools.cache
def _recorded() -> Table:
    table = zigzag(np.radians(15), 120, 0.1, K=0.2, T=5.0, n3=20.0, rudder_rate=np.radians(5), speed=4.0)
    return noisy(table, np.radians(0.1), np.radians(0.2), seed=1)


def _with_spikes(table: Table, name: str, size: float) -> Table:
    random = np.random.default_rng(3)
    values = table[name].copy()
    hit = random.choice(values.size, values.size // 100, replace=False)
    values[hit] += size * random.choice([-1.0, 1.0], hit.size)
    return {**table, name: values}


@pytest.mark.parametrize(
    ("name", "size"),
    [("heading_rad", 1.57), ("heading_rad", 3.1), ("yaw_rate_rad_s", 0.7), ("rudder_rad", 1.0), ("speed_m_s", 40.0)],
)
def test_spikes_are_left_out_reported_and_change_nothing(name: str, size: float) -> None:
    run = run_of(_with_spikes(_recorded(), name, size), "spiky.csv")
    assert run.notes == (f"spiky.csv: 12 of 1200 values of {name} left out as spikes.",)
    found = identify([run], Question(weighting="residuals"))
    assert found.model.gain == pytest.approx(0.2, rel=0.02)
    assert found.model.time_constant == pytest.approx(5.0, rel=0.03)


def test_a_clean_recording_loses_nothing() -> None:
    run = run_of(_recorded())
    assert run.notes == ()
    np.testing.assert_array_equal(run.segments[0].rudder, _recorded()["rudder_rad"])
    np.testing.assert_array_equal(run.segments[0].rate, _recorded()["yaw_rate_rad_s"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda table: {"heading_rad": -table["heading_rad"]}, "the heading turns to the other side"),
        (lambda table: {"yaw_rate_rad_s": -table["yaw_rate_rad_s"]}, "the heading turns to the other side"),
        (lambda table: {"heading_rad": np.degrees(table["heading_rad"])}, "contradict each other"),
        (lambda table: {"yaw_rate_rad_s": np.degrees(table["yaw_rate_rad_s"])}, "contradict each other"),
        (lambda table: {"yaw_rate_rad_s": np.radians(table["yaw_rate_rad_s"])}, "contradict each other"),
        (lambda table: {"time_s": 1000.0 * table["time_s"]}, "check the units of time and yaw rate"),
    ],
    ids=["heading reversed", "rate reversed", "heading in deg", "rate in deg", "rate too small", "time in ms"],
)
def test_a_heading_and_a_yaw_rate_that_contradict_each_other_are_refused(
    change: Callable[[Table], Table], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        run_of({**_recorded(), **change(_recorded())})


@pytest.mark.parametrize("late", [0, 10])
def test_a_rate_sensor_s_scale_and_bias_and_a_late_compass_are_no_contradiction(late: int) -> None:
    table = _recorded()
    rate = 1.3 * table["yaw_rate_rad_s"] + np.radians(0.4)
    assert run_of({**table, "yaw_rate_rad_s": rate, "heading_rad": np.roll(table["heading_rad"], late)}).notes == ()


@given(st.integers(0, 2**31), st.floats(0.01, 0.7), st.booleans())
def test_noise_ramps_and_steps_are_no_spikes(seed: int, scale: float, angle: bool) -> None:
    random = np.random.default_rng(seed)
    levels = np.repeat(random.choice([-1.0, 0.0, 1.0], 15), 20)
    ramped = np.convolve(levels, np.ones(5) / 5, mode="valid")
    values = scale * (ramped + 0.05 * random.normal(size=ramped.size))
    same, spikes = without_spikes(values, angle=angle)
    assert spikes == 0
    np.testing.assert_array_equal(same, values)


@given(st.floats(0.0, 6.28), st.integers(5, 290))
def test_a_heading_spike_is_found_on_either_side_of_north(heading: float, at: int) -> None:
    values = heading + 0.01 * np.sin(0.1 * np.arange(300))
    values[at] += 2.0
    cleaned, spikes = without_spikes(np.mod(values, 2.0 * np.pi), angle=True)
    assert spikes == 1
    assert np.flatnonzero(np.isnan(cleaned)).tolist() == [at]


def test_a_compass_that_freezes_while_the_boat_turns_is_left_out() -> None:
    table = _recorded()
    frozen = table["heading_rad"].copy()
    frozen[400:] = frozen[400]
    run = run_of({**table, "heading_rad": frozen}, "frozen.csv")
    assert run.notes == ("frozen.csv: 800 headings are left out: the compass stood still while the boat turned.",)
    assert identify([run]).model.gain == pytest.approx(0.2, rel=0.02)


def test_a_compass_that_freezes_with_no_rate_beside_it_is_refused() -> None:
    table = {name: values for name, values in _recorded().items() if name != "yaw_rate_rad_s"}
    table["heading_rad"] = np.where(np.arange(1200) > 400, 1.0, table["heading_rad"])
    with pytest.raises(InputError, match=r"frozen.csv: the heading stands at 57.3 degrees from 40.1 s to 119.9 s"):
        run_of(table, "frozen.csv")


def test_a_compass_that_stands_for_a_while_with_no_rate_beside_it_is_left_out() -> None:
    table = {name: values for name, values in _recorded().items() if name != "yaw_rate_rad_s"}
    still = (np.arange(1200) >= 480) & (np.arange(1200) < 720)
    run = run_of({**table, "heading_rad": np.where(still, table["heading_rad"][480], table["heading_rad"])}, "f.csv")
    assert run.notes == ("f.csv: 240 headings are left out: the compass stood still while the boat turned.",)
    found = identify([run])
    assert found.model.gain == pytest.approx(0.2, rel=0.03)
    assert found.model.time_constant == pytest.approx(5.0, rel=0.05)


def test_a_coarse_compass_stands_on_every_number_and_is_believed() -> None:
    time = np.arange(0.0, 120.0, 0.1)
    heading = np.radians(np.round(6.0 * np.sin(0.1 * time)))
    nothing, rudder = np.full(1200, np.nan), np.radians(15.0) * np.sign(np.cos(0.1 * time))
    same, frozen = without_freezes("coarse.csv", time, heading, nothing, rudder)
    assert frozen == 0
    np.testing.assert_array_equal(same, heading)


@pytest.mark.parametrize("rates", [True, False])
def test_headings_that_are_blank_for_whole_turns_lose_none_of_them(rates: bool) -> None:
    """A circle of 6 deg/s with 40 s of headings missing: 240 deg, which a compass takes for -120."""
    time = np.arange(0.0, 120.0, 0.1)
    heading = np.radians(6.0) * time
    blank = (time > 40.0) & (time < 80.0)
    table = {
        "time_s": time,
        "rudder_rad": np.full(1200, 0.2),
        "speed_m_s": np.full(1200, 5.0),
        "heading_rad": np.where(blank, np.nan, np.mod(heading, 2.0 * np.pi)),
    }
    run = run_of({**table, "yaw_rate_rad_s": np.full(1200, np.radians(6.0))} if rates else table)
    assert len(run.segments) == (1 if rates else 2)
    for segment in run.segments:
        at = np.isfinite(segment.heading)
        turned = segment.heading[at] - segment.heading[at][0]
        np.testing.assert_allclose(turned, np.radians(6.0) * (segment.time[at] - segment.time[at][0]), atol=1e-9)


@pytest.mark.parametrize("every", [3, 5, 10])
def test_a_motion_that_is_measured_in_some_rows_alone_is_fitted_as_it_was_measured(every: int) -> None:
    """A logger's rows hold the rudder 20 times a second, and the motion as seldom as its instruments send it."""
    table = zigzag(np.radians(15), 120, 0.05, K=0.35, T=2.2, n3=1.2, rudder_rate=np.radians(12), speed=3.0)
    table = noisy(table, np.radians(0.1), np.radians(0.2), seed=1)
    blank = np.arange(table["time_s"].size) % every > 0
    seldom = {name: np.where(blank, np.nan, table[name]) for name in ("heading_rad", "yaw_rate_rad_s")}
    found = identify([run_of({**table, **seldom})], Question())
    for name, truth in (("gain", 0.35), ("time_constant", 2.2)):
        value, error = getattr(found.model, name), found.standard_errors[name]
        assert value == pytest.approx(truth, rel=0.02)
        assert error is not None and abs(value - truth) < 4.0 * error


def test_a_boat_that_lies_still_has_no_frozen_compass() -> None:
    time, heading = np.arange(0.0, 60.0, 0.1), np.full(600, 1.0)
    same, frozen = without_freezes("still.csv", time, heading, 0.001 * np.sin(time), np.zeros(600))
    assert frozen == 0
    np.testing.assert_array_equal(same, heading)


@pytest.mark.parametrize("unit", ["degrees", "pulse widths"])
def test_a_rudder_in_another_unit_is_refused(unit: str) -> None:
    rudder = np.degrees(_recorded()["rudder_rad"])
    other = rudder if unit == "degrees" else 1500.0 + 13.0 * rudder
    with pytest.raises(InputError, match=r"unit.csv: the rudder lies at .* rad, and none goes beyond 1.57 rad"):
        run_of({**_recorded(), "rudder_rad": other}, "unit.csv")


@pytest.mark.parametrize("missing", ["heading_rad", "yaw_rate_rad_s"])
def test_radians_that_stand_for_degrees_are_refused(missing: str) -> None:
    table = {**zigzag(0.35, 60.0, 0.1), missing: np.full(600, np.nan)}
    run_from_columns("right.csv", table)
    table["rudder_rad"] = np.radians(table["rudder_rad"])
    with pytest.raises(InputError, match=r"run\.csv: the rudder goes .* no rudder does so much"):
        run_from_columns("run.csv", table)


@pytest.mark.parametrize("rudder", [0.26, -0.35])
def test_a_steady_turn_is_no_rudder_in_another_unit(rudder: float) -> None:
    table = zigzag(0.35, 60.0, 0.1)
    noise = 0.005 * np.random.default_rng(3).standard_normal(600)
    turning = {"rudder_rad": rudder + noise, "yaw_rate_rad_s": np.full(600, 0.6 * rudder) + noise}
    run_from_columns("turn.csv", {**table, **turning, "heading_rad": 0.6 * rudder * table["time_s"]})


def test_a_run_astern_is_refused_and_a_short_way_astern_is_not() -> None:
    table = zigzag(0.35, 60.0, 0.1)
    with pytest.raises(InputError, match=r"run\.csv: the speed is below nought, -5 m/s in the mean"):
        run_from_columns("run.csv", {**table, "speed_m_s": -table["speed_m_s"]})
    some = np.where(table["time_s"] < 12.0, -1.0, 1.0) * table["speed_m_s"]
    run_from_columns("harbour.csv", {**table, "speed_m_s": some})


@pytest.mark.skipif(not (RECORDINGS / "frt_ds_esso").is_dir(), reason=f"no recordings in {os.fspath(RECORDINGS)}")
def test_a_real_ship_loses_no_sample() -> None:
    columns = {
        "time_s": "t [s]",
        "rudder_rad": "delta_rudder [rad]",
        "yaw_rate_rad_s": "r_angvelo [rad/s]",
        "speed_m_s": "u_velo [m/s]",
    }
    files = sorted(Path(RECORDINGS / "frt_ds_esso").glob("*.csv"))
    assert len(files) == 6
    for file in files:
        assert run_from_columns(file.name, read_csv(str(file), columns).columns).notes == ()
