"""Messages of the MAVLink standard that pymavlink's ArduPilot dialect does not have, in the form of its own classes.

A class tells its id and its fields as https://mavlink.io/en/messages/common.html and development.html list them; the
order on the wire (wide types first) and CRC_EXTRA follow from names and types by the rules of
https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import re
import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

MODE_NAME_LENGTH = 35
LETTERS = {"uint32_t": "I", "uint16_t": "H", "uint8_t": "B", "char": "s"}
FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")
"""`uint8_t name` or `char[35] name`."""


class _ExtraMessage(dialect.MAVLink_message):
    """What pymavlink's generated classes have in common. Values come in the order of the fields, texts as bytes."""

    id: ClassVar[int]
    msgname: ClassVar[str]
    fieldnames: ClassVar[list[str]]
    ordered_fieldnames: ClassVar[list[str]]
    fieldtypes: ClassVar[list[str]]
    array_lengths: ClassVar[list[int]]
    crc_extra: ClassVar[int]
    unpacker: ClassVar[struct.Struct]
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    instance_field = None
    instance_offset = -1

    def __init_subclass__(cls, identity: int, fields: str) -> None:
        given = [(kind, int(length or 0), name) for kind, length, name in FIELD.findall(fields)]
        wire = sorted(given, key=lambda field: -struct.calcsize(LETTERS[field[0]]))
        cls.id = identity
        cls.msgname = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).upper()
        cls.fieldtypes, cls.fieldnames = [kind for kind, _, _ in given], [name for _, _, name in given]
        cls.array_lengths, cls.ordered_fieldnames = [length for _, length, _ in wire], [name for _, _, name in wire]
        cls.unpacker = struct.Struct("<" + "".join(f"{length or ''}{LETTERS[kind]}" for kind, length, _ in wire))
        layout = b"".join(f"{kind} {name} ".encode() + bytes([length] * (length > 0)) for kind, length, name in wire)
        crc = int(dialect.x25crc(f"{cls.msgname} ".encode() + layout).crc)
        cls.crc_extra = (crc & 0xFF) ^ (crc >> 8)

    def __init__(self, *values: Any) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field = self.instance_field
        self._instance_offset = self.instance_offset
        for name, value in zip(self.fieldnames, values, strict=True):
            setattr(self, name, value)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the packet."""
        payload = self.unpacker.pack(*(getattr(self, name) for name in self.ordered_fieldnames))
        packet: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return packet


class CommandCancel(
    _ExtraMessage, identity=80, fields="uint8_t target_system, uint8_t target_component, uint16_t command"
):
    """Cancel a command that is being carried out."""


class AvailableModes(
    _ExtraMessage,
    identity=435,
    fields="uint8_t number_modes, uint8_t mode_index, uint8_t standard_mode, uint32_t custom_mode, "
    f"uint32_t properties, char[{MODE_NAME_LENGTH}] mode_name",
):
    """One of the modes there are."""


class CurrentMode(
    _ExtraMessage, identity=436, fields="uint8_t standard_mode, uint32_t custom_mode, uint32_t intended_custom_mode"
):
    """The mode that is, and the one that was last asked for."""


class ComponentMetadata(_ExtraMessage, identity=397, fields="uint32_t time_boot_ms, uint32_t file_crc, char[100] uri"):
    """Where a component's general metadata file is, and its CRC-32."""


class ComponentInformation(
    _ExtraMessage,
    identity=395,
    fields="uint32_t time_boot_ms, uint32_t general_metadata_file_crc, char[100] general_metadata_uri, "
    "uint32_t peripherals_metadata_file_crc, char[100] peripherals_metadata_uri",
):
    """The same as older ground stations ask for it; we have no peripherals."""


KINDS: tuple[type[Any], ...] = (CommandCancel, AvailableModes, CurrentMode, ComponentMetadata, ComponentInformation)
EXTRA_MESSAGES: dict[int, type[Any]] = {kind.id: kind for kind in KINDS}
KNOWN: dict[int, type[Any]] = {**EXTRA_MESSAGES, **dialect.mavlink_map}
"""Every message that can be read, by its id."""
