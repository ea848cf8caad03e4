"""Whether a model is good enough to steer by, in one sentence: said before any number.

Designed gains bear a boat that is some 30 % off its model, so that 95 % intervals of K and T inside that are good, and
wider ones are good for a start. What is not determined is no model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

from autopilot.identification.drive_effect import DriveFit
from autopilot.identification.drive_effect import Prediction as DrivePrediction
from autopilot.identification.gear_check import GearCheck, gear_check
from autopilot.identification.identified import SURE_OF_IT, Identified
from autopilot.identification.ordered_rudder import with_rudder_of
from autopilot.identification.residual_tests import Prediction, ResidualTest
from autopilot.identification.rudder_path import rudder_rate_of
from autopilot.identification.runs import Run

Grade = Literal["good", "start", "not enough"]

GOOD, ENOUGH = 0.3, 0.6
"""Half a 95 % interval of K or T, as a share of it: that gains bear, and that a first design may be tried with."""
MOST_LEANING = 0.5
"""Share of what is known of K/T or n1/T that other boats may have said of a good model."""
LEAST_R2 = 0.5
"""Share of the yaw rate that must be predicted open loop from rudder and speed for a good model of a stable boat."""
LEAST_R2_BY_THRUST = 0.9
"""The same of a boat that steers by thrust, of each run."""
KNOT_M_S = 1852.0 / 3600.0


class Verdict(NamedTuple):
    """The grade, and the sentence for the skipper."""

    grade: Grade
    sentence: str

    def serves(self, least: str | None) -> bool:
        """Return whether the grade is at least that one; None asks for nothing."""
        grades = ("not enough", "start", "good")
        return least is None or grades.index(self.grade) >= grades.index(least)


def verdict_on_runs(found: Identified, runs: Sequence[Run], filed: float) -> Verdict:
    """Return what the model is good for, fitted to the `runs`, which are as they were recorded; `filed` is the rudder's
    rate by the vessel file [rad/s], inf where none is known."""
    rate = found.rudder_rate
    fitted = runs if rate is None else [with_rudder_of(run, rate) for run in runs]
    gear = gear_check(runs, filed, rate or rudder_rate_of(fitted))
    return verdict_of(found, [found.predict(run) for run in fitted], found.residual_tests(fitted), gear)


def verdict_by_thrust(fit: DriveFit, predictions: Sequence[DrivePrediction]) -> Verdict:
    """Return what the model of a boat that steers by thrust is good for; predictions of all its runs."""
    values = {"K": (fit.model.gain, fit.errors["gain"]), "T": (fit.model.time_constant, fit.errors["time_constant"])}
    doubts = {symbol: SURE_OF_IT * error / abs(value) for symbol, (value, error) in values.items()}
    worst = max(doubts, key=lambda symbol: doubts[symbol])
    share, least = f"{worst} +- {100.0 * doubts[worst]:.0f} %, 95 %", min(each.r2 for each in predictions)
    if not doubts[worst] <= ENOUGH or not least >= LEAST_R2:
        why = share if not doubts[worst] <= ENOUGH else f"of the yaw rate of one run R2 is {least:.2f}"
        return Verdict("not enough", f"not enough ({why}): sail the zigzags once more, each for twice as long.")
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


def verdict_of(
    found: Identified,
    predictions: Sequence[Prediction] = (),
    tests: Sequence[ResidualTest] = (),
    gear: GearCheck = GearCheck(),  # noqa: B008 - immutable
) -> Verdict:
    """Return what the model is good for; predictions of the runs that were fitted, tests of their residuals; gear:
    whether the rudder is that of the vessel file."""
    again = f"20/20 once more at {found.model.reference_speed / KNOT_M_S:.3g} kn"
    unknown = [symbol for symbol in ("K", "T") if symbol in found.unidentifiable]
    if found.ratios is not None and found.ratios.on_ridge:
        return Verdict(
            "not enough",
            "not enough: the runs do not tell whether the boat is course-stable; sail a zigzag with small rudder "
            "angles (5/5) and two turns held for some minutes, and identify all of them together.",
        )
    if unknown:
        return Verdict("not enough", f"not enough: {' and '.join(unknown)} not determined; sail {again}.")
    doubts = {
        symbol: SURE_OF_IT * error / abs(value)
        for symbol, value, error in (
            ("K", found.model.gain, found.standard_errors["gain"]),
            ("T", found.model.time_constant, found.standard_errors["time_constant"]),
        )
        if error is not None
    }
    if not doubts:
        return Verdict(
            "start", f"good for a start: this method gives no doubt of K and T; compare output-error on {again}."
        )
    worst = max(doubts, key=lambda symbol: doubts[symbol])
    share = f"{worst} +- {100.0 * doubts[worst]:.0f} %"
    if doubts[worst] > ENOUGH or not math.isfinite(doubts[worst]):
        return Verdict("not enough", f"not enough: {share} (95 %); sail {again}, for twice as long.")
    if doubts[worst] > GOOD:
        return Verdict("start", f"good for a start ({share}, 95 %): sail {again}.")
    leaning = max((found.leans.get(symbol, 0.0) for symbol in ("K", "T")), default=0.0)
    if leaning > MOST_LEANING:
        whose = f"{100.0 * leaning:.0f} % of what is known is other boats'"
        return Verdict("start", f"good for a start ({share}, 95 %; {whose}): sail {again}.")
    scores = [each.yaw_rate_r2 for each in predictions if each.yaw_rate_r2 is not None]
    if found.model.n1 > 0.0 and scores and sorted(scores)[len(scores) // 2] < LEAST_R2:
        return Verdict(
            "start", f"good for a start: the model explains less than half of the yaw rate; sail {again} in less wind."
        )
    if any(test.follows_rudder for test in tests) and found.model.n1 > 0.0:
        return Verdict(
            "start",
            "good for a start: the residuals follow the rudder, so that the model misses part of what it does; check "
            f"the rudder's scale and sail {again}.",
        )
    if gear.against:
        return Verdict("start", f"good for a start ({share}, 95 %): {gear.against[0]}.")
    beside = f"; {gear.beside}" if gear.beside else ""
    if found.train.dead_band > 0.0:
        play = f"{math.degrees(found.train.dead_band):.2g} deg of play to either side"
        return Verdict(
            "good", f"good, steer with it ({share}, 95 %); but take {play} out of the steering gear{beside}."
        )
    return Verdict("good", f"good, steer with it ({share}, 95 %){beside}.")
