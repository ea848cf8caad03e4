"""A parameter file of either kind, told apart by its keys."""

from __future__ import annotations

from pathlib import Path

from autopilot.params.firmware_file import FirmwareFile, firmware_document, firmware_from, shipped_firmware
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import vessel_document, vessel_from

FIRMWARE_KEYS = frozenset({"firmware", "groups", "frame"})


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
