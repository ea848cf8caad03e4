"""A log of any kind, known by its content, as a recording.

What a log holds and what identification can use of it.

Logs of any kind as runs for the identification, several of one run merged.

Kinds of files that people have beside readable logs are known by their content, too: what one is, and what to do.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.outside import alike, as_utf8, read_regular, utf8_blocks
from autopilot.identification.rudder_path import jumps_share
from autopilot.identification.runs import Run, gap_limit, run_from_columns, seconds
from autopilot.links.mavlink.frames import MAGIC_V1, MAGIC_V2
from autopilot.logs.merge import merged, sources_of
from autopilot.logs.series import ANGLES, THROTTLE, WIND_DIRECTION, FloatArray, LogFormat, Recording, Series, duration
from autopilot.logs.series import ReadOptions as ReadOptions
from autopilot.logs.table import RudderSettings, ServoScale, Table, orders_of, table_of
from autopilot.vessel.schema import Vessel

LOOK_AT = 4096
FARTHER = 65536

TABLE = "write time, heading, rudder and speed from it as a CSV table"
FRAMES = "turn it into candump's text (python-can: python -m can.logconvert FILE FILE.log)"
RECORD = "record the bus with candump -L, or the instruments' lines as text"
CANBOAT = "turn it into JSON with canboat (analyzer -json)"
CONVERT = "turn it into text with the maker's program"
UNPACK = "unpack it first"
NO_RUDDER = "it has no rudder and no heading of a compass; give the log of the instruments"
NO_LOG = "give a log"


SENTENCE = re.compile(rb"\$(?!PCDIN|MXPGN)[A-Z]{2,}[A-Z0-9]*,")
"""A sentence of NMEA 0183 that carries none of NMEA 2000."""


class Kind(NamedTuple):
    """A kind of file: what it is, what to do, and whether bytes are of it."""

    what: str
    advice: str
    is_it: Callable[[bytes], bool]


def _begins(*beginnings: bytes, at: int = 0) -> Callable[[bytes], bool]:
    return lambda data: data[at : at + max(map(len, beginnings))].startswith(beginnings)


def _matches(pattern: bytes) -> Callable[[bytes], bool]:
    form = re.compile(pattern, re.IGNORECASE)
    return lambda data: form.match(data[:LOOK_AT].lstrip()) is not None


def _lines(beginning: bytes) -> Callable[[bytes], bool]:
    """Return whether lines begin so and no sentence of NMEA 0183 stands beside them."""
    form = re.compile(rb"(?m)^[^\r\n$!]{0,64}" + beginning)
    return lambda data: form.search(data[:FARTHER]) is not None and SENTENCE.search(data[:FARTHER]) is None


def _is_signalk(data: bytes) -> bool:
    line = rb"(?:\d{13};\w{1,20};)?\{[^\r\n]{0,4000}\"(?:updates|context)\"\s*:"
    return re.match(line, data.lstrip()[:LOOK_AT]) is not None and SENTENCE.search(data[:FARTHER]) is None


def _is_json(data: bytes) -> bool:
    return re.match(rb"[{\[]\s*[{\[\"\]}]", data[:LOOK_AT].lstrip()) is not None and not {b'"pgn"', b'"fields"'} <= set(
        re.findall(rb'"pgn"|"fields"', data[:FARTHER])
    )


def _is_spreadsheet(data: bytes) -> bool:
    return data.startswith(b"PK\3\4") and re.search(rb"\[Content_Types\]\.xml|opendocument", data[:LOOK_AT]) is not None


def _is_rosbag(data: bytes) -> bool:
    head = data[:FARTHER].lower()
    return head.startswith(b"sqlite format 3\0") and b"create table topics" in head and b"create table messages" in head


def _is_frames_database(data: bytes) -> bool:
    return data.startswith(b"SQLite format 3\0") and b"arbitration_id" in data[:FARTHER]


PCAP = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"M<\xb2\xa1", b"\xa1\xb2<M")
BINARY = (
    Kind("a packet capture (.pcap)", RECORD, _begins(*PCAP)),
    Kind("a packet capture (.pcapng)", RECORD, _begins(b"\n\r\r\n")),
    Kind("a ROS 2 bag (.db3)", TABLE, _is_rosbag),
    Kind("python-can's database of frames", FRAMES, _is_frames_database),
    Kind("an SQLite database", TABLE, _begins(b"SQLite format 3\0")),
    Kind("a ROS 1 bag (.bag)", TABLE, _begins(b"#ROSBAG V")),
    Kind("a Vector CAN log (.blf)", FRAMES, _begins(b"LOGG")),
    Kind("a CAN log in MDF (.mf4)", FRAMES, _begins(b"MDF     ")),
    Kind("a Yacht Devices voyage recorder's file (.DAT)", CONVERT, _begins(b"YDVR", at=8)),
    Kind("a Garmin activity (.fit)", NO_RUDDER, _begins(b".FIT", at=8)),
    Kind("a Raymarine archive of waypoints and tracks (.fsh)", NO_RUDDER, _begins(b"RL90 FLASH FILE")),
    Kind("a Parquet table", "export the log as .csv or .mcap instead", _begins(b"PAR1")),
    Kind("a MATLAB file (.mat)", TABLE, _begins(b"MATLAB 5.0", b"MATLAB 7.3")),
    Kind("an HDF5 file", TABLE, _begins(b"\x89HDF\r\n\x1a\n")),
    Kind("a NumPy array", TABLE, _begins(b"\x93NUMPY")),
    Kind("a spreadsheet (.xlsx, .ods)", "save it as CSV", _is_spreadsheet),
    Kind("a spreadsheet (.xls)", "save it as CSV", _begins(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")),
    Kind("packed (gzip)", UNPACK, _begins(b"\x1f\x8b")),
    Kind("packed (zip)", UNPACK, _begins(b"PK\3\4", b"PK\5\6")),
    Kind("packed (7z)", UNPACK, _begins(b"7z\xbc\xaf")),
    Kind("packed (xz)", UNPACK, _begins(b"\xfd7zXZ")),
    Kind("packed (bzip2)", UNPACK, _begins(*(b"BZh%d1AY&SY" % size for size in range(1, 10)))),
    Kind("packed (zstd)", UNPACK, _begins(b"\x28\xb5\x2f\xfd")),
    Kind("packed (rar)", UNPACK, _begins(b"Rar!\x1a\x07")),
    Kind("a PDF", NO_LOG, _begins(b"%PDF-")),
    Kind("a picture", NO_LOG, _begins(b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8")),
)
TEXT = (
    Kind("a DataFlash log turned into text", "give the .BIN that it was made from", _begins(b"FMT, 128")),
    Kind("a file of parameters, no log", "give the log of a run", _matches(rb"(?:#[^\n]*\n\s*)*schema_version:")),
    Kind("a GPX track", NO_RUDDER, _matches(rb"<(?:[^<]*<){0,9}?gpx\b")),
    Kind("a KML track", NO_RUDDER, _matches(rb"<(?:[^<]*<){0,9}?kml\b")),
    Kind("a web page", NO_LOG, _matches(rb"<!doctype html|<html")),
    Kind("an XML file", NO_RUDDER, _matches(rb"<\?xml")),
    Kind("an Expedition log", TABLE, _matches(rb"!boat,")),
    Kind("a Garmin CAN log", CANBOAT, _matches(rb"Sequence #,Timestamp,PGN,")),
    Kind("python-can's CSV of frames", FRAMES, _matches(rb"timestamp,arbitration_id,")),
    Kind("SavvyCAN's CSV of frames", "save the frames as candump's text", _matches(rb"Time Stamp,ID,Extended,")),
    Kind("a table of CAN frames", FRAMES, _matches(rb"Time[^\n]{0,40},ID,[^\n]{0,40}\bDLC\b")),
    Kind("a PCAN trace (.trc)", FRAMES, _matches(rb";\$FILEVERSION=")),
    Kind("a Vector CAN log (.asc)", FRAMES, _matches(rb"date [^\n]{1,80}\n\s*base\s+(?:hex|dec)")),
    Kind("what a serial CAN adapter sends (slcan)", RECORD, _matches(rb"T[0-9A-F]{8}[0-8](?:[0-9A-F]{2}){0,10}\s")),
    Kind("a text of messages for an iKonvert, without times", RECORD, _matches(rb"!PDGY,\d+,\d+,[A-Za-z0-9+/=]+\s")),
    Kind("a text of frames without times", RECORD, _matches(rb"[01][0-9A-F]{7}(?: [0-9A-F]{2}){1,8}\s")),
    Kind("a glider's track (.igc)", NO_RUDDER, _matches(rb"A[^\n]{3,80}\r?\nHFDTE")),
    Kind("InfluxDB's line protocol", TABLE, _matches(rb"[\w.]+(?:,[\w.]+=[^ ,\n]+)* [\w.]+=[^ \n]+ \d{16,19}\s")),
    Kind("a MOOS log (.alog)", TABLE, _matches(rb"%%[^\n]*\n?%% LOG FILE|%% LOG FILE")),
    Kind("an OpenCPN log without NMEA 0183", RECORD, _lines(rb"received_at,protocol,")),
    Kind("NMEA 2000 inside NMEA 0183 ($PCDIN, $MXPGN)", CANBOAT, _lines(rb"\$(?:PCDIN|MXPGN),")),
    Kind(
        "canboat's text for people",
        CANBOAT,
        _matches(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d+ \d +\d{1,3} +\d{1,3} +\d{4,6} "),
    ),
    Kind("a log of AIS reports", "they tell of other ships; " + NO_RUDDER, _lines(rb"!(?:AI|BS|AB)VD[MO],")),
    Kind("a Signal K log", "log what the instruments send instead (data logging of the connection)", _is_signalk),
    Kind("GeoJSON", NO_RUDDER, _matches(rb"\{[^\n]{0,400}\"FeatureCollection\"")),
    Kind("JSON, but no messages of canboat's", TABLE, _is_json),
)
ENDINGS = {
    ".ebl": ("an Actisense log (.ebl)", CONVERT),
    ".vdr": ("a voyage data recorder's file (.vdr)", RECORD),
    ".dat": ("a file (.dat) of a kind that is not known", RECORD),
    ".adm": ("a Garmin user data file (.adm)", NO_RUDDER),
    ".sl2": ("a sonar log (.sl2)", NO_RUDDER),
    ".sl3": ("a sonar log (.sl3)", NO_RUDDER),
    ".slg": ("a sonar log (.slg)", NO_RUDDER),
}
"""What a file is taken for by its name, where its content tells nothing."""


def named(path: str, data: bytes) -> str | None:
    """Return the sentence that refuses a file of a kind known by its content that is not read; None for another."""
    kinds = BINARY if b"\0" in data[:LOOK_AT] else (*TEXT, *BINARY)
    found = next((each for each in kinds if each.is_it(data)), None)
    return None if found is None else _sentence(path, found.what, found.advice)


def named_by_ending(path: str) -> str | None:
    """Return the sentence that refuses a file whose name alone tells its kind; None for another."""
    found = ENDINGS.get(Path(path).suffix.lower())
    return None if found is None else _sentence(path, *found)


def _sentence(path: str, what: str, advice: str) -> str:
    if what.startswith("packed"):
        return f"{path}: is {what}; {advice}."
    return f"{path}: is {what}, which is not read; {advice}."


MODULES = (
    "own_log",
    "tlog",
    "dataflash",
    "ulog",
    "mcap_log",
    "n2k_json",
    "n2k_text",
    "nmea_text",
    "csv_log",
)
"""Modules of this room with a constant FORMAT, in the order in which a file is asked whether it is of one."""
FORMATS: tuple[LogFormat, ...] = tuple(import_module(f"autopilot.logs.{module}").FORMAT for module in MODULES)


def examples() -> str:
    """Return what can be read, in words."""
    return ", ".join(each.example for each in FORMATS if each.example)


def read_recording(path: str, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the recording in a log of any kind. Raises InputError where the file cannot be used."""
    found = format_of(path, head_of(path))
    return found.read(path, b"" if found.is_streamed else bytes_of(path), options)


def format_of(path: str, data: bytes) -> LogFormat:
    """Return of what format a file is, by its beginning. Raises InputError where that is none known here."""
    if (found := next((each for each in FORMATS if not each.is_text and each.is_it(data)), None)) is not None:
        return found
    if (refusal := named(path, data)) is not None:
        raise InputError(refusal)
    for each in FORMATS:
        if each.ending and Path(path).suffix.lower() == each.ending:
            raise InputError(f"{path}: {each.broken}")
    if data[:1] in (bytes([MAGIC_V1]), bytes([MAGIC_V2])):
        raise InputError(f"{path}: is a MAVLink stream without time stamps; record it as .tlog.")
    if b"\0" in data[:LOOK_AT]:
        raise InputError(
            named_by_ending(path)
            or f"{path}: is no log of a kind known here, or its beginning is lost; readable are {examples()}."
        )
    return next(each for each in FORMATS if each.is_text and each.is_it(data))


def head_of(path: str) -> bytes:
    """Return the first bytes of a log, a text's in UTF-8. Raises InputError, also where there are none."""
    return _opened(path, lambda: next(utf8_blocks(path), b""))


def bytes_of(path: str) -> bytes:
    """Return what a log holds, a text in UTF-8. Raises InputError, also where that is nothing."""
    return _opened(path, lambda: as_utf8(read_regular(path)))


def _opened(path: str, read: Callable[[], bytes]) -> bytes:
    try:
        data = read()
    except OSError as error:
        advice = alike(path) if isinstance(error, FileNotFoundError) else ""
        raise InputError(f"{path}: {error.strerror}{advice or '; give a log that exists and can be read'}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: begins as a text in {error.encoding} and is none; save it as UTF-8.") from None
    if not data:
        raise InputError(f"{path}: is empty; a log is needed: {examples()}.")
    return data


NEEDED = {"rudder_rad": "rudder", "speed_m_s": "speed"}


class SeriesInfo(NamedTuple):
    """One series: median rate [Hz], times [s] of first and last sample, gaps that break the record, range."""

    quantity: str
    source: str
    samples: int
    rate_hz: float
    begins: float
    ends: float
    gaps: int
    longest_gap: float
    low: float
    high: float


class LogInfo(NamedTuple):
    """What a log is, holds, and gives the identification.

    duration [s]; began: Unix time [s] or None; uses: where each column would come from; usable: seconds in runs
    without gaps, and segments how many those are; missing: why it cannot be used, '' where it can.
    """

    source: str
    kind: str
    duration: float
    began: float | None
    series: tuple[SeriesInfo, ...]
    uses: dict[str, str]
    usable: float
    segments: int
    missing: str
    notes: tuple[str, ...]


def info_of(recording: Recording, settings: RudderSettings) -> LogInfo:
    """Return what there is to know of a recording; never raises for what is only missing."""
    uses, usable, segments, missing, left_out = _use(recording, settings)
    return LogInfo(
        recording.source,
        recording.kind,
        duration(recording),
        recording.began,
        tuple(_info(series) for series in recording.series),
        uses,
        usable,
        segments,
        missing,
        (*recording.notes, *left_out),
    )


def _use(recording: Recording, settings: RudderSettings) -> tuple[dict[str, str], float, int, str, tuple[str, ...]]:
    uses: dict[str, str] = {}
    try:
        table, uses, _ = table_of(recording, settings)
        for column, name in NEEDED.items():
            if column not in table:
                raise InputError(f"{recording.source}: holds no {name}; merge it in from another log with +FILE.")
        run = run_from_columns(recording.source, table)
    except InputError as error:
        return uses, 0.0, 0, str(error), ()
    return uses, seconds(run), len(run.segments), "", run.notes


def _info(series: Series) -> SeriesInfo:
    values = np.unwrap(series.values) if series.quantity in ANGLES else series.values
    if series.quantity == WIND_DIRECTION:
        # a boat turns on and on; a vane is somewhere between port and starboard
        values = np.angle(np.exp(1j * values))
    apart = np.diff(series.time)
    limit = gap_limit(series.time) if apart.size else 0.0
    return SeriesInfo(
        series.quantity,
        series.source,
        int(series.time.size),
        1.0 / series.spacing,
        float(series.time[0]),
        float(series.time[-1]),
        int(np.count_nonzero(apart > limit)),
        series.longest_gap,
        float(np.min(values)),
        float(np.max(values)),
    )


class LogOptions(NamedTuple):
    """How to read logs, and where the rudder comes from."""

    reading: ReadOptions = ReadOptions()
    rudder: RudderSettings = RudderSettings()

    def of_vessel(self, vessel: Vessel) -> LogOptions:
        """Return them with what the vessel's file says of servo, rudder, gear and thrusters, where they say nothing."""
        from autopilot.runtime.build import gear_of, thrusters_of  # most commands read no vessel's log

        helm, servo, at_full = vessel.helm, self.reading.servo, self.rudder.at_full
        if servo is None and helm.servo_us is not None:
            servo = ServoScale(*helm.servo_us)
        if at_full is None:
            full = math.radians(helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg)
            at_full = -full if helm.reversed else full
        reading = self.reading._replace(servo=servo, thrusters=thrusters_of(vessel))
        return LogOptions(reading, self.rudder._replace(at_full=at_full, gear=gear_of(vessel)))


def load_recording(text: str, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the log `text`, or the logs of one run merged: FILE+FILE@SECONDS. Raises InputError."""
    sources = sources_of(text)
    return merged([read_recording(source.path, options) for source in sources], [source.offset for source in sources])


def load_run(
    text: str,
    column_map: Mapping[str, str] | None = None,
    reverse_rudder: bool = False,
    options: LogOptions = LogOptions(),  # noqa: B008 - immutable
) -> Run:
    """Return the run in the log `text`, or in several logs of it: FILE+FILE@SECONDS; its headings at its gyro's time.

    column_map: what CSV tables call their columns. reverse_rudder: the recorded rudder is positive to port. Raises
    InputError where a file cannot be used.
    """
    from autopilot.identification.compass_and_gyro import in_time  # slow to load, and most commands read no run

    reading = options.reading._replace(columns=column_map or options.reading.columns)
    sources = sources_of(text)
    as_it_is = format_of(text, head_of(text)).run if len(sources) == 1 else None
    if as_it_is is not None:
        columns, notes = as_it_is(text, reading)
        run = run_from_columns(text, _turned(columns, reverse_rudder))
        return in_time(_if_ordered(run._replace(notes=(*notes, *run.notes)), options.rudder))
    recording = load_recording(text, reading)
    table = _table(text, recording, options.rudder)
    notes = recording.notes
    if table.rudder == "ordered":
        notes = (*notes, f"{text}: the rudder is {table.uses['rudder_rad']}.")
    run = run_from_columns(text, _turned(table.columns, reverse_rudder))
    throttle = table.columns.get(THROTTLE)
    known = throttle is not None and bool(np.any(np.isfinite(throttle)))
    mean = float(np.nanmean(throttle)) if throttle is not None and known else math.nan
    orders = None if reverse_rudder else orders_of(recording)
    run = _if_ordered(run._replace(notes=(*notes, *run.notes), rudder=table.rudder, orders=orders), options.rudder)
    return in_time(run._replace(vessel=recording.vessel, late=recording.late, throttle=mean))


def _if_ordered(run: Run, rudder: RudderSettings) -> Run:
    """Return the run with its rudder as one that was ordered where it moves as orders do and nobody says otherwise."""
    if run.rudder != "measured" or rudder.choice == "measured" or run.orders is not None:
        return run
    if jumps_share(run.segments) < MOSTLY_JUMPS:
        return run
    said = (
        f"{run.source}: the rudder jumps from angle to angle and stands between, as orders do and no steering gear: it "
        "is taken for what was ordered; --rudder measured says that a sensor showed it."
    )
    return run._replace(rudder="ordered", notes=(*run.notes, said))


MOSTLY_JUMPS = 0.9
"""A rudder that takes a share s of the spacing of its samples to go over is caught on its way in a share s of its
moves. One that is caught in a tenth of them is there within a tenth of the spacing, a third of what nobody knows of the
moment (1/sqrt(12) of it): order and angle are one then, whoever wrote them."""


def _turned(columns: Mapping[str, FloatArray], reverse_rudder: bool) -> Mapping[str, FloatArray]:
    return {**columns, "rudder_rad": -columns["rudder_rad"]} if reverse_rudder else columns


def _table(text: str, recording: Recording, rudder: RudderSettings) -> Table:
    table = table_of(recording, rudder, between_motions=True)
    if "rudder_rad" not in table.columns:
        hint = next((note for note in recording.notes if "servo" in note), "")
        raise InputError(hint or f"{text}: holds no rudder; the rudder's angle, its servo or its orders are needed.")
    if "speed_m_s" not in table.columns:
        raise InputError(f"{text}: holds no two speeds; merge them in from another log of the run with +FILE.")
    return table
