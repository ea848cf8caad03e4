"""The measures of manoeuvres as rows for people: name, value, criterion; used by the terminal and by the page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from autopilot.identification import manoeuvring_criteria as criteria
from autopilot.identification.trial_measures import Circle, Measures, PullOut, Spiral, Zigzag
from autopilot.printable import fixed

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth")

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
        found.append((measures.spiral.begins, _spiral(measures.spiral, length, _speed(measures))))
    return [Block(next(rows)[0], begins, tuple(rows)) for begins, rows in found]


def _zigzag(found: Zigzag, length: float | None) -> Iterator[Row]:
    kind = criteria.zigzag_kind(found.rudder, found.execute)
    yield (
        f"Zigzag {_deg(found.rudder)}/{_deg(found.execute)} from {_s(found.begins)} at {_speed_of(found.speed)}",
        "",
        "",
    )
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


def _speed(measures: Measures) -> float:
    speeds = [one.speed for one in measures.zigzags] + [one.speed for one in measures.circles]
    return speeds[0] if speeds else math.nan


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
