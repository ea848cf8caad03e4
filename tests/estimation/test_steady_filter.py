"""The filter as it is after long, and the margins of the loop with it, against matrices and root finders."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

from autopilot.control.law import LoopGains
from autopilot.control.margins import (
    Delays,
    OutputFeedbackLoop,
    OutputFeedbackMargins,
    linear_of,
    output_feedback_margins,
    prediction,
    refusal_of,
    steady_filter,
)
from autopilot.estimation.disturbance import FilterNoise
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

RUDDER_IN_USE = math.radians(1.0)

Matrix = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
NOISE = FilterNoise(heading=1.0e-4, rate=4.0e-5, acceleration=2.0e-5, bias=3.0e-6, model_error=0.1, waves=True)
STABLE = Norrbin(0.2, 5.0)
BENT = Norrbin(0.4, 3.0, n1=1.0, n2=0.4, n3=3.0)
UNSTABLE = Norrbin(0.3, 4.0, n1=-0.5, n3=2.0)
BOATS = [STABLE, BENT, UNSTABLE]


def continuous(model: Norrbin) -> Matrix:
    """A and B of (psi, r, b, delta), straight on."""
    a = np.zeros((4, 4))
    a[0, 1] = 1.0
    a[1] = 0.0, -model.n1 / model.time_constant, model.gain / model.time_constant, model.gain / model.time_constant
    return a


@pytest.mark.parametrize("model", BOATS)
@pytest.mark.parametrize("seconds", [0.0, 0.05, 0.4, 3.0])
def test_the_prediction_is_the_matrix_exponential(model: Norrbin, seconds: float) -> None:
    wanted = expm(continuous(model) * seconds)
    found = prediction(model, seconds)
    assert np.allclose(found.transition, wanted[:3, :3], rtol=1e-9, atol=1e-12)
    assert np.allclose(found.drive, wanted[:3, 3], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("model", BOATS)
@pytest.mark.parametrize("interval", [0.1, 0.5])
def test_the_gains_solve_the_riccati_equation(model: Norrbin, interval: float) -> None:
    f = expm(continuous(model) * interval)[:3, :3]
    steered = NOISE.model_error * model.gain / model.time_constant * RUDDER_IN_USE
    q = (NOISE.acceleration + steered**2) * interval
    noise = np.diag([0.0, 0.0, NOISE.bias * interval])
    noise[:2, :2] = q * np.array([[interval**2 / 3.0, interval / 2.0], [interval / 2.0, 1.0]])
    h = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    r = np.diag([NOISE.heading, NOISE.rate])
    p = solve_discrete_are(f.T, h.T, noise, r)
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
    assert np.allclose(steady_filter(model, NOISE, interval).gains, gain, rtol=2e-3, atol=1e-5)


def test_the_model_is_straight_and_the_heading_s_age_has_its_own_prediction() -> None:
    assert linear_of(BENT._replace(n0=0.1)) == BENT._replace(n2=0.0, n3=0.0)
    found = steady_filter(BENT, NOISE, 0.2, 0.7)
    assert found.interval == 0.2
    assert found.prediction == prediction(BENT, 0.2)
    assert found.ahead == prediction(BENT, 0.7)


def loop_of(observed: OutputFeedbackLoop, omega: float) -> tuple[complex, complex]:
    """D and N of the equations of `autopilot.control.margins` at one frequency [rad/s], with matrices."""
    model, gear, delays, gains, uses_bias, steady = observed
    s = 1j * omega
    a, b = np.array(steady.prediction.transition), np.array(steady.prediction.drive)
    g = np.array(steady.gains)
    kept = np.eye(3) - g @ np.eye(2, 3)

    def mean(seconds: float) -> complex:
        return (1.0 - cmath.exp(-s * seconds)) / (s * seconds) if seconds else 1.0 + 0.0j

    left = np.eye(3) - cmath.exp(-s * steady.interval) * (kept @ a)
    from_rudder = np.linalg.solve(left, kept @ b * mean(steady.interval))
    from_boat = np.linalg.solve(left, g @ np.array([1.0, s]))
    late, ahead = cmath.exp(-s * delays.latency), np.array(steady.ahead.transition)
    from_command = ahead @ from_rudder * late + np.array(steady.ahead.drive) * mean(delays.latency)
    seen = ahead @ from_boat * late
    law = np.array([gains.proportional + gains.integral / s, gains.derivative, float(uses_bias)])
    law = law / (1.0 + s * gains.smoothing)
    acts = cmath.exp(-s * gear.delay) / (1.0 + s * gear.lag)
    boat = model.gain / (s * (model.time_constant * s + model.n1))
    return 1.0 + complex(law @ from_command) * acts, complex(law @ seen) * boat * acts * cmath.exp(-s * delays.unknown)


def roots(function: Callable[[float], float], low: float, high: float) -> list[float]:
    grid = np.geomspace(low, high, 3000)
    values = [function(float(w)) for w in grid]
    pairs = zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True)
    return [float(brentq(function, a, b, xtol=1e-13)) for a, b, x, y in pairs if x * y < 0.0 and abs(x - y) < 1.0]


def by_crossings(observed: OutputFeedbackLoop) -> OutputFeedbackMargins:
    """The margins of a loop known to be stable, from where L = N/D crosses the real axis and the unit circle."""
    high = 0.98 * math.pi / observed.steady.interval

    def ratio(omega: float) -> complex:
        inner, outer = loop_of(observed, omega)
        return outer / inner

    real = [ratio(w).real for w in roots(lambda w: ratio(w).imag / abs(ratio(w)), 1e-3, high)]
    factors = [-1.0 / value for value in real if value < 0.0]
    unit = roots(lambda w: math.tanh(math.log(abs(ratio(w)))), 1e-3, high)
    late = [((cmath.phase(ratio(w)) + math.pi) % (2.0 * math.pi)) / w for w in unit]
    grid = [float(w) for w in np.geomspace(1e-3, high, 3000)]
    return OutputFeedbackMargins(
        True,
        max((f for f in factors if 0.02 < f < 1.0), default=0.0),
        min((f for f in factors if 1.0 < f < 20.0), default=math.inf),
        min(late),
        max(1.0 / abs(1.0 + ratio(w)) for w in grid),
    )


GAINS = LoopGains(0.9, 0.0, 1.5)
GEAR = SteeringGear(0.5, 0.3, 0.1, delay=0.15)


def output_feedback_loop(
    model: Norrbin, gains: LoopGains, uses_bias: bool, delays: Delays, interval: float = 0.2, gear: SteeringGear = GEAR
) -> OutputFeedbackLoop:
    return OutputFeedbackLoop(
        model, gear, delays, gains, uses_bias, steady_filter(model, NOISE, interval, delays.latency)
    )


CASES = [
    output_feedback_loop(STABLE, GAINS, False, Delays(0.1)),
    output_feedback_loop(STABLE, GAINS, True, Delays(0.1)),
    output_feedback_loop(STABLE, GAINS._replace(integral=0.02), False, Delays(0.0, 0.3)),
    output_feedback_loop(STABLE, GAINS._replace(smoothing=0.4), True, Delays(0.05, 0.5), 0.1),
    output_feedback_loop(BENT, GAINS, True, Delays(0.2), 0.5),
    output_feedback_loop(UNSTABLE, LoopGains(1.5, 0.0, 4.0), True, Delays(0.05)),
    output_feedback_loop(UNSTABLE, LoopGains(1.5, 0.05, 4.0), False, Delays(0.05, 0.2)),
]


@pytest.mark.parametrize("observed", CASES)
def test_the_margins_are_where_the_loop_crosses(observed: OutputFeedbackLoop) -> None:
    found, wanted = output_feedback_margins(observed), by_crossings(observed)
    assert found.stable
    assert found.gain_down == pytest.approx(wanted.gain_down, rel=2e-2)
    assert found.gain_up == pytest.approx(wanted.gain_up, rel=2e-2)
    assert found.delay == pytest.approx(wanted.delay, rel=2e-2)
    assert found.sensitivity == pytest.approx(wanted.sensitivity, rel=2e-2)
    assert refusal_of(observed) == ""


@pytest.mark.parametrize("observed", CASES)
def test_past_a_margin_the_loop_is_unstable_and_before_it_is_not(observed: OutputFeedbackLoop) -> None:
    margins = output_feedback_margins(observed)
    for share, is_stable in ((0.97, True), (1.03, False)):
        later = observed.delays._replace(unknown=observed.delays.unknown + share * margins.delay)
        assert output_feedback_margins(observed._replace(delays=later)).stable == is_stable
    assert "unstable with the heading filter" in refusal_of(observed._replace(delays=later))
    assert output_feedback_margins(observed._replace(delays=later)) == (False, 1.0, 1.0, 0.0, math.inf)
    if margins.gain_up < math.inf:
        for share, is_stable in ((0.97, True), (1.03, False)):
            stronger = observed.model._replace(gain=share * margins.gain_up * observed.model.gain)
            assert output_feedback_margins(observed._replace(model=stronger)).stable == is_stable


@pytest.mark.parametrize("observed", CASES[5:])
@pytest.mark.parametrize(("down", "is_refused"), [(0.68, False), (0.72, True)])
def test_a_course_unstable_boat_must_stay_steerable_with_seven_tenths_of_its_rudder(
    observed: OutputFeedbackLoop, down: float, is_refused: bool
) -> None:
    gain = observed.model.gain * output_feedback_margins(observed).gain_down / down
    nearer = observed._replace(model=observed.model._replace(gain=gain))
    assert output_feedback_margins(nearer).gain_down == pytest.approx(down, rel=1e-3)
    refusal = refusal_of(nearer)
    assert ("lost where its rudder is 30 % weaker than the model's" in refusal) is is_refused
    assert bool(refusal) is is_refused


@pytest.mark.parametrize(
    ("down", "up", "late", "wanted"),
    [
        (0.3, 5.0, 0.7, (0.3, 5.0, 0.7)),
        (0.021, 19.9, 0.02, (0.021, 19.9, 0.02)),
        (0.019, 20.1, 0.004, (0.0, math.inf, 0.004)),
        (0.5, 3.0, 48.0, (0.5, 3.0, 48.0)),
        (0.5, 3.0, 70.0, (0.5, 3.0, math.inf)),
    ],
)
def test_the_gain_range_is_searched_from_a_fiftieth_to_a_hundredfold(
    monkeypatch: pytest.MonkeyPatch, down: float, up: float, late: float, wanted: tuple[float, float, float]
) -> None:
    """Of a loop that crosses over at 2 rad/s: a delay of 50 s or more is none that matters."""
    monkeypatch.setattr("autopilot.control.margins._crossover", lambda _: 2.0)
    monkeypatch.setattr(
        "autopilot.control.margins._holds",
        lambda _, __, factor, delay=0.0: down < factor < up and delay < late,
    )
    found = output_feedback_margins(CASES[0])
    assert found.stable
    assert (found.gain_down, found.gain_up, found.delay) == pytest.approx(wanted, rel=1e-6)


def test_the_pace_is_the_highest_frequency_at_which_the_loop_is_not_small(monkeypatch: pytest.MonkeyPatch) -> None:
    scales: list[float] = []
    monkeypatch.setattr("autopilot.control.margins._delay", lambda _, scale: scales.append(scale))
    for observed in CASES:
        output_feedback_margins(observed)
        pace = 1.0 / scales[-1]
        (inner, outer), (after, beyond) = loop_of(observed, pace), loop_of(observed, 1.07 * pace)
        assert abs(outer) >= 0.999 * abs(inner) and abs(beyond) < abs(after)


@pytest.mark.parametrize(
    ("observed", "least", "says"),
    [
        (CASES[0], 0.8, ""),
        (CASES[0], 1.0, "unstable with the heading filter"),
        (CASES[5], 0.699, ""),
        (CASES[5], 0.701, "is lost where its rudder is 30 % weaker"),
        (CASES[5], 1.0, "unstable with the heading filter"),
    ],
)
def test_only_a_course_unstable_boat_needs_a_rudder_to_spare(
    monkeypatch: pytest.MonkeyPatch, observed: OutputFeedbackLoop, least: float, says: str
) -> None:
    monkeypatch.setattr("autopilot.control.margins._holds", lambda _, __, factor, delay=0.0: least < factor)
    found = refusal_of(observed)
    assert says in found and bool(found) is bool(says)


@pytest.mark.parametrize("observed", CASES)
def test_the_curve_is_that_of_the_matrices_up_to_half_the_sampling_frequency(
    monkeypatch: pytest.MonkeyPatch, observed: OutputFeedbackLoop
) -> None:
    """160 frequencies from a thousandth of the slower of the boat's own pace and the highest one."""
    seen: list[Any] = []
    monkeypatch.setattr("autopilot.control.margins._crossover", lambda curve: [seen.append(curve), 1.0][1])
    found = output_feedback_margins(observed)
    omegas, inner, outer = seen[0]
    high = 0.98 * math.pi / observed.steady.interval
    low = 1e-3 * min(1.0 / observed.model.time_constant, high)
    assert omegas == pytest.approx(np.geomspace(low, high, 160))
    for place in range(0, 160, 12):
        d, n = loop_of(observed, omegas[place])
        assert (inner[place], outer[place]) == (pytest.approx(d, rel=1e-6), pytest.approx(n, rel=1e-6))
    worst = max(abs(d / (d + n)) for d, n in zip(inner, outer, strict=True))
    assert found.sensitivity == pytest.approx(worst)
