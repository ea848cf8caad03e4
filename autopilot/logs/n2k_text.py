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
import re
import statistics
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
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
    LogFormat,
    Progress,
    Recording,
    Series,
    lines_in,
    on_one_clock,
    quantities_of,
    series_of,
    silent,
    spread,
    stamp_of,
    stamped,
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
    """Messages as they were sent, decoded while one goes through them: their fields take ten times the memory.

    times [s], groups, sources, contents: of one length.
    """

    times: FloatArray
    groups: list[int]
    sources: list[int]
    contents: list[bytes]

    def among(self, *groups: int) -> Iterator[Message]:
        """Yield those of the groups, or where none is given all."""
        every = zip(self.times, self.groups, self.sources, self.contents, strict=True)
        for time, group, source, content in every:
            if not groups or group in groups:
                yield Message(float(time), group, source, decoded(group, content))


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
        series += series_of(quantity, source, np.array(times), np.array(values))
    if not series:
        raise InputError(f"{path}: holds none of the NMEA 2000 messages that are read: {KINDS}.")
    dates = (date - each.time for each in among() if (date := moment(each.fields)) is not None)
    began = 0.0 if is_dated else next(dates, None)
    recording = on_one_clock(Recording(path, kind, tuple(series), began, tuple(notes)))
    return recording._replace(notes=(*recording.notes, *_choices(recording)))


Found = dict[tuple[str, int, str], tuple["array[float]", "array[float]"]]
"""Times and values by quantity, group and source."""


def _values(messages: Iterable[Message], compass: Compass) -> Found:
    found: Found = defaultdict(lambda: (array("d"), array("d")))
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
            times, values = found[quantity, group, source]
            times.append(time)
            values.append(value)
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

PAIR = "[0-9A-Fa-f]{2}"
IN_BRACKETS = r"\((?P<stamp>[^()]{1,40})\)\s+"
IDENTIFIER = "(?P<id>[0-9A-Fa-f]{3,8})"
SPACED = rf"(?P<data>(?:\s+{PAIR})*)"
FORMS = {
    "canboat log": r"(?P<stamp>\d{4}-\d\d-\d\d[-T ]\d\d:\d\d:\d\d(?:[.,]\d{1,9})?Z?),\d{1,2},(?P<group>\d{1,6}),"
    rf"(?P<source>\d{{1,3}}),\d{{1,3}},(?P<length>\d{{1,4}}),(?P<data>{PAIR}(?:,{PAIR})*),?",
    "candump log": rf"{IN_BRACKETS}\S{{1,32}}\s+{IDENTIFIER}#(?P<data>(?:{PAIR})*|R\d?)(?:\s+[RT])?",
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
SERVER = re.compile(r"(\d{13});[^;]{1,40};")
ACTISENSE = re.compile(r"(\d\d)(\d\d)(\d\d\.\d+)")


class Frame(NamedTuple):
    """A line: its place in the file, its stamp ('': none), and what of a message it is."""

    place: int
    stamp: str
    group: int
    source: int
    data: bytes


class Lines(NamedTuple):
    """The frames of groups that are read. kind: the form of the lines. good, bad: lines of it, and of none."""

    kind: str
    frames: list[Frame]
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
    kind, frames, good, bad = lines_of(data, progress)
    count = good + bad
    if bad > BAD_SHARE * count:
        raise InputError(f"{path}: {bad} of {count} lines are none of a {kind}; it is damaged.")
    if not frames:
        known = ", ".join(str(group) for group in INSTRUMENTS)
        raise InputError(f"{path}: is a {kind} without any of the messages that are read: {known}.")
    stamps = [_stamp(each.stamp) for each in frames]
    notes = []
    if any(each.stamp for each in frames):
        sound = [(frame, stamp) for frame, stamp in zip(frames, stamps, strict=True) if stamp is not None]
        kept = without_outliers([stamp for _, stamp in sound])
        sound = [each for each, is_kept in zip(sound, kept, strict=True) if is_kept]
        if len(sound) < (1.0 - BAD_SHARE) * len(frames):
            raise InputError(f"{path}: {len(frames) - len(sound)} of {len(frames)} time stamps are no times.")
        bad += len(frames) - len(sound)
        time, is_of_day = stamped(path, [stamp for _, stamp in sound], "message")
        is_dated = not is_of_day and bool(time[-1] > EPOCH_FROM)
        messages, lost = _messages([frame for frame, _ in sound], time)
    else:
        messages, lost = _spread(path, kind, frames)
        is_dated = True
        notes.append(f"{path}: has no time stamps; times are spread between those in its messages.")
    if bad:
        notes.append(f"{path}: {bad} of {count} lines are damaged and left out.")
    if lost:
        notes.append(f"{path}: {lost} messages of several frames lack one and are left out.")
    found = recording_of(path, f"NMEA 2000 ({kind})", messages.among, variation, is_dated)
    return found._replace(notes=(*notes, *found.notes))


def lines_of(data: bytes, progress: Progress = silent) -> Lines:
    """Return the lines of whatever is in a file; blank ones, comments (#) and a device's status are none."""
    kinds = dict.fromkeys(PATTERNS, 0)
    pattern, kind = PATTERNS["canboat log"], "canboat log"
    frames: list[Frame] = []
    bad = 0
    for place, raw in enumerate(lines_in(data, progress)):
        line = raw[: LINE_MOST + 1].decode("ascii", "replace").strip()
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
        frame = _frame(place, stamp, found.groupdict())
        if frame is None:
            bad += 1
            continue
        kinds[kind] += 1
        if frame.group in INSTRUMENTS:
            frames.append(frame)
    return Lines(max(kinds, key=kinds.__getitem__), frames, sum(kinds.values()), bad)


def _frame(place: int, stamp: str, parts: dict[str, str | None]) -> Frame | None:
    """Return the frame in the parts of a line, of group 0 where it is none of NMEA 2000; None where it is damaged."""
    text = parts.get("data") or ""
    stamp = stamp or parts.get("stamp") or ""
    if parts.get("seconds") is not None:
        stamp = stamp or f"{parts['seconds']}.{parts['ms']:0>3}"
    if (address := parts.get("id") or parts.get("bare")) is not None:
        value = int(address, 16)
        is_short = len(address) < 8 and parts.get("bare") is None
        if is_short or value > IDENTIFIER_MOST or text.startswith("R"):
            return Frame(place, stamp, 0, 0, b"")
        group, source = addressed(value)
    elif (number := parts.get("hex")) is not None:
        group, source = int(number, 16), int(parts["from"] or "", 16)
    else:
        group, source = int(parts["group"] or ""), int(parts["source"] or "")
    if group not in INSTRUMENTS:
        return Frame(place, stamp, 0, 0, b"")
    try:
        packed = parts.get("base64")
        data = bytes.fromhex(text.replace(",", "")) if packed is None else binascii.a2b_base64(packed, strict_mode=True)
    except binascii.Error:
        return None
    if (length := parts.get("length")) is not None and int(length) != len(data):
        return None
    return Frame(place, stamp, group, source, data)


def _stamp(text: str) -> tuple[float, bool] | None:
    """Return the time [s] in a stamp, and whether it is one of day; Actisense's may have any hour."""
    if (found := ACTISENSE.fullmatch(text)) is not None:
        return int(found[1]) * 3600.0 + int(found[2]) * 60.0 + float(found[3]), True
    return stamp_of(dashed(text))


def dashed(text: str) -> str:
    """Return a stamp with a dash between date and time, as canboat writes it, as one with a T."""
    return f"{text[:10]}T{text[11:]}" if text[10:11] == "-" else text


def _messages(frames: Sequence[Frame], time: FloatArray) -> tuple[Undecoded, int]:
    """Return the messages in frames, and how many of several frames were lost."""
    packets = FastPackets()
    found = Undecoded(time, [], [], [])
    kept = np.full(len(frames), True)
    for at, (frame, now) in enumerate(zip(frames, time.tolist(), strict=True)):
        whole: bytes | None = frame.data
        if frame.group in FAST and len(frame.data) <= FRAME_BYTES:
            whole = packets.add(now, frame.group, frame.source, frame.data)
        kept[at] = whole is not None
        if whole is not None:
            found.groups.append(frame.group)
            found.sources.append(frame.source)
            found.contents.append(whole)
    return found._replace(times=time[kept]), packets.lost


def _spread(path: str, kind: str, frames: Sequence[Frame]) -> tuple[Undecoded, int]:
    """Return the messages of a log without stamps, timed by the moments in some of them. Raises InputError."""
    messages, lost = _messages(frames, np.array([LINE_S * frame.place for frame in frames]))
    marks = [(each.time, when) for each in messages.among() if (when := moment(each.fields)) is not None]
    time = spread(messages.times, marks)
    if time is None:
        raise InputError(
            f"{path}: is a {kind} without time stamps, and {len(marks)} messages in it tell the time (129029, 126992); "
            "record with time stamps (candump -L)."
        )
    return messages._replace(times=time), lost


FORMAT = LogFormat(
    "an NMEA 2000 log in text",
    is_n2k_text,
    lambda path, data, options: read_n2k(path, data, options.variation, options.progress),
    is_text=True,
)
