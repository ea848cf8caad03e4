"""How an override of a steering input is proved before we steer, seen while we do, and seen to end afterwards. Pure.

The override probe finds out, before the pilot may engage and without moving the rudder, that our steering is taken.
ArduPilot ignores overrides in silence: from a system id that is not its ground station's, while the pilot's override
switch is off, or when its parameters are other than they were read. So a pulse is sent that differs from the present
one by a few microseconds, inside the dead zone where there is one, and RC_CHANNELS must show exactly that pulse. Then
nothing is sent for a moment, in which it must stay: whoever else overrides the input shows then.

It is proved at the start, so that the skipper hears early of what stands in the way, and anew for each engagement:
another pilot may have taken the helm since.

The release: the input differs from all that was ordered of late, or, where the stick stands as the last order did, a
mark is overridden, seen, and released again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping
from enum import Enum

from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.steering import DISTINCT_US, SteeringOutput
from autopilot.links.rudder_order import LONGEST_PERIOD_S, PATIENCE_S, REPORTS, SLOWEST_WAY_S, WAYS

DISOBEDIENCE_S = 1.0
"""The rudder may differ from the command this long: reports come at 5 to 10 Hz and are as old as the link."""
DOUBT_S = 0.4
"""From here on it may be a parameter that was changed: what comes of reading them again comes before the verdict."""
AGREEMENT_WEIGHT = 0.5
"""Reports that agree make good half as much: a rudder that follows somebody else every other time is found out too."""
PULSE_TOLERANCE_US = 3
HISTORY_S = 1.0
"""A report may show any pulse sent within this time."""
ECHO_PATIENCE_S = 2.5
"""A slow telemetry radio may take this long from our message to the vehicle's report of it."""
STRAGGLER_S = 5.0
"""One order may come so late that it is seen this long after it was sent: an old one of ours, and nobody else's."""
RETURN_GAP_S, RETURNS_S = 0.35, 1.5
"""Orders that are released and back within the one, for longer than the other: who steers repeats its own at 5 Hz."""


class OverrideEcho:
    """Whether an override shows in what the vehicle reports: one for each channel that is overridden. Times in seconds.

    Attributes:
        began: when the overriding began.  report_time: when something was reported last, -inf before.
        pulses: the input pulses [us] commanded in the `HISTORY_S` before the last command, each once with its last
            time, the newest last.
        doubted: the reports that have disagreed for so long that they may be going to for too long.
    """

    def __init__(self) -> None:
        self.began = self.report_time = -math.inf
        self.pulses: dict[int, float] = {}
        self.doubted: set[str] = set()
        self._earlier: dict[int, float] = {}
        self._is_held = False
        self._acted = (-math.inf, -math.inf)
        """Since when, and when last, orders that are released have been seen to act again."""
        self._doubts: dict[str, tuple[float, float]] = {}

    def commanded(self, now: float, pulse: int | None) -> None:
        """Take a command as it was sent: the input pulse [us] it asks for, None where it asks for something else."""
        if not self._is_held:
            self._is_held, self._doubts, self.doubted = True, {}, set()
            self.began = self.report_time = now
        if pulse is not None:
            self.pulses.pop(pulse, None)  # its last time orders it
            self.pulses[pulse] = now
        for oldest in [*self.pulses]:
            if now - self.pulses[oldest] <= HISTORY_S:
                break
            self._earlier.pop(oldest, None)
            self._earlier[oldest] = self.pulses.pop(oldest)
        for oldest in [*self._earlier]:
            if now - self._earlier[oldest] <= STRAGGLER_S:
                break
            del self._earlier[oldest]

    def released(self) -> None:
        """Take note that nothing is overridden any more."""
        self._is_held = False
        for pulse, time in self.pulses.items():
            self._earlier.pop(pulse, None)
            self._earlier[pulse] = time
        self.pulses.clear()

    def is_late(self, pulse: int) -> bool:
        """Return whether a reported `pulse` [us] was commanded before `pulses`, and not longer ago than a straggler."""
        return agrees_with(pulse, self._earlier)

    def acts_again(self, now: float, pulse: int) -> bool:
        """Return whether a reported `pulse` [us] may be an order of ours that came behind its release, which the
        vehicle obeys until it lets go by itself.

        Such a one goes with the next release. What comes back behind each of them is somebody else who steers, or a
        stick that stands there: theirs is not to be released.
        """
        if self._is_held or not self._earlier:
            return False
        recent = [sent for sent, time in self._earlier.items() if now - time <= STRAGGLER_S]
        if not recent:
            self._earlier.clear()
        if not agrees_with(pulse, recent):
            return False
        since, last = self._acted
        self._acted = (since if now - last <= RETURN_GAP_S else now, now)
        if now - self._acted[0] > RETURNS_S:
            self._earlier.clear()
            return False
        return True

    def shows(self, now: float, what: str, pulse: int, expected: Collection[int]) -> str:
        """Compare a reported `pulse` [us] with those that the commands of late ask for, the newest last; return what it
        is that has differed for too long, '' where nothing has.

        It is one of them: between two that lie on either side a pulse that stands still would seem to obey for as long
        as the order swings about it. `what` names the report, such as "RC channel 1" or "servo 1".
        """
        return differing(what, pulse, expected) if self.disagrees(now, what, agrees_with(pulse, expected)) else ""

    def disagrees(self, now: float, what: str, agrees: bool) -> bool:
        """Take whether the report `what` agrees with what is commanded; return whether it has not for too long."""
        self.report_time = now
        last, doubt = self._doubts.get(what, (self.began, 0.0))
        passed = now - last if now - last < DISOBEDIENCE_S else DISOBEDIENCE_S
        doubt += -AGREEMENT_WEIGHT * passed if agrees else passed
        self._doubts[what] = (now, doubt if doubt > 0.0 else 0.0)
        if doubt > DOUBT_S:
            self.doubted.add(what)
        elif self.doubted:
            self.doubted.discard(what)
        return doubt > DISOBEDIENCE_S


def agrees_with(pulse: int, expected: Collection[int]) -> bool:
    """Return whether a reported `pulse` [us] is one of those that are expected."""
    return pulse in expected or any(-PULSE_TOLERANCE_US <= pulse - each <= PULSE_TOLERANCE_US for each in expected)


def differing(what: str, pulse: int, expected: Collection[int]) -> str:
    """Return what is said of a reported `pulse` [us] that is none of those that are expected."""
    return f"{what} is at {pulse} us while {[*expected][-1]} is commanded"


REPEAT_S = 0.1
RETRY_S = 4.0
SEEN_REPORTS = 3
"""So many reports in a row must show the pulse: a stick that a hand moves passes by."""
STRANGE_PROBES = 2
"""One report may have been overtaken on its way."""
PAUSE_S = 0.35
"""Others repeat their overrides at 5 Hz at least."""
PAUSE_REPORTS = 2
OTHER = (
    "another pilot or ground station overrides the steering input: RC channel {number} went to {pulse} us while "
    "{ours} us was sent last; stop it, or start with --with-other-pilot"
)
MOVES = (
    "another pilot or ground station, or a hand, moves the steering input (RC channel {number}) and ours does not "
    "show: hold the stick still, and stop what else steers"
)
LATE = (
    "the vehicle shows our steering {seconds:.1f} s after it was sent (RC channel {number}): over so slow a line no "
    "boat is steered well; raise its baud rate, or let it carry less"
)
REPORT_TIMEOUT_S = 3.0
CHECKED_ON_ENGAGING = "the steering input is checked anew when an order to engage comes"
CHECKING = "checking the steering input"


class Stage(Enum):
    """How far a proof is; the reason says it in words."""

    WAITING = "nothing is reported yet"
    CHECKING = "a pulse of ours is sent, or will be"
    NOT_TAKEN = "the vehicle does not take our steering"
    SHARED = "somebody else, or a hand, moves the input"
    GROWN_OLD = "tried once, and tried anew when somebody waits for it"
    PASSED = "the vehicle takes our steering"


class OverrideProbe:
    """One proof when the vehicle starts and one for each engagement. `may_share`: others may override the input too.

    Attributes:
        reason: why control is not ours yet; empty once the vehicle has shown that it takes our steering.
        stage: how far the proof is.
        pulse [us]: the input that the proof asks for.
        message: what is being sent for the proof, None while nothing is.
        way [s]: from an order to the report that shows it, as the last proof did.
    """

    def __init__(self, output: SteeringOutput, may_share: bool = False) -> None:
        self._output = output
        self._may_share = may_share
        self._is_waited_for = True
        self.way = 0.0
        self.reset()

    def reset(self) -> None:
        """Ask for the proof anew, as after a reboot."""
        self.stage = Stage.WAITING
        self.reason = "waiting for the vehicle to report its steering input (RC_CHANNELS)"
        self._reported: int | None = None
        self._report_time = -math.inf  # unheard of for ever is silent
        self.message: Message | None = None
        self.pulse = 0
        self._began = self._aimed = self._next = -math.inf
        self._base = self._seen = self._strange = self._moves = 0
        self._has_shown = False
        self._paused: float | None = None

    def wanted(self, waits: bool) -> None:
        """Take whether an order to engage waits, while we do not steer: a proof that nobody waits for grows old.

        Where others may override the input too the first proof is enough, and another would not come through.
        """
        if self._may_share:
            return
        self._is_waited_for = waits
        if waits and self.stage is Stage.GROWN_OLD:
            self.stage, self.reason = Stage.CHECKING, CHECKING
        elif not waits and self.passed:
            self.stage, self.reason = Stage.GROWN_OLD, CHECKED_ON_ENGAGING

    @property
    def passed(self) -> bool:
        """Whether the vehicle has shown that it takes our steering."""
        return self.stage is Stage.PASSED

    def report(self, now: float, number: int, pulse: int) -> None:
        """Take what RC_CHANNELS says of the steering channel `number`."""
        self._report_time = now
        if self.message is None:
            self._reported = pulse
            return
        if self._paused is not None:
            self._judge_pause(now, number, pulse)
            return
        self._seen = self._seen + 1 if pulse == self.pulse else 0
        is_first = self._seen > 0 and not self._has_shown
        if is_first and now - self._aimed > DISOBEDIENCE_S:
            # the same lateness would end the steering as soon as the order moves
            self._refuse(now, Stage.NOT_TAKEN, LATE.format(number=number, seconds=now - self._aimed))
            return
        if is_first:
            self._has_shown, self.way = True, now - self._aimed
        # an override stays for seconds: what shows behind ours is no stick
        self._strange += self._has_shown and pulse != self.pulse
        if self._strange >= STRANGE_PROBES and not self._may_share:
            self._refuse(now, Stage.SHARED, OTHER.format(number=number, pulse=pulse, ours=self.pulse))
        elif self._seen >= SEEN_REPORTS:
            self._paused, self._seen = now, 0
            if self._may_share:
                self.stage, self.reason, self.message = Stage.PASSED, "", None
        elif now - self._began > ECHO_PATIENCE_S and self._moves >= STRANGE_PROBES:
            self._refuse(now, Stage.SHARED, MOVES.format(number=number))
        elif now - self._began > ECHO_PATIENCE_S:
            self._refuse(
                now,
                Stage.NOT_TAKEN,
                f"the vehicle does not take our steering: RC channel {number} stays at {pulse} us while {self.pulse} "
                "us is sent; switch radio override on, close other ground stations, or start with --as-gcs",
            )
        elif not self._has_shown and abs(pulse - self._base) > DISTINCT_US:
            self._moves += 1
            self._aim(now, pulse)  # where the rudder was is no place to hold it

    def _aim(self, now: float, pulse: int) -> None:
        """Have a pulse sent that leaves the servo where an input `pulse` [us] has it."""
        found = self._output.unmoving(pulse)
        if found is not None:
            self._aimed = now
            self._base = pulse
            self.message, self.pulse = found

    def _judge_pause(self, now: float, number: int, pulse: int) -> None:
        assert self._paused is not None
        if pulse != self.pulse:
            self._refuse(now, Stage.SHARED, OTHER.format(number=number, pulse=pulse, ours=self.pulse))
            return
        self._seen += 1
        if now - self._paused >= PAUSE_S and self._seen >= PAUSE_REPORTS:
            self.stage, self.reason, self.message, self._paused = Stage.PASSED, "", None, None

    def _refuse(self, now: float, stage: Stage, reason: str) -> None:
        self.message, self._reported, self._paused, self._next = None, None, None, now + RETRY_S
        self.stage, self.reason = stage, reason

    def due(self, now: float) -> Message | None:
        """Return the message to send at `now` [s], None where none is."""
        if self.stage in (Stage.PASSED, Stage.GROWN_OLD) or now < self._next:
            return None
        if self.message is None and not self._is_waited_for and self.stage is Stage.SHARED:
            # to try again would disturb who steers; and whether they still do is not known without
            self.stage, self.reason = Stage.GROWN_OLD, CHECKED_ON_ENGAGING
            return None
        if now - self._report_time > REPORT_TIMEOUT_S:
            self.message = self._paused = None
            return None
        if self._paused is not None:
            return None
        if self.message is None:
            if self._reported is None:
                return None
            self._aim(now, self._reported)
            if self.message is None:
                return None
            self._began, self._seen, self._strange, self._moves, self._has_shown = now, 0, 0, 0, False
            # what the last try found stays said while the next is under way
            if self.stage not in (Stage.NOT_TAKEN, Stage.SHARED):
                self.stage, self.reason = Stage.CHECKING, CHECKING
        self._next = now + REPEAT_S
        return self.message


DIFFERENT_REPORTS = 2
"""A stick that a hand moves passes by: so many reports in a row must differ from what was ordered."""
SAME_S = 0.4
"""When reports still show the last order after this, the stick may stand there: a mark tells the two apart."""
MARK_PERIOD_S = 0.1
MARK_S = 0.6
OVERRIDE_MARGIN_S = 0.5


class OverrideRelease:
    """Watches the reports of a steering input that was overridden. Pure; times in seconds.

    The override is gone when the input differs from all that was ordered of late. Where the stick stands as the last
    order did, nothing differs: then a `mark`, an input that moves nothing, is overridden, seen, and released again.

    Attributes:
        is_asked: whether the release has been sent and no order since.
        way [s]: from what is sent to the report that shows it.
    """

    def __init__(self) -> None:
        self.is_asked = False
        self.way = 0.0
        self._sent: deque[tuple[float, int]] = deque()
        self._asked_time = math.nan
        self._last_order = math.nan
        self._report_time = math.nan
        self._period = 0.1
        self._different = 0
        self._same: int | None = None
        self._mark: int | None = None
        self._mark_sent = self._mark_next = math.nan
        self._is_mark_seen = False
        self._is_mark_tried = False
        self.shown_by = ""

    def ordered(self, now: float, pulse: int) -> None:
        """Take an override as it was sent, of `pulse` [us]."""
        self.is_asked, self.shown_by = False, ""
        self._keep(now, pulse)

    def asked(self, now: float) -> None:
        """Take a release as it was sent."""
        if not self.is_asked:
            self.is_asked, self._asked_time = True, now
            self._different, self._same, self._mark = 0, None, None
            self._is_mark_seen = self._is_mark_tried = False

    @property
    def has_ordered(self) -> bool:
        """Whether an override has ever been sent."""
        return bool(self._sent)

    def report(self, now: float, pulse: int, name: str, servo_of: Mapping[int, int] | None = None) -> None:
        """Take what the report `name` shows of the steering input [us], or of the servo: `servo_of` each input [us]."""
        period = now - self._report_time  # not a number for the first report
        if period >= 0.0:
            self._period += 0.2 * ((period if period < LONGEST_PERIOD_S else LONGEST_PERIOD_S) - self._period)
        self._report_time = now
        if not self._sent or not self.is_asked or self.shown_by or now <= self._asked_time:
            return
        if self._mark is not None and servo_of is None:
            is_marked = abs(pulse - self._mark) <= PULSE_TOLERANCE_US
            if self._is_mark_seen and not is_marked and not self.is_marking(now):
                self.shown_by = name
            self._is_mark_seen = self._is_mark_seen or is_marked
            return
        ordered = [sent for when, sent in self._sent if self._asked_time - when <= HISTORY_S]
        if servo_of is not None:
            ordered = [servo_of[sent] for sent in ordered]
        if any(abs(pulse - sent) <= PULSE_TOLERANCE_US for sent in ordered):
            self._different = 0
            self._same = pulse if servo_of is None else None
        else:
            self._different += 1
            self._same = None
            if self._different >= DIFFERENT_REPORTS:
                self.shown_by = name

    def is_held(self, now: float, override_time: float) -> bool:
        """Return whether an override of ours may be in force; `override_time` [s]: RC_OVERRIDE_TIME, < 0 for ever."""
        if not self._sent or self.shown_by:
            return False
        return override_time < 0.0 or now - self._last_order <= override_time + OVERRIDE_MARGIN_S

    @property
    def patience(self) -> float:
        """Seconds to wait for a report after the release."""
        ways = SAME_S + WAYS * min(self.way, SLOWEST_WAY_S)
        return max(PATIENCE_S, ways) + REPORTS * self._period

    def wants_mark(self, now: float) -> int | None:
        """Return the input [us] to find a mark beside, once, where the reports show what was ordered last."""
        if self._is_mark_tried or self.shown_by or self._same is None or now - self._asked_time < SAME_S + self.way:
            return None
        return self._same

    def mark(self, now: float, pulse: int) -> None:
        """Take the mark [us] that is to be sent when `is_marking` says so."""
        self._mark, self._is_mark_tried, self._is_mark_seen = pulse, True, False
        self._mark_sent, self._mark_next = now, now

    def mark_due(self, now: float) -> bool:
        """Return whether the mark is to be sent (again) at `now`."""
        if self._mark is None or not self.is_marking(now) or now < self._mark_next:
            return False
        self._mark_next = now + MARK_PERIOD_S
        self._keep(now, self._mark)
        return True

    def is_marking(self, now: float) -> bool:
        """Return whether a mark is under way that has not been seen yet."""
        return self._mark is not None and not self._is_mark_seen and now - self._mark_sent < MARK_S + self.way

    def _keep(self, now: float, pulse: int) -> None:
        self._last_order = now
        if not self._sent or self._sent[-1][1] != pulse:
            self._sent.append((now, pulse))
        else:
            self._sent[-1] = (now, pulse)
        while now - self._sent[0][0] > HISTORY_S:  # the newest is of now
            self._sent.popleft()
