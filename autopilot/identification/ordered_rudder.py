"""How quick the rudder was that a recording knows by its orders alone: as the boat's turning shows it.

A steering gear that is slower than the file says is met as a rudder behind its orders, by more the larger the order is.
No delay or lag of the rudder's train does that, and a fit that has no other explanation finds a boat that is none. So
before the fit the rudder is moved at each of a ladder of rates, and the rate is taken with which Norrbin's model, to
the first order of its n3, explains the rate of turn best:

    r = a x + b y + c x' + e,   T x' = U d/U0 - x,   T y' = x^3 - y,

linear in a, b, c and e; T and a delay are searched. c x' is what a lateness between the delays that are tried adds, to
first order. What goes with exp(-t/T) is left out, for nobody knows how the boat turned before a stretch began; so is
what goes with where a slow rudder stood then, which after a gap may be anywhere between the largest orders: to first
order the response to a rudder from one side of them less that to one from the other. That is a number more for each
stretch than the filed rate has, and is worth one in the logarithm of the likelihood (Akaike 1974). The
regressors know nothing of the measured motion, so that its noise biases nothing. A heading alone is differentiated, and
it and the regressors are averaged alike. Delay and lag of the train compete: the filed rate is tried with a few of
both, so that a rudder that is merely late is not called slow. The evidence is the ratio of likelihoods of white
residuals, as many of them as are independent by their autocorrelation. Boats that are course-unstable show no rate.

Derived here; first order in n3: the perturbation of Nomoto's model by its cubic term.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import Identified, Ratios
from autopilot.identification.likelihood_fit import LikelihoodFit, moved_to
from autopilot.identification.likelihood_model import in_norrbin, reasons_of
from autopilot.identification.likelihood_record import level_of
from autopilot.identification.rudder_path import RudderRate
from autopilot.identification.runs import FloatArray, Run, Segment

LADDER = 1.25
"""Ratio of two neighbouring rates."""
SLOWEST = math.radians(0.5)
"""The slowest rate tried [rad/s]; SOLAS asks of the slowest steering gear for 2.3 deg/s."""
LATER = (0.0, 0.1, 0.2, 0.4, 0.8)
LAGGING = (0.0, 0.2, 0.5, 1.0)
"""Delays [s] and lags [s] of the train that compete."""
SURE = 8.0
"""So much more likely, as a natural logarithm, must another rate be than the filed one with any delay and lag."""
TIMES = np.geomspace(0.3, 120.0, 9)
"""Time constants T [s] that are tried, and refined between."""
AVERAGED = 1.0
"""A rate of turn by the heading is averaged over this time [s]."""
MOST = 3000
"""Of a recording as many samples at most are looked at: no rudder's rate needs more."""
BESIDE = 0.05
"""The standard error is that of a parabola through so much slower and quicker, a step of the ladder at most."""
CLOSE = 2.0e-3
"""The rate is found to so much of itself; its doubt is 1 % and more."""
NO_MISFIT = 1.0e-16
"""Of recordings without noise [(rad/s^2)^2]."""


class _Series(NamedTuple):
    """A stretch at even spacing dt [s]: rate of turn [rad/s], rudder [rad], speed [m/s]; over how many samples the rate
    is averaged."""

    dt: float
    rate: FloatArray
    rudder: FloatArray
    speed: FloatArray
    averaged: int


def rate_limited(time: FloatArray, rudder: FloatArray, rate_max: float) -> FloatArray:
    """Return the `rudder` [rad] at `time` [s] behind a gear that moves at `rate_max` [rad/s] at most."""
    moved = np.empty_like(rudder)
    angle = moved[0] = float(rudder[0])
    steps = np.diff(time).tolist()
    for place, (order, step) in enumerate(zip(rudder[1:].tolist(), steps, strict=True), 1):
        reach, left = rate_max * step, order - angle
        angle += -reach if left < -reach else reach if left > reach else left
        moved[place] = angle
    return moved


def slower_rudder(
    runs: Sequence[Run],
    filed: float,
    *,
    by_thrust: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> RudderRate | None:
    """Return the rate at which the rudder moved where the runs show that it was slower than `filed` [rad/s].

    runs: their rudder as ordered or estimated, moved at the filed rate, which may be inf. by_thrust: the boat has no
    rudder, and what is estimated is its thrust. progress: called with how many rates are tried, and of how many. None
    where it is no likelier than the filed one, and where a sensor shows the rudder; one that is likelier and not sure
    is for `with_unsure_rate`.
    """
    if any(run.rudder == "measured" or (by_thrust and run.rudder == "estimated") for run in runs):
        return None
    series = [each for run in runs for segment in run.segments if (each := _series(segment)) is not None]
    asked = max((float(np.max(np.abs(np.diff(each.rudder)))) / each.dt for each in series), default=0.0)
    quickest = min(filed, asked)
    if not quickest > SLOWEST:
        return None
    rates = quickest / LADDER ** np.arange(math.ceil(math.log(quickest / SLOWEST) / math.log(LADDER)))
    trains = [(late, lag) for late in LATER for lag in LAGGING]
    total, direct, tried = len(trains) + rates.size, list[_Misfit](), list[_Misfit]()
    for late, lag in trains:
        progress(len(direct), total)
        direct.append(_misfit(series, _as_ordered(series), late, lag))
    for rate in rates.tolist():
        progress(len(trains) + len(tried), total)
        tried.append(_at_rate(series, rate))
    progress(total, total)
    as_filed = min(direct)
    best = int(np.argmin([found.square for found in tried]))
    if best == 0:
        return None
    around = math.log(rates[best]) + math.log(LADDER) * np.array([-1.0, 1.0])
    from scipy.optimize import minimize_scalar  # slow to load, and few recordings need it

    found = minimize_scalar(
        lambda rate: math.log(_at_rate(series, math.exp(rate)).square),
        bounds=tuple(around),
        method="bounded",
        options={"xatol": CLOSE},
    )
    rate = math.exp(float(found.x))
    here = _at_rate(series, rate)
    gain = 0.5 * here.independent * math.log(as_filed.square / here.square)
    if not gain > 0.0:
        return None
    beside = [math.log(_at_rate(series, rate * math.exp(side * BESIDE)).square) for side in (-1.0, 1.0)]
    bend = 0.5 * here.independent * (sum(beside) - 2.0 * math.log(here.square)) / (BESIDE * BESIDE)
    error = rate / math.sqrt(max(bend, math.log(LADDER) ** -2))
    return RudderRate(rate, error, _movements(series, rate), True, gain - len(series) > SURE)


def shows_rate(runs: Sequence[Run], filed: float) -> bool:
    """Return whether the runs would have shown a rudder half as fast as `filed` [rad/s], which `slower_rudder` did not
    find."""
    series = [each for run in runs for segment in run.segments if (each := _series(segment)) is not None]
    if not series:
        return False
    as_filed, half = _misfit(series, _as_ordered(series), 0.0, 0.0), _at_rate(series, 0.5 * filed)
    return 0.5 * as_filed.independent * math.log(half.square / as_filed.square) > SURE


def with_rudder_of(run: Run, rate: RudderRate) -> Run:
    """Return the run with its rudder behind a gear of that `rate`."""
    segments = tuple(
        segment._replace(rudder=rate_limited(segment.time, segment.rudder, rate.rate)) for segment in run.segments
    )
    return run._replace(segments=segments)


def identified_behind(
    ordered: Sequence[Run], rate: RudderRate, identify: Callable[[Sequence[Run]], Identified]
) -> tuple[Identified, RudderRate | None]:
    """Return what is identified of the runs as `ordered`, behind a gear of that `rate` where it is sure, and the rate;
    None where no boat is found behind it: a gear that hardly ever comes to where it is ordered turns its orders into
    a boat's slide."""
    if rate.is_sure and (found := _behind(ordered, rate, identify)) is not None:
        return found, rate
    return identify(ordered), None if rate.is_sure else rate


def with_rate(
    found: Identified, ordered: Sequence[Run], rate: RudderRate, identify: Callable[[Sequence[Run]], Identified]
) -> Identified:
    """Return what is identified of the runs as `ordered` with a `rate` that turning shows, and its doubt; found: of
    them as they are, or behind a gear of that rate where that is sure.

    Turning knows nothing of gusts: what is sure by it is compared with the rudder as ordered too, and counts where it
    is the likelier one by the fits.
    """
    if not rate.is_sure:
        return with_unsure_rate(found, ordered, rate, identify)
    direct = _behind(ordered, None, identify)
    compared = None if direct is None else _of_both(direct, found, ordered, rate, identify)
    return with_doubt_of_rate(found, ordered, rate, identify) if compared is None else compared


def with_doubt_of_rate(
    found: Identified, ordered: Sequence[Run], rate: RudderRate, identify: Callable[[Sequence[Run]], Identified]
) -> Identified:
    """Return `found`, fitted to the runs as `ordered` behind a gear of that `rate`, or what is fitted behind the
    likeliest rate near it, with the rate's doubt in its own.

    To first order covariances add: of parameters p(s) fitted at a rate s of deviation e, C + (p' e)(p' e)', with p' by
    the difference of fits to either side (a rate that was found first and held then: Murphy and Topel 1985). Rate and
    deviation are those of the fit's own likelihood, where it has one that bends: it knows of gusts, and of orders whose
    moments nobody knows, which smear the turning over the time between two reports as a slower gear would.
    What only one of the two fits could tell adds its distance from `found`. Where neither can be made, nothing is
    known of the doubt, and InputError is raised.
    """
    near = _likeliest_rate(found, ordered, rate)
    if near is not None:
        moved = found if near.rate.rate == rate.rate else _behind(ordered, near.rate, identify)
        if moved is not None:
            return _spread(moved, near.slow, near.quick, near.share, near.rate)
    beside = list[Identified]()
    for side in (-1.0, 1.0):
        moved_by = rate._replace(rate=rate.rate + side * rate.standard_error)
        if (there := _behind(ordered, moved_by, identify)) is not None:
            beside.append(there)
    if not beside:
        raise InputError(
            "The doubt about K and T is unknown: nothing is identified with the rudder a little slower or quicker "
            "than the boat's turning shows it; record the rudder's angle."
        )
    slow, quick = (found, beside[0]) if len(beside) == 1 else beside
    return _spread(found, slow, quick, 1.0 if len(beside) == 1 else 0.5, rate)


def _spread(found: Identified, slow: Identified, quick: Identified, share: float, rate: RudderRate) -> Identified:
    """Return `found` behind a gear of that `rate`, a `share` of the difference of two fits as one more deviation."""
    errors = dict(found.standard_errors)
    for name, error in errors.items():
        if error is not None:
            errors[name] = math.hypot(error, share * (_value(quick, name) - _value(slow, name)))
    covariance = found.covariance
    if covariance is not None:
        off = share * np.array([_value(quick, name) - _value(slow, name) for name in found.free])
        covariance = covariance + np.outer(off, off)
    of_ratios = list[float]()
    if found.ratios is not None and slow.ratios is not None and quick.ratios is not None:
        pairs = zip(found.ratios.errors, slow.ratios.values, quick.ratios.values, strict=True)
        of_ratios = [math.hypot(error, share * (high - low)) for error, low, high in pairs]
    return _doubting(found, errors, covariance, of_ratios)._replace(rudder_rate=rate)


class _Likeliest(NamedTuple):
    """The likeliest rate, boats to either side of it, and its deviation as a share of what these are apart."""

    rate: RudderRate
    slow: Identified
    quick: Identified
    share: float


def _likeliest_rate(found: Identified, ordered: Sequence[Run], rate: RudderRate) -> _Likeliest | None:
    """Return the rate near `rate` behind which the runs are likeliest: Newton's steps on the likelihood's parabola
    through three rates, each with the likeliest boat; None where there is no likelihood, or it does not bend there."""
    likely, speed, h = found.likely, found.model.reference_speed, rate.standard_error
    if likely is None or likely.around is not None or found.around is not None:
        return None
    known = dict[float, LikelihoodFit | None]()

    def behind(at: float) -> LikelihoodFit | None:
        if at not in known:
            known[at] = _moved_behind(likely, ordered, rate._replace(rate=at), speed)
        return known[at]

    here = float(rate.rate)
    for _ in range(STEPS):
        fits = [behind(here + side * h) for side in (-1.0, 0.0, 1.0)] if here > 2.0 * h else []
        if None in fits or not fits:
            return None
        slow, middle, quick = (fit for fit in fits if fit is not None)
        bend = slow.loss + quick.loss - 2.0 * middle.loss
        way = 0.5 * (slow.loss - quick.loss)
        error = h / math.sqrt(bend) if bend > 0.0 else math.inf
        step = h * way / bend if bend > 0.0 else math.copysign(2.0 * h, way)
        if abs(step) < SAME_RATE * error < math.inf:
            likeliest = rate._replace(rate=here, standard_error=error)
            return _Likeliest(likeliest, _as_identified(found, slow), _as_identified(found, quick), 0.5 * error / h)
        here += float(max(-2.0 * h, min(2.0 * h, step)))
    return None


def _as_identified(found: Identified, fit: LikelihoodFit) -> Identified:
    """Return `found` with the values of that `fit`."""
    model, _ = in_norrbin(fit, found.model.reference_speed)
    ratios = found.ratios and Ratios((fit.rates.a, fit.rates.b, fit.rates.d, fit.rates.e), found.ratios.errors)
    return found._replace(model=model, train=fit.train, ratios=ratios)


SAME_RATE = 0.2
"""Of the rate's deviation: a boat that is off by so much of it has 2 % of that variance more."""
STEPS = 6
"""Of Newton's to the likeliest rate, at most: each goes two deviations of the rate that was found first at most."""


def with_unsure_rate(
    found: Identified, ordered: Sequence[Run], rate: RudderRate, identify: Callable[[Sequence[Run]], Identified]
) -> Identified:
    """Return `found`, fitted to the runs as `ordered`, or a fit behind a gear of that `rate` where that is surely the
    likelier one, with the doubt which of them it is.

    The fits know of the weather, as what shows the rate does not. Of two boats with probabilities 1 - q and q the mean
    square about the first is C = (1 - q) C1 + q (C2 + (p2 - p1)(p2 - p1)'); q by their likelihoods, the one with a
    number more, the rate, less likely by one (Akaike 1974). Where either has none, `found` stays.
    """
    if found.likely is None:
        return found
    near = _likeliest_rate(found, ordered, rate)
    rate = rate if near is None else near.rate._replace(is_sure=False)
    gain = _gain(*_moved_to_both(found.likely, ordered, rate, found.model.reference_speed))
    if gain is not None and gain < -SURE:
        return found
    behind = _behind(ordered, rate, identify)
    compared = None if behind is None else _of_both(found, behind, ordered, rate, identify)
    return found if compared is None else compared


def _of_both(
    found: Identified,
    behind: Identified,
    ordered: Sequence[Run],
    rate: RudderRate,
    identify: Callable[[Sequence[Run]], Identified],
) -> Identified | None:
    """Return what is `found` of the runs as `ordered`, or is `behind` a gear of that `rate`, with the doubt that
    `with_unsure_rate` tells of; None where they cannot be compared."""
    if found.likely is None or behind.likely is None:
        return None
    # likelihoods are compared on one grid of times
    pair: tuple[LikelihoodFit | None, LikelihoodFit | None] = found.likely, behind.likely
    if [motion.shape for motion in found.likely.motions] != [motion.shape for motion in behind.likely.motions]:
        pair = _moved_to_both(behind.likely, ordered, rate, found.model.reference_speed)
    gain = _gain(*pair)
    if gain is None:
        return None
    if gain > (0.0 if rate.is_sure else SURE):
        found, behind, gain = with_doubt_of_rate(behind, ordered, rate._replace(is_sure=True), identify), found, -gain
    q = 0.5 * (1.0 + math.tanh(0.5 * gain))

    def doubted(own: float, others: float, off: float) -> float:
        return math.sqrt((1.0 - q) * own * own + q * (others * others + off * off))

    errors = dict(found.standard_errors)
    for name, error in errors.items():
        others = behind.standard_errors.get(name)
        if error is not None and others is not None:
            errors[name] = doubted(error, others, _value(behind, name) - _value(found, name))
    covariance = found.covariance
    if covariance is not None and behind.covariance is not None and found.free == behind.free:
        off = np.array([_value(behind, name) - _value(found, name) for name in found.free])
        covariance = (1.0 - q) * covariance + q * (behind.covariance + np.outer(off, off))
    ratios, of_ratios = found.ratios, list[float]()
    if ratios is not None and behind.ratios is not None:
        pairs = zip(ratios.errors, behind.ratios.errors, ratios.values, behind.ratios.values, strict=True)
        of_ratios = [doubted(error, others, there - here) for error, others, here, there in pairs]
    return _doubting(found, errors, covariance, of_ratios)


def _segments_of(runs: Sequence[Run]) -> tuple[Segment, ...]:
    """Return the segments of all runs."""
    return tuple(segment for run in runs for segment in run.segments)


def _moved_to_both(
    likely: LikelihoodFit, ordered: Sequence[Run], rate: RudderRate, speed: float
) -> tuple[LikelihoodFit | None, LikelihoodFit | None]:
    """Return the likeliest boats near `likely` of the runs as `ordered`, and behind a gear of that `rate`, on one grid
    of times."""
    return moved_to(likely, _segments_of(ordered), speed), _moved_behind(likely, ordered, rate, speed)


def _moved_behind(
    likely: LikelihoodFit, ordered: Sequence[Run], rate: RudderRate, speed: float
) -> LikelihoodFit | None:
    """Return the likeliest boat near `likely` of the runs behind a gear of that `rate`."""
    return moved_to(likely, _segments_of([with_rudder_of(run, rate) for run in ordered]), speed)


def _gain(direct: LikelihoodFit | None, behind: LikelihoodFit | None) -> float | None:
    """Return how much likelier the fit `behind` a gear is, which has a number more; None where there is not either."""
    return None if direct is None or behind is None else direct.loss - behind.loss - 1.0


def _behind(
    ordered: Sequence[Run], rate: RudderRate | None, identify: Callable[[Sequence[Run]], Identified]
) -> Identified | None:
    """Return what is identified of the runs behind a gear of that `rate`, or as ordered without one; None where nothing
    is found, or no curvature is finite."""
    try:
        return identify(ordered if rate is None else [with_rudder_of(run, rate) for run in ordered])
    except (InputError, np.linalg.LinAlgError):
        return None


def _doubting(
    found: Identified, errors: dict[str, float | None], covariance: FloatArray | None, of_ratios: Sequence[float]
) -> Identified:
    """Return `found` with these doubts; of_ratios: those of a, b, d and e, empty where they stay."""
    ratios, reasons = found.ratios, found.unidentifiable
    if ratios is not None and of_ratios:
        a, b, d, e = of_ratios
        ratios = Ratios(ratios.values, (a, b, d, e))
        reasons = {**reasons, **reasons_of(ratios, found.model, errors)}
    return found._replace(standard_errors=errors, covariance=covariance, ratios=ratios, unidentifiable=reasons)


def _value(found: Identified, name: str) -> float:
    """Return a parameter of the model, of the rudder's way, or of propeller and wind; 0 where it was not found."""
    owners = (found.model, found.train, found.around)
    return next((float(getattr(owner, name)) for owner in owners if hasattr(owner, name)), 0.0)


class _Misfit(NamedTuple):
    """Mean square of the residuals, and how many of them stand alone. Orders by the square."""

    square: float
    independent: float


def _series(segment: Segment) -> _Series | None:
    time = segment.time
    if time.size < 20:
        return None
    dt = max(float(np.median(np.diff(time))), float(time[-1] - time[0]) / MOST)
    even = np.arange(time[0], time[-1], dt)
    has_rate, has_heading = np.isfinite(segment.rate), np.isfinite(segment.heading)
    averaged = 1
    rated = np.count_nonzero(has_rate)
    if rated >= 20 and rated > 0.9 * np.count_nonzero(has_rate | has_heading):
        rate = np.interp(even, time[has_rate], segment.rate[has_rate])
    elif np.count_nonzero(has_heading) > 20:
        rate = np.gradient(np.interp(even, time[has_heading], segment.heading[has_heading]), dt)
        averaged = max(1, round(AVERAGED / dt))
    else:
        return None
    speed = np.interp(even, time, segment.speed)
    return _Series(dt, _mean_of(rate, averaged), np.interp(even, time, segment.rudder), speed, averaged)


def _mean_of(values: FloatArray, count: int) -> FloatArray:
    return values if count == 1 else np.convolve(values, np.full(count, 1.0 / count), "same")


def _at_rate(series: Sequence[_Series], rate: float) -> _Misfit:
    moved = [_moved(each, rate) for each in series]
    return min(_misfit(series, moved, late, 0.0) for late in LATER[:3])


Driven = Sequence[tuple[FloatArray, FloatArray | None]]
"""Of each stretch the rudder, and what it may be off by from a beginning at another angle than ordered, if it may."""


def _as_ordered(series: Sequence[_Series]) -> Driven:
    return [(each.rudder, None) for each in series]


def _moved(series: _Series, rate_max: float) -> tuple[FloatArray, FloatArray]:
    """Return the rudder behind a gear of that rate, as in `Driven`."""
    time, orders = series.dt * np.arange(float(series.rudder.size)), series.rudder
    begins = (float(orders[0]), float(np.max(orders)), float(np.min(orders)))
    from_order, high, low = (rate_limited(time, np.concatenate([[side], orders[1:]]), rate_max) for side in begins)
    return from_order, high - low


def _misfit(series: Sequence[_Series], moved: Driven, late: float, lag: float) -> _Misfit:
    """Return the misfit of the rudder as it `moved`, late and lagging, with the best time constant."""
    driven = [
        (
            _turning(each, _low_pass(rudder, each.dt, lag) if lag > 0.0 else rudder, late),
            None if unknown is None else _turning(each, unknown, late),
        )
        for each, (rudder, unknown) in zip(series, moved, strict=True)
    ]
    squares = [_square(series, driven, float(time)) for time in TIMES]
    best = int(np.argmin(squares))
    bounds = (math.log(TIMES[max(best - 1, 0)]), math.log(TIMES[min(best + 1, len(TIMES) - 1)]))
    from scipy.optimize import minimize_scalar  # slow to load, and few recordings need it

    found = minimize_scalar(
        lambda time: _square(series, driven, math.exp(time)), bounds=bounds, method="bounded", options={"xatol": 0.02}
    )
    residual = _residual(series, driven, math.exp(float(found.x)))
    return _Misfit(max(float(np.mean(residual * residual)), NO_MISFIT), residual.size / _remembered(residual))


def _turning(series: _Series, moved: FloatArray, late: float) -> FloatArray:
    """Return the rudder `moved` so much `late`, times the speed."""
    dt, speed = series.dt, series.speed
    if late > 0.0:
        times = np.arange(moved.size)
        moved = np.interp(times - late / dt, times, moved)
    return moved * speed / max(float(np.mean(speed)), 0.1)


def _square(series: Sequence[_Series], driven: Driven, time: float) -> float:
    residual = _residual(series, driven, time)
    return float(np.mean(residual * residual))


def _residual(series: Sequence[_Series], driven: Driven, time: float) -> FloatArray:
    tables = []
    for each, (rudder, unknown) in zip(series, driven, strict=True):
        x = _low_pass(rudder, each.dt, time)
        y = _low_pass(x**3, each.dt, time)
        begin = np.exp(-each.dt / time * np.arange(x.size))
        columns = (x, y, (rudder - x) / time, np.ones_like(x), begin)
        *averaged, begin = (_mean_of(column, each.averaged) for column in columns)
        table = _without(np.column_stack([*averaged, each.rate]), begin)
        if unknown is not None:
            stood = _mean_of(_low_pass(unknown, each.dt, time), each.averaged)
            table = _without(table, _without(stood[:, None], begin)[:, 0])
        tables.append(table)
    table = np.vstack(tables)
    regressors, found = table[:, :-1], table[:, -1]
    scale = np.linalg.norm(regressors, axis=0)
    regressors = regressors / np.where(scale > 0.0, scale, 1.0)
    square = regressors.T @ regressors + 1.0e-12 * np.eye(scale.size)
    return np.asarray(found - regressors @ np.linalg.solve(square, regressors.T @ found))


def _without(columns: FloatArray, begin: FloatArray) -> FloatArray:
    """Return the columns less what of each goes with what nobody knows of a stretch's beginning."""
    size = float(begin @ begin)
    return columns - np.outer(begin, begin @ columns) / size if size > 0.0 else columns


def _low_pass(values: FloatArray, dt: float, tau: float) -> FloatArray:
    return level_of(values, -math.expm1(-dt / tau))


def _remembered(residual: FloatArray) -> float:
    """Return over how many samples a residual is remembered: 1 + 2 sum of its autocorrelation up to the first zero."""
    size = 1 << (2 * residual.size - 1).bit_length()
    spectrum = np.fft.rfft(residual, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[: residual.size // 2]
    correlation /= max(float(correlation[0]), 1.0e-300)
    below = np.flatnonzero(correlation < 0.0)
    end = int(below[0]) if below.size else correlation.size
    return 1.0 + 2.0 * float(np.sum(correlation[1:end]))


def _movements(series: Sequence[_Series], rate: float) -> int:
    """Return how many times the rudder was slewed at its rate."""
    found = 0
    for each in series:
        moved = rate_limited(each.dt * np.arange(float(each.rudder.size)), each.rudder, rate)
        slewing = np.abs(np.diff(moved)) > 0.99 * rate * each.dt
        found += int(np.count_nonzero(slewing[1:] & ~slewing[:-1])) + int(bool(slewing.size and slewing[0]))
    return found
