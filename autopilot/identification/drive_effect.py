"""The model of a boat that steers by thrust, and how it goes with speed and throttle, from runs at several of them.

The equation is that of `autopilot.models.drives`,

    r' = s^p t^q (beta delta + e) - (a + c (s - 1)) r - d r^3 + gusts + noise,     s = U/U0,   t = n/n0,

with K = beta/|a|, T = 1/|a|, n1 the sign of a, n3 = d/|a|, w = c/a. First all runs are simulated at once from their
rudder, speed and throttle, and the rates' differences from the measured ones are made least (output error). A helm that
answers its compass answers the gusts with it: rudder and gusts go together, and output error, which knows none, takes
for the rudder's doing what gusts did. So it is where the search for the boat begins that the runs make likely
(`likelihood_fit`), gusts, waves and noise being states and sizes to be found. Where that finds none output error
stands, with the standard errors of residuals that remember.

Where the throttle is recorded thrust that is turned has q fitted with p = 0. All else has p fitted with q = 0: in a
steady run the speed follows the throttle, and the two cannot be parted. What the runs cannot tell stays as it is
usual for the drive, and is said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.identification.identify import LEAST_EXPLAINED, check_excitation, check_response, starting_point
from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.likelihood_fit import LikelihoodFit, largest_rate, likelihood_fit
from autopilot.identification.likelihood_model import SURELY_TURNS, ordered
from autopilot.identification.likelihood_record import Form, Surroundings
from autopilot.identification.likelihood_search import SWAY
from autopilot.identification.marginal_likelihood import Rates
from autopilot.identification.residuals import robust_covariance
from autopilot.identification.rudder_path import DIRECT, means_behind, with_corners
from autopilot.identification.runs import FloatArray, Run, Segment, mean_speed, seconds
from autopilot.models.drives import THROTTLE_FLOOR, DriveLaw, Needs, effect_of
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin

SPACING_S = 0.1
"""The runs are looked at so often: a boat whose T is shorter than twice this is too quick for this fit."""
LEAST_SPAN = 1.3
"""Speeds or throttles this far apart tell how the boat goes with them; closer ones do not."""
RATE_MOST = 20.0
"""[rad/s]: a simulation that turns faster has run away."""
NAMES = ("strength", "exponent", "damping", "damping_slope", "cubic", "push")
"""beta [1/s^2], p or q, a [1/s], c [1/s], d [s/rad^2], e [rad/s^2]."""


class Prediction(NamedTuple):
    """How well a run's yaw rate is predicted from rudder, speed and throttle: R2, None where the rate stands
    still, and rms of what is left [rad/s]."""

    r2: float | None
    rms: float


class DriveFit(NamedTuple):
    """model: at the reference speed. law: how it goes with speed and throttle. errors: standard errors by the names of
    NAMES, of what was fitted, and of gain, time_constant and damping_share. sentences: what is to be said of it."""

    model: Norrbin
    law: DriveLaw
    errors: dict[str, float]
    sentences: tuple[str, ...]


class _Stack(NamedTuple):
    """All segments side by side, shape (N, S), nan behind the end of the shorter ones: mean and rise of the rudder
    [rad] until the next sample, speed and throttle over those of reference, measured rate [rad/s]."""

    rudder: FloatArray
    rise: FloatArray
    speed: FloatArray
    throttle: FloatArray
    rate: FloatArray


def _rate_of(part: Segment, at: FloatArray) -> FloatArray:
    """Return the yaw rate [rad/s] at times: the measured one, or the slope of the heading over two spacings."""
    known = np.isfinite(part.rate)
    if np.count_nonzero(known) > 0.5 * part.time.size:
        return np.asarray(np.interp(at, part.time[known], part.rate[known]))
    known = np.isfinite(part.heading)
    heading = np.interp(at, part.time[known], part.heading[known])
    return np.asarray(np.gradient(heading, at))


def _steered(part: Segment, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and rise of the rudder [rad] until the next of the times: a rudder that goes over within a step turns
    the boat by its mean, not by where it is at both ends."""
    mean, rise, _ = means_behind(DIRECT, *with_corners(part.time, part.rudder), at)
    return np.append(mean, part.rudder[-1]), np.append(rise, 0.0)


def _stacked(runs: Sequence[Run], speed: float, throttle: float) -> _Stack:
    columns: list[tuple[FloatArray, ...]] = []
    for run in runs:
        for part in run.segments:
            at = np.arange(part.time[0], part.time[-1], SPACING_S)
            ratio = np.maximum(np.abs(np.interp(at, part.time, part.speed)) / speed, SPEED_FLOOR_RATIO)
            share = max(abs(run.throttle), THROTTLE_FLOOR) / throttle if math.isfinite(throttle) else 1.0
            columns.append((*_steered(part, at), ratio, np.full(at.size, share), _rate_of(part, at)))
    longest = max(each[0].size for each in columns)

    def wide(place: int) -> FloatArray:
        return np.stack(
            [np.append(each[place], np.full(longest - each[place].size, np.nan)) for each in columns], axis=1
        )

    return _Stack(*(wide(place) for place in range(5)))


@np.errstate(over="ignore", invalid="ignore")
def _simulated(stack: _Stack, values: FloatArray, start: FloatArray, *, by_throttle: bool) -> FloatArray:
    """Return the rates [rad/s], shape (N, S), by the classical Runge-Kutta method, the input in straight lines."""
    strength, exponent, damping, slope, cubic, push = values
    over = stack.throttle if by_throttle else stack.speed
    effect = over**exponent
    drive, half = effect * (strength * stack.rudder + push), 0.5 * strength * effect * stack.rise
    damped = damping + slope * (stack.speed - 1.0)
    rates = np.empty_like(stack.rate)
    rate = rates[0] = start
    dt = SPACING_S
    for step in range(stack.rate.shape[0] - 1):
        u, more, a0, a2 = drive[step], half[step], damped[step], damped[step + 1]
        a1 = 0.5 * (a0 + a2)
        k1 = u - more - (a0 + cubic * rate * rate) * rate
        r = rate + 0.5 * dt * k1
        k2 = u - (a1 + cubic * r * r) * r
        r = rate + 0.5 * dt * k2
        k3 = u - (a1 + cubic * r * r) * r
        r = rate + dt * k3
        k4 = u + more - (a2 + cubic * r * r) * r
        # into what is no number, too
        rate = np.fmax(np.fmin(rate + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), RATE_MOST), -RATE_MOST)
        rates[step + 1] = rate
    return rates


def _begin(stack: _Stack, exponent: float, *, by_throttle: bool) -> FloatArray:
    """Return where the fit begins: the equation's least squares on the slope of the measured rates over a second."""
    width = max(round(0.5 / SPACING_S), 1)
    rate = stack.rate[width:-width]
    slope = (stack.rate[2 * width :] - stack.rate[: -2 * width]) / (2.0 * width * SPACING_S)
    over = (stack.throttle if by_throttle else stack.speed)[width:-width]
    rudder = stack.rudder[width:-width] * over**exponent
    known = np.isfinite(slope) & np.isfinite(rudder)
    columns = np.stack([rudder[known], -rate[known], -(rate[known] ** 3), np.ones(np.count_nonzero(known))], axis=1)
    beta, damping, cubic, push = np.linalg.lstsq(columns, slope[known], rcond=None)[0]
    return np.array([max(beta, 1.0e-4), exponent, max(damping, 0.01), 0.0, max(cubic, 0.0), push])


def fit_drive(runs: Sequence[Run], usual: DriveLaw, needs: Needs) -> DriveFit:
    """Return the model of the runs and how it goes with speed and throttle.

    Raises InputError where nothing steers, the boat makes no way, or the motion does not follow what steers, or follows
    it backwards.
    """
    total = sum(seconds(run) for run in runs)
    speeds = [mean_speed([run]) for run in runs]
    reference = sum(speed * seconds(run) for speed, run in zip(speeds, runs, strict=True)) / total
    check_excitation(runs, reference)
    throttles = [abs(run.throttle) for run in runs]
    throttle = sum(each * seconds(run) for each, run in zip(throttles, runs, strict=True)) / total
    by_throttle = needs is Needs.THRUST and throttle > 0.0
    span = _span(throttles) if by_throttle else _span(speeds)
    exponent = usual.throttle_exponent if needs is Needs.THRUST else usual.speed_exponent
    stack = _stacked(runs, reference, throttle if throttle > 0.0 else math.nan)
    values = _begin(stack, exponent, by_throttle=by_throttle)
    free = [0, 2, 4, 5]
    if span >= LEAST_SPAN:
        free.append(1)
    if _span(speeds) >= LEAST_SPAN:
        free.append(3)
    free.sort()
    known = np.isfinite(stack.rate) & np.isfinite(stack.rudder)

    def residuals(theta: FloatArray) -> FloatArray:
        tried = values.copy()
        tried[free] = theta[: len(free)]
        left = _simulated(stack, tried, theta[len(free) :], by_throttle=by_throttle) - stack.rate
        return np.asarray(left[known])

    first = np.concatenate([values[free], stack.rate[0]])
    low = np.full(first.size, -np.inf)
    for name in ("strength", "cubic"):
        if NAMES.index(name) in free:
            low[free.index(NAMES.index(name))] = 0.0
    from scipy.optimize import least_squares  # slow to load, and few recordings need it

    found = least_squares(residuals, np.maximum(first, low + 1.0e-9), bounds=(low, np.inf), x_scale="jac")
    values[free] = found.x[: len(free)]
    covariance, rates = _covariance(known, found.jac, found.fun), stack.rate[known]
    explains = float(found.fun @ found.fun) < (1.0 - LEAST_EXPLAINED) * float(np.sum((rates - np.mean(rates)) ** 2))
    if not (explains and values[0] > SURELY_TURNS * math.sqrt(max(float(covariance[0, 0]), 0.0))):
        check_response(runs, starting_point(runs, reference))
    asked = _Asked(usual, needs, reference, throttle, by_throttle, speeds, throttles)
    values, covariance = _likely(runs, values, free, asked) or (values, covariance)
    return _drive_fit(values, free, covariance, asked)


class _Asked(NamedTuple):
    """What the runs were, beside what was fitted to them."""

    usual: DriveLaw
    needs: Needs
    speed: float
    throttle: float
    by_throttle: bool
    speeds: Sequence[float]
    throttles: Sequence[float]


def _likely(
    runs: Sequence[Run], values: FloatArray, free: Sequence[int], asked: _Asked
) -> tuple[FloatArray, FloatArray] | None:
    """Return what the runs make likely near `values`, gusts, waves and noise apart, and the covariance of what is
    `free` of it; None where they do not, or where nothing parts their damping from 0: c has no share of that."""
    strength, exponent, damping, slope, cubic, push = values.tolist()
    power = "throttle_exponent" if asked.by_throttle else "speed_exponent"
    names = tuple(name for place, name in ((1, power), (3, "damping_share")) if place in free)
    law = DriveLaw(slowest=SPEED_FLOOR_RATIO, fastest=math.inf)._replace(
        **{power: exponent}, damping_share=slope / damping if damping else 0.0
    )
    shares = [max(abs(each), THROTTLE_FLOOR) / asked.throttle if asked.by_throttle else 1.0 for each in asked.throttles]
    by_segment = tuple(share for share, run in zip(shares, runs, strict=True) for _ in run.segments)
    found = likelihood_fit(
        [part for run in runs for part in run.segments],
        asked.speed,
        Rates(strength, damping, cubic, -push),
        form=Form(law),
        surroundings=Surroundings(names, law, asked.usual, by_segment),
    )
    if found is None or found.joint is None or found.rates.a <= 0.0:
        return None
    a, b, d, e = found.rates
    if abs(b) < SURELY_TURNS * math.sqrt(max(float(found.joint[1, 1]), 0.0)):
        return None
    law = found.form.law
    values = np.array([a, getattr(law, power), b, law.damping_share * b, d, -e])
    # how `values` go with a, b, d, e and what is searched for of the law
    by = np.zeros((6, found.joint.shape[0]))
    by[0, 0] = by[2, 1] = by[4, 2] = 1.0
    by[5, 3], by[3, 1] = -1.0, law.damping_share
    for place, name in enumerate(names, start=4):
        by[1 if name == power else 3, place] = 1.0 if name == power else b
    return values, by[list(free)] @ found.joint @ by[list(free)].T


def _way_exponent(asked: _Asked) -> float:
    """Return the power of the throttle with which the runs' speeds go; what is usual where they do not tell."""
    if not asked.throttle > 0.0 or _span(asked.throttles) < LEAST_SPAN:
        return asked.usual.way_exponent
    slope = np.polyfit(np.log(np.asarray(asked.throttles)), np.log(np.asarray(asked.speeds)), 1)[0]
    return float(min(max(slope, 0.2), 3.0))


def _drive_fit(values: FloatArray, free: Sequence[int], covariance: FloatArray, asked: _Asked) -> DriveFit:
    """Return the fit in the model's terms, and in words; covariance: of the `free` values first."""
    errors = {NAMES[place]: math.sqrt(max(covariance[i, i], 0.0)) for i, place in enumerate(free)}
    strength, exponent, damping, slope, cubic, push = (float(each) for each in values)
    size = max(abs(damping), 1.0e-4)
    model = Norrbin(
        strength / size,
        1.0 / size,
        n3=cubic / size,
        n1=1.0 if damping >= 0.0 else -1.0,
        n0=-push / size,
        reference_speed=asked.speed,
    )
    what = "throttle" if asked.by_throttle else "speed"
    law = DriveLaw(
        0.0 if asked.by_throttle else exponent,
        exponent if asked.by_throttle else 0.0,
        slope / damping if damping else 0.0,
        asked.throttle if asked.throttle > 0.0 else math.nan,
        _way_exponent(asked),
        min(asked.speeds) / asked.speed,
        max(asked.speeds) / asked.speed,
    )
    errors["time_constant"] = errors["damping"] / size**2
    # a boat that turns harder and is damped more turns alike in the end: their errors go together
    by = np.zeros(covariance.shape[0])
    by[free.index(0)], by[free.index(2)] = 1.0 / max(strength, 1.0e-9), -math.copysign(1.0 / size, damping)
    errors["gain"] = model.gain * math.sqrt(max(float(by @ covariance @ by), 0.0))
    sentences = []
    if "exponent" in errors:
        name = "throttle_exponent" if asked.by_throttle else "speed_exponent"
        errors[name] = errors["exponent"]
        sentences.append(f"K/T goes with the power {exponent:.2f} +- {1.96 * errors['exponent']:.2f} of the {what}.")
    else:
        sentences.append(
            f"The runs are all at much the same {what}: how K and T go with it cannot be known, and is taken as usual "
            f"for the drive (power {exponent:g}). Add runs at half and twice that {what}."
        )
    if "damping_slope" in errors:
        low, high = min(asked.speeds) / asked.speed, max(asked.speeds) / asked.speed
        # c and a err together
        by = np.zeros(covariance.shape[0])
        by[free.index(3)], by[free.index(2)] = 1.0 / size, -slope / (size * damping)
        errors["damping_share"] = math.sqrt(max(float(by @ covariance @ by), 0.0))
        # more than all of the damping cannot go with the speed, and chance finds more of a boat of which all does
        if 1.0 < law.damping_share < 1.0 + SURE_OF_IT * errors["damping_share"]:
            law = law._replace(damping_share=1.0)
        sentences.append(
            f"The yaw damping n1/T is {damping + slope * (low - 1.0):.3g} 1/s at {min(asked.speeds):.2f} m/s and "
            f"{damping + slope * (high - 1.0):.3g} 1/s at {max(asked.speeds):.2f} m/s."
        )
    if damping + slope * (max(asked.speeds) / asked.speed - 1.0) < 0.0:
        sentences.append("At the higher speeds the boat does not go straight by itself.")
    return DriveFit(model, law, errors, tuple(sentences))


def _covariance(known: NDArray[np.bool_], jacobian: FloatArray, left: FloatArray) -> FloatArray:
    """Return the covariance of what was fitted, from the residuals that are `left` and their `jacobian`, a row for each
    sample that is `known`: that of scores that may remember (`residuals.robust_covariance`).

    What pushes a boat slowly tells against what its rudder does within seconds by little: residuals that remember
    long do not make each sample tell less alike.
    """
    row = np.zeros(known.shape, dtype=np.intp)
    row[known] = np.arange(left.size)
    slopes, residuals = [], []
    # one segment after the other: all of them as long as the longest, by all starting rates, are gigabytes
    for there, rows in zip(known.T, row.T, strict=True):
        last = int(np.flatnonzero(there)[-1]) + 1
        rows, missing = rows[:last], ~there[:last]
        slope, residual = jacobian[rows, None], left[rows, None]
        slope[missing], residual[missing] = 0.0, 0.0
        slopes.append(slope)
        residuals.append(residual)
    return robust_covariance(slopes, residuals)


def _span(values: Sequence[float]) -> float:
    return max(values) / min(values) if values and min(values) > 0.0 else 1.0


def at_one_throttle(runs: Sequence[Run], law: DriveLaw) -> list[Run]:
    """Return the runs with the rudder that would do at the reference throttle what theirs does at their own."""

    def times(run: Run) -> float:
        return effect_of(law._replace(speed_exponent=0.0), 1.0, run.throttle)

    return [
        run._replace(segments=tuple(part._replace(rudder=times(run) * part.rudder) for part in run.segments))
        for run in runs
    ]


def likely_drive(runs: Sequence[Run], fit: DriveFit) -> LikelihoodFit | None:
    """Return what the runs make likely of the boat near `fit`, with gusts, waves and noise apart, for predictions
    (`prediction_bands`) of runs like `at_one_throttle`; None where they cannot say that the boat follows its rudder.

    A boat that thrust turns without way is turned far: the drag of the flow across its hull goes with r|r|, which n3
    follows at the rates of the runs alone, and the hull slides (T2 and T3 of Nomoto's second order). How it goes with
    speed is held at what `fit` found, or is usual.
    """
    model, law = fit.model, fit.law
    if not model.gain > 0.0:
        return None
    unit = 1.0 / model.time_constant
    segments = [part for run in at_one_throttle(runs, law) for part in run.segments]
    # the drag that slows the largest turn as much as n3 does
    drag = model.n3 * unit * largest_rate(segments)
    guess = Rates(model.gain * unit, model.n1 * unit, drag, model.n0 * unit)
    train = ("delay", *SWAY) if ordered(runs) else tuple(SWAY)
    found = likelihood_fit(segments, model.reference_speed, guess, train, form=Form(law, power=2))
    if found is None or found.rates.a < SURELY_TURNS * math.sqrt(max(float(found.covariance[0, 0]), 0.0)):
        return None
    return found


def predict_drive(run: Run, fit: DriveFit) -> Prediction:
    """Return how well a run is predicted from its rudder, speed and throttle alone, from its first measured rate on."""
    model, law = fit.model, fit.law
    stack = _stacked([run], model.reference_speed, law.throttle)
    by_throttle = law.throttle_exponent != 0.0 and math.isfinite(law.throttle)
    unit = 1.0 / model.time_constant
    values = np.array(
        [
            model.gain * unit,
            law.throttle_exponent if by_throttle else law.speed_exponent,
            model.n1 * unit,
            model.n1 * unit * law.damping_share,
            model.n3 * unit,
            -model.n0 * unit,
        ]
    )
    left = _simulated(stack, values, stack.rate[0], by_throttle=by_throttle) - stack.rate
    left, rate = left[np.isfinite(left)], stack.rate[np.isfinite(stack.rate)]
    moved = float(np.sum((rate - np.mean(rate)) ** 2))
    return Prediction(1.0 - float(np.sum(left**2)) / moved if moved > 0.0 else None, float(np.sqrt(np.mean(left**2))))
