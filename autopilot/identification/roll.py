"""How a boat rolls under its rudder, from a recording with roll.

    phi'' = -2 zeta w phi' - w^2 phi + b_delta (U/U0)^2 delta + b_r (U/U0) r + d,
    r'    = -(U/U0)/T r + (U/U0)^2 (K/T) delta + c

The first line is the row of roll that `autopilot/control/sliding_roll.py` steers by, scaled with speed as there; d is
what waves do. Waves that roll the boat also yaw it, so a measured yaw rate would carry them into b_r: r is here the
answer of the second line, fitted to the same record, to the rudder alone. What is left of the roll is an
autoregressive process, which is fitted anew at each w and zeta and whitens roll and prediction (generalised least
squares: Clarke 1967, first IFAC symposium on identification, Prague); all else is linear. The errors of w and zeta are
those of the likelihood's curvature. The rudder must not follow the roll: a zigzag or a binary sequence, and no roll
damping at work.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar
from scipy.signal import cont2discrete, lfilter

from autopilot.errors import InputError
from autopilot.identification.runs import FloatArray, gap_limit

SAMPLES_A_ROLL, FINER = 16, 4
"""The record is taken at so many samples in a period of the roll: more say nothing new of it. Answers are worked out at
steps so many times finer, for straight lines between samples are no rudder's, and averaged."""
LONGEST_STEP_S, SHORTEST_STEP_S = 1.0, 0.02
ORDERS = (2, 4, 8, 12, 16, 24)
"""Orders of the autoregressive process that Akaike's criterion chooses from."""
ROUNDS = 2
"""Fits, each whitened by what the last one left over."""
INNER = 2
"""Rounds of whitening at each frequency and damping."""
STEPS_MOST, FLATTEST = 12, 1.0
"""Doublings of the step over which the curvature is taken, and the least curvature per unit of the logarithm: an error
of 100 % in what nothing tells."""
FREQUENCIES = np.geomspace(0.15, 12.0, 50)
"""Natural frequencies [rad/s] tried: periods of half a second to 42 s."""
DAMPINGS = (0.04, 0.12, 0.4)
LEAST_S = 60.0
SEEN = 20.0
"""Chi-square with two degrees of freedom beyond which the rudder moves roll: by chance once in 20,000."""
LARGEST_DAMPING = 2.0
SURE = 1.96
"""Standard errors to either side of 95 %."""


class RollRecord(NamedTuple):
    """A stretch without gaps at even steps `dt` [s]: roll [rad] and yaw rate [rad/s], means of FINER steps; rudder
    [rad] and U/U0 at the fine steps themselves."""

    dt: float
    roll: FloatArray
    rate: FloatArray
    rudder: FloatArray
    ratio: FloatArray


class RollModel(NamedTuple):
    """Natural frequency [rad/s], damping ratio [-], b_delta [1/s^2] and b_r [1/s] at `reference_speed` [m/s], and their
    standard errors; the rms [rad] of the roll that the rudder does not explain; seconds of record."""

    frequency: float
    damping: float
    rudder: float
    yaw: float
    errors: tuple[float, float, float, float]
    reference_speed: float
    left_rms: float
    seconds: float

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of a parameter."""
        value, error = float(getattr(self, name)), self.errors[PARAMETERS.index(name)]
        return value - SURE * error, value + SURE * error

    def row(self) -> tuple[float, float, float, float, float]:
        """Return p' over v, p, r, phi and the rudder at the reference speed, as the law's section has it."""
        return 0.0, -2.0 * self.damping * self.frequency, self.yaw, -(self.frequency**2), self.rudder


PARAMETERS = ("frequency", "damping", "rudder", "yaw")


def roll_records(
    source: str, columns: Mapping[str, FloatArray], reference_speed: float | None
) -> tuple[list[RollRecord], float]:
    """Return the stretches of columns as identification takes them with `roll_rad`, and the reference speed [m/s]: the
    mean where None is given. Raises InputError, naming `source`."""
    for name, word in (("roll_rad", "roll"), ("rudder_rad", "rudder"), ("speed_m_s", "speed")):
        if name not in columns:
            raise InputError(f"{source}: holds no {word}; a roll model needs roll, rudder, speed and heading.")
    rate = _yaw_rate(source, columns)
    time = columns["time_s"]
    known = np.isfinite(time) & np.isfinite(rate)
    for name in ("roll_rad", "rudder_rad", "speed_m_s"):
        known &= np.isfinite(columns[name])
    rows = np.flatnonzero(known)
    if rows.size < 2:
        raise InputError(f"{source}: roll, rudder, speed and heading are nowhere known together.")
    time, roll, rudder, speed = (columns[name][rows] for name in ("time_s", "roll_rad", "rudder_rad", "speed_m_s"))
    rate = rate[rows]
    mean = float(np.mean(speed)) if reference_speed is None else reference_speed
    if not mean > 0.0:
        raise InputError(f"{source}: the boat makes no way; the rudder rolls it only when it does.")
    step = _step(time, roll)
    records = []
    for part in np.split(np.arange(time.size), np.flatnonzero(np.diff(time) > gap_limit(time)) + 1):
        even = np.arange(time[part[0]], time[part[-1]], step / FINER)
        even = even[: even.size - even.size % FINER]
        if even.size * step / FINER >= 0.5 * LEAST_S:
            moved = (np.interp(even, time[part], values[part]) for values in (roll, rate, rudder, speed))
            rolled, turned, helm, made = moved
            records.append(RollRecord(step, _coarse(rolled), _coarse(turned), helm, made / mean))
    seconds = sum(one.roll.size * one.dt for one in records)
    if seconds < LEAST_S:
        raise InputError(f"{source}: has {seconds:.0f} s of roll and rudder without gaps; {LEAST_S:.0f} s are needed.")
    return records, mean


def _yaw_rate(source: str, columns: Mapping[str, FloatArray]) -> FloatArray:
    time, rate = columns["time_s"], columns.get("yaw_rate_rad_s")
    if rate is not None and np.mean(np.isfinite(rate)) > 0.5:
        return rate
    heading = columns.get("heading_rad")
    if heading is None or np.count_nonzero(np.isfinite(heading)) < 2:
        raise InputError(f"{source}: holds no heading and no yaw rate; a roll model needs one of them.")
    known = np.isfinite(heading)
    found = np.full(time.size, np.nan)
    found[known] = np.gradient(np.unwrap(heading[known]), time[known])
    return found


def _step(time: FloatArray, roll: FloatArray) -> float:
    """Return the step [s] for SAMPLES_A_ROLL in a period of the roll, by how often it crosses its mean."""
    spacing = float(np.median(np.diff(time)))
    off = roll - np.mean(roll)
    kernel = max(1, round(0.3 / spacing))
    smooth = np.convolve(off, np.ones(kernel) / kernel, mode="same")
    crossings = max(int(np.count_nonzero(np.diff(np.sign(smooth)))), 1)
    period = 2.0 * (time[-1] - time[0]) / crossings
    return float(max(min(period / SAMPLES_A_ROLL, LONGEST_STEP_S), spacing, SHORTEST_STEP_S))


def _coarse(values: FloatArray) -> FloatArray:
    """Return the means of FINER rows each."""
    return np.asarray(values.reshape(-1, FINER, *values.shape[1:]).mean(axis=1))


def identify_roll(source: str, columns: Mapping[str, FloatArray], reference_speed: float | None = None) -> RollModel:
    """Return the roll model of a record (columns in SI units, with `roll_rad`) at the reference speed [m/s].

    Raises InputError where something is missing, or where the rudder does not move roll.
    """
    records, speed = roll_records(source, columns, reference_speed)
    if float(np.std(np.concatenate([one.rudder for one in records]))) < math.radians(0.5):
        raise InputError(f"{source}: the rudder hardly moves; a roll model needs a zigzag or a binary sequence.")
    yaws = _yaw_answers(records)
    place, weighed = _fitted(records, yaws)
    target, design = _whitened(records, yaws, place, weighed)
    linear, squares = _solved(target, design)
    _, without = _solved(target, design[:, 2:])
    freedom = target.size - design.shape[1] - 2
    variance = squares / freedom
    if without - squares < SEEN * variance:
        raise InputError(
            f"{source}: the rudder does not move roll: with it the fit is no better than without "
            f"(chi-square {(without - squares) / variance:.1f}, {SEEN:g} are needed)."
        )
    errors = _errors(records, yaws, place, weighed, variance)
    left = np.concatenate(_left_over(records, yaws, place, weighed))
    return RollModel(
        *place,
        float(linear[0]),
        float(linear[1]),
        errors,
        speed,
        float(np.sqrt(np.mean(left * left))),
        sum(one.roll.size * one.dt for one in records),
    )


def _fitted(records: Sequence[RollRecord], yaws: Sequence[FloatArray]) -> tuple[tuple[float, float], FloatArray]:
    """Return natural frequency and damping ratio, and the filter that whitens what is left over: of the fits that begin
    at each of DAMPINGS the most likely, for a narrow sea can be taken for a boat that hardly damps its roll."""
    first = _whitening([one.roll - one.roll.mean() for one in records])
    ends = []
    for damping in DAMPINGS:
        place, weighed = _best(records, yaws, first, [(w, damping) for w in _tried(records)]), first
        for _ in range(ROUNDS):
            weighed = _whitening(_left_over(records, yaws, place, weighed))
            place = _best(records, yaws, weighed, [place])
        target, design = _whitened(records, yaws, place, weighed)
        variance = _solved(target, design)[1] / target.size
        ends.append((target.size * math.log(max(variance, 1.0e-300)) + 2.0 * weighed.size, place, weighed))
    _, place, weighed = min(ends, key=lambda end: end[0])

    def cost(logs: NDArray[np.float64]) -> float:
        frequency, damping = math.exp(logs[0]), math.exp(logs[1])
        if not FREQUENCIES[0] / 2.0 < frequency < _highest(records) or not 1.0e-3 < damping < LARGEST_DAMPING:
            return math.inf
        return _likelihood(records, yaws, (frequency, damping), weighed)[0]

    begin = np.log(place)
    corners = begin + np.array([(0.0, 0.0), (0.03, 0.0), (0.0, 0.4)])
    options = {"initial_simplex": corners, "xatol": 1.0e-3, "fatol": 1.0e-2, "maxiter": 60}
    found = minimize(cost, begin, method="Nelder-Mead", options=options)
    place = math.exp(float(found.x[0])), math.exp(float(found.x[1]))
    return place, _likelihood(records, yaws, place, weighed)[1]


def _likelihood(
    records: Sequence[RollRecord], yaws: Sequence[FloatArray], place: tuple[float, float], whiten: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Return -2 log likelihood up to a constant, the whitening filter at `place`, and the linear coefficients."""
    raw = _design(records, yaws, place, np.ones(1))
    ends = np.cumsum([one.roll.size for one in records])[:-1]
    parts = np.split(raw, ends)
    roll = np.concatenate([one.roll for one in records])

    def solved(by: FloatArray) -> tuple[FloatArray, float, int]:
        target = np.concatenate([_through(by, one.roll) for one in records])
        return (*_solved(target, np.vstack([_through(by, part) for part in parts])), target.size)

    for _ in range(INNER):
        linear, _, _ = solved(whiten)
        whiten = _whitening(np.split(roll - raw @ linear, ends), whiten.size - 1)
    linear, squares, size = solved(whiten)
    return size * math.log(max(squares / size, 1.0e-300)), whiten, linear


def _yaw_answers(records: Sequence[RollRecord]) -> list[FloatArray]:
    """Return the yaw rate [rad/s] that the rudder alone makes in each record, by the second equation."""
    mean = float(np.mean(np.concatenate([one.ratio for one in records])))

    def parts(constant: float, whiten: FloatArray) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
        targets, designs, answers = [], [], []
        for number, one in enumerate(records):
            pole = math.exp(-mean * one.dt / FINER / constant)
            driven = one.ratio**2 * one.rudder
            answer = lfilter([0.5 * (1.0 - pole), 0.5 * (1.0 - pole)], [1.0, -pole], driven)
            own = np.zeros((one.rate.size, 2 * len(records)))
            own[:, 2 * number] = 1.0
            own[:, 2 * number + 1] = pole ** (FINER * np.arange(one.rate.size))
            designs.append(_through(whiten, np.column_stack((_coarse(answer), own))))
            targets.append(_through(whiten, one.rate))
            answers.append(answer)
        return np.concatenate(targets), np.vstack(designs), answers

    whiten, constant, longest = np.ones(1), 1.0, sum(one.rate.size * one.dt for one in records)
    for _ in range(2):
        tried = np.geomspace(0.1, min(longest, 500.0), 40)
        costs = [_solved(*parts(float(value), whiten)[:2])[1] for value in tried]
        near = int(np.argmin(costs))
        bounds = (math.log(tried[max(near - 1, 0)]), math.log(tried[min(near + 1, 39)]))
        fitted = whiten
        found = minimize_scalar(
            lambda log, by=fitted: _solved(*parts(math.exp(log), by)[:2])[1], bounds=bounds, method="bounded"
        )
        constant = math.exp(float(found.x))
        target, design, _ = parts(constant, np.ones(1))
        linear, _ = _solved(*parts(constant, whiten)[:2])
        left, ends = target - design @ linear, np.cumsum([one.rate.size for one in records])[:-1]
        whiten = _whitening(np.split(left, ends))
    target, design, answers = parts(constant, whiten)
    gain = float(_solved(target, design)[0][0])
    return [gain * answer for answer in answers]


def _answers(one: RollRecord, yaw: FloatArray, place: tuple[float, float]) -> FloatArray:
    """Return the roll that rudder and yaw rate make each for a unit of its coefficient, and the free roll: n x 5."""
    frequency, damping = place
    numerator, denominator, _ = cont2discrete(
        ([1.0], [1.0, 2.0 * damping * frequency, frequency**2]), one.dt / FINER, method="foh"
    )
    driven = [lfilter(numerator.ravel(), denominator, u) for u in (one.ratio**2 * one.rudder, one.ratio * yaw)]
    impulse = np.zeros(one.rudder.size)
    impulse[0] = 1.0
    free = lfilter([1.0], denominator, impulse)
    return _coarse(np.column_stack((*driven, np.ones(free.size), free, np.append(0.0, free[:-1]))))


def _design(
    records: Sequence[RollRecord], yaws: Sequence[FloatArray], place: tuple[float, float], whiten: FloatArray
) -> FloatArray:
    """Return the regressors, whitened: b_delta, b_r, and mean and free roll of each record."""
    blocks = []
    for number, (one, yaw) in enumerate(zip(records, yaws, strict=True)):
        found = _answers(one, yaw, place)
        block = np.zeros((one.roll.size, 2 + 3 * len(records)))
        block[:, :2] = found[:, :2]
        block[:, 2 + 3 * number : 5 + 3 * number] = found[:, 2:]
        blocks.append(_through(whiten, block))
    return np.vstack(blocks)


def _whitened(
    records: Sequence[RollRecord], yaws: Sequence[FloatArray], place: tuple[float, float], whiten: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return np.concatenate([_through(whiten, one.roll) for one in records]), _design(records, yaws, place, whiten)


def _through(whiten: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(lfilter(whiten, [1.0], values, axis=0)[whiten.size - 1 :])


def _solved(target: FloatArray, design: FloatArray) -> tuple[FloatArray, float]:
    """Return the linear coefficients and the sum of squares that is left."""
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0.0] = 1.0
    found = np.linalg.lstsq(design / scale, target, rcond=1.0e-12)[0]
    left = target - design @ (found / scale)
    return found / scale, float(left @ left)


def _highest(records: Sequence[RollRecord]) -> float:
    """Return the highest natural frequency [rad/s] that the steps show: four samples in a period."""
    return math.pi / records[0].dt / 2.0


def _tried(records: Sequence[RollRecord]) -> list[float]:
    return [float(w) for w in FREQUENCIES if w < _highest(records)]


def _best(
    records: Sequence[RollRecord],
    yaws: Sequence[FloatArray],
    whiten: FloatArray,
    tried: Sequence[tuple[float, float]],
) -> tuple[float, float]:
    """Return natural frequency and damping ratio of the least sum of squares, from the best that was `tried` on."""

    def cost(logs: NDArray[np.float64]) -> float:
        frequency, damping = math.exp(logs[0]), math.exp(logs[1])
        if not FREQUENCIES[0] / 2.0 < frequency < _highest(records) or not 1.0e-3 < damping < LARGEST_DAMPING:
            return math.inf
        return _solved(*_whitened(records, yaws, (frequency, damping), whiten))[1]

    begin = min((np.log(place) for place in tried), key=cost)
    found = minimize(cost, begin, method="Nelder-Mead", options={"xatol": 1.0e-4, "fatol": 1.0e-9})
    return math.exp(float(found.x[0])), math.exp(float(found.x[1]))


def _left_over(
    records: Sequence[RollRecord], yaws: Sequence[FloatArray], place: tuple[float, float], whiten: FloatArray
) -> list[FloatArray]:
    """Return what the model does not explain of each roll [rad], not whitened."""
    linear, _ = _solved(*_whitened(records, yaws, place, whiten))
    left = np.concatenate([one.roll for one in records]) - _design(records, yaws, place, np.ones(1)) @ linear
    return np.split(left, np.cumsum([one.roll.size for one in records])[:-1])


def _whitening(left: Sequence[FloatArray], order: int | None = None) -> FloatArray:
    """Return the filter 1, -a1, -a2, ... that whitens what is left over, of the order that Akaike's criterion takes
    where none is given."""
    orders = ORDERS if order is None else (order,)
    most = max(order for order in orders if order == orders[0] or order < min(part.size for part in left) // 8)
    now = np.concatenate([part[most:] for part in left])
    past = np.vstack(
        [np.column_stack([part[most - lag : part.size - lag] for lag in range(1, most + 1)]) for part in left]
    )
    best, found = math.inf, np.ones(1)
    for order in (order for order in orders if order <= most):
        # least squares, not correlations: these leak from the waves into what they leave quiet
        a, squares = _solved(now, past[:, :order])
        criterion = now.size * math.log(max(squares, 1.0e-300)) + 2.0 * order
        if criterion < best:
            best, found = criterion, np.concatenate(([1.0], -a))
    return found


def _errors(
    records: Sequence[RollRecord],
    yaws: Sequence[FloatArray],
    place: tuple[float, float],
    whiten: FloatArray,
    variance: float,
) -> tuple[float, float, float, float]:
    """Return the standard errors of frequency, damping ratio, b_delta and b_r.

    Those of the first two are by the curvature of the likelihood over a step as long as they are, the noise fitted anew
    at each; those of the others are what is left for known roll, and what they move with it.
    """
    _, design = _whitened(records, yaws, place, whiten)
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv((design / scale).T @ (design / scale), rcond=1.0e-14, hermitian=True)
    known = variance * np.diag(inverse)[:2] / scale[:2] ** 2

    def at(first: float, second: float) -> tuple[float, FloatArray]:
        there = (place[0] * math.exp(first), place[1] * math.exp(second))
        cost, _, linear = _likelihood(records, yaws, there, whiten)
        return cost, linear[:2]

    steps = np.array([1.0e-3, 1.0e-2])
    least = at(0.0, 0.0)[0]
    for number in range(2):
        for _ in range(STEPS_MOST):
            one = np.where(np.arange(2) == number, steps, 0.0)
            rise = 0.5 * (at(*one)[0] + at(*-one)[0]) - least
            if rise > 1.0:
                steps[number] *= max(math.sqrt(2.0 / rise), 0.1) if rise > 4.0 else 1.0
                break
            steps[number] *= 2.0
            if steps[number] > 0.7:
                break
    curve = np.empty((2, 2))
    slopes = np.empty((2, 2))
    for number in range(2):
        one = np.where(np.arange(2) == number, steps, 0.0)
        (up, high), (down, low) = at(*one), at(*-one)
        curve[number, number] = (up + down - 2.0 * least) / steps[number] ** 2
        slopes[:, number] = (high - low) / (2.0 * steps[number])
    cross = sum(
        sign * at(a * steps[0], b * steps[1])[0] for a, b, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
    )
    curve[0, 1] = curve[1, 0] = cross / (4.0 * steps[0] * steps[1])
    values, turned = np.linalg.eigh(0.5 * curve)
    spread = turned @ np.diag(1.0 / np.maximum(values, FLATTEST)) @ turned.T
    moved = np.diag(slopes @ spread @ slopes.T)
    first, second = np.sqrt(np.diag(spread))
    b_delta, b_r = np.sqrt(known + moved)
    return float(first) * place[0], float(second) * place[1], float(b_delta), float(b_r)
