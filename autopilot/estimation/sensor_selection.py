"""Which of several instruments is selected: by their order, by how fresh they are, by the word of the others. Pure.

Which of several compasses has failed by the word of the others: it stands still, jumps or trembles alone. Pure.

One compass alone is judged by the pilot's own monitors, with what they know of rudder, rate and sea. Two judge each
other sooner and more surely: where one moves, jumps or trembles and the other does not, the pilot
need not fail, it goes on with the one that is well.

Which of several instruments is selected, and whether two compasses agree. Pure.

Of the sources that give the same kind of value the first in the priority list that is fresh is selected, and the
others are left out: two compasses fused would be a third one that does not exist. Without a list the source heard
first stays until it is stale. A better source that comes back must have been heard for `SETTLE_S` before it takes
over, or one that comes and goes would jerk the helm each time. A compass that has failed by the word of another, see
`CompassWatch`, is not selected at all. The compass that the skipper has chosen goes before the list.
"""

from __future__ import annotations

import math
import re
from collections import deque
from fnmatch import fnmatchcase
from typing import NamedTuple

from autopilot.angles import compass_text, shortest_turn, wrap
from autopilot.errors import InputError
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

STANDS_S = 0.3
STANDS_SAMPLES = 4
STANDS_TURN = math.radians(2.5)
STANDS_DIGITS = 2.0
"""A compass that says the very same for so long [s] and so often while another has turned by this [rad], and by so many
of its own digits, is frozen."""
HABIT = 4
HABIT_LEAST = 3
HABIT_KNOWN = 100
HABIT_S = 1.5
HABIT_TURN = math.radians(1.0)
"""Or one that has never before said the same so often: HABIT times the longest that it did in HABIT_KNOWN headings and
more, and no less than HABIT * HABIT_LEAST headings and so long [s], while another has turned by this [rad]. Where
lengths are random, as noise makes them, that is as rare as the cube of one in all that were."""
NOISY, QUIET = math.radians(4.0), math.radians(2.0)
NOISY_S, NOISY_SHARE = 1.5, 1.0 / 15.0
WILDEST = math.radians(20.0)
"""A compass with white noise of more than NOISY [rad] beside one with less than QUIET is noisy: 0.5 to 1 deg are usual.
Over so long [s], a heading at most a share of it, each counting as WILDEST [rad] at most: one of 2 deg was never called
noisy in three hours, and one of 10 deg in 1.0 s on average, 2.4 s at most; a single jump or spike never is."""
AGREES = math.radians(10.0)
AGREES_S = 3.0
"""It is well again when it moves and is no further from the other than this [rad] for this time [s]."""
SILENT_S = 2.0
"""Or when it was silent for so long [s]: it has been switched off and on."""
FRESH_S = 1.0


class _Noise:
    """The standard deviation [rad] of an angle's white noise, from its second differences, which a steady turn has not:
    they have the variance 6 sigma^2, and their size the mean sigma sqrt(12/pi)."""

    __slots__ = ("_last", "_step", "deviation")

    def __init__(self, angle: float) -> None:
        self._last, self._step, self.deviation = angle, 0.0, 0.0

    def take(self, angle: float, share: float) -> None:
        """Take the next angle [rad], which counts for a `share` of the mean."""
        step = shortest_turn(self._last, angle)
        size = abs(shortest_turn(self._step, step)) / math.sqrt(12.0 / math.pi)
        self.deviation += share * (min(size, WILDEST) - self.deviation)
        self._last, self._step = angle, step


class _Compass:
    """What one compass said last, since when it stands, and where the others were when it began to; the noise of its
    headings, and of what lies between them and another's."""

    __slots__ = (
        *("agrees_since", "apart", "digit", "heading", "heard", "last", "longest", "noise", "others", "reason", "same"),
        "since",
    )

    def __init__(self, now: float, heading: float) -> None:
        self.heading, self.last = heading, now
        self.reason, self.digit = "", math.inf
        self.heard, self.longest = 0, HABIT_LEAST
        self.agrees_since: float | None = None
        self.noise = _Noise(heading)
        self.apart: dict[str, _Noise] = {}
        self.stand(now, {})

    def stand(self, now: float, others: dict[str, float]) -> None:
        """Begin to stand where it is, the others being where they are."""
        self.since, self.same, self.others = now, 1, others


class CompassWatch:
    """`on_sample` every heading; `reason` has what is wrong with a compass, '' where nothing is.

    jump [rad]: no boat turns further between two headings; inf: not watched. frozen: watched or not.
    """

    def __init__(self, jump: float, *, frozen: bool) -> None:
        self._jump, self._frozen = jump, frozen
        self.reset()

    def reset(self) -> None:
        """Forget every compass."""
        self._compasses: dict[str, _Compass] = {}

    def reason(self, name: str) -> str:
        """Return what is wrong with a compass."""
        compass = self._compasses.get(name)
        return compass.reason if compass is not None else ""

    def doubted(self, now: float) -> list[tuple[str, str]]:
        """Return the compasses that are heard and not selected, and why."""
        return [(name, it.reason) for name, it in self._compasses.items() if it.reason and now - it.last <= SILENT_S]

    def on_sample(self, now: float, name: str, heading: float) -> None:
        """Take a heading [rad] that arrived at `now` [s]."""
        compass = self._compasses.get(name)
        if compass is None or now - compass.last > SILENT_S:
            self._compasses[name] = _Compass(now, heading)
            return
        others = self._others(now, name)
        if not compass.reason:
            compass.reason = self._jumped(compass, heading, others)
        is_noisy = self._is_noisy(now, compass, heading, others)
        if is_noisy and not compass.reason:
            compass.reason = "is noisy"
        compass.heard += 1
        if heading != compass.heading:
            if not compass.reason:
                compass.longest = max(compass.longest, compass.same)
            compass.digit = min(compass.digit, abs(shortest_turn(compass.heading, heading)))
            compass.stand(now, others)
        else:
            compass.same += 1
            if not compass.reason and self._frozen and self._stands(now, compass, others):
                compass.reason = "stands still"
        compass.heading, compass.last = heading, now
        self._forgive(now, compass, {} if is_noisy else others)

    def _others(self, now: float, name: str) -> dict[str, float]:
        return {
            other: compass.heading
            for other, compass in self._compasses.items()
            if other != name and not compass.reason and now - compass.last <= FRESH_S
        }

    def _jumped(self, compass: _Compass, heading: float, others: dict[str, float]) -> str:
        """A jump alone is none of the boat's: the others lie where the compass came from, not where it went to."""
        if abs(shortest_turn(compass.heading, heading)) <= self._jump:
            return ""
        stayed = any(
            abs(shortest_turn(other, compass.heading)) < abs(shortest_turn(other, heading)) for other in others.values()
        )
        return "jumps" if stayed else ""

    def _is_noisy(self, now: float, compass: _Compass, heading: float, others: dict[str, float]) -> bool:
        """What the boat does is no noise: both show it, and nothing of it lies between them."""
        share = min(-math.expm1(-(now - compass.last) / NOISY_S), NOISY_SHARE)
        compass.noise.take(heading, share)
        off = {name: shortest_turn(other, heading) for name, other in others.items()}
        compass.apart = {name: compass.apart.get(name, _Noise(angle)) for name, angle in off.items()}
        for name, angle in off.items():
            compass.apart[name].take(angle, share)
        if not math.isfinite(self._jump) or compass.noise.deviation <= NOISY:
            return False
        return any(
            apart.deviation > NOISY and self._compasses[name].noise.deviation < QUIET
            for name, apart in compass.apart.items()
        )

    @staticmethod
    def _stands(now: float, compass: _Compass, others: dict[str, float]) -> bool:
        if now - compass.since < STANDS_S or compass.same < STANDS_SAMPLES:
            return False
        turns = (
            shortest_turn(compass.others[name], heading) for name, heading in others.items() if name in compass.others
        )
        is_strange = (
            compass.heard >= HABIT_KNOWN and compass.same >= HABIT * compass.longest and now - compass.since >= HABIT_S
        )
        least = HABIT_TURN if is_strange else STANDS_TURN
        return any(abs(turn) > max(least, STANDS_DIGITS * compass.digit) for turn in turns)

    @staticmethod
    def _forgive(now: float, compass: _Compass, others: dict[str, float]) -> None:
        near = any(abs(shortest_turn(other, compass.heading)) <= AGREES for other in others.values())
        if not compass.reason or not near or compass.same >= STANDS_SAMPLES:
            compass.agrees_since = None
        elif compass.agrees_since is None:
            compass.agrees_since = now
        elif now - compass.agrees_since >= AGREES_S:
            compass.reason = ""


SETTLE_S = 3.0
MONITOR_S = 3.0
"""Two headings further apart than the limit for this long disagree; waves swing a compass for less."""
AGREE_AGAIN = 0.8
"""They agree again within this share of the limit."""
LATENCIES_S = 1.0
"""One of them may be older than the other by this: they may be apart by what the boat turns in that time."""
SILENT_SAID_S = 60.0
"""So long it is said that a compass is silent and another steers."""
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
TURNS_LEAST = math.radians(3.0)
"""A boat that turns by more [rad/s] shows what is between two compasses falsely: one of them is older."""
MAGNETIC_TOO = ":M"
"""Behind the name of a device on NMEA 2000: its magnetic headings, beside which it may send true ones."""
MAGNETIC = re.compile(r"..HD[GM]|.*:M")
"""Names of the compasses that measure from magnetic north: NMEA 0183's HDG and HDM, and NMEA 2000's of that kind."""


class _Received:
    """One source of one kind."""

    __slots__ = ("apart", "first", "heading", "last", "rank", "stale")

    def __init__(self, now: float, rank: int, stale: float) -> None:
        self.first = now
        self.last = now
        self.rank = rank
        self.stale = stale
        self.heading: float | None = None
        self.apart = 0.0
        """How far [rad] it is from the compass that steers, of late."""

    def compare(self, now: float, steering: float) -> None:
        """Take the `heading` [rad], as old as the one that steers [rad] as far as anybody knows."""
        assert self.heading is not None
        known = max(now - self.first, 0.0)
        share = 1.0 if known == 0.0 else min(max((now - self.last) / min(known, APART_S), 0.0), 1.0)
        self.apart = wrap(self.apart + share * wrap(self.heading - steering - self.apart))


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
        self._alarm: AlarmEvent | None = None
        self._disagree: AlarmEvent | None = None
        """Two headings that disagree, as it was first said: what changes with every reading is a
        new alarm each time."""
        self._left: tuple[str, float] | None = None
        """The compass that fell silent last, and when another took its place [s]."""
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

        What is held is turned by what lies between the two, see `CompassSample`: the boat stays on its course.
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
        if best != steers and steers in heard:
            if len(self._headings) > 1 and self._turning(now, self._headings[-1][1]) > TURNS_LEAST:
                raise InputError("the boat is turning: choose on a steady course")
            self._news.append(CompassSample(now, received[best].apart, best))
            apart = received[best].apart
            for known in received.values():
                known.apart = wrap(known.apart - apart)
        self.chosen = source
        for each, rank in ranks.items():
            received[each].rank = rank
        if best:
            self._selected["heading"], self._left = best, None
            self._headings.clear()
            self._apart, self._disagree = 0.0, None

    def admit(self, now: float, samples: list[Sample], link: str) -> list[Sample]:
        """Return those `samples`, arrived by `now` [s] on `link`, that are selected, and a change of alarm or of what
        is steered by."""
        kept, self._news = self._news, []
        for sample in samples:
            kind = _kind(sample)
            if not kind or self._choose(now, kind, f"{sample.source}@{link}", sample):
                kept.append(sample)
            else:
                self.dropped += 1
        alarm = self._failed(now) or self._compare(now) or self._silent(now)
        if alarm != self._alarm:
            self._alarm = alarm
            kept.append(AlarmSample(now, alarm, MONITOR))
        return kept

    def _choose(self, now: float, kind: str, source: str, sample: Sample) -> bool:
        received = self._received.setdefault(kind, {})
        entry = received.get(source)
        if entry is None:
            if len(received) >= SOURCES_MOST:
                return False
            entry = received[source] = self._new(now, kind, source)
        elif now - entry.last > entry.stale:
            entry.first = now
        if isinstance(sample, HeadingSample):
            entry.heading = sample.heading
            steers = received.get(self._selected.get("heading", ""), entry)
            is_well = not self._compasses.reason(self._selected.get("heading", ""))
            if is_well and steers.heading is not None and now - steers.last <= steers.stale:
                entry.compare(now, steers.heading)
        entry.last = now
        if isinstance(sample, HeadingSample):
            self._compasses.on_sample(now, source, sample.heading)
            if self._compasses.reason(source):
                return False
        best = self._selected.get(kind)
        has_failed = best is not None and kind == "heading" and self._compasses.reason(best)
        if best is None or has_failed or self._goes_before(now, entry, received[best]):
            if (
                kind == "heading"
                and best is not None
                and best != source
                and now - received[best].last > received[best].stale
            ):
                self._left = (best, now)
            self._selected[kind] = source
            return True
        return best == source

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
                detail = f"{name.partition('@')[0]} {reason}, {selected.partition('@')[0]} steers"
                return AlarmEvent("heading_disagrees", detail, FAILED)
        return None

    def _silent(self, now: float) -> AlarmEvent | None:
        """Return the alarm of a compass that has fallen silent while another steers, for a minute."""
        if self._left is None:
            return None
        name, since = self._left
        entry = self._received["heading"][name]
        if now - since > SILENT_SAID_S or now - entry.last <= entry.stale:
            self._left = None
            return None
        selected = self._selected["heading"].partition("@")[0]
        return AlarmEvent("compass_silent", f"{name.partition('@')[0]}; {selected} steers")

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
        limit = apart_by + LATENCIES_S * self._turning(now, best.heading)
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
        self._disagree = self._disagree or self._apart_by(best.heading, *far[0])
        return self._disagree

    def _turning(self, now: float, heading: float) -> float:
        """Return how fast [rad/s] the compass that is selected has turned over `MONITOR_S`: waves come and go."""
        headings = self._headings
        headings.append((now, heading))
        while headings[0][0] < now - MONITOR_S:
            headings.popleft()
        return abs(shortest_turn(headings[0][1], heading)) / MONITOR_S

    def _apart_by(self, heading: float, other: str, other_heading: float) -> AlarmEvent:
        apart = abs(math.degrees(shortest_turn(heading, other_heading)))
        detail = (
            f"{apart:.0f} deg: {self._selected['heading'].partition('@')[0]} {compass_text(heading, 1)}, "
            f"{other.partition('@')[0]} {compass_text(other_heading, 1)}"
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
