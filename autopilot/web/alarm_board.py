"""The alarms that are on, who has seen them, and when each was raised, acknowledged and cleared. Pure.

The list is the boat's, fetched when the numbers that it tells change. Texts alone would not do: they tell when an alarm
begins, never when it ends or was acknowledged, and a display that comes later has not heard them. The history is kept
here, for all displays, as long as this program runs: a page that comes back finds it.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter, deque
from typing import Any, NamedTuple

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, parse_json
from autopilot.files.printable import printable
from autopilot.firmware.metadata import FtpClient
from autopilot.links.ground_station.file_server import ALARMS
from autopilot.signals import AlarmState
from autopilot.supervision.alarms import CATALOGUE, OTHER, SOUNDS, Priority, Sound
from autopilot.web.view import BoatView

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


class AlarmBoard:
    """`active` are the alarms that are on, the most urgent first; `history` has those of this session, the newest last.

    An alarm whose words change, as a number in them does, stays one alarm in the history.
    """

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self._on: tuple[Alarm, ...] = ()
        self._seen: set[str] = set()
        self._now = 0.0
        self._sent_news: tuple[float, float | None] | None = None
        self._next = -math.inf
        self._is_asked = self._is_old = False
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
            for key, alarm in _keyed(self._on).items()
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

    def update(self, now: float, view: BoatView) -> None:
        """Fetch the list where the boat tells of other alarms than we know, or of others that were acknowledged."""
        self._now = now
        count = view.value("alarm_count")
        if count is None:
            return
        news = (count, view.value("alarm_new"))
        if count == 0.0:
            self._put(())
        elif news != self._sent_news or now >= self._next:
            self._next, self._is_old = now + CHECK_S, True
        self._sent_news = news
        if self._is_old and not self._is_asked:
            self._is_asked, self._is_old = True, False
            self._files.fetch(ALARMS, self._take)

    def acknowledge(self, is_known_aboard: bool, name: str | None = None) -> None:
        """Note that what sounds has been seen, of a name or all of it; where the boat does not know, it counts here
        alone."""
        sounding = [
            alarm for alarm in self._on if alarm.state is AlarmState.SOUNDING and name in (None, alarm.name or OTHER)
        ]
        self._seen.update(alarm.words for alarm in sounding)
        if is_known_aboard:
            self._seen.difference_update(alarm.words for alarm in sounding)
            self._on = tuple(
                alarm._replace(state=AlarmState.ACKNOWLEDGED) if alarm in sounding else alarm for alarm in self._on
            )
        self._put(self._on)

    def forget(self) -> None:
        """The boat has started again."""
        self._put(())
        self._sent_news = None

    def _take(self, content: bytes | None) -> None:
        self._is_asked = False
        if content is None:
            return
        with contextlib.suppress(InputError):  # the alarms known stay, until a list comes that is one
            self._put(alarms_from(content))

    def _put(self, alarms: tuple[Alarm, ...]) -> None:
        """Let these be the alarms that are on, and write down what has changed."""
        self._on, now = alarms, self._now
        self._seen.intersection_update(alarm.words for alarm in alarms)
        keyed = _keyed(alarms)
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
    words, name, state = (fields.get(key) for key in ("words", "name", "state"))
    if not isinstance(words, str):
        raise InputError(f"{origin}: words {printable(repr(words), SHOWN)}: a text is needed")
    if not (isinstance(name, str) and NAME.fullmatch(name)):
        raise InputError(f"{origin}: name {printable(repr(name), SHOWN)}: up to 64 of a-z, 0-9 and _ are allowed")
    if not (isinstance(state, str) and state in STATES):
        raise InputError(f"{origin}: state {printable(repr(state), SHOWN)}: allowed are {', '.join(STATES)}")
    priority = fields.get("priority", _priority_of(name, STATES[state]).name.lower())
    if not (isinstance(priority, str) and priority in PRIORITIES):
        raise InputError(f"{origin}: priority {printable(repr(priority), SHOWN)}: allowed are {', '.join(PRIORITIES)}")
    return Alarm(name, words, STATES[state], PRIORITIES[priority], fields.get("escalated") is True)


def _priority_of(name: str, state: AlarmState) -> Priority:
    """Return the priority where an older boat tells none."""
    if name in CATALOGUE:
        return CATALOGUE[name].priority
    return Priority.CAUTION if state is AlarmState.NOTICE else Priority.WARNING
