"""The simulation of all steps at once against a loop over time, against scipy, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from memory import measured
from scipy.integrate import solve_ivp
from zigzag_trials import LANXIN, zigzag

from autopilot.identification import simulation
from autopilot.identification.residual_tests import simulate_run
from autopilot.identification.rudder_path import DIRECT, RudderTrain, corners
from autopilot.identification.runs import FloatArray, Run, Segment, run_from_columns
from autopilot.identification.simulation import (
    at_samples,
    forcing,
    forcing_in_parts,
    motions_at_samples,
    rudder_behind,
    simulate,
    slopes,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind

DRIFTING = RaceAndWind(0.5, 8.0, 2.0e-4, 1.0e-4, 1.0, 0.4, 1.5, 3.0e-4)
TRUTH = Norrbin(LANXIN["K"], LANXIN["T"], LANXIN["n3"], reference_speed=5.0)


def segment(seconds: float = 20.0, spacing: float = 0.1, seed: int = 0) -> Segment:
    """A rudder and a speed that wander, sampled."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, spacing)
    rudder = 0.4 * np.sin(0.7 * time) + 0.1 * np.cumsum(random.normal(size=time.size)) * np.sqrt(spacing)
    speed = 5.0 + np.sin(0.2 * time)
    return Segment(time, np.zeros_like(time), np.zeros_like(time), rudder, speed)


def in_turn(model: Norrbin, segments: list[Segment], start: list[float], longest: float) -> FloatArray:
    """Return the rates at the nodes by the loop over time."""
    steps = forcing(segments, longest)
    return simulation._one_by_one(simulation._drives(model, steps, None), steps, np.array([start]))[0]


@settings(max_examples=20, deadline=None)
@given(
    gain=st.floats(0.01, 2.0),
    time_constant=st.floats(0.2, 30.0),
    n3=st.floats(0.0, 200.0),
    n0=st.floats(-0.05, 0.05),
    unstable=st.booleans(),
    start=st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=2),
)
def test_all_steps_at_once_are_the_steps_one_after_the_other(
    gain: float, time_constant: float, n3: float, n0: float, unstable: bool, start: list[float]
) -> None:
    n1 = -1.0 if unstable else 1.0
    model = Norrbin(gain, time_constant, max(n3, 1.0) if unstable else n3, n1=n1, n0=n0, reference_speed=5.0)
    segments, longest = [segment(seed=1), segment(8.0, 0.25, seed=2)], min(0.2, time_constant / 12.0)
    expected = in_turn(model, segments, start, longest)
    found = simulate(model, forcing(segments, longest), np.array(start)).rate
    np.testing.assert_allclose(found, expected, atol=1.0e-9 * max(1.0, float(np.max(np.abs(expected)))))


@pytest.mark.parametrize("train", [DIRECT, RudderTrain(0.02, 0.13, 0.3, 0.1)])
@pytest.mark.parametrize("around", [None, DRIFTING])
def test_in_parts_the_motion_is_the_same(
    around: RaceAndWind | None, train: RudderTrain, monkeypatch: pytest.MonkeyPatch
) -> None:
    segments, start = [segment(seed=1), segment(1.0, seed=3), segment(8.0, 0.25, seed=2)], [0.1, 0.2, -0.1]
    steps = forcing(segments, 0.02)
    steps = steps._replace(rudder=rudder_behind(train, steps))
    whole = simulate(TRUTH, steps, np.array(start), around)
    monkeypatch.setattr(simulation, "PART", 97)
    parts = motions_at_samples(TRUTH, segments, 0.02, start, around, train)
    for s, part in enumerate(parts):
        np.testing.assert_allclose(part[:, 0], at_samples(whole.rate, steps, s), atol=1.0e-11)
        np.testing.assert_allclose(part[:, 1], at_samples(whole.turned, steps, s), atol=1.0e-11)


@pytest.mark.parametrize("most", [1, 7, 97, 340])
def test_parts_hold_each_step_and_each_sample_once(most: int) -> None:
    segments = [segment(seed=1), segment(1.0, seed=3), segment(8.0, 0.25, seed=2)]
    whole, parts = forcing(segments, 0.07), list(forcing_in_parts(segments, 0.07, most=most))
    for name in ("step", "rudder", "speed"):
        joined = np.concatenate([getattr(part.forcing, name) for part in parts], axis=-1)
        np.testing.assert_array_equal(joined, getattr(whole, name))
    for s, each in enumerate(segments):
        there = np.zeros(each.time.size)
        for part in parts:
            for place, (number, rows) in enumerate(zip(part.segments, part.rows, strict=True)):
                if number == s:
                    assert part.forcing.samples[place].share.size == there[rows].size
                    there[rows] += 1.0
        np.testing.assert_array_equal(there, 1.0)
    assert all(part.forcing.step.size == most for part in parts[:-1])
    assert not parts[-1].goes_on


def test_a_segment_of_one_row_stays_where_it_begins() -> None:
    """It has no step: what its memory held before came out as its motion."""
    row = Segment(*(np.array([value]) for value in (3.0, 0.5, 0.2, 0.1, 5.0)))
    one, _ = motions_at_samples(TRUTH, [row, segment(seed=1)], 0.02, [0.2, 0.1])
    np.testing.assert_array_equal(one, [[0.2, 0.0]])


def test_predicting_a_longer_log_takes_no_more_than_ten_times_its_columns() -> None:
    def predicted(seconds: float) -> float:
        time = np.arange(0.0, seconds, 0.1)
        still = np.zeros_like(time)
        longs = Segment(time, still, still, 0.2 * np.sin(0.7 * time), still + 5.0)
        return measured(lambda: simulate_run(TRUTH, Run("day", (longs,))))[1].peak

    assert predicted(10_000.0) - predicted(5_000.0) < 10.0 * 5.0 * 8.0 * 50_000, "of 7 steps to a sample"


def test_a_guess_does_not_change_the_result() -> None:
    steps = forcing([segment()], 0.02)
    plain = simulate(TRUTH, steps, np.array([0.1]))
    guessed = simulate(TRUTH, steps, np.array([0.1]), guess=plain._replace(rate=np.full(plain.rate.size, 0.3)))
    np.testing.assert_allclose(guessed.rate, plain.rate, atol=1.0e-10)
    for other in (
        TRUTH._replace(gain=3.0 * TRUTH.gain),
        TRUTH._replace(time_constant=0.3 * TRUTH.time_constant, n3=0.0),
    ):
        elsewhere = simulate(other, steps, np.array([-0.2]))
        assert elsewhere.linearised is not None
        near = simulate(TRUTH, steps, np.array([0.1]), guess=elsewhere)
        np.testing.assert_allclose(near.rate, plain.rate, atol=1.0e-10)
        assert near.linearised is not None, "Newton's method arrived"


def test_a_model_that_runs_away_is_held_inside_the_bound() -> None:
    steps = forcing([segment(60.0)], 0.1)
    away = simulate(Norrbin(1.0, 0.5, n1=-1.0, reference_speed=5.0), steps, np.array([0.1]))
    assert np.isfinite(away.rate).all()
    assert np.isfinite(away.turned).all()
    assert float(np.max(np.abs(away.rate))) == simulation.RATE_BOUND_RAD_S
    model = Norrbin(1.0, 0.5, n1=-1.0, reference_speed=5.0)
    for derivative in slopes(model, steps, away, [(model._replace(gain=1.000001), None, steps.rudder)], 1.0e-6):
        assert np.isfinite(derivative.rate).all()
        assert np.isfinite(derivative.turned).all()


@pytest.mark.parametrize(
    "around",
    [None, RaceAndWind(0.5, 8.0, 2.0e-4, 1.0e-4), RaceAndWind(0.5, 8.0, 2.0e-4, 1.0e-4, 1.0, 0.4, 1.5, 3.0e-4)],
)
def test_the_derivatives_are_those_of_whole_simulations(around: RaceAndWind | None) -> None:
    driven = segment()
    driven = driven._replace(
        propeller=8.0 + np.sin(driven.time), beam_wind=20.0 + 0.0 * driven.time, quarter_wind=np.cos(driven.time)
    )
    steps, by = forcing([driven, segment(8.0, seed=3)], 0.02), 1.0e-6
    start = np.array([0.05, -0.1])
    motion = simulate(TRUTH, steps, start, around)
    shifted = [TRUTH._replace(**{name: getattr(TRUTH, name) + by}) for name in ("gain", "time_constant", "n3", "n0")]
    found = slopes(TRUTH, steps, motion, [(model, around, steps.rudder) for model in shifted], by, around)
    whole = [simulate(model, steps, start, around) for model in shifted] + [simulate(TRUTH, steps, start + by, around)]
    for derivative, other in zip(found, whole, strict=True):
        for mine, theirs, base in zip(derivative[:2], other[:2], motion[:2], strict=True):
            assert mine is not None and theirs is not None and base is not None
            difference = (theirs - base) / by
            np.testing.assert_allclose(mine, difference, atol=1.0e-4 * max(1.0, float(np.max(np.abs(difference)))))


def test_simulated_motion_agrees_with_scipys_integrator() -> None:
    driven = segment()
    steps = forcing([driven], 0.02)
    motion = simulate(TRUTH, steps, np.array([0.1]))

    def motion_by_scipy(time: float, state: FloatArray) -> list[float]:
        rudder, ratio = np.interp(time, driven.time, driven.rudder), np.interp(time, driven.time, driven.speed) / 5.0
        r = state[0]
        pull = LANXIN["K"] * ratio * rudder - r - LANXIN["n3"] / ratio**2 * r**3
        return [pull / (LANXIN["T"] / ratio), r]

    exact = solve_ivp(
        motion_by_scipy,
        (0.0, driven.time[-1]),
        [0.1, 0.0],
        t_eval=driven.time,
        rtol=1.0e-9,
        atol=1.0e-10,
        max_step=0.05,
    )
    np.testing.assert_allclose(at_samples(motion.rate, steps, 0), exact.y[0], atol=1.0e-5)
    np.testing.assert_allclose(at_samples(motion.turned, steps, 0), exact.y[1], atol=1.0e-5)


@pytest.mark.parametrize("spacing", [0.1, 0.25, 0.5])
def test_the_corners_of_a_slewing_rudder_are_found_between_samples(spacing: float) -> None:
    fine, coarse = zigzag(np.radians(15.0), 40.0, 0.005), zigzag(np.radians(15.0), 40.0, spacing)
    time, rudder = corners(coarse["time_s"], coarse["rudder_rad"])
    assert time.size > 10
    path_time = np.concatenate([coarse["time_s"], time])
    order = np.argsort(path_time)
    path = np.concatenate([coarse["rudder_rad"], rudder])[order]
    # two corners between the same samples stay hidden, as at the very first movement
    later = (fine["time_s"] > 2.0) & (fine["time_s"] < coarse["time_s"][-1])
    rounded = np.interp(fine["time_s"], path_time[order], path) - fine["rudder_rad"]
    cut = np.interp(fine["time_s"], coarse["time_s"], coarse["rudder_rad"]) - fine["rudder_rad"]
    assert np.sqrt(np.mean(rounded[later] ** 2)) < 0.15 * np.sqrt(np.mean(cut[later] ** 2))


def test_a_noisy_or_smooth_rudder_has_no_corners() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    noise = np.radians(0.3) * np.random.default_rng(4).normal(size=time.size)
    table = zigzag(np.radians(15.0), 60.0, 0.1)
    assert corners(time, table["rudder_rad"][: time.size] + noise)[0].size == 0
    assert corners(time, 0.3 * np.sin(time))[0].size == 0
    assert corners(time, np.zeros_like(time))[0].size == 0
    assert corners(time[:3], time[:3])[0].size == 0


def test_corners_join_the_run_of_one_segment() -> None:
    run = run_from_columns("zigzag", zigzag(np.radians(15.0), 40.0, 0.5))
    steps = forcing(run.segments, 0.5, 0.05)
    assert steps.step.size > run.segments[0].time.size - 1
    assert float(np.sum(steps.step)) == pytest.approx(float(run.segments[0].time[-1]))
