"""What a helm display remembers: who ordered what and when, where the boat has been, its route, and its alarms. Pure.

The list of alarms is the boat's, fetched when the numbers that it tells change. Texts alone would not do: they tell
when an alarm begins, never when it ends or was acknowledged, and a display that comes later has not heard them. History
is kept here, for all displays, as long as this program runs: a page that comes back finds it.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, parse_json
from autopilot.files.printable import printable
from autopilot.firmware.session import FtpClient
from autopilot.links.ground_station.file_server import ALARMS
from autopilot.signals import AlarmState
from autopilot.supervision.alarms import OTHER, SOUNDS, Priority, Sound
from autopilot.web.view import BoatView

KEPT = 100
ECHO_S = 4.0
"""So long after an order of ours [s] a change of mode or course is its own."""
SETTLED_S = 2.0
"""A course that has stood for this long was ordered; one that changes all the time is led by a route or the wind."""
CHANGED_DEG = 0.5
ELSEWHERE = "elsewhere"
"""At the pilot's own terminal, from a ground station, or over Signal K."""


class Given(NamedTuple):
    """An order: when [s], who gave it, what it was, whether it was taken, None while it is not known; and why not."""

    number: int
    time: float
    who: str
    what: str
    taken: bool | None = None
    words: str = ""


class Journal:
    """`entries` are the orders of this session, the newest last."""

    def __init__(self) -> None:
        self.entries: deque[Given] = deque(maxlen=KEPT)
        self._count = 0
        self._ours = -math.inf
        self._mode: int | None = None
        self._course = self._stands = math.nan
        self._since = -math.inf

    def begin(self, now: float, who: str, what: str) -> int:
        """Note an order that is given; return its number, for `end`."""
        self._ours = now
        return self._note(now, who, what, None)

    def end(self, number: int, taken: bool, words: str) -> None:
        """Note how it ended."""
        for place, entry in enumerate(self.entries):
            if entry.number == number:
                self.entries[place] = entry._replace(taken=taken, words="" if taken else words)

    def update(self, now: float, view: BoatView) -> None:
        """Note what was ordered elsewhere: another mode, or another course that stands."""
        if not view.is_ours:
            return
        mode, course = view.mode, view.value("order")
        is_ours = now - self._ours < ECHO_S
        if self._mode not in (None, mode) and not is_ours:
            self._note(now, ELSEWHERE, view.mode_name, True)
            self._stands = math.nan
        self._mode = mode
        if course is None:
            self._course = self._stands = math.nan
            return
        if not abs(math.remainder(course - self._course, 360.0)) < CHANGED_DEG:
            self._course, self._since = course, now
        if now - self._since < SETTLED_S or view.mode_name != "heading":
            return
        if abs(math.remainder(course - self._stands, 360.0)) >= CHANGED_DEG and not is_ours:
            self._note(now, ELSEWHERE, f"course {round(course) % 360:03d}°", True)
        self._stands = course

    def _note(self, now: float, who: str, what: str, taken: bool | None) -> int:
        self._count += 1
        self.entries.append(Given(self._count, round(now, 1), who, what, taken))
        return self._count


def words_of(request: dict[str, Any]) -> str:
    """Return what a checked request asks for, in words."""
    kind = str(request["do"])
    return WORDS[kind](request) if kind in WORDS else " ".join(str(value) for value in request.values())


def _side(degrees: float) -> str:
    return f"{abs(degrees):g}° to {'port' if degrees < 0.0 else 'starboard'}"


WORDS: dict[str, Callable[[dict[str, Any]], str]] = {
    "engage": lambda _: "hold the heading",
    "standby": lambda _: "standby",
    "release": lambda _: "release the helm",
    "route": lambda _: "follow the route",
    "turn": lambda request: _side(request["degrees"]),
    "heading": lambda request: f"course {round(request['degrees']) % 360:03d}°",
    "dodge": lambda request: f"dodge {_side(request['degrees'])}",
    "back": lambda _: "back to the course before",
    "mob": lambda _: "MAN OVERBOARD",
    "mob_at": lambda _: "MAN OVERBOARD",
    "mob_off": lambda _: "man overboard: recovered",
    "next": lambda _: "on to the next waypoint",
    "wind": lambda request: f"hold the {'true' if request.get('true') else 'apparent'} wind",
    "confirm": lambda _: "turn to the other side of the wind",
    "decline": lambda _: "no turn",
    "zigzag": lambda request: "zigzag {rudder:g}/{change:g}, {duration:g} s".format(**request),
    "turning": lambda request: "turn at {rudder:g}° of rudder, {duration:g} s".format(**request),
    "cancel": lambda _: "end the trial",
    "level": lambda request: f"response {request['level']:g}",
    "compass": lambda request: f"compass {request['number']:g}" if request["number"] else "the best compass",
    "adopt": lambda _: "adopt the learnt model",
    "revert": lambda _: "revert to the model before",
    "acknowledge": lambda request: f"acknowledge {request.get('name') or 'all'}".replace("_", " "),
    "set": lambda request: "{name} = {value:g}".format(**request),
}


EVERY_S = 2.0
POINTS = 1800
"""An hour."""
LEAST_M = 1.0
"""A boat that lies still adds no points."""
METRES_PER_DEG = 111_195.0
ROUTE_MOST = 65_536
AGAIN_S = 20.0

Place = tuple[float, float]
"""Latitude and longitude [deg]."""
Entry = TypeVar("Entry")


class Track:
    """`points` are [time s, latitude deg, longitude deg], the oldest first."""

    def __init__(self) -> None:
        self.points: deque[tuple[float, float, float]] = deque(maxlen=POINTS)

    def update(self, now: float, view: BoatView) -> tuple[float, float, float] | None:
        """Add where the boat is, where it is time to and it has moved; return the new point."""
        latitude, longitude, age = view.value("lat"), view.value("lon"), view.age("position", now)
        if latitude is None or longitude is None or age is None or age > EVERY_S:
            return None
        if self.points:
            last = self.points[-1]
            north = (latitude - last[1]) * METRES_PER_DEG
            east = math.remainder(longitude - last[2], 360.0) * METRES_PER_DEG * math.cos(math.radians(latitude))
            if now - last[0] < EVERY_S or math.hypot(north, east) < LEAST_M:
                return None
        point = (round(now, 1), latitude, longitude)
        self.points.append(point)
        return point


class ListBoard(Generic[Entry]):
    """`entries` of one of the boat's files, fetched anew where the values that tell of it change, and now and then.

    file: its name.  values: by which the boat says how many there are, and what else may tell of another list.  parse:
    raises InputError.  again [s]: a list as long as it was may yet be another.
    """

    def __init__(
        self,
        files: FtpClient,
        file: str,
        values: tuple[str, ...],
        parse: Callable[[bytes], tuple[Entry, ...]],
        again: float = AGAIN_S,
    ) -> None:
        self._files, self._file, self._values, self._parse, self._again = files, file, values, parse, again
        self.entries: tuple[Entry, ...] = ()
        self._now, self._next = 0.0, -math.inf
        self._news: tuple[float | None, ...] = ()
        self._is_asked = self._is_old = False

    def update(self, now: float, view: BoatView) -> None:
        """Ask for the file where it may be another; what changes while it comes is asked for behind it."""
        self._now = now
        news = tuple(map(view.value, self._values))
        if news[0] is None:
            return
        if news[0] == 0.0:
            self._put(())
        elif news != self._news or now >= self._next:
            self._next, self._is_old = now + self._again, True
        self._news = news
        if self._is_old and not self._is_asked:
            self._is_asked, self._is_old = True, False
            self._files.fetch(self._file, self._take)

    def forget(self) -> None:
        """Know nothing until the boat, which has started again, has said it anew."""
        self._put(())
        self._news = ()

    def _take(self, content: bytes | None) -> None:
        self._is_asked = False
        if content is not None:
            with contextlib.suppress(InputError):  # what is known stays, until a list comes that is one
                self._put(self._parse(content))

    def _put(self, entries: tuple[Entry, ...]) -> None:
        self.entries = entries


class CompassName(NamedTuple):
    """A compass of the boat's list: its name, its link, and whether it measures from magnetic north."""

    name: str
    link: str
    magnetic: bool


def compasses_from(content: bytes) -> tuple[CompassName, ...]:
    """Return a boat's list of compasses. Raises InputError."""
    origin = "the boat's compasses"
    entries = parse_json(content, origin, LIST_MOST)
    if not (isinstance(entries, list) and all(map(_is_compass, entries))):
        raise InputError(f"{origin}: a list of name, link and whether it is magnetic is needed")
    return tuple(
        CompassName(printable(each["name"], SHOWN), printable(each["link"], SHOWN), each["magnetic"])
        for each in entries
    )


def _is_compass(entry: Any) -> bool:
    kinds = {"name": str, "link": str, "magnetic": bool}
    return isinstance(entry, dict) and {key: type(value) for key, value in entry.items()} == kinds


def route_from(content: bytes) -> tuple[Place, ...]:
    """Return the places of a boat's route. Raises InputError."""
    origin = "the boat's route"
    entries = parse_json(content, origin, ROUTE_MOST)
    if not (isinstance(entries, list) and all(map(_is_place, entries))):
        raise InputError(f"{origin}: a list of [latitude, longitude] in degrees is needed")
    return tuple((float(latitude), float(longitude)) for latitude, longitude in entries)


def _is_place(entry: Any) -> bool:
    return (
        isinstance(entry, list)
        and len(entry) == 2
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in entry)
        and abs(entry[0]) <= 90.0
        and abs(entry[1]) <= 180.0
    )


CHECK_S = 5.0
"""The list is fetched again after this [s] while alarms are on: one may have taken another's place."""
STATES = {state.name.lower(): state for state in AlarmState}
PRIORITIES = {priority.name.lower(): priority for priority in Priority}
LIST_MOST = 65536
"""Bytes of a list: three hundred alarms, or thirty of the longest sentences."""
NAME = re.compile(r"([a-z][a-z0-9_]{0,63})?")
"""A name, "" where an alarm is of no kind."""
HISTORY_MOST = 100


class Alarm(NamedTuple):
    """One alarm of the boat's list: its name, its words, its state, how soon people must act, and whether it is said
    again because nobody has acknowledged it."""

    name: str
    words: str
    state: AlarmState
    priority: Priority
    is_escalated: bool = False


class Record(NamedTuple):
    """One alarm in the history, with the times [s] at which it was raised, acknowledged and cleared; None: not yet."""

    number: int
    name: str
    words: str
    priority: str
    raised: float
    acknowledged: float | None = None
    cleared: float | None = None


class AlarmBoard(ListBoard[Alarm]):
    """`active` are the alarms that are on, the most urgent first; `history` has those of this session, the newest last.

    An alarm whose words change, as a number in them does, stays one alarm in the history.
    """

    def __init__(self, files: FtpClient) -> None:
        super().__init__(files, ALARMS, ("alarm_count", "alarm_new"), alarms_from, CHECK_S)
        self._seen: set[str] = set()
        self._records: dict[tuple[str, int], Record] = {}
        """Those that are on, by name and which of that name."""
        self._over: deque[Record] = deque(maxlen=HISTORY_MOST)
        self._count = 0

    @property
    def active(self) -> list[dict[str, Any]]:
        """The alarms: name, priority, words, whether each sounds, is acknowledged, is said again, and since when."""
        shown = [
            {
                "name": alarm.name,
                "priority": alarm.priority.name.lower(),
                "words": alarm.words,
                "sounds": alarm.state is AlarmState.SOUNDING and alarm.words not in self._seen,
                "acknowledged": alarm.state is AlarmState.ACKNOWLEDGED or alarm.words in self._seen,
                "escalated": alarm.is_escalated,
                "since": round(self._records[key].raised, 1),
            }
            for key, alarm in _keyed(self.entries).items()
        ]
        return sorted(shown, key=lambda each: (not each["sounds"], PRIORITIES[each["priority"]], -each["since"]))

    @property
    def sound(self) -> Sound | None:
        """What is to be heard now; a warning that nobody acknowledges sounds like an alarm."""
        sounding = [each for each in self.active if each["sounds"]]
        urgent = [Priority.ALARM for each in sounding if each["escalated"]]
        return SOUNDS.get(
            min([*urgent, *(PRIORITIES[each["priority"]] for each in sounding)], default=Priority.CAUTION)
        )

    @property
    def history(self) -> list[Record]:
        """The alarms of this session in the order in which they were raised."""
        return sorted((*self._over, *self._records.values()), key=lambda record: record.number)[-HISTORY_MOST:]

    def acknowledge(self, is_known_aboard: bool, name: str | None = None) -> None:
        """Note that what sounds has been seen, of a name or all of it; where the boat does not know, it counts here
        alone."""
        sounding = [
            alarm
            for alarm in self.entries
            if alarm.state is AlarmState.SOUNDING and name in (None, alarm.name or OTHER)
        ]
        self._seen.update(alarm.words for alarm in sounding)
        if is_known_aboard:
            self._seen.difference_update(alarm.words for alarm in sounding)
            self.entries = tuple(
                alarm._replace(state=AlarmState.ACKNOWLEDGED) if alarm in sounding else alarm for alarm in self.entries
            )
        self._put(self.entries)

    def _put(self, entries: tuple[Alarm, ...]) -> None:
        """Let these be the alarms that are on, and write down what has changed."""
        now = self._now
        super()._put(entries)
        self._seen.intersection_update(alarm.words for alarm in entries)
        keyed = _keyed(entries)
        for key in self._records.keys() - keyed.keys():
            self._over.append(self._records.pop(key)._replace(cleared=now))
        for key, alarm in keyed.items():
            record = self._records.get(key)
            if record is None:
                self._count += 1
                record = Record(self._count, alarm.name, alarm.words, alarm.priority.name.lower(), now)
            is_seen = alarm.state is AlarmState.ACKNOWLEDGED or alarm.words in self._seen
            seen = (now if record.acknowledged is None else record.acknowledged) if is_seen else None
            self._records[key] = record._replace(words=alarm.words, acknowledged=seen)


def _keyed(alarms: tuple[Alarm, ...]) -> dict[tuple[str, int], Alarm]:
    """Return the alarms by name and which of that name; what has none goes by its words."""
    counts: Counter[str] = Counter()
    keyed = {}
    for alarm in alarms:
        name = alarm.name or alarm.words
        counts[name] += 1
        keyed[name, counts[name]] = alarm
    return keyed


def alarms_from(content: bytes) -> tuple[Alarm, ...]:
    """Return the alarms of a boat's list, each once. Raises InputError."""
    origin = "the boat's list of alarms"
    entries = parse_json(content, origin, LIST_MOST)
    if not isinstance(entries, list):
        raise InputError(f"{origin}: a list [...] is needed")
    found = (_alarm_from(entry, f"{origin}: alarm {number}") for number, entry in enumerate(entries, 1))
    return tuple({alarm.words: alarm for alarm in found}.values())


def _alarm_from(entry: Any, origin: str) -> Alarm:
    fields = entry if isinstance(entry, dict) else {}
    words, name, state, priority = (fields.get(key) for key in ("words", "name", "state", "priority"))
    if not isinstance(words, str):
        raise InputError(f"{origin}: words {printable(repr(words), SHOWN)}: a text is needed")
    if not (isinstance(name, str) and NAME.fullmatch(name)):
        raise InputError(f"{origin}: name {printable(repr(name), SHOWN)}: up to 64 of a-z, 0-9 and _ are allowed")
    if not (isinstance(state, str) and state in STATES):
        raise InputError(f"{origin}: state {printable(repr(state), SHOWN)}: allowed are {', '.join(STATES)}")
    if not (isinstance(priority, str) and priority in PRIORITIES):
        raise InputError(f"{origin}: priority {printable(repr(priority), SHOWN)}: allowed are {', '.join(PRIORITIES)}")
    return Alarm(name, words, STATES[state], PRIORITIES[priority], fields.get("escalated") is True)
