"""The boat that a recording makes likely, and how far from it the truth may be.

The marginal likelihood (`marginal_likelihood`) of the boat's rates a, b, d, e, and of delay and lag of a rudder that
was ordered, averaged over gusts, waves and noise (`weather_average`): the doubt about those is in the answer. No
term is dropped: what the recording cannot tell keeps its doubt.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.likelihood_record import (
    NORRBIN,
    Beside,
    Form,
    IntArray,
    Record,
    Scales,
    Surroundings,
    beside_of,
    blur_of,
    blurred,
    instruments,
    record_of,
    rudder_on,
    speed_changes,
    white_noise,
)
from autopilot.identification.likelihood_search import (
    GUST_TIME_S,
    GUST_TIME_WIDTH,
    LATE_S,
    NEAR,
    RATE_NAMES,
    SWAY,
    Space,
    approached,
    in_weather,
    inverse,
    settled,
)
from autopilot.identification.marginal_likelihood import (
    Rates,
    Weather,
    begin_path,
    best_path,
    motion_of,
)
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Segment
from autopilot.identification.weather_average import Known, averaged, mixed
from autopilot.models.drives import DriveLaw
from autopilot.models.weather import RaceAndWind

USUALLY_LATE_S, START_LATE = 0.15, 0.1
"""Where the search for delay and lag begins, as a share of the boat's time constant at most."""
DRAWS = 32
"""Of the weather; half of it where the record is long, and says more of it."""
MAYBE_WAVES, MAYBE_LONG = 0.5, 3.0
"""So much likelier, in the logarithm, must waves as they are guessed make the record, or none are searched for. In a
long record chance shows some that make it likelier by one or two, and real ones do by tens."""
HURRIED_S = GUST_TIME_S * math.exp(-2.0 * GUST_TIME_WIDTH)
"""Gusts that last no longer may be waves, whatever a guess of these is worth beside them."""
WAVE_SIZES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Waves are guessed at so many times what the strongest frequency shows."""
ROUGH_WHITE = 3.0
"""Times what a search begins with: white gusts as large may be waves."""
NO_PART = 12.0
"""Weather of which the likelihood's logarithm is lower by so much at its best has no part in what is known."""
NO_KIND = 5.0
"""Nor have waves that move the heading beside others that push, with as many numbers, or those beside these, where one
kind is likelier by so much."""


class Unseen(NamedTuple):
    """By how much a delay, and by how much a play of the rudder, would raise the logarithm of the likelihood where they
    were not fitted; the likeliest play [rad], to either side, and the least that the record excludes; by how much a
    boat that slides would, and by how much a rudder that stops short of its record; the likeliest such stop [rad].
    maybe_play: `play` may as well be a pilot's answers to waves."""

    late_worth: float
    play_worth: float
    play: float
    excluded: float
    sway_worth: float = 0.0
    stop_worth: float = 0.0
    stop: float = math.inf
    maybe_play: bool = False

    @property
    def stops(self) -> bool:
        """Whether the rudder surely stops short of its record, likelier than all else that was not fitted."""
        return self.stop_worth > max(SURELY_STOPS, self.play_worth, self.late_worth, self.sway_worth)


NOTHING_UNSEEN = Unseen(0.0, 0.0, 0.0, math.inf)


class SpeedPower(NamedTuple):
    """With how many powers of the speed beyond the second a rudder steers: mean and deviation; the weather that the
    mean leaves. What is to be added to a, b, d, e and the logarithms of the train's parts for a boat that steers with
    the mean, and for each power more, shape (B,)."""

    mean: float
    deviation: float
    weather: Weather
    boat: FloatArray
    by_power: FloatArray


class LikelihoodFit(NamedTuple):
    """rates: the estimate, with covariance of a, b, d, e, shape (4, 4); train: of an ordered rudder, its errors by
    name; weather: gusts, waves and noise; loss: the negative logarithm of the likelihood with what was known before;
    late_error [s]: standard error of delay and lag together, of which the record tells more than of each; unseen: what
    of the rudder's way was not fitted; motions: of each segment time [s], heading [rad] and rate [rad/s] of the boat,
    as all of the recording tells them, shape (3, N); form: which d is meant, and how the boat goes with speed;
    joint: covariance of a, b, d, e and the logarithms of what `train_errors` names, in that order; power: of the
    speed with which the rudder steers; None with `around`. around: what was fitted of `Surroundings`, a law in
    the form's place; its own part of `joint` comes last, of a race its logarithm's. angle [rad]: of the rudder by which
    a was found; infinite where that is not known."""

    rates: Rates
    covariance: FloatArray
    train: RudderTrain
    train_errors: dict[str, float]
    weather: Weather
    loss: float
    late_error: float = 0.0
    unseen: Unseen = NOTHING_UNSEEN
    motions: tuple[FloatArray, ...] = ()
    form: Form = NORRBIN
    joint: FloatArray | None = None
    power: SpeedPower | None = None
    around: RaceAndWind | None = None
    angle: float = math.inf

    @property
    def pushes(self) -> Weather:
        """The weather in which predictions are made."""
        return self.weather if self.power is None else self.power.weather

    def with_doubt(self, more: FloatArray) -> LikelihoodFit:
        """Return the fit with so much `more` covariance of a, b, d and e, shape (4, 4)."""
        joint = self.joint
        if joint is not None:
            joint = joint.copy()
            joint[:4, :4] += more
        return self._replace(covariance=self.covariance + more, joint=joint)


def likelihood_fit(
    segments: Sequence[Segment],
    reference_speed: float,
    guess: Rates,
    parts: tuple[str, ...] = (),
    progress: Callable[[], None] = lambda: None,
    form: Form = NORRBIN,
    surroundings: Surroundings | None = None,
) -> LikelihoodFit | None:
    """Return the most likely boat near `guess`, and its covariance; None where the search cannot begin there, or ends
    nowhere.

    parts: of the rudder's train, to be fitted too. form: how the terms go with speed and rate. surroundings: what else
    turns the boat; then nothing else that might is looked for.
    """
    memory = memory_of(guess, segments, form.power)
    record = record_of(segments, reference_speed, memory, form)
    scale = scales(segments, guess, form.power)
    around: RaceAndWind | DriveLaw | None = None if surroundings is None else surroundings.start
    wind = around if isinstance(around, RaceAndWind) else None
    blur = blur_of(segments, scale.a, reference_speed, form, wind)
    record = blurred(record, blur, scale.a)
    gyro, compass = instruments(segments)
    gust = scale.a * math.radians(0.3)
    calm = usual = Weather(gust, GUST_TIME_S, 0.3 * gust, gyro, compass)
    # a lag longer than the boat's own would change places with it
    shortly = min(USUALLY_LATE_S, START_LATE * memory)
    train = DIRECT._replace(**{part: PLAYS[1] if part == "dead_band" else shortly for part in parts})

    def beside(record: Record, segments: Sequence[Segment]) -> Beside | None:
        if surroundings is None:
            return None
        return beside_of(record, segments, surroundings, reference_speed, scale.e, form)

    starts = [(guess, train)]
    if set(SWAY) <= set(parts):
        starts = [(guess, train._replace(**sliding(memory))), _as_slow(guess, train, memory)]
    if record.nodes > LONG or len(starts) > 1:
        parted = [_liveliest(segment) for segment in segments] if record.nodes > LONG else segments
        part = record_of(parted, reference_speed, memory, form) if record.nodes > LONG else record
        part = blurred(part, blur, scale.a)
        on_part = beside(part, parted)
        rough = [Space(part, rates, calm, behind, parts, scale, on_part) for rates, behind in starts]
        ends = [approached(each, each.start) for each in rough if math.isfinite(each.keep(each.start))]
        if ends:
            nearest, _ = min(ends, key=lambda end: end[1])
            guess, weather, train = rough[0].opened(nearest)
            # gusts that are over within a step are none to begin a search with
            calm = weather if weather.gust_time > float(record.step[0]) else calm
    groups = None if surroundings is None or len(segments) < 2 else _alike(segments)
    space = Space(record, guess, calm, train, parts, scale, beside(record, segments), groups)
    if not math.isfinite(space.found(space.start).loss):
        return None
    draws = DRAWS if record.nodes <= LONG else DRAWS // 2
    space, best, loss = _without_white(space, usual)
    best, loss, curvature = settled(space, best, loss)
    bare = space, best, loss, curvature
    progress()
    waves = [(other, *approached(other, other.start)) for other in _with_waves(space, best, loss, usual)]
    orders = _with_own_lags([bare[:2], *(each[:2] for each in waves)])
    waves += orders
    least = min(loss, *(each[2] for each in waves)) if waves else loss
    # a difference, not a sum: a loss may be so large that the limit is lost in it
    hopeful = [each for each in waves if each[2] - least < NO_KIND + NEAR]
    tried = [bare, *((each[0], *settled(*each)) for each in hopeful)]
    progress()
    space, best, loss, _ = min(tried, key=lambda each: each[2])
    likely = [each for each in tried if each[2] - loss < (NO_PART if each is bare else NO_KIND)]
    found = [averaged(*each[:2], each[3], draws) for each in likely]
    found = _alike_in_time(found) if orders else found
    progress()
    space, best, *_ = likely[max(range(len(found)), key=lambda k: found[k].evidence)]
    _, weather, train = space.opened(best)
    known = mixed(found)
    units = np.array([getattr(scale, name) for name in RATE_NAMES])
    units = np.append(units, np.ones(len(parts)))
    own, found_beside = len(units), space.beside
    if found_beside is not None:
        units = np.append(units, found_beside.units)
        around = found_beside.opened(dict(zip(found_beside.names, known.mean[own:].tolist(), strict=True)))
    values, joint = known.mean[:4] * units[:4], known.covariance * np.outer(units, units)
    if not (np.isfinite(values).all() and np.isfinite(joint).all()):
        return None
    train = train._replace(**{name: math.exp(float(known.mean[4 + k])) for k, name in enumerate(parts)})
    size = np.array([getattr(train, name) for name in parts])
    way = joint[4:own, 4:own] * np.outer(size, size)
    errors = dict(zip(parts, np.sqrt(np.maximum(np.diag(way), 0.0)).tolist(), strict=True))
    boat = Rates(**dict(zip(RATE_NAMES, values.tolist(), strict=True)))
    late = np.array([part != "dead_band" for part in parts], dtype=float)
    late_error = math.sqrt(max(float(late @ way @ late), 0.0))
    motions = _motions(space, best)
    fit = LikelihoodFit(
        boat, joint[:4, :4], train, errors, weather, loss, late_error, NOTHING_UNSEEN, motions, form, joint
    )._replace(angle=angle_of(segments))
    if isinstance(around, DriveLaw):
        return fit._replace(form=form._replace(law=around))
    if around is not None:
        return fit._replace(around=around)
    unseen = _unseen(space, best, memory, least_play(segments))
    if form.law.is_rudder:
        power = _speed_power(space, best, segments)
    else:
        power = _unknown_power(space, best, record_of(segments, reference_speed, memory).scales.linear)
    power = power._replace(boat=units * power.boat, by_power=units * power.by_power)
    return fit._replace(unseen=unseen, power=power)


def space_at(found: LikelihoodFit, segments: Sequence[Segment], reference_speed: float) -> Space | None:
    """Return where to search near `found` in other `segments`; None where the rudder never moves in them.

    Likelihoods of segments on the same times are compared by it: their grid goes with where a search begins.
    """
    record = record_of(segments, reference_speed, memory_of(found.rates, segments, found.form.power), found.form)
    scale = scales(segments, found.rates, found.form.power)
    if not min(scale) > 0.0:
        return None
    record = blurred(record, blur_of(segments, scale.a, reference_speed, found.form, None), scale.a)
    return Space(record, found.rates, found.weather, found.train, tuple(found.train_errors), scale)


def moved_to(found: LikelihoodFit, segments: Sequence[Segment], reference_speed: float) -> LikelihoodFit | None:
    """Return `found` with the boat that is likeliest for `segments` in the same weather, and its loss; None where there
    is none near it."""
    space = space_at(found, segments, reference_speed)
    if space is None or not math.isfinite(space.found(space.start).loss):
        return None
    best, loss = in_weather(space, space.start)
    rates, _, train = space.opened(best)
    return found._replace(rates=rates, train=train, loss=loss) if math.isfinite(loss) else None


def _has_changed(space: Space, z: FloatArray) -> bool:
    """Return whether the vector's boat may have changed places with the lag of its rudder."""
    rates, _, train = space.opened(z)
    return "lag" in space.parts and "lead" not in space.parts and rates.b * train.lag > CHANGED


def _with_own_lags(ends: Sequence[tuple[Space, FloatArray]]) -> list[tuple[Space, FloatArray, float]]:
    """Return what `approached` finds, with its space, from the boats that have all of the two lags in a row that one of
    the `ends` may have exchanged; empty where none did, or all come back there.

    Two lags answer a rudder alike in either order, and their sum is known best. What the boat turns by for good stays,
    and how far gusts turn it; the rudder has what is usual of one.
    """
    found = []
    for space, z in ends:
        if not _has_changed(space, z):
            continue
        rates, weather, train = space.opened(z)
        share = 1.0 / (1.0 + rates.b * train.lag)
        weather = weather._replace(gust=share * weather.gust, white=share * weather.white)
        slow, behind = Rates(*(share * rate for rate in rates)), train._replace(lag=LATE_S)
        other = Space(space.record, slow, weather, behind, space.parts, space.scale, space.beside_at(z), space.groups)
        other.priors, other.path = space.priors, space.path
        found.append((other, *approached(other, other.start)))
    return [each for each in found if not _has_changed(*each[:2])]


def _alike_in_time(found: Sequence[Known]) -> list[Known]:
    """Return what is known with evidences that compare boats of very different T as if none of ln T, K, n3 and n0 were
    likelier before than another: da db dd de = |b|^4 d(ln T) dK dn3 dn0. Alike in a, b, d and e, quick ones would be.
    """
    logs = [math.log(max(abs(float(known.mean[1])), SMALLEST)) for known in found]
    return [
        known._replace(evidence=known.evidence - len(RATE_NAMES) * log) for known, log in zip(found, logs, strict=True)
    ]


SMALLEST = 1.0e-6
CHANGED = 0.5
"""Of the boat's time constant: a rudder's lag of less is not the boat's."""


def _alike(segments: Sequence[Segment]) -> IntArray:
    """Return which segments have gusts of one strength: each its own, of many those of about one speed."""
    order = np.argsort(np.argsort([float(np.mean(np.abs(segment.speed))) for segment in segments], kind="stable"))
    return np.asarray(order * min(len(segments), STRENGTHS) // len(segments))


STRENGTHS = 6
"""Of gusts at most: runs of other speeds, sides and days have other gusts."""


def sliding(memory: float) -> dict[str, float]:
    """Return the usual lag and lead [s] of a boat that slides and forgets its rate in so long a time [s]."""
    return {part: share * memory for part, share in SWAY.items()}


def _as_slow(guess: Rates, train: RudderTrain, memory: float) -> tuple[Rates, RudderTrain]:
    """Return a boat that slides as slowly as it turns, and answers its rudder as a boat near `guess` does that does not
    slide: at first, and for good."""
    lag = min(1.0 / max(abs(guess.b), SLOWEST), SLOWLY * memory)
    rates = Rates(*(value / SLIDES for value in guess))
    return rates, train._replace(lag=lag, lead=SLIDES * lag)


SLIDES, SLOWLY = 1.6, 10.0
"""Lead over lag of such a boat, and its lag at most, as a multiple of the time in which it forgets its rate."""


def _at_power(space: Space, z: FloatArray, powers: float, ratio: FloatArray) -> tuple[Space, FloatArray]:
    """Return the space in which the rudder steers with so many powers of the speed beyond the law's, and the vector
    there; ratio: of the speed to the reference, in each substep."""
    rates, weather, train = space.opened(z)
    steering, linear, higher = space.record.scales
    record = space.record._replace(scales=Scales(steering * ratio**powers, linear, higher))
    other = Space(record, rates, weather, train, space.parts, space.scale, moved=space.moved)
    other.priors, other.path = space.priors, space.path
    return other, other.start.copy()


def _suiting(space: Space, z: FloatArray, powers: float, ratio: FloatArray) -> tuple[float, FloatArray]:
    """Return the loss of the boat that suits such a power best, in the weather of the vector, and its numbers."""
    other, at = _at_power(space, z, powers, ratio)
    loss = math.inf
    for _ in range(POWER_TURNS):
        there, slope, known = other.slope(at, boat_only=True)
        if not math.isfinite(there):
            return math.inf, at[other.boat]
        step = inverse(known) @ slope[other.boat]
        at[other.boat] -= step
        loss = there - 0.5 * float(step @ slope[other.boat])
    return loss, at[other.boat]


def _speed_power(space: Space, z: FloatArray, segments: Sequence[Segment]) -> SpeedPower:
    """Return what the record says of the power of the speed with which the rudder steers; at a constant speed what is
    known before.

    A turn takes speed away: what the rudder loses with it, and what damps the turn, differ by that power alone.
    Newton's method on the likelihood of the boat that suits a power best, and with the power found the weather anew:
    a wrong power looks like gusts, or like waves.
    """
    space.keep(z)
    searched, own, begin, ratio = space, z[space.boat], space.path, space.record.scales.linear
    found = SpeedPower(
        0.0, math.hypot(POWER_DOUBT, FORM_DOUBT), space.opened(z)[1], np.zeros_like(own), np.zeros_like(own)
    )
    at, middle = z, 0.0
    for _ in range(POWER_ROUNDS if speed_changes(segments) else 0):
        beside = [_suiting(space, at, middle + by, ratio) for by in (-POWER_STEP, 0.0, POWER_STEP)]
        (less, before), (here, now), (more, after) = beside
        if not math.isfinite(less + here + more):
            break
        bend = max((less - 2.0 * here + more) / POWER_STEP**2, 0.0) + POWER_DOUBT**-2.0
        move = -((more - less) / (2.0 * POWER_STEP) + middle / POWER_DOUBT**2) / bend
        move = min(max(move, -2.0 * POWER_STEP), 2.0 * POWER_STEP)
        middle += move
        by_power = (after - before) / (2.0 * POWER_STEP)
        at = at.copy()
        at[space.boat] = now + move * by_power
        found = SpeedPower(
            middle, math.hypot(bend**-0.5, FORM_DOUBT), space.opened(at)[1], at[space.boat] - own, by_power
        )
        gains = 0.5 * bend * move * move
        if gains < POWER_GAINS:
            break
        other, there = _at_power(space, at, middle, ratio)
        at, loss = approached(other, there)
        space.path = other.path
        if space.base.wave > 0.0:
            still = _without_waves(space, at)
            other, there = _at_power(still, still.start, middle, ratio)
            as_still, its_loss = approached(other, there)
            if its_loss < loss + WAVES_GAIN:
                space, at = still, as_still
                space.path = other.path
    searched.path = begin
    return found


def _unknown_power(space: Space, z: FloatArray, ratio: FloatArray) -> SpeedPower:
    """Return how a boat that steers by thrust goes with the power of the speed, which its record at one throttle tells
    nobody; ratio: of the speed to the reference, in each substep.

    What the record asks for is not believed: a hull that slides and its drag take it for theirs, and the other way
    round.
    """
    space.keep(z)
    begin, own = space.path, np.zeros(len(space.boat))
    (less, before), (more, after) = (_suiting(space, z, by, ratio) for by in (-POWER_STEP, POWER_STEP))
    space.path = begin
    by_power = (after - before) / (2.0 * POWER_STEP) if math.isfinite(less + more) else own
    return SpeedPower(0.0, math.hypot(POWER_DOUBT, FORM_DOUBT), space.opened(z)[1], own, by_power)


def _without_waves(space: Space, z: FloatArray) -> Space:
    """Return where to search for the boat of the vector in a sea without waves."""
    rates, weather, train = space.opened(z)
    still = Space(space.record, rates, weather._replace(wave=0.0), train, space.parts, space.scale, moved=space.moved)
    still.priors, still.path = space.priors, space.path[:, :3]
    return still


POWER_DOUBT, FORM_DOUBT = 0.5, 0.35
"""Of the power of the speed with which a rudder steers, one standard deviation, before a record is known (of thrust
about its law's): 2 in the boat's own flow, 1 in a race as strong, which keeps its speed in a turn, more where the flow
at the rudder loses more than the boat does. And from one manoeuvre to another, whatever the record: no boat goes by a
power alone."""
POWER_STEP, POWER_TURNS, POWER_ROUNDS = 0.5, 2, 5
"""Powers of the speed by which it is tried, Newton's steps to the boat that suits one, and to the power."""
WAVES_GAIN = 3.0
"""Of the likelihood's logarithm, by waves that are there: one for each of their numbers (Akaike 1974)."""
POWER_GAINS = 1.0
"""Of the likelihood's logarithm, by a step to another power, for another step to follow."""


def _motions(space: Space, z: FloatArray) -> tuple[FloatArray, ...]:
    """Return `LikelihoodFit.motions` at the vector."""
    states, record = space.found(z).states, space.record
    substeps = record.substeps
    ends = np.append(record.first[1:], record.nodes)
    return tuple(
        np.stack([edges[::substeps], *states[first:end, :2].T])
        for edges, first, end in zip(record.edges, record.first, ends, strict=True)
    )


def _unseen(space: Space, z: FloatArray, memory: float, least: float) -> Unseen:
    """Return what delay and play would do for the likelihood, had the boat one step of Newton's to suit them. A play
    below the `least` [rad] is not tried: it would only take up what noise the recorded rudder has."""
    space.keep(z)
    train, record = space.opened(z)[2], space.record
    delays = [train._replace(delay=share * memory) for share in LATE_SHARES] if train.delay == 0.0 else []
    tried = [play for play in PLAYS if play > least] if train.dead_band == 0.0 else []
    ways = [(lag * memory, ratio * lag * memory) for lag, ratio in SLIDING_WAYS] if train.lead == 0.0 else []
    largest = max(float(np.quantile(np.abs(angle), LARGEST_ANGLE)) for _, angle in record.paths)
    trains = [
        *delays,
        *(train._replace(dead_band=play) for play in tried),
        *(train._replace(lag=lag, lead=lead) for lag, lead in ways),
    ]
    rudders = [rudder_on(record, each) for each in trains]
    rudders += [rudder_on(_stopped(record, share * largest), train) for share in STOPS]
    worths = iter(space.worths_behind(z, rudders))
    late = [next(worths) for _ in delays]
    plays = {0.0: 0.0, **{play: next(worths) for play in tried}}
    slides = max((next(worths) for _ in ways), default=0.0)
    stops = {share * largest: next(worths) for share in STOPS}
    likeliest = max(plays, key=lambda play: plays[play])
    unlikely = [play for play in plays if play > likeliest and plays[play] < plays[likeliest] - UNLIKELY]
    stop = max(stops, key=lambda each: stops[each])
    return Unseen(
        max([0.0, *late]),
        plays[likeliest],
        likeliest,
        min(unlikely, default=math.inf),
        slides,
        max(stops[stop], 0.0),
        stop,
    )


def _stopped(record: Record, stop: float) -> Record:
    """Return the record of a rudder that went no further than `stop` [rad] to either side."""
    return record._replace(paths=tuple((time, np.clip(angle, -stop, stop)) for time, angle in record.paths))


def angle_of(segments: Sequence[Segment]) -> float:
    """Return the angle [rad] at which a rudder that steers with delta^(1+p) does what one that steers with a delta does
    in this record, by least squares and for small p: the mean of log(delta), by the angles' squares."""
    size = np.abs(np.concatenate([segment.rudder for segment in segments]))
    square = size * size
    total = float(square.sum())
    return math.exp(float(square @ np.log(np.maximum(size, LEAST_ANGLE))) / total) if total > 0.0 else math.inf


LEAST_ANGLE = 1.0e-6
SURELY_STOPS = 8.0
"""A stop that nothing shows is believed where it raises the logarithm of the likelihood by so much."""
LARGEST_ANGLE, STOPS = 0.98, (0.4, 0.5, 0.6, 0.7, 0.8)
"""The largest angle of a rudder is this quantile of its record; stops are tried at so many times it."""
LATE_SHARES = (0.03, 0.1)
"""Delays that are tried, as shares of the boat's time constant."""
SLIDING_WAYS = (*((lag, ratio) for lag in (0.05, 0.15, 0.3, 0.6) for ratio in (1.6, 2.4)), (0.15, 3.0))
"""Lags that are tried, as shares of the time in which the boat forgets its rate, each with leads of so many times it
(`SWAY`): one lag or ratio that is far off makes a boat that slides less likely than one that does not."""
PLAYS = tuple(math.radians(each) for each in (0.25, 0.5, 1.0, 2.0))
"""Plays of the rudder that are tried, to either side."""
PLAY_NOISES, PLAY_JUMPS = 4.0, 1.0 / 6.0
"""Deviations of the recorded rudder's noise that a play must be larger than, and the share of a jump between samples:
its moment is unknown by a sample, and a lag behind it makes of that an angle that may pass for play."""


def least_play(segments: Sequence[Segment]) -> float:
    """Return the play [rad] below which the recorded rudder, with its noise and its jumps, tells none."""
    noise = max(white_noise(segment.rudder) for segment in segments)
    jump = max(float(np.max(np.abs(np.diff(segment.rudder, 2)), initial=0.0)) for segment in segments)
    return max(PLAY_NOISES * noise, PLAY_JUMPS * jump)


UNLIKELY = 1.92
"""What is so much less likely, in the logarithm, lies outside of a 95 % interval."""


LONG, PART = 1500, 0.1
"""A record of more nodes is first searched in a part of each segment, this share of it."""


def _liveliest(segment: Segment) -> Segment:
    """Return the part of a segment in which the rudder moves most, of those that lie side by side."""
    length = max(int(PART * segment.time.size), SHORTEST_PART)
    begins = range(0, max(segment.time.size - length, 0) + 1, length)
    first = max(begins, key=lambda at: float(np.std(segment.rudder[at : at + length])))
    inside = slice(first, first + length)
    return Segment(*(values[inside] if values.size else values for values in segment))


SHORTEST_PART = 100


class Start(NamedTuple):
    """Rates to begin with, and the share of the turning's changes that they explain."""

    rates: Rates
    explained: float


def start_rates(segments: Sequence[Segment], reference_speed: float) -> Start:
    """Return the rates that explain best what turns the boat, as a smoother that knows no boat sees it.

    g of a path with a = b = d = e = 0 is the boat's whole acceleration; least squares on rudder, rate, its cube and
    one gives the four. Noise draws b towards 0; a boat of either stability is found.
    """
    rate = largest_rate(segments)
    record = record_of(segments, reference_speed, 5.0)
    rudder = rudder_on(record)
    gyro, compass = instruments(segments)
    push = max(rate / TURNS_WITHIN_S, 1.0e-6)
    path = best_path(
        Rates(0.0, 0.0), Weather(push, 2.0, 0.05 * push, gyro, compass), record, rudder, begin_path(record)
    )
    now = record.begin
    r, turning = path.states[now, 1], path.states[now, 2]
    steering, linear, higher = (scale.mean(axis=0) for scale in record.scales)
    columns = np.stack([steering * rudder[0].mean(axis=0), -linear * r, -higher * r**3, -steering], axis=1)
    inside = np.abs(r) < 2.0 * rate
    if np.count_nonzero(inside) < 8 or not math.isfinite(path.loss):
        return Start(Rates(0.0, 1.0), 0.0)
    best = _regressed(columns[inside], turning[inside])
    if best.rates.d < 0.0:
        best = _regressed(columns[inside][:, [0, 1, 3]], turning[inside])
    return best


TURNS_WITHIN_S = 2.0
"""A boat comes to its largest rate in no less; of quicker ones the smoother smooths more than it should."""


def better_start(segments: Sequence[Segment], reference_speed: float, starts: Sequence[Rates]) -> Rates:
    """Return the one of `starts` that a record in rough weather makes the likeliest."""
    if len(starts) == 1:
        return starts[0]
    memory = min(memory_of(start, segments) for start in starts)
    record = record_of(segments, reference_speed, memory)
    rudder, path, (gyro, compass) = rudder_on(record), begin_path(record), instruments(segments)

    def loss(start: Rates) -> float:
        push = scales(segments, start).e * ROUGH
        return best_path(start, Weather(push, 3.0, 0.1 * push, gyro, compass), record, rudder, path).loss

    return min(starts, key=loss)


ROUGH = 0.1
"""Rough weather, as a share of the rudder's moment."""


def _regressed(columns: FloatArray, turning: FloatArray) -> Start:
    values, *_ = np.linalg.lstsq(columns, turning, rcond=None)
    rest, whole = turning - columns @ values, turning - np.mean(turning)
    explained = 1.0 - float(rest @ rest) / max(float(whole @ whole), 1.0e-300)
    a, b, *cubic, e = values.tolist()
    return Start(Rates(a, b, cubic[0] if cubic else 0.0, e), explained)


def memory_of(rates: Rates, segments: Sequence[Segment], power: int = 3) -> float:
    """Return the shortest time [s] within which the boat forgets its rate: that of a turn at the largest one."""
    slope = power * max(rates.d, 0.0) * largest_rate(segments) ** (power - 1)
    return 1.0 / max(abs(rates.b) + slope, SLOWEST)


SLOWEST = 1.0e-4
"""Slower boats [1/s] are integrated as if they were as quick."""


def scales(segments: Sequence[Segment], guess: Rates, power: int = 3) -> Rates:
    """Return of which size a, b, d and e are where each of them takes the rudder's whole moment at the largest rate."""
    rudder = np.concatenate([np.abs(segment.rudder - np.median(segment.rudder)) for segment in segments])
    largest = float(np.quantile(rudder, 0.98))
    rate = largest_rate(segments)
    a = abs(guess.a)
    return Rates(a, a * largest / rate, a * largest / rate**power, a * largest)


def largest_rate(segments: Sequence[Segment]) -> float:
    """Return the largest rate [rad/s] in the record that is not noise."""
    found = []
    for segment in segments:
        known = np.isfinite(segment.heading)
        if known.sum() > 8:
            time, heading = segment.time[known], segment.heading[known]
            grid = np.arange(time[0], time[-1], max(1.0, 3.0 * float(np.median(np.diff(time)))))
            if grid.size > 3:
                found.append(float(np.quantile(np.abs(np.diff(np.interp(grid, time, heading)) / np.diff(grid)), 0.95)))
        elif np.isfinite(segment.rate).any():
            found.append(float(np.nanquantile(np.abs(segment.rate), 0.95)))
    return max([1.0e-5, *found])


def _without_white(space: Space, usual: Weather) -> tuple[Space, FloatArray, float]:
    """Return what `approached` finds in a space, with the space; where it ends in white pushes, of a second search that
    begins in lasting gusts, if that ends better.

    White pushes stand for gusts, for waves and for what the model misses alike, and take the instruments' noise with
    them: whatever comes next would be beside the noise that they ended with.
    """
    z, loss = approached(space, space.start)
    rates, weather, train = space.opened(z)
    if weather.white > ROUGH_WHITE * usual.white:
        lasting = _long_gusts(weather, usual.white)._replace(gyro=usual.gyro, compass=usual.compass)
        beside = space.beside_at(z)
        other = Space(
            space.record, rates, lasting, train, space.parts, space.scale, beside, space.groups, moved=space.moved
        )
        other.priors, other.path = space.priors, space.path
        if math.isfinite(other.found(other.start).loss):
            again = approached(other, other.start)
            if again[1] < loss:
                return other, *again
    return space, z, loss


def _long_gusts(weather: Weather, white: float) -> Weather:
    """Return weather with gusts of the usual time that push as much in the long run, and so much `white`."""
    slow = math.hypot(weather.gust * math.sqrt(2.0 * weather.gust_time), weather.white)
    return weather._replace(gust=slow / math.sqrt(2.0 * GUST_TIME_S), gust_time=GUST_TIME_S, white=white)


def _with_waves(space: Space, z: FloatArray, loss: float, usual: Weather) -> list[Space]:
    """Return where to search for a boat in waves of either kind, beside the best one found without, `z`; empty where
    that shows none.

    usual: the weather that a search begins with where none is known.

    Gusts that pass as quickly as waves, or white ones of that size, are what waves and gusts that last are taken for
    where there are no waves to be found: beside waves they begin at the usual time, with as much push in the long run.
    Begun weaker, white ones would take their place, whose doubt about the rudder's zero is less.
    """
    rates, weather, train = space.opened(z)
    hurried = weather.gust_time < HURRIED_S or weather.white > ROUGH_WHITE * usual.white
    slow = math.hypot(weather.gust * math.sqrt(2.0 * weather.gust_time), weather.white)
    # white pushes show the instruments' noise as strongly as waves: gusts that pass as quickly do not
    quick = {"gust": slow / math.sqrt(2.0 * HURRIED_S), "gust_time": HURRIED_S, "white": usual.white}
    seen = z.copy()
    for name, value in quick.items():
        seen[space.names.index(name)] = math.log(value)
    guesses = [_wave_start(space, seen, weather)]
    if hurried:
        guesses = [_long_gusts(guesses[0], usual.white)]
    else:
        guesses.append(_wave_start(space, z, weather))
    beside = space.beside_at(z)
    found, maybe = [], MAYBE_WAVES if space.record.nodes <= LONG else MAYBE_LONG
    for pushes in (False, True):
        tried = []
        for wavy, size in itertools.product(guesses, WAVE_SIZES):
            sized = wavy._replace(wave=size * wavy.wave, wave_pushes=pushes)
            start = Space(
                space.record, rates, sized, train, space.parts, space.scale, beside, space.groups, moved=space.moved
            )
            if space.strengths:
                start.start[-len(space.strengths) :] = z[-len(space.strengths) :]
            # the boat's own path is near, whatever the waves
            start.path[:, :3] = space.path
            # one step of Newton's tells sizes from one another
            tried.append((start, start.found(start.start, rounds=1).loss))
        likeliest, _ = min(tried, key=lambda each: each[1])
        if hurried or likeliest.found(likeliest.start).loss < loss - maybe:
            found.append(likeliest)
    return found


def _wave_start(space: Space, z: FloatArray, weather: Weather) -> Weather:
    """Return the `weather` with waves at the strongest frequency of what pushes the boat and is no lasting gust."""
    rates, _, train = space.opened(z)
    record, states = space.record_at(z), space.found(z).states
    motion = motion_of(rates, record, rudder_on(record, train), states)
    push = states[record.begin, 2] + motion.rate / record.step
    spacing = float(np.median(record.step))
    bare = push - np.convolve(np.pad(push, 10, mode="edge"), np.full(21, 1.0 / 21.0), mode="valid")[: push.size]
    spectrum = np.abs(np.fft.rfft(bare * np.hanning(bare.size))) ** 2
    frequency = 2.0 * math.pi * np.fft.rfftfreq(bare.size, spacing)
    band = (frequency > 0.3) & (frequency < 0.7 * math.pi / spacing)
    if not band.any():
        return weather._replace(wave=weather.compass, wave_frequency=1.0)
    at = float(frequency[band][int(np.argmax(spectrum[band]))])
    size = float(np.std(bare)) / at**2
    return weather._replace(wave=max(size, 0.1 * weather.compass), wave_frequency=at, wave_damping=0.1)
