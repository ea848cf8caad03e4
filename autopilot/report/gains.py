"""What becomes of a planned turn where the rudder is weaker than the model's: the pilot itself, simulated.

For course-unstable boats: one that turns faster than its rudder can stop is lost, and linear margins do not say so.

Gains judged from every side: margins, the worst boat within the model's uncertainty, and the large-signal response.

The gains in force and the margins they leave, from a fifth of the trial's speed to one and a half times it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from random import Random
from typing import Any, NamedTuple

from autopilot.angles import wrap
from autopilot.control.design import DESIGNED, SENSITIVITY_MOST, Margins, Spread, Verdict, worst_margins
from autopilot.control.margins import Loop, OutputFeedbackMargins, Recovery, output_feedback_margins, recoveries
from autopilot.files.printable import aligned
from autopilot.guidance.stop import turn_limits
from autopilot.guidance.turn import turning_time
from autopilot.identification.interval import ENOUGH, off_by
from autopilot.models.norrbin import rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step
from autopilot.report import steered
from autopilot.runtime.build import (
    build_pilot,
    gear_of,
    law_of,
    limits_of,
    loop_gains_of,
    model_at_ratio,
    model_of,
    output_feedback_loop,
    pilot_config,
    planned_share,
    refusal_to_engage,
    shown_gains_of,
    verdict_of,
)
from autopilot.runtime.tuning import SIGMAS, GainRequest, LevelCost, designed, spread_of
from autopilot.signals import HeadingSample, Order, OrderKind
from autopilot.vessel.schema import Control, Vessel

TURN = math.radians(90.0)
STRAIGHT_S = 10.0
HEADING_EVERY_S = 0.1
TURNING_TIMES = 1.5
LOOPS = 4.0
"""The longest time constant [1/crossover] that a turn is given to settle by."""
SETTLED, NEAR = math.radians(3.0), math.radians(1.0)
SWINGS = 5
"""A boat that leaves the course by SETTLED so often swings about it for good."""
STAYS_S = 20.0
"""A turn has settled once the boat stays near for so long, and for as long as it took to come there."""
SEEDS = (1, 2, 3)
"""The instruments' noise decides whether a boat on the brink is lost: the worst of these runs counts there."""
RUDDER_LOSS = 0.7
PAST_MOST = math.radians(5.0)
BRINK = 0.5 * PAST_MOST
"""A turn that leads further past with RUDDER_LOSS times the model's K is not well in hand, or may not be."""


class Turned(NamedTuple):
    """A planned turn of 90 deg, simulated: how far it leads past [rad], when it stays within 1 deg [s]; inf: never."""

    past: float
    settled: float


def survives(vessel: Vessel) -> bool:
    """Return whether a turn stays in hand where the rudder is 30 % weaker than the model's; with gains that are refused
    there is none."""
    if refusal_to_engage(vessel, DESIGNED):
        return False
    first = turned(vessel, SEEDS[0], RUDDER_LOSS, PAST_MOST).past
    if not BRINK < first <= PAST_MOST:
        return first <= BRINK
    return all(turned(vessel, seed, RUDDER_LOSS, PAST_MOST).past <= PAST_MOST for seed in SEEDS[1:])


def bearing_level(vessel: Vessel, least: int) -> tuple[int, Vessel] | None:
    """Return the calmest level from `least` on whose gains survive, and the vessel with them; None where none does."""
    before = None
    for level in range(least, 10):
        better = designed(vessel, GainRequest(level))
        if better != before and survives(better):
            return level, better
        before = better
    return None


def turned(vessel: Vessel, seed: int, share: float = 1.0, lost: float = math.inf) -> Turned:
    """Return a turn of 90 deg by the pilot itself; share: the rudder's strength as one of the model's.

    Noise as in the vessel file. A boat that comes `lost` [rad] past the course does not settle. Raises RefusedError
    where the gains must not be engaged.
    """
    model, gear, limits, random = model_of(vessel), gear_of(vessel), limits_of(vessel), Random(seed)
    pilot, line = build_pilot(vessel), DelayLine(gear.delay + vessel.control.loop_delay_s)
    true = model._replace(gain=share * model.gain)
    turn = turn_limits(model, SteeringGear(limits.angle_max, limits.rate_max), planned_share(vessel))
    dt, noise = 1.0 / vessel.control.rate_hz, vessel.sensors.heading_noise_deg
    rate_noise = vessel.sensors.rate_noise_deg_s if vessel.sensors.gyro else math.nan
    heading = rate = rudder = 0.0
    sampled, outside, swings, errors = -math.inf, 0, 0, list[float]()
    # a boat that is all but neutral settles by its loop, not by its own time constant
    loop_s = LOOPS / max(verdict_of(vessel).margins.crossover, 1.0e-3)
    settling = model._replace(time_constant=min(model.time_constant, loop_s))
    for tick in range(round((STRAIGHT_S + TURNING_TIMES * turning_time(settling, turn, TURN)) / dt)):
        now, samples = tick * dt, tuple[HeadingSample, ...]()
        if now >= sampled + HEADING_EVERY_S - 1.0e-6:
            sampled = now
            read = heading + random.gauss(0.0, math.radians(noise))
            turning = rate + random.gauss(0.0, math.radians(rate_noise))
            samples = (HeadingSample(now, wrap(read), turning if vessel.sensors.gyro else None),)
        order = Order(OrderKind.HEADING, 0.0 if now < STRAIGHT_S else TURN, serial=1)
        line.give(now, pilot.step(now, samples, order).command.angle)
        for part in (0.25, 0.75):
            moved = gear_step(gear, rudder, line.effective(now + part * dt), 0.5 * dt)
            before, rate = rate, rate_step(true, rate, 0.5 * (rudder + moved), 0.5 * dt)
            heading, rudder = heading + 0.25 * dt * (before + rate), moved
        errors.append(heading - TURN)
        swings += tick > 0 and abs(errors[-2]) <= SETTLED < abs(errors[-1])
        if errors[-1] > lost or swings >= SWINGS:
            return Turned(math.inf, math.inf)
        if abs(errors[-1]) > NEAR:
            outside = tick
        elif now > STRAIGHT_S and (tick - outside) * dt > max(STAYS_S, outside * dt - STRAIGHT_S):
            break
    late = errors[-len(errors) // 10 :]
    if not max(map(abs, late)) < SETTLED:
        return Turned(math.inf, math.inf)
    return Turned(max(errors), (outside + 1) * dt - STRAIGHT_S)


LARGE_SIGNAL_DEG = (5.0, 20.0, 45.0, 90.0)


class Judged(NamedTuple):
    """A vessel's law: its verdict, the worst margins of boats that are `off` so far, `spread` in words, the
    large-signal response, and the margins with the heading filter in the loop, in calm water and in the strongest
    gusts that it learns."""

    vessel: Vessel
    law: str
    verdict: Verdict
    worst: Margins
    off: Spread
    spread: str
    recoveries: list[Recovery]
    output_feedback: OutputFeedbackMargins
    disturbed: OutputFeedbackMargins


def judged(vessel: Vessel, law: str) -> Judged:
    """Return the gains of the vessel's `law` judged."""
    verdict = verdict_of(vessel, law)
    spread, words = spread_of(vessel)
    gains = loop_gains_of(vessel, law)
    worst = worst_margins(
        model_of(vessel), gear_of(vessel), limits_of(vessel).rate_max, vessel.control.loop_delay_s, gains, spread
    )
    errors = [math.radians(error) for error in LARGE_SIGNAL_DEG]
    found = recoveries(loop_of(vessel), law_of(vessel, law), verdict.margins.crossover, errors)
    calm, gusty = (
        output_feedback_margins(output_feedback_loop(vessel, law, disturbed=disturbed)) for disturbed in (False, True)
    )
    return Judged(vessel, law, verdict, worst, spread, words, found, calm, gusty)


NEXT_TO_NOTHING_DEG = 0.3
TURN_PAST_MOST = math.radians(2.0)
"""A turn leads past by less."""


def verdict_of_gains(each: Judged, cost: LevelCost | None) -> steered.Verdict:
    """Return what a set of gains is good for; cost: of the level it is of, None where it is of none."""
    if each.verdict.refusal or not each.output_feedback.stable:
        why = each.verdict.refusal or "unstable with the heading filter"
        return steered.Verdict("refused", f"not to be engaged: {why}")
    turn = turned(replace(each.vessel, control=replace(each.vessel.control, law=each.law)), SEEDS[0])
    said = (
        f"turns 90 deg in {turn.settled:.0f} s{_past_in_words(turn.past)}"
        if math.isfinite(turn.settled)
        else "a turn of 90 deg does not settle"
    )
    if cost is not None:
        said += f"; holds within {math.degrees(cost.sea.heading):.1f} deg rms in the sea it is designed for"
    spread = each.spread.split(",")[0]
    doubt = max(max(off_by("gain", 1.0, share / SIGMAS)) for share in each.off)
    leads_past = not turn.past <= TURN_PAST_MOST
    doubts = [
        words
        for is_so, words in (
            (leads_past, "turns lead past"),
            (not each.worst.stable, "a boat off its model is not held"),
            (each.worst.sensitivity > SENSITIVITY_MOST, "little margin for a boat off its model"),
            (doubt > ENOUGH, f"a model known too little ({spread})"),
            (not each.disturbed.stable, "unstable in the strongest gusts"),
        )
        if is_so
    ]
    if doubts:
        advice = "try a calmer --level, or identify the boat anew"
        if leads_past:
            share = each.vessel.guidance.rudder_share
            advice = f"plan turns with less of the rudder (guidance.rudder_share below {share:g}), or {advice}"
        return steered.Verdict("doubtful", f"doubtful: {', '.join(doubts)}; {said}; {advice}")
    return steered.Verdict("good", f"good: {said}; bears a boat with {spread}")


def _past_in_words(past: float) -> str:
    degrees = math.degrees(past)
    return " without passing the course" if degrees < NEXT_TO_NOTHING_DEG else f", {degrees:.1f} deg past the course"


def loop_of(vessel: Vessel) -> Loop:
    """Return the vessel's boat and rudder as the large-signal simulation takes them."""
    control = vessel.control
    return Loop(model_of(vessel), gear_of(vessel), limits_of(vessel), control.loop_delay_s, control.rate_hz)


def as_json(each: Judged) -> dict[str, Any]:
    """Return everything with the unit in the key."""
    found = each.verdict.margins
    return {
        "gains": shown_gains_of(each.vessel, each.law),
        "stable": found.stable,
        "gain_margin": found.gain,
        "phase_margin_deg": math.degrees(found.phase),
        "delay_margin_s": found.delay,
        "worst_sensitivity": found.sensitivity,
        "delay_margin_left_by_measured_path_s": left_by_path(each),
        "with_heading_filter": _output_feedback(each.output_feedback),
        "with_heading_filter_in_gusts": _output_feedback(each.disturbed),
        "crossover_rad_s": found.crossover,
        "rudder_rate_saturates_at_heading_error_deg": math.degrees(found.saturation),
        "worst_boat": {
            "spread": each.spread,
            "stable": each.worst.stable,
            "worst_sensitivity": each.worst.sensitivity,
            "phase_margin_deg": math.degrees(each.worst.phase),
        },
        "large_errors": [
            {
                "error_deg": math.degrees(row.error),
                "corrected": row.corrected,
                "overshoot_deg": math.degrees(row.overshoot),
                "settling_s": row.settling,
                "swings_at_the_end_deg": math.degrees(row.swing),
            }
            for row in each.recoveries
        ],
        "refusal": each.verdict.refusal or None,
    }


def left_by_path(each: Judged) -> float:
    """Return what the measured path leaves of the delay margin [s] with the heading filter; nan: none is measured."""
    control = each.vessel.control
    if control.path_delay_s is None or not each.output_feedback.stable:
        return math.nan
    return each.output_feedback.delay - max(control.path_delay_s - control.loop_delay_s, 0.0)


def _output_feedback(found: OutputFeedbackMargins) -> dict[str, Any]:
    return {
        "stable": found.stable,
        "delay_margin_s": found.delay,
        "worst_sensitivity": found.sensitivity,
        "K_may_be_smaller_by_factor": found.gain_down,
        "K_may_be_larger_by_factor": found.gain_up,
    }


def as_text(rows: dict[str, Judged]) -> str:
    """Return the table of margins with what else there is to say below each line of it."""
    table = margin_table(rows)
    head, *lines = aligned(table, right=range(1, len(table[0])))
    said = [head]
    for line, each in zip(lines, rows.values(), strict=True):
        gains = ", ".join(f"{key} {value:g}" for key, value in shown_gains_of(each.vessel, each.law).items())
        said += [line, *(f"    {sentence}" for sentence in (gains, *sentences(each)))]
    return "\n".join(said)


def front_table(vessel: Vessel, front: Sequence[LevelCost], chosen: int | None = None) -> list[tuple[str, ...]]:
    """Return what every level costs, a line for each below the heads; chosen: the level to be named so."""
    heads = (
        "level",
        "bandwidth",
        "heading rms",
        "rudder travel",
        "drive runs",
        "travel in a calm",
        "worst boat's heading",
    )
    rate_max = limits_of(vessel).rate_max
    lines = [
        (
            f"{row.level}, chosen" if row.level == chosen else f"{row.level}",
            f"{row.bandwidth:.3g} rad/s",
            f"{math.degrees(row.sea.heading):.2f} deg",
            f"{math.degrees(row.sea.travel):.2f} deg/s",
            f"{100.0 * row.sea.travel / rate_max:.1f} %" if math.isfinite(rate_max) else "unknown",
            f"{math.degrees(row.calm.travel):.3f} deg/s",
            f"{math.degrees(row.worst.heading):.2f} deg" if math.isfinite(row.worst.heading) else "not held",
        )
        for row in front
    ]
    return [heads, *lines]


FRONT_SENTENCE = (
    "Heading rms and rudder travel in waves of 1 deg and gusts of 0.5 deg rms, as rudder angles, predicted by the "
    "linear loop of boat, gear, filter and law; the share of the time that the drive runs; the worst boat within "
    "the uncertainty of K, T and delay. --level chooses: 1 spares the rudder, 9 holds the course."
)


def front_as_text(vessel: Vessel, front: Sequence[LevelCost], chosen_level: int | None) -> str:
    """Return the front as a table, the chosen level marked."""
    table = front_table(vessel, front)
    lines = aligned(table, right=range(1, len(table[0])))
    marked = [f"{'*' if row.level == chosen_level else ' '} {line}" for row, line in zip(front, lines[1:], strict=True)]
    head = lines[0].replace("\n", "\n  ")
    return "\n".join([f"  {head}", *marked, FRONT_SENTENCE])


def front_as_json(front: Sequence[LevelCost]) -> list[dict[str, float | int]]:
    """Return the front with the unit in every key."""
    return [
        {
            "level": row.level,
            "bandwidth_rad_s": row.bandwidth,
            "heading_rms_deg": math.degrees(row.sea.heading),
            "rudder_travel_deg_s": math.degrees(row.sea.travel),
            "rudder_travel_in_calm_deg_s": math.degrees(row.calm.travel),
            "worst_boat_heading_rms_deg": math.degrees(row.worst.heading),
        }
        for row in front
    ]


def margin_table(rows: Mapping[str, Judged]) -> list[tuple[str, ...]]:
    """Return the margins about straight running, a line for each set of gains below the heads."""
    heads = (
        "gain margin",
        "phase margin",
        "delay margin",
        "worst sensitivity",
        "crossover [rad/s]",
        "rate saturates from",
    )
    table: list[tuple[str, ...]] = [("gains", *heads)]
    for name, each in rows.items():
        found = each.verdict.margins
        if not found.stable:
            table.append((name, "unstable", *[""] * (len(heads) - 1)))
            continue
        table.append(
            (
                name,
                f"{found.gain:.2f}",
                f"{math.degrees(found.phase):.0f} deg",
                f"{found.delay:.2f} s",
                f"{found.sensitivity:.2f}",
                f"{found.crossover:.3g}",
                f"{math.degrees(found.saturation):.2f} deg",
            )
        )
    return table


def sentences(each: Judged) -> list[str]:
    """Return what the worst boat and the large-signal response are, and why the gains are refused where they are."""
    said = []
    if each.verdict.margins.stable:
        said.append(f"with the heading filter: {_margins_in_words(each.output_feedback)}")
        if math.isfinite(left := left_by_path(each)):
            said.append(_path_in_words(each.vessel.control, left))
        if each.disturbed != each.output_feedback:
            said.append(f"in the strongest gusts: {_margins_in_words(each.disturbed)}")
        outcome = f"worst sensitivity {each.worst.sensitivity:.2f}" if each.worst.stable else "UNSTABLE"
        said.append(f"worst boat ({each.spread}): {outcome}")
    good = [row for row in each.recoveries if row.corrected]
    bad = [row for row in each.recoveries if not row.corrected]
    if good:
        past = ", ".join(
            f"{math.degrees(row.error):.0f} deg: {math.degrees(row.overshoot):.1f} deg past in {row.settling:.1f} s"
            for row in good
        )
        said.append(f"large-signal response, without a planned turn: {past}")
    if bad:
        said.append(
            f"from {math.degrees(bad[0].error):.0f} deg the rudder's limits leave it swinging by "
            f"{max(math.degrees(row.swing) for row in bad):.1f} deg"
        )
    return [*said, each.verdict.refusal] if each.verdict.refusal else said


def _path_in_words(control: Control, left: float) -> str:
    measured = f"orders were measured to come {control.path_delay_s:.2f} s late, filed are {control.loop_delay_s:.2f} s"
    if left > 0.0:
        return f"{measured}: {left:.2f} s of the delay margin are left"
    return f"{measured}: {-left:.2f} s beyond the delay margin; the boat is held by steering ahead of what is measured"


def _margins_in_words(found: OutputFeedbackMargins) -> str:
    if not found.stable:
        return "UNSTABLE"
    least = f"{found.gain_down:.2f}" if found.gain_down > 0.0 else "next to nothing"
    most = f"{found.gain_up:.1f} times the model's" if math.isfinite(found.gain_up) else "any size"
    return f"delay margin {found.delay:.2f} s, worst sensitivity {found.sensitivity:.2f}, K from {least} to {most}"


RATIOS = (0.2, 0.5, 0.75, 1.0, 1.25, 1.5)
UNSCHEDULED = (
    "Until a link brings a speed, the model and the gains of the trial's speed are in force, whatever the boat does."
)
HEAD = ("speed", "K [1/s]", "T [s]", "gain margin", "phase margin", "delay margin")


class AtSpeed(NamedTuple):
    """One speed: share of the trial's and [m/s], K [1/s], T [s], the gains by their keys in the file, and the verdict.

    waits: slower than the steerage, where the rudder waits amidships and no gains are in force.
    """

    ratio: float
    speed: float
    gain: float
    time_constant: float
    gains: dict[str, float]
    verdict: Verdict
    waits: bool


def by_speed(each: Judged) -> list[AtSpeed]:
    """Return the law of `each` at every share of the trial's speed in RATIOS."""
    steerage = pilot_config(each.vessel, each.law).steerage
    found = []
    for ratio in RATIOS:
        model = model_at_ratio(each.vessel, ratio)
        gains = shown_gains_of(each.vessel, each.law, ratio)
        verdict, waits = verdict_of(each.vessel, each.law, ratio), model.reference_speed < steerage
        found.append(AtSpeed(ratio, model.reference_speed, model.gain, model.time_constant, gains, verdict, waits))
    return found


def chosen(rows: Mapping[str, Judged]) -> dict[str, Judged]:
    """Return the rows of the law that the file steers with."""
    return {name: each for name, each in rows.items() if each.law == each.vessel.control.law}


def speeds_as_json(each: Judged) -> dict[str, Any]:
    """Return the entry "speeds" with the unit in every key; null for what is infinite."""
    return {"speeds": [_as_json(row) for row in by_speed(each)]}


def _as_json(row: AtSpeed) -> dict[str, Any]:
    found = row.verdict.margins
    return {
        "speed_percent": round(100.0 * row.ratio),
        "speed_m_s": row.speed,
        "K_1_s": row.gain,
        "T_s": row.time_constant,
        "gains": row.gains,
        "stable": found.stable,
        "gain_margin": found.gain,
        "phase_margin_deg": math.degrees(found.phase),
        "delay_margin_s": found.delay,
        "below_steerage": row.waits,
        "refusal": row.verdict.refusal or None,
    }


def speeds_as_text(rows: Mapping[str, Judged]) -> str:
    """Return a table of speeds for each set of gains of the law that the file steers with."""
    lines = []
    for name, each in chosen(rows).items():
        table = speed_table(each)
        gains = slice(3, 3 + len(table[0]) - len(HEAD) - 1)  # between K and T and the margins: a table of their own
        margins = [row[: gains.start] + row[gains.stop :] for row in table]
        lines += [f"{name}, by speed", *aligned(margins, right=range(len(HEAD)))]
        lines += ["", *aligned([row[:1] + row[gains] for row in table], right=range(len(table[0])))]
    return "\n".join([*lines, UNSCHEDULED])


def speed_table(each: Judged) -> list[tuple[str, ...]]:
    """Return the table of one set of gains, its head first."""
    keys = tuple(shown_gains_of(each.vessel, each.law))
    return [(*HEAD[:3], *keys, *HEAD[3:], ""), *(_cells(row, keys) for row in by_speed(each))]


def _cells(row: AtSpeed, keys: tuple[str, ...]) -> tuple[str, ...]:
    found = row.verdict.margins
    said = "rudder waits: below steerage" if row.waits else "not to be engaged" if row.verdict.refusal else ""
    margins = (f"{found.gain:.2f}", f"{math.degrees(found.phase):.0f} deg", f"{found.delay:.2f} s")
    return (
        f"{100.0 * row.ratio:.0f} % = {row.speed:.2f} m/s",
        f"{row.gain:.3g}",
        f"{row.time_constant:.3g}",
        *(f"{row.gains[key]:.3g}" for key in keys),
        *(margins if found.stable else ("unstable", "", "")),
        said,
    )
