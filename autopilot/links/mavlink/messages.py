"""How the payloads of messages are read and written: pymavlink's own tables, looked up once for each kind.

Messages of the MAVLink standard that pymavlink's ArduPilot dialect does not have, in its own form.

Ids, fields and CRC_EXTRA as in https://mavlink.io/en/messages/common.html and development.html; the CRC_EXTRA is worked
out from names and types by the rule of https://mavlink.io/en/guide/serialization.html#crc_extra.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

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


PART = re.compile(r"(\d*)([A-Za-z])")
"""One field of a struct's format: how many, of which kind."""
KNOWN: dict[int, type[Any]] = {**EXTRA_MESSAGES, **dialect.mavlink_map}


class Layout(NamedTuple):
    """How the payload of one message is read: pymavlink's own tables, looked up once. Texts of ours come as bytes."""

    kind: type[Any]
    unpack: Callable[[bytes], tuple[float, ...]]
    size: int
    crc_extra: bytes
    names: tuple[str, ...]
    blank: dict[str, Any]


def _layout(kind: type[Any]) -> Layout | None:
    has_arrays = any(kind.array_lengths) or "char" in kind.fieldtypes
    if dialect.mcrf4xx is None or (has_arrays and kind.id not in EXTRA_MESSAGES):
        return None
    blank = dict(vars(kind(*[0] * len(kind.fieldnames))))
    extra = bytes([kind.crc_extra])
    names = tuple(kind.ordered_fieldnames)
    return Layout(kind, kind.unpacker.unpack, kind.unpacker.size, extra, names, blank)


class Writer(NamedTuple):
    """How the payload of one message is written; `values` returns what `pack` takes."""

    pack: Callable[..., bytes]
    values: Callable[[Any], Sequence[Any]]
    crc_extra: bytes


def _writer(kind: type[Any]) -> Writer | None:
    """Return how messages of a kind are written: bytes and texts in one piece. None for arrays of other numbers."""
    if dialect.mcrf4xx is None:
        return None
    shape, names, arrays = "<", [], []
    fields = PART.findall(kind.unpacker.format)
    for place, (name, (count, letter)) in enumerate(zip(kind.ordered_fieldnames, fields, strict=True)):
        if count and letter not in "Bs":
            return None
        if count and letter == "B":
            arrays.append(place)
        shape += f"{count}s" if count else letter
        names.append(f"_{name}_raw" if letter in "cs" else name)
    return Writer(struct.Struct(shape).pack, _values(names, arrays), bytes([kind.crc_extra]))


def _values(names: Sequence[str], arrays: Sequence[int]) -> Callable[[Any], Sequence[Any]]:
    """Return what reads the attributes `names`, those at the places `arrays` as bytes."""
    read = attrgetter(*names) if len(names) > 1 else lambda message: (getattr(message, names[0]),)
    if not arrays:
        return read

    def with_bytes(message: Any) -> list[Any]:
        values = list(read(message))
        for place in arrays:
            values[place] = bytes(values[place])
        return values

    return with_bytes


_writers: dict[type[Any], Writer | None] = {}
_layouts: dict[int, Layout | None] = {}


def writer_of(kind: type[Any]) -> Writer | None:
    """Return how messages of the class `kind` are written; None where that is left to the class itself."""
    try:
        return _writers[kind]
    except KeyError:
        # our own messages, and classes derived from the dialect's, pack their fields in a way of their own
        writer = _writers[kind] = _writer(kind) if dialect.mavlink_map.get(kind.id) is kind else None
        return writer


def layout_of(identity: int) -> Layout | None:
    """Return the layout of the message `identity`; None where it has arrays and pymavlink knows it."""
    try:
        return _layouts[identity]
    except KeyError:
        layout = _layouts[identity] = _layout(KNOWN[identity])
        return layout
