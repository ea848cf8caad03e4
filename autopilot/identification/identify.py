"""From recorded runs to a model with its standard errors, and to a plain statement of what they cannot tell.

Where a fit begins: the best of a grid of time constants, for each of which the linear model is solved outright.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import (
    LARGEST_RELATIVE_ERROR,
    USUAL,
    Identified,
    Question,
    SteadyTurns,
    Steps,
    identified_from,
)
from autopilot.identification.likelihood_model import (
    ORDERED,
    as_doubtful,
    beside_surroundings,
    follows_surely,
    likeliest,
    likeliest_fit,
    ordered,
)
from autopilot.identification.model_choice import CUBIC, START_N3, extended, may_extend
from autopilot.identification.output_error import NOISE_ROUNDS, Solution, solve
from autopilot.identification.prediction_bands import in_the_race
from autopilot.identification.residuals import Fitted, RunTrims, initial_state, own_trims, triangle, typical_rate
from autopilot.identification.runs import (
    FloatArray,
    Run,
    Segment,
    has_propeller,
    has_wind,
    mean_speed,
    shortest_time_constant,
)
from autopilot.identification.simulation import (
    RATE_BOUND_RAD_S,
    Forcing,
    at_samples,
    forcing,
    forcing_in_parts,
    linear_responses,
)
from autopilot.identification.two_stage import CubicDamping, cubic_damping_stage
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, folds, yaw_acceleration

LINEAR = ("gain", "time_constant", "n0")
STEADY_ROUNDS = 3
"""K and the n3 that the steady turns give for it settle within a per cent in as many rounds."""

LEAST_RUDDER_MOVEMENT_RAD = 0.005
LEAST_SPEED_M_S = 0.02
LEAST_EXPLAINED = 0.05
"""Share of the motion that the rudder must explain before anything is fitted to it."""

CLEARLY_BACKWARDS = 0.3
"""Share of the motion that a rudder of opposite sign must explain before the sign is called wrong."""

GRID_POINTS = 18
EVERY = 2
"""Every so many points of the grid are tried first, and then those beside the best."""
PAST_THE_BEST = 4
STEPS_PER_TIME_CONSTANT = 4.0
ROUGH_STEPS = 2.0
"""The same on the grid of linear models: exact to a few thousandths, which is enough to begin with."""
SHORTEST_TIME_CONSTANT_S = 0.05
LONGEST_TIME_CONSTANT_S = 500.0


LARGEST_TABLE = 4_000_000
"""Numbers that the motions of models simulated side by side may take."""

WELL_EXPLAINED = 0.8
"""Share of the motion from which on a best T that lies behind is believed."""


TOO_QUICK = 1.5
"""Times the shortest T that samples tell, which is the next point of the grid: no T of a boat is found below it."""


class StartingPoint(NamedTuple):
    """A linear model near the best one, and the share of the motion's variance that it explains.

    The gain is negative where the record's rudder turns the boat to the other side.
    """

    model: Norrbin
    explained: float


def starting_point(runs: Sequence[Run], reference_speed: float) -> StartingPoint:
    """Return the best linear model on a logarithmic grid of T, from 0.05 s, or what the samples tell, to 500 s.

    With n3 = 0 the motion is linear in K, in n0 and in the initial rates: three simulations per T give them by
    least squares, on yaw rates where measured and on headings elsewhere.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    duration = max(float(segment.time[-1] - segment.time[0]) for segment in segments)
    longest = max(min(LONGEST_TIME_CONSTANT_S, duration), 2.0 * SHORTEST_TIME_CONSTANT_S)
    grid = np.geomspace(longest, SHORTEST_TIME_CONSTANT_S, GRID_POINTS).tolist()
    shortest = shortest_time_constant(segments)
    times = [T for T in grid if shortest <= T] or [shortest]
    # from the slow end, where steps are long: a short T costs most and is seldom worth trying
    tried: dict[int, StartingPoint] = {}
    for index in range(0, len(times), EVERY):
        tried[index] = _linear_fit(segments, times[index], reference_speed)
        best = max(tried, key=lambda at: tried[at].explained)
        # a regular zigzag is explained by half by a slow boat that turns the wrong way: no reason to stop there
        found = tried[best].model.gain > 0.0 and tried[best].explained > WELL_EXPLAINED
        if found and index - best >= PAST_THE_BEST:
            break
    for index in range(max(best - EVERY + 1, 0), min(best + EVERY, len(times))):
        if index not in tried:
            tried[index] = _linear_fit(segments, times[index], reference_speed)
    return max(tried.values(), key=lambda point: point.explained)


def unstable_starting_point(runs: Sequence[Run], linear: Norrbin) -> Norrbin:
    """Return a course-unstable model (n1 = -1) near the best one, on a grid around the linear model.

    K and T are tried from a quarter to four times those of `linear`, n3 so that the boat left alone would turn
    at a third to three times the typical rate: -r + n3 r^3 = 0 at r = n3^(-1/2).
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    rate = typical_rate(segments)
    factors = np.geomspace(0.25, 4.0, 7)
    candidates = [
        linear._replace(
            gain=linear.gain * k, time_constant=linear.time_constant * t, n1=-1.0, n3=1.0 / (turn * rate) ** 2
        )
        for k in factors
        for t in factors
        for turn in np.geomspace(1.0 / 3.0, 3.0, 7)
    ]
    steps = forcing(segments, linear.time_constant * float(factors[0]) / STEPS_PER_TIME_CONSTANT)
    states = [initial_state(segment) for segment in segments]
    together = max(LARGEST_TABLE // (steps.step.size + 1), 1)
    misfits = [
        _misfits(candidates[first : first + together], segments, steps, states)
        for first in range(0, len(candidates), together)
    ]
    return candidates[int(np.argmin(np.concatenate(misfits)))]


def _misfits(
    candidates: Sequence[Norrbin], segments: Sequence[Segment], steps: Forcing, states: Sequence[tuple[float, float]]
) -> FloatArray:
    """Return the sum of squared errors of each candidate, all of them simulated side by side."""
    rate, turned = _side_by_side(candidates, steps, [start for start, _ in states])
    total = np.zeros(len(candidates))
    for s, segment in enumerate(segments):
        measured_rate = bool(np.isfinite(segment.rate).any())
        measured = segment.rate if measured_rate else segment.heading - states[s][1]
        left, share = steps.samples[s]
        nodes = rate if measured_rate else turned
        response = nodes[left] * (1.0 - share)[:, None] + nodes[left + 1] * share[:, None]
        total += np.nansum((response - measured[:, None]) ** 2, axis=0)
    return total


@np.errstate(over="ignore", invalid="ignore")  # a model that runs away is bounded, not an accident
def _side_by_side(
    candidates: Sequence[Norrbin], steps: Forcing, initial: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Return rate [rad/s] and angle turned [rad] of each candidate at the nodes, both of shape (M+S, candidates), by
    Runge and Kutta's steps."""
    columns = np.array(candidates).T
    model = Norrbin(*columns)
    ratio = np.maximum(np.abs(steps.speed) / candidates[0].reference_speed, SPEED_FLOOR_RATIO)
    rate = np.zeros((steps.step.size + steps.first.size, len(candidates)))
    turned = np.zeros_like(rate)
    rate[steps.first] = np.array(initial)[:, None]
    drives = zip(steps.begin.tolist(), steps.step.tolist(), steps.rudder.T.tolist(), ratio.T.tolist(), strict=True)
    for node, h, rudder, scale in drives:
        boats = [at_speed_ratio(model, each) for each in scale]
        r: Any = rate[node]
        k1 = yaw_acceleration(boats[0], r, rudder[0])
        k2 = yaw_acceleration(boats[1], r + 0.5 * h * k1, rudder[1])
        k3 = yaw_acceleration(boats[1], r + 0.5 * h * k2, rudder[1])
        k4 = yaw_acceleration(boats[2], r + h * k3, rudder[2])
        moved = r + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        rate[node + 1] = np.nan_to_num(np.clip(moved, -RATE_BOUND_RAD_S, RATE_BOUND_RAD_S), nan=RATE_BOUND_RAD_S)
        turned[node + 1] = turned[node] + h * (r + h / 6.0 * (k1 + k2 + k3))
    return rate, turned


def _linear_fit(segments: Sequence[Segment], T: float, reference_speed: float) -> StartingPoint:
    unit = Norrbin(1.0, T, reference_speed=reference_speed)
    rated = [bool(np.isfinite(segment.rate).any()) for segment in segments]
    rows, open_rows, state, goes_on = [], np.empty(0), np.empty((2, 3)), False
    for part in forcing_in_parts(segments, T / ROUGH_STEPS):
        steps = part.forcing
        begins, begun = np.outer([0.0, 0.0, 1.0], np.ones(steps.first.size)), np.zeros((3, steps.first.size))
        if goes_on:
            begins[:, 0], begun[:, 0] = state
        responses = linear_responses(unit, steps, begins)
        for s, (number, those) in enumerate(zip(part.segments, part.rows, strict=True)):
            segment, by_rate = segments[number], rated[number]
            answers = [
                at_samples(motion[0], steps, s) if by_rate else at_samples(motion[1], steps, s) + begun[k, s]
                for k, motion in enumerate(responses)
            ]
            measured = segment.rate if by_rate else segment.heading - initial_state(segment)[1]
            gain, trim, rate = answers
            left = measured[those]
            own = [rate] if by_rate else [np.ones(left.size), rate]
            table = np.stack([*own, gain, trim, left], axis=1)[np.isfinite(left)]
            if s == 0 and goes_on:
                table = np.concatenate([open_rows, table])
            if part.goes_on and s == len(part.segments) - 1:
                open_rows = triangle(table)
            else:
                rows.append(_without(table[:, : len(own)], table[:, len(own) :]))
        state = np.stack([motion[:, -1] for motion in responses], axis=1)
        state[1] += begun[:, -1]
        goes_on = part.goes_on
    table = np.concatenate(rows)
    return _solve(table[:, :-1], table[:, -1], unit)


def _without(own: FloatArray, columns: FloatArray) -> FloatArray:
    """Return what is left of a least-squares problem's columns, three rows at most, once the segment's own unknowns,
    the factors of `own`, have taken theirs: the other unknowns and the sum of squares come out the same.

    With hundreds of stretches between gaps, a table with all of their unknowns takes a hundred times as long.
    """
    left = triangle(np.concatenate([own, columns], axis=1))
    pivots = np.abs(np.diag(left)[: own.shape[1]])
    count = int(np.count_nonzero(pivots > DEPENDENT * np.linalg.norm(own[:, : pivots.size], axis=0)))
    if count < pivots.size:
        return _without(own[:, :count], columns)
    rest = left[own.shape[1] :, own.shape[1] :]
    # rounding is left of a column that they take whole
    return np.where(np.abs(rest) > DEPENDENT * np.linalg.norm(columns, axis=0), rest, 0.0)


DEPENDENT = 1.0e-10
"""The share of a column beside others from which on it is taken for a combination of those."""


def _solve(columns: FloatArray, left: FloatArray, unit: Norrbin) -> StartingPoint:
    """Columns: the responses to K = 1 and to n0 = -1."""
    coefficients = np.linalg.lstsq(columns, left, rcond=None)[0]
    rest = float(np.sum((left - columns @ coefficients) ** 2))
    others = columns[:, 1:]
    total = float(np.sum((left - others @ np.linalg.lstsq(others, left, rcond=None)[0]) ** 2))
    explained = 1.0 - rest / total if total > 0.0 else 0.0
    return StartingPoint(unit._replace(gain=float(coefficients[0]), n0=-float(coefficients[1])), explained)


def identify(runs: Sequence[Run], question: Question = USUAL) -> Identified:
    """Return the output-error estimate from all runs together, scaled with speed.

    A "norrbin" has n3: from steady turns where given, otherwise fitted with the rest and dropped again, with the
    reason, where it ends on its bound or cannot be distinguished from zero: the linear model that is left is stable
    everywhere. Of a course-unstable boat n3 is always fitted, and there is no smaller model to fall back to. Parts of
    the rudder's train, and n2, are left out again where they cannot be distinguished from 0 or would let the boat turn
    without bound. The train goes neither with steady turns nor with a course-unstable boat.

    Raises InputError where the rudder never moves, the boat makes no way, the motion does not follow the
    rudder, or follows it backwards.
    """
    kind, train, turns = question.kind, question.rudder_train, question.steady_turns
    speed = mean_speed(runs) if question.reference_speed is None else question.reference_speed
    check_excitation(runs, speed)
    fits = 1 if kind == "nomoto" else 3 if has_propeller(runs) or has_wind(runs) or train else 2
    steps = Steps(question.progress, total=1 + NOISE_ROUNDS * (fits + question.quadratic))
    start = starting_point(runs, speed)
    check_order_of_cause(runs, start)
    fit = _Fit(runs, steps, own_trims(runs, question.trim))
    if _asks_likelihood(question, fit.trims):
        linear = start.model if start.model.gain > 0.0 and start.explained > LEAST_EXPLAINED else None
        fitted = ORDERED if ordered(runs) and not train else train
        likely = likeliest(runs, speed, linear, question._replace(rudder_train=fitted), steps)
        if likely is not None:
            if not follows_surely(likely):
                check_response(runs, start)
            return as_doubtful(_with_surroundings(fit, likely), runs, steps)
    check_response(runs, start)
    steps.next()
    if question.course_unstable:
        return _unstable(fit, unstable_starting_point(runs, start.model), question.quadratic)
    if kind == "nomoto":
        plain = identified_from(fit.solve(start.model, LINEAR), {}, runs)
        return extended(runs, plain, train, steps, (*LINEAR, *fit.trims.names), fit.trims)
    if turns is not None:
        return _with_steady_turns(fit, fit.solve(start.model, LINEAR), turns, question.gain)
    return _norrbin(fit, start.model, question.quadratic, train)


class _Fit(NamedTuple):
    """What all fits of one identification share."""

    runs: Sequence[Run]
    steps: Steps
    trims: RunTrims

    def solve(self, start: Norrbin, free: tuple[str, ...], rounds: int = NOISE_ROUNDS) -> Solution:
        """Return the best model near `start` with `free`, and the runs' own trims, fitted."""
        named = (*free, *self.trims.names)
        return solve(self.runs, Fitted(start, trims=self.trims), named, self.steps.next, rounds)


def _asks_likelihood(question: Question, trims: RunTrims) -> bool:
    return (
        question.kind == "norrbin"
        and question.weighting == "likelihood"
        and question.steady_turns is None
        and not question.quadratic
        and not trims.names
        and set(question.rudder_train) <= set(ORDERED)
    )


def _with_surroundings(fit: _Fit, likely: Identified) -> Identified:
    """Return the answer with propeller, wind and drift where the runs show them; of a boat that is clearly
    course-stable."""
    if likely.model.n1 < 0.0 or "T" in likely.unidentifiable:
        return likely
    named = (name for name in ("dead_band", *ORDERED) if name not in likely.unidentifiable)
    train = tuple(name for name in named if getattr(likely.train, name) > 0.0)
    more = extended(fit.runs, likely, train, fit.steps, CUBIC, fit.trims) if may_extend(fit.runs) else likely
    if more.around is not None:
        runs, speed = in_the_race(more.around, fit.runs, more.model.reference_speed)
        fitted = (
            None if speed == more.model.reference_speed else likeliest_fit(runs, speed, more.model, train, fit.steps)
        )
        whole = beside_surroundings(more, likely, fit.runs, fit.steps) or at_least_as_doubtful(more, likely)
        return whole._replace(likely=fitted[0] if fitted else likely.likely)
    notes = tuple(dict.fromkeys((*likely.notes, *more.notes)))
    return likely._replace(unidentifiable={**more.unidentifiable, **likely.unidentifiable}, notes=notes)


def at_least_as_doubtful(more: Identified, likely: Identified) -> Identified:
    """Return the answer `more`, which the residuals weigh, with the doubt that gusts make of K, T, n3 and n0 in it.

    Of the rate's residuals, or the heading's where no rate was measured, what propeller and wind explain is gone, and
    the likelihood's errors are less by that share; what is fitted besides makes nothing better known.
    """
    shares = (now.size / before.size for now, before in zip(more.noise, likely.noise, strict=True) if before.size > 0.0)
    left = min(next(shares, 1.0), 1.0)
    errors, grown = dict(more.standard_errors), np.ones(len(more.free))
    for name in likely.free:
        own, least = errors.get(name), likely.standard_errors[name]
        # of K and T, which differ between the two, the same share
        scale = abs(getattr(more.model, name) / getattr(likely.model, name)) if name in LINEAR[:2] else 1.0
        if own is not None and least is not None and own < left * least * scale:
            wanted = left * least * scale
            errors[name], grown[more.free.index(name)] = wanted, wanted / max(own, 1.0e-300)
    covariance = None if more.covariance is None else more.covariance * np.outer(grown, grown)
    return more._replace(standard_errors=errors, covariance=covariance, is_blind=False)


def _norrbin(fit: _Fit, start: Norrbin, quadratic: bool, rudder_train: Sequence[str]) -> Identified:
    """Return the model with n3 and n2 as far as the runs tell them, and with what else they show."""
    runs, reasons = fit.runs, dict[str, str]()
    found = fit.solve(start, CUBIC)
    if reason := _why_no_cubic(found):
        reasons["n3"] = reason
    if quadratic:
        n3 = max(found.model.n3, START_N3 / typical_rate([s for run in runs for s in run.segments]) ** 2)
        asymmetric = fit.solve(found.model._replace(n3=n3), (*CUBIC, "n2"))
        if reason := _why_no_quadratic(asymmetric):
            reasons["n2"] = reason
        else:
            found = asymmetric
            reasons.pop("n3", None)
    base = (*CUBIC, "n2") if "n2" in found.free else CUBIC
    if "n3" in reasons:
        found = fit.solve(found.model._replace(n3=0.0), LINEAR)
    plain = identified_from(found, reasons, runs)
    result = extended(runs, plain, rudder_train, fit.steps, (*base, *fit.trims.names), fit.trims)
    kept = {symbol: reason for symbol, reason in reasons.items() if symbol == "n2"}
    return result._replace(unidentifiable={**kept, **result.unidentifiable})


def _unstable(fit: _Fit, start: Norrbin, quadratic: bool) -> Identified:
    solution, reasons = fit.solve(start, CUBIC), {}
    if "n3" in solution.at_bound:
        raise InputError(
            f"{sources_of(fit.runs)}: a course-unstable model (n1 = -1) does not fit: n3 ends at 0, and nothing would "
            "bound its turning; leave --course-unstable out."
        )
    if quadratic:
        asymmetric = fit.solve(solution.model, (*CUBIC, "n2"))
        if reason := _why_no_quadratic(asymmetric):
            reasons["n2"] = reason
        else:
            solution = asymmetric
    return identified_from(solution, reasons, fit.runs)


def steady_damping(turns: SteadyTurns, gain: float, reference_speed: float) -> CubicDamping:
    """Return n3 at the reference speed [m/s] from steady turns, K [1/s] held at that speed."""
    ratio = np.ones(turns.rate.size) if turns.speed is None else turns.speed / reference_speed
    # with the rate in units of the speed ratio every turn obeys the equation of the reference speed
    return cubic_damping_stage(turns.rudder, turns.rate / ratio, gain)


def _with_steady_turns(fit: _Fit, linear: Solution, turns: SteadyTurns, gain: float | None) -> Identified:
    """Fit the rest with n3 held at what the steady turns give for the K of the round before."""
    solution = linear
    for _ in range(STEADY_ROUNDS):
        K = solution.model.gain if gain is None else gain
        cubic = steady_damping(turns, K, solution.model.reference_speed)
        if cubic.n3 <= 0.0:
            reason = (
                f"n3: the steady turns give {cubic.n3:.3g} s^2/rad^2 with K = {K:.3g} 1/s, which would let the boat "
                "turn without bound, so it is held at 0; check the signs and units of the steady turns."
            )
            return identified_from(linear, {"n3": reason}, fit.runs)._replace(steady=cubic)
        solution = fit.solve(solution.model._replace(n3=cubic.n3), LINEAR, rounds=2)
    found = identified_from(solution, {}, fit.runs)
    return found._replace(standard_errors={**found.standard_errors, "n3": cubic.standard_error}, steady=cubic)


def _why_no_cubic(solution: Solution) -> str:
    n3, error = solution.model.n3, solution.standard_error("n3") or 0.0
    remedy = "steady turns at large rudder angles would tell it (--steady-turns)."
    if "n3" in solution.at_bound:
        return (
            "n3: the fit ends at its bound 0 (left alone it would turn negative and the simulation diverge), so it "
            f"is held at 0; {remedy}"
        )
    if error > LARGEST_RELATIVE_ERROR * n3:
        return (
            f"n3: {n3:.3g} with a standard error of {error:.2g} s^2/rad^2 cannot be distinguished from 0, so it is "
            f"held at 0; {remedy}"
        )
    return ""


def _why_no_quadratic(solution: Solution) -> str:
    model, error = solution.model, solution.standard_error("n2") or 0.0
    if error > LARGEST_RELATIVE_ERROR * abs(model.n2):
        return (
            f"n2: {model.n2:.3g} with a standard error of {error:.2g} s/rad cannot be distinguished from 0, so it is "
            "held at 0; turns to both sides at large rudder angles would tell it."
        )
    if folds(model):
        return (
            f"n2: {model.n2:.3g} s/rad with n3 {model.n3:.3g} s^2/rad^2 would let the boat turn faster and faster to "
            "one side under a rudder that stands still, so it is held at 0; turns to both sides at large rudder angles "
            "would tell them apart."
        )
    return ""


def sources_of(runs: Sequence[Run]) -> str:
    """Return where the runs came from, in words."""
    return ", ".join(run.source for run in runs)


def check_excitation(runs: Sequence[Run], speed: float) -> None:
    """Raise InputError where the rudder never moves or the boat makes no way at a mean `speed` [m/s]."""
    movement = max(float(np.ptp(segment.rudder)) for run in runs for segment in run.segments)
    if movement < LEAST_RUDDER_MOVEMENT_RAD:
        raise InputError(
            f"{sources_of(runs)}: the rudder never moves (by {np.degrees(movement):.2f} deg in all), so nothing can be "
            "identified; record a zigzag."
        )
    if speed < LEAST_SPEED_M_S:
        raise InputError(
            f"{sources_of(runs)}: the boat makes no way (mean speed {speed:.3f} m/s), so its rudder has nothing to "
            "steer with; check the speed column and its unit."
        )


def check_order_of_cause(runs: Sequence[Run], start: StartingPoint) -> None:
    """Raise InputError where the rudder seems to turn the boat at once, and explains no zigzag's share of the motion.

    The other way round it is no wonder: a pilot answers each wave's turning with the rudder, at once. Either sign of K
    comes out of that, whichever the rudder's column has.
    """
    shortest = max(
        shortest_time_constant([segment for run in runs for segment in run.segments]), SHORTEST_TIME_CONSTANT_S
    )
    if LEAST_EXPLAINED < start.explained < WELL_EXPLAINED and start.model.time_constant < TOO_QUICK * shortest:
        raise InputError(
            f"{sources_of(runs)}: rudder and motion go together at once, quicker than a boat answers its rudder: so a "
            "pilot or a hand moves it against waves, and nothing can be identified from that; record a zigzag."
        )


def check_response(runs: Sequence[Run], start: StartingPoint) -> None:
    """Raise InputError where the motion does not follow the rudder, or follows it backwards."""
    if start.model.gain < 0.0 and start.explained > CLEARLY_BACKWARDS:
        raise InputError(
            f"{sources_of(runs)}: the boat turns against its rudder (K = {start.model.gain:.3g} 1/s explains "
            f"{100.0 * start.explained:.0f} % of the motion); rudder must be positive to starboard and heading "
            "clockwise: if the recorded rudder has the opposite sign, pass --reverse-rudder; if you did, leave it out."
        )
    if start.model.gain <= 0.0 or start.explained < LEAST_EXPLAINED:
        raise InputError(
            f"{sources_of(runs)}: the motion does not follow the rudder (it explains "
            f"{100.0 * max(start.explained, 0.0):.0f} % of it), so nothing can be identified; check that heading, "
            "yaw rate and rudder are the right columns and share one clock."
        )
