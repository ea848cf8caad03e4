"""Messages of the MAVLink standard that pymavlink's ArduPilot dialect does not have, in its own form.

Ids, fields and CRC_EXTRA as in https://mavlink.io/en/messages/common.html and development.html; the CRC_EXTRA is worked
out from names and types by the rule of https://mavlink.io/en/guide/serialization.html#crc_extra.
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

MODE_NAME_LENGTH = 35


class _ExtraMessage(dialect.MAVLink_message):
    """What pymavlink's generated classes have in common."""

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


class CommandCancel(_ExtraMessage):
    """Cancel a command that is being carried out."""

    id = 80
    msgname = "COMMAND_CANCEL"
    fieldnames: ClassVar = ["target_system", "target_component", "command"]
    ordered_fieldnames: ClassVar = ["command", "target_system", "target_component"]
    fieldtypes: ClassVar = ["uint8_t", "uint8_t", "uint16_t"]
    array_lengths: ClassVar = [0, 0, 0]
    crc_extra = 14
    unpacker = struct.Struct("<HBB")


class AvailableModes(_ExtraMessage):
    """One of the modes there are; `mode_name` as bytes."""

    id = 435
    msgname = "AVAILABLE_MODES"
    fieldnames: ClassVar = ["number_modes", "mode_index", "standard_mode", "custom_mode", "properties", "mode_name"]
    ordered_fieldnames: ClassVar = [
        "custom_mode",
        "properties",
        "number_modes",
        "mode_index",
        "standard_mode",
        "mode_name",
    ]
    fieldtypes: ClassVar = ["uint8_t", "uint8_t", "uint8_t", "uint32_t", "uint32_t", "char"]
    array_lengths: ClassVar = [0, 0, 0, 0, 0, MODE_NAME_LENGTH]
    crc_extra = 134
    unpacker = struct.Struct(f"<IIBBB{MODE_NAME_LENGTH}s")


class CurrentMode(_ExtraMessage):
    """The mode that is, and the one that was last asked for."""

    id = 436
    msgname = "CURRENT_MODE"
    fieldnames: ClassVar = ["standard_mode", "custom_mode", "intended_custom_mode"]
    ordered_fieldnames: ClassVar = ["custom_mode", "intended_custom_mode", "standard_mode"]
    fieldtypes: ClassVar = ["uint8_t", "uint32_t", "uint32_t"]
    array_lengths: ClassVar = [0, 0, 0]
    crc_extra = 193
    unpacker = struct.Struct("<IIB")


class ComponentMetadata(_ExtraMessage):
    """Where a component's general metadata file is (`uri` as bytes), and its CRC-32."""

    id = 397
    msgname = "COMPONENT_METADATA"
    fieldnames: ClassVar = ["time_boot_ms", "file_crc", "uri"]
    ordered_fieldnames: ClassVar = ["time_boot_ms", "file_crc", "uri"]
    fieldtypes: ClassVar = ["uint32_t", "uint32_t", "char"]
    array_lengths: ClassVar = [0, 0, 100]
    crc_extra = 182
    unpacker = struct.Struct("<II100s")


class ComponentInformation(_ExtraMessage):
    """The same as older ground stations ask for it; we have no peripherals."""

    id = 395
    msgname = "COMPONENT_INFORMATION"
    fieldnames: ClassVar = [
        "time_boot_ms",
        "general_metadata_file_crc",
        "general_metadata_uri",
        "peripherals_metadata_file_crc",
        "peripherals_metadata_uri",
    ]
    ordered_fieldnames: ClassVar = [
        "time_boot_ms",
        "general_metadata_file_crc",
        "peripherals_metadata_file_crc",
        "general_metadata_uri",
        "peripherals_metadata_uri",
    ]
    fieldtypes: ClassVar = ["uint32_t", "uint32_t", "char", "uint32_t", "char"]
    array_lengths: ClassVar = [0, 0, 0, 100, 100]
    crc_extra = 0
    unpacker = struct.Struct("<III100s100s")


KINDS: tuple[type[Any], ...] = (CommandCancel, AvailableModes, CurrentMode, ComponentMetadata, ComponentInformation)
EXTRA_MESSAGES: dict[int, type[Any]] = {kind.id: kind for kind in KINDS}
