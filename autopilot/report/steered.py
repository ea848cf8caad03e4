"""How well a boat was steered: measured tick by tick in constant memory, and said in one sentence for the skipper.

The same measures end `autopilot run`, and compare two logs in `autopilot log compare`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import compass_text, wrap
from autopilot.models.drives import DRIVES
from autopilot.signals import Mode, OrderKind, Tick

TURN_LEAST = math.radians(5.0)
"""A smaller change of course is no turn to be measured."""
SETTLED = math.radians(3.0)
STAYS_S, TURN_MOST_S = 10.0, 180.0
"""A turn has ended when the boat has stayed within SETTLED of its course for so long, or after so long in any case."""
BIN_DEG, BINS = 0.1, 450
SHARE = 0.95
GOOD_PAST_DEG, FAIR_PAST_DEG = 2.0, 6.0
GOOD_OFF_DEG, FAIR_OFF_DEG = 2.5, 6.0
"""What counts as good and as fair: degrees past the course after a turn, and off it for 95 % of the time. They are
yardsticks of boats in ordinary seas, and no standard's."""
BUSY_DEG_S = math.sqrt(2.0 / math.pi) * 2.0 * 1.0
"""How much a rudder moves [deg/s] that answers the yaw of a rough sea, 2 deg rms about 1 rad/s, degree for degree: the
mean of its rate. One that moves more on a course hunts, or follows the noise of the instruments."""
SHORTEST_S = 20.0


class Verdict(NamedTuple):
    """The grade, in a word or two, and the sentence that begins with it."""

    grade: str
    sentence: str


class Turn(NamedTuple):
    """A change of course [rad], positive to starboard: time until it stayed within 3 deg [s], inf where it did not, and
    how far it led past [rad]."""

    angle: float
    settled: float
    past: float


class Steered:
    """Call it with every tick. drive: what steers the boat, a name of `DRIVES`.

    Attributes:
        seconds: engaged.  on_course: of these, on a course and out of a turn.  turns: those measured.  lost: how often
        steering ended by a fail-safe or fault.  executes: how often a trial's rudder went to another angle.
        swing: the least and the largest change of heading [rad] in trials.  out: engaged in a turn, in how many
        seconds it was back at most, inf where it was not, and how far past [rad].  across: how far to the other side
        its way back led [rad].
    """

    def __init__(self, drive: str = "rudder") -> None:
        self._has_gear = not DRIVES[drive].is_mixed
        """The difference of two thrusts wears nothing, however much it moves."""
        self.seconds = self.on_course = self.trial_seconds = 0.0
        self.turns: list[Turn] = []
        self.lost = self.executes = 0
        self.swing = self.out = (0.0, 0.0)
        self.across = 0.0
        self.what = ""
        self._had_course = False
        self._squares = self._travel = self._held_travel = self._way = 0.0
        self._moved = 0.0
        self._bins = [0.0] * (BINS + 1)
        self._last: Tick | None = None
        self._course: float | None = None
        self._swings_out: tuple[float, float, float] | None = None
        """Engaged on its heading in a turn, it goes past and comes back: which way it turned (+1, -1), when, and how
        far past it was at most [rad]."""
        self._crosses = 0.0
        """Then, which way it had turned, +1 or -1, until it turns round on the other side; else 0."""
        self._turn: tuple[float, float, float, float] | None = None
        """The turn under way: its angle [rad], when it began, when it was last outside [s], how far past [rad]."""
        self._trial: tuple[float, float] | None = None
        """The trial's rudder order [rad], and its heading at the last tick [rad]."""
        self._swung = 0.0

    def __call__(self, tick: Tick) -> None:
        last, self._last = self._last, tick
        step = 0.0 if last is None else tick.now - last.now
        if tick.mode is not Mode.ENGAGED:
            if last is not None and last.mode is Mode.ENGAGED and tick.mode in (Mode.FAILSAFE, Mode.FAULT):
                self.lost += 1
            self._leave(tick.now)
            return
        self.seconds += step
        joined = last is not None and last.command.engaged and tick.command.engaged
        self._moved = abs(math.degrees(tick.command.angle - last.command.angle)) if last is not None and joined else 0.0
        self._travel += self._moved
        if tick.order.kind is OrderKind.HEADING:
            self._trial = None
            self._take_course(tick, step)
        else:
            self._end_turn(tick.now)
            self._course = None
            self._take_trial(tick, step)

    @property
    def rms_deg(self) -> float:
        """How far off the planned course, rms [deg]; nan without a course."""
        return math.sqrt(self._squares / self.on_course) if self.on_course > 0.0 else math.nan

    @property
    def off_deg(self) -> float:
        """How far off the course for 95 % of the time at most [deg]; nan without a course."""
        total, passed = sum(self._bins), 0.0
        for place, seconds in enumerate(self._bins):
            passed += seconds
            if total > 0.0 and passed >= SHARE * total:
                return (place + 1) * BIN_DEG
        return math.nan

    @property
    def travel_deg_s(self) -> float:
        """How much the ordered rudder moved [deg/s]; nan where nothing was steered."""
        return self._travel / self.seconds if self.seconds > 0.0 else math.nan

    @property
    def held_travel_deg_s(self) -> float:
        """The same on a course, out of turns [deg/s]; nan without a course."""
        return self._held_travel / self.on_course if self.on_course > 0.0 else math.nan

    @property
    def way(self) -> float:
        """The mean speed in trials [m/s]: the model's where none was measured; nan without a trial."""
        return self._way / self.trial_seconds if self.trial_seconds > 0.0 else math.nan

    @property
    def past_deg(self) -> float:
        """How far the worst turn led past its course [deg]; nan without one."""
        return math.degrees(max((turn.past for turn in self.turns), default=math.nan))

    @property
    def words(self) -> str:
        """What was steered, how long and how well, in few words."""
        if not self.what:
            return "nothing was steered"
        well = f", {self.rms_deg:.1f} deg rms off" if self.on_course > 0.0 else ""
        return f"steered {self.seconds:.0f} s, last {self.what}{well}"

    @property
    def verdict(self) -> Verdict | None:
        """How well it was steered; None where no course was."""
        if not self._had_course:
            return None
        said = self._said()
        if self.lost:
            times = "once" if self.lost == 1 else f"{self.lost} times"
            return Verdict("poor", f"poor: steering was lost {times}; {said}")
        if self.on_course < SHORTEST_S and not self.turns:
            held = f"{self.on_course:.0f} s on a course" if self.on_course else "the turn to the course was not over"
            return Verdict("too short", f"too short to judge: {held}")
        past, off = math.degrees(max(self.across, *(turn.past for turn in self.turns), 0.0)), self.off_deg
        unsettled = any(math.isinf(took) for took in (self.out[0], *(turn.settled for turn in self.turns)))
        if unsettled or past > FAIR_PAST_DEG or off > FAIR_OFF_DEG:
            advice = "look at the speed log, the rudder and the vessel file, then at autopilot gains"
            return Verdict("poor", f"poor: {said}; {advice}")
        if past > GOOD_PAST_DEG or off > GOOD_OFF_DEG:
            return Verdict("fair", f"fair: {said}; in a calm it should be nearer: see autopilot gains")
        if self._has_gear and self.on_course >= SHORTEST_S and self.held_travel_deg_s > BUSY_DEG_S:
            return Verdict(
                "fair", f"fair: {said}, which is busy; in a calm it should move less: see autopilot gains --level"
            )
        return Verdict("good", f"good: {said}")

    def _said(self) -> str:
        said = []
        seconds, past = self.out
        if seconds:
            back = f"was back in {seconds:.0f} s" if math.isfinite(seconds) else f"was not back in {TURN_MOST_S:.0f} s"
            across = math.degrees(self.across)
            across_too = f", then {across:.1f} deg to the other side" if across > GOOD_PAST_DEG else ""
            said.append(f"engaged in a turn, it went {math.degrees(past):.0f} deg past and {back}{across_too}")
        if self.turns:
            largest = max(self.turns, key=lambda turn: abs(turn.angle))
            degrees = f"{abs(math.degrees(largest.angle)):.0f} deg"
            took = f"in {largest.settled:.0f} s" if math.isfinite(largest.settled) else "without settling"
            how_many = "" if len(self.turns) == 1 else f", at most {self.past_deg:.1f} in {len(self.turns)} turns"
            said.append(f"turned {degrees} {took}, {math.degrees(largest.past):.1f} deg past the course{how_many}")
        if self.on_course >= SHORTEST_S:
            long = f"{self.on_course:.0f} s" if self.on_course < 120.0 else f"{self.on_course / 60.0:.0f} min"
            said.append(f"held it within {self.off_deg:.1f} deg for 95 % of {long}")
        said.append(f"rudder {self.travel_deg_s:.2f} deg/s")
        return "; ".join(said)

    def _take_course(self, tick: Tick, step: float) -> None:
        order, self._had_course = tick.order, True
        course = order.heading if math.isfinite(order.heading) else tick.reference.heading
        self.what = f"course {compass_text(course, 1)}".removesuffix(".0")
        # engaged on another course than the boat has: a turn as well, and not a course badly held
        change = wrap(course - (tick.state.heading if self._course is None else self._course))
        if not order.is_led and abs(change) >= TURN_LEAST:
            self._end_turn(tick.now)
            self._turn = (change, tick.now, tick.now, 0.0)
        elif self._course is None and abs(change) < TURN_LEAST and abs(tick.state.rate) * STAYS_S > SETTLED:
            self._swings_out = (math.copysign(1.0, tick.state.rate), tick.now, 0.0)
        if self._course is None or abs(change) >= TURN_LEAST or self._turn is None:
            self._course = course
        if self._turn is not None:
            self._swings_out, self._crosses = None, 0.0
            self._go_on(tick, wrap(tick.state.heading - course))
            return
        if self._is_out(tick, wrap(tick.state.heading - course)):
            return
        if self._crosses:
            self.across = max(self.across, -self._crosses * wrap(tick.state.heading - course))
            self._crosses *= self._crosses * tick.state.rate < 0.0
        off = math.degrees(wrap(tick.state.heading - (tick.reference.heading if order.is_led else course)))
        self.on_course += step
        self._held_travel += self._moved
        self._squares += step * math.degrees(wrap(tick.state.heading - tick.reference.heading)) ** 2
        self._bins[min(int(abs(off) / BIN_DEG), BINS)] += step

    def _is_out(self, tick: Tick, error: float) -> bool:
        if self._swings_out is None:
            return False
        side, began, most = self._swings_out
        past, took = side * error, tick.now - began
        most = max(most, past)
        # one that does not go out has stopped turning, goes the other way, or its rate sensor shows too much
        stays = most <= SETTLED and (side * tick.state.rate <= 0.0 or past < -SETTLED or took >= STAYS_S)
        is_back = past <= SETTLED and (most > SETTLED or stays)
        if is_back or took >= TURN_MOST_S:
            self._swings_out = None
            if most > SETTLED:
                self.out = max(self.out, (took if is_back else math.inf, most))
                self._crosses = side
            return False
        self._swings_out = side, began, most
        return True

    def _go_on(self, tick: Tick, error: float) -> None:
        assert self._turn is not None
        angle, began, outside, past = self._turn
        if abs(error) > SETTLED:
            outside = tick.now
        self._turn = (angle, began, outside, max(past, math.copysign(1.0, angle) * error))
        if tick.now - outside >= STAYS_S or tick.now - began >= TURN_MOST_S:
            self._end_turn(tick.now)

    def _end_turn(self, now: float) -> None:
        if self._turn is None:
            return
        (angle, began, outside, past), self._turn = self._turn, None
        if now - outside >= STAYS_S:
            self.turns.append(Turn(angle, outside - began, past))
        elif now - began >= TURN_MOST_S:
            self.turns.append(Turn(angle, math.inf, past))

    def _take_trial(self, tick: Tick, step: float) -> None:
        if tick.order.kind is OrderKind.ZIGZAG:
            self.what = "zigzag"
        else:
            self.what = f"rudder {math.degrees(tick.order.rudder):+.1f}"
        wanted = tick.demand if tick.order.kind is OrderKind.ZIGZAG else tick.order.rudder
        before, heading = self._trial if self._trial is not None else (0.0, tick.state.heading)
        if abs(wanted - before) > math.radians(1.0):
            self.executes += 1
        self._swung += wrap(tick.state.heading - heading)
        self.swing = (min(self.swing[0], self._swung), max(self.swing[1], self._swung))
        self.trial_seconds += step
        self._way += step * tick.state.speed
        self._trial = (wanted, tick.state.heading)

    def _leave(self, now: float) -> None:
        self._end_turn(now)
        self._course = self._trial = self._swings_out = None
        self._crosses = 0.0


EXECUTES_ENOUGH = 4
TURNED_DEG = 5.0
"""A boat whose heading swings over less than this was held fast, or its rudder does nothing."""


def trial_verdict(steered: Steered, reason: str, *, at_dock: bool = False, least_way: float = 0.0) -> Verdict:
    """Return what a trial is good for. reason: why it ended before its time, "" where it did not. at_dock: the rudder
    alone was to be proved, by a boat that is tied up. least_way: a boat slower than this [m/s] made no way."""
    swing = math.degrees(steered.swing[1] - steered.swing[0])
    orders = f"{steered.executes} rudder order{'' if steered.executes == 1 else 's'}"
    said = (
        f"{orders} in {steered.trial_seconds:.0f} s, the heading swung over {swing:.0f} deg"
        if steered.trial_seconds > 0.0
        else "the rudder was never moved"
    )
    if reason or not steered.trial_seconds:
        early = f"it ended early ({reason}); " if reason else ""
        return Verdict("not enough", f"not enough: {early}{said}; sail it again")
    if at_dock:
        lay = "lay still, as it should" if swing < TURNED_DEG else "did not lie still: tie it up, stop the propeller"
        return Verdict("start", f"good for the rudder alone: {said}; the boat {lay}")
    if steered.way < least_way:
        why = f"the boat made no way ({steered.way:.1f} m/s), and a rudder steers by the water that passes it"
        return Verdict("not enough", f"not enough to identify: {said}; {why}: get under way, and sail it again")
    if swing < TURNED_DEG:
        why = "the boat was held fast, or its rudder does nothing"
        return Verdict("not enough", f"not enough to identify: {said}; {why}: prove the rudder with --at-dock")
    if steered.executes < EXECUTES_ENOUGH:
        return Verdict("start", f"good for a start: {said}; sail it for longer, and identify both together")
    return Verdict("good", f"good: sailed to its end, {said}; next: autopilot identify with this log")
