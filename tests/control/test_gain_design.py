"""Margins against simulations of the same loop; designs on boats of all sizes; refusals with their reason."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from boats import BOATS as TEST_BOATS
from boats import vessel_of
from hypothesis import given
from hypothesis import strategies as st

from autopilot.control import backstepping
from autopilot.control.backstepping import BacksteppingGains, linear_gains_backstepping, lqr_gains
from autopilot.control.design import (
    WORST_SENSITIVITY,
    Margins,
    Spread,
    ahead_gains,
    design_backstepping,
    judge,
    loop,
    margins,
    worst_margins,
)
from autopilot.control.front import AS_MODELLED, CALM, SLOW_WORST, bandwidth_of, cost
from autopilot.control.law import NO_ROLL, LawInput, LoopGains
from autopilot.control.pid import equivalent_pid
from autopilot.control.sliding_heading import linear_gains_sliding, sliding_of
from autopilot.errors import RefusedError
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import build_pilot, verdict_of
from autopilot.runtime.tuning import afloat_of, bandwidths_of, bears_speeds, front_of, offs_of
from autopilot.signals import NavState, Reference
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel

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
    kp, ki, kd = equivalent_pid(model, gains)
    same = LoopGains(kp, ki, kd)
    assert same == pytest.approx(linear_gains_backstepping(model, gains))


def test_no_gain_serves_a_hopeless_rudder() -> None:
    with pytest.raises(ValueError, match="too slow for this boat"):
        design_backstepping(Norrbin(0.5, 1.0, 5.0, n1=-1.0), SteeringGear(0.5, 0.01, 5.0, 0.0, 3.0), 0.01, 1.0)


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


def room(model: Norrbin, gear: SteeringGear, level: int) -> tuple[float, float, float]:
    """How quick the designed loop is, k [1/s], its Ms and the error [deg] that saturates the rudder's rate."""
    gains = design_backstepping(model, gear, gear.rate_max, 0.05, level)
    return spare_room(model, gear, 2.0 * math.sqrt(gains.gamma))


def spare_room(model: Norrbin, gear: SteeringGear, k: float) -> tuple[float, float, float]:
    gains = BacksteppingGains(k, k, 0.25 * k * k)
    found = margins(model, gear.lag, gear.delay + 0.05, gear.rate_max, linear_gains_backstepping(model, gains))
    return k, found.sensitivity if found.stable else math.inf, math.degrees(found.saturation)


@pytest.mark.parametrize(("model", "gear"), BOATS[:3])
def test_level_five_is_the_quickest_loop_with_its_margins(model: Norrbin, gear: SteeringGear) -> None:
    """Ms of 1.6 and one degree of error before the rudder's rate saturates; a tenth quicker breaks one of the two."""
    k, sensitivity, error = room(model, gear, 5)
    assert sensitivity <= 1.6 and error >= 1.0
    _, above, less = spare_room(model, gear, 1.11 * k)
    assert above > 1.6 or less < 1.0


@pytest.mark.parametrize(("model", "gear"), BOATS[:1])
def test_three_levels_down_halve_the_loop_and_each_level_up_takes_what_it_may(
    model: Norrbin, gear: SteeringGear
) -> None:
    middle, _, _ = room(model, gear, 5)
    for level in (1, 2, 3, 4):
        assert room(model, gear, level)[0] / middle == pytest.approx(2.0 ** ((level - 5) / 3.0))
    for up in (1, 2, 3, 4):
        k, sensitivity, error = room(model, gear, 5 + up)
        most, least = 1.6 + 0.1 * up, 2.0 ** (-0.5 * up)
        assert sensitivity <= most and error >= least and k <= middle * 2.0 ** (up / 3.0) * (1.0 + 1e-9)
        _, above, less = spare_room(model, gear, 1.11 * k)
        is_full = k >= middle * 2.0 ** (up / 3.0) * (1.0 - 1e-9)
        assert is_full or above > most or less < least
    for level in (0, 10, -5):
        with pytest.raises(ValueError, match=f"response level {level}: allowed is 1"):
            design_backstepping(model, gear, gear.rate_max, 0.05, level)


@pytest.mark.parametrize("proportional", [0.3, 1.0, 2.5])
def test_crossover_and_gain_margin_of_a_loop_that_can_be_worked_out(proportional: float) -> None:
    """p K/(s (T s + 1) (lag s + 1)) turns unstable at p K = 1/T + 1/lag; the grid's steps are 3.5 %."""
    model, lag = Norrbin(0.4, 2.0), 0.3
    gains = LoopGains(proportional, 0.0, 0.0)
    found = margins(model, lag, 0.0, 0.2, gains)
    assert found.gain == pytest.approx((1.0 / 2.0 + 1.0 / lag) / (0.4 * proportional), rel=0.12)
    size = abs(loop(model, lag, 0.0, gains, found.crossover))
    assert 1.0 <= size < 1.12
    assert all(abs(loop(model, lag, 0.0, gains, found.crossover * up)) < 1.0 for up in (1.04, 1.5, 10.0, 300.0))
    angle = -math.pi / 2.0 - math.atan(2.0 * found.crossover) - math.atan(lag * found.crossover)
    assert found.phase == pytest.approx(math.pi + angle)
    assert found.delay == pytest.approx(found.phase / found.crossover)
    assert found.saturation == pytest.approx(0.2 / (proportional * found.crossover))
    finer = [0.01 * 1.01**step for step in range(1000)]
    worst = max(1.0 / abs(1.0 + loop(model, lag, 0.0, gains, omega)) for omega in finer)
    assert found.sensitivity == pytest.approx(worst, rel=0.01)
    assert margins(model, lag, 0.0, math.inf, gains).saturation == math.inf


def test_a_loop_that_hardly_steers_has_nothing_to_lose() -> None:
    found = margins(Norrbin(0.4, 2.0), 0.3, 0.1, 0.2, LoopGains(1e-6, 0.0, 0.0))
    assert (found.crossover, found.phase, found.delay, found.saturation) == (0.0, math.pi, math.inf, math.inf)
    assert found.gain > 1e3


@pytest.mark.parametrize(("share", "is_refused"), [(0.99, True), (1.01, False), (10.0, False)])
def test_a_rudder_that_saturates_within_a_tenth_of_a_degree_is_refused(share: float, is_refused: bool) -> None:
    model, gear = BOATS[1]
    gains = linear_gains_backstepping(model, design_backstepping(model, gear, gear.rate_max, 0.05))
    at_one = math.degrees(margins(model, gear.lag, gear.delay + 0.05, 1.0, gains).saturation)
    said = judge(model, gear, 0.1 * share / at_one, 0.05, gains)
    assert math.degrees(said.margins.saturation) == pytest.approx(0.1 * share)
    assert bool(said.refusal) is is_refused
    if is_refused:
        assert "0.20 s lag and 0.15 s delay" in said.refusal and "heading error of 0.099 deg" in said.refusal


def test_the_worst_of_the_boats_within_the_spread_is_judged() -> None:
    model, gear = BOATS[1]
    gains = linear_gains_backstepping(model, design_backstepping(model, gear, gear.rate_max, 0.05))
    spread = Spread(0.3, 0.4)
    each = [
        margins(model._replace(gain=0.2 * a, time_constant=5.0 * b), gear.lag, gear.delay + 0.05, gear.rate_max, gains)
        for a in (0.7, 1.0, 1.3)
        for b in (0.6, 1.0, 1.4)
    ]
    found = worst_margins(model, gear, gear.rate_max, 0.05, gains, spread)
    assert found == pytest.approx(max(each, key=lambda one: one.sensitivity))
    unstable = worst_margins(model, gear, gear.rate_max, 0.05, LoopGains(*(9.0 * gain for gain in gains)), spread)
    assert not unstable.stable
    none = worst_margins(model, gear, gear.rate_max, 0.05, gains, Spread(0.0, 0.0))
    assert none == pytest.approx(each[4])


@pytest.mark.parametrize("level", [-1, 0, 10, 11])
def test_there_are_nine_response_levels(level: int) -> None:
    model, gear = BOATS[0]
    with pytest.raises(ValueError, match=f"response level {level}: allowed is 1"):
        design_backstepping(model, gear, gear.rate_max, 0.0, level)


CURVES = [
    (Norrbin(0.4, 2.0), 0.3, 0.1, LoopGains(1.5, 0.0, 2.0)),
    (Norrbin(0.4, 2.0), 0.3, 0.1, LoopGains(1.5, 0.2, 2.0, 0.4)),
    (Norrbin(0.7, 0.3, 3.0), 0.1, 0.05, LoopGains(20.0, 0.0, 0.5)),
    (Norrbin(0.2, 5.0, 20.0, n1=-1.0), 0.2, 0.1, LoopGains(4.0, 0.0, 14.0)),
    (Norrbin(0.2, 5.0, 20.0, n1=-1.0), 0.2, 0.1, LoopGains(4.0, 0.3, 14.0, 0.1)),
    (Norrbin(0.2, 5.0, n1=3.0), 0.0, 0.0, LoopGains(0.5, 0.0, -3.0)),
    (Norrbin(0.1, 20.0), 0.3, 2.0, LoopGains(9.0, 0.0, 90.0)),
]


@pytest.mark.parametrize(("model", "lag", "delay", "gains"), CURVES)
def test_the_margins_are_those_of_the_curve_at_four_hundred_frequencies(
    model: Norrbin, lag: float, delay: float, gains: LoopGains
) -> None:
    """400 frequencies from a thousandth of the slowest of the loop's own to a thousand times the quickest."""
    drive, own = model.gain / model.time_constant, 1.0 / model.time_constant
    quick = max(own, math.sqrt(drive * gains.proportional), drive * abs(gains.derivative))
    w = np.geomspace(1e-3 * min(own, quick), 1e3 * quick, 400)
    s = 1j * w
    asked = (gains.proportional + gains.integral / s + gains.derivative * s) / (1.0 + gains.smoothing * s)
    curve = asked * model.gain / (s * (model.time_constant * s + model.n1)) * np.exp(-s * delay) / (lag * s + 1.0)
    found = margins(model, lag, delay, 0.2, gains)
    assert found.sensitivity == pytest.approx(np.max(1.0 / np.abs(1.0 + curve)))
    at = int(np.max(np.nonzero((np.abs(curve[:-1]) >= 1.0) & (np.abs(curve[1:]) < 1.0))))
    assert found.crossover == pytest.approx(w[at])
    phase = math.remainder(float(np.angle(curve[at])) - math.pi, 2.0 * math.pi)
    assert (found.phase, found.delay) == pytest.approx((phase, phase / w[at]))
    assert found.saturation == pytest.approx(0.2 / (abs(asked[at]) * w[at]))
    crosses = (curve.real[:-1] < 0.0) & (curve.real[1:] < 0.0) & (curve.imag[:-1] < 0.0) & (curve.imag[1:] >= 0.0)
    sizes = [size for size in np.abs(curve[1:][crosses]) if size < 1.0]
    assert found.gain == pytest.approx(1.0 / max(sizes) if sizes else math.inf)
    turned = float(np.sum(np.angle((1.0 + curve[1:]) / (1.0 + curve[:-1]))))
    poles = 0.5 * (1 + (gains.integral > 0.0)) + (model.n1 < 0.0)
    assert found.stable is (abs(turned - math.pi * poles) < 0.5)


@pytest.mark.parametrize("level", range(1, 10))
@pytest.mark.parametrize(("binds", "quickest"), [("sensitivity", 0.4), ("saturation", 0.5), ("stability", 0.3)])
def test_what_each_level_may_take_of_the_margins(
    monkeypatch: pytest.MonkeyPatch, level: int, binds: str, quickest: float
) -> None:
    """Of a loop of k [1/s] with Ms = 1 + 1.5 k, which saturates at an error of 0.5 deg/k, or falls over at 0.3/s: 121
    values from a thousandth of the boat's own pace to a hundred times it."""
    model, gear = BOATS[1]

    def margins_of(of: Norrbin, lag: float, delay: float, rate_max: float, gains: LoopGains) -> Margins:
        assert (of, lag, delay, rate_max) == (model, 0.2, pytest.approx(0.15), 0.08)
        k = math.sqrt(gains.proportional / 1.25 * of.gain / of.time_constant)
        sensitivity = 1.0 + 1.5 * k if binds == "sensitivity" else 1.0
        saturation = math.radians(0.5 / k) if binds == "saturation" else math.inf
        return Margins(9.0, 1.0, 1.0, sensitivity, 1.0, binds != "stability" or k < 0.3, saturation)

    monkeypatch.setattr("autopilot.control.design.margins", margins_of)
    up = level - 5
    most = {"sensitivity": (0.6 + 0.1 * up) / 1.5, "saturation": 0.5 * 2.0 ** (0.5 * up), "stability": 0.3}[binds]
    grid = np.geomspace(1e-3 / 5.0, 1e2 / 5.0, 121)
    middle = grid[grid <= quickest * (1.0 + 1e-9)][-1]
    wanted = middle * 2.0 ** (up / 3.0)
    if up > 0:
        wanted = min(wanted, grid[grid <= most * (1.0 + 1e-9)][-1])
    gains = design_backstepping(model, gear, 0.08, 0.05, level)
    assert 2.0 * math.sqrt(gains.gamma) == pytest.approx(wanted)


def test_pid_and_sliding_gains_of_the_same_loop() -> None:
    """p = (T/K)(gamma + k1 k2), d = (T/K)(k1 + k2 - n1/T), never negative; i = p/time. A large error asks the sliding
    law for the whole rudder, (K/T) delta_max."""
    model, gains = Norrbin(0.4, 2.0, n1=0.5), BacksteppingGains(0.3, 0.7, 0.2)
    pid = equivalent_pid(model, gains, 8.0)
    assert tuple(pid)[:3] == pytest.approx((5.0 * 0.41, 5.0 * 0.41 / 8.0, 5.0 * 0.75))
    assert equivalent_pid(model, gains).ki == 0.0
    assert equivalent_pid(model._replace(n1=9.0), gains).kd == 0.0
    sliding = sliding_of(model, gains, 0.5)
    assert sliding == pytest.approx((0.3, 0.1, 0.1 / 0.7))
    assert linear_gains_sliding(model, sliding) == pytest.approx((5.0 * 0.21, 0.0, 5.0 * 0.75, 0.0, 0.0))


@given(st.floats(0.05, 0.6), st.sampled_from([-1.0, 0.0, 1.0]), st.floats(0.1, 50.0))
def test_gains_that_reckon_ahead_are_the_steps_own(ahead: float, n1: float, time_constant: float) -> None:
    """By small deviations of what the law's step is given."""
    model = Norrbin(0.4, time_constant, 0.0, n1=n1, reference_speed=5.0)
    law = backstepping.BoundedGains(lqr_gains(model, 0.5), math.inf, ahead)
    smoothing = law.gains.smoothing

    def order(psi: float, r: float, bias: float, rudder: float, last: float) -> float:
        state = NavState(0.0, psi, r, 5.0, rudder, bias, 0.0, True)
        given_ = LawInput(model, 1.0, Reference(0.0), state, NO_ROLL, last, math.inf, 0.0)
        acted = backstepping.when_acted_on(law.ahead, given_)
        return backstepping.backstepping_rudder(law, acted, 0.0)

    small = 1.0e-6
    found = ahead_gains(model, backstepping.linear_gains_backstepping(model, law.gains)._replace(ahead=ahead))
    by_step = [order(*(small if place == row else 0.0 for place in range(5))) / small for row in range(5)]
    wanted = (-found.heading, -found.rate, -1.0 - found.bias, -found.rudder, -found.order)
    assert by_step == pytest.approx(wanted, rel=1e-4, abs=1e-6)
    assert smoothing > 0.0


@pytest.mark.parametrize("name", TEST_BOATS)
def test_every_level_holds_every_boat_within_the_uncertainty_in_a_moderate_sea(name: str) -> None:
    """Within 3 deg rms. A loop that holds neither boat holds the worst as well as the model, and is no robust one."""
    for row in front_of(vessel_of(TEST_BOATS[name])):
        assert math.degrees(row.worst.heading) < 3.0, f"level {row.level}"


def behind_a_compass(name: str) -> Vessel:
    vessel = load_vessel(name)
    return replace(vessel, sensors=replace(vessel.sensors, gyro=False))


@pytest.mark.parametrize("name", ["esso_osaka", "mmg_tanker", "lanxin"])
def test_no_level_behind_a_compass_alone_was_designed_for_a_gyro(name: str) -> None:
    """With gains for a gyro that is not there the loop of an Esso Osaka within its uncertainty is unstable."""
    for row in front_of(behind_a_compass(name)):
        assert row.worst.heading <= SLOW_WORST * row.sea.heading, f"level {row.level}"


@pytest.mark.parametrize("name", ["lanxin", "small_craft"])
def test_behind_a_compass_alone_the_levels_end_where_a_calm_shows_nothing_for_more_rudder(name: str) -> None:
    vessel = behind_a_compass(name)
    levels, rows = bandwidths_of(vessel), front_of(vessel)
    assert levels.noise < levels.quickest
    assert rows[-1].bandwidth == rows[-2].bandwidth == levels.noise
    # a level more would be no nearer to the course, and the rudder would work harder for it
    boats, afloat = (AS_MODELLED, *offs_of(vessel)), afloat_of(vessel)
    gains = [lqr_gains(afloat.model, each) for each in (levels.noise, levels.noise * 2.0**0.25)]
    calm = [[cost(afloat, each, CALM, boat) for boat in boats] for each in gains]
    rms = [float(np.sqrt(np.mean([one.heading**2 for one in each]))) for each in calm]
    assert rms[1] > rms[0]
    assert all(after.travel > 1.3 * before.travel for before, after in zip(*calm, strict=True))


def test_thrusters_wear_nothing_and_hold_as_quickly_as_they_may() -> None:
    """The middle level spares no gear; every level keeps the margins that a verdict asks for, but those above it."""
    vessel = load_vessel("blueboat")
    levels, rows = bandwidths_of(vessel), front_of(vessel)
    middle = rows[4].bandwidth
    assert bears_speeds(vessel, middle) and not bears_speeds(vessel, 1.2 * middle)
    assert bandwidth_of(5, levels) < middle
    assert rows[0].bandwidth < middle < rows[-1].bandwidth
    geared = replace(vessel, drive=replace(vessel.drive, kind="outboard"))
    assert front_of(geared)[4].bandwidth == pytest.approx(bandwidth_of(5, bandwidths_of(geared)))


@pytest.mark.parametrize("name", ["lanxin", "esso_osaka"])
def test_a_gyro_lets_every_level_be_had(name: str) -> None:
    levels = bandwidths_of(load_vessel(name))
    assert levels.noise == levels.quickest
