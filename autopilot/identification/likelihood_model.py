"""The likeliest boat (`likelihood_fit`) in Norrbin's convention, n1 = 1 or -1, and in words what the runs cannot tell.

With T = 1/|b|, n1 is the sign of b, K = a T, n3 = d T, n0 = e T, and their standard errors follow from the covariance
of a, b, d and e to first order. Where b cannot be parted from 0 no T is given, nor what is a multiple of it: the runs
then determine K/T and n3/T, and those are named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from autopilot.identification.boat_prior import BoatPrior, Combined, Expected, combined
from autopilot.identification.compass_and_gyro import on_one_course, turned_apart
from autopilot.identification.identified import (
    LARGEST_RELATIVE_ERROR,
    Identified,
    Question,
    Ratios,
    Sliding,
    Steps,
    too_quick,
)
from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.likelihood_fit import (
    CHANGED,
    UNLIKELY,
    LikelihoodFit,
    Start,
    Unseen,
    better_start,
    least_play,
    likelihood_fit,
    start_rates,
)
from autopilot.identification.likelihood_record import Surroundings, usual_race
from autopilot.identification.likelihood_search import SWAY
from autopilot.identification.marginal_likelihood import Rates
from autopilot.identification.one_boat import differing
from autopilot.identification.residual_tests import Simulation, answered_share, one_of, predict
from autopilot.identification.residuals import Noise, residual_noise
from autopilot.identification.rudder_path import RudderTrain, small_swings
from autopilot.identification.runs import FloatArray, Run, Segment, has_propeller, has_wind, spacing_of
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind

ORDERED = ("delay", "lag")
"""What lies between an ordered rudder and the water."""
LEAST_EXPLAINED = 0.1
"""Share of the turning's changes that rates must explain to begin with them."""
SURELY_TURNS = 3.0
"""K/T must differ from 0 by so many standard errors."""
QUICK = 0.5
"""A boat with a T below this share of the time between two samples answers before they show it."""
SURELY_LATE = 5.0
"""A delay of which nobody knows is looked for where it would raise the logarithm of the likelihood by so much."""
SURELY_SLIDES = 10.0
"""A boat slides where that raises the logarithm of the likelihood by so much: two numbers more, of any log."""
SMALLEST_B = 1.0e-6


def ordered(runs: Sequence[Run]) -> bool:
    """Return whether the recorded rudder is an order, or a pilot's estimate from its orders, and no measured angle."""
    return all(run.rudder != "measured" for run in runs)


def likeliest(
    runs: Sequence[Run], speed: float, linear: Norrbin | None, question: Question, steps: Steps
) -> Identified | None:
    """Return the likeliest boat at the reference `speed` [m/s]; None where another fit must say why there is none.

    linear: the best linear model, to begin with, if there is one. question: what is fitted of the rudder's way, and
    what other boats say of this one.
    """
    found, reasons = likeliest_fit(runs, speed, linear, question.rudder_train, steps)
    answer = None if found is None else answer_of(found, runs, speed, question.prior, reasons)
    if found is None or answer is None:
        return None
    # gusts have taken up most of what the slide would explain: held, they show little of its worth
    if found.unseen.sway_worth < UNLIKELY:
        return answer
    sliding, is_sure = _sliding(found, runs, speed, linear, steps)
    if sliding is None:
        return answer
    assert answer.likely is not None
    doubt, said = _doubt_of_order(answer.likely, sliding), _slides(sliding) if is_sure else _may_slide(sliding)
    return answer._replace(sliding=sliding if is_sure else None, of_order=doubt, notes=(*answer.notes, said))


def as_doubtful(answer: Identified, runs: Sequence[Run], steps: Steps) -> Identified:
    """Return the answer with the doubt that one model of all runs hides: of parts that are not of one boat, where
    propeller, wind and drift do not explain that, of a first order that a boat that slides has not, of a rudder's lag
    that T may have changed places with, and of compass and gyro that turn by different angles."""
    speed, apart, differ, changed = answer.model.reference_speed, turned_apart(runs), None, None
    if answer.around is None and answer.likely is not None:
        differ, changed = differing(answer.likely, runs, speed, steps.next), doubt_of_change(answer.likely, runs)
    said = [*([f"{differ.sentence()}."] if differ else []), *([apart.sentence()] if apart else [])]
    said += [] if changed is None else [f"{LAG_OR_T[0].upper()}{LAG_OR_T[1:]}: {RECORD_IT}."]
    if answer.around is None and answer.likely is not None and (said or answer.of_order is not None):
        more = np.zeros((4, 4)) if answer.of_order is None else answer.of_order.copy()
        more += differ.doubt if differ is not None else 0.0
        more += 0.0 if changed is None else changed
        more += apart.doubt(answer.likely.rates) if apart is not None else 0.0
        wide = answer_of(answer.likely.with_doubt(more), runs, speed, None, {}, answer.simulations)
        assert wide is not None
        answer = answer._replace(
            standard_errors=wide.standard_errors,
            covariance=wide.covariance,
            ratios=wide.ratios,
            likely=wide.likely,
            unidentifiable={**answer.unidentifiable, **wide.unidentifiable},
        )
    elif apart is not None:
        gain = math.hypot(answer.standard_errors["gain"] or 0.0, apart.doubt_of_gain * answer.model.gain)
        answer = answer._replace(standard_errors={**answer.standard_errors, "gain": gain})
    is_stable = answer.model.n1 > 0.0 and "T" not in answer.unidentifiable
    answers = answered_share(answer.model, runs, [answer.simulated(run) for run in runs]) if is_stable else 0.0
    said += filter(None, [on_one_course(runs)])
    return answer._replace(
        differing=differ, answers=answers, may_be_lag=changed is not None, notes=(*answer.notes, *said)
    )


LAG_OR_T = "the rudder's lag and T may have changed places within the time between two reports of its orders"
RECORD_IT = "record the orders more often, or the rudder's angle by a sensor"


def doubt_of_change(found: LikelihoodFit, runs: Sequence[Run]) -> FloatArray | None:
    """Return as covariance of a, b, d and e, shape (4, 4), what it leaves open that T and the rudder's lag may have
    changed places; None where the runs tell them apart.

    Two lags in a row answer alike in either order, and which is T shows in what goes on within the shorter one. Of
    orders reported no oftener nothing is recorded of that, and the likelihood, to which their unknown moments are
    noise, may prefer the wrong one by tens. The other boat has all of both, as little of a rudder lags so long.
    """
    b, lag = found.rates.b, found.train.lag if "lead" not in found.train_errors else 0.0
    if not b > 0.0 or not lag > 0.0:
        return None
    shorter = min(1.0 / b, lag) if b * lag > CHANGED else 1.0 / b
    if not shorter < _between_orders([segment for run in runs for segment in run.segments]):
        return None
    off = b * lag / (1.0 + b * lag) * np.array(found.rates)
    return np.outer(off, off)


def _between_orders(segments: Sequence[Segment]) -> float:
    """Return the time [s] between two reports of orders at moments that nobody knows, 0 of a rudder that is known
    throughout: of moves D the integral of the rudder has a variance of D^2 h^2/12 each (`Segment.moments`)."""
    variance = moved = 0.0
    for segment in (each for each in segments if each.moments.size):
        variance += float(segment.moments[-1] - segment.moments[0])
        steps = np.diff(segment.rudder)
        begins = np.flatnonzero(np.diff(np.sign(steps), prepend=math.nan))
        moved += float(np.square(np.add.reduceat(steps, begins)).sum())
    return math.sqrt(12.0 * variance / moved) if moved > 0.0 else 0.0


def _sliding(
    found: LikelihoodFit, runs: Sequence[Run], speed: float, linear: Norrbin | None, steps: Steps
) -> tuple[Sliding | None, bool]:
    """Return the boat of second order where the runs show that the boat slides, or may, and whether they surely do;
    None where they do not.

    Surely it must make them surely likelier, its lead must be surely longer than its lag, which else is the steering
    gear's, and it must explain more of the runs from rudder and speed alone.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    kept = tuple(name for name in found.train_errors if name not in SWAY)
    # likelihoods are compared on one grid of times, which goes with where the search begins
    begin = _begin(segments, speed, start_rates(segments, speed), linear)
    if begin is None:
        return None, False
    straight = likelihood_fit(segments, speed, begin, kept, steps.next) if kept else found
    fit = likelihood_fit(segments, speed, begin, (*kept, *SWAY), steps.next)
    if fit is None or straight is None or fit.rates.a <= 0.0 or fit.train.lead <= fit.train.lag:
        return None, False
    worth = straight.loss - fit.loss
    if worth < UNLIKELY:
        return None, False
    sliding, before = Sliding(in_norrbin(fit, speed)[0], fit), in_norrbin(found, speed)[0]
    if worth < SURELY_SLIDES or not fit.train.lead - fit.train.lag > SURELY_TURNS * _error_between(fit):
        return sliding, False
    unexplained = [
        sum(1.0 - (predict(model, run, None, train).yaw_rate_r2 or 0.0) for run in _with_rates(runs, found))
        for model, train in ((before, found.train), (sliding.model, fit.train))
    ]
    return sliding, unexplained[1] < unexplained[0]


def _error_between(fit: LikelihoodFit) -> float:
    """Return the standard error [s] of lead less lag, whose doubts go together."""
    assert fit.joint is not None
    names = tuple(fit.train_errors)
    by = np.zeros(fit.joint.shape[0])
    by[4 + names.index("lag")], by[4 + names.index("lead")] = -fit.train.lag, fit.train.lead
    return math.sqrt(max(float(by @ fit.joint @ by), 0.0))


def _with_rates(runs: Sequence[Run], found: LikelihoodFit) -> list[Run]:
    """Return the runs with the yaw rate that the whole recording tells where none was measured.

    Headings are no measure of what a model explains by itself: an error of the first rate turns all that follow.
    """
    motions, filled = iter(found.motions), []
    for run in runs:
        segments = []
        for segment in run.segments:
            time, _, rate = next(motions)
            known = np.isfinite(segment.rate).any()
            segments.append(segment if known else segment._replace(rate=np.interp(segment.time, time, rate)))
        filled.append(run._replace(segments=tuple(segments)))
    return filled


def _under_slow_rudder(sliding: Sliding) -> LikelihoodFit:
    """Return the boat of first order that a boat that slides is under a slow rudder: as it turns for good, with
    T1 + T2 - T3 for T."""
    (_, _, lag, lead), rates = sliding.fit.train, sliding.fit.rates
    share = max(1.0 - rates.b * (lead - lag), LEAST_OF_FIRST)
    return sliding.fit._replace(rates=Rates(*(value / share for value in rates)))


def _doubt_of_order(first: LikelihoodFit, sliding: Sliding) -> FloatArray:
    """Return what the `first` order leaves open of a boat that slides, as covariance of a, b, d and e, shape (4, 4).

    The first order is that of the manoeuvre's frequencies; under a slower rudder the boat turns by another.
    """
    off = np.array(_under_slow_rudder(sliding).rates) - first.rates
    return np.outer(off, off)


LEAST_OF_FIRST = 0.25
"""Of T1: no boat that slides is said to have a T1 + T2 - T3 of less."""


def _slides(sliding: Sliding) -> str:
    """Return what is to be said of a boat that slides."""
    model, (_, _, lag, lead) = sliding.model, sliding.fit.train
    errors, (slow, _) = sliding.fit.train_errors, in_norrbin(_under_slow_rudder(sliding), model.reference_speed)
    return (
        f"The boat slides in its turns: of Nomoto's second order its lag T2 is {lag:.2g} +- "
        f"{SURE_OF_IT * errors['lag']:.1g} s and its lead T3 {lead:.2g} +- {SURE_OF_IT * errors['lead']:.1g} s, with K "
        f"{model.gain:.3g} 1/s, T1 {model.time_constant:.3g} s and n1 {model.n1:+.0f}. Predictions are made with it. "
        "The boat is steered by K, T and n3 above, of the first order at the manoeuvre's frequencies; their intervals "
        f"hold those under a slow rudder, K {slow.gain:.3g} 1/s and T {slow.time_constant:.3g} s."
    )


def _may_slide(sliding: Sliding) -> str:
    """Return what is to be said of a boat that may slide."""
    slow, _ = in_norrbin(_under_slow_rudder(sliding), sliding.model.reference_speed)
    return (
        "These runs do not tell whether the boat slides in its turns, which would explain them better: under a slow "
        f"rudder it would turn by K {slow.gain:.3g} 1/s and T {slow.time_constant:.3g} s, which the intervals "
        "hold; more zigzags, and turns held for minutes, would tell."
    )


def beside_surroundings(more: Identified, likely: Identified, runs: Sequence[Run], steps: Steps) -> Identified | None:
    """Return the answer `more`, which the residuals weigh, with all its numbers as the likelihood of the runs has them,
    so that gusts, wind and race keep their doubt in one another; None of a boat that drifts, of a race that nobody
    recorded, and where that leaves no course-stable boat.

    What was recorded is fitted, shown or not: what the runs do not tell of it is a doubt about K and T.
    """
    found, around, speed = likely.likely, more.around, more.model.reference_speed
    if found is None or around is None or around.drifts or around.steady_race > 0.0:
        return None
    names: tuple[str, ...] = ("race",) if has_propeller(runs) and around.reference_propeller > 0.0 else ()
    names += ("wind_beam", "wind_quarter") if has_wind(runs) else ()
    if "race" in names and around.race <= 0.0:
        around = around._replace(race=usual_race(speed, around.reference_propeller))
    K, T, n3, _, _, n0, _ = more.model
    parts = tuple(name for name in found.train_errors if getattr(found.train, name) > 0.0)
    segments = tuple(segment for run in runs for segment in run.segments)
    surroundings = Surroundings(names, around)
    fit = likelihood_fit(
        segments, speed, Rates(K / T, 1.0 / T, n3 / T, n0 / T), parts, steps.next, surroundings=surroundings
    )
    if fit is None or fit.joint is None or fit.around is None:
        return None
    free = ("gain", "time_constant", "n3", "n0", *parts, *names)
    own = [float(getattr(fit.around, name)) for name in names]
    logs = [math.log(float(getattr(fit.train, name))) for name in parts]
    searched = [math.log(value) if name == "race" else value for name, value in zip(names, own, strict=True)]
    vector = np.array([*fit.rates, *logs, *searched])
    spread = np.sqrt(np.maximum(np.diag(fit.joint), 0.0))
    if vector[0] <= 0.0 or vector[1] < SURE_OF_IT * spread[1]:
        return None
    here = _as_named(vector, free)
    slope = np.empty((here.size, vector.size))
    for i, by in enumerate(np.maximum(NUDGE * spread, 1.0e-300)):
        beside = vector.copy()
        beside[i] += by
        slope[:, i] = (_as_named(beside, free) - here) / by
    covariance = slope @ fit.joint @ slope.T
    values = dict(zip(free, here.tolist(), strict=True))
    errors = dict(zip(free, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True))
    a, b, d, e = spread[:4].tolist()
    ratios = Ratios((fit.rates.a, fit.rates.b, fit.rates.d, fit.rates.e), (a, b, d, e))
    model = more.model._replace(**{name: values[name] for name in Norrbin._fields if name in values})
    around = around._replace(**{name: values[name] for name in names})
    every = {**dict.fromkeys(more.standard_errors), **errors}
    reasons = {symbol: why for symbol, why in more.unidentifiable.items() if symbol not in (*names, "n3")}
    for name in names:
        if errors[name] > LARGEST_RELATIVE_ERROR * abs(values[name]):
            reasons[name] = (
                f"{name}: {values[name]:.3g} with a standard error of {errors[name]:.2g} cannot be distinguished from "
                "0; it is kept with its doubt, which K and T share; trials at other speeds and in stronger wind would "
                "tell it."
            )
    made = _simulations(model, runs, fit.train, around)
    return more._replace(
        model=model,
        around=around,
        ratios=ratios,
        unidentifiable={**reasons, **reasons_of(ratios, model, every)},
        standard_errors=every,
        noise=_noises(made),
        simulations=made,
        free=free,
        covariance=covariance,
        train=fit.train,
        is_blind=False,
    )


NUDGE = 1.0e-3
"""Of a standard error, over which slopes are taken."""


def _as_named(vector: FloatArray, free: Sequence[str]) -> FloatArray:
    """Return K, T, n3, n0 and what else is `free` of a, b, d, e and what else the likelihood's `vector` has: logarithms
    of the train's parts and of the race."""
    a, b, d, e = vector[:4].tolist()
    values = [a / b, 1.0 / b, max(d, 0.0) / b, e / b]
    for name, value in zip(free[4:], vector[4:].tolist(), strict=True):
        values.append(math.exp(value) if name == "race" or name in RudderTrain._fields else value)
    return np.array(values)


def follows_surely(answer: Identified) -> bool:
    """Return whether the recording shows surely that the boat turns to the side of its rudder."""
    ratios = answer.ratios
    return ratios is not None and ratios.values[0] > SURELY_TURNS * ratios.errors[0]


def likeliest_fit(
    runs: Sequence[Run], speed: float, linear: Norrbin | None, train: tuple[str, ...], steps: Steps
) -> tuple[LikelihoodFit | None, dict[str, str]]:
    """Return the fit to the recording alone, and what of the `train` it cannot tell, by name.

    A rudder that was only ordered comes late, whether the runs show it or not: left out, delay and lag would be taken
    for a part of T, with the doubt of a T that is known by itself. They stay, with what is usual of them. Of a measured
    rudder they are left out where the runs do not show them.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    regressed = start_rates(segments, speed)
    begin = _begin(segments, speed, regressed, linear)
    if begin is None:
        return None, {}
    reasons: dict[str, str] = {}
    found = likelihood_fit(segments, speed, begin, train, steps.next)
    if found is not None and train:
        stays = ordered(runs)
        direct = None if stays else likelihood_fit(segments, speed, begin, (), steps.next)
        # neither is ever found to be 0: that they are nearly, a fit without them says
        is_as_likely = direct is not None and direct.loss < found.loss + SURELY_LATE
        if is_as_likely or not _is_late(found):
            reasons |= dict.fromkeys(train, _why_no(found, stays))
            found = found if stays else direct
    if found is None or not set(train) <= set(ORDERED):
        return found, reasons
    kept, unseen, shown = tuple(found.train_errors), found.unseen, dict[str, LikelihoodFit]()
    for part in _worth_a_try(unseen):
        if unseen.stops and part == "dead_band":
            continue
        behind = likelihood_fit(segments, speed, found.rates, (*kept, part), steps.next)
        if behind is not None and _is_shown(part, behind, segments):
            shown[part] = behind
    # a quick boat that answers late looks as if its rudder had play, or stopped short: what was fitted decides
    part = min(shown, key=lambda name: shown[name].loss, default="")
    if not part or (unseen.stops and found.loss - shown[part].loss < unseen.stop_worth):
        return found, reasons
    if part == "dead_band" and small_swings(segments) > MOST_SMALL:
        return _between(found, shown[part]), reasons
    return shown[part], reasons


def _is_shown(part: str, behind: LikelihoodFit, segments: Sequence[Segment]) -> bool:
    """Return whether the fit `behind` a play or a delay shows it surely."""
    if part == "dead_band":
        sure = SURELY_TURNS * behind.train_errors["dead_band"]
        return behind.train.dead_band > max(sure, least_play(segments))
    return _is_late(behind) and behind.train.delay > 0.5 * spacing_of(segments)


def _between(found: LikelihoodFit, behind: LikelihoodFit) -> LikelihoodFit:
    """Return the boat between one without play and one `behind` it, with the doubt which of them it is.

    A rudder that answers waves goes with what they do to the boat. Where the waves are taken for a motion of their own
    that makes the small swings of the rudder seem idle, as a play makes them.
    """
    middle = Rates(*(0.5 * (a + b) for a, b in zip(found.rates, behind.rates, strict=True)))
    half = 0.5 * (np.array(behind.rates) - found.rates)
    unseen = found.unseen._replace(play=behind.train.dead_band, maybe_play=True)
    return found.with_doubt(np.outer(half, half))._replace(rates=middle, unseen=unseen)


MOST_SMALL = 0.1
"""Share of the rudder's travel in small swings up to which a play can be parted from answers to waves."""


def _worth_a_try(unseen: Unseen) -> tuple[str, ...]:
    """Return the parts of the rudder's way that would make the record surely likelier, the likeliest first."""
    worth = {"dead_band": unseen.play_worth, "delay": unseen.late_worth}
    return tuple(sorted((part for part in worth if worth[part] > SURELY_LATE), key=lambda part: -worth[part]))


def _begin(segments: Sequence[Segment], speed: float, regressed: Start, linear: Norrbin | None) -> Rates | None:
    starts = []
    if linear is not None:
        T = linear.time_constant
        starts.append(Rates(linear.gain / T, 1.0 / T, 0.0, linear.n0 / T))
    if regressed.rates.a > 0.0 and regressed.explained > LEAST_EXPLAINED:
        starts.append(regressed.rates)
    return better_start(segments, speed, starts) if starts else None


def _is_late(found: LikelihoodFit) -> bool:
    """Return whether the runs show that the rudder is late at all: delay and lag together exceed their doubt.

    What is whose may stay open, and it may be less than the spacing of the samples: held at 0, it would be taken for
    a part of T.
    """
    return found.train.delay + found.train.lag > SURELY_TURNS * found.late_error


def _why_no(found: LikelihoodFit, kept: bool) -> str:
    late = found.train.delay + found.train.lag
    then = "and T, from which they take their part, is as uncertain" if kept else "so both are held at 0"
    return (
        f"The rudder's delay and lag are {late:.3g} s together, with a standard error of {found.late_error:.2g} s: "
        f"that cannot be distinguished from 0, {then}. Trials with quick reversals, sampled well within that time, "
        "would show it."
    )


def answer_of(
    found: LikelihoodFit,
    runs: Sequence[Run],
    speed: float,
    prior: BoatPrior | None,
    reasons: Mapping[str, str],
    made: Sequence[Simulation] = (),
) -> Identified | None:
    """Return a fit in Norrbin's convention, together with what other boats say; None where it turns the boat against
    its rudder. made: simulations that need not be made again."""
    if found.rates.a <= 0.0:
        return None
    # that the boat turns to the side of its rudder must be in the recording: no other boat can say that
    turns = found.rates.a > SURELY_TURNS * math.sqrt(max(float(found.covariance[0, 0]), 0.0))
    expected = None if prior is None or not turns else prior.at(speed)
    together = None if expected is None else combined(found.rates, found.covariance, expected)
    if together is not None:
        found = found._replace(rates=together.rates, covariance=together.covariance)
    a, b, d, e = found.rates
    spread = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    ratios = Ratios((a, b, d, e), (spread[0], spread[1], spread[2], spread[3]))
    model, covariance = in_norrbin(found, speed)
    names = ("gain", "time_constant", "n3", "n0")
    errors: dict[str, float | None] = dict(
        zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True)
    )
    errors |= {"n1": None, "n2": None, **{name: found.train_errors.get(name) for name in RudderTrain._fields}}
    reasons = {**reasons, **reasons_of(ratios, model, errors)}
    spacing = spacing_of([segment for run in runs for segment in run.segments])
    shortest = QUICK * spacing
    if "T" not in reasons and model.time_constant < shortest:
        reasons["T"] = too_quick(shortest, "half")
    made = _simulations(model, runs, found.train, None, made)
    return Identified(
        model,
        errors,
        reasons,
        _noises(made),
        free=names,
        covariance=covariance,
        train=found.train,
        ratios=ratios,
        notes=(*_behind(found, runs), *_off_zero(found), *_said(together, expected)),
        leans=dict(zip(("K", "T", "n3"), together.shares, strict=True)) if together and any(together.shares) else {},
        likely=found,
        spacing=spacing,
        simulations=made,
    )


def _behind(found: LikelihoodFit, runs: Sequence[Run]) -> tuple[str, ...]:
    """Return what is to be said of the way from the recorded rudder to the water, where nobody expects it."""
    said, unseen, train = [], found.unseen, found.train
    if unseen.stops:
        sentence = stopped_short(unseen)
        said.append(f"{sentence[0].upper()}{sentence[1:]}. Below that angle K is larger than these runs say.")
    if not ordered(runs) and train.delay > 0.0:
        said.append(
            f"The motion follows the measured rudder {train.delay:.2g} +- {SURE_OF_IT * found.late_error:.1g} s late: "
            "compass or gyro are late, or the rudder is recorded early; the delay is taken into account."
        )
        if unseen.play_worth > SURELY_LATE:
            said[-1] += " A play of the rudder would explain it nearly as well; a zigzag with half the angle tells."
    if train.dead_band > 0.0:
        error = math.degrees(SURE_OF_IT * found.train_errors["dead_band"])
        said.append(
            f"It looks as if the rudder had {math.degrees(train.dead_band):.2g} +- {error:.1g} deg of play to either "
            "side between its record and the water; it is taken into account. Measure it at the dock, and take it out "
            "of the gear."
        )
    elif unseen.maybe_play:
        said.append(
            f"A rudder with {math.degrees(unseen.play):.2g} deg of play to either side would explain the runs better, "
            "and so would a pilot or a hand that answered waves, for most swings of the rudder were small: K and T lie "
            "between both, and their intervals hold both. Measure the play at the dock, or sail a zigzag."
        )
    elif not ordered(runs) and unseen.excluded > LEAST_PLAY:
        most = f"up to {math.degrees(unseen.excluded):.2g} deg" if math.isfinite(unseen.excluded) else "of some degrees"
        said.append(
            f"These runs do not exclude a play of the rudder {most} to either side, which would show as a smaller K; "
            "zigzags with two rudder angles (5/5 and 20/20) would."
        )
    return tuple(said)


def stopped_short(unseen: Unseen) -> str:
    """Return how a rudder that stops short of its record shows."""
    return (
        f"the boat turns as if its rudder stopped at some {math.degrees(unseen.stop):.0f} deg, though its record goes "
        "further: look for an end stop, a stall at large angles, or something that slips between sensor and rudder"
    )


def _off_zero(found: LikelihoodFit) -> tuple[str, ...]:
    """Return what is to be said where the boat goes straight with the rudder surely off amidships."""
    a, e = found.rates.a, found.rates.e
    angle, error = math.degrees(e / a), math.degrees(SURE_OF_IT * math.sqrt(max(found.covariance[3, 3], 0.0)) / a)
    if abs(angle) < max(error, LEAST_OFF_DEG):
        return ()
    return (
        f"The boat goes straight with {angle:.2g} +- {error:.1g} deg of rudder: its zero is off by as much, or "
        "wind or propeller turn the boat; runs on opposite courses tell which.",
    )


LEAST_OFF_DEG = 1.0
"""A rudder's zero is seldom set closer."""
LEAST_PLAY = math.radians(0.5)
"""A play that changes nothing that matters."""


def _said(together: Combined | None, expected: Expected | None) -> tuple[str, ...]:
    """Return what is to be said of the other boats' part."""
    if together is None or expected is None:
        return ()
    if together.contradicted:
        return (
            f"The runs contradict {expected.boats} other boats of that length and speed, which were left out; check "
            "the length, the speed column and the rudder's scale, or take it that this boat is another kind.",
        )
    if not any(together.shares):
        return ()
    a, b, d = (f"{100.0 * share:.0f} %" for share in together.shares)
    return (
        f"{expected.boats} other boats of that length and speed helped: of what is known of K/T {a} is theirs, of n1/T "
        f"{b}, of n3/T {d}; more manoeuvres replace them.",
    )


def _simulations(
    model: Norrbin,
    runs: Sequence[Run],
    train: RudderTrain,
    around: RaceAndWind | None = None,
    made: Sequence[Simulation] = (),
) -> tuple[Simulation, ...]:
    return tuple(Simulation(model, run, around, train, one_of(made, model, run, around, train)) for run in runs)


def _noises(made: Sequence[Simulation]) -> tuple[Noise, Noise]:
    off = [
        values - np.stack([segment.rate, segment.heading], axis=1)
        for each in made
        for segment, values in zip(each.run.segments, each.motion, strict=True)
    ]
    return residual_noise([values[:, 0] for values in off]), residual_noise([values[:, 1] for values in off])


def in_norrbin(found: LikelihoodFit, speed: float) -> tuple[Norrbin, FloatArray]:
    """Return the model at the reference `speed` [m/s], and the covariance of K, T, n3 and n0."""
    a, b, d, e = found.rates
    b = math.copysign(max(abs(b), SMALLEST_B), b)
    T, sign = 1.0 / abs(b), math.copysign(1.0, b)
    slope = np.zeros((4, 4))
    slope[:, 1] = -sign * T * T * np.array([a, 1.0, d, e])
    slope[0, 0] = slope[2, 2] = slope[3, 3] = T
    model = Norrbin(a * T, T, max(d, 0.0) * T, n1=sign, n0=e * T, reference_speed=speed)
    return model, slope @ found.covariance @ slope.T


def reasons_of(ratios: Ratios, model: Norrbin, errors: dict[str, float | None]) -> dict[str, str]:
    """Return what the runs cannot tell with these errors, a sentence by symbol."""
    (a, b, d, _), (a_error, b_error, d_error, _) = ratios
    if ratios.on_ridge:
        known = (
            f"K/T {a:.3g} +- {SURE_OF_IT * a_error:.2g} 1/s^2 and n3/T {d:.3g} +- {SURE_OF_IT * d_error:.2g} s/rad^2 "
            "(95 %)"
        )
        why = (
            f"n1/T {b:.3g} +- {SURE_OF_IT * b_error:.2g} 1/s holds 0, so that the boat may be course-stable or not; "
            f"these runs tell {known}; sail 20/20 once more, for twice as long."
        )
        return dict.fromkeys(("K", "T"), f"K and T: not determined: {why}")
    error = errors["n3"] or 0.0
    if error > LARGEST_RELATIVE_ERROR * model.n3:
        return {
            "n3": f"n3: {model.n3:.3g} with a standard error of {error:.2g} s^2/rad^2 cannot be distinguished from 0; "
            "it is kept with its doubt, which K and T share; steady turns at large rudder angles would tell it "
            "(--steady-turns)."
        }
    return {}
