"""Mission items: which of them a boat can follow, as waypoints, and as the text that ground stations keep. Pure.

The text is the waypoint file of QGroundControl, Mission Planner and MAVProxy ("QGC WPL 110"), one item a line:
index, current, frame, command, parameters 1 to 4, latitude, longitude [deg], altitude, autocontinue, split by tabs.
Source: https://mavlink.io/en/file_formats/#mission_plain_text_file
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.guidance.track import Waypoint

MOST_ITEMS = 500
HOLD_MOST_S = 1.0
"""A boat whose throttle is not ours cannot wait at a waypoint; some senders mean "pass it" by half a second."""
RADIUS_MOST = 5000.0
LATITUDE_MOST_E7 = 850_000_000
LONGITUDE_MOST_E7 = 1_800_000_000
FRAMES = frozenset(
    {
        dialect.MAV_FRAME_GLOBAL,
        dialect.MAV_FRAME_GLOBAL_INT,
        dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    }
)
FIRST_LINE = "QGC WPL 110"
COLUMNS = 12


class MissionItem(NamedTuple):
    """An item as it was uploaded; x and y are latitude and longitude [1e-7 deg], z is an altitude [m], not used."""

    frame: int
    command: int
    parameters: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1

    @property
    def waypoint(self) -> Waypoint:
        """The place it leads to."""
        radius = self.parameters[1]
        return Waypoint(
            math.radians(self.x * 1.0e-7),
            math.radians(self.y * 1.0e-7),
            radius if math.isfinite(radius) and radius > 0.0 else math.nan,
        )


def problem(number: int, item: MissionItem) -> tuple[int, str]:
    """Return the MAV_MISSION_RESULT of an item and, where it is not ACCEPTED, the sentence why."""
    if item.command != dialect.MAV_CMD_NAV_WAYPOINT:
        kind = dialect.enums["MAV_CMD"].get(item.command)
        name = kind.name.removeprefix("MAV_CMD_") if kind is not None else str(item.command)
        return dialect.MAV_MISSION_UNSUPPORTED, f"item {number} is {name}: only NAV_WAYPOINT is followed"
    if item.frame not in FRAMES:
        return dialect.MAV_MISSION_UNSUPPORTED_FRAME, f"item {number} is in frame {item.frame}: use a global one"
    hold, radius = item.parameters[:2]
    if hold > HOLD_MOST_S:
        return dialect.MAV_MISSION_INVALID_PARAM1, f"item {number} waits {hold:g} s: the boat cannot, set it to 0"
    if radius > RADIUS_MOST:
        return (
            dialect.MAV_MISSION_INVALID_PARAM2,
            f"item {number}: radius {radius:g} m, allowed is {RADIUS_MOST:g}",
        )
    if not abs(item.x) <= LATITUDE_MOST_E7:
        return dialect.MAV_MISSION_INVALID_PARAM5_X, f"item {number}: latitude {item.x * 1e-7:g}, up to 85 is allowed"
    if not abs(item.y) <= LONGITUDE_MOST_E7:
        return dialect.MAV_MISSION_INVALID_PARAM6_Y, f"item {number}: longitude {item.y * 1e-7:g}, allowed is up to 180"
    if item.x == item.y == 0:
        return dialect.MAV_MISSION_INVALID_PARAM5_X, f"item {number} lies at 0 N 0 E: give it a place"
    return dialect.MAV_MISSION_ACCEPTED, ""


def from_message(message: object) -> MissionItem:
    """Return the item of a MISSION_ITEM_INT or MISSION_ITEM message; what is not finite becomes a place off the map."""
    fields = {name: getattr(message, name) for name in ("frame", "command", "x", "y", "z", "autocontinue")}
    if isinstance(fields["x"], float):
        fields["x"], fields["y"] = _e7(fields["x"]), _e7(fields["y"])
    parameters = tuple(float(getattr(message, f"param{number}")) for number in range(1, 5))
    return MissionItem(parameters=parameters, **fields)  # type: ignore[arg-type]


def _e7(degrees: float) -> int:
    return round(degrees * 1.0e7) if abs(degrees) <= 200.0 else LONGITUDE_MOST_E7 + 1


def dump_items(items: Sequence[MissionItem]) -> str:
    """Return items as the text of a waypoint file."""
    lines = [FIRST_LINE]
    for number, item in enumerate(items):
        parameters = (repr(float(value)) for value in item.parameters)
        place = (f"{item.x * 1e-7:.7f}", f"{item.y * 1e-7:.7f}", repr(float(item.z)))
        fields = (str(number), "0", str(item.frame), str(item.command), *parameters, *place, str(item.autocontinue))
        lines.append("\t".join(fields))
    return "\n".join(lines) + "\n"


def parse_items(text: str, name: str) -> tuple[MissionItem, ...]:
    """Return the items of a waypoint file's text; InputError names the file, the line and what is wrong."""
    lines = [line.strip() for line in text.splitlines()]
    if not lines or lines[0] != FIRST_LINE:
        raise InputError(f"{name}: line 1 must be {FIRST_LINE!r}; save the route as a waypoint file")
    items: list[MissionItem] = []
    for number, line in enumerate(lines[1:], 2):
        if line and not line.startswith("#"):
            item = _item_of(line, f"{name}, line {number}")
            sentence = problem(len(items), item)[1]
            if sentence:
                raise InputError(f"{name}, line {number}: {sentence}")
            items.append(item)
    if len(items) > MOST_ITEMS:
        raise InputError(f"{name}: holds {len(items)} items, up to {MOST_ITEMS} are allowed")
    return tuple(items)


def _item_of(line: str, where: str) -> MissionItem:
    fields = line.split()
    if len(fields) != COLUMNS:
        raise InputError(f"{where}: holds {len(fields)} values, {COLUMNS} are needed")
    try:
        frame, command, autocontinue = int(fields[2]), int(fields[3]), int(fields[11])
        p1, p2, p3, p4, latitude, longitude, z = (float(field) for field in fields[4:11])
    except ValueError:
        raise InputError(f"{where}: holds a value that is not a number") from None
    return MissionItem(frame, command, (p1, p2, p3, p4), _e7(latitude), _e7(longitude), z, autocontinue)
