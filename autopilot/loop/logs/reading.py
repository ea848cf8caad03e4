"""A log of any kind, known by its content, as a recording."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.links.mavlink_codec import MAGIC_V1
from autopilot.links.signing import MAGIC_V2
from autopilot.loop.csv_log import read_csv
from autopilot.loop.logs.dataflash import HEAD
from autopilot.loop.logs.dataflash_log import read_dataflash
from autopilot.loop.logs.nmea_text import is_nmea_text, read_nmea
from autopilot.loop.logs.own_log import is_own, read_own
from autopilot.loop.logs.series import Recording, on_one_clock, series_of
from autopilot.loop.logs.servo import Servo, ServoScale
from autopilot.loop.logs.tlog import read_tlog
from autopilot.loop.logs.ulog import read_ulog
from autopilot.regular_file import read_regular

KINDS = "a .tlog, an ArduPilot .BIN, a PX4 .ulg, NMEA sentences in text, a CSV table"
ULOG = b"ULog\x01\x12\x35"
PACKED = {b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"7z\xbc\xaf": "7z", b"\xfd7zXZ": "xz"}


class Kind(Enum):
    """Kinds of logs."""

    DATAFLASH = "ArduPilot DataFlash log"
    OWN = "Norrbin log"
    TLOG = "MAVLink telemetry log"
    ULOG = "PX4 log"
    NMEA = "NMEA 0183 sentences"
    TABLE = "CSV table"


class ReadOptions(NamedTuple):
    """columns: what a CSV table calls its columns. system: MAVLink system id to read.

    servo: the steering servo, or only its scale.
    variation [rad], east positive: of magnetic compasses in NMEA sentences.
    """

    columns: Mapping[str, str] | None = None
    system: int | None = None
    servo: Servo | ServoScale | None = None
    variation: float | None = None


def read_recording(path: str, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the recording in a log of any kind. Raises InputError where the file cannot be used."""
    data = bytes_of(path)
    match kind_of(path, data):
        case Kind.DATAFLASH:
            return read_dataflash(path, data, options.servo)
        case Kind.OWN:
            return read_own(path)
        case Kind.TLOG:
            return read_tlog(path, data, options.system, options.servo)
        case Kind.ULOG:
            return read_ulog(path, data, options.servo)
        case Kind.NMEA:
            return read_nmea(path, data, options.variation)
        case Kind.TABLE:
            return _read_table(path, options.columns)


def kind_of(path: str, data: bytes) -> Kind:
    """Return what a file is, by its content. Raises InputError where that is nothing known here."""
    if data.startswith(HEAD):
        return Kind.DATAFLASH
    if is_tlog(data):
        return Kind.OWN if is_own(data) else Kind.TLOG
    if data.startswith(ULOG):
        return Kind.ULOG
    if data.startswith(b"FMT, 128"):
        raise InputError(f"{path}: is a DataFlash log turned into text; give the .BIN that it was made from.")
    _check_promise(path)
    for beginning, name in PACKED.items():
        if data.startswith(beginning):
            raise InputError(f"{path}: is packed ({name}); unpack it first.")
    if data[:1] in (bytes([MAGIC_V1]), bytes([MAGIC_V2])):
        raise InputError(f"{path}: is a MAVLink stream without time stamps; record it as .tlog.")
    if b"\0" in data[:4096]:
        raise InputError(f"{path}: is no log of a kind known here, or its beginning is lost; readable are {KINDS}.")
    return Kind.NMEA if is_nmea_text(data) else Kind.TABLE


def _check_promise(path: str) -> None:
    """Raise InputError where a name promises a kind that the content has turned out not to be."""
    match Path(path).suffix.lower():
        case ".tlog":
            raise InputError(f"{path}: no MAVLink packet at byte 8: this is not a .tlog, or it is damaged there")
        case ".bin":
            raise InputError(f"{path}: does not begin with a DataFlash message (A3 95): this is no .BIN of ArduPilot")
        case ".ulg":
            raise InputError(f"{path}: does not begin as a PX4 log does: this is no .ulg, or it is damaged there")


def is_tlog(data: bytes) -> bool:
    """Return whether a file begins as a .tlog does: eight bytes of time, then a MAVLink packet."""
    return len(data) > 8 and data[8] in (MAGIC_V1, MAGIC_V2) and data[0] == 0


def _read_table(path: str, column_map: Mapping[str, str] | None) -> Recording:
    columns, notes = read_csv(path, column_map, (("time_s",),))
    time = columns.pop("time_s")
    series = [s for name, values in columns.items() for s in series_of(name, "table", time, values)]
    return on_one_clock(Recording(path, "CSV table", tuple(series), None, notes))


def bytes_of(path: str) -> bytes:
    try:
        data = read_regular(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give a log that exists and can be read") from error
    if not data:
        raise InputError(f"{path}: is empty; a log is needed: {KINDS}.")
    return data
