"""What a vehicle itself says of its parameters: component metadata, fetched over MAVLink FTP and read strictly. Pure.

Sources: https://mavlink.io/en/services/component_metadata.html; general.schema.json and parameter.schema.json of the
folder component_metadata of mavlink/mavlink; PX4's component_information (the files), mavlink_ftp.cpp and jsonout.py;
QGroundControl's RequestMetaDataTypeStateMachine.cc, FTPManager.cc and CompInfoParam.cc. PX4 serves some 60 kB of .xz,
on boards with little flash only an https address, which is not fetched; older ones know COMPONENT_INFORMATION alone.
ArduPilot answers neither.
"""

from __future__ import annotations

import lzma
import math
import re
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.boat.file_server import DATA_MAX, checksum
from autopilot.links.extra_messages import ComponentInformation, ComponentMetadata
from autopilot.links.mavlink_codec import Message
from autopilot.params.component_metadata import PARAMETER_TYPE
from autopilot.params.firmware_owned import NO_MARKS, Marks
from autopilot.params.ftp_client import FtpClient
from autopilot.params.protocol import Target, is_from
from autopilot.printable import printable
from autopilot.strict_json import parse_json

FIELDS = {ComponentMetadata.id: "uri", ComponentInformation.id: "general_metadata_uri"}
"""The messages that say where the general file is, as they are asked for in turn, and the field that says it."""
COMMAND = dialect.MAV_CMD_REQUEST_MESSAGE
AGAIN_S = 0.2
WAIT_S = 0.4
"""So long is waited for the answer of a vehicle that is not known to give one."""
PX4_WAIT_S = 2.0
FETCH_MOST_S = 40.0
"""So long at most both files may take; QGroundControl allows each as much."""
FORETOLD_S = 5.0
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
        self._next = now + AGAIN_S
        system, component, _ = self._target
        wanted = self._to_ask[0]
        return [dialect.MAVLink_command_long_message(system, component, COMMAND, 0, wanted, 0, 0, 0, 0, 0, 0)]

    def _look_at_time(self, now: float) -> None:
        """Give up what is not there in time, or will not be."""
        done, size = self.progress
        if self._fetched_until is None:
            self._fetched_until = now + FETCH_MOST_S
        if size == 0:  # no file is open: the clock of the next one has not begun
            self._began = now
        passed = now - self._began
        if now > self._fetched_until or (passed > FORETOLD_S and done * FETCH_MOST_S < size * passed):
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
    text = _expanded(content) if content.startswith(XZ) else content
    if crc not in (None, checksum(content), checksum(text)):
        raise InputError(f"its file is damaged: the checksum is {checksum(content)} and was to be {crc}")
    document = parse_json(text, "its file", EXPANDED_MOST)
    if not isinstance(document, dict):
        raise InputError("its file is no object of JSON")
    version = document.get("version")
    if type(version) is not int or version not in VERSIONS:
        raise InputError(f"its file is of version {printable(version)}; 1 to {VERSIONS[-1]} are known")
    return document


def _expanded(content: bytes) -> bytes:
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, MEMORY_MOST)
    try:
        text = decompressor.decompress(content, EXPANDED_MOST)
    except (lzma.LZMAError, EOFError) as error:
        raise InputError(f"its file is damaged ({error})") from None
    if not decompressor.eof:
        raise InputError(f"its file is cut off, or more than {EXPANDED_MOST} bytes when expanded")
    return text


def _list_in(document: dict[str, Any], key: str) -> list[dict[str, Any]]:
    entries = document.get(key)
    if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
        raise InputError(f"{key!r} in its file is no list of objects")
    return entries
