"""What the messages of an NMEA 2000 log mean: heading, yaw rate, roll, rudder and its orders, speed, position, wind.

Several sources of one group are series of their own, the one with the most samples first. Speed through the water comes
before that over the ground, a heading before the yaw of an attitude, whose north no field tells.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.links.n2k_messages import (
    ATTITUDE,
    GNSS,
    GROUND_SPEED,
    LAYOUTS,
    POSITION,
    RATE_OF_TURN,
    RUDDER,
    SYSTEM_TIME,
    VARIATION,
    WATER_SPEED,
    WIND,
    Compass,
    Fields,
    apparent_wind,
    is_heading,
    moment,
    number,
    own_variation,
    rudder_order,
    sample_of,
)
from autopilot.links.n2k_messages import HEADING as VESSEL_HEADING
from autopilot.logs.series import (
    HEADING,
    ORDER,
    WIND_DIRECTION,
    WIND_SPEED,
    Recording,
    Series,
    on_one_clock,
    quantities_of,
    series_of,
)

YAW_MOST = 3.1416
PREFERRED = (VESSEL_HEADING, ATTITUDE, RATE_OF_TURN, RUDDER, WATER_SPEED, GROUND_SPEED, POSITION, GNSS, WIND)
"""Groups that series come from; of those with the same quantity the preferred one first."""
KINDS = (
    "heading 127250, rate of turn 127251, rudder 127245, speed 128259 or 129026, position 129025 or 129029, roll 127257"
)


class Message(NamedTuple):
    """A decoded message: time [s] on the log's clock, parameter group, address of its source, fields."""

    time: float
    group: int
    source: int
    fields: Fields


def recording_of(
    path: str, kind: str, messages: Sequence[Message], variation: float | None, is_dated: bool
) -> Recording:
    """Return the recording in the messages of a log.

    variation [rad], east positive: of magnetic headings that bring none; None takes the median of what the log says.
    is_dated: times are Unix times; otherwise the first message that has the date gives it. Raises InputError where
    nothing that is read is in it.
    """
    notes: list[str] = []
    stated = [
        east for each in messages if each.group in (VARIATION, VESSEL_HEADING) if (east := own_variation(each.fields))
    ]
    if variation is None and stated:
        variation = statistics.median(stated)
    found = _values(messages, Compass(variation))
    if not any(quantity == HEADING and group == VESSEL_HEADING for quantity, group, _ in found):
        magnetic = _values([each for each in messages if is_heading(each.group, each.fields)], Compass(0.0))
        if magnetic:
            notes.append(f"{path}: the variation is not known; headings are magnetic, which does for identification.")
        found.update(magnetic)
    ordered = sorted(found.items(), key=lambda item: (PREFERRED.index(item[0][1]), -len(item[1])))
    series: list[Series] = []
    for (quantity, group, source), pairs in ordered:
        if (quantity, group) == (HEADING, ATTITUDE) and len({value for _, value in pairs}) == 1:
            continue  # of a sensor that knows roll and pitch alone
        series += series_of(quantity, source, [time for time, _ in pairs], [value for _, value in pairs])
    if not series:
        raise InputError(f"{path}: holds none of the NMEA 2000 messages that are read: {KINDS}.")
    dates = (date - each.time for each in messages if (date := moment(each.fields)) is not None)
    began = 0.0 if is_dated else next(dates, None)
    recording = on_one_clock(Recording(path, kind, tuple(series), began, tuple(notes)))
    return recording._replace(notes=(*recording.notes, *_choices(recording)))


Found = dict[tuple[str, int, str], list[tuple[float, float]]]
"""Times and values by quantity, group and source."""


def _values(messages: Sequence[Message], compass: Compass) -> Found:
    found: Found = defaultdict(list)
    for time, group, address, fields in messages:
        if group not in LAYOUTS or group in (SYSTEM_TIME, VARIATION):
            continue
        source = f"N2K{group}.{address}"
        pairs: list[tuple[str, float]] = []
        if group == RUDDER:
            source += f":{rudder:g}" if (rudder := number(fields, "instance", 252.0)) else ""
            pairs += [] if (order := rudder_order(fields)) is None else [(ORDER, order)]
        elif group == ATTITUDE:
            pairs += [] if (yaw := number(fields, "yaw", YAW_MOST)) is None else [(HEADING, yaw)]
        elif group == WIND and (wind := apparent_wind(fields)) is not None:
            pairs += [(WIND_SPEED, wind[0]), (WIND_DIRECTION, wind[1])]
        sample = sample_of(group, time, fields, compass, source)
        pairs += [] if sample is None else quantities_of(sample)
        for quantity, value in pairs:
            found[quantity, group, source].append((time, value))
    return found


def _choices(recording: Recording) -> list[str]:
    """Return a sentence about each quantity that several sources send in the same group."""
    notes = []
    for quantity in dict.fromkeys(each.quantity for each in recording.series):
        used = recording.best(quantity)
        if used is None:
            continue
        group = used.source.partition(".")[0]
        others = [each for each in recording.of(quantity) if each is not used and each.source.startswith(f"{group}.")]
        if others:
            rest = ", ".join(f"{each.source} ({each.time.size})" for each in others[:5])
            notes.append(
                f"{recording.source}: {quantity} is that of {used.source} ({used.time.size} samples), not of {rest}."
            )
    return notes
