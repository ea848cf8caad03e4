"""Parameter files of ground stations: Mission Planner, MAVProxy, ArduPilot and QGroundControl, read and written.

`.param` and `.parm` hold a name and a value a line, with a comma (Mission Planner) or blanks (MAVProxy) between;
`#` begins a comment. Sources: Mission Planner's ParamFile.cs, pymavlink's mavparm.py. `.params` holds vehicle id,
component id, name, value and MAV_PARAM_TYPE with tabs between. Source: QGroundControl's ParameterManager.cc.

A parameter file of any kind: a vessel or firmware file, distinguished by its keys, or a ground station's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.files.strict_yaml import text_of
from autopilot.firmware.file import (
    NAME_LENGTH_MAX,
    FirmwareFile,
    Heading,
    Number,
    TypedValue,
    Wanted,
    entries,
    firmware_document,
    firmware_from,
    implied_kind,
    shipped_firmware,
    wanted_parameters,
)
from autopilot.firmware.protocol import as_float32, encode, is_integer_type, kind_named, type_name
from autopilot.firmware.session import NORRBIN
from autopilot.vessel.file import vessel_document, vessel_from
from autopilot.vessel.parameters import parameters_of, value_of
from autopilot.vessel.schema import RESTART, Vessel

SUFFIXES = (".param", ".parm", ".params")

_NAME = re.compile(r"[A-Z_][A-Z0-9_]*")
_INTEGER = re.compile(r"[-+]?[0-9]+")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")

_STACKS = {"ardupilot": "ardurover", "px4 pro": "px4", "px4": "px4"}


class ForeignFile(NamedTuple):
    """What such a file holds; `firmware` is what a QGroundControl file says of its stack, empty elsewhere."""

    values: list[TypedValue]
    firmware: str = ""
    system: int | None = None
    left_out: int = 0
    """How many parameters of other components (a camera, a gimbal) the file has besides."""


def is_foreign(path: str | Path) -> bool:
    """Return whether the name of a file is that of a ground station's parameter file."""
    return Path(path).suffix.lower() in SUFFIXES


def read_foreign(path: str | Path) -> ForeignFile:
    """Return the parameters in the file at `path`; raises InputError with file and line for what cannot be used."""
    return parse_foreign(text_of(path), str(path))


def parse_foreign(text: str, file: str) -> ForeignFile:
    """Return the parameters in `text`, in the format that the suffix of `file` says. Raises InputError."""
    is_qgc = Path(file).suffix.lower() == ".params"
    values: dict[str, TypedValue] = {}
    places: dict[str, int] = {}
    systems: set[int] = set()
    left_out = 0
    for number, line in _lines(text):
        place = f"{file}, line {number}"
        if is_qgc:
            each, system, component = _qgc_line(line, place)
            systems.add(system)
            if component != 1:
                left_out += 1
                continue
        else:
            each = _plain_line(line, place)
        if each.name in values:
            raise InputError(f"{place}: {each.name} is given twice, first on line {places[each.name]}; keep one.")
        values[each.name], places[each.name] = each, number
    if not values:
        raise InputError(
            f"{file}: holds no parameter; a line is {'five fields with tabs' if is_qgc else 'NAME,VALUE'}."
        )
    if len(systems) > 1:
        several = ", ".join(map(str, sorted(systems)))
        raise InputError(f"{file}: holds parameters of several vehicles ({several}); keep those of one.")
    return ForeignFile(list(values.values()), _stack(text) if is_qgc else "", next(iter(systems), None), left_out)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.split("#", 1)[0].strip()
        if content:
            yield number, content


def _plain_line(line: str, place: str) -> TypedValue:
    if line.startswith("@"):
        raise InputError(f"{place}: {line.split()[0]} is not followed; put the lines of that file here.")
    fields = line.replace(",", " ").split()
    if len(fields) != 2:
        raise InputError(f"{place}: '{_short(line)}' has {len(fields)} fields; allowed is NAME,VALUE or NAME VALUE.")
    return TypedValue(_name(fields[0], place), _number(fields[1], place))


def _qgc_line(line: str, place: str) -> tuple[TypedValue, int, int]:
    fields = line.split("\t") if "\t" in line else line.split()
    if len(fields) != 5:
        raise InputError(
            f"{place}: '{_short(line)}' has {len(fields)} fields; allowed are five with tabs: vehicle id, component "
            "id, name, value, type."
        )
    if not all(field.isascii() and field.isdigit() and len(field) < 4 for field in (fields[0], fields[1], fields[4])):
        raise InputError(f"{place}: the ids and the type are whole numbers, this line has '{_short(line)}'.")
    system, component, kind = int(fields[0]), int(fields[1]), int(fields[4])
    if not is_integer_type(kind) and kind != implied_kind(0.0):
        raise InputError(f"{place}: the type {kind} cannot be used; allowed are 1 to 6 (integers) and 9 (REAL32).")
    name = _name(fields[2], place)
    value = _number(fields[3], place)
    if is_integer_type(kind):
        try:
            encode(value, kind, bytewise=True)
        except ValueError:
            raise InputError(f"{place}: {name} is {fields[3]}, which its type {type_name(kind)} cannot hold.") from None
        return TypedValue(name, int(value), kind), system, component
    return TypedValue(name, float(value), kind), system, component


def _name(text: str, place: str) -> str:
    if not _NAME.fullmatch(text) or len(text) > NAME_LENGTH_MAX:
        raise InputError(
            f"{place}: '{_short(text)}' is not a parameter's name: at most {NAME_LENGTH_MAX} capital letters, digits "
            "and _, no digit first."
        )
    return text


def _number(text: str, place: str) -> Number:
    if _INTEGER.fullmatch(text) and len(text) <= 20:
        return int(text)
    if _HEXADECIMAL.fullmatch(text) and len(text) <= 20:
        return int(text, 16)
    value = float(text) if _FLOAT.fullmatch(text) and len(text) <= 60 else math.nan
    if not math.isfinite(as_float32(value)):
        raise InputError(f"{place}: '{_short(text)}' is not a number that a 32-bit float holds.")
    return value


def _short(text: str) -> str:
    return " ".join(text.split()) if len(text) <= 40 else " ".join(text[:37].split()) + "..."


def _stack(text: str) -> str:
    found = re.search(r"^#\s*Stack:\s*(.+?)\s*$", text, re.MULTILINE)
    return _STACKS.get(found[1].casefold(), "") if found else ""


def float_text(value: Number) -> str:
    """Return the shortest decimal text that reads back as the same 32-bit float, or the whole number itself."""
    if isinstance(value, int):
        return str(value)
    wanted = as_float32(value)
    return next(repr(near) for digits in (6, 7, 8, 9) if as_float32(near := float(f"{value:.{digits}g}")) == wanted)


def _mission_planner(values: list[TypedValue], heading: Heading, system: int) -> str:
    note = " ".join(f"{heading.date} {heading.description}".split())
    return "\n".join([f"#NOTE: {note}", *(f"{name},{float_text(value)}" for name, value, _ in values)]) + "\n"


def _mavproxy(values: list[TypedValue], heading: Heading, system: int) -> str:
    return "".join(f"{name:<16} {float_text(value)}\n" for name, value, _ in values)


def _qgroundcontrol(values: list[TypedValue], heading: Heading, system: int) -> str:
    stack = "PX4 Pro" if heading.firmware == "px4" else "ArduPilot"
    lines = [f"# Onboard parameters for Vehicle {system}", "#", f"# Stack: {stack}", "# Vehicle: Boat", "#"]
    lines.append("# Vehicle-Id Component-Id Name Value Type")
    for name, value, kind in values:
        kind = implied_kind(value) if kind is None else kind
        text = str(int(value)) if is_integer_type(kind) else float_text(float(value))
        lines.append(f"{system}\t1\t{name}\t{text}\t{kind}")
    return "\n".join(lines) + "\n"


Writer = Callable[[list[TypedValue], Heading, int], str]

WRITERS: Mapping[str, Writer] = {".param": _mission_planner, ".parm": _mavproxy, ".params": _qgroundcontrol}


def dump_foreign(path: str | Path, values: Iterable[TypedValue], heading: Heading, system: int = 1) -> str:
    """Return the text of the ground station's file that the suffix of `path` names, sorted by name."""
    return WRITERS[Path(path).suffix.lower()](sorted(values), heading, system)


REAL32 = kind_named("REAL32")
FIRMWARE_KEYS = frozenset({"firmware", "groups", "frame", "include"})


class ParameterFile(NamedTuple):
    """What a file asks of a flight controller; `firmware` is empty where the file does not say which. is_counted: the
    file says how many parameters it was written with, and has them."""

    wanted: list[Wanted]
    values: list[TypedValue]
    firmware: str = ""
    frame: str = "boat"
    left_out: int = 0
    is_counted: bool = False


def load_any(path_or_name: str | Path) -> Vessel | FirmwareFile:
    """Return the vessel or firmware file at a path, or the shipped one of that name. Raises InputError."""
    name = str(path_or_name)
    if name in shipped_firmware() and not Path(name).exists():
        return firmware_from(firmware_document(name))
    root = vessel_document(path_or_name, also_shipped=tuple(shipped_firmware()))
    if not isinstance(root.value, dict):
        raise root.fault("a parameter file holds keys and values, this one does not.")
    if FIRMWARE_KEYS & root.value.keys():
        return firmware_from(root)
    return vessel_from(root)


def load_parameters(path_or_name: str | Path, *, vessel_too: bool = False) -> ParameterFile:
    """Return what a firmware file or a ground station's file asks for. Raises InputError.

    A vessel file is the parameters of a running Norrbin, where `vessel_too` says that one may be meant.
    """
    if is_foreign(path_or_name):
        foreign = read_foreign(path_or_name)
        wanted = [Wanted((each.name,), each.value) for each in foreign.values]
        return ParameterFile(wanted, foreign.values, foreign.firmware, left_out=foreign.left_out)
    content = load_any(path_or_name)
    if isinstance(content, Vessel) and vessel_too:
        return _of_vessel(content)
    if isinstance(content, Vessel):
        raise InputError(
            f"{path_or_name} is a vessel file, which Norrbin reads itself (autopilot run {path_or_name}); a firmware "
            "file or a ground station's .param, .parm or .params file is needed."
        )
    values = [
        TypedValue(name, entry.value, None if entry.type is None else kind_named(entry.type))
        for _, name, entry in entries(content)
    ]
    return ParameterFile(
        wanted_parameters(content), values, content.firmware, content.frame, is_counted=content.count is not None
    )


def _of_vessel(vessel: Vessel) -> ParameterFile:
    table = [(parameter, value_of(vessel, parameter)) for parameter in parameters_of(vessel)]
    wanted = [
        Wanted((each.name,), value, reboot=each.counts is RESTART, allowed=f"; documented are {each.allowed}")
        for each, value in table
    ]
    return ParameterFile(wanted, [TypedValue(each.name, value, REAL32) for each, value in table], NORRBIN)
