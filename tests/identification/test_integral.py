"""The integral method: equations of windows, and their solution with instruments."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from zigzag_trials import LANXIN, noisy, run_of, zigzag

from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.integral_method import Equations, Motion, _cubes_of_headings, equations, integral
from autopilot.identification.registry import method_named
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.norrbin import Norrbin

TRUE = Norrbin(LANXIN["K"], LANXIN["T"], LANXIN["n3"], reference_speed=5.0)
NOISE = {"rate": math.radians(0.1), "heading": math.radians(0.2)}
TWENTY_SECONDS = zigzag(math.radians(15.0), 20.0, 0.1)


def segment_of(table: dict[str, np.ndarray]) -> Segment:
    (segment,) = run_of(table).segments
    return segment


def windows(table: dict[str, np.ndarray], length: float = 3.0, model: Norrbin = TRUE) -> Equations:
    segment = segment_of(table)
    return equations(segment, Motion(segment.heading, segment.rate), model, length)


def errors(model: Norrbin, rows: Equations) -> FloatArray:
    return rows.left - rows.terms @ np.array([model.gain, model.time_constant, model.n3, model.n0])


def without(table: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    return {**table, name: np.full(table["time_s"].size, np.nan)}


def test_the_true_boat_satisfies_the_equation_of_every_window() -> None:
    found = windows(TWENTY_SECONDS)
    assert found.time.size > 50
    size = np.max(np.abs(found.left))
    assert np.max(np.abs(errors(TRUE, found))) < 0.005 * size
    assert np.max(np.abs(errors(TRUE._replace(gain=1.1 * TRUE.gain), found))) > 0.05 * size


def test_heading_alone_or_rate_alone_give_the_same_equations() -> None:
    both = windows(TWENTY_SECONDS)
    for missing in ("heading_rad", "yaw_rate_rad_s"):
        alone = windows(without(TWENTY_SECONDS, missing))
        np.testing.assert_allclose(alone.left, both.left, atol=2.0e-3)
        np.testing.assert_allclose(alone.terms[:, 1], both.terms[:, 1], atol=5.0e-3)


def test_trim_and_a_changing_speed_are_part_of_the_equation() -> None:
    """T r' + s r + n3 r^3/s + n0 s^2 = K s^2 delta with the speed ratio s going from 1.5 to 0.5 and back."""
    table = zigzag(0.25, 60.0, 0.1, K=0.5, T=2.0, n3=0.0)
    dt, rate, heading, rows = 0.01, 0.0, 0.0, []
    rudder = np.interp(np.arange(0.0, 60.0, dt), table["time_s"], table["rudder_rad"])
    for i in range(6000):
        s = 1.0 + 0.5 * math.cos(0.2 * i * dt)
        if i % 10 == 0:
            rows.append((heading, rate, 5.0 * s))
        rate += dt * (0.5 * s * s * rudder[i] - s * rate - 20.0 * rate**3 / s - 0.02 * s * s) / 2.0
        heading += dt * rate
    moved = np.array(rows)
    segment = segment_of({**table, "heading_rad": moved[:, 0], "yaw_rate_rad_s": moved[:, 1]})
    segment = segment._replace(speed=moved[:, 2])
    boat = Norrbin(0.5, 2.0, 20.0, n0=0.02, reference_speed=5.0)
    found = equations(segment, Motion(segment.heading, segment.rate), boat, 8.0)
    assert np.max(np.abs(errors(boat, found))) < 0.01 * np.max(np.abs(found.left))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_irregular_sampling_changes_the_equation_little(seed: int) -> None:
    dense = zigzag(0.25, 12.0, 0.02)
    gaps = np.random.default_rng(seed).integers(1, 6, size=600)  # 0.02 to 0.1 s: no gap that ends a run
    keep = np.cumsum(gaps)[np.cumsum(gaps) < 600]
    found = windows({name: values[keep] for name, values in dense.items()})
    assert found.time.size
    assert np.max(np.abs(errors(TRUE, found))) < 0.02 * np.max(np.abs(found.left))


def test_a_boat_at_rest_ends_a_window_and_begins_another() -> None:
    segment = segment_of(TWENTY_SECONDS)
    stopped = segment._replace(speed=np.where(np.abs(segment.time - 9.0) < 0.05, 0.5, 5.0))
    ends = equations(stopped, Motion(stopped.heading, stopped.rate), TRUE, 3.0).time
    assert np.any((ends > 7.5) & (ends <= 9.0))
    assert not np.any((ends > 9.1) & (ends < 12.0))
    assert np.any(ends > 14.0)


def test_a_turn_through_north_is_a_small_one() -> None:
    wrapped = {**TWENTY_SECONDS, "heading_rad": np.mod(TWENTY_SECONDS["heading_rad"] - 0.1, 2.0 * math.pi)}
    np.testing.assert_allclose(windows(wrapped).left, windows(TWENTY_SECONDS).left, atol=1.0e-9)


def test_headings_and_rates_that_are_missing_are_bridged() -> None:
    rows = np.arange(200)
    gaps = {
        **TWENTY_SECONDS,
        "heading_rad": np.where(rows % 5 == 1, np.nan, TWENTY_SECONDS["heading_rad"]),
        "yaw_rate_rad_s": np.where(rows % 7 == 1, np.nan, TWENTY_SECONDS["yaw_rate_rad_s"]),
    }
    found = windows(gaps)
    assert np.isfinite(found.terms).all()
    assert np.max(np.abs(errors(TRUE, found))) < 0.02 * np.max(np.abs(found.left))


def turn_of(noise: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return a turn r = 0.1 cos 0.5 t [rad/s] of 60 s: times, and headings with noise [rad]."""
    time = np.arange(600) * 0.1
    return time, 0.2 * np.sin(0.5 * time) + noise * np.random.default_rng(seed).normal(size=600)


def test_noise_of_headings_does_not_make_the_cube_of_the_rate_larger() -> None:
    size, sums = math.radians(0.6), []
    for seed in range(40):
        at, cubes = _cubes_of_headings(*turn_of(size, seed), size, 3.0)
        sums.append(np.mean(cubes * np.cos(0.5 * at)))
    clean_at, clean = _cubes_of_headings(*turn_of(0.0, 0), 0.0, 3.0)
    expected = float(np.mean(clean * np.cos(0.5 * clean_at)))
    assert expected == pytest.approx(0.1**3 * 3.0 / 8.0, rel=0.1)
    # uncorrected it would be more by a third
    assert np.mean(sums) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_minute_gives_the_boat_within_five_per_cent_whatever_it_begins_with(factor: float) -> None:
    minute = zigzag(math.radians(20.0), 60.0, 0.1)
    for seed in range(3):
        run = run_of(noisy(minute, NOISE["rate"], NOISE["heading"], seed))
        start = TRUE._replace(gain=factor * TRUE.gain, time_constant=factor * TRUE.time_constant, n3=factor * TRUE.n3)
        found = integral([run], Question(start=start)).model
        assert found.gain == pytest.approx(TRUE.gain, rel=0.05)
        assert found.time_constant == pytest.approx(TRUE.time_constant, rel=0.05)


def test_windows_are_fitted_to_the_time_constant_that_was_found() -> None:
    run = run_of(zigzag(0.26, 120.0, 0.1, K=0.2, T=5.0, n3=20.0))
    found = integral([run], Question(start=Norrbin(0.1, 1.0, 10.0, reference_speed=5.0))).model
    assert found.time_constant == pytest.approx(5.0, rel=0.05)


def test_a_course_unstable_boat_is_found_from_headings_alone() -> None:
    boat = Norrbin(0.2, 5.0, 200.0, n1=-1.0, reference_speed=5.0)
    rate, heading, order, rows = 0.0, 0.0, 0.26, []
    for k in range(10_000):
        if k % 10 == 0:
            rows.append((0.01 * k, order, 5.0, heading, math.nan))
        if heading * math.copysign(1.0, order) >= 0.26:
            order = -order
        before = rate
        rate += 0.01 * (0.2 * order + rate - 200.0 * rate**3) / 5.0
        heading += 0.005 * (before + rate)
    run = run_from(rows)
    found = integral([run], Question(start=boat._replace(gain=0.4, time_constant=10.0, n3=400.0))).model
    assert found.gain == pytest.approx(0.2, rel=0.08)
    assert found.time_constant == pytest.approx(5.0, rel=0.08)


def run_from(rows: list[tuple[float, ...]]) -> Run:
    names = ("time_s", "rudder_rad", "speed_m_s", "heading_rad", "yaw_rate_rad_s")
    return run_of(dict(zip(names, np.array(rows).T, strict=True)))


def test_a_rudder_that_stands_still_tells_too_little() -> None:
    table = zigzag(math.radians(15.0), 4.0, 0.1)
    with pytest.raises(InputError, match="too few for the integral method"):
        integral([run_of(table)], Question(start=TRUE))


def test_n2_is_not_known_to_the_method() -> None:
    with pytest.raises(InputError, match="n2"):
        integral([run_of(TWENTY_SECONDS)], Question(start=TRUE._replace(n2=0.1)))


def test_the_method_says_that_a_gentle_record_does_not_tell_n3() -> None:
    table = noisy(zigzag(math.radians(6.0), 60.0, 0.1), NOISE["rate"], NOISE["heading"], 3)
    found = integral([run_of(table)], Question())
    assert found.model.n3 == 0.0
    assert "cannot be distinguished from 0" in found.unidentifiable["n3"]


def test_standard_errors_cover_the_truth() -> None:
    inside = 0
    for seed in range(8):
        run = run_of(noisy(zigzag(math.radians(20.0), 30.0, 0.1), NOISE["rate"], NOISE["heading"], seed))
        found = integral([run], Question(start=TRUE._replace(n3=1.0)))
        error = found.standard_errors["gain"]
        assert error is not None
        inside += abs(found.model.gain - TRUE.gain) < 2.0 * error
    assert inside >= 6


def test_the_way_there_is_kept() -> None:
    found = method_named("integral").identify([run_of(TWENTY_SECONDS)], Question("nomoto"))
    assert found.convergence is not None
    assert found.convergence.names[:2] == ("gain", "time_constant")
    assert found.convergence.values.shape == (found.convergence.time.size, len(found.convergence.names))
    assert np.all(np.diff(found.convergence.time) > 0.0)
