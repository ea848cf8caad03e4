"""Pages of logs: a sea trial, and two runs side by side.

The trial: what was sailed, each manoeuvre measured beside its criterion, track and steady turns. The measures of
manoeuvres are rows for people: name, value, criterion; used by the terminal and by the page. Two runs: how well each
was steered, as a table and as a page.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.files.printable import fixed
from autopilot.identification import trial_measures as criteria
from autopilot.identification.trial_measures import Circle, Measures, PullOut, Spiral, TrialRecord, Zigzag
from autopilot.report.page import (
    SPEED_SPAN,
    FloatArray,
    Line,
    Opening,
    Panel,
    Section,
    plane_figure,
    render,
    time_figure,
)
from autopilot.report.steered import SHORTEST_S, Steered, Verdict
from autopilot.signals import Mode, OrderKind, Tick

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")

Row = tuple[str, str, str]
"""Name, value with its unit, and the criterion beside it, empty where there is none."""


class Block(NamedTuple):
    """One manoeuvre: its title, when it begins [s], and its rows."""

    title: str
    begins: float
    rows: tuple[Row, ...]


def blocks_of(measures: Measures, length: float | None) -> list[Block]:
    """Return every manoeuvre with its rows; criteria where there are some and the `length` [m] is known."""
    found = [(one.begins, _zigzag(one, length)) for one in measures.zigzags]
    found += [(one.begins, _circle(one, length)) for one in measures.circles]
    found += [(one.begins, _pull_out(one)) for one in measures.pull_outs]
    if measures.spiral is not None:
        speeds = [one.speed for one in measures.zigzags] + [one.speed for one in measures.circles]
        speed = speeds[0] if speeds else math.nan
        found.append((measures.spiral.begins, _spiral(measures.spiral, length, speed)))
    return [Block(next(rows)[0], begins, tuple(rows)) for begins, rows in found]


def _zigzag(found: Zigzag, length: float | None) -> Iterator[Row]:
    kind = criteria.zigzag_kind(found.rudder, found.execute)
    yield f"Zigzag {_kind(found)} from {_s(found.begins)} at {_speed_of(found.speed)}", "", ""
    yield "rudder, and heading at which it went over", f"{_deg(found.rudder)}, {_deg(found.execute)}", ""
    yield "initial turning time", _s(found.initial_time), ""
    time, distance = found.initial_turn
    limit = f"{criteria.INITIAL_LENGTHS:g} L" if kind == 10 else ""
    yield "way until heading changed by 10 deg", f"{_m(distance, length)} in {_s(time)}", limit
    for number, angle in enumerate(found.overshoots):
        name = ORDINALS[number] if number < len(ORDINALS) else f"{number + 1}th"
        yield f"{name} overshoot", _deg(angle), _overshoot_limit(kind, number, found.speed, length)
        yield "  heading checked after", _s(found.checks[number]), ""
    yield "reach", _s(found.reach), ""
    yield "period", _s(found.period), ""


def _kind(found: Zigzag) -> str:
    """Return what a zigzag is called: rudder and execute angle in whole degrees; near each other, the rudder's twice,
    since between two samples the heading goes further than to the angle that was meant."""
    is_one = abs(found.execute - found.rudder) < criteria.NEAR
    angles = found.rudder, found.rudder if is_one else found.execute
    return "/".join(f"{round(math.degrees(angle), 0):.3g}" for angle in angles)


def _overshoot_limit(kind: int, number: int, speed: float, length: float | None) -> str:
    if kind == 20 and number == 0:
        return _deg(criteria.FIRST_OVERSHOOT_20)
    if kind != 10 or number > 1 or length is None or not speed > 0.0:
        return ""
    limit = (criteria.first_overshoot_10, criteria.second_overshoot_10)[number](length, speed)
    return f"{_deg(limit)} (L/V {fixed(length / speed, 1)} s)"


def _circle(found: Circle, length: float | None) -> Iterator[Row]:
    yield (
        f"Turning circle at {_deg(found.rudder, sign=True)} from {_s(found.begins)} at {_speed_of(found.speed)}",
        "",
        "",
    )
    yield "advance", _m(found.advance, length), f"{criteria.ADVANCE_LENGTHS:g} L"
    yield "transfer", _m(found.transfer, length), ""
    yield "tactical diameter", _m(found.tactical_diameter, length), f"{criteria.TACTICAL_LENGTHS:g} L"
    yield "steady radius (speed/yaw rate)", _m(found.radius, length), ""
    yield "steady yaw rate", _rate(found.rate), ""
    yield "time to 90, 180, 360 deg", ", ".join(_s(one) for one in (found.time_90, found.time_180, found.time_360)), ""
    yield "speed lost in the turn", _percent(found.speed_lost), ""


def _pull_out(found: PullOut) -> Iterator[Row]:
    yield f"Pull-out from {_deg(found.rudder, sign=True)} at {_s(found.begins)}", "", ""
    yield "steady yaw rate before", _rate(found.turn_rate), ""
    yield f"residual yaw rate after {fixed(found.time, 0)} s", _rate(found.residual_rate), ""


def _spiral(found: Spiral, length: float | None, speed: float) -> Iterator[Row]:
    yield f"Spiral of {len(found.down)} and {len(found.up)} angles from {_s(found.begins)}", "", ""
    limit = "" if length is None or not speed > 0.0 else _deg(criteria.loop_width(length, speed)) + " (MSC/Circ.1053)"
    yield "loop width", _deg(found.width), limit
    yield "loop height at rudder amidships", _rate(found.height), ""
    back = {round(math.degrees(angle), 1): rate for angle, rate in found.up}
    for angle, rate in found.down:
        other = back.get(round(math.degrees(angle), 1))
        yield f"  rudder {_deg(angle, sign=True)}", _rate(rate) + ("" if other is None else f" / {_rate(other)}"), ""


def _deg(angle: float, sign: bool = False) -> str:
    return "-" if math.isnan(angle) else f"{fixed(math.degrees(angle), 1, '+' if sign else '')} deg"


def _rate(rate: float) -> str:
    return "-" if math.isnan(rate) else f"{fixed(math.degrees(rate), 2, '+')} deg/s"


def _s(seconds: float) -> str:
    return "-" if math.isnan(seconds) else f"{fixed(seconds, 1)} s"


def _speed_of(speed: float) -> str:
    return f"{fixed(speed, 2)} m/s"


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{fixed(100.0 * share, 0)} %"


def _m(metres: float, length: float | None) -> str:
    if math.isnan(metres):
        return "-"
    return f"{fixed(metres, 1)} m" if length is None else f"{fixed(metres, 1)} m = {fixed(metres / length, 1)} L"


SAID_MOST = 2
NO_MANOEUVRE = (
    "no manoeuvre found; a zigzag needs three executes, a turning circle 180 deg at a held rudder, a pull-out a turn "
    "and then the rudder amidships, a spiral five angles down and up again."
)
POINTS_MOST = 4000
"""More samples than this draw no finer line and make the page heavy."""


def trials_page(source: str, record: TrialRecord, measures: Measures, length: float | None, command: str) -> str:
    """Return the page of one record; `length` [m] of the boat, None where it is not known."""
    lead = f"Manoeuvres found in {source}, measured by IMO MSC.137(76) and ITTC 7.5-04-02-01: "
    lead += f"{criteria.SHIPS}."
    hero = Section("", figure=_motion(record), caption="what was sailed; rudder and yaw rate: starboard positive")
    sections = []
    for block in blocks_of(measures, length):
        table = [("measure", "value", "criterion"), *((name.strip(), *rest) for name, *rest in block.rows)]
        if not any(criterion for _, _, criterion in block.rows):
            table = [row[:2] for row in table]
        sections.append(Section(block.title, table))
    if not sections:
        sections.append(Section("Measures", text=("No manoeuvre was found in this record.",)))
    if np.isfinite(record.north).all():
        sections.append(Section("Track", figure=_track(record), caption=f"by {measures.position}"))
    steady = _steady(measures)
    if steady is not None:
        sections.append(Section("Steady turns", figure=steady, caption="one branch to port, one back to starboard"))
    return render(Opening("Sea trial", lead, hero, verdict_of_trials(measures)), sections, command)


def verdict_of_trials(measures: Measures) -> Verdict:
    """Return what the manoeuvres came to, in one sentence."""
    said = []
    for zigzag in measures.zigzags:
        past = " and ".join(_deg(angle) for angle in zigzag.overshoots[:2])
        said.append(f"the {_kind(zigzag)} zigzag overshoots by {past}")
    for circle in measures.circles:
        side = "port" if circle.rudder < 0.0 else "starboard"
        said.append(f"circle to {side} {_m(circle.tactical_diameter, None)} across, 90 deg in {_s(circle.time_90)}")
    said += [f"pull-out leaves {_rate(one.residual_rate)}" for one in measures.pull_outs]
    if measures.spiral is not None:
        said.append(f"spiral with a loop of {_deg(measures.spiral.width)}")
    if not said:
        return Verdict("not enough", f"not enough: {NO_MANOEUVRE}")
    more = f"; and {len(said) - SAID_MOST} more" if len(said) > SAID_MOST else ""
    return Verdict("good", f"good: {'; '.join(said[:SAID_MOST])}{more}")


def _thinned(values: FloatArray) -> FloatArray:
    return values[:: max(1, values.size // POINTS_MOST)]


def _motion(record: TrialRecord) -> str:
    time = _thinned(record.time)
    heading = Line("heading", time, np.degrees(_thinned(record.heading)))
    rudder = Line("rudder", time, np.degrees(_thinned(record.rudder)))
    rate = Line("yaw rate", time, np.degrees(_thinned(record.rate)))
    panels = [Panel("heading [deg]", [heading]), Panel("rudder [deg]", [rudder]), Panel("yaw rate [deg/s]", [rate])]
    if np.isfinite(record.speed).any():
        speed = _thinned(record.speed)
        panels.append(Panel("speed [m/s]", [Line("speed", time, speed)], SPEED_SPAN * float(np.nanmean(speed))))
    return time_figure(panels)


def _track(record: TrialRecord) -> str:
    line = Line("track", _thinned(record.east), _thinned(record.north))
    begin = Line("begin", record.east[:1], record.north[:1], dots=True)
    return plane_figure(Panel("north [m]", [line, begin]), "east [m]", equal=True)


def _steady(measures: Measures) -> str | None:
    """Return the steady yaw rates over the rudder angles, from a spiral and from the circles; None without any."""
    lines = [] if measures.spiral is None else _branches(measures.spiral)
    if measures.circles:
        angles, rates = (np.degrees([getattr(one, name) for one in measures.circles]) for name in ("rudder", "rate"))
        lines.append(Line("turning circles", angles, rates, dots=True))
    return plane_figure(Panel("yaw rate [deg/s]", lines), "rudder [deg]") if lines else None


def _branches(spiral: Spiral) -> list[Line]:
    named = (("to port", spiral.down), ("back to starboard", spiral.up))
    return [Line(name, *np.degrees(np.array(branch)).T) for name, branch in named]


NEARLY = 0.1
"""Figures that differ by less than this share are called alike."""


class RunOf(NamedTuple):
    """A run: the log's name, its ticks in parts, which are decoded where they are looked at, and how it was steered."""

    name: str
    parts: tuple[Sequence[Tick], ...]
    steered: Steered


def run_of(name: str, *parts: Sequence[Tick]) -> RunOf:
    """Return a run with its measures; parts: its ticks, of one log after the other."""
    steered = Steered()
    for tick in chain.from_iterable(parts):
        steered(tick)
    return RunOf(name, parts, steered)


def measures_of_run(run: RunOf) -> dict[str, float | int]:
    """Return the measures by name, the unit in each key; nan for what is not known."""
    found = run.steered
    largest = max(found.turns, key=lambda turn: abs(turn.angle), default=None)
    return {
        "engaged_s": found.seconds,
        "on_course_s": found.on_course,
        "heading_rms_deg": found.rms_deg,
        "heading_off_95_percent_deg": found.off_deg,
        "rudder_travel_deg_s": found.travel_deg_s,
        "rudder_travel_on_course_deg_s": found.held_travel_deg_s,
        "turns": len(found.turns),
        "worst_past_deg": found.past_deg,
        "largest_turn_deg": math.nan if largest is None else abs(math.degrees(largest.angle)),
        "largest_turn_settled_s": math.nan if largest is None else largest.settled,
        "steering_lost": found.lost,
    }


ROWS = (
    ("engaged_s", "engaged", "s", 0),
    ("on_course_s", "on a course, out of turns", "s", 0),
    ("heading_rms_deg", "off the planned course, rms", "deg", 2),
    ("heading_off_95_percent_deg", "off the course, 95 % of the time", "deg", 1),
    ("rudder_travel_deg_s", "travel of the ordered rudder", "deg/s", 2),
    ("rudder_travel_on_course_deg_s", "of it out of turns", "deg/s", 2),
    ("turns", "turns", "", 0),
    ("worst_past_deg", "worst past the course", "deg", 1),
    ("largest_turn_deg", "largest turn", "deg", 0),
    ("largest_turn_settled_s", "its settling to 3 deg", "s", 1),
    ("steering_lost", "steering lost", "times", 0),
)


def table_of_runs(first: RunOf, second: RunOf) -> list[tuple[str, ...]]:
    """Return both runs' measures and the second's as a share of the first's, the heads first."""
    one, other = measures_of_run(first), measures_of_run(second)
    table: list[tuple[str, ...]] = [("", first.name, second.name, "second, of the first")]
    for key, words, unit, digits in ROWS:
        left, right = one[key], other[key]
        share = (
            f"{100.0 * right / left:.0f} %"
            if left and math.isfinite(left + right) and unit not in ("", "times")
            else ""
        )
        table.append((words, _cell(left, digits, unit), _cell(right, digits, unit), share))
    return table


def _cell(value: float, digits: int, unit: str) -> str:
    return f"{value:.{digits}f} {unit}".rstrip() if math.isfinite(value) else "-"


UNMOVED_DEG_S = 0.01


def compared(first: RunOf, second: RunOf) -> Verdict:
    """Return which run was steered better: by the course that was held and by the rudder that it took, out of turns."""
    courses = first.steered.rms_deg, second.steered.rms_deg
    # below this nothing was moved, by noise or at all
    rudders = tuple(max(run.steered.held_travel_deg_s, UNMOVED_DEG_S) for run in (first, second))
    shortest = min(first, second, key=lambda run: run.steered.on_course)
    if shortest.steered.on_course < SHORTEST_S or 0.0 in courses:
        held = f"{shortest.name} has {shortest.steered.on_course:.0f} s"
        return Verdict("not enough", f"not enough: both runs must hold a course for {SHORTEST_S:.0f} s; {held} of it")
    said, better = [], []
    for words, (left, right) in (("course", courses), ("rudder", rudders)):
        share = right / left
        how = "alike" if abs(share - 1.0) < NEARLY else f"{share:.2f} times"
        better.append(0 if abs(share - 1.0) < NEARLY else 1 if share < 1.0 else -1)
        said.append(f"{'off the course' if words == 'course' else 'rudder travel'} {how}")
    lost = first.steered.lost - second.steered.lost
    sums = sum(better) + (2 * lost)
    if min(better) < 0 < max(better) and not lost:
        grade, what = "traded", "traded: one holds the course better, the other spares the rudder"
    elif sums == 0:
        grade, what = "alike", "alike"
    else:
        grade = "better" if sums > 0 else "worse"
        what = f"the second run is {grade}"
    return Verdict(grade, f"{what}; second against first: {', '.join(said)}. Seas differ: compare runs of one day.")


def document_of_runs(first: RunOf, second: RunOf) -> dict[str, Any]:
    """Return the comparison for programs."""
    return {
        "verdict": compared(first, second)._asdict(),
        "runs": [
            {"log": run.name, "verdict": run.steered.verdict and run.steered.verdict._asdict(), **measures_of_run(run)}
            for run in (first, second)
        ],
    }


def comparison_page(first: RunOf, second: RunOf, command: str) -> str:
    """Return the page: how far each was off and its rudder over time, the verdict, then the table."""
    runs = (first, second)
    offs, rudders = zip(*map(_lines, runs), strict=True)
    figure = time_figure([Panel("off the course [deg]", offs), Panel("rudder ordered [deg]", rudders)])
    sections = [
        Section("Measures", table_of_runs(first, second)),
        Section(
            "Each run by itself",
            text=tuple(f"{run.name}: {run.steered.verdict.sentence}" for run in runs if run.steered.verdict),
        ),
    ]
    hero = Section("", figure=figure, caption="time since each run engaged; starboard positive")
    lead = "The same measures on both logs: how well a course was held, how turns ended, and what the rudder did."
    opening = Opening("Two runs compared", lead, hero, compared(first, second))
    return render(opening, sections, command)


def _lines(run: RunOf) -> tuple[Line, Line]:
    """Return how far off the course the run was, and its rudder."""
    rows = [
        (tick.now, wrap(tick.state.heading - tick.reference.heading), tick.command.angle)
        for tick in chain.from_iterable(run.parts)
        if tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
    ]
    time, off, angle = np.array(rows[:: max(1, len(rows) // POINTS_MOST)]).reshape(-1, 3).T
    since = time - (time[0] if time.size else 0.0)
    return Line(run.name, since, np.degrees(off)), Line(run.name, since, np.degrees(angle))
