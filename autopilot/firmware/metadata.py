"""What a vehicle's parameters are: which of them are settings, and what it says of them itself over MAVLink FTP. Pure.

What it says itself is component metadata, read strictly.

Sources: https://mavlink.io/en/services/component_metadata.html; general.schema.json and parameter.schema.json of the
folder component_metadata of mavlink/mavlink; PX4's component_information (the files), mavlink_ftp.cpp and jsonout.py;
QGroundControl's RequestMetaDataTypeStateMachine.cc, FTPManager.cc and CompInfoParam.cc. PX4 serves some 60 kB of .xz,
on boards with little flash only an https address, which is not fetched; older ones know COMPONENT_INFORMATION alone.
ArduPilot answers neither.

Parameters that are not settings: what a firmware moves by itself, what names its devices, what it calibrated.

A file that holds a whole vehicle holds these too. Written back, they would never agree (a counter has gone on),
describe another board (device ids), undo a calibration, or erase the vehicle (FORMAT_VERSION).

PX4 serves metadata that mark what it moves by itself and what is read only: `Marks`, which `MetadataDownload` fetches.
ArduPilot marks them in the metadata of its sources, which no vehicle sends: `@ReadOnly`, `@Volatile`, `@Calibration`
and AP_PARAM_FLAG_INTERNAL_USE_ONLY in AP_Stats, AP_Baro, AP_Mission, AP_InertialSensor, AP_Compass, AP_Airspeed
(apm.pdef of Rover 4.5 and 4.6). FORMAT_VERSION is unmarked there: Rover erases every parameter at the next boot where
it is not the firmware's own. PX4 keeps calibration in CAL_ and TC_. RULES is all of that in one table.
"""

from __future__ import annotations

import itertools
import lzma
import math
import re
from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.files.printable import printable
from autopilot.firmware.file import Wanted
from autopilot.firmware.protocol import Target, is_from
from autopilot.firmware.session import FtpClient
from autopilot.links.ground_station.file_server import DATA_MAX, PARAMETER_TYPE, checksum
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.frames import ComponentInformation, ComponentMetadata

NUMBER = re.compile(r"([0-9]+)")


class Kept(StrEnum):
    """Why a parameter is left to the firmware."""

    FORMAT = "erases the vehicle's parameters"
    STATE = "moves by itself"
    READ_ONLY = "read only"
    DEVICE = "names a device of the board"
    CALIBRATION = "calibration"


RULES: dict[str, tuple[tuple[Kept, str], ...]] = {
    "ardurover": (
        (Kept.FORMAT, r"FORMAT_VERSION|SYSID_SW_(MREV|TYPE)"),
        (Kept.STATE, r"STAT_\w+|SYS_NUM_RESETS|LOG_LASTFILE|CMD_(TOTAL|INDEX)|(MIS|FENCE|RALLY)_TOTAL"),
        (Kept.STATE, r"BARO\d?_GND_(PRESS|TEMP)|BARO_ALT_OFFSET|GND_(ABS_PRESS\d?|TEMP|ALT_OFFSET)"),
        (Kept.DEVICE, r"\w+_DEV_?ID\d?|INS\d?_(ACC|GYR)\d?_ID|COMPASS_PRIO\d_ID|GPS\d?_CAN_NODEID\d?"),
        (Kept.CALIBRATION, r"INS\d?_(ACC|GYRO?)\d?(OFFS|SCAL)_[XYZ]|INS\d?_(ACC|GYR)\d?_CALTEMP"),
        (Kept.CALIBRATION, r"INS_?\w*TCAL\d?_(TMIN|TMAX|(ACC|GYR)\d_[XYZ])"),
        (Kept.CALIBRATION, r"COMPASS\d?_?(OFS|DIA|ODI|MOT)\d?_[XYZ]|COMPASS_SCALE\d?|COMPASS_PMOT\d_[XYZ]"),
        (Kept.CALIBRATION, r"AHRS_TRIM_[XYZ]|ARSPD\d?_(OFFSET|RATIO)"),
    ),
    "px4": (
        (Kept.FORMAT, r"SYS_PARAM_VER|SYS_AUTOCONFIG"),
        (Kept.STATE, r"LND_FLIGHT_T_(HI|LO)|COM_FLIGHT_UUID|EKF2_MAGBIAS_[XYZ]|_HASH_CHECK"),
        (Kept.DEVICE, r"(CAL|TC)_\w+_ID"),
        (Kept.CALIBRATION, r"CAL_\w+|TC_\w+|SENS_BOARD_[XYZ]_OFF|SENS_DPRES_OFF"),
    ),
}
"""By firmware: the first row whose expression is the whole name counts. Norrbin's own parameters are all settings."""

_COMPILED = {
    firmware: tuple((kept, re.compile(expression)) for kept, expression in rows) for firmware, rows in RULES.items()
}


class Marks(NamedTuple):
    """What the vehicle itself says is `volatile` or `read_only`; FOO{n}_BAR there stands for FOO1_BAR and so on."""

    volatile: frozenset[str] = frozenset()
    read_only: frozenset[str] = frozenset()


NO_MARKS = Marks()


def kept_by_firmware(firmware: str, name: str, marks: Marks = NO_MARKS) -> Kept | None:
    """Return why parameter `name` is left to the firmware, None where it is a setting.

    The table goes before the mark: PX4 marks calibration as volatile, which `--with-calibration` writes all the same.
    """
    rows = _COMPILED.get(firmware, ())
    by_table = next((kept for kept, expression in rows if expression.fullmatch(name)), None)
    if by_table not in (None, Kept.CALIBRATION):
        return by_table
    if _is_among(marks.read_only, name):
        return Kept.READ_ONLY
    return Kept.STATE if by_table is None and _is_among(marks.volatile, name) else by_table


def _is_among(names: frozenset[str], name: str) -> bool:
    if not names or name in names:
        return name in names
    parts = [(part, "{n}") if part.isdigit() else (part,) for part in NUMBER.split(name)]
    return any("".join(spelling) in names for spelling in itertools.product(*parts))


class LeftOut(NamedTuple):
    """A parameter of a file that is not written, and why."""

    name: str
    why: Kept


def settings_of(
    wanted: Iterable[Wanted], firmware: str, *, calibration: bool = False, marks: Marks = NO_MARKS
) -> tuple[list[Wanted], list[LeftOut]]:
    """Return what of a file is to be written, and what is left to the firmware.

    calibration: calibration is written too; device ids never are, a board finds its own.
    """
    settings: list[Wanted] = []
    left: list[LeftOut] = []
    for each in wanted:
        kept = next(filter(None, (kept_by_firmware(firmware, name, marks) for name in each.names)), None)
        if kept is None or (calibration and kept is Kept.CALIBRATION):
            settings.append(each)
        else:
            left.append(LeftOut(each.name, kept))
    return settings, left


NAMED_MAX = 3
"""So many names of a kind are said."""


def sentence_of(left: Sequence[LeftOut]) -> str:
    """Return one line that says what was left out and why, '' where nothing was."""
    if not left:
        return ""
    parts = []
    for kept in Kept:
        names = [each.name for each in left if each.why is kept]
        if names:
            more = f" and {len(names) - NAMED_MAX} more" if len(names) > NAMED_MAX else ""
            parts.append(f"{kept} ({', '.join(names[:NAMED_MAX])}{more})")
    hint = ""
    if any(each.why is Kept.CALIBRATION for each in left):
        hint = "; --with-calibration writes calibration too"
    return f"{len(left)} left to the firmware: {', '.join(parts)}{hint}"


FIELDS = {ComponentMetadata.id: "uri", ComponentInformation.id: "general_metadata_uri"}
"""The messages that say where the general file is, as they are asked for in turn, and the field that says it."""
COMMAND = dialect.MAV_CMD_REQUEST_MESSAGE
ASKED_AGAIN_S = 0.2
WAIT_S = 0.4
"""So long is waited for the answer of a vehicle that is not known to give one."""
PX4_WAIT_S = 2.0
FETCH_MOST_S = 40.0
"""So long at most both files may take; QGroundControl allows each as much."""
FORECAST_S = 5.0
"""After this a file that would not be there in time is given up."""
UNDER_WAY = (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS)
XZ = b"\xfd7zXZ\0"
EXPANDED_MOST = 8_000_000
MEMORY_MOST = 100 << 20
"""What PX4 packs (preset 9) takes 65 MiB to expand."""
VERSIONS = (1, 2, 3)
"""Of both files; the keys read here mean the same in all."""
NAME = re.compile(r"[.\-A-Za-z0-9_{}]{1,16}")
URI = re.compile(r"mftp://(?:/?\[;comp=([0-9]{1,3})\])?/*([!-~]+)", re.IGNORECASE)
CRC_MOST = 0xFFFFFFFF


class MetadataDownload:
    """Fetches what the vehicle says of its parameters: a `Client` of `ParameterSession`.

    Attributes:
        marks: what it says; nothing where it says nothing that is usable.
        trouble: why what it offers is not usable; '' where it is, and where it offers nothing.
        is_offered: whether it offers anything.
    """

    def __init__(self, target: Target, wait_s: float = WAIT_S) -> None:
        self._target = target
        self._wait_s = wait_s
        self._to_ask = list(FIELDS)
        self._files = FtpClient()
        self._next = -math.inf
        self._until: float | None = None
        self._fetched_until: float | None = None
        self._began = 0.0
        self._crc: int | None = None
        self.marks: Marks = NO_MARKS
        self.trouble = ""
        self.is_offered = False

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        return not self._to_ask and self._files.is_idle

    @property
    def progress(self) -> tuple[int, int]:
        """Bytes of the present file that have come, of how many."""
        return self._files.progress

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's are ignored."""
        if not is_from(message, self._target):
            return
        kind = message.get_type()
        if kind == "FILE_TRANSFER_PROTOCOL":
            self._files.receive(now, message)
        elif not self._to_ask:
            return
        elif kind in (ComponentMetadata.msgname, ComponentInformation.msgname):
            uri: bytes = getattr(message, FIELDS[message.id])
            self._to_ask.clear()
            self.is_offered = True
            self._fetch(uri.split(b"\0")[0].decode("ascii", "replace"), self._take_general)
        elif kind == "COMMAND_ACK" and message.command == COMMAND and message.result not in UNDER_WAY:
            self._to_ask.pop(0)
            self._next = -math.inf

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        if self._to_ask:
            return self._question(now)
        if not self._files.is_idle and not self.trouble:
            self._look_at_time(now)
        return self._files.due(now, self._target)

    def _question(self, now: float) -> list[Message]:
        if self._until is None:
            self._until = now + self._wait_s
        if now >= self._until:
            self._to_ask.clear()
            return []
        if now < self._next:
            return []
        self._next = now + ASKED_AGAIN_S
        system, component, _ = self._target
        wanted = self._to_ask[0]
        return [dialect.MAVLink_command_long_message(system, component, COMMAND, 0, wanted, 0, 0, 0, 0, 0, 0)]

    def _look_at_time(self, now: float) -> None:
        done, size = self.progress
        if self._fetched_until is None:
            self._fetched_until = now + FETCH_MOST_S
        if size == 0:  # no file is open: the clock of the next one has not begun
            self._began = now
        passed = now - self._began
        if now > self._fetched_until or (passed > FORECAST_S and done * FETCH_MOST_S < size * passed):
            self._files.abandon()
            self.trouble = f"its metadata take more than {FETCH_MOST_S:g} s on this link"

    def _fetch(self, uri: str, take: Callable[[bytes], None]) -> None:
        def got(content: bytes | None) -> None:
            try:
                if content is None:
                    raise InputError(f"its file {path} does not come")
                take(content)
            except InputError as error:
                self.trouble = str(error)

        try:
            path = _path(uri, self._target)
        except InputError as error:
            self.trouble = str(error)
        else:
            self._files.fetch(path, got)

    def _take_general(self, content: bytes) -> None:
        uri, self._crc = _parameters_file(content)
        self._fetch(uri, self._take_parameters)

    def _take_parameters(self, content: bytes) -> None:
        self.marks = _marks(content, self._crc)
        self._fetched_until = math.inf  # what is left is to close the file


def _path(uri: str, target: Target) -> str:
    """Return the path that a URI of MAVLink FTP names; InputError where it is another, or of another component."""
    found = URI.fullmatch(uri)
    if found is None or len(found[2]) >= DATA_MAX:
        raise InputError(f"its address {printable(uri)} is none of MAVLink FTP, and nothing else is fetched")
    if found[1] and int(found[1]) != target.component:
        raise InputError(f"its address {printable(uri)} is another component's")
    return f"/{found[2]}"


def _parameters_file(content: bytes) -> tuple[str, int | None]:
    """Return address and CRC-32 of the parameters' file that the general file names. Raises InputError."""
    entries = _list_in(_document(content, None), "metadataTypes")
    found = [each for each in entries if type(each.get("type")) is int and each["type"] == PARAMETER_TYPE]
    if not found:
        raise InputError("it does not describe parameters")
    places = [(found[0].get(f"uri{which}"), found[0].get(f"fileCrc{which}")) for which in ("", "Fallback")]
    uri, crc = next((place for place in places if str(place[0]).lower().startswith("mftp://")), places[0])
    if not (crc is None or (type(crc) is int and 0 <= crc <= CRC_MOST)):
        raise InputError(f"fileCrc {printable(crc)}: a whole number from 0 to {CRC_MOST} is allowed")
    return str(uri), crc


def _marks(content: bytes, crc: int | None) -> Marks:
    """Return what the parameters' file marks. Raises InputError."""
    marked: dict[str, set[str]] = {"volatile": set(), "readOnly": set()}
    for entry in _list_in(_document(content, crc), "parameters"):
        name = entry.get("name")
        if not (isinstance(name, str) and NAME.fullmatch(name)):
            raise InputError(f"{printable(name)} is no name of a parameter")
        for key, names in marked.items():
            mark = entry.get(key, False)
            if not isinstance(mark, bool):
                raise InputError(f"{name}: {key} {printable(mark)}: true or false is allowed")
            if mark:
                names.add(name)
    return Marks(frozenset(marked["volatile"]), frozenset(marked["readOnly"]))


def _document(content: bytes, crc: int | None) -> dict[str, Any]:
    """Return the object of JSON in a file, which may be packed; `crc` is that of the file as it is, or unpacked."""
    text = expanded(content, "its file", EXPANDED_MOST, MEMORY_MOST) if content.startswith(XZ) else content
    if crc not in (None, checksum(content), checksum(text)):
        raise InputError(f"its file is damaged: the checksum is {checksum(content)} and was to be {crc}")
    document = parse_json(text, "its file", EXPANDED_MOST)
    if not isinstance(document, dict):
        raise InputError("its file is no object of JSON")
    version = document.get("version")
    if type(version) is not int or version not in VERSIONS:
        raise InputError(f"its file is of version {printable(version)}; 1 to {VERSIONS[-1]} are known")
    return document


def expanded(content: bytes, origin: str, most: int, memory: int) -> bytes:
    """Return what a vehicle has packed (xz): at most so many bytes of it, in at most so many bytes of memory.

    Raises InputError, which calls the file `origin`.
    """
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, memory)
    try:
        text = decompressor.decompress(content, most)
    except lzma.LZMAError as error:
        raise InputError(f"{origin} is damaged ({error})") from None
    if not decompressor.eof:
        raise InputError(f"{origin} is cut off, or more than {most} bytes when expanded")
    return text


def _list_in(document: dict[str, Any], key: str) -> list[dict[str, Any]]:
    entries = document.get(key)
    if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
        raise InputError(f"{key!r} in its file is no list of objects")
    return entries
