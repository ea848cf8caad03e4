"""What every log becomes: series of quantities in SI units on one clock.

A log format says of itself how it is known by its content, and how such series are read.

When the lines of a log in text were received: by the time stamps before them, or spread between those inside. Stamps
known: seconds or milliseconds since 1970, ISO 8601 dates with time, a time of day, seconds from any beginning, and the
tag block of NMEA 4.10 (\\c:SECONDS*hh\\). Without stamps the times that some lines hold are marks, and what lies
between two marks is spread evenly by its place in the file: right to within the pauses of the line.
"""

from __future__ import annotations

import io
import itertools
import math
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.files.outside import BLOCK, whole_lines
from autopilot.models.drives import PLAIN, Mixing
from autopilot.signals import (
    HeadingSample,
    PositionSample,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
    ThrustSample,
)

if TYPE_CHECKING:
    from autopilot.logs.table import Servo, ServoScale

FloatArray = NDArray[np.float64]

HEADING, RATE, SPEED = "heading_rad", "yaw_rate_rad_s", "speed_m_s"
ROLL = "roll_rad"
"""Positive with the starboard side down."""
RUDDER = "rudder_rad"
"""The rudder's angle as measured, starboard positive."""
ORDER = "rudder_order_rad"
"""The rudder angle that was commanded."""
THROTTLE = "throttle_share"
"""The share of full throttle, -1 to 1 and ahead positive, that went to the motor or motors."""
SHARE = "steering_share"
"""The share of full rudder, -1 to 1 and starboard positive, that went to the steering servo."""
LATITUDE, LONGITUDE = "latitude_rad", "longitude_rad"
PROPELLER, WIND_SPEED, WIND_DIRECTION = "propeller_rps", "wind_speed_m_s", "wind_direction_rad"

ANGLES = (HEADING, WIND_DIRECTION, LONGITUDE)
"""Quantities that go round the circle."""


DAY_S = 86400.0
FARTHEST_S = 3.0 * DAY_S
"""Neighbours further apart than this are not of one clock: it was set between them, or one of them is damage."""
PART_SHARE = 0.02
"""The part before or behind such a step is damage where it has a smaller share of the samples of the largest part."""
PAUSE_S = 60.0
"""How long after its end the part behind a step is taken to begin: nobody knows, and so much is a gap to everybody."""
LONGEST_S = 30.0 * DAY_S
STEPS_S = (1.0e-7, 600.0)
"""How far apart the samples of a recording can be, for the most part; closer ones are of one moment."""
LARGEST = 1.0e11
"""No quantity of a boat is larger, in SI units."""
LATEST_S = 1.0e20
"""No log's own form of time goes further: beyond are no times but numbers that were damaged."""


class Series(NamedTuple):
    """One quantity from one source: times [s] on the recording's clock, strictly increasing, and values."""

    quantity: str
    source: str
    time: FloatArray
    values: FloatArray

    @property
    def spacing(self) -> float:
        """Median spacing of the samples [s]; inf where there are fewer than two."""
        return float(np.median(np.diff(self.time))) if self.time.size > 1 else float("inf")

    @property
    def longest_gap(self) -> float:
        """Longest time [s] between neighbouring samples; 0 where there are fewer than two."""
        return float(np.max(np.diff(self.time))) if self.time.size > 1 else 0.0


PILOT = "pilot"
"""Source of what the pilot's estimator made of the samples: rudder (fed back, or by the steering-gear model), speed."""


class Recording(NamedTuple):
    """One log.

    source: the file. kind: what it is, in words. series: those of a quantity in the order in which they are
    preferred. began: Unix time [s] of the clock's zero, None where the log does not tell. notes: sentences about
    what was damaged, guessed or left out. vessel: text of the vessel file that the pilot had, in its own logs. late:
    how long after a heading its order came to the rudder [s], there too, nan where it does not show or nobody asked.
    """

    source: str
    kind: str
    series: tuple[Series, ...]
    began: float | None = None
    notes: tuple[str, ...] = ()
    vessel: str = ""
    late: float = math.nan

    def of(self, quantity: str) -> list[Series]:
        """Return the series of `quantity`, the preferred one first."""
        return [series for series in self.series if series.quantity == quantity]

    def best(self, quantity: str) -> Series | None:
        """Return the series of `quantity` to use: the first that covers half the time of the longest at least."""
        found = [series for series in self.of(quantity) if series.time.size > 1]
        if not found:
            return None
        longest = max(_span(series) for series in found)
        return next(series for series in found if _span(series) >= 0.5 * longest)


def series_of(
    quantity: str, source: str, times: Sequence[float] | FloatArray, values: Sequence[float] | FloatArray
) -> tuple[Series, ...]:
    """Return the series of samples that can be, in order of time, of samples at one time the last; none where empty.

    Arrays that are so already are not copied: the quantities of a table have one time.
    """
    time, value = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    known = (np.abs(time) <= LATEST_S) & (np.abs(value) <= LARGEST)
    if not known.all():
        time, value = time[known], value[known]
    if time.size == 0:
        return ()
    if np.all(np.diff(time) > 0.0):
        return (Series(quantity, source, time, value),)
    order = np.argsort(time, kind="stable")
    time, value = time[order], value[order]
    last = np.append(np.diff(time) > 0.0, True)
    return (Series(quantity, source, time[last], value[last]),)


Key = TypeVar("Key")


class Gathered(dict[Key, tuple["array[float]", "array[float]"]]):
    """Times and values of each key as they are read, 16 bytes for a value: a pair of numbers in a list takes seven
    times as much."""

    def __missing__(self, key: Key) -> tuple[array[float], array[float]]:
        self[key] = new = array("d"), array("d")
        return new

    def put(self, key: Key, time: float, value: float) -> None:
        """Append one value."""
        times, values = self[key]
        times.append(time)
        values.append(value)


class Clock(NamedTuple):
    """One clock for the parts of a recording between which its own was set.

    begins [s]: of each part, by the recording's own clock. moves [s]: what is added to its times, nan where it is
    damage. notes: sentences about both.
    """

    begins: FloatArray
    moves: FloatArray
    notes: tuple[str, ...]

    def read(self, time: FloatArray) -> FloatArray:
        """Return times [s] by this clock, nan where they are damage."""
        part = np.searchsorted(self.begins, time, side="right") - 1
        return np.asarray(time + self.moves[part], dtype=np.float64)


def check_steps(source: str, time: FloatArray) -> None:
    """Raise InputError where rising times [s] cannot be those of a recording."""
    steps = np.diff(time)
    if steps.size > 1 and not STEPS_S[0] <= (usual := float(np.median(steps))) <= STEPS_S[1]:
        raise InputError(
            f"{source}: its times cannot be those of a recording: {time.size} samples in {time[-1] - time[0]:.3g} s, "
            f"{usual:.3g} s apart for the most part and {np.min(steps):.3g} s at least; times are in seconds, and "
            f"{STEPS_S[0]:g} to {STEPS_S[1]:g} s apart."
        )


def clock_of(source: str, times: FloatArray) -> Clock:
    """Return the clock for the samples at `times` [s], in any order. Raises InputError where they span too much."""
    times = np.sort(times, kind="stable")  # quick on what is sorted for the most part
    parts = np.split(times, np.flatnonzero(np.diff(times) > FARTHEST_S) + 1)
    least = PART_SHARE * max(part.size for part in parts)
    kept = [number for number, part in enumerate(parts) if part.size >= least]
    moves, jumps = np.full(len(parts), np.nan), []
    moves[kept[:1]] = 0.0
    for before, after in itertools.pairwise(kept):
        end, begin = float(parts[before][-1]), float(parts[after][0])
        moves[after] = end + moves[before] + PAUSE_S - begin
        jumps.append((end, begin))
    notes = []
    if jumps:
        (end, begin), more = jumps[0], f", and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
        notes.append(
            f"{source}: its clock jumps by {(begin - end) / DAY_S:.5g} days, from {end:.10g} s to {begin:.10g} s{more} "
            f"(it was set, or two logs were put together); what follows is taken to begin {PAUSE_S:g} s later."
        )
    left_out = times.size - sum(parts[number].size for number in kept)
    if left_out:
        notes.append(f"{source}: {left_out} of {times.size} samples are left out: their times are days off the rest.")
    length = parts[kept[-1]][-1] + moves[kept[-1]] - parts[kept[0]][0]
    if length > LONGEST_S:
        raise InputError(
            f"{source}: its times cannot be those of one recording: it is {length / DAY_S:.4g} days long, and "
            f"{LONGEST_S / DAY_S:g} are the most; cut out the part that is meant."
        )
    return Clock(np.array([part[0] for part in parts]), moves, tuple(notes))


def on_one_clock(recording: Recording) -> Recording:
    """Return what a reader has found on one clock from zero, without what is damage by its time. Raises InputError."""
    if not recording.series:
        return recording
    check_steps(recording.source, max((series.time for series in recording.series), key=np.size))
    begins, ends = (np.array([series.time[at] for series in recording.series]) for at in (0, -1))
    if np.max(ends) - np.min(begins) <= FARTHEST_S:  # no two neighbours are further apart
        clock = Clock(np.min(begins, keepdims=True), np.zeros(1), ())
    else:
        clock = clock_of(recording.source, np.concatenate([series.time for series in recording.series]))
    series = []
    for one in recording.series:
        time = clock.read(one.time)
        last = np.isfinite(time) & ~(np.diff(time, append=np.inf) < STEPS_S[0])
        if last.all():
            series.append(one._replace(time=time))
        elif last.any():
            series.append(one._replace(time=time[last], values=one.values[last]))
    # of the clock's settings the last is right
    set_by = float(clock.moves[np.isfinite(clock.moves)][-1])
    began = None if recording.began is None else recording.began - set_by
    notes = (*recording.notes, *clock.notes)
    return from_zero(recording._replace(series=tuple(series), began=began, notes=notes))


def from_zero(recording: Recording) -> Recording:
    """Return the recording with its first sample at time 0."""
    starts = [float(series.time[0]) for series in recording.series]
    if not starts:
        return recording
    return shifted(recording, -min(starts))


def shifted(recording: Recording, seconds: float) -> Recording:
    """Return the recording on a clock that shows `seconds` more."""
    times = {id(series.time): series.time for series in recording.series}
    moved = {which: time + seconds for which, time in times.items()}
    return recording._replace(
        series=tuple(series._replace(time=moved[id(series.time)]) for series in recording.series),
        began=None if recording.began is None else recording.began - seconds,
    )


def duration(recording: Recording) -> float:
    """Return the time [s] from the first sample to the last; 0 where there is none."""
    if not recording.series:
        return 0.0
    return max(float(s.time[-1]) for s in recording.series) - min(float(s.time[0]) for s in recording.series)


def _span(series: Series) -> float:
    return float(series.time[-1] - series.time[0])


def quantities_of(sample: Sample) -> list[tuple[str, float]]:
    """Return what a sample measured, by quantity; an ordered rudder is none."""
    match sample:
        case HeadingSample(heading=heading, rate=rate):
            return [(HEADING, heading)] if rate is None else [(HEADING, heading), (RATE, rate)]
        case RateSample(rate=rate):
            return [(RATE, rate)]
        case RollSample(roll=roll):
            return [(ROLL, roll)]
        case RudderSample(angle=angle, ordered=False):
            return [(RUDDER, angle)]
        case ThrustSample(throttle=throttle):
            return [(THROTTLE, throttle)]
        case SpeedSample(speed=speed):
            return [(SPEED, speed)]
        case PositionSample(latitude=latitude, longitude=longitude):
            return [(LATITUDE, latitude), (LONGITUDE, longitude)]
    return []


Progress = Callable[[int, int], None]
"""Is called with how much of a log is read, and all of it: bytes, lines or rows."""
SHOWN_SHARE = 100
"""Progress is said about so often while a log is read."""


def silent(done: int, total: int) -> None:
    """Tell nobody how much is read."""


def lines_in(data: bytes, progress: Progress) -> Iterator[bytes]:
    """Yield the lines of a file with their ends, and say now and then how far it is read; a list of all of them would
    be larger than the file."""
    place, step = 0, min(max(len(data) // SHOWN_SHARE, 1), BLOCK)
    for block in whole_lines(data[at : at + step] for at in range(0, len(data), step)):
        progress(place, len(data))
        yield from block.splitlines(keepends=True)
        place += len(block)


class CountedBytes(io.BytesIO):
    """A file's bytes that say now and then how far they are read."""

    def __init__(self, data: bytes, progress: Progress) -> None:
        super().__init__(data)
        self._progress, self._size, self._next = progress, len(data), 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Return the next `size` bytes."""
        data = super().read(size)
        if (place := self.tell()) >= self._next:
            self._next = place + self._size // SHOWN_SHARE
            self._progress(place, self._size)
        return data


def without_zeros(data: bytes) -> int:
    """Return how many bytes stand before the zeros at the end of a file, as a power cut leaves them."""
    end = len(data)
    while end > 0 and data[max(end - BLOCK, 0) : end].count(0) == min(end, BLOCK):
        end -= min(end, BLOCK)
    return max(end - BLOCK, 0) + len(data[max(end - BLOCK, 0) : end].rstrip(b"\0"))


class ReadOptions(NamedTuple):
    """columns: what a CSV table calls its columns. system: MAVLink system id to read.

    servo: the steering servo, or only its scale.
    variation [rad], east positive: of magnetic compasses in NMEA sentences. thrusters: what two of them do, beside
    what the firmware's parameters say. progress: called with how much of a file is read, and all of it.
    path_delay: reckon how late orders came to the rudder, in our own logs, which takes as long as reading them.
    """

    columns: Mapping[str, str] | None = None
    system: int | None = None
    servo: Servo | ServoScale | None = None
    variation: float | None = None
    thrusters: Mixing = PLAIN
    progress: Progress = silent
    path_delay: bool = False


class LogFormat(NamedTuple):
    """A format, as `autopilot.logs.reading` knows it.

    example: one of its files, as a sentence names it; "": another format's says enough.
    is_it: says of a file's first bytes (BLOCK) whether they are of this format. read: the recording in a file, of its
    path, its bytes and the options; InputError where it cannot be used.
    ending, broken: of the file names that promise it, and what is said where the content is another.
    is_text: it is looked for after all that is not.
    packets: it is a row of MAVLink packets; ticks: of the pilot's own ticks, too.
    is_streamed: it reads the file itself, and is given none of its bytes.
    run: the columns of a run, and notes, where they stand in the file as they are; None: they are made of the series.
    """

    example: str
    is_it: Callable[[bytes], bool]
    read: Callable[[str, bytes, ReadOptions], Recording]
    ending: str = ""
    broken: str = ""
    is_text: bool = False
    packets: bool = False
    ticks: bool = False
    is_streamed: bool = False
    run: Callable[[str, ReadOptions], tuple[Mapping[str, FloatArray], tuple[str, ...]]] | None = None


MILLISECONDS_FROM = 1.0e11
"""Numbers beyond this are milliseconds since 1970, and beyond a thousand times this microseconds."""
EPOCH_FROM = 3.0e8
"""A number of seconds above this is counted from 1970 (1979 on)."""
PREFIX_MOST = 256
"""Characters before a line that are looked at."""
BACK_MOST_S = 1.0
"""Lines may stand in another order than that of their stamps by this much."""

_TAG = re.compile(r"\\[^\\]*?c:(\d+)[^\\]*\\\s*$")
_ISO = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:[.,]\d+)?)\s*(Z|[+-]\d\d:?\d\d)?")
_OF_DAY = re.compile(r"(?<![\d:])(\d\d):(\d\d):(\d\d(?:[.,]\d+)?)(?![\d:])")
_NUMBER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)(?![\w.])")


def stamp_of(prefix: str) -> tuple[float, bool] | None:
    """Return the time [s] in what stands before a line, and whether it is a time of day; None where none is."""
    prefix = prefix[-PREFIX_MOST:]
    tag = _TAG.search(prefix)
    if tag:
        return _epoch(tag[1])
    iso = _ISO.search(prefix)
    if iso:
        zone = (iso[3] or "Z").replace("Z", "+00:00")
        try:
            moment = datetime.fromisoformat(f"{iso[1]}T{iso[2].replace(',', '.')[:15]}{zone}")
            return moment.timestamp(), False
        except (ValueError, OverflowError):
            return None
    clock = _OF_DAY.search(prefix)
    if clock:
        time = of_day(clock[1], clock[2], clock[3].replace(",", "."))
        return None if time is None else (time, True)
    number = _NUMBER.search(prefix)
    return _epoch(number[1]) if number else None


def _epoch(digits: str) -> tuple[float, bool] | None:
    """Return the seconds that a number of seconds, milliseconds, micro- or nanoseconds is; None where it is no time."""
    value = float(digits)
    for _ in range(3):
        value = value * 1.0e-3 if value > MILLISECONDS_FROM else value
    return (value, False) if value <= MILLISECONDS_FROM else None


def of_day(hours: str, minutes: str, seconds: str) -> float | None:
    """Return the time of day [s], None where no clock shows it; a day may end with a leap second."""
    if int(hours) > 23 or int(minutes) > 59 or float(seconds) >= 61.0:
        return None
    return int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)


def without_midnight(times: FloatArray) -> FloatArray:
    """Return times of day [s] counted on over midnight."""
    turns = np.where(np.diff(times) < -0.5 * DAY_S, 1.0, 0.0)
    return times + DAY_S * np.concatenate(([0.0], np.cumsum(turns)))


def spread(places: Sequence[float] | FloatArray, marks: Sequence[tuple[float, float]]) -> FloatArray | None:
    """Return the times [s] of lines at `places` in the file from (place, UTC) marks; None with fewer than two marks.

    The first sentence of each new UTC is the mark. Beyond the marks the nearest two are continued.
    """
    fresh = [mark for at, mark in enumerate(marks) if at == 0 or mark[1] != marks[at - 1][1]]
    if len(fresh) < 2:
        return None
    at = np.array([place for place, _ in fresh], dtype=np.float64)
    times = without_midnight(np.array([time for _, time in fresh]))
    rising = np.append(True, np.diff(times) > 0.0)
    at, times = at[rising], times[rising]
    if at.size < 2:
        return None
    x = np.asarray(places, dtype=np.float64)
    inside = np.interp(x, at, times)
    before = times[0] + (x - at[0]) * (times[1] - times[0]) / (at[1] - at[0])
    after = times[-1] + (x - at[-1]) * (times[-1] - times[-2]) / (at[-1] - at[-2])
    return np.asarray(np.where(x < at[0], before, np.where(x > at[-1], after, inside)))


def counted_on(path: str, time: FloatArray, is_of_day: bool, what: str) -> FloatArray:
    """Return the times [s] of lines by their stamps, those of day over midnight.

    what: one of the lines, as a refusal names it. Raises InputError where they step back.
    """
    time = without_midnight(time) if is_of_day else time
    # small steps add up: a file that is written backwards would else be read as sailed forwards
    behind = np.maximum.accumulate(time) - time
    back = np.flatnonzero(behind > BACK_MOST_S)
    if back.size:
        raise InputError(
            f"{path}: the time stamps step back by {behind[back[0]]:.1f} s at {what} {back[0] + 1}: "
            "the clock was set, or two logs were put together; keep one part."
        )
    return time


def without_outliers(time: FloatArray) -> NDArray[np.bool_]:
    """Return which stamps [s] are kept: not one alone that lies outside its neighbours, which are in order."""
    kept = np.full(time.size, True)
    if time.size > 2:
        before, here, after = time[:-2], time[1:-1], time[2:]
        odd = (here < before - BACK_MOST_S) | (here > after + BACK_MOST_S)
        kept[1:-1] = ~((before <= after) & odd)
    return kept
