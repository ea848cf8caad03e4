"""The course watch: a boat off the course that it is to hold, one that swings, spins, or goes round and round.

No model tells why: the file may have the wrong boat, speed, rudder or delay, and what the loop does is what counts. A
loop that is unstable by its own rudder ends in a limit cycle: the order goes from one side far to the other, again and
again, and the heading with it. From stop to stop that is a loss of control, however far the boat swings and however
irregular that is: gusts and a way that comes and goes make it so. A heavy sea can look like that. So the pilot is made
soft first (SOFTER): it supposes a boat that answers so many times as much, which has a quarter of the gain and half the
bandwidth and with which a boat of up to so many times its model's liveliness is stable again; if need be, softer still
(SOFTEST). In a sea the rudder then rests more than before, and nothing else comes of it. Swings that the rudder does
not account for are a sea's, or gusts', however slow the rudder is against them: they are none of steering's. Where the
swings by the rudder go on all the same, steering makes them, and ends.

By the model no steady turn is quicker than that with the rudder hard over. One that is SPIN times as quick for a while,
as if twice the rudder pushed beside it, and to the rudder's side, is another boat's; RUSH times, and the law is made
soft. A boat that is known to be pushed harder than its rudder is not taken to go round by itself. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, shortest_turn, wrap
from autopilot.estimation.path_delay import orders_before
from autopilot.estimation.tuning import PATH_GRID, PATH_STEP, WAVE_FREQUENCY_LEAST
from autopilot.models.norrbin import Norrbin, at_speed_ratio, damping
from autopilot.signals import AlarmEvent
from autopilot.supervision import rudder_watch
from autopilot.supervision.alarms import AT_STOP
from autopilot.supervision.monitor_input import AlarmLimits, History, MonitorInput, is_hard_over, reads_low, speed_ratio
from autopilot.supervision.tuning import (
    ALIKE,
    AT_THE_STOP,
    BACK_ON_COURSE,
    BEHIND,
    BEYOND,
    BY_RUDDER,
    BY_RUDDER_LATER,
    CIRCLES,
    CIRCLES_DOUBTED,
    GROWS,
    HALF_SWINGS,
    LEAST_TIME,
    LED_PAST,
    NEW_COURSE,
    NEWS,
    ON_COURSE,
    ON_COURSE_TIME,
    OUTRUNS,
    OUTRUNS_UNSTABLE,
    PAUSE,
    RUSH,
    SOFTER,
    SPEED_SWINGS,
    SPIN,
    SPIN_TIME,
    SUSPECT_SWINGS,
    SWEEP,
    SWING,
    WAY_KEPT,
)

SOFTEST = SOFTER * SOFTER
"""No law is softer."""
STOP_TO_STOP = 2.0 * AT_THE_STOP
"""A sweep of the rudder between both of its stops [rudder's limits]."""
LONGEST_WAVE_S = math.pi / WAVE_FREQUENCY_LEAST
"""Half the period of the longest wave that is estimated [s]."""
RATE_MOST = 10.0
"""No boat turns as fast [rad/s]: such a step is the compass's, or the estimate's that begins anew."""
NO_MORE = 1.0e-9
"""A column of which less is left [share of its square] is a sum of the others."""
DAY_S = 86400.0
SEA_SIGMAS = math.sqrt(2.0 * math.log(DAY_S / (2.0 * LONGEST_WAVE_S)))
"""Of a rate of turn so many standard deviations of the sea's may be the sea's, the largest of a day's waves (Rayleigh):
of the sea that was there when the heading was ordered, for a boat that steering swings since then looks like one."""


class Away(NamedTuple):
    """since [s]: since when the boat has been off heading, nan: it is on it; back [s]: since when it has been within
    the limit again, nan: it is not; side: to which it was off last, 1 or -1; is_off: whether that is an alarm."""

    since: float = math.nan
    back: float = math.nan
    side: float = 0.0
    is_off: bool = False


ON_HEADING = Away()


class OffCourse(NamedTuple):
    """away: whether the boat is off its course; reported [rad]: how far it was when that was said; found: what is
    said."""

    away: Away = ON_HEADING
    reported: float = math.nan
    found: AlarmEvent | None = None


ON_ITS_COURSE = OffCourse()


def course_step(limits: AlarmLimits, time_constant: float, before: Away, now: float, error: float) -> Away:
    """Return whether the boat of such a time constant [s] is off heading, by what this returned before and the
    heading's `error` [rad] off the course ordered.

    It is on its course again when it has been within the limit for as long as makes it off, or as it takes to settle: a
    boat that comes near and leaves again has not held it. One that goes through it and leaves to the other side swings,
    and need not be waited for.
    """
    since, back, side, is_off = before
    limit = limits.off_course * (BACK_ON_COURSE if is_off else 1.0)
    # written so that an error that is no number is no reason to be quiet
    if not -limit <= error <= limit:
        since, to = since if since == since else now, -1.0 if error < 0.0 else 1.0
        swings = back == back and to == -side
        return Away(since, math.nan, to, is_off or swings or now - since >= limits.off_course_time)
    if since != since:
        return before
    back = back if back == back else now
    settles = ON_COURSE_TIME * (time_constant if time_constant > 1.0 else 1.0)
    settles = settles if settles < limits.off_course_time else limits.off_course_time
    return ON_HEADING if now - back >= settles else Away(since, back, side, is_off)


def off_course_step(
    limits: AlarmLimits, before: OffCourse, seen: MonitorInput, aside: tuple[float, bool], side: float
) -> OffCourse:
    """Judge a tick: how far the boat is off, which way, and whether the rudder is at its stop. aside: how far the
    heading is off [rad], and whether another was ordered in this tick.

    While a turn may last a boat on its way to its course is on it, and one that is past it by so much for LED_PAST has
    led past; side: to which it turned. From then on it may swing to both sides, until another course is ordered.
    """
    error, is_new = aside
    if limits.off_course == math.inf or not (seen.holds_course or seen.follows):
        return ON_ITS_COURSE
    if not seen.holds_course:
        since = before.away.since
        if side * error <= 0.0 and (is_new or since != since):
            return ON_ITS_COURSE
        limits = limits._replace(off_course_time=min(LED_PAST, limits.off_course_time))
        error = error if abs(error) < 0.5 * math.pi else 0.0
    away = course_step(limits, seen.model.time_constant, before.away, seen.now, error)
    if not away.is_off:
        return OffCourse(away)
    is_back = away.back == away.back
    if before.found is not None and (is_back or not abs(error - before.reported) > NEWS):
        return OffCourse(away, before.reported, before.found)
    off = f"by {math.degrees(abs(error)):.0f} deg to {'starboard' if error > 0.0 else 'port'}"
    return OffCourse(away, error, AlarmEvent("off_course", off, AT_STOP if is_hard_over(seen) else ""))


Sums = tuple[float, float, float, float, float, float, float, float, float, float]
OfOrders = tuple[float, float, float, float, float, float]
LATER = tuple(PATH_STEP * step for step in range(0, PATH_GRID, 2))
"""Orders come up to so much later [s] than they were given where swings are looked at."""


class ByRudder(NamedTuple):
    """How much of the rate of turn the rudder accounts for, whatever the boat: R^2 of r' = a delta + b r + c.

    By least squares of its integral r = a D + b psi + c t + d, D' = delta, which does not differentiate noise. At the
    one frequency of a limit cycle a delay is a part of a and b. From stop to stop, in swings of a few delays, it is
    not: there D is of the orders of one of LATER before, with which it accounts for most. What gusts and waves do
    beside the rudder is none.

    time [s] and turned psi [rad] since it began; sums: of the products of two of the columns 1, t, psi and r, each pair
    once, the first of them the number of ticks; orders: for each of LATER D [rad s], and the sums of it with 1, t, psi,
    D and r.
    """

    time: float = 0.0
    turned: float = 0.0
    sums: Sums = (0.0,) * 10
    orders: tuple[OfOrders, ...] = ((0.0,) * 6,) * len(LATER)

    def with_tick(self, step: float, turned: float, given: tuple[float, ...], rate: float) -> ByRudder:
        """Return the same with a tick `step` [s] later, in which the boat `turned` [rad]; what is between the first and
        the tick before it does not count. given: the orders [rad] of LATER before."""
        time, psi, (ticks, st, sp, sr, stt, stp, str_, spp, spr, srr), orders = self
        if ticks > 0.0:
            time, psi = time + step, psi + turned
        else:
            step = 0.0
        sums = (
            ticks + 1.0,
            st + time,
            sp + psi,
            sr + rate,
            stt + time * time,
            stp + time * psi,
            str_ + time * rate,
            spp + psi * psi,
            spr + psi * rate,
            srr + rate * rate,
        )
        added = []
        for (ordered, so, sto, spo, soo, sor), rudder in zip(orders, given, strict=True):
            d = ordered + rudder * step
            added.append((d, so + d, sto + time * d, spo + psi * d, soo + d * d, sor + d * rate))
        return ByRudder(time, psi, sums, tuple(added))

    def fit(self, later: int = 0) -> tuple[float, float]:
        """Return R^2, 0 where nothing has turned: what elimination leaves of the last column's square; and a [1/s^2],
        K/T of a boat that nothing else turns. later: which of LATER."""
        ticks, st, sp, sr, stt, stp, str_, spp, spr, srr = self.sums
        _, so, sto, spo, soo, sor = self.orders[later]
        left = [
            [ticks, st, sp, so, sr],
            [st, stt, stp, sto, str_],
            [sp, stp, spp, spo, spr],
            [so, sto, spo, soo, sor],
            [sr, str_, spr, sor, srr],
        ]
        before = [left[index][index] for index in range(5)]
        total = 0.0
        for pivot in range(4):
            if left[pivot][pivot] > NO_MORE * before[pivot]:
                for row in range(pivot + 1, 5):
                    part = left[row][pivot] / left[pivot][pivot]
                    left[row] = [one - part * other for one, other in zip(left[row], left[pivot], strict=True)]
            total = total or left[4][4]
        answer = left[3][4] / left[3][3] if left[3][3] > NO_MORE * before[3] else 0.0
        return 1.0 - left[4][4] / total if total > 0.0 else 0.0, answer

    def accounts(self) -> bool:
        """Return whether steering makes the swings: the rudder accounts for them at once, or nearly all of them later,
        for a sea fits one of so many delays more easily."""
        if self.fit()[0] >= BY_RUDDER:
            return True
        later = (self.fit(later) for later in range(1, len(LATER)))
        return any(share >= BY_RUDDER_LATER and answer > 0.0 for share, answer in later)


def orders_given(history: History, time: float, newest: float) -> tuple[float, ...]:
    """Return the orders [rad] that were given by the tick at `time` [s], and so much of LATER before: the `newest` for
    all of them where one is not remembered."""
    times, _, commands, ticks = history
    given = orders_before((times, commands, ticks), time)
    return (newest,) * len(LATER) if given is None else (newest, *given[2::2])


class Swings(NamedTuple):
    """sweeps: how many sweeps of the order there were in a row, each with a swing of the heading. swept [s]: the last
    turning point of the order; side: to which it has gone since, and extreme [rad] how far, nan: nothing is known yet;
    turned [rad]: the heading since it began; low and high [rad]: its span since the turning point, and that of the
    sweep before; swung [rad] and lasted [s]: the last swing; by_rudder: None before the first turning point."""

    swept: float = -math.inf
    side: int = 0
    extreme: float = math.nan
    turned: float = 0.0
    low: float = 0.0
    high: float = 0.0
    low_before: float = 0.0
    high_before: float = 0.0
    swung: float = 0.0
    lasted: float = 0.0
    sweeps: int = 0
    by_rudder: ByRudder | None = None


NO_SWINGS = Swings()


class Quickest(NamedTuple):
    """The quickest model of a boat, see `quickest_model`, with the model and the trial's speed [m/s] that it is of."""

    of: Norrbin
    trial_speed: float
    model: Norrbin


def quickest_for(seen: MonitorInput, before: Quickest | None) -> Quickest:
    """Return what counts as the quickest: what it was `before`, as long as neither boat nor speed has changed."""
    if before is not None and before.of is seen.model and before.trial_speed == seen.trial_speed:
        return before
    return Quickest(seen.model, seen.trial_speed, quickest_model(seen))


class Turn(NamedTuple):
    """What the boat has done since the tick before: step [s], turned [rad]; how far the heading ordered has moved
    [rad]; off [rad]: how far the boat is off it; quickest: the model at the trial's speed where that is the quicker
    one; given [rad]: see `orders_given`."""

    step: float
    turned: float
    led: float
    off: float
    quickest: Norrbin
    given: tuple[float, ...]


def turn_since(
    before: tuple[float, float, float], seen: MonitorInput, quickest: Norrbin, given: tuple[float, ...]
) -> Turn:
    """Return what the boat has done since the tick before, by its time [s], heading and the one ordered [rad]. given:
    see `orders_given`."""
    time, heading, wanted = before
    is_at, order = seen.state.heading, seen.wanted
    turned, led, off = is_at - heading, 0.0 if order == wanted else shortest_turn(wanted, order), is_at - order
    turned = turned if -PI < turned <= PI else wrap(turned)
    return Turn(seen.now - time, turned, led, off if -PI < off <= PI else wrap(off), quickest, given)


def swings_step(before: Swings, sweep: float, seen: MonitorInput, turn: Turn) -> Swings:
    """Return the count after a tick, of sweeps of at least `sweep` [rudder's limits]: of less than STOP_TO_STOP those
    that swing the heading alike, else all."""
    # a rudder that waits for way a moment is a part of the swing that took it
    if not (seen.follows or (seen.waits and seen.steers)):
        return NO_SWINGS
    now, order = seen.now, seen.rudder
    swept, side, extreme, turned, low, high, low_before, high_before, swung, lasted, count, by_rudder = before
    is_paused = now - swept > PAUSE[0] + PAUSE[1] * seen.model.time_constant
    # a rudder that stood while the loop stalled swings the boat, too: late ticks are an alarm of their own
    if seen.is_late or is_paused or not -NEW_COURSE < turn.led < NEW_COURSE:
        return Swings(now, extreme=order)
    turned += turn.turned
    low = turned if turned < low else low
    high = turned if turned > high else high
    if by_rudder is not None:
        by_rudder = by_rudder.with_tick(turn.step, turn.turned, turn.given, seen.state.rate)
    if side == 0:
        side = 1 if order > extreme else -1 if order < extreme else 0
    elif side * (order - extreme) >= 0.0:
        extreme = order
    elif side * (extreme - order) >= sweep * seen.angle_max:
        # swept from there to the other side: that was a turning point. The heading may trail by half a sweep
        swing, lasts = max(high, high_before) - min(low, low_before), now - swept
        counts, is_alike = lasts >= LEAST_TIME * turn.quickest.time_constant, True
        if sweep < STOP_TO_STOP:
            goes_on = swung < ALIKE * swing and swing < GROWS * swung
            is_alike = goes_on and lasts < ALIKE * lasted and lasted < ALIKE * lasts
            counts = counts and swing >= SWING
        is_beyond_rudder = swing > BEYOND * widest_swing(turn.quickest, seen.angle_max, lasts)
        worth = 2 if is_beyond_rudder and lasts > LONGEST_WAVE_S else 1
        count = 0 if not counts else count + worth if is_alike else 1
        if count >= SUSPECT_SWINGS and by_rudder is not None and not by_rudder.accounts():
            count = 0
        # a limit cycle does not die away: as far as the farthest
        swung = max(swing, swung) if count > 1 else swing
        by_rudder = by_rudder if count > 1 else ByRudder()
        side, extreme, swept, lasted = -side, order, now, lasts
        low_before, high_before, low, high = low, high, turned, turned
    return Swings(swept, side, extreme, turned, low, high, low_before, high_before, swung, lasted, count, by_rudder)


def is_quicker(throws: Swings, seen: MonitorInput) -> bool:
    """Return whether a boat that goes from stop to stop by its own rudder answers rather as at the trial's speed than
    as at the one, lower, that is read: K/T goes with the square of the speed, and half way is the geometric mean."""
    if throws.sweeps < SPEED_SWINGS or throws.by_rudder is None:
        return False
    share, answer = throws.by_rudder.fit()
    return share >= BY_RUDDER and answer * speed_ratio(seen) > seen.model.gain / seen.model.time_constant


def quickest_model(seen: MonitorInput) -> Norrbin:
    """Return the model at the trial's speed where that is the quicker one: a speed that reads too low makes any boat
    slow."""
    ratio = speed_ratio(seen)
    return seen.model if ratio >= 1.0 else at_speed_ratio(seen.model, 1.0 / ratio)


def widest_swing(model: Norrbin, angle_max: float, lasted: float) -> float:
    """Return how far [rad] the boat swings whose rudder stands at one stop and the other for `lasted` [s] each.

    By the first harmonic of that rudder, 4/pi angle_max at w = pi/lasted: 2 K 4/pi angle_max/(w |n1 + i w T|). n3 would
    make it less.
    """
    pace = math.pi / max(lasted, 1.0e-3)
    return 8.0 / math.pi * model.gain * angle_max / (pace * math.hypot(model.n1, pace * model.time_constant))


class Circles(NamedTuple):
    """off [rad]: how far the boat has turned away from the heading that is ordered, whole turns with it, nan: none is;
    begun [rad]: how far it was off when that was ordered; since [s]: it is near its course, nan: it is not."""

    off: float = math.nan
    begun: float = 0.0
    since: float = math.nan


NO_CIRCLES = Circles()


def circles_step(before: Circles, seen: MonitorInput, turn: Turn) -> Circles:
    """Add up a tick's turns."""
    if not seen.follows:
        return NO_CIRCLES
    off, begun, since = before
    led, near, most = turn.led, turn.off, seen.angle_max
    if off != off or led > NEW_COURSE or led < -NEW_COURSE:
        off, begun = near, abs(near)
    elif -most <= seen.push <= most or reads_low(seen):
        # what is pushed round by more than its rudder is not steered round
        off += turn.turned - led
    if near > ON_COURSE or near < -ON_COURSE:
        since = math.nan
    elif since != since:
        since = seen.now
    elif seen.now - since >= ON_COURSE_TIME and seen.now - since >= ON_COURSE_TIME * seen.model.time_constant:
        off = near
    return Circles(off, begun, since)


def goes_round(circles: Circles, is_doubted: bool) -> bool:
    """Return whether it has gone round and round; is_doubted: whether its speed is."""
    return abs(circles.off) > (CIRCLES_DOUBTED if is_doubted and circles.begun < BEHIND else CIRCLES)


class Spin(NamedTuple):
    """A rate of turn [rad/s], by the heading alone, that is quicker than a rudder hard over makes it by the model.

    is_begun: a heading came before; wanted [rad]: what was ordered when by_sea [rad/s], the sea's largest rate of turn,
    was taken. is_fast, rushes: it is SPIN, or RUSH, times too fast; outruns_speed: OUTRUNS times what goes with the
    speed; speed_ratio: the quickest of late, for a boat that loses way in a turn still turns as at the speed that it
    had.
    """

    is_begun: bool = False
    wanted: float = math.nan
    by_sea: float = 0.0
    rate: float = 0.0
    is_fast: bool = False
    rushes: bool = False
    outruns_speed: bool = False
    speed_ratio: float = 0.0


def spin_step(before: Spin, seen: MonitorInput, turn: Turn) -> Spin:
    """Judge a tick. A speed that reads too low would make any turn too fast: the model counts at the trial's speed at
    least."""
    is_begun, wanted, by_sea, rate, _, _, _, recent = before
    # see `speed_ratio`
    by_speed = now = seen.model.reference_speed / seen.trial_speed if seen.trial_speed > 0.0 else 1.0
    if recent > now and turn.step > 0.0:
        now += math.exp(-turn.step / (WAY_KEPT * seen.model.time_constant)) * (recent - now)
    if not seen.steers or not is_begun or not turn.step > 0.0:
        return Spin(True, wanted, by_sea, rate if seen.steers else 0.0, False, False, False, now)
    if wanted != seen.wanted and not abs(shortest_turn(wanted, seen.wanted)) < NEW_COURSE:
        # what is there before the first order is not known to be the sea's
        known = seen.state.wave_deviation * seen.state.wave_frequency
        by_sea, wanted = 0.0 if math.isnan(wanted) else SEA_SIGMAS * known, seen.wanted
    turned = turn.turned / turn.step
    if turned > RATE_MOST or turned < -RATE_MOST:
        turned = 0.0
    quickest, model, rudder_most = turn.quickest, seen.model, seen.angle_max
    lasts = SPIN_TIME[1] * quickest.time_constant
    rate -= math.expm1(-turn.step / (lasts if lasts > SPIN_TIME[0] else SPIN_TIME[0])) * (turned - rate)
    is_steered, is_stable = rate * seen.rudder > 0.0, model.n1 > 0.0
    if not is_steered and is_stable:
        return Spin(True, wanted, by_sea, rate, False, False, False, now)
    # a wrong speed does what a sea does, and is doubted rather than borne
    by_rudder = math.copysign(max(abs(rate) - (0.0 if reads_low(seen) else by_sea), 0.0), rate)
    # a course-unstable boat outruns its rudder, against it too, where it is steered by a wrong speed
    had_way = model if now == by_speed else at_speed_ratio(model, now / by_speed)
    outruns = is_beyond(had_way, by_rudder / (OUTRUNS if is_stable else OUTRUNS_UNSTABLE), rudder_most)
    rushes = is_steered and is_beyond(quickest, by_rudder / RUSH, rudder_most)
    is_fast = is_steered and is_beyond(quickest, by_rudder / SPIN, rudder_most)
    return Spin(True, wanted, by_sea, rate, is_fast, rushes, outruns, now)


def is_beyond(model: Norrbin, rate: float, angle_max: float) -> bool:
    """Return whether no steady turn is as quick as `rate` [rad/s]: its damping is more than all the rudder."""
    return math.copysign(1.0, rate) * damping(model, rate) > model.gain * angle_max


class State(NamedTuple):
    """What the course watch remembers; time [s], heading and wanted [rad] of the tick before. softer: the law is to
    order as for a boat that answers so many times as much; hunts: because it swings; side: to which the newest course
    lay, 1 or -1."""

    time: float = math.nan
    heading: float = math.nan
    wanted: float = math.nan
    off_course: OffCourse = ON_ITS_COURSE
    sweeps: Swings = NO_SWINGS
    throws: Swings = NO_SWINGS
    circles: Circles = NO_CIRCLES
    spin: Spin = Spin()
    softer: float = 1.0
    hunts: bool = False
    quickest: Quickest | None = None
    side: float = 0.0


def update(
    limits: AlarmLimits, before: State, seen: MonitorInput, rudder: rudder_watch.State, history: History
) -> tuple[State, tuple[AlarmEvent, ...], bool]:
    """Judge a tick, of which the `rudder` watch has found so much; return what is remembered, what is found, and
    whether it contradicts the speed. history: what was ordered.

    What steering itself does to the boat: a soft law is tried first, then steering ends. A speed that is too low is the
    likeliest cause of swings, the trial's speed the worst that is plausible, so it is doubted first; then less is
    ordered. A course-unstable boat would be lost with less than it needs against its own tendency to turn.
    """
    time, heading, wanted, off_course, sweeps, throws, circles, spin, softer, hunts, quickest, side = before
    quickest = quickest_for(seen, quickest)
    looks = sweeps.by_rudder is not None or throws.by_rudder is not None
    given = orders_given(history, time, seen.rudder) if looks else ()
    turn = turn_since((time, heading, wanted), seen, quickest.model, given)
    if not seen.steers:
        softer, hunts = 1.0, False
    elif rudder.asks_less:
        softer = max(softer, SOFTER)
    sweeps = swings_step(sweeps, SWEEP, seen, turn)
    throws = swings_step(throws, STOP_TO_STOP, seen, turn)
    spin = spin_step(spin, seen, turn)
    # no law is softer, and to try it once more would begin the count of everything anew
    fast = spin.rate if spin.is_fast or (spin.rushes and softer >= SOFTEST) else 0.0
    is_stable, contradicts_speed = seen.model.n1 > 0.0, False
    is_soft, swept, thrown = softer > 1.0 or not is_stable, sweeps.sweeps, throws.sweeps
    swings = (is_soft and thrown >= HALF_SWINGS) or (softer >= SOFTEST and swept >= SUSPECT_SWINGS)
    if not swings:
        suspect = swept >= SUSPECT_SWINGS or thrown >= SUSPECT_SWINGS or (seen.follows and spin.rushes)
        contradicts_speed = (suspect or spin.outruns_speed or is_quicker(throws, seen)) and reads_low(seen)
        if suspect and not contradicts_speed:
            hunts, softer = True, min(SOFTER * softer, SOFTEST) if is_stable else softer
        if contradicts_speed or (suspect and is_stable):
            sweeps, throws, spin = NO_SWINGS, NO_SWINGS, Spin()
    circles = circles_step(circles, seen, turn)
    # straight behind a course lies to either side: the turn goes over that to which the boat then comes
    if side == 0.0 or turn.led > NEW_COURSE or turn.led < -NEW_COURSE or not -BEHIND < turn.off < BEHIND:
        side = -math.copysign(1.0, turn.off)
    off_course = off_course_step(limits, off_course, seen, (turn.off, turn.led != 0.0), side)
    found: tuple[AlarmEvent, ...] = (AlarmEvent("swinging"),) if swings else ()
    if hunts and not rudder.other:
        found += (AlarmEvent("hunting"),)
    if fast:
        found += (AlarmEvent("too_quick", f"turning at {math.degrees(abs(fast)):.0f} deg/s"),)
    if abs(circles.off) > CIRCLES_DOUBTED and goes_round(circles, rudder.doubts_speed or contradicts_speed):
        found += (AlarmEvent("circling"),)
    if seen.speeds_apart > 0.0:
        found += (AlarmEvent("speeds_disagree"),)
    if off_course.found is not None:
        found += (off_course.found,)
    after = State(
        seen.now,
        seen.state.heading,
        seen.wanted,
        off_course,
        sweeps,
        throws,
        circles,
        spin,
        softer,
        hunts,
        quickest,
        side,
    )
    return after, found, contradicts_speed
