"""What a ground station reads about our parameters: component metadata, JSON files that it fetches over MAVLink FTP.

Source: https://mavlink.io/en/services/component_information.html with general.schema.json and parameter.schema.json
of the folder component_metadata of the repository mavlink/mavlink. QGroundControl takes parameter files of version 1
(CompInfoParam.cc), which is also what PX4 sends.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Sequence
from typing import Any

from autopilot.links.boat.file_server import checksum
from autopilot.links.boat.metadata import GENERAL
from autopilot.params.vessel_parameters import VesselParameter

PARAMETERS = "/parameters.json.xz"
PARAMETER_TYPE = 1
"""COMP_METADATA_TYPE_PARAMETER."""
GROUPS = {
    "model": "Model",
    "rudder": "Rudder",
    "sensors": "Sensors",
    "control": "Control",
    "control.backstepping": "Backstepping law",
    "control.sliding": "Sliding law",
    "control.sliding_roll": "Sliding law for heading and roll",
    "control.sliding_roll.quiet": "Sliding law for heading and roll: quiet",
    "estimator": "Estimator",
    "control.pid": "PID law",
    "guidance": "Guidance",
    "limits": "Limits",
    "failsafe": "Fail-safe",
    "helm": "Helm",
    "drive": "Rudder drive",
}


def metadata_files(parameters: Sequence[VesselParameter], version: str) -> dict[str, bytes]:
    """Return the metadata files by path.

    Args:
        parameters: what is described.  version: ours, such as "0.2.0".
    """
    table = {"version": 1, "parameters": [_described(parameter) for parameter in parameters]}
    # a ground station that asks for metadata must be able to expand .xz, and a radio is slow
    packed = lzma.compress(_json(table), format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32)
    numbers = version.split(".")[:3]
    general: dict[str, Any] = {
        "version": 1,
        "vendorName": "Norrbin",
        "modelName": "Norrbin autopilot",
        "metadataTypes": [{"type": PARAMETER_TYPE, "uri": f"mftp://{PARAMETERS}", "fileCrc": checksum(packed)}],
    }
    if len(numbers) == 3 and all(number.isdecimal() for number in numbers):
        general["firmwareVersion"] = ".".join(numbers)
    return {GENERAL: _json(general), PARAMETERS: packed}


def _described(parameter: VesselParameter) -> dict[str, Any]:
    section, _, _ = parameter.path.rpartition(".")
    allowed = f" Allowed: {parameter.allowed}." if parameter.low is not None else ""
    entry: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": parameter.doc,
        "longDesc": f"{parameter.doc} ({parameter.path} of the vessel file).{allowed}",
        "group": GROUPS.get(section, section),
    }
    if parameter.unit:
        entry["units"] = parameter.unit
    if parameter.low is not None:
        entry["min"] = parameter.low
    if parameter.high is not None:
        entry["max"] = parameter.high
    if parameter.choices:
        entry["values"] = [{"value": number, "description": word} for number, word in enumerate(parameter.choices)]
    if parameter.choices or parameter.is_whole:
        entry["decimalPlaces"] = 0
    if parameter.waits:
        entry["rebootRequired"] = True
    return entry


def _json(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
