"""The rudder of a recording: measured, or what the steering gear makes of the pulses or commands that it was given."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.runs import RudderOrigin
from autopilot.loop.logs.own_log import PILOT
from autopilot.loop.logs.series import ORDER, RUDDER, SHARE, FloatArray, Recording, Series
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step

RudderChoice = Literal["auto", "measured", "servo", "commands"]
CHOICES: tuple[RudderChoice, ...] = ("auto", "measured", "servo", "commands")

GEAR_STEP_S = 0.02
LONGEST_HOLD_S = 2.0
"""An order older than this, with none since, says nothing about where the rudder is."""


class RudderSettings(NamedTuple):
    """Where the rudder comes from.

    choice: see CHOICES. at_full [rad]: rudder at full share, negative where the servo turns the other way, None where
    not known. gear: the steering gear behind servo or commands, None to take the rudder to stand where it is told.
    """

    choice: RudderChoice = "auto"
    at_full: float | None = None
    gear: SteeringGear | None = None


class FoundRudder(NamedTuple):
    """The rudder [rad] of a recording, where it comes from in words, and what it is."""

    series: Series
    words: str
    origin: RudderOrigin


def rudder_of(recording: Recording, settings: RudderSettings) -> FoundRudder | None:
    """Return the rudder that the settings choose; None where the recording has none.

    Raises InputError where what was chosen is not there, or a servo's angle is not known.
    """
    choices = ("measured", "commands", "servo") if settings.choice == "auto" else (settings.choice,)
    for choice in choices:
        found = _by_choice(recording, settings, choice)
        if found is not None:
            return found
    if settings.choice != "auto":
        raise InputError(f"{recording.source}: --rudder {settings.choice}: the log holds none; {_offers(recording)}.")
    return None


def _by_choice(recording: Recording, settings: RudderSettings, choice: str) -> FoundRudder | None:
    if choice == "measured":
        return _measured(recording, settings.choice == "auto")
    if choice == "commands":
        orders = recording.best(ORDER)
        return None if orders is None else _moved(orders, settings.gear, "commanded")
    shares = recording.best(SHARE)
    if shares is None:
        return None
    if settings.at_full is None:
        raise InputError(
            f"{recording.source}: the rudder is known as a share of its full angle ({shares.source}), not as an angle; "
            "give --vessel FILE, or the angle at full steering with --rudder-at-full-deg."
        )
    angles = shares._replace(values=shares.values * settings.at_full)
    return _moved(angles if settings.gear is None else _between_reports(angles), settings.gear, "by")


def _measured(recording: Recording, with_estimate: bool) -> FoundRudder | None:
    sensor = recording._replace(series=tuple(s for s in recording.series if not _by_pilot(s))).best(RUDDER)
    series = recording.best(RUDDER) if with_estimate else sensor
    if series is None:
        return None
    # where there is a sensor, the pilot's estimate follows it
    origin: RudderOrigin = "estimated" if sensor is None else "measured"
    if _by_pilot(series):
        return FoundRudder(series, "the pilot's estimate (sensor or steering gear)", origin)
    return FoundRudder(series, f"measured ({series.source})", origin)


def _by_pilot(series: Series) -> bool:
    """Return whether the pilot's estimator made the series; merging puts the file's name before the source."""
    return series.source.rpartition(": ")[2] == PILOT


def _moved(orders: Series, gear: SteeringGear | None, word: str) -> FoundRudder:
    how = f"{word} {orders.source}" if word == "by" else f"as {word}"
    if gear is None:
        return FoundRudder(orders._replace(quantity=RUDDER), f"{how}, taken to stand where it was ordered", "ordered")
    return FoundRudder(through_gear(orders, gear), f"{how}, through the steering gear of the vessel file", "ordered")


def _between_reports(orders: Series) -> Series:
    """Return orders that were looked at now and then, at every GEAR_STEP_S in straight lines between the reports.

    A change is seen at the first report after it, half a spacing late on average; a straight line from the report
    before is right on average.
    """
    pauses = np.flatnonzero(np.diff(orders.time) > max(LONGEST_HOLD_S, 5.0 * orders.spacing)) + 1
    stretches = np.split(orders.time, pauses)
    times = np.concatenate(
        [np.arange(part[0], max(part[-1], part[0] + GEAR_STEP_S), GEAR_STEP_S) for part in stretches]
    )
    return orders._replace(time=times, values=np.interp(times + 0.5 * GEAR_STEP_S, orders.time, orders.values))


def through_gear(orders: Series, gear: SteeringGear) -> Series:
    """Return where `gear` takes the rudder under `orders` [rad], each held until the next; it starts at the first.

    Behind an order that nothing follows for LONGEST_HOLD_S (or five spacings) the series has a gap.
    """
    hold = max(LONGEST_HOLD_S, 5.0 * orders.spacing)
    line = DelayLine(gear.delay, float(orders.values[0]))
    angle, now = float(orders.values[0]), float(orders.time[0])
    times, angles = [now], [angle]
    ends = np.minimum(np.append(orders.time[1:], orders.time[-1] + orders.spacing), orders.time + hold)
    for start, order, end in zip(orders.time, orders.values, ends, strict=True):
        now = float(start)
        line.give(now, float(order))
        steps = max(1, math.ceil((end - now) / GEAR_STEP_S - 1.0e-9))
        for step in range(1, steps + 1):
            until = now + (float(end) - now) * step / steps
            angle = gear_step(gear, angle, line.effective(until - 1.0e-9), until - times[-1])
            times.append(until)
            angles.append(angle)
    return Series(RUDDER, orders.source, *_rising(np.array(times), np.array(angles)))


def _rising(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    last = np.append(np.diff(time) > 0.0, True)
    return time[last], values[last]


def _offers(recording: Recording) -> str:
    kinds = {RUDDER: "measured", ORDER: "commands", SHARE: "servo"}
    there = [name for quantity, name in kinds.items() if recording.of(quantity)]
    return f"it has {' and '.join(there)}" if there else "it has no rudder of any kind"
