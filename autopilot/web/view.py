"""What a helm display knows of the boat, and how old each piece of it is: built from the messages of its link. Pure.

STATUSTEXT put together from its pieces of 50 characters, the newest kept. Pure.

"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.firmware.session import NORRBIN, Vehicle, vehicle_of
from autopilot.links.alarm_outputs import PIECE
from autopilot.links.ground_station.orders import HEADING, MANUAL, TRACK, TRIAL, WIND
from autopilot.links.ground_station.telemetry import SHOWN_MOST
from autopilot.links.mavlink.codec import Message

KEPT = 50
PIECES_MOST = 20
PATIENCE_S = 3.0
"""A text whose next piece does not come within this time is shown as far as it came."""


class Text(NamedTuple):
    """What was said: number of the text in this session, when [s], MAV_SEVERITY, words."""

    number: int
    time: float
    severity: int
    words: str


class TextPieces:
    """Takes STATUSTEXT messages; `kept` are the whole texts, oldest first."""

    def __init__(self) -> None:
        self.kept: deque[Text] = deque(maxlen=KEPT)
        self.count = 0
        self._parts: dict[int, dict[int, str]] = {}
        self._heads: dict[int, tuple[float, int]] = {}

    def take(self, now: float, message: Message) -> None:
        """Take one piece. A piece shorter than 50 characters, or a text without id, ends a text."""
        words = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
        words = words.rstrip("\0")
        if message.id == 0:
            self._store(now, int(message.severity), words)
            return
        self.update(now)
        parts = self._parts.setdefault(message.id, {})
        self._heads[message.id] = (now, int(message.severity))
        parts[min(int(message.chunk_seq), PIECES_MOST)] = words
        last = max(parts)
        if len(parts[last]) < PIECE and len(parts) == last + 1:
            self._finish(now, message.id)

    def update(self, now: float) -> None:
        """Keep what has waited too long for its next piece."""
        for identity, (since, _) in list(self._heads.items()):
            if now - since > PATIENCE_S:
                self._finish(now, identity)

    def _finish(self, now: float, identity: int) -> None:
        parts, (_, severity) = self._parts.pop(identity), self._heads.pop(identity)
        self._store(now, severity, "".join(parts[number] for number in sorted(parts)))

    def _store(self, now: float, severity: int, words: str) -> None:
        if words:
            self.count += 1
            self.kept.append(Text(self.count, now, severity, words))


MODE_NAMES = {MANUAL: "standby", HEADING: "heading", TRACK: "route", TRIAL: "trial", WIND: "wind"}
HISTORY_PERIOD_S = 0.5
HISTORY_ROWS = 600
COLUMNS = ("t", "heading", "reference", "order", "rudder", "rudder_order", "xte", "gap", "hz")
"""A row of the history, in degrees, metres and milliseconds."""
TRIAL_COMMANDS = frozenset({int(dialect.MAV_CMD_USER_1), int(dialect.MAV_CMD_USER_2)})
GROUPS = ("beat", "attitude", "navigation", "rudder", "loop", "learning", "speed", "position", "wind", "mob", "compass")
"""Each ages by itself: what is old is shown as old, though other messages still come."""
NAMED = {
    "rud_deg": ("rudder", "rudder"),
    "rudcmd_deg": ("rudder_order", "rudder"),
    "bias_deg": ("bias", "rudder"),
    "ref_deg": ("reference", "rudder"),
    "ord_deg": ("order", "rudder"),
    "ticks_hz": ("hz", "loop"),
    "gap_ms": ("gap", "loop"),
    "hdg_age_ms": ("heading_age", "loop"),
    "alarms": ("alarm_count", "loop"),
    "alarms_new": ("alarm_new", "loop"),
    "level": ("level", "loop"),
    "magnetic": ("magnetic", "loop"),
    "var_deg": ("variation", "loop"),
    "var_from": ("variation_from", "loop"),
    "var_year": ("variation_year", "loop"),
    "cmp_n": ("compasses", "compass"),
    "cmp_steers": ("compass", "compass"),
    "cmp_chosen": ("compass_chosen", "compass"),
    **{f"cmp{number}": (f"compass_{number}", "compass") for number in range(1, SHOWN_MOST + 1)},
    "AppWndSpd": ("aws", "wind"),
    "AppWndDir": ("awa", "wind"),
    "TruWndSpd": ("tws", "wind"),
    "TruWndDir": ("twa", "wind"),
    "wnd_hold": ("wind_angle", "wind"),
    "wnd_true": ("wind_true", "wind"),
    "wnd_ask": ("wind_ask", "wind"),
    "mob_brg": ("mob_bearing", "mob"),
    "mob_dist": ("mob_distance", "mob"),
    "mob_s": ("mob_since", "mob"),
}
"""NAMED_VALUE_FLOAT to our value and the group it ages with; `lrn_` values are kept under their own names."""
IN_KNOTS = ("aws", "tws")
LEARNT = "lrn_"
PLACE = ("lat", "lon")


class Trial(NamedTuple):
    """A trial that was begun: its command, share done in per cent, MAV_RESULT (5 while it lasts)."""

    command: int
    percent: int
    result: int


class BoatView:
    """Takes every message of the link; `snapshot` and `row` say what is known.

    Attributes:
        vehicle: the boat that was heard first, None before; only it is listened to.
        texts: what it said lately.  trial: the trial of this session, None before one.
        stood_by: when [s] the pilot was first heard to have left the helm the last time, -inf before.
    """

    def __init__(self) -> None:
        self.vehicle: Vehicle | None = None
        self.texts = TextPieces()
        self.trial: Trial | None = None
        self.stood_by = -math.inf
        self.history: deque[tuple[float | None, ...]] = deque(maxlen=HISTORY_ROWS)
        self._values: dict[str, float] = {}
        self._received: dict[str, float] = {}
        self._status = 0
        self._mode = MANUAL
        self._next_row = -math.inf
        self._takers = {
            "HEARTBEAT": self._heartbeat,
            "ATTITUDE": self._attitude,
            "VFR_HUD": self._hud,
            "NAV_CONTROLLER_OUTPUT": self._navigation,
            "NAMED_VALUE_FLOAT": self._named,
            "MISSION_CURRENT": self._mission,
            "GLOBAL_POSITION_INT": self._position,
            "STATUSTEXT": self.texts.take,
            "COMMAND_ACK": self._acknowledged,
        }

    @property
    def is_ours(self) -> bool:
        """Whether the boat is a running Norrbin, whose modes and commands we know."""
        return self.vehicle is not None and self.vehicle.firmware == NORRBIN

    @property
    def mode(self) -> int:
        """The boat's mode as last heard."""
        return self._mode

    @property
    def mode_name(self) -> str:
        """The boat's mode in a word."""
        return MODE_NAMES.get(self._mode, f"mode {self._mode}")

    def value(self, name: str) -> float | None:
        """Return a value by name, None where it is not known."""
        found = self._values.get(name, math.nan)
        return found if math.isfinite(found) else None

    def age(self, group: str, now: float) -> float | None:
        """Return the seconds since anything of the group came, None where nothing has."""
        received = self._received.get(group)
        return None if received is None else max(0.0, now - received)

    def take(self, now: float, message: Message) -> None:
        """Take a message that came at `now` [s]."""
        if self.vehicle is None:
            self.vehicle = vehicle_of(message)
        vehicle = self.vehicle
        if vehicle is None or (message.get_srcSystem(), message.get_srcComponent()) != vehicle[:2]:
            return
        taker = self._takers.get(message.get_type())
        if taker is not None:
            taker(now, message)

    def forget(self) -> None:
        """Forget which boat it is: the link was opened anew, and another may be there."""
        self.vehicle = None

    def snapshot(self, now: float) -> dict[str, Any]:
        """Return all that is known at `now` [s]: numbers in degrees, knots, metres; None for what is not known."""
        vehicle = self.vehicle
        values = {
            name: _rounded(value, 7 if name in PLACE else 2)
            for name, value in self._values.items()
            if not name.startswith(LEARNT)
        }
        ages = {group: _rounded(age) for group in GROUPS if (age := self.age(group, now)) is not None}
        return {
            "t": round(now, 2),
            "ours": self.is_ours,
            "system": vehicle.system if vehicle is not None else None,
            "armed": vehicle.armed if vehicle is not None else False,
            "status": self._status,
            "mode": self.mode_name,
            **values,
            "ages": ages,
        }

    def learning(self) -> dict[str, float | None]:
        """Return what the boat says of its live identification; empty where it does not learn."""
        return {name: _exact(value) for name, value in self._values.items() if name.startswith(LEARNT)}

    def keep_history(self, now: float) -> tuple[float | None, ...] | None:
        """Add a row where it is time to, and return it. What is stale leaves a gap in the plots."""
        if now < self._next_row:
            return None
        self._next_row = now + HISTORY_PERIOD_S
        fresh = {group for group in GROUPS if (age := self.age(group, now)) is not None and age < 2.0}
        groups = ("attitude", "rudder", "rudder", "rudder", "rudder", "navigation", "loop", "loop")
        row = (
            round(now, 2),
            *(
                _rounded(self._values.get(name, math.nan)) if group in fresh else None
                for name, group in zip(COLUMNS[1:], groups, strict=True)
            ),
        )
        self.history.append(row)
        return row

    def _set(self, now: float, group: str, **values: float) -> None:
        self._received[group] = now
        self._values.update(values)

    def _heartbeat(self, now: float, message: Message) -> None:
        self._received["beat"] = now
        if self._mode != MANUAL and message.custom_mode == MANUAL:
            self.stood_by = now
        self._status, self._mode = int(message.system_status), int(message.custom_mode)
        vehicle = vehicle_of(message)
        if vehicle is not None:
            self.vehicle = vehicle

    def _attitude(self, now: float, message: Message) -> None:
        heading = math.degrees(message.yaw) % 360.0
        self._set(now, "attitude", heading=heading, rate=math.degrees(message.yawspeed))
        self._values["roll"] = math.degrees(message.roll)

    def _hud(self, now: float, message: Message) -> None:
        self._set(now, "speed", speed=message.groundspeed * 3600.0 / 1852.0)

    def _navigation(self, now: float, message: Message) -> None:
        self._set(now, "navigation", xte=message.xtrack_error, distance=float(message.wp_dist))

    def _named(self, now: float, message: Message) -> None:
        name = message.name if isinstance(message.name, str) else message.name.decode("ascii", "replace")
        name = name.rstrip("\0")
        if name in NAMED:
            ours, group = NAMED[name]
            self._set(now, group, **{ours: message.value * (3600.0 / 1852.0 if ours in IN_KNOTS else 1.0)})
        elif name.startswith(LEARNT):
            self._set(now, "learning", **{name: message.value})

    def _mission(self, now: float, message: Message) -> None:
        self._values |= {"waypoint": float(message.seq), "waypoints": float(message.total)}

    def _position(self, now: float, message: Message) -> None:
        self._set(now, "position", lat=message.lat * 1.0e-7, lon=message.lon * 1.0e-7)

    def _acknowledged(self, now: float, message: Message) -> None:
        if message.command in TRIAL_COMMANDS:
            self.trial = Trial(int(message.command), int(message.progress), int(message.result))


def _rounded(value: float, digits: int = 2) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _exact(value: float) -> float | None:
    return float(f"{value:.5g}") if math.isfinite(value) else None
