"""Whether a model is good enough to steer by, in one sentence: said before any number, and after a look at the gear.

Designed gains bear a boat that is some 30 % off its model, so that 95 % intervals of K and T inside that are good, and
wider ones are good for a start. What is not determined is no model.

No good word is said about a model where the steering gear is not the one in the vessel file. Where a sensor shows the
rudder, its angles at rest stand beside those ordered: their ratio is the scale, and where only the large orders fall
short there is the end stop; how fast it slews is measured. Where nothing shows it, the angles cannot be checked: K
counts degrees as they are ordered, and orders go out by the same scale. Its rate then shows in how the boat turns
(`autopilot.identification.ordered_rudder`), if half of it would have been noticed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from autopilot.identification.compass_and_gyro import on_one_course
from autopilot.identification.drive_effect import DriveFit
from autopilot.identification.drive_effect import Prediction as DrivePrediction
from autopilot.identification.identified import Identified
from autopilot.identification.interval import ENOUGH, GOOD, SURE_OF_IT, off_by, serves
from autopilot.identification.likelihood_model import LAG_OR_T, RECORD_IT, stopped_short
from autopilot.identification.ordered_rudder import shows_rate, with_rudder_of
from autopilot.identification.residual_tests import Prediction, ResidualTest
from autopilot.identification.rudder_path import RudderRate, rudder_rate_of
from autopilot.identification.runs import FloatArray, Orders, Run

SCALE_OFF = 0.15
"""An angle off by more than this share contradicts its order: half of the 30 % that designed gains bear."""
LEAST_OFF = math.radians(1.5)
"""Less than this [rad] a drive's dead band or a sensor's zero may be."""
RATE_OFF = 0.15
"""A measured rate slower than the file's by more than this share, and by three standard errors, contradicts it."""
STANDS_S, LOOKED_AT_S = 2.0, 1.0
"""An order has to stand so long [s]; angles at rest are medians over the other [s], the last two of it."""
STANDS, RESTS = math.radians(0.1), math.radians(0.5)
"""Orders within the one are the same, angles within the other at rest."""
LARGE, SMALL = 0.9, 0.7
"""Shares of the largest order: from the one on an end stop may be met, below the other none is."""
UNKNOWN_RATE = (
    "nothing shows how quick the rudder is: time it from stop to stop for rudder.rate_max_deg_s, or record its angle"
)
AS_TYPED = (
    "No sensor shows the rudder: its angles are as the vessel file says, and K counts degrees as they are ordered. If "
    "the rudder really goes f times as far, K is f times too large, n0/K, end stop and rate are f times too small, and "
    "the boat is steered just the same, since orders go out by the same scale. Wrong by f are then the degrees that "
    "are shown, and K beside other boats'. To know, order 10 deg at the dock and measure the angle."
)

AS_SHOWN = (
    "Nothing checks the scales of rudder and log: K counts the degrees that the rudder's sensor shows, K and T belong "
    "to the speed that the log shows, and a stop or a stall of the rudder below the angles sailed makes K smaller. To "
    "know, measure the rudder at the dock, and compare the log with GPS on opposite courses."
)


class Rest(NamedTuple):
    """What was ordered [rad], and where the rudder came to rest [rad]; side: to which the order went before it stood
    still, starboard 1, port -1, unknown 0."""

    order: float
    angle: float
    side: float = 0.0


class GearCheck(NamedTuple):
    """What contradicts the vessel file, a clause each, the worst first; what a good word needs beside it, and what
    there is to know about it: sentences, empty where a sensor and the file agree."""

    against: tuple[str, ...] = ()
    beside: str = ""
    note: str = ""


def rests_of(orders: Orders) -> list[Rest]:
    """Return where the rudder came to rest under orders that stood still."""
    found = []
    pauses = np.flatnonzero((np.abs(np.diff(orders.order)) > STANDS) | (np.diff(orders.order_time) > STANDS_S)) + 1
    for part in np.split(np.arange(orders.order.size), pauses):
        end = float(orders.order_time[part[-1]])
        if end - float(orders.order_time[part[0]]) < STANDS_S:
            continue
        last = orders.angle[(orders.time > end - LOOKED_AT_S) & (orders.time <= end)]
        before = orders.angle[(orders.time > end - 2.0 * LOOKED_AT_S) & (orders.time <= end - LOOKED_AT_S)]
        if min(last.size, before.size) >= 2 and abs(float(np.median(last) - np.median(before))) < RESTS:
            came = orders.order[part[0]] - orders.order[max(part[0] - 1, 0)]
            found.append(Rest(float(orders.order[part[-1]]), float(np.median(last)), float(np.sign(came))))
    return found


class Backlash(NamedTuple):
    """Between orders and sensor: the play to either side and the sensor's zero [rad], with their standard errors."""

    play: float
    play_error: float
    zero: float
    zero_error: float


LEAST_RESTS, MOST_ALIKE = 6, 10.0
"""Fewer angles at rest do not tell play from scale and zero, nor do such as are so much alike (condition number)."""
LEAST_REST_NOISE = math.radians(0.1)
"""No angle at rest is known better [rad], however well the others agree."""


def backlash_of(orders: Sequence[Orders]) -> Backlash | None:
    """Return what the angles at rest show of play and zero, None where they are too few or too much alike.

    angle = zero + scale order - play side, by least squares: a rudder with play stops short of its order, on the side
    that it comes from. Zigzags of one rudder angle do not tell it from the scale; those of two do.
    """
    rests = [rest for each in orders for rest in rests_of(each) if rest.side]
    if len(rests) < LEAST_RESTS:
        return None
    terms = np.array([(1.0, rest.order, -rest.side) for rest in rests])
    angles = np.array([rest.angle for rest in rests])
    if np.linalg.cond(terms / np.linalg.norm(terms, axis=0)) > MOST_ALIKE:
        return None
    found, *_ = np.linalg.lstsq(terms, angles, rcond=None)
    left = angles - terms @ found
    variance = max(float(left @ left) / (len(rests) - 3), LEAST_REST_NOISE**2)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(terms.T @ terms)))
    return Backlash(max(float(found[2]), 0.0), float(errors[2]), float(found[0]), float(errors[0]))


def angles_against(rests: Sequence[Rest]) -> list[str]:
    """Return how the angles at rest contradict the orders, a clause each."""
    largest = max((abs(rest.order) for rest in rests), default=0.0)
    small = [rest for rest in rests if LEAST_OFF < abs(rest.order) < SMALL * largest]
    large = [rest for rest in rests if abs(rest.order) > LARGE * largest]
    scale = _scale(small or large)
    if scale is None:
        return []
    against = []
    if _is_off(scale, max(abs(rest.order) for rest in small or large)):
        against.append(
            f"the rudder's sensor shows {scale:.2g} deg for each degree ordered: one of them has the wrong scale "
            "(helm.rudder_at_full_pwm_deg, drive.angle_at_full_deg, or the sensor's), or there is an end stop"
        )
    reached = _scale(large)
    if small and reached is not None and reached < scale and _is_off(1.0 + reached - scale, largest):
        stop = math.degrees(min(abs(rest.angle) for rest in large))
        against.append(
            f"the rudder stops at {stop:.0f} deg where {math.degrees(largest):.0f} were ordered: set "
            "rudder.angle_max_deg lower"
        )
    return against


def _scale(rests: Sequence[Rest]) -> float | None:
    """Return the angle for each radian ordered, the sensor's zero left out where both sides were ordered."""
    orders, angles = (np.array([getattr(rest, name) for rest in rests]) for name in ("order", "angle"))
    if orders.size < 2 or float(np.ptp(orders)) < 2.0 * LEAST_OFF:
        return None
    return float(np.polyfit(orders, angles, 1)[0])


def _is_off(scale: float, order: float) -> bool:
    return abs(scale - 1.0) > SCALE_OFF and abs(scale - 1.0) * order > LEAST_OFF


def rate_against(measured: RudderRate | None, filed: float, orders: Sequence[Orders]) -> list[str]:
    """Return how the measured rate contradicts the filed one [rad/s], where more was ordered than came."""
    if measured is None or not measured.rate < (1.0 - RATE_OFF) * filed - 3.0 * measured.standard_error:
        return []
    if not any(_quickest(each.order_time, each.order) > (1.0 + RATE_OFF) * measured.rate for each in orders):
        return []
    return [
        f"the rudder moves at {math.degrees(measured.rate):.3g} deg/s where the file says {math.degrees(filed):.3g}: "
        "correct rudder.rate_max_deg_s"
    ]


def _quickest(time: FloatArray, order: FloatArray) -> float:
    """Return the fastest change of the order [rad/s] over LOOKED_AT_S."""
    if time.size < 2:
        return 0.0
    later = np.interp(time + LOOKED_AT_S, time, order)
    return float(np.max(np.abs(later - order))) / LOOKED_AT_S


def unchecked(runs: Sequence[Run]) -> str:
    """Return what K and T depend on that nothing in the runs checks: what is alike in all of them, no fit shows."""
    what = ["the recorded speed is right (no fouled log, no current under a speed over ground)"]
    if not any(np.isfinite(segment.rate).any() for run in runs for segment in run.segments):
        what.append("the rudder goes as far as recorded (no gyro would show an end stop)")
    if on_one_course(runs):
        what.append("the compass is right (neither a gyro nor another course checks it)")
    return f"K and T rest on this: {', and '.join(what)}"


def gear_check(runs: Sequence[Run], filed: float, measured: RudderRate | None) -> GearCheck:
    """Return whether the runs' rudder is that of the vessel file, of the `filed` rate [rad/s], inf where none is known.

    measured: the rate that a sensor, or the boat's turning, shows.
    """
    if any(run.rudder == "measured" for run in runs):
        orders = [run.orders for run in runs if run.orders is not None]
        angles = angles_against([rest for each in orders for rest in rests_of(each)])
        against = (*angles, *rate_against(measured, filed, orders))
        return GearCheck(against, unchecked(runs), "" if orders else AS_SHOWN)
    if measured is not None:
        rates = f"{math.degrees(measured.rate):.3g} deg/s" + (
            f" in place of {math.degrees(filed):.3g}" if math.isfinite(filed) else ""
        )
        shown = f"its rudder turns out to move at {rates}, its angles are as typed"
    elif not math.isfinite(filed):
        shown = "the rudder's angles and rate are as ordered"
    elif shows_rate(runs, filed):
        shown = "it turns as a rudder of the typed rate would turn it, its angles are as typed"
    else:
        return GearCheck((UNKNOWN_RATE,), "", AS_TYPED)
    return GearCheck((), f"{shown}; {unchecked(runs)}", AS_TYPED)


Grade = Literal["good", "start", "not enough"]
IN_WORDS: Mapping[Grade, str] = {"good": "good, steer with it", "start": "good for a start", "not enough": "not enough"}

MOST_LEANING = 0.5
"""Share of what is known of K/T or n1/T that other boats may have said of a good model."""
MOST_ANSWERED = 0.5
"""Share of the rudder's motion that may go with what pushes the boat, or what the model misses: the lesser part."""
LEAST_R2, MOSTLY = 0.5, 0.8
"""Share of the yaw rate that must be predicted open loop from rudder and speed for a good model of a stable boat, and
for one to start with whose rudder goes with what it misses."""
LEAST_R2_BY_THRUST = 0.9
"""The same of a boat that steers by thrust, of each run."""
LEAST_LENGTH_BY_THRUST = 10.0
"""Time constants T that all runs together have to last: what the hull's drift adds outlasts one T, and is in K and T of
shorter runs, not in their doubt. Of five runs that were cut to 5 s K came out 40 to 80 % too large."""
KNOT_M_S = 1852.0 / 3600.0


class Verdict(NamedTuple):
    """The grade, and the sentence for the skipper."""

    grade: Grade
    sentence: str

    def serves(self, least: str | None) -> bool:
        """Return whether the grade is at least that one; None asks for nothing."""
        return serves(self.grade, least)


def verdict_on_runs(found: Identified, runs: Sequence[Run], filed: float) -> Verdict:
    """Return what the model is good for, fitted to the `runs`, which are as they were recorded; `filed` is the rudder's
    rate by the vessel file [rad/s], inf where none is known."""
    rate = found.rudder_rate
    fitted = runs if rate is None else [with_rudder_of(run, rate) for run in runs]
    gear = gear_check(runs, filed, rate or rudder_rate_of(fitted))
    return verdict_of(found, [found.predict(run) for run in fitted], found.residual_tests(fitted), gear)


def verdict_by_thrust(fit: DriveFit, predictions: Sequence[DrivePrediction], lasted: float) -> Verdict:
    """Return what the model of a boat that steers by thrust is good for; predictions of all its runs; lasted [s]: those
    that it was fitted to, together."""
    values = {"K": (fit.model.gain, fit.errors["gain"]), "T": (fit.model.time_constant, fit.errors["time_constant"])}
    doubts = {symbol: SURE_OF_IT * error / abs(value) for symbol, (value, error) in values.items()}
    worst = max(doubts, key=lambda symbol: doubts[symbol])
    share = f"{worst} +- {100.0 * doubts[worst]:.0f} %, 95 %"
    least = min((each.r2 for each in predictions if each.r2 is not None), default=-math.inf)
    if not doubts[worst] <= ENOUGH or not least >= LEAST_R2:
        why = share if not doubts[worst] <= ENOUGH else f"of the yaw rate of one run R2 is {least:.2f}"
        return Verdict("not enough", f"not enough ({why}): sail the zigzags once more, each for twice as long.")
    if not lasted >= (least_s := LEAST_LENGTH_BY_THRUST * fit.model.time_constant):
        return Verdict("not enough", f"not enough ({lasted:.0f} s, {least_s:.0f} s at the least): sail longer zigzags.")
    if doubts[worst] > GOOD:
        return Verdict("start", f"good for a start ({share}): sail one more zigzag at each throttle.")
    if least < LEAST_R2_BY_THRUST:
        return Verdict(
            "start",
            f"good for a start ({share}; of the yaw rate of one run R2 is {least:.2f}): look over rudder, throttle and "
            "speed of the runs.",
        )
    if "exponent" not in fit.errors:
        return Verdict("start", f"good for a start ({share}): sail zigzags at half and twice the throttle too.")
    return Verdict("good", f"good, steer with it ({share}).")


def in_words(below: float, above: float) -> str:
    """Return how far an interval reaches to either side, in per cent."""
    down, up = f"{100.0 * below:.0f} %", f"{100.0 * above:.0f} %"
    if not math.isfinite(above):
        up = "any"
    return f"+- {up}" if down == up else f"-{down}, +{up}"


def _unbelieved(found: Identified, tests: Sequence[ResidualTest], again: str) -> tuple[str, str]:
    """Return why the intervals are not to be believed, "" where they are, and what to do; again: the trial to sail."""
    if found.model.time_constant < found.spacing:
        unseen = (
            f"the boat answers within the {found.spacing:.2g} s between two samples, in which nobody saw the rudder"
        )
        return unseen, "record heading and rudder more often"
    if found.is_blind and not all(test.is_white for test in tests):
        pushed = (
            "gusts or what the model leaves out pushed the boat, and this fit takes too little of that into its doubt"
        )
        return pushed, f"sail {again} in less wind"
    return "", ""


def _doubts(found: Identified) -> dict[str, tuple[float, float]]:
    """Return how far below and above K and T their intervals reach, as shares, of those that have one."""
    named = {"K": "gain", "T": "time_constant"}
    errors = {symbol: (name, found.standard_errors[name]) for symbol, name in named.items()}
    return {
        symbol: off_by(name, float(getattr(found.model, name)), error)
        for symbol, (name, error) in errors.items()
        if error is not None
    }


def _undetermined(found: Identified, doubts: Mapping[str, float], explained: float, again: str) -> Verdict | None:
    """Return the verdict where the runs are not of one boat, or do not tell of it; None where they do; explained: share
    of the yaw rate that the model explains."""
    unknown = [symbol for symbol in ("K", "T") if symbol in found.unidentifiable]
    is_on_ridge = found.ratios is not None and found.ratios.on_ridge
    grade: Grade
    is_known = not unknown and not is_on_ridge and max(doubts.values(), default=math.inf) <= ENOUGH
    if found.differing is not None and found.differing.is_doubtful:
        grade = "start" if is_known and not found.differing.are_two else "not enough"
        return Verdict(grade, f"{IN_WORDS[grade]}: {found.differing.sentence()}.")
    if is_known and found.around is None and found.likely is not None and found.likely.unseen.stops:
        return Verdict("start", f"good for a start: {stopped_short(found.likely.unseen)}.")
    if found.answers > MOST_ANSWERED:
        grade = "start" if is_known and explained > MOSTLY else "not enough"
        return Verdict(
            grade,
            f"{IN_WORDS[grade]}: {100.0 * found.answers:.0f} % of the rudder's motion goes with what it does not "
            "explain of the turning: a pilot or a hand answered waves, or the model misses what the rudder does; look "
            "over compass, speed and clock, and "
            f"sail {again}.",
        )
    if found.may_be_lag and not is_known:
        return Verdict("not enough", f"not enough: {LAG_OR_T}; {RECORD_IT}.")
    if is_on_ridge:
        assert found.ratios is not None
        share = SURE_OF_IT * found.ratios.errors[0] / abs(found.ratios.values[0])
        grade = "start" if share <= ENOUGH else "not enough"
        return Verdict(
            grade,
            f"{IN_WORDS[grade]} (K/T +- {100.0 * share:.0f} %, 95 %): the runs do not tell whether the boat is "
            f"course-stable, and a file is written where gains serve both; sail {again}, for twice as long, and "
            "identify all of them together.",
        )
    if unknown:
        return Verdict("not enough", f"not enough: {' and '.join(unknown)} not determined; sail {again}.")
    return None


def verdict_of(
    found: Identified,
    predictions: Sequence[Prediction] = (),
    tests: Sequence[ResidualTest] = (),
    gear: GearCheck = GearCheck(),  # noqa: B008 - immutable
) -> Verdict:
    """Return what the model is good for; predictions of the runs that were fitted, tests of their residuals; gear:
    whether the rudder is that of the vessel file."""
    again = f"20/20 once more at {found.model.reference_speed / KNOT_M_S:.3g} kn"
    sides = _doubts(found)
    doubts = {symbol: max(each) for symbol, each in sides.items()}
    scores = sorted(each.yaw_rate_r2 for each in predictions if each.yaw_rate_r2 is not None)
    explained = scores[len(scores) // 2] if scores else math.nan
    if (undetermined := _undetermined(found, doubts, explained, again)) is not None:
        return undetermined
    if not doubts:
        return Verdict(
            "start", f"good for a start: this method gives no doubt of K and T; compare output-error on {again}."
        )
    worst = max(doubts, key=lambda symbol: doubts[symbol])
    share = f"{worst} {in_words(*sides[worst])}"
    if doubts[worst] > ENOUGH or not math.isfinite(doubts[worst]):
        return Verdict("not enough", f"not enough: {share} (95 %); sail {again}, for twice as long.")
    if doubts[worst] > GOOD:
        return Verdict("start", f"good for a start ({share}, 95 %): sail {again}.")
    if found.may_be_lag:
        return Verdict("start", f"good for a start ({share}, 95 %): {LAG_OR_T}; {RECORD_IT}.")
    leaning = max((found.leans.get(symbol, 0.0) for symbol in ("K", "T")), default=0.0)
    if leaning > MOST_LEANING:
        whose = f"{100.0 * leaning:.0f} % of what is known is other boats'"
        return Verdict("start", f"good for a start ({share}, 95 %; {whose}): sail {again}.")
    if found.model.n1 > 0.0 and explained < LEAST_R2:
        return Verdict(
            "start", f"good for a start: the model explains less than half of the yaw rate; sail {again} in less wind."
        )
    if any(test.follows_rudder for test in tests) and found.model.n1 > 0.0:
        return Verdict(
            "start",
            "good for a start: the residuals follow the rudder, so that the model misses part of what it does; check "
            f"the rudder's scale and sail {again}.",
        )
    why, what = _unbelieved(found, tests, again)
    if why:
        return Verdict("start", f"good for a start ({share}, 95 %, but {why}): {what}.")
    if gear.against:
        return Verdict("start", f"good for a start ({share}, 95 %): {gear.against[0]}.")
    beside = f"; {gear.beside}" if gear.beside else ""
    if found.train.dead_band > 0.0:
        play = f"{math.degrees(found.train.dead_band):.2g} deg of play to either side"
        return Verdict(
            "good", f"good, steer with it ({share}, 95 %); but look for {play} in the steering gear{beside}."
        )
    return Verdict("good", f"good, steer with it ({share}, 95 %){beside}.")
