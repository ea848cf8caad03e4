"""The bound of Cramer and Rao against closed forms, and the fit against the bound."""

from __future__ import annotations

import numpy as np
import pytest
from zigzag_trials import noisy, run_of, zigzag

from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.output_error import Weighting
from autopilot.identification.runs import Run, Segment
from autopilot.identification.trial_design import InstrumentNoise, cramer_rao, planned, zigzag_helm
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

RATE, HEADING = np.radians(0.1), np.radians(0.2)
BOAT = Norrbin(0.2, 2.0, reference_speed=5.0)
GEAR = SteeringGear(np.radians(35.0), np.radians(20.0))


def held(rudder: float, seconds: float = 200.0) -> Run:
    time = np.arange(0.0, seconds, 0.1)
    still = np.zeros_like(time)
    return Run("held", (Segment(time, still, still, np.full_like(time, rudder), np.full_like(time, 5.0)),))


def test_a_held_rudder_tells_the_gain_as_a_mean_of_rates_would() -> None:
    """r = K delta after the start: the error of K is s/(|delta| sqrt(N)) where the rate alone is measured."""
    run = held(0.2, 2000.0)
    bound = cramer_rao([run], BOAT, ("gain",), InstrumentNoise(RATE, np.inf))
    assert bound["gain"] == pytest.approx(RATE / (0.2 * np.sqrt(run.segments[0].time.size)), rel=0.02)


def test_twice_the_noise_is_twice_the_error_and_four_trials_are_half() -> None:
    trial = planned(BOAT, GEAR, zigzag_helm(0.26, 0.26), 60.0, 0.1, 5.0)
    free = ("gain", "time_constant", "n0")
    one = cramer_rao([trial], BOAT, free, InstrumentNoise(RATE, HEADING))
    noisier = cramer_rao([trial], BOAT, free, InstrumentNoise(2.0 * RATE, 2.0 * HEADING))
    four = cramer_rao([trial] * 4, BOAT, free, InstrumentNoise(RATE, HEADING))
    for name in free:
        assert noisier[name] == pytest.approx(2.0 * one[name], rel=1.0e-6)
        assert four[name] == pytest.approx(0.5 * one[name], rel=1.0e-6)


def test_what_a_trial_does_not_tell_is_infinite() -> None:
    """One held rudder from a steady turn on: gain, offset and cubic damping say the same."""
    bound = cramer_rao([held(0.2)], BOAT, ("gain", "time_constant", "n3", "n0"), InstrumentNoise(RATE, HEADING))
    still = cramer_rao([held(0.0)], BOAT, ("gain", "time_constant", "n0"), InstrumentNoise(RATE, HEADING))
    assert bound["gain"] == np.inf or bound["gain"] > BOAT.gain
    assert still["gain"] == np.inf
    assert np.isfinite(still["n0"])


def test_the_planned_trial_is_the_zigzag_of_another_integration() -> None:
    model = Norrbin(0.701, 0.332, 3.2828, reference_speed=5.0)
    mine = planned(model, GEAR, zigzag_helm(np.radians(15.0), np.radians(15.0)), 20.0, 0.005, 5.0).segments[0]
    other = zigzag(np.radians(15.0), 20.0, 0.005)
    reversals = np.flatnonzero(np.diff(np.sign(mine.heading)))
    theirs = np.flatnonzero(np.diff(np.sign(other["heading_rad"])))
    np.testing.assert_allclose(mine.time[reversals], other["time_s"][theirs], atol=0.02)


@pytest.mark.parametrize("weighting", ["residuals", "likelihood"])
def test_the_fit_reaches_the_bound_and_its_intervals_cover_the_truth(weighting: Weighting) -> None:
    """12 seeds of a zigzag: rms error over bound is within 1.25 for the sample that small (chi-square, 1 %: 1.5).

    The bound knows that there are no gusts, and so does the fit to white residuals. The likelihood asks the record, and
    what it cannot exclude makes its intervals wider.
    """
    table = zigzag(np.radians(15.0), 60.0, 0.1)
    truth = Norrbin(0.701, 0.332, 3.2828, reference_speed=5.0)
    free = ("gain", "time_constant", "n3", "n0")
    bound = cramer_rao([run_of(table)], truth, free, InstrumentNoise(RATE, HEADING))
    question = Question(reference_speed=5.0, weighting=weighting)
    found = [identify([run_of(noisy(table, RATE, HEADING, seed))], question) for seed in range(12)]
    for name in free:
        errors = np.array([getattr(fit.model, name) - getattr(truth, name) for fit in found])
        assert np.sqrt(np.mean(errors**2)) < 1.5 * bound[name]
        bounds = np.array([fit.standard_errors[name] for fit in found], dtype=float)
        assert np.mean(bounds) > 0.9 * bound[name]
        if weighting == "residuals":
            assert np.mean(bounds) == pytest.approx(bound[name], rel=0.1)
        assert np.count_nonzero(np.abs(errors) > 1.96 * bounds) <= 3
