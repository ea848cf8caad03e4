"""The alarms that are on, as a file for ground stations: STATUSTEXT tells when an alarm begins, never when it ends."""

from __future__ import annotations

import json
from collections.abc import Sequence

ALARMS = "/alarms.json"
"""A list of texts, over MAVLink FTP; to be read again when the value `alarms`, their number, changes."""


def alarm_list(alarms: Sequence[str]) -> bytes:
    """Return the file."""
    return json.dumps(list(alarms), ensure_ascii=False, separators=(",", ":")).encode()
