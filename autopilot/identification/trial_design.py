"""Which trial tells most about a boat in the water and the time there is: candidates, their track, and the bound.

For each candidate the boat in the vessel file is sailed in thought; as much of it as the water holds is scored by the
root mean square of the least relative standard errors (Cramer and Rao) of K, T and, where the boat has any, n3, with n0
unknown beside them. The grid is refined once around the best. The vessel file's model must be about right: a design
is as good as the guess it starts from (Goodwin and Payne 1977, chapter 6).

What a trial can tell at best: Fisher's information and the bound of Cramer and Rao, before it is sailed.

With white noise on heading and yaw rate the information on the parameters theta is

    I = sum over samples of (dr/dtheta)'(dr/dtheta)/s_r^2 + (dpsi/dtheta)'(dpsi/dtheta)/s_psi^2

with each segment's unknown initial rate and heading projected out; no unbiased estimate has a covariance below
its inverse. Rudder and speed are taken as known. Source: Ljung 1999, sections 7.4 and 9.4; Goodwin and Payne 1977.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.guidance.manoeuvres import BinaryHelm, zigzag_side
from autopilot.identification.output_error import fit_steps
from autopilot.identification.residuals import Fitted, Problem, initial_state, typical_rate, units
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.norrbin import Norrbin, at_speed, rate_step
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.models.weather import RaceAndWind

Helm = Callable[[float, float], float]
"""Rudder order [rad] at a time [s] and heading [rad]."""

INFORMED = 1.0e-12
"""Directions of the parameters with less than this share of the largest information are not determined at all."""


class InstrumentNoise(NamedTuple):
    """Standard deviations of white noise on yaw rate [rad/s] and heading [rad]; inf where not measured."""

    rate: float
    heading: float


def cramer_rao(
    runs: Sequence[Run],
    model: Norrbin,
    free: tuple[str, ...],
    noise: InstrumentNoise,
    around: RaceAndWind | None = None,
    train: RudderTrain = DIRECT,
) -> dict[str, float]:
    """Return the least standard error that an unbiased estimate from `runs` can have, by parameter in `free`.

    free: of gain [1/s], time_constant [s], n3 [s^2/rad^2], n0 [rad/s] and those of propeller, wind and the rudder's
    train; all of them unknown together. inf where the runs do not tell a parameter. What was measured does not count,
    only what rudder, speed and times say.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    scale = typical_rate(segments)
    fitted = Fitted(model, around or RaceAndWind(), train)
    steps = fit_steps(segments, model, scale)
    problem = Problem(segments, steps, fitted, free, scale, units(fitted, scale, segments))
    z = problem.vector([initial_state(segment) for segment in segments])
    weight = np.array([1.0 / noise.rate, 1.0 / noise.heading])
    total = np.zeros((len(free), len(free)))
    for _, slope in problem.response(z):
        weighted = (slope * weight[:, None]).reshape(-1, len(free) + 2)
        total += _without_initial_state(weighted, len(free))
    return dict(zip(free, _least_errors(total) * problem.parameter_scale(z), strict=True))


def _without_initial_state(slope: FloatArray, F: int) -> FloatArray:
    """Return the information on the first F parameters with the others unknown: the Schur complement."""
    own = slope[:, F:]
    rest = slope[:, :F] - own @ np.linalg.lstsq(own, slope[:, :F], rcond=None)[0]
    return np.asarray(rest.T @ rest)


def _least_errors(information: FloatArray) -> FloatArray:
    """Return the roots of the inverse's diagonal, inf where a direction that matters holds no information."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    informed = size > 0.0
    result = np.full(size.size, np.inf)
    if not informed.any():
        return result
    scaled = information[np.ix_(informed, informed)] / np.outer(size[informed], size[informed])
    values, vectors = np.linalg.eigh(scaled)
    inverse = np.where(values > INFORMED * values[-1], 1.0 / np.maximum(values, INFORMED * values[-1]), np.inf)
    # 0 times inf: a direction without information counts only for the parameters it moves
    share = np.where(vectors**2 > INFORMED, vectors**2, 0.0)
    parts = np.multiply(share, inverse, out=np.zeros_like(share), where=share > 0.0)
    result[informed] = np.sqrt(parts.sum(axis=1)) / size[informed]
    return result


def planned(model: Norrbin, gear: SteeringGear, helm: Helm, duration: float, spacing: float, speed: float) -> Run:
    """Return the run that a trial would be: the boat from rest in yaw, sampled every `spacing` [s], at `speed` [m/s].

    helm: who orders the rudder. Heading and rate are without noise.
    """
    boat = at_speed(model, speed)
    table = np.empty((max(round(duration / spacing), 8) + 1, 4))
    heading = rate = rudder = 0.0
    for k in range(table.shape[0]):
        table[k] = k * spacing, heading, rate, rudder
        moved = gear_step(gear, rudder, helm(k * spacing, heading), spacing)
        following = rate_step(boat, rate, 0.5 * (rudder + moved), spacing)
        heading += 0.5 * spacing * (rate + following)
        rate, rudder = following, moved
    time, headings, rates, rudders = table.T.copy()
    return Run("planned", (Segment(time, headings, rates, rudders, np.full(time.size, speed)),))


def zigzag_helm(rudder: float, heading_change: float) -> Helm:
    """Return the helm of a zigzag: `rudder` [rad] to starboard, over each time the heading has changed that much."""
    side = 1

    def order(time: float, heading: float) -> float:
        nonlocal side
        side = zigzag_side(side, 0.0, heading, heading_change)
        return side * rudder

    return order


SHORTEST_S = 10.0
COURSES = np.radians(np.arange(-85.0, 95.0, 5.0))
"""Courses [rad] against the long side that are tried; beyond them lies the same water turned round."""
REFINED = (0.7, 0.85, 1.0, 1.2, 1.4)
SEED = 1
SWING = math.radians(45.0)
KINDS = ("zigzag", "turning", "prbs")

Progress = Callable[[int, int], None]


class Water(NamedTuple):
    """The rectangle the trial must stay in: length and width [m], less `margin` [m] on every side, and time [s]."""

    length: float
    width: float
    time: float
    margin: float = 0.0


class Boat(NamedTuple):
    """What the design starts from; rudder_max [rad], speed [m/s], spacing of samples [s]."""

    model: Norrbin
    gear: SteeringGear
    noise: InstrumentNoise
    rudder_max: float
    speed: float
    spacing: float = 0.1


class Candidate(NamedTuple):
    """A trial: rudder [rad], and what goes with its kind: execute angle [rad] of a zigzag, seconds at each angle of
    turning (rudder, -rudder, rudder/2, -rudder/2), seconds of one step of a binary sequence."""

    kind: str
    rudder: float
    second: float


class Berth(NamedTuple):
    """How a track lies in the water: course [rad] to starboard of the long side at the beginning; where it begins [m]
    from the short side behind and from the long side to port; length and width [m] that it takes."""

    course: float
    behind: float
    to_port: float
    length: float
    width: float


class Design(NamedTuple):
    """A candidate, how long [s] of it the water holds, its berth, and the least standard errors by parameter."""

    candidate: Candidate
    duration: float
    berth: Berth
    errors: dict[str, float]
    score: float


def designs(boat: Boat, water: Water, kinds: Sequence[str] = KINDS, progress: Progress | None = None) -> list[Design]:
    """Return the best design of each kind, the best of all first; a kind that the water does not hold is left out."""
    found = []
    grid = [list(_grid(kind, boat)) for kind in kinds]
    total, done = sum(len(one) + len(REFINED) ** 2 for one in grid), 0
    for candidates in grid:
        best: Design | None = None
        for round_ in (candidates, None):
            tried = round_ if round_ is not None else list(_around(best, boat)) if best is not None else []
            for candidate in tried:
                best = _better(best, design_of(boat, water, candidate))
                done += 1
                if progress is not None:
                    progress(done, total)
        if best is not None:
            found.append(best)
    return sorted(found, key=lambda design: design.score)


def _better(best: Design | None, other: Design | None) -> Design | None:
    if best is None or (other is not None and other.score < best.score):
        return other
    return best


def _grid(kind: str, boat: Boat) -> Iterator[Candidate]:
    T = boat.model.time_constant
    seconds = {
        "zigzag": np.radians([5.0, 10.0, 15.0, 20.0, 30.0, 45.0]),
        "turning": np.array([2.0, 4.0, 8.0]) * max(T, 1.0),
        "prbs": np.array([0.5, 1.0, 2.0, 4.0]) * max(T, 0.5),
    }
    for share in (0.25, 0.5, 0.75, 1.0):
        for second in seconds[kind]:
            yield Candidate(kind, share * boat.rudder_max, float(second))


def _around(best: Design, boat: Boat) -> Iterator[Candidate]:
    kind, rudder, second = best.candidate
    for share in REFINED:
        for other in REFINED:
            if share != 1.0 or other != 1.0:
                yield Candidate(kind, min(share * rudder, boat.rudder_max), other * second)


def design_of(boat: Boat, water: Water, candidate: Candidate) -> Design | None:
    """Return what a candidate would give in the water, None where it holds less than ten seconds of it."""
    run = planned(boat.model, boat.gear, helm_of(candidate), water.time, boat.spacing, boat.speed)
    segment = run.segments[0]
    rows, berth = berthed(*track_of(segment), water)
    if candidate.kind == "turning" and rows:
        # only whole turns are sailed
        whole = math.floor(float(segment.time[rows - 1]) / candidate.second + 1.0e-9) * candidate.second
        rows = int(np.searchsorted(segment.time, whole + 1.0e-9))
    if rows < 2 or segment.time[rows - 1] < SHORTEST_S:
        return None
    kept = Run(run.source, (Segment(*(array[:rows] if array.size else array for array in segment)),))
    has_n3 = boat.model.n3 > 0.0
    free = ("gain", "time_constant", *(("n3",) if has_n3 else ()), "n0")
    errors = cramer_rao([kept], boat.model, free, boat.noise)
    relative = [errors["gain"] / boat.model.gain, errors["time_constant"] / boat.model.time_constant]
    relative += [errors["n3"] / boat.model.n3] if has_n3 else []
    score = math.sqrt(sum(one * one for one in relative) / len(relative))
    return Design(candidate, float(segment.time[rows - 1]), berth, errors, score)


def helm_of(candidate: Candidate) -> Helm:
    """Return who orders the rudder in a candidate; fresh, for one run."""
    kind, rudder, second = candidate
    if kind == "zigzag":
        return zigzag_helm(rudder, second)
    if kind == "turning":
        angles = turning_angles(rudder)
        return lambda time, heading: angles[int(time / second) % len(angles)]
    binary = BinaryHelm(second, SWING, SEED)
    return lambda time, heading: rudder * binary.side(time, heading)


def turning_angles(rudder: float) -> tuple[float, ...]:
    """Return the angles [rad] of the turns, one after another, again and again."""
    return rudder, -rudder, 0.5 * rudder, -0.5 * rudder


def track_of(segment: Segment) -> tuple[FloatArray, FloatArray]:
    """Return how far [m] ahead and to starboard of the first course the boat is in each row."""
    steps = segment.speed[1:] * np.diff(segment.time)
    middle = 0.5 * (segment.heading[1:] + segment.heading[:-1])
    ahead, abeam = (np.concatenate(([0.0], np.cumsum(steps * f(middle)))) for f in (np.cos, np.sin))
    return ahead, abeam


def berthed(ahead: FloatArray, abeam: FloatArray, water: Water) -> tuple[int, Berth]:
    """Return how many rows of a track the water holds when it lies in it at best, and how it lies."""
    best, berth = 0, Berth(0.0, 0.0, 0.0, 0.0, 0.0)
    room = water.length - 2.0 * water.margin, water.width - 2.0 * water.margin
    for course in COURSES:
        along = ahead * math.cos(course) - abeam * math.sin(course)
        across = ahead * math.sin(course) + abeam * math.cos(course)
        lows, highs = ([f.accumulate(axis) for axis in (along, across)] for f in (np.minimum, np.maximum))
        fits = (highs[0] - lows[0] <= room[0]) & (highs[1] - lows[1] <= room[1])
        rows = fits.size if fits.all() else int(np.argmin(fits))
        if rows > best:
            last = rows - 1
            best = rows
            berth = Berth(
                float(course),
                water.margin + float(-lows[0][last]),
                water.margin + float(-lows[1][last]),
                float(highs[0][last] - lows[0][last]),
                float(highs[1][last] - lows[1][last]),
            )
    return best, berth
