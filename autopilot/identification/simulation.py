"""Models driven by recorded rudder and speed: the open-loop simulation behind every fit.

The equation is `autopilot.models.norrbin`, evaluated elementwise over all steps of all segments at once. What is
left is a recurrence, x_k+1 = F_k(x_k) with F_k a Runge-Kutta step and x the yaw rate, or rate and drift; Newton's
method on all of it together needs three or four rounds, each a few evaluations of every step and one banded system,
where a loop over time would need as many calls as there are steps. The same system gives the derivatives by the
parameters.

What drives a simulation: the recorded rudder, speed, propeller and wind on the steps of an integration.

Linear recurrences along all segments at once, as one banded triangular system.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtbsv

from autopilot.identification.rudder_path import DIRECT, RudderTrain, corners, following, with_corners
from autopilot.identification.runs import FloatArray, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, yaw_acceleration
from autopilot.models.weather import RaceAndWind, inflow_ratio, wind_acceleration

INPUTS_BESIDE_RUDDER = ("speed", "propeller", "beam_wind", "quarter_wind")


IntArray = NDArray[np.intp]


class SamplePlaces(NamedTuple):
    """Where the N samples of a segment lie: after node `left` by `share` of the way to the next, shapes (N,)."""

    left: IntArray
    share: FloatArray


class Forcing(NamedTuple):
    """The integration steps of S segments, one segment after the other: M steps between M + S nodes in all.

    step [s], shape (M,); begin: the node at which each step begins, shape (M,), its end is the next node; first:
    the node at which each segment begins, shape (S,). rudder [rad] and speed [m/s], shape (3, M), at the beginning,
    middle and end of each step, as are propeller [1/s], beam_wind and quarter_wind [m^2/s^2], 0 where the recording
    has none. samples: per segment, at which nodes its samples lie. moments [s]: per segment its steps' beginnings,
    middles and ends, shape (3, its steps); paths: per segment time [s] and angle [rad] of the recorded rudder. scales:
    what a simulation has found of the scaling with speed, for the next one.
    """

    step: FloatArray
    begin: IntArray
    first: IntArray
    rudder: FloatArray
    speed: FloatArray
    propeller: FloatArray
    beam_wind: FloatArray
    quarter_wind: FloatArray
    samples: tuple[SamplePlaces, ...]
    moments: tuple[FloatArray, ...]
    paths: tuple[tuple[FloatArray, FloatArray], ...]
    scales: dict[tuple[float, int, int], Norrbin]


class Part(NamedTuple):
    """Steps of some segments, or of a piece of one: `forcing` has each piece for a segment. segments: of which, by
    number; rows: their samples; goes_on: the last piece does so in the next part."""

    forcing: Forcing
    segments: tuple[int, ...]
    rows: tuple[slice, ...]
    goes_on: bool


class _Piece(NamedTuple):
    number: int
    segment: Segment
    rows: slice
    knots: FloatArray
    path: tuple[FloatArray, FloatArray]
    rudder: FloatArray


def forcing(segments: Sequence[Segment], longest_step: float, together: float | None = None) -> Forcing:
    """Return the segments' rudder and speed on steps of at most about `longest_step` [s].

    Samples further apart than that are subdivided; those that lie within `together` [s], by default the same, are
    stepped over in one. Between samples rudder and speed move linearly.
    """
    (part,) = forcing_in_parts(segments, longest_step, together, most=sys.maxsize)
    return part.forcing


def forcing_in_parts(
    segments: Sequence[Segment],
    longest_step: float,
    together: float | None = None,
    train: RudderTrain = DIRECT,
    most: int | None = None,
) -> Iterator[Part]:
    """Yield what `forcing` returns, the rudder behind `train`, on about `most` steps after the others: those of a day
    take many times the memory of its log."""
    reach = longest_step if together is None else together
    room = whole = PART if most is None else most
    pieces: list[_Piece] = []
    for number, segment in enumerate(segments):
        turns = corners(segment.time, segment.rudder)
        path = with_corners(segment.time, segment.rudder, turns)
        knots = _knots(np.union1d(segment.time, turns[0]), longest_step, reach)
        begin, row, behind = 0, 0, None
        while begin < knots.size - 1:
            end = min(begin + room, knots.size - 1)
            own = knots[begin : end + 1]
            rudder, behind = _rudder_at(train, path, _moments(own), behind)
            after = int(np.searchsorted(segment.time, own[-1], side="right")) if end < knots.size - 1 else None
            pieces.append(_Piece(number, segment, slice(row, after), own, path, rudder))
            room, begin, row = room - (end - begin), end, after or 0
            if room == 0:
                yield _part(pieces, goes_on=end < knots.size - 1)
                pieces, room = [], whole
    if pieces:
        yield _part(pieces, goes_on=False)


def _part(pieces: Sequence[_Piece], goes_on: bool) -> Part:
    segments, knots = [piece.segment for piece in pieces], [piece.knots for piece in pieces]
    first = np.cumsum([0, *(times.size for times in knots[:-1])])
    begin = np.concatenate([start + np.arange(times.size - 1) for start, times in zip(first, knots, strict=True)])
    moments = tuple(_moments(times) for times in knots)
    samples = tuple(
        _places(piece.segment.time[piece.rows], piece.knots, start)
        for piece, start in zip(pieces, first.tolist(), strict=True)
    )
    joined = Forcing(
        np.concatenate([np.diff(times) for times in knots]),
        begin,
        first,
        np.concatenate([piece.rudder for piece in pieces], axis=1),
        **{name: _recorded(segments, name, moments) for name in INPUTS_BESIDE_RUDDER},
        samples=samples,
        moments=moments,
        paths=tuple(piece.path for piece in pieces),
        scales={},
    )
    return Part(joined, tuple(piece.number for piece in pieces), tuple(piece.rows for piece in pieces), goes_on)


def _moments(knots: FloatArray) -> FloatArray:
    return np.stack([knots[:-1], 0.5 * (knots[:-1] + knots[1:]), knots[1:]])


def _rudder_at(
    train: RudderTrain, path: tuple[FloatArray, FloatArray], moments: FloatArray, behind: float | None = None
) -> tuple[FloatArray, float | None]:
    """Return the rudder [rad] behind `train` at the moments, shape (3, M), and what the lag has come to at the last of
    them; behind: at the first."""
    if train == DIRECT:
        return np.interp(moments, *path), None
    there, behind = following(train, *path, np.append(moments[:2].T.ravel(), moments[2, -1]), behind)
    return np.stack([there[:-1:2], there[1::2], there[2::2]]), behind


def rudder_behind(train: RudderTrain, forcing: Forcing) -> FloatArray:
    """Return what the recorded rudder [rad] has become behind `train`, shape (3, M) as in Forcing."""
    if train == DIRECT:
        return forcing.rudder
    parts = zip(forcing.paths, forcing.moments, strict=True)
    return np.concatenate([_rudder_at(train, path, moments)[0] for path, moments in parts], axis=1)


def _recorded(segments: Sequence[Segment], name: str, moments: Sequence[FloatArray]) -> FloatArray:
    """Return what was recorded at the moments, shape (3, M); 0 where nothing was, which takes no memory of its own."""
    columns = [getattr(segment, name) for segment in segments]
    if not any(values.size for values in columns):
        return np.broadcast_to(0.0, (3, sum(times.shape[1] for times in moments)))
    return np.concatenate(
        [
            np.interp(times, segment.time, values) if values.size else np.zeros_like(times)
            for segment, values, times in zip(segments, columns, moments, strict=True)
        ],
        axis=1,
    )


def _places(time: FloatArray, knots: FloatArray, start: int) -> SamplePlaces:
    right = np.clip(np.searchsorted(knots, time), 1, knots.size - 1)
    return SamplePlaces(start + right - 1, (time - knots[right - 1]) / (knots[right] - knots[right - 1]))


def _knots(time: FloatArray, longest_step: float, together: float) -> FloatArray:
    """Return the ends of the integration steps [s]: every few samples, or several within a sample spacing."""
    coarse = _thinned(time, together * (1.0 + 1.0e-9))
    pieces = np.maximum(np.ceil(np.diff(coarse) / longest_step - 1e-9), 1.0).astype(int)
    return np.interp(np.arange(pieces.sum() + 1), np.concatenate([[0], np.cumsum(pieces)]), coarse)


def _thinned(time: FloatArray, together: float) -> FloatArray:
    """Return `time` without what lies within `together` [s] of one that is kept; the last one always stays."""
    if time.size < 3 or float(np.min(time[2:] - time[:-2])) > together:
        return time
    within = np.searchsorted(time, time + together, side="right") - 1
    # the last sample within reach, and the next one where none is
    following = np.maximum(within, np.arange(1, time.size + 1)).tolist()
    chosen = [0]
    while chosen[-1] < time.size - 1:
        chosen.append(following[chosen[-1]])
    return time[chosen]


def at_samples(values: FloatArray, forcing: Forcing, s: int) -> FloatArray:
    """Return `values` at the nodes, shape (M+S,), at the N samples of segment `s`, linear between nodes."""
    left, share = forcing.samples[s]
    return np.asarray(values[left] * (1.0 - share) + values[left + 1] * share)


class Recurrence:
    """x_k+1 = A_k x_k + b_k over each of M steps, for one A and one source b after the other.

    memory: A, shape (C, C, M), C = 1 or 2.
    """

    def __init__(self, memory: FloatArray, forcing: Forcing) -> None:
        self._forcing, count = forcing, memory.shape[0]
        # the components of a node lie side by side, so that the next node's are `count` places further on
        self._band = np.zeros((2 * count, count * (forcing.step.size + forcing.first.size)), order="F")
        for row in range(count):
            for column in range(count):
                self._band[count + row - column, count * forcing.begin + column] = -memory[row, column]

    def solved(self, source: FloatArray, initial: FloatArray) -> FloatArray:
        """Return x at the nodes, shape (C, M+S), with x = `initial` at each segment's first node, shape (C, S).

        source: b, shape (C, M).
        """
        forcing, count = self._forcing, source.shape[0]
        x = np.empty(self._band.shape[1])
        for row in range(count):
            x[count * forcing.first + row] = initial[row]
            x[count * (forcing.begin + 1) + row] = source[row]
        found = dtbsv(2 * count - 1, self._band, x, lower=1, diag=1, overwrite_x=1)
        return np.ascontiguousarray(np.asarray(found).reshape(-1, count).T)


RATE_BOUND_RAD_S = 100.0
"""Simulated rates are held inside this, so that a model which runs away gives a large number, not inf or nan."""

SLOPE_BOUND = 1.0e8
"""Derivatives of a model that runs away are held inside this, in units of rad/s and rad by the parameter's."""

NEWTON_ROUNDS = 20
"""Rounds after which the recurrence is stepped through one by one: a model that runs away does not settle."""
SETTLED = 1.0e-12
"""Change of the rates, as a share of the largest, below which Newton's method has arrived."""
NEARLY = 1.0e-6
"""A defect, as a share of the largest rate, from which one round more leads to rounding errors: they square."""
PROBE = 1.0e-6
"""Step of the finite differences inside one integration step, as a share of the largest rate."""

UNIT = Norrbin(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
"""What is scaled with speed to find the scales."""

BLOCK = 8192
"""Steps that are evaluated together: their arrays then stay in the processor's cache."""
PART = 1 << 15
"""Steps that are taken together where nothing needs them all."""


class Trajectory(NamedTuple):
    """Yaw rate [rad/s] and angle turned through since the segment's beginning [rad] at the nodes, shape (M+S,); drift:
    what drift adds to the turning [rad/s], likewise, None where it does not count. linearised: the steps next to this
    motion, where they are known: they spare `slopes` half its work."""

    rate: FloatArray
    turned: FloatArray
    drift: FloatArray | None = None
    linearised: Linearised | None = None


def simulate(
    model: Norrbin,
    forcing: Forcing,
    initial_rate: FloatArray,
    around: RaceAndWind | None = None,
    guess: Trajectory | None = None,
) -> Trajectory:
    """Return the open-loop motion in S segments that begin with `initial_rate` [rad/s], shape (S,).

    Classical Runge-Kutta steps of r' = yaw_acceleration(r, delta) with the parameters scaled to the speed of the
    moment, and of psi' = r. `around` is what propeller, wind and drift add; without it they do not count. A segment
    begins as if it had turned so for long. guess: a similar model's motion to begin the search with; it does not change
    the result.
    """
    state, advance, near = _moved(model, forcing, _initial(initial_rate, around), around, guess)
    return _trajectory(state, _turned(advance, forcing))._replace(linearised=near)


@np.errstate(over="ignore", invalid="ignore")  # a model that runs away is bounded, not an accident
def _moved(
    model: Norrbin, forcing: Forcing, initial: FloatArray, around: RaceAndWind | None, guess: Trajectory | None
) -> tuple[FloatArray, FloatArray, Linearised | None]:
    """Return the states at the nodes, the angles [rad] turned in the steps, and the steps next to that motion where
    Newton's method arrived."""
    drives = _drives(model, forcing, around)
    found = _by_newton(drives, forcing, initial, guess)
    if found is None:
        state = _one_by_one(drives, forcing, initial)
        return state, _advance(drives, state[:, forcing.begin])[1], None
    state, near = found
    return state, near.advance + np.einsum("cm,cm->m", near.turning, state[:, forcing.begin] - near.start), near


def motions_at_samples(
    model: Norrbin,
    segments: Sequence[Segment],
    longest_step: float,
    initial_rate: Sequence[float],
    around: RaceAndWind | None = None,
    train: RudderTrain = DIRECT,
) -> list[FloatArray]:
    """Return per segment the rate [rad/s] and the angle turned since its beginning [rad] that `simulate` has at its
    samples, shape (N, 2): some steps after the others, so that a day's log takes little more memory than its motion."""
    # a segment of one row has no step, and stays where it begins
    found = [np.full((each.time.size, 2), (rate, 0.0)) for each, rate in zip(segments, initial_rate, strict=True)]
    state, so_far, goes_on = np.empty(0), 0.0, False
    for part in forcing_in_parts(segments, longest_step, train=train):
        steps = part.forcing
        initial, begun = (
            _initial(np.array([initial_rate[s] for s in part.segments]), around),
            np.zeros(steps.first.size),
        )
        if goes_on:
            initial[:, 0], begun[0] = state, so_far
        states, advance, _ = _moved(model, steps, initial, around, _as_measured(segments, part))
        turned = _turned(advance, steps)
        for s, (number, rows) in enumerate(zip(part.segments, part.rows, strict=True)):
            found[number][rows, 0] = at_samples(states[0], steps, s)
            found[number][rows, 1] = at_samples(turned, steps, s) + begun[s]
        state, so_far, goes_on = states[:, -1], float(turned[-1] + begun[-1]), part.goes_on
    return found


def _as_measured(segments: Sequence[Segment], part: Part) -> Trajectory | None:
    """Return the measured motion at the nodes, for the search to begin with; None where no rate is measured."""
    rates = []
    for number, (begins, _, ends) in zip(part.segments, part.forcing.moments, strict=True):
        segment = segments[number]
        known = np.isfinite(segment.rate)
        if not known.any():
            return None
        rates.append(np.interp(np.append(begins, ends[-1]), segment.time[known], segment.rate[known]))
    rate = np.concatenate(rates)
    return Trajectory(rate, np.zeros_like(rate))


@np.errstate(over="ignore", invalid="ignore")
def slopes(
    model: Norrbin,
    forcing: Forcing,
    motion: Trajectory,
    shifted: Sequence[tuple[Norrbin, RaceAndWind | None, FloatArray]],
    by: float,
    around: RaceAndWind | None = None,
) -> list[Trajectory]:
    """Return the derivatives of `motion` by each parameter that was shifted, and last by the initial rates.

    shifted: model, surroundings and rudder with one parameter moved, `by` that much in the derivative's unit.
    Differences are taken within each step and carried on by the linearised recurrence: exact but for rounding, however
    long the record is.
    """
    base = motion.linearised
    if base is None:
        base = Linearised(_drives(model, forcing, around), _state(motion)[:, forcing.begin])
    start, first = base.start, motion.rate[forcing.first]
    initial = _initial(first, around)
    result = []
    for other, beside_it, rudder in shifted:
        moved, moved_advance = _advance(_drives(other, forcing._replace(rudder=rudder), beside_it), start)
        begins = (_initial(first, beside_it) - initial) / by
        result.append(base.carried((moved - base.ahead) / by, (moved_advance - base.advance) / by, begins, forcing))
    still = np.zeros_like(start)
    begins = _initial(np.ones(first.size), around)
    return [*result, base.carried(still, still[0], begins, forcing)]


@np.errstate(over="ignore", invalid="ignore")
def linear_responses(
    model: Norrbin, forcing: Forcing, initial: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what a linear model (n3 = n2 = 0, no surroundings) answers to its rudder, to n0 = -1 rad/s without rudder,
    and to an initial rate of 1 rad/s: rate [rad/s] and angle turned [rad] at the nodes, each of shape (2, M+S).

    initial: of each answer the rates that segments begin with, shape (3, S), where those are other ones.
    """
    still = np.zeros((1, forcing.step.size))
    driven = _advance(_drives(model._replace(n0=0.0), forcing, None), still)
    free = _drives(model._replace(gain=0.0, n0=0.0), forcing, None)
    memory, turning = _advance(free, still + 1.0)
    pushed = _advance(_drives(model._replace(gain=0.0, n0=-1.0), forcing, None), still)
    begins = np.outer([0.0, 0.0, 1.0], np.ones(forcing.first.size)) if initial is None else initial
    result, recurrence = [], Recurrence(memory[None], forcing)
    for (source, advance), begin in zip((driven, pushed, (still, still[0])), begins, strict=True):
        rate = recurrence.solved(source, begin[None])[0]
        result.append(np.stack([rate, _turned(advance + turning * rate[forcing.begin], forcing)]))
    return result[0], result[1], result[2]


def _finite(slope: FloatArray) -> FloatArray:
    """Return derivatives held inside the bound: one that overflowed says as much as a large one."""
    # as a rule none is near it, and that is found without writing them anew; nan is in no order
    if slope.min() > -SLOPE_BOUND and slope.max() < SLOPE_BOUND:
        return slope
    return np.fmax(np.fmin(slope, SLOPE_BOUND), -SLOPE_BOUND)


def _trajectory(state: FloatArray, turned: FloatArray) -> Trajectory:
    return Trajectory(state[0], turned, state[1] if state.shape[0] > 1 else None)


def _state(motion: Trajectory) -> FloatArray:
    """Return the state at the nodes: the rate, shape (1, M+S), or rate and drift, shape (2, M+S)."""
    return np.stack([motion.rate] if motion.drift is None else [motion.rate, motion.drift])


def _initial(rate: FloatArray, around: RaceAndWind | None) -> FloatArray:
    """Return the states that segments begin with: drift, where it counts, has settled."""
    return np.stack([rate, around.drift * rate] if around is not None and around.drifts else [rate])


class _Moment(NamedTuple):
    """Parameters and rudder at one moment of each step; with drift, how much of it pulls, how fast it settles [1/s], on
    which share of the rate, and the wind's push on it [rad/s^2]."""

    model: Norrbin
    rudder: FloatArray
    pull: FloatArray | None = None
    settle: FloatArray | None = None
    share: float = 0.0
    push: FloatArray | None = None


class _Drive(NamedTuple):
    """Beginning, middle and end of each step, and the steps [s]."""

    begin: _Moment
    middle: _Moment
    end: _Moment
    step: FloatArray


def _drives(model: Norrbin, forcing: Forcing, around: RaceAndWind | None) -> list[_Drive]:
    """Return what drives the steps, some thousand of them at a time."""
    starts = range(0, forcing.step.size, BLOCK)
    return [_drive(model, forcing, around, slice(start, start + BLOCK)) for start in starts]


def _drive(model: Norrbin, forcing: Forcing, around: RaceAndWind | None, steps: slice) -> _Drive:
    begin, middle, end = (_moment(model, forcing, around, (i, steps)) for i in range(3))
    return _Drive(begin, middle, end, forcing.step[steps])


def _moment(model: Norrbin, forcing: Forcing, around: RaceAndWind | None, at: tuple[int, slice]) -> _Moment:
    if around is None:
        return _Moment(_scaled(model, forcing, at), forcing.rudder[at])
    speed = np.maximum(np.abs(forcing.speed[at]) / model.reference_speed, SPEED_FLOOR_RATIO)
    ratio = inflow_ratio(around, model.reference_speed, speed, forcing.propeller[at])
    scaled = at_speed_ratio(model, cast(float, ratio))
    wind = wind_acceleration(around, forcing.beam_wind[at], forcing.quarter_wind[at])
    # the rudder angle that would do without wind what the rudder does with it
    rudder = forcing.rudder[at] + wind * scaled.time_constant / scaled.gain
    if not around.drifts:
        return _Moment(scaled, rudder)
    pull, push = speed / model.time_constant, around.drift_wind * forcing.beam_wind[at]
    return _Moment(scaled, rudder, pull, speed / around.drift_time, around.drift, push)


def _scaled(model: Norrbin, forcing: Forcing, at: tuple[int, slice]) -> Norrbin:
    """Return the model at the speeds of the moment. Each parameter goes with a power of the speed that is the same for
    all models, so that these powers are found once."""
    key = (model.reference_speed, at[0], at[1].start)
    if key not in forcing.scales:
        speed = np.maximum(np.abs(forcing.speed[at]) / model.reference_speed, SPEED_FLOOR_RATIO)
        # the reference speed itself is no part of the equation
        forcing.scales[key] = at_speed_ratio(UNIT, cast(float, speed))._replace(reference_speed=1.0)
    scales = forcing.scales[key]
    return Norrbin(*(value and value * scale for value, scale in zip(model, scales, strict=True)))


def _advance(drives: Sequence[_Drive], state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the states one step after `state`, shape (C, M), and the angles [rad] turned meanwhile, shape (M,)."""
    ahead, advance, start = np.empty_like(state), np.empty(state.shape[1]), 0
    for drive in drives:
        part = slice(start, start + drive.step.size)
        following, advance[part] = _runge_kutta(drive, tuple(state[:, part]))
        for row, values in enumerate(following):
            ahead[row, part] = values
        start = part.stop
    return ahead, advance


State = tuple[FloatArray, ...]


def _runge_kutta(drive: _Drive, state: State) -> tuple[State, FloatArray]:
    """Return the state one step after `state`, and the angles [rad] turned meanwhile. Elementwise."""
    h = drive.step
    half = 0.5 * h
    k1 = _rates(drive.begin, state)
    k2 = _rates(drive.middle, tuple(x + half * k for x, k in zip(state, k1, strict=True)))
    k3 = _rates(drive.middle, tuple(x + half * k for x, k in zip(state, k2, strict=True)))
    k4 = _rates(drive.end, tuple(x + h * k for x, k in zip(state, k3, strict=True)))
    sixth = h / 6.0
    between = [a + b + c for a, b, c in zip(k1, k2, k3, strict=True)]
    following = tuple(
        x + sixth * (between_ + b + c + d) for x, between_, b, c, d in zip(state, between, k2, k3, k4, strict=True)
    )
    return following, h * (state[0] + sixth * between[0])


def _rates(at: _Moment, state: State) -> State:
    """The scalar equation of `models.norrbin`, elementwise, and the drift's where it counts."""
    turning = cast(FloatArray, yaw_acceleration(at.model, cast(float, state[0]), cast(float, at.rudder)))
    if at.pull is None or at.settle is None or at.push is None:
        return (turning,)
    return turning + at.pull * state[1], at.settle * (at.share * state[0] - state[1]) + at.push


class Linearised:
    """Every step from `start`, shape (C, M), and how what lies beside it is carried on."""

    def __init__(self, drives: Sequence[_Drive], start: FloatArray) -> None:
        self.start = start
        self._recurrence: Recurrence | None = None
        self.ahead, self.advance = _advance(drives, start)
        probe = PROBE * max(float(np.max(np.abs(start[0]))), PROBE)
        count = start.shape[0]
        self.memory, self.turning = np.empty((count, count, start.shape[1])), np.empty_like(start)
        for column in range(count):
            beside = start.copy()
            beside[column] += probe
            moved, advance = _advance(drives, beside)
            self.memory[:, column] = (moved - self.ahead) / probe
            self.turning[column] = (advance - self.advance) / probe

    def recurrence(self, forcing: Forcing) -> Recurrence:
        """Return the recurrence of what lies beside the steps."""
        if self._recurrence is None:
            self._recurrence = Recurrence(self.memory, forcing)
        return self._recurrence

    def carried(self, source: FloatArray, advance: FloatArray, initial: FloatArray, forcing: Forcing) -> Trajectory:
        """Return the derivative whose own part of each step is `source` and, of the angle turned, `advance`."""
        state = _finite(self.recurrence(forcing).solved(source, initial))
        total = advance + np.einsum("cm,cm->m", self.turning, state[:, forcing.begin])
        return _trajectory(state, _finite(_turned(_finite(total), forcing)))


def _by_newton(
    drives: Sequence[_Drive], forcing: Forcing, initial: FloatArray, guess: Trajectory | None
) -> tuple[FloatArray, Linearised] | None:
    """Return the states at the nodes that follow from one another, and the steps next to them; None where Newton's
    method does not arrive."""
    state = np.zeros((initial.shape[0], forcing.step.size + forcing.first.size))
    if guess is not None and guess.rate.size == state.shape[1]:
        known = _state(guess)[: state.shape[0]]
        state[: known.shape[0]] = known
    state[:, forcing.first] = initial
    for _ in range(NEWTON_ROUNDS):
        largest = float(np.max(np.abs(state)))
        if not largest < RATE_BOUND_RAD_S:
            return None
        step = Linearised(drives, state[:, forcing.begin])
        defect = step.ahead - state[:, forcing.begin + 1]
        error = float(np.max(np.abs(defect))) / max(largest, SETTLED)
        if error <= SETTLED:
            return state, step
        state = state + step.recurrence(forcing).solved(defect, np.zeros_like(initial))
        if error <= NEARLY:
            return state, step
    return None


def _one_by_one(drives: Sequence[_Drive], forcing: Forcing, initial: FloatArray) -> FloatArray:
    """Return the states at the nodes, step after step in plain numbers, held inside the bound."""
    state = np.empty((initial.shape[0], forcing.step.size + forcing.first.size))
    state[:, forcing.first] = initial
    nodes = iter(forcing.begin.tolist())
    for drive in drives:
        moments = [_in_turn(moment, drive.step.size) for moment in drive[:3]]
        for begin, middle, end, step in zip(*moments, drive.step.tolist(), strict=True):
            node = next(nodes)
            following = _runge_kutta(_Drive(begin, middle, end, step), tuple(state[:, node]))[0]
            # overflow on overflow is not a number: the bound is as good
            state[:, node + 1] = [max(-RATE_BOUND_RAD_S, min(RATE_BOUND_RAD_S, float(x))) for x in following]
    return state


def _in_turn(moment: _Moment, count: int) -> list[_Moment]:
    models = [np.broadcast_to(values, (count,)).tolist() for values in moment.model]
    others = [[None] * count if values is None else np.broadcast_to(values, (count,)).tolist() for values in moment[1:]]
    rows = zip(*models, strict=True)
    return [_Moment(Norrbin(*row), *rest) for row, *rest in zip(rows, *others, strict=True)]


def _turned(advance: FloatArray, forcing: Forcing) -> FloatArray:
    """Return the angle turned since each segment's beginning at the nodes, from what each step adds."""
    turned = np.zeros(forcing.step.size + forcing.first.size)
    turned[forcing.begin + 1] = advance
    turned = np.cumsum(turned)
    lengths = np.diff(np.append(forcing.first, turned.size))
    return np.asarray(turned - np.repeat(turned[forcing.first], lengths))
