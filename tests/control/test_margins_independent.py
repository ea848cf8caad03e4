"""Margins against poles (Pade) and against a root finder."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from autopilot.control.backstepping import linear_gains_backstepping, lqr_gains
from autopilot.control.design import design_backstepping, margins
from autopilot.control.law import LoopGains
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

BOATS = [
    (Norrbin(0.701, 0.332, 3.2828), SteeringGear(0.52, 0.35, 0.1, 0.0, 0.05)),
    (Norrbin(0.2, 5.0), SteeringGear(0.6, 0.12, 0.3)),
    (Norrbin(0.1, 20.0), SteeringGear(0.6, 0.05, 0.3)),
    (Norrbin(0.2, 5.0, 20.0, n1=-1.0), SteeringGear(0.6, 0.12, 0.3)),
]

gain = st.floats(0.1, 4.0)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.1, 4.0), st.floats(0.1, 4.0), st.floats(0.02, 0.4), st.floats(0.005, 0.3), st.sampled_from([1.0, -1.0])
)
def test_stability_agrees_with_the_poles_of_the_closed_loop(
    proportional: float, derivative: float, lag: float, delay: float, n1: float
) -> None:
    """Poles with a third-order Pade approximation of the dead time; too close to the border is not asked."""
    model = Norrbin(0.7, 0.5, n1=n1)
    numerator = np.array([-(delay**3), 12 * delay**2, -60 * delay, 120.0])
    denominator = np.array([delay**3, 12 * delay**2, 60 * delay, 120.0])
    plant = np.polymul(np.polymul([model.time_constant, n1, 0.0], [lag, 1.0]), denominator)
    closed = np.polyadd(plant, model.gain * np.polymul([derivative, proportional], numerator))
    rightmost = float(np.roots(np.trim_zeros(closed, "f")).real.max())
    found = margins(model, lag, delay, math.inf, LoopGains(proportional, 0.0, derivative))
    if abs(rightmost) > 0.15:
        assert found.stable == (rightmost < 0.0)


@pytest.mark.parametrize(
    ("model", "gear", "bandwidth"),
    # the first without a weight on the rudder's rate, the others with one
    [*((*boat, None) for boat in BOATS), (*BOATS[0], 1.72), (*BOATS[1], 0.328), (*BOATS[2], 0.1326)],
)
def test_phase_margin_and_sensitivity_agree_with_a_root_finder(
    model: Norrbin, gear: SteeringGear, bandwidth: float | None
) -> None:
    design = design_backstepping(model, gear, gear.rate_max, 0.05)
    law = design if bandwidth is None else lqr_gains(model, bandwidth)
    p, _, d, smoothing, _ = linear_gains_backstepping(model, law)
    assert (smoothing > 0.0) is (bandwidth is not None)
    found = margins(model, gear.lag, gear.delay + 0.05, gear.rate_max, LoopGains(p, 0.0, d, smoothing))

    def opened(w: float) -> complex:
        s = 1j * w
        boat = model.gain / (s * (model.time_constant * s + model.n1))
        return (p + d * s) / (1.0 + smoothing * s) * boat * cmath.exp(-s * (gear.delay + 0.05)) / (gear.lag * s + 1.0)

    crossing = brentq(lambda w: abs(opened(w)) - 1.0, 0.5 * found.crossover, 3.0 * found.crossover)
    assert found.crossover == pytest.approx(crossing, rel=0.05)
    assert found.phase == pytest.approx(math.pi + cmath.phase(opened(crossing)), abs=math.radians(3.0))
    worst = max(1.0 / abs(1.0 + opened(w)) for w in np.geomspace(1e-3 * crossing, 1e3 * crossing, 20000))
    assert found.sensitivity == pytest.approx(worst, rel=0.01)
