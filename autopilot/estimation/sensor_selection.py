"""Which of several instruments is selected: by their order, by how fresh they are, by the word of the others. Pure.

Of the sources that give the same kind of value the first in the priority list that is fresh is selected, and the
others are left out: two compasses fused would be a third one that does not exist. Without a list the source heard
first stays until it is stale. A better source that comes back must have been heard for `SETTLE_S` before it takes
over, or one that comes and goes would jerk the helm each time. A compass that has failed by the word of another, see
`CompassWatch`, is not selected at all. The compass that the skipper has chosen goes before the
list. Whenever another compass takes over, what is held is turned by what lies between the two, see `CompassSample`:
the boat stays on its course.
"""

from __future__ import annotations

import math
import re
from collections import deque
from fnmatch import fnmatchcase
from typing import NamedTuple

from autopilot.angles import compass_text, shortest_turn, wrap
from autopilot.errors import InputError
from autopilot.estimation.compass_peers import DRIFTING, CompassWatch
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    CompassSample,
    HeadingSample,
    PositionSample,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
)
from autopilot.supervision.alarms import APART, FAILED

SETTLE_S = 3.0
MONITOR_S = 3.0
"""Two headings further apart than the limit for this long disagree; waves swing a compass for less."""
AGREE_AGAIN = 0.8
"""They agree again within this share of the limit."""
LATENCIES_S = 1.0
"""One of them may be older than the other by this: they may be apart by what the boat turns in that time."""
SILENT_SAID_S = 60.0
"""So long it is said that a compass is silent and another steers."""
CHOSEN_SILENT_S = 10.0
"""It is said after this that the chosen one is."""
SOURCES_MOST = 32
"""Of one kind: a line full of noise must not fill the memory with talkers."""
MONITOR = "heading monitor"
KINDS: dict[type, str] = {HeadingSample: "heading", RateSample: "rate", RollSample: "", PositionSample: ""}
"""What the samples that come most often measure; '' for what is passed on whoever sends it."""


class SourceRule(NamedTuple):
    """A pattern such as `HEHDT`, `HC*` or `*@nmea:/dev/ttyUSB1*`, and the age [s] at which what matches is stale."""

    pattern: str
    stale: float


class SelectionSettings(NamedTuple):
    """rules: best first, for every kind of value alike.  stale [s] where no rule matches.

    heading_stale [s]: a heading is stale at this age at the latest, so that another compass takes over before the
    fail-safe does.  disagree [rad]: two headings further apart are an alarm; inf: nobody compares.  jump [rad] and
    frozen: what `CompassWatch` looks for. compass: the NAME@LINK of the one that the skipper has chosen, '' for none.
    """

    rules: tuple[SourceRule, ...] = ()
    stale: float = 2.0
    heading_stale: float = math.inf
    disagree: float = math.inf
    jump: float = math.inf
    frozen: bool = False
    compass: str = ""


class Compass(NamedTuple):
    """A compass that has been heard: NAME@LINK, whether it measures from magnetic north, and its heading [rad] as it is
    steered by, nan while it is stale or has failed."""

    source: str
    is_magnetic: bool
    heading: float


CHOSEN = -1
"""The rank of the compass that the skipper has chosen."""
APART_S = 3.0
"""Time [s] over which two compasses are compared for what lies between them."""
USUAL_S = 60.0
"""And over which what lay between them before one drifts: of a drift of t [s] the share t/(2 USUAL_S) is in it."""
TURNS_LEAST = math.radians(3.0)
"""A boat that turns by more [rad/s] shows what is between two compasses falsely: one of them is older."""
MAGNETIC_TOO = ":M"
"""Behind the name of a device on NMEA 2000: its magnetic headings, beside which it may send true ones."""
MAGNETIC = re.compile(r"..HD[GM]|.*:M")
"""Names of the compasses that measure from magnetic north: NMEA 0183's HDG and HDM, and NMEA 2000's of that kind."""


class _Received:
    """One source of one kind."""

    __slots__ = ("apart", "compared", "first", "heading", "known", "last", "rank", "stale", "usual")

    def __init__(self, now: float, rank: int, stale: float) -> None:
        self.first = self.last = now
        self.rank, self.stale = rank, stale
        self.heading: float | None = None
        self.apart, self.usual, self.known, self.compared = 0.0, 0.0, 0.0, -math.inf
        """How far [rad] it is from the compass that steers, of late and over USUAL_S; for how long [s] that is known,
        and from when."""

    def compare(self, now: float, steers: _Received) -> None:
        """Take the heading, as old as that of the compass which `steers`, as far as anybody knows."""
        if self.heading is None or steers.heading is None or steers.last < self.compared:
            return  # a compass that falls silent says nothing of a boat that turns on
        if self.is_known and steers.last < self.first:
            return  # of two that take turns each change would add what a single heading is wrong by
        step = min(max(now - self.compared, 0.0), APART_S) if self.is_known else 0.0
        self.known = min(self.known + step, USUAL_S)
        apart, share = self.heading - steers.heading, step / min(self.known, APART_S) if self.known else 1.0
        self.apart = wrap(self.apart + share * wrap(apart - self.apart))
        self.usual = wrap(self.usual + (step / self.known if self.known else 1.0) * wrap(apart - self.usual))
        self.compared = now

    @property
    def is_known(self) -> bool:
        """Whether it was ever compared."""
        return self.compared > -math.inf


class SensorSelection:
    """Drops the samples of sources that are not selected. Memory: who was heard when, who is selected."""

    def __init__(self, settings: SelectionSettings = SelectionSettings()) -> None:  # noqa: B008 - immutable
        self._settings, self.chosen = settings, settings.compass
        self._compasses = CompassWatch(settings.jump, frozen=settings.frozen)
        self.reset()

    def reset(self) -> None:
        """Forget every source."""
        self.dropped = 0
        self._compasses.reset()
        self._received: dict[str, dict[str, _Received]] = {}
        self._selected: dict[str, str] = {}
        self._apart, self._compared = 0.0, math.inf
        self._headings: deque[tuple[float, float]] = deque()
        """Those of the compass that steers, of the last MONITOR_S, and when they came [s]."""
        self._begun = math.inf
        self._alarm: AlarmEvent | None = None
        self._disagree: AlarmEvent | None = None
        """Two headings that disagree, as it was first said: what changes with every reading is a
        new alarm each time."""
        self._left: tuple[str, float] | None = None
        """The compass that fell silent last, and when another took its place [s]."""
        self._left_last = ("", -math.inf)
        self._again = ""
        """Who falls silent time and again; '' for nobody."""
        self._news: list[Sample] = []

    def selected(self, kind: str) -> str:
        """Return the source selected for `kind` (heading, rate, rudder, ordered rudder, speed), or nothing."""
        return self._selected.get(kind, "")

    def compasses(self, now: float) -> list[Compass]:
        """Return the compasses that have been heard, in the order in which they were heard first."""
        found = []
        for source, entry in self._received.get("heading", {}).items():
            heading = entry.heading
            is_well = heading is not None and now - entry.last <= entry.stale and not self._compasses.reason(source)
            name = source.partition("@")[0]
            found.append(Compass(source, MAGNETIC.fullmatch(name) is not None, heading if is_well else math.nan))  # type: ignore[arg-type]
        return found

    def choose(self, now: float, source: str) -> None:
        """Steer by this compass from now on, '' for the best of the list. InputError where that cannot be.

        What is held is turned by what lies between the two: the boat stays on its course.
        """
        received, steers = self._received.get("heading", {}), self._selected.get("heading", "")
        if source:
            entry = received.get(source)
            if entry is None or now - entry.last > entry.stale:
                raise InputError(f"{_short(source)} is not heard")
            if reason := self._compasses.reason(source):
                raise InputError(f"{_short(source)} {reason}")
            if source != steers and now - entry.first < SETTLE_S:
                raise InputError(f"{_short(source)} has not been heard for {SETTLE_S:.0f} s yet")
        ranks = {each: CHOSEN if each == source else self._rank(each) for each in received}
        heard = [each for each, known in received.items() if now - known.last <= known.stale]
        well = [each for each in heard if not self._compasses.reason(each) and now - received[each].first >= SETTLE_S]
        best = source or min(well, key=lambda each: (ranks[each], each != steers), default=steers)
        if best != steers and steers in heard and self._turning() > TURNS_LEAST:
            raise InputError("the boat is turning: choose on a steady course")
        self.chosen = source
        for each, rank in ranks.items():
            received[each].rank = rank
        if best:
            self._steer_by(now, best)
            self._left = None

    def _steer_by(self, now: float, source: str) -> None:
        """Select a compass; what is held is turned by what lies between it and the one before, where that is known."""
        received, before = self._received["heading"], self._selected.get("heading")
        self._selected["heading"] = source
        self._apart, self._disagree = 0.0, None
        if before is None or before == source or not received[source].is_known:
            return
        of = received[source]
        # the boat followed one that drifts off its course
        turn = of.usual if self._compasses.reason(before) == DRIFTING else of.apart
        self._news.append(CompassSample(now, turn, source))
        for known in received.values():
            known.apart, known.usual = wrap(known.apart - turn), wrap(known.usual - turn)
        self._headings = deque((time, wrap(heading + turn)) for time, heading in self._headings)

    def admit(self, now: float, samples: list[Sample], link: str) -> list[Sample]:
        """Return those `samples`, arrived by `now` [s] on `link`, that are selected, and a change of alarm or of what
        is steered by."""
        self._begun = min(self._begun, now)
        kept: list[Sample] = []
        for sample in samples:
            kind = _kind(sample)
            if kind and not self._choose(now, kind, f"{sample.source}@{link}", sample):
                self.dropped += 1
                continue
            kept += [*self._news, sample]
            self._news.clear()
        kept += self._news
        self._news.clear()
        alarm = self._failed(now) or self._compare(now) or self._silent(now)
        if alarm != self._alarm:
            self._alarm = alarm
            kept.append(AlarmSample(now, alarm, MONITOR))
        return kept

    def _choose(self, now: float, kind: str, source: str, sample: Sample) -> bool:
        if isinstance(sample, HeadingSample) and not math.isfinite(sample.heading):
            return False
        received = self._received.setdefault(kind, {})
        entry = received.get(source)
        if entry is None:
            if len(received) >= SOURCES_MOST:
                return False
            entry = received[source] = self._new(now, kind, source)
        elif now - entry.last > entry.stale:
            entry.first = now
        if isinstance(sample, HeadingSample):
            return self._choose_compass(now, source, entry, sample)
        entry.last = now
        best = self._selected.get(kind)
        if best is None or self._goes_before(now, entry, received[best]):
            best = self._selected[kind] = source
        return best == source

    def _choose_compass(self, now: float, source: str, entry: _Received, sample: HeadingSample) -> bool:
        heading = sample.heading
        received, best = self._received["heading"], self._selected.get("heading")
        steers, has_failed = (entry, False) if best is None else (received[best], bool(self._compasses.reason(best)))
        entry.heading = heading
        if not has_failed and now - steers.last <= steers.stale:
            entry.compare(now, steers)
        entry.last = now
        self._compasses.on_sample(now, source, heading, sample.rate)
        if self._compasses.reason(source):
            return False
        if best is None or has_failed or self._goes_before(now, entry, steers):
            if best is not None and best != source and now - steers.last > steers.stale:
                self._again = self._silent_again(now, best)
                self._left = self._left_last = (best, now)
            self._steer_by(now, source)
        elif best != source:
            return False
        self._headings.append((now, heading))
        while self._headings[0][0] < now - MONITOR_S:
            self._headings.popleft()
        return True

    def _new(self, now: float, kind: str, source: str) -> _Received:
        most = self._settings.heading_stale if kind == "heading" else math.inf
        rank, rules = self._rank(source), self._settings.rules
        stale = rules[rank].stale if rank < len(rules) else self._settings.stale
        is_chosen = kind == "heading" and source == self.chosen
        return _Received(now, CHOSEN if is_chosen else rank, min(stale, most))

    def _rank(self, source: str) -> int:
        """Return the place in the list; behind it all are alike."""
        name = source.partition("@")[0]
        names = name, name.removesuffix(MAGNETIC_TOO), source
        rules = self._settings.rules
        return next(
            (rank for rank, rule in enumerate(rules) if any(fnmatchcase(each, rule.pattern) for each in names)),
            len(rules),
        )

    def _goes_before(self, now: float, entry: _Received, best: _Received) -> bool:
        if now - best.last > best.stale:
            return True
        is_settled = now - entry.first >= SETTLE_S or best.first == entry.first or now - best.first < SETTLE_S
        return entry.rank < best.rank and is_settled

    def _failed(self, now: float) -> AlarmEvent | None:
        """Return the alarm of a compass that has failed by the word of another; None where none has."""
        for name, reason in self._compasses.doubted(now):
            selected = self._selected.get("heading", "")
            if name != selected:
                detail = f"{_short(name)} {reason}, {_short(selected)} steers"
                return AlarmEvent("heading_disagrees", detail, FAILED)
        return None

    def _silent_again(self, now: float, name: str) -> str:
        """Return who is silent again, one having been so shortly before."""
        before, since = self._left_last
        if now - since > SILENT_SAID_S:
            return ""
        if name == before:
            return f"{_short(name)} comes and goes"
        return " and ".join(sorted((_short(before), _short(name)))) + " take turns"

    def _silent(self, now: float) -> AlarmEvent | None:
        """Return the alarm of a compass that has fallen silent while another steers, for a minute; of the one that the
        skipper has chosen while it is not heard."""
        received, steers = self._received.get("heading", {}), _short(self.selected("heading"))
        chosen = received.get(self.chosen)
        if self.chosen and steers and now - (self._begun if chosen is None else chosen.last) > CHOSEN_SILENT_S:
            return AlarmEvent("compass_silent", f"{_short(self.chosen)}, the chosen one; {steers} steers")
        if self._again and now - self._left_last[1] <= SILENT_SAID_S:
            return AlarmEvent("compass_silent", self._again)
        if self._left is None:
            return None
        name, since = self._left
        entry = received[name]
        if now - since > SILENT_SAID_S or now - entry.last <= entry.stale:
            self._left = None
            return None
        return AlarmEvent("compass_silent", f"{_short(name)}; {steers} steers")

    def _compare(self, now: float) -> AlarmEvent | None:
        """Return the alarm of two fresh headings that disagree for long; None where they agree."""
        received = self._received.get("heading", {})
        best = received.get(self._selected.get("heading", ""))
        if best is None or best.heading is None or not math.isfinite(self._settings.disagree):
            return None
        others = [
            (name, entry) for name, entry in received.items() if entry is not best and now - entry.last <= entry.stale
        ]
        # two that part slowly tremble about the limit for minutes: one alarm, not one at each of their noises
        apart_by = self._settings.disagree * (1.0 if self._disagree is None else AGREE_AGAIN)
        limit = apart_by + LATENCIES_S * self._turning()
        far = [
            (name, entry.heading)
            for name, entry in others
            if entry.heading is not None and abs(shortest_turn(best.heading, entry.heading)) > limit
        ]
        elapsed, self._compared = min(max(now - self._compared, 0.0), LATENCIES_S), now
        if now - best.last > best.stale or (not far and self._disagree is not None):
            self._apart, self._disagree = 0.0, None
            return None
        # a swell that brings them together for a moment takes back no more than that moment
        self._apart = min(self._apart + elapsed, MONITOR_S) if far else max(self._apart - elapsed, 0.0)
        if self._apart < MONITOR_S:
            return None
        steers = self._selected["heading"]
        for name, _ in far:
            for one, other in ((steers, name), (name, steers)):
                if not self._compasses.reason(other) and self._compasses.drifts(one, other):
                    self._compasses.accuse(one)
        self._disagree = self._disagree or self._apart_by(best.heading, *far[0])
        return self._disagree

    def _turning(self) -> float:
        """Return how fast [rad/s] the compass that steers has turned over `MONITOR_S`: waves come and go."""
        headings = self._headings
        return abs(shortest_turn(headings[0][1], headings[-1][1])) / MONITOR_S if headings else 0.0

    def _apart_by(self, heading: float, other: str, other_heading: float) -> AlarmEvent:
        apart = abs(math.degrees(shortest_turn(heading, other_heading)))
        detail = (
            f"{apart:.0f} deg: {_short(self._selected['heading'])} {compass_text(heading, 1)}, "
            f"{_short(other)} {compass_text(other_heading, 1)}"
        )
        return AlarmEvent("heading_disagrees", detail, APART)


def _short(source: str) -> str:
    return source.partition("@")[0]


def _kind(sample: Sample) -> str:
    if (kind := KINDS.get(sample.__class__)) is not None:
        return kind
    if isinstance(sample, SpeedSample):
        return "speed over ground" if sample.over_ground else "speed"
    if isinstance(sample, RudderSample):
        return "ordered rudder" if sample.ordered else "rudder"
    return ""
