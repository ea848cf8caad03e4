"""What is forecast of manoeuvres that were not sailed, against a boat that shares nothing with the project."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from independent_boat import SPEED_M_S, Plant, Sea, zigzags

from autopilot.identification.identified import Identified, Question
from autopilot.identification.identify import identify
from autopilot.identification.likelihood_fit import LikelihoodFit, likelihood_fit
from autopilot.identification.marginal_likelihood import Rates, Weather, still_waves
from autopilot.identification.prediction_bands import (
    AHEAD_S,
    TURNING_RAD,
    boats_of,
    forecast,
    gear_of,
    headings_after,
    motions_of,
    overshoots,
    stretches_of,
    turned,
    widened,
)
from autopilot.identification.rudder_path import DIRECT
from autopilot.identification.runs import FloatArray, Run, run_from_columns
from autopilot.models.steering_gear import SteeringGear
from autopilot.report.identification import Result, as_text, document_of
from autopilot.report.identification_page import identification_page

PLANT = Plant("K 0.43, T 3.5", 0.43 / 3.5, 1.0 / 3.5, 6.0 / 3.5, 0.0015, 15.0, 60.0)
SEA = Sea("gusts", gust_deg=1.0, rudder_deg=0.1)


def runs_of(seed: int, plant: Plant = PLANT, sea: Sea = SEA) -> list[Run]:
    return [run_from_columns(f"{side:+d}.csv", zigzags(plant, sea, [seed], side)[0]) for side in (1, -1)]


@pytest.fixture(scope="module")
def found() -> Identified:
    return identify(runs_of(300), Question(reference_speed=SPEED_M_S))


@pytest.mark.parametrize("doubt", [1.0, 1.0e2, 1.0e4])
def test_boats_of_which_next_to_nothing_is_known_are_forecast_with_wide_bands(doubt: float) -> None:
    """Some of those drawn run away."""
    spread = np.square(doubt * np.array([0.01, 0.02, 0.1, 0.001]))
    weather = Weather(0.002, 6.0, 0.0005, 0.002, 0.005)
    fit = LikelihoodFit(Rates(0.12, 0.28, 1.7), np.diag(spread), DIRECT, {}, weather, 0.0)
    ahead = forecast(fit, runs_of(300)[:1], SPEED_M_S, SteeringGear(math.inf, 0.26))
    assert np.isfinite(ahead.turn).all()
    assert (ahead.heading.high - ahead.heading.low > 10.0) == (doubt > 1.0)


def test_waves_that_push_the_boat_are_in_the_bands() -> None:
    """A boat that goes straight on forgets its rate in 1/b; the waves' push moves its rate by what a filter of first
    order lets through at their frequency W."""
    b, W, damping, wave = 0.3, 1.2, 0.1, 0.02
    weather = Weather(1.0e-6, 6.0, 1.0e-6, 0.002, 0.005, wave, W, damping, True)
    fit = LikelihoodFit(Rates(0.1, b), np.diag([1.0e-14] * 4), DIRECT, {}, weather, 0.0)
    boats = boats_of(fit, np.ones(1), np.random.default_rng(2), 2000)
    headings = turned(boats, lambda time: (np.zeros(2000), np.ones(2000)), 30.0)
    rates = (headings[-1] - headings[-2]) / boats.step
    through = wave * W * W / math.sqrt(b * b + 2.0 * damping * W * b + W * W) * math.sqrt((2.0 * damping * W + b) / b)
    assert np.std(rates) == pytest.approx(through, rel=0.1)


def test_a_zigzag_of_a_known_boat_overshoots_as_its_equation_does() -> None:
    """A quick boat in a calm, against small steps of Euler's: to a tenth of what a compass shows."""
    a, b, d, travel, lag, h, angle = 1.5, 0.7, 30.0, 0.44, 0.1, 2.0e-4, math.radians(10.0)
    fit = LikelihoodFit(
        Rates(a, b, d), np.diag([1.0e-14] * 4), DIRECT, {}, Weather(1.0e-7, 6.0, 1.0e-7, 0.002, 0.005), 0.0
    )
    drawn = boats_of(fit, np.ones(1), np.random.default_rng(2), 3)
    heading = rate = rudder = called = 0.0
    side, beyond = 1.0, list[float]()
    while len(beyond) < 3:
        if side * heading >= angle:
            side, called = -side, abs(heading)
            beyond.append(0.0)
        rudder += min(max(h / lag * (side * angle - rudder), -travel * h), travel * h)
        rate += h * (a * rudder - b * rate - d * rate**3)
        heading += h * rate
        if beyond:
            beyond[-1] = max(beyond[-1], -side * heading - called)
    found = overshoots(drawn, angle, SteeringGear(math.inf, travel, lag))
    assert np.degrees(found[:, 0]) == pytest.approx(np.degrees(beyond[:2]), abs=0.03)


def first_overshoots(table: dict[str, FloatArray], angle: float) -> list[float]:
    heading, rudder = table["heading_rad"], table["rudder_rad"]
    moving = np.flatnonzero(np.abs(np.diff(np.sign(rudder))) > 1)
    begins = [k - np.argmax(np.abs(rudder[k::-1]) >= 0.99 * angle) for k in moving]
    spans = [heading[begin:end] for begin, end in pairwise(begins[:3])]
    return [float(np.max(np.abs(span))) - angle for span in spans]


def test_overshoots_of_a_zigzag_that_was_not_sailed_lie_in_their_bands(found: Identified) -> None:
    assert found.likely is not None
    expected = forecast(found.likely, runs_of(300), SPEED_M_S, SteeringGear(math.inf, math.radians(15.0)))
    angle, inside = math.radians(10.0), []
    truth = zigzags(PLANT, SEA._replace(rudder_deg=0.0, compass_deg=0.0), list(range(400, 420)), 1, 10.0)
    for table in truth:
        for band, value in zip(expected.overshoots[10.0], first_overshoots(table, angle), strict=True):
            inside.append(band.low <= value <= band.high)
    # 95 % of 40; fewer than 33 by chance in one case of 400
    assert sum(inside) >= 33
    # and the bands say something
    for band in expected.overshoots[10.0]:
        assert band.high - band.low < 2.0 * band.middle


def test_headings_of_another_day_lie_in_their_bands(found: Identified) -> None:
    assert found.likely is not None
    inside = []
    for seed in range(500, 504):
        segments = [segment for run in runs_of(seed) for segment in run.segments]
        parts = stretches_of(segments, motions_of(segments), AHEAD_S)
        drawn = headings_after(found.likely, parts, AHEAD_S, SPEED_M_S)
        low, high = np.quantile(drawn, (0.025, 0.975), axis=1)
        turned = np.array([part.turned for part in parts])
        inside += ((low <= turned) & (turned <= high)).tolist()
    assert np.mean(inside) >= 0.85


def test_a_fit_that_errs_by_more_than_it_says_is_widened(found: Identified) -> None:
    assert found.likely is not None
    weather = found.likely.weather
    sure = found.likely._replace(
        covariance=0.01 * found.likely.covariance,
        weather=weather._replace(gust=0.1 * weather.gust, white=0.1 * weather.white),
        power=None,
    )
    assert widened(sure, runs_of(300), SPEED_M_S).weather.gust > 3.0 * sure.weather.gust
    assert widened(found.likely, runs_of(300), SPEED_M_S).weather.gust < 2.0 * weather.gust


def test_the_user_sees_the_bands(found: Identified) -> None:
    assert found.likely is not None
    runs = runs_of(300)
    expected = forecast(found.likely, runs, SPEED_M_S, gear_of(runs))
    result = Result("norrbin", found, None, [(run, "fit", found.predict(run)) for run in runs], forecast=expected)
    text, document = as_text(result), document_of(result)["forecast"]
    assert "first overshoot of a 10/10 zigzag" in text and "second overshoot of a 20/20 zigzag" in text
    turn = document[f"heading {AHEAD_S:g} s after {math.degrees(TURNING_RAD):g} deg of rudder"]
    assert turn["low_deg"] < turn["middle_deg"] < turn["high_deg"]
    page = identification_page(result, "output-error", "autopilot identify", None, {})
    assert "time since the rudder went over" in page


def in_a_race(power: float) -> Run:
    """A 20/20 zigzag of a boat that loses a third of its speed in its turns, and steers with a power of it."""
    step, angle = 0.02, math.radians(20.0)
    psi, r, ratio, side, rows = 0.0, 0.0, 1.0, 1.0, []
    for k in range(6000):
        side = -side if side * psi > angle else side
        if k % 5 == 0:
            rows.append((k * step, psi, side * angle, 5.0 * ratio))
        r += step * (0.2 * ratio**power * side * angle - 0.3 * ratio * r - 2.0 / ratio * r**3)
        psi += step * r
        ratio += step * (1.0 - 2.0 * abs(r) - ratio) / 5.0
    columns = dict(zip(("time_s", "heading_rad", "rudder_rad", "speed_m_s"), np.array(rows).T, strict=True))
    columns["heading_rad"] += math.radians(0.1) * np.random.default_rng(1).normal(size=len(rows))
    return run_from_columns("race.csv", columns)


def pushed(weather: Weather) -> float:
    """Return what gusts, and waves where they push the boat, drive it by [rad/s^2], rms."""
    waves = still_waves(weather)[0] if weather.wave > 0.0 and weather.wave_pushes else 0.0
    return math.sqrt(weather.gust**2 + waves)


def test_how_a_boat_is_another_where_its_rudder_steers_with_another_power_of_the_speed() -> None:
    truth = np.array([0.2, 0.3, 2.0])
    fit = likelihood_fit(in_a_race(1.5).segments, 5.0, Rates(0.2, 0.3, 2.0, 0.0))
    assert fit is not None and fit.power is not None
    assert fit.power.mean == pytest.approx(-0.5, abs=0.15)
    found, changed = np.array(fit.rates[:3]), fit.power.boat[:3]
    assert (np.abs(found + changed - truth) < 0.2 * np.abs(found - truth)).all()
    # what is no gust, and no wave, is not taken for one
    assert pushed(fit.pushes) < 0.2 * pushed(fit.weather)
    drawn = boats_of(fit, np.ones(1), np.random.default_rng(1))
    assert np.mean(drawn.beyond) == pytest.approx(fit.power.mean, abs=0.05)
    assert 0.3 < np.std(drawn.beyond) < 0.5 and np.std(drawn.b) > np.sqrt(fit.covariance[1, 1])


def test_a_quick_boat_in_a_calm_errs_in_its_own_runs_by_what_it_says() -> None:
    """A boat that forgets its rate in a third of a second, on nodes of which three make that: between them its rate is
    no straight line."""
    lanxin, calm = Plant("Lanxin", 2.11, 3.01, 9.9, 0.03, 20.0, 300.0), Sea("calm", gyro_deg_s=0.1)
    runs = runs_of(310, lanxin, calm)
    fit = identify(runs, Question(reference_speed=SPEED_M_S)).likely
    assert fit is not None
    assert widened(fit, runs, SPEED_M_S).weather.gust < 2.0 * fit.weather.gust
    parts = stretches_of(runs[0].segments, fit.motions[:1], AHEAD_S)
    assert all(0.99 * AHEAD_S < each.lasts < AHEAD_S + 1.0e-6 for each in parts)


def test_a_lag_acts_through_a_step_by_its_mean() -> None:
    """Boats behind a lag of five steps turn as in steps a tenth as long."""
    weather = Weather(1.0e-9, 6.0, 1.0e-9, 0.002, 0.005)
    train, rates = DIRECT._replace(lag=0.5, lead=0.8), Rates(0.12, 0.28, 1.7)
    fit = LikelihoodFit(rates, 1.0e-12 * np.eye(4), train, {}, weather, 0.0)
    drawn = boats_of(fit, np.ones(1), np.random.default_rng(2), 3)
    over = lambda time: (np.full(3, 0.3), np.ones(3))  # noqa: E731
    before = np.zeros((1, 3))
    coarse, fine = (turned(drawn._replace(step=h), over, 6.0, 0.0, before)[-1] for h in (0.1, 0.01))
    assert coarse == pytest.approx(fine, rel=1.0e-3)
