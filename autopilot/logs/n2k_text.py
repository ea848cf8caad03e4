"""NMEA 2000 logs in text, a frame or a message a line: canboat, candump, Yacht Devices, Actisense, Digital Yacht.

    2011-11-24-22:42:04.388,2,127251,36,255,8,7d,0b,...  canboat: stamp, priority, group, source, destination, length;
                                                         frames, or fast packets put together; also stamped ...T...Z
    (1436509052.249713) can0 09F8027F#FFFC...            candump -L
    (1436509052.249713)  can0  09F8027F   [8]  FF FC     candump -ta; without the stamp; <0x09f8027f> [8] ff fc
    17:33:21.107 R 19F51323 01 2F 30 70                  Yacht Devices: received or transmitted, identifier
    A173321.107 23FF7 1F513 012F3070002F30709F           Actisense: source, destination and priority, group
    !PDGY,127250,2,3,255,482.36,2y20AAAAAAE=             iKonvert: group, priority, source, destination, seconds and
                                                         milliseconds (482.036 s) since it began, base 64

Before a line may stand what a Signal K server's log has there: milliseconds since 1970 and the kind of line.
Sources: canboat, common/parse.c and samples; can-utils, candump.c and lib.c; Yacht Devices, manual of the YDWG-02,
appendix E; Actisense, "NMEA 2000 ASCII output format" of the W2K-1; canboat's samples/ikonvert.log; Signal K, data
logging.

What messages mean, whatever form they were kept in: several sources of one group are series of their own, the one with
the most samples first. Speed through the water comes before that over the ground, a heading before the yaw of an
attitude, whose north no field tells.
"""

from __future__ import annotations

import binascii
import math
import re
import statistics
from array import array
from collections.abc import Callable, Iterable, Iterator
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.files.outside import ByteRows
from autopilot.links.n2k.packets import (
    ATTITUDE,
    FAST,
    FRAME_BYTES,
    GNSS,
    GROUND_SPEED,
    IDENTIFIER_MOST,
    POSITION,
    RATE_OF_TURN,
    RUDDER,
    SYSTEM_TIME,
    VARIATION,
    WATER_SPEED,
    WIND,
    FastPackets,
    Fields,
    decoded,
    number,
)
from autopilot.links.n2k.packets import HEADING as VESSEL_HEADING
from autopilot.links.n2k.packets import group_and_source as addressed
from autopilot.links.n2k.samples import (
    INSTRUMENTS,
    Compass,
    apparent_wind,
    is_heading,
    moment,
    own_variation,
    rudder_order,
    sample_of,
    source_name,
)
from autopilot.logs.series import (
    EPOCH_FROM,
    HEADING,
    ORDER,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    Gathered,
    LogFormat,
    Progress,
    Recording,
    Series,
    counted_on,
    lines_in,
    on_one_clock,
    quantities_of,
    series_of,
    silent,
    spread,
    stamp_of,
    without_outliers,
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


class Undecoded(NamedTuple):
    """Frames, or messages put together of them, as they were sent, decoded while one goes through them: their fields
    take ten times the memory.

    groups, sources, contents: of one length.
    """

    groups: array[int]
    sources: array[int]
    contents: ByteRows

    @classmethod
    def none(cls) -> Undecoded:
        """Return where there are none yet."""
        return cls(array("I"), array("H"), ByteRows())

    def add(self, group: int, source: int, content: bytes) -> None:
        """Append one."""
        self.groups.append(group)
        self.sources.append(source)
        self.contents.append(content)

    def at(self, times: FloatArray) -> Among:
        """Return what gives the messages, which came at `times` [s], of some groups or all."""

        def among(*groups: int) -> Iterator[Message]:
            for time, group, source, content in zip(map(float, times), *self, strict=True):
                if not groups or group in groups:
                    yield Message(time, group, source, decoded(group, content))

        return among


Among = Callable[..., Iterable[Message]]
"""Gives a log's messages of some parameter groups, or all."""


def recording_of(path: str, kind: str, among: Among, variation: float | None, is_dated: bool) -> Recording:
    """Return the recording in the messages of a log.

    variation [rad], east positive: of magnetic headings that bring none; None takes the median of what the log says.
    is_dated: times are Unix times; otherwise the first message that has the date gives it. Raises InputError where
    nothing that is read is in it.
    """
    notes: list[str] = []
    stated = [east for each in among(VARIATION, VESSEL_HEADING) if (east := own_variation(each.fields))]
    if variation is None and stated:
        variation = statistics.median(stated)
    found = _values(among(), Compass(variation))
    if not any(quantity == HEADING and group == VESSEL_HEADING for quantity, group, _ in found):
        magnetic = _values((each for each in among() if is_heading(each.group, each.fields)), Compass(0.0))
        if magnetic:
            notes.append(f"{path}: the variation is not known; headings are magnetic, which does for identification.")
        found.update(magnetic)
    ordered = sorted(found.items(), key=lambda item: (PREFERRED.index(item[0][1]), -len(item[1][0])))
    series: list[Series] = []
    for (quantity, group, source), (times, values) in ordered:
        if (quantity, group) == (HEADING, ATTITUDE) and len(set(values)) == 1:
            continue  # of a sensor that knows roll and pitch alone
        series += series_of(quantity, source, times, values)
    if not series:
        raise InputError(f"{path}: holds none of the NMEA 2000 messages that are read: {KINDS}.")
    dates = (date - each.time for each in among() if (date := moment(each.fields)) is not None)
    began = 0.0 if is_dated else next(dates, None)
    recording = on_one_clock(Recording(path, kind, tuple(series), began, tuple(notes)))
    return recording._replace(notes=(*recording.notes, *_choices(recording)))


def _values(messages: Iterable[Message], compass: Compass) -> Gathered[tuple[str, int, str]]:
    """Return times and values by quantity, group and source."""
    found = Gathered[tuple[str, int, str]]()
    for time, group, address, fields in messages:
        if group not in INSTRUMENTS or group in (SYSTEM_TIME, VARIATION):
            continue
        source = source_name(group, address, fields)
        pairs: list[tuple[str, float]] = []
        if group == RUDDER:
            pairs += [] if (order := rudder_order(fields)) is None else [(ORDER, order)]
        elif group == ATTITUDE:
            pairs += [] if (yaw := number(fields, "yaw", YAW_MOST)) is None else [(HEADING, yaw)]
        elif group == WIND and (wind := apparent_wind(fields)) is not None:
            pairs += [(WIND_SPEED, wind[0]), (WIND_DIRECTION, wind[1])]
        sample = sample_of(group, time, fields, compass, source)
        pairs += [] if sample is None else quantities_of(sample)
        for quantity, value in pairs:
            found.put((quantity, group, source), time, value)
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


LOOK_AT = 65536
LINE_MOST = 4096
"""Characters of a line; the longest message of NMEA 2000 has 1785 bytes."""
BAD_SHARE = 0.2
LINE_S = 1.0e-3
"""What a line of a log without stamps is taken to last while fast packets are put together."""

SINCE_LINE_BEFORE = (
    "its time stamps go back and forth: they tell how long after the line before each line came (candump -td); record "
    "with candump -L."
)

PAIR = "[0-9A-Fa-f]{2}"
IN_BRACKETS = r"\((?P<stamp>[^()]{1,40})\)\s+"
IDENTIFIER = "(?P<id>[0-9A-Fa-f]{3,8})"
SPACED = rf"(?P<data>(?:\s+{PAIR})*)"
FORMS = {
    "canboat log": r"(?P<stamp>\d{4}-\d\d-\d\d[-T ]\d\d:\d\d:\d\d(?:[.,]\d{1,9})?Z?),\d{1,2},(?P<group>\d{1,6}),"
    rf"(?P<source>\d{{1,3}}),\d{{1,3}},(?P<length>\d{{1,4}}),(?P<data>{PAIR}(?:,{PAIR})*),?",
    "candump log": rf"{IN_BRACKETS}\S{{1,32}}\s+{IDENTIFIER}#(?:#[0-9A-Fa-f])?(?P<data>(?:{PAIR})*|R\d?)(?:\s+[RT])?",
    "candump": rf"(?:(?:{IN_BRACKETS})?[A-Za-z]\S{{0,31}}\s+(?:[RT]X\s+\S\s+\S\s+)?{IDENTIFIER}"
    rf"|<0x(?P<bare>[0-9A-Fa-f]{{3,8}})>)\s+\[\d{{1,2}}\]{SPACED}(?:\s+(?:'.*'|remote request|ERRORFRAME))?",
    "Yacht Devices RAW log": rf"(?P<stamp>\d\d:\d\d:\d\d\.\d{{1,6}})\s+[RT]\s+{IDENTIFIER}{SPACED}",
    "Actisense N2K ASCII log": rf"A(?P<stamp>\d{{6}}\.\d{{1,6}})\s+(?P<from>{PAIR}){PAIR}[0-9A-Fa-f]\s+"
    rf"(?P<hex>[0-9A-Fa-f]{{5,6}})\s+(?P<data>(?:{PAIR})+)",
    "iKonvert log": r"!PDGY,(?P<group>\d{1,6}),\d,(?P<source>\d{1,3}),\d{1,3},(?P<seconds>\d{1,9})\.(?P<ms>\d{1,3}),"
    r"(?P<base64>[A-Za-z0-9+/]{2,400}={0,2})",
}
"""What a line has to be as a whole, by what such a log is called."""
PATTERNS = {name: re.compile(form, re.ASCII) for name, form in FORMS.items()}
COLOURS = re.compile(r"\x1b\[[0-9;]{0,9}m")
"""What `candump -c` colours a line with."""
SERVER = re.compile(r"(\d{13});[^;]{1,40};")
ACTISENSE = re.compile(r"(\d\d)(\d\d)(\d\d\.\d+)")


class Frame(NamedTuple):
    """A line: its stamp ('': none), and what of a message it is."""

    stamp: str
    group: int
    source: int
    data: bytes


class Lines(NamedTuple):
    """The frames of groups that are read, by numbers alone: there may be millions.

    kind: the form of the lines. frames: as they were sent. places: lines of the file before each. stamps [s]: nan where
    one is no time. are_of_day: whether it is one of day. are_stamped: any of them. good, bad: lines of it, and of none.
    """

    kind: str
    frames: Undecoded
    places: array[int]
    stamps: array[float]
    are_of_day: array[int]
    are_stamped: bool
    good: int
    bad: int


def is_n2k_text(data: bytes) -> bool:
    """Return whether the beginning of a file has such lines, and not more NMEA 0183 sentences than those."""
    head = data[:LOOK_AT]
    good = lines_of(head).good
    return good > 0 and good >= len(re.findall(rb"\$[A-Z]{5},", head))


def read_n2k(path: str, data: bytes, variation: float | None = None, progress: Progress = silent) -> Recording:
    """Return the recording in a log of such lines. Raises InputError.

    variation [rad], east positive: of magnetic headings that bring none.
    """
    lines = lines_of(data, progress)
    kind, bad, count, frames = lines.kind, lines.bad, lines.good + lines.bad, len(lines.places)
    if bad > BAD_SHARE * count:
        raise InputError(f"{path}: {bad} of {count} lines are none of a {kind}; it is damaged.")
    if not frames:
        known = ", ".join(str(group) for group in INSTRUMENTS)
        raise InputError(f"{path}: is a {kind} without any of the messages that are read: {known}.")
    notes = []
    if lines.are_stamped:
        stamps = np.asarray(lines.stamps)
        kept = np.isfinite(stamps)
        if np.count_nonzero(np.diff(stamps[kept]) < 0.0) > BAD_SHARE * frames and stamps[kept].max() < EPOCH_FROM:
            raise InputError(f"{path}: {SINCE_LINE_BEFORE}")
        kept[kept] = without_outliers(stamps[kept])
        if (sound := int(np.count_nonzero(kept))) < (1.0 - BAD_SHARE) * frames:
            raise InputError(f"{path}: {frames - sound} of {frames} time stamps are no times.")
        bad += frames - sound
        is_of_day = bool(np.asarray(lines.are_of_day)[kept].all())
        time = counted_on(path, stamps[kept], is_of_day, "message")
        is_dated = not is_of_day and bool(time[-1] > EPOCH_FROM)
        messages, time, lost = _messages(lines.frames, kept, time)
    else:
        messages, time, lost = _spread(path, lines)
        is_dated = True
        notes.append(f"{path}: has no time stamps; times are spread between those in its messages.")
    if bad:
        notes.append(f"{path}: {bad} of {count} lines are damaged and left out.")
    if lost:
        notes.append(f"{path}: {lost} messages of several frames lack one and are left out.")
    del lines
    found = recording_of(path, f"NMEA 2000 ({kind})", messages.at(time), variation, is_dated)
    return found._replace(notes=(*notes, *found.notes))


def lines_of(data: bytes, progress: Progress = silent) -> Lines:
    """Return the lines of whatever is in a file; blank ones, comments (#) and a device's status are none."""
    kinds = dict.fromkeys(PATTERNS, 0)
    pattern, kind = PATTERNS["canboat log"], "canboat log"
    frames, places, stamps, are_of_day = Undecoded.none(), array("q"), array("d"), array("b")
    bad, are_stamped = 0, False
    for place, raw in enumerate(lines_in(data, progress)):
        line = COLOURS.sub("", raw[: LINE_MOST + 1].decode("ascii", "replace")).strip()
        if not line or line.startswith(("#", "$PDGY,")):
            continue
        stamp = ""
        if (server := SERVER.match(line)) is not None:
            stamp, line = server[1], line[server.end() :]
        found = pattern.fullmatch(line)
        if found is None:
            for other, candidate in PATTERNS.items():
                if (found := candidate.fullmatch(line)) is not None:
                    pattern, kind = candidate, other
                    break
        if found is None or len(line) > LINE_MOST:
            bad += 1
            continue
        frame = _frame(stamp, found.groupdict())
        if frame is None:
            bad += 1
            continue
        kinds[kind] += 1
        if frame.group in INSTRUMENTS:
            time = _stamp(frame.stamp)
            frames.add(frame.group, frame.source, frame.data)
            places.append(place)
            stamps.append(math.nan if time is None else time[0])
            are_of_day.append(time is not None and time[1])
            are_stamped = are_stamped or frame.stamp != ""
    kind = max(kinds, key=kinds.__getitem__)
    return Lines(kind, frames, places, stamps, are_of_day, are_stamped, sum(kinds.values()), bad)


def _frame(stamp: str, parts: dict[str, str | None]) -> Frame | None:
    """Return the frame in the parts of a line, of group 0 where it is none of NMEA 2000; None where it is damaged."""
    text = parts.get("data") or ""
    stamp = stamp or parts.get("stamp") or ""
    if parts.get("seconds") is not None:
        stamp = stamp or f"{parts['seconds']}.{parts['ms']:0>3}"
    if (address := parts.get("id") or parts.get("bare")) is not None:
        value = int(address, 16)
        is_short = len(address) < 8 and parts.get("bare") is None
        if is_short or value > IDENTIFIER_MOST or text.startswith("R"):
            return Frame(stamp, 0, 0, b"")
        group, source = addressed(value)
    elif (number := parts.get("hex")) is not None:
        group, source = int(number, 16), int(parts["from"] or "", 16)
    else:
        group, source = int(parts["group"] or ""), int(parts["source"] or "")
    if group not in INSTRUMENTS:
        return Frame(stamp, 0, 0, b"")
    try:
        packed = parts.get("base64")
        padded = None if packed is None else packed.rstrip("=") + "=" * (-len(packed.rstrip("=")) % 4)
        data = bytes.fromhex(text.replace(",", "")) if padded is None else binascii.a2b_base64(padded, strict_mode=True)
    except binascii.Error:
        return None
    if (length := parts.get("length")) is not None and int(length) != len(data):
        return None
    return Frame(stamp, group, source, data)


def _stamp(text: str) -> tuple[float, bool] | None:
    """Return the time [s] in a stamp, and whether it is one of day; Actisense's may have any hour."""
    if (found := ACTISENSE.fullmatch(text)) is not None:
        return int(found[1]) * 3600.0 + int(found[2]) * 60.0 + float(found[3]), True
    return stamp_of(dashed(text))


def dashed(text: str) -> str:
    """Return a stamp with a dash between date and time, as canboat writes it, as one with a T."""
    return f"{text[:10]}T{text[11:]}" if text[10:11] == "-" else text


def _messages(frames: Undecoded, kept: NDArray[np.bool_], time: FloatArray) -> tuple[Undecoded, FloatArray, int]:
    """Return the messages in the frames that are `kept`, which came at `time` [s], when, and how many of several frames
    were lost."""
    packets, found, times = FastPackets(), Undecoded.none(), array("d")
    for (group, source, data), now in zip(compress(zip(*frames, strict=True), kept), map(float, time), strict=True):
        whole: bytes | None = data
        if group in FAST and len(data) <= FRAME_BYTES:
            whole = packets.add(now, group, source, data)
        if whole is not None:
            found.add(group, source, whole)
            times.append(now)
    return found, np.asarray(times), packets.lost


def _spread(path: str, lines: Lines) -> tuple[Undecoded, FloatArray, int]:
    """Return the messages of a log without stamps, timed by the moments in some of them, when, and how many were lost.

    Raises InputError.
    """
    places = np.asarray(lines.places) * LINE_S
    messages, places, lost = _messages(lines.frames, np.full(places.size, True), places)
    marks = [(each.time, when) for each in messages.at(places)() if (when := moment(each.fields)) is not None]
    time = spread(places, marks)
    if time is None:
        raise InputError(
            f"{path}: is a {lines.kind} without time stamps, and {len(marks)} messages in it tell the time (129029, "
            "126992); record with time stamps (candump -L)."
        )
    return messages, time, lost


FORMAT = LogFormat(
    "an NMEA 2000 log in text",
    is_n2k_text,
    lambda path, data, options: read_n2k(path, data, options.variation, options.progress),
    is_text=True,
)
