"""Margins against simulations of the same loop; designs on boats of all sizes; refusals with their reason."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import pytest

from autopilot.build import build_pilot, verdict_of
from autopilot.control.backstepping import BacksteppingGains
from autopilot.control.design import (
    WORST_SENSITIVITY,
    LoopGains,
    design_backstepping,
    equivalent_pid,
    linear_gains_backstepping,
    linear_gains_pid,
    margins,
)
from autopilot.errors import RefusedError
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.params.vessel_file import load_vessel

BOATS = [
    (Norrbin(0.701, 0.332, 3.2828), SteeringGear(0.52, math.radians(20.0), 0.1, 0.0, 0.05)),
    (Norrbin(0.2, 5.0), SteeringGear(0.52, math.radians(5.0), 0.2, 0.0, 0.1)),
    (Norrbin(0.1, 20.0), SteeringGear(0.52, math.radians(2.5), 0.3, 0.0, 0.1)),
    (Norrbin(0.2, 5.0, 20.0, n1=-1.0), SteeringGear(0.52, math.radians(5.0), 0.2, 0.0, 0.1)),
]


def grows(model: Norrbin, lag: float, delay: float, gains: LoopGains) -> bool:
    """Simulate the linear loop by small Euler steps and tell whether it grows: no frequency domain in here."""
    quickest = max(
        1.0 / model.time_constant,
        1.0 / lag,
        1.0 / max(delay, 1e-6),
        gains.derivative * model.gain / model.time_constant,
    )
    dt = min(0.02 / quickest, 0.01)
    waiting = deque([0.0] * max(1, round(delay / dt)))
    psi, rate, rudder, integral = 0.01, 0.0, 0.0, 0.0
    peak_early = peak_late = 0.0
    count = int(60.0 * max(model.time_constant, 1.0) / dt)
    for i in range(count):
        integral += psi * dt
        waiting.append(-(gains.proportional * psi + gains.integral * integral + gains.derivative * rate))
        rudder += dt * (waiting.popleft() - rudder) / lag
        rate += dt * (model.gain * rudder - model.n1 * rate) / model.time_constant
        psi += dt * rate
        if i < count // 3:
            peak_early = max(peak_early, abs(psi))
        elif i > 2 * count // 3:
            peak_late = max(peak_late, abs(psi))
        if abs(psi) > 1.0e3:
            return True
    return peak_late > peak_early


@pytest.mark.parametrize(("model", "gear"), BOATS[:2] + BOATS[3:])
def test_gain_and_delay_margin_are_where_the_simulated_loop_turns_unstable(model: Norrbin, gear: SteeringGear) -> None:
    delay = gear.delay + 0.05
    gains = linear_gains_backstepping(model, design_backstepping(model, gear, gear.rate_max, 0.05))
    found = margins(model, gear.lag, delay, gear.rate_max, gains)
    for factor, unstable in ((0.85, False), (1.15, True)):
        scaled = LoopGains(*(gain * (found.gain * factor) for gain in gains))
        assert grows(model, gear.lag, delay, scaled) is unstable
        assert margins(model, gear.lag, delay, gear.rate_max, scaled).stable is not unstable
    for factor, unstable in ((0.85, False), (1.2, True)):
        assert grows(model, gear.lag, delay + found.delay * factor, gains) is unstable
        assert margins(model, gear.lag, delay + found.delay * factor, gear.rate_max, gains).stable is not unstable


@pytest.mark.parametrize(("model", "gear"), BOATS)
def test_every_boat_gets_gains_with_margins(model: Norrbin, gear: SteeringGear) -> None:
    gains = design_backstepping(model, gear, gear.rate_max, 0.05)
    found = margins(model, gear.lag, gear.delay + 0.05, gear.rate_max, linear_gains_backstepping(model, gains))
    assert found.stable
    assert found.sensitivity <= WORST_SENSITIVITY
    assert found.gain > 2.0
    assert math.degrees(found.phase) > 40.0


def test_a_pid_with_the_same_linear_part_has_the_same_margins() -> None:
    model, _ = BOATS[0]
    gains = BacksteppingGains(2.0, 2.0)
    same = linear_gains_pid(equivalent_pid(model, gains))
    assert same == pytest.approx(linear_gains_backstepping(model, gains))


def test_no_gain_serves_a_hopeless_rudder() -> None:
    with pytest.raises(ValueError, match="too slow for this boat"):
        design_backstepping(Norrbin(0.5, 1.0, 5.0, n1=-1.0), SteeringGear(0.5, 0.01, 5.0, 0.0, 3.0), 0.01, 1.0)


def test_a_course_unstable_boat_cannot_be_spared_the_rudder() -> None:
    model, gear = BOATS[3]
    with pytest.raises(ValueError, match="try --no-spare-rudder"):
        design_backstepping(model, gear, gear.rate_max, 0.05, spares=True)


def test_the_papers_gains_are_refused_on_a_real_rudder_with_the_reason() -> None:
    with pytest.raises(RefusedError, match=r"refused to engage: the loop is unstable with a rudder with 20\.0 deg/s"):
        build_pilot(load_vessel("lanxin_paper_gains"))


def test_the_papers_gains_serve_an_ideal_rudder() -> None:
    vessel = load_vessel("lanxin_paper_gains")
    ideal = replace(
        vessel,
        rudder=replace(vessel.rudder, rate_max_deg_s=None, lag_s=0.0, delay_s=0.0),
        control=replace(vessel.control, loop_delay_s=0.0),
    )
    assert verdict_of(ideal).refusal == ""
    assert build_pilot(ideal).law.name == "backstepping"


def test_a_rate_limited_rudder_without_lag_is_refused_for_its_limit_cycle() -> None:
    vessel = load_vessel("lanxin_paper_gains")
    quick = replace(
        vessel,
        rudder=replace(vessel.rudder, lag_s=0.0, delay_s=0.0),
        control=replace(vessel.control, loop_delay_s=0.0),
    )
    assert "limit-cycle" in verdict_of(quick).refusal


def test_a_law_without_gains_is_refused_with_the_key_to_add() -> None:
    vessel = load_vessel("lanxin")
    with pytest.raises(RefusedError, match=r"add control\.pid to the file"):
        build_pilot(replace(vessel, control=replace(vessel.control, pid=None)), "pid")


@pytest.mark.parametrize("level", [1, 5, 9])
@pytest.mark.parametrize(("model", "gear"), [*BOATS, (Norrbin(0.2, 5.0, n1=6.0), BOATS[1][1])])
def test_designed_gains_place_the_poles_and_keep_the_boat_s_own_damping(
    model: Norrbin, gear: SteeringGear, level: int
) -> None:
    """gamma = k^2/4, k1 k2 = k^2, k1 + k2 = 2 k or the boat's n1/T where that is more."""
    gains = design_backstepping(model, gear, gear.rate_max, 0.05, level)
    k = 2.0 * math.sqrt(gains.gamma)
    assert gains.k1 * gains.k2 == pytest.approx(k * k)
    assert gains.k1 + gains.k2 == pytest.approx(max(2.0 * k, model.n1 / model.time_constant))
    assert gains.k1 <= gains.k2 * (1.0 + 1.0e-9)
    assert gains.smoothing == 0.0
