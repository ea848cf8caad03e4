"""The front of heading error against rudder travel: what a loop costs in a sea, worked out in milliseconds.

Boat, steering gear, path to the servo, the heading filter with its waves, and the law make one linear system about
straight running, sampled as the pilot is:

    z(k+1) = A z(k) + noise,   X = A X A' + Q,   heading rms = sqrt(X_psi),   travel = sqrt(2/pi) rms(u(k) - u(k-1))/dt,

the mean of |u'| where u' is Gaussian. Law and filter are not written down again: the law's part of A is what its own
step makes of a small deviation, the filter's gain the solution of its Riccati equation with its own transition and
noise. The Lyapunov equation also says which boats the loop does not hold: those where A has an eigenvalue outside the
unit circle.

A design is one number, the regulator's bandwidth w (`design`). The quickest one that may be had leaves

- to the rudder's rate an error of LEAST_ERROR, which asks for u' = w^3 T/K times it at first, and RATE_SIGMAS times the
  rms of what it is asked for in the usual sea,
- to every boat within the uncertainty a heading rms of at most WORST times the model's, and to the worst of them at
  most WORST times the least that any loop leaves it; where none does both, that least. The first alone would be met by
  a loop that holds neither boat.

The levels of response are a ladder down from there, half as quick every four levels, and end where the worst boat
within the uncertainty has SLOW_WORST times the model's heading rms: a course-unstable boat needs a loop that is much
quicker than the boat, and a slow one loses it. At the other end the noise of the instruments ends it: a level that in
a calm holds the boats within the uncertainty no nearer to their course than the next calmer one is that one, however
much more the rudder would work.

Source: covariance of a closed loop, Astrom and Wittenmark 1997, section 11.4; mean of |x|, Papoulis 1991, ch. 5.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov

from autopilot.control import backstepping
from autopilot.control.backstepping import BacksteppingGains, BoundedGains, lqr_gains
from autopilot.control.design import LEAST_ERROR, MIDDLE_LEVEL, bandwidths_of
from autopilot.control.law import NO_ROLL, LawInput
from autopilot.control.margins import RUDDER_IN_USE, linear_of, prediction
from autopilot.estimation.disturbance import FilterNoise, in_balance
from autopilot.estimation.disturbance import Sea as Wavy
from autopilot.estimation.heading_ekf import wave_step
from autopilot.estimation.tuning import WAVE_FREQUENCY_LEAST, WAVE_FREQUENCY_MOST, WAVE_STIFFENING, WAVE_VARIANCE_LEAST
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import NavState, Reference

Floats = npt.NDArray[np.float64]

LEVELS = range(1, 10)
HALF_AS_QUICK = 4.0
"""So many levels down."""
WORST = 1.5
"""The heading rms of the worst boat within the uncertainty, times the model's, that a design may leave."""
SLOW_WORST = 2.0
"""The same of a loop that is slower than it might be: a boat twice as far off is not steered as it was designed."""
RATE_SIGMAS = 2.5
"""The rudder's rate is so many times its rms in the usual sea at least: a hundredth of the time it is asked for more.
A loop that asks for more often is another than was designed: a course-unstable boat swings by 30 deg in it."""
LAG_LEAST = 1.0e-3
GRID = 25
PROBE = 1.0e-5
TRAVEL = math.sqrt(2.0 / math.pi)


class Sea(NamedTuple):
    """What pushes the boat, as rudder angles: waves [rad rms] of a frequency [rad/s] and damping [-], and gusts
    [rad rms] of a correlation time [s]."""

    waves: float
    frequency: float
    damping: float
    gusts: float
    gust_time: float


STILL = Sea(0.0, 1.0, 0.3, 0.0, 10.0)
USUAL = Sea(math.radians(1.0), 0.8, 0.3, math.radians(0.5), 10.0)
"""A moderate sea, where none was recorded."""
CALM = Sea(0.0, 1.0, 0.3, math.radians(0.1), 60.0)
"""A breath of wind that comes and goes in a minute: without any push, no rudder at all holds best. With half the breath
a compass of 0.3 deg ends the ladders of two boats at 0.4 and 1.1 rad/s in place of 1.2 and 1.7, with twice the breath
nowhere."""


class Afloat(NamedTuple):
    """The boat as the pilot has it, and what else is known: gear, what the order takes to the servo beyond the gear's
    own delay [s], the time between two ticks [s], the filter's noise."""

    model: Norrbin
    gear: SteeringGear
    path: float
    dt: float
    noise: FilterNoise


class Cost(NamedTuple):
    """Heading rms [rad] and rudder travel [rad/s]; inf: not stable."""

    heading: float
    travel: float


LOST = Cost(math.inf, math.inf)


class Off(NamedTuple):
    """How a real boat may be off its model: factors of K and T, and more delay [s]."""

    gain: float = 1.0
    time_constant: float = 1.0
    delay: float = 0.0


AS_MODELLED = Off()


class _Filter(NamedTuple):
    """The heading filter at rest in a sea: transition, drive of the mean rudder, and gain on (heading, rate), of
    (psi, r, b, h, s, e); w0 [rad/s]: the frequency that it takes the waves for."""

    transition: Floats
    drive: Floats
    gain: Floats
    frequency: float


class _Steered(NamedTuple):
    """z' = a z + noise of the covariance `driven`; the order moves by `moved` z and noise of the variance `kicked`."""

    a: Floats
    driven: Floats
    moved: Floats
    kicked: float


def cost(afloat: Afloat, gains: BacksteppingGains, sea: Sea, off: Off = AS_MODELLED) -> Cost:
    """Return what these gains cost in a sea; `off`: on a boat that is so far from the model."""
    steered = _steered(afloat, gains, sea, off)
    if float(np.abs(np.linalg.eigvals(steered.a)).max()) >= 1.0 - 1.0e-7:
        return LOST
    spread = solve_discrete_lyapunov(steered.a, steered.driven)
    moved = float(steered.moved @ spread @ steered.moved) + steered.kicked
    return Cost(math.sqrt(max(float(spread[0, 0]), 0.0)), TRAVEL * math.sqrt(max(moved, 0.0)) / afloat.dt)


PSI, RATE, RUDDER, RECKONED, FIRST = 0, 1, 2, 6, 7
"""Places in z: heading, rate, rudder, two of the waves and the gusts; the rudder that the pilot reckons with; from
FIRST on the orders of the ticks before, the newest first, and then the filter's prediction."""


def _steered(afloat: Afloat, gains: BacksteppingGains, sea: Sea, off: Off) -> _Steered:
    model, gear, dt = linear_of(afloat.model), afloat.gear, afloat.dt
    transition, held, noise = _boat(model, gear.lag, dt, sea, off)
    known, real = round(gear.delay / dt), round((gear.delay + afloat.path + off.delay) / dt)
    kept = max(known, real, 1)
    size, hat = FIRST + kept + 6, FIRST + kept
    filtered = _filter(model, afloat.noise, dt, sea)
    law = _law(afloat, gains, filtered.frequency)
    seen = np.zeros((2, size))
    seen[0, PSI] = seen[1, RATE] = 1.0
    shows = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0, 0.0]])
    state = filtered.gain @ seen
    state[:, hat:] += np.eye(6) - filtered.gain @ shows
    order = law[:6] @ state
    order[RECKONED] += law[6]
    order[FIRST] += law[7]
    kick = law[:6] @ filtered.gain
    # everything but this tick's order, and what that adds
    a, by_order = np.zeros((size, size)), np.zeros(size)
    a[:6, :6] = transition
    keep = math.exp(-dt / max(gear.lag, LAG_LEAST))
    a[RECKONED, RECKONED] = keep
    for late, rows, share in (
        (real, slice(0, 6), held),
        (known, slice(RECKONED, RECKONED + 1), np.array([1.0 - keep])),
    ):
        if late:
            a[rows, FIRST + late - 1] += share
        else:
            by_order[rows] += share
    by_order[FIRST] = 1.0
    for place in range(1, kept):
        a[FIRST + place, FIRST + place - 1] = 1.0
    a[hat:] += filtered.transition @ state
    a[hat:, RECKONED] += 0.5 * filtered.drive
    a[hat:] += np.outer(0.5 * filtered.drive, a[RECKONED])
    by_order[hat:] += 0.5 * filtered.drive * by_order[RECKONED]
    kicks = np.outer(by_order, kick)
    kicks[hat:] += filtered.transition @ filtered.gain
    read = np.diag([afloat.noise.heading, afloat.noise.rate])
    driven = kicks @ read @ kicks.T
    driven[:6, :6] += noise
    moved = order.copy()
    moved[FIRST] -= 1.0
    return _Steered(a + np.outer(by_order, order), driven, moved, float(kick @ read @ kick))


def _boat(model: Norrbin, lag: float, dt: float, sea: Sea, off: Off) -> tuple[Floats, Floats, Floats]:
    """Return transition, effect of a held order and noise over `dt` [s] of psi, r, rudder, two of the waves, gusts."""
    time, lag = model.time_constant * off.time_constant, max(lag, LAG_LEAST)
    drive, w = model.gain * off.gain / time, sea.frequency
    a, noise = np.zeros((6, 6)), np.zeros((6, 6))
    a[PSI, RATE], a[RATE, RATE], a[RUDDER, RUDDER] = 1.0, -model.n1 / time, -1.0 / lag
    a[RATE, RUDDER] = drive
    # what pushes does not change with what the boat makes of it
    a[RATE, 4] = a[RATE, 5] = model.gain / model.time_constant
    a[3, 4], a[4, 3], a[4, 4] = w, -w, -2.0 * sea.damping * w
    noise[4, 4] = 4.0 * sea.damping * w * sea.waves * sea.waves
    a[5, 5] = -1.0 / sea.gust_time
    noise[5, 5] = 2.0 / sea.gust_time * sea.gusts * sea.gusts
    held = np.zeros((6, 1))
    held[RUDDER] = 1.0 / lag
    moved = expm(dt * np.block([[a, held], [np.zeros((1, 7))]]))
    # van Loan 1978
    both = expm(dt * np.block([[-a, noise], [np.zeros((6, 6)), a.T]]))
    driven = both[6:, 6:].T @ both[:6, 6:]
    return moved[:6, :6], moved[:6, 6], 0.5 * (driven + driven.T)


def _filter(model: Norrbin, noise: FilterNoise, dt: float, sea: Sea) -> _Filter:
    """Return the filter that has learnt the sea: how much the waves move the heading, and how quickly wind changes."""
    drive, n = model.gain / model.time_constant, model.n1 / model.time_constant
    w0 = min(max(sea.frequency, WAVE_FREQUENCY_LEAST), WAVE_FREQUENCY_MOST)
    size = (drive * sea.waves) ** 2 / (w0 * w0 * (w0 * w0 + n * n))
    size = max(size, WAVE_VARIANCE_LEAST) if noise.waves else 0.0
    transition, driven = np.zeros((6, 6)), np.zeros((6, 6))
    boat, by_rudder = prediction(model, dt)
    transition[:3, :3] = boat
    steered = noise.model_error * drive * RUDDER_IN_USE
    q = (noise.acceleration + steered * steered) * dt
    changes = min(max(2.0 * sea.gusts * sea.gusts / sea.gust_time, noise.bias), max(noise.gusty_bias, noise.bias))
    driven[:3, :3] = [
        [q * dt * dt / 3.0, 0.5 * q * dt, 0.0],
        [0.5 * q * dt, q, 0.0],
        [0.0, 0.0, (changes if noise.waves else noise.bias) * dt],
    ]
    waves = np.array(wave_step(w0, dt)).reshape(3, 3)
    v33, v44, v45, v55 = in_balance(Wavy(size, WAVE_STIFFENING * w0 * w0 * size), w0)
    balance = np.array([[v33, 0.0, 0.0], [0.0, v44, v45], [0.0, v45, v55]])
    transition[3:, 3:] = waves
    driven[3:, 3:] = balance - waves @ balance @ waves.T
    shows = np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0, 0.0]])
    read = np.diag([noise.heading, noise.rate])
    # a little of everything, so that the equation has a solution in a calm
    driven = 0.5 * (driven + driven.T) + 1.0e-16 * np.eye(6)
    before = solve_discrete_are(transition.T, shows.T, driven, read)
    gain = before @ shows.T @ np.linalg.inv(shows @ before @ shows.T + read)
    return _Filter(transition, np.array([*by_rudder, 0.0, 0.0, 0.0]), gain, w0)


def _law(afloat: Afloat, gains: BacksteppingGains, frequency: float) -> Floats:
    """Return what the law's order is by psi, r, b, h, s, e, the rudder that is reckoned with, and the last order."""
    model = linear_of(afloat.model)
    bounded = BoundedGains(gains, math.inf, afloat.gear.delay + afloat.gear.lag)
    waves = frequency if afloat.noise.waves else 0.0

    def order(probed: Floats) -> float:
        psi, r, b, h, s, rudder, last = probed.tolist()
        state = NavState(0.0, psi + h, r + s, model.reference_speed, rudder, b, 0.0, True, h, s, 1.0, waves)
        given = LawInput(model, 1.0, Reference(0.0), state, NO_ROLL, last, math.inf, afloat.dt)
        return backstepping.in_proportion(bounded, given) / PROBE

    rows = np.eye(7) * PROBE
    psi, r, b, h, s, rudder, last = (order(row) for row in rows)
    return np.array([psi, r, b, h, s, 0.0, rudder, last])


def boats_off(gain: float, time_constant: float, delay: float) -> tuple[Off, ...]:
    """Return the boats that a design must hold: K and T off by these shares to either side, and so much more delay
    [s]."""
    factors = (
        (1.0 - gain, 1.0),
        (1.0 + gain, 1.0),
        (1.0 + gain, 1.0 - time_constant),
        (1.0 - gain, 1.0 + time_constant),
    )
    return (*(Off(k, t) for k, t in factors), Off(1.0, 1.0, delay), Off(1.0 + gain, 1.0 - time_constant, delay))


def worst(afloat: Afloat, gains: BacksteppingGains, sea: Sea, offs: tuple[Off, ...]) -> Cost:
    """Return the costs of the worst of these boats, heading and travel each by itself."""
    found = [cost(afloat, gains, sea, off) for off in offs]
    return Cost(max(one.heading for one in found), max(one.travel for one in found))


class Bandwidths(NamedTuple):
    """The slowest and the quickest regulator [rad/s] that may be had, and the one beyond which only noise is answered
    with more rudder."""

    slowest: float
    quickest: float
    noise: float


@lru_cache(maxsize=32)
def bandwidths(afloat: Afloat, rate_max: float, offs: tuple[Off, ...]) -> Bandwidths:
    """Return the bandwidths that may be had, see the module's docstring. ValueError where there is none."""
    model = afloat.model
    low, high = bandwidths_of(model)
    least_error = LEAST_ERROR * math.exp2(-0.5 * (LEVELS[-1] - MIDDLE_LEVEL))
    if math.isfinite(rate_max):
        high = min(high, math.cbrt(rate_max * model.gain / (model.time_constant * least_error)))
    low = max(1.0e-2 * high, min(low, high))
    tried: list[tuple[float, float, tuple[int, float]]] = []
    for bandwidth in map(float, np.geomspace(high, low, GRID)):
        gains = lqr_gains(model, bandwidth)
        nominal, travel = cost(afloat, gains, USUAL)
        if math.isinf(nominal) or travel > TRAVEL * rate_max / RATE_SIGMAS:
            continue
        found = [cost(afloat, gains, USUAL, off).heading for off in offs]
        held = [heading for heading in found if math.isfinite(heading)]
        tried.append((bandwidth, max(found) / nominal, (len(found) - len(held), max(held, default=math.inf))))
    if not tried:
        raise ValueError("design: no gain gives a stable loop: the steering gear is too slow for this boat")
    best = min(range(len(tried)), key=lambda index: tried[index][2])
    lost, least = tried[best][2]
    alike = (
        index
        for index, (_, times, (more, rms)) in enumerate(tried)
        if times <= WORST and more == lost and rms <= WORST * least
    )
    first = next(alike, best)
    last = first
    while last + 1 < len(tried) and tried[last + 1][1] <= SLOW_WORST:
        last += 1
    quickest, slowest = tried[first][0], tried[last][0]
    noise = _by_noise(afloat, (AS_MODELLED, *offs), slowest, quickest)
    return Bandwidths(0.0 if last + 1 == len(tried) else slowest, quickest, noise)


def _by_noise(afloat: Afloat, boats: tuple[Off, ...], slowest: float, quickest: float) -> float:
    """Return the bandwidth [rad/s] of the quickest level that in a calm holds these boats nearer to their course than
    the level below it, by the rms over all of them."""

    def off_course(bandwidth: float) -> float:
        gains = lqr_gains(afloat.model, bandwidth)
        return math.fsum(cost(afloat, gains, CALM, boat).heading ** 2 for boat in boats)

    found, here = quickest, off_course(quickest)
    for level in reversed(LEVELS[:-1]):
        slower = max(quickest * math.exp2((level - LEVELS[-1]) / HALF_AS_QUICK), slowest)
        there = off_course(slower)
        if not there < here:
            break
        found, here = slower, there
    return found


def bandwidth_of(level: int, of: Bandwidths) -> float:
    """Return the bandwidth [rad/s] of a response level. ValueError for another level."""
    if level not in LEVELS:
        raise ValueError(f"response level {level}: allowed is {LEVELS[0]} (calm) to {LEVELS[-1]} (quick)")
    return max(min(of.quickest * math.exp2((level - LEVELS[-1]) / HALF_AS_QUICK), of.noise), of.slowest)
