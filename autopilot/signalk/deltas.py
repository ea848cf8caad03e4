"""What Signal K is told of the boat: deltas made of what a helm display knows. Pure.

Paths and units of the Signal K specification 1.7: radians, radians a second, metres, metres a second.
"""

from __future__ import annotations

import math
import zlib
from typing import Any

from autopilot.links.boat.modes import HEADING, TRACK, TRIAL
from autopilot.web.station import Station

LABEL = "norrbin"
FRESH_S = 2.0
BEAT_FRESH_S = 3.0
KNOT_M_S = 1852.0 / 3600.0
RADIAN = math.pi / 180.0
STATES = {HEADING: "auto", TRACK: "route", TRIAL: "trial"}
"""Our modes by the names that Signal K programs know; each other one is standby."""
OFF_LINE, STANDBY = "off-line", "standby"
MEASURED = (
    ("attitude", "heading", "navigation.headingTrue", RADIAN),
    ("attitude", "rate", "navigation.rateOfTurn", RADIAN),
    ("rudder", "rudder", "steering.rudderAngle", RADIAN),
    ("rudder", "order", "steering.autopilot.target.headingTrue", RADIAN),
    ("speed", "speed", "navigation.speedOverGround", KNOT_M_S),
    ("navigation", "xte", "navigation.courseRhumbline.crossTrackError", 1.0),
)
"""Group that ages together, our value, path, and factor to Signal K's unit."""
NOTIFICATIONS = "notifications.steering.autopilot.norrbin."
"""Before the name of an alarm: each has a notification of its own."""
OURS_ALONE = {"acknowledgeSupport": "No", "temporarySilenceSupport": "No"}
"""signalk-server lets everybody who reaches it acknowledge by its notifications API, and would show an alarm that comes
again as acknowledged: with this it leaves both to the boat."""
OVER = {"state": "normal", "method": [], "message": "", **OURS_ALONE}


def state_of(station: Station, now: float) -> str:
    """Return what the pilot does, in Signal K's words."""
    age = station.view.age("beat", now)
    if station.target is None or age is None or age > BEAT_FRESH_S:
        return OFF_LINE
    return STATES.get(station.view.mode, STANDBY)


def values_of(station: Station, now: float) -> dict[str, Any]:
    """Return what is known at `now` [s], by path; what is stale is None, which Signal K takes for unknown."""
    view = station.view
    state = state_of(station, now)
    values: dict[str, Any] = {"steering.autopilot.state": state}
    values["steering.autopilot.engaged"] = state not in (OFF_LINE, STANDBY)
    is_magnetic = bool(view.value("magnetic"))
    for group, name, true_path, factor in MEASURED:
        path = true_path.replace("True", "Magnetic") if is_magnetic else true_path
        age, value = view.age(group, now), view.value(name)
        is_known = state != OFF_LINE and age is not None and age < FRESH_S and value is not None
        values[path] = value * factor if is_known and value is not None else None
    if not values["steering.autopilot.engaged"]:
        values[f"steering.autopilot.target.heading{'Magnetic' if is_magnetic else 'True'}"] = None
    if state != "route":
        values["navigation.courseRhumbline.crossTrackError"] = None
    return values


def notifications_of(station: Station) -> dict[str, Any]:
    """Return the notification of each alarm that is on, by path: it sounds until somebody has acknowledged it."""
    told: dict[str, Any] = {}
    for alarm in station.alarms.shown:
        path = path_of(alarm)
        alike = sum(each.startswith(path) for each in told)
        # two lines may be lost at a time
        told[f"{path}{alike + 1}" if path in told else path] = {
            "state": "alarm" if alarm["sounds"] or alarm["acknowledged"] else "alert",
            "method": ["visual", "sound"] if alarm["sounds"] else ["visual"],
            "message": alarm["words"],
            **OURS_ALONE,
        }
    return told


def path_of(alarm: dict[str, Any]) -> str:
    """Return the path of an alarm's notification; what is of no kind, as older boats say it, has none but its words."""
    first, *rest = (alarm["name"] or f"other_{zlib.crc32(alarm['words'].encode()):08x}").split("_")
    return NOTIFICATIONS + first + "".join(word.capitalize() for word in rest)


class Deltas:
    """Makes deltas: all values at first and every so often, in between what has changed."""

    ALL_S = 5.0
    OVER_S = 60.0
    """How long it is repeated that an alarm is over."""

    def __init__(self) -> None:
        self._told: dict[str, Any] = {}
        self._over: dict[str, float] = {}
        self._next = -math.inf

    def due(self, station: Station, now: float) -> dict[str, Any] | None:
        """Return what to tell at `now` [s], None where nothing has changed."""
        values = values_of(station, now) | self._notifications(station, now)
        if now >= self._next:
            self._next, self._told = now + self.ALL_S, {}
        changed = {path: value for path, value in values.items() if path not in self._told or self._told[path] != value}
        self._told = values
        return delta_of(changed) if changed else None

    def _notifications(self, station: Station, now: float) -> dict[str, Any]:
        """Return the alarms that are on, and for a while those that were."""
        on = notifications_of(station)
        self._over = {path: until for path, until in self._over.items() if now < until}
        self._over.update(dict.fromkeys(on, now + self.OVER_S))
        return {path: on.get(path, OVER) for path in self._over}


def delta_of(values: dict[str, Any]) -> dict[str, Any]:
    """Return the delta of values by path, without a time: the server gives it its own, and so is not misled by ours.

    Notifications are an update of their own: signalk-server 2.23 gives all of an update that has one another source.
    """
    told = [{"path": path, "value": value} for path, value in values.items()]
    groups = [
        [each for each in told if not str(each["path"]).startswith("notifications.")],
        [each for each in told if str(each["path"]).startswith("notifications.")],
    ]
    source = {"label": LABEL, "type": "MAVLink"}
    return {
        "context": "vessels.self",
        "updates": [{"source": source, "values": group} for group in groups if group],
    }
