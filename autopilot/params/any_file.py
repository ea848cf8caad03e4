"""A parameter file of any kind: a vessel or firmware file, told apart by its keys, or a ground station's."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.params.firmware_dump import TypedValue
from autopilot.params.firmware_file import (
    FirmwareFile,
    Wanted,
    entries,
    firmware_document,
    firmware_from,
    shipped_firmware,
    wanted_parameters,
)
from autopilot.params.foreign_files import is_foreign, read_foreign
from autopilot.params.session import NORRBIN
from autopilot.params.value_coding import kind_named
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import vessel_document, vessel_from
from autopilot.params.vessel_parameters import parameters_of, value_of

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
        Wanted((each.name,), value, reboot=each.waits, allowed=f"; documented are {each.allowed}")
        for each, value in table
    ]
    return ParameterFile(wanted, [TypedValue(each.name, value, REAL32) for each, value in table], NORRBIN)
