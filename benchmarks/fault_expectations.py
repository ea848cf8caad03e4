"""What the pilot must do about each fault of the matrix: the limits that every cell is held to.

Times and headings are judged while the pilot steers. In a turn or a trial she turns at up to 20 deg/s, and a fault
carries her further in the same time, and degraded she is steered by headings alone: the limit of the heading is `QUICK`
times as wide there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

from fault_cells import Cell

ENGAGED = ("heading", "turn", "track", "trial", "degraded")
QUICK = {"turn": 4.0, "trial": 3.0, "degraded": 1.5}
ENDED = {"standby": ("standby",), "override": ("override",), "fail-safe": ("failsafe", "override", "fault")}
"""States at the end where the pilot did not steer: it goes on not steering."""


class Expect(NamedTuple):
    """ends: states allowed at the end, `same` is the one before. says: what one of the new alarms must hold, a regular
    expression, '' for nothing. within [s]: by then an alarm or another state. off_deg: limit of the heading."""

    ends: tuple[str, ...]
    says: str = ""
    within: float = math.inf
    off_deg: float = 180.0


def fails_safe(says: str, within: float, off_deg: float = 8.0) -> Expect:
    """Return that steering ends in the fail-safe; a link that then stays silent makes an override of it."""
    return Expect(("failsafe", "override"), says, within, off_deg)


def lets_go(says: str, within: float, off_deg: float = 8.0) -> Expect:
    """Return that the helm is given up to whom it was taken by."""
    return Expect(("override",), says, within, off_deg)


def tells(says: str, within: float, off_deg: float = 8.0) -> Expect:
    """Return that it is said, and steering goes on, in doubt or not."""
    return Expect(("same", "degraded"), says, within, off_deg)


def steers_on(off_deg: float) -> Expect:
    """Return that nothing needs to be said: the fault is borne."""
    return Expect(("same", "degraded"), "", math.inf, off_deg)


def may_end(off_deg: float) -> Expect:
    """Return that the fault is borne, or found out and steering ended: both are right."""
    return Expect(("same", "degraded", "failsafe"), off_deg=off_deg)


def ends_trial(says: str, within: float) -> Expect:
    """Return that an alarm ends the trial: she holds her heading where the same trial without the fault goes on."""
    return Expect(("heading", "degraded"), says, within, 20.0)


HELMLESS = Expect(("override", "failsafe"), "does not obey|rudder", 8.0, 8.0)
"""Nothing that is ordered is done: it shows when the rudder should move, by its report or by the boat."""
FROZEN, LOST, JUMPS = "heading frozen", "heading lost", "heading jumps"
EXPECTED: dict[str, Expect] = {
    "nothing": steers_on(0.0),
    "heading lost": fails_safe(LOST, 1.0, 3.0),
    "heading lost for 0.6 s": steers_on(5.0),
    "heading frozen": fails_safe(FROZEN, 5.0),
    "heading and rate frozen": fails_safe(FROZEN, 5.0, 10.0),
    "heading frozen, compass without rate": fails_safe(FROZEN, 5.0, 10.0),
    "heading jumps by 40 deg": fails_safe(JUMPS, 1.0),
    "heading jumps by 40 deg and back": fails_safe(JUMPS, 1.0),
    "heading drifts by 1 deg/s": steers_on(20.0),
    # three jumps are wanted, and when they come is chance
    "heading noise of 10 deg": fails_safe(JUMPS, 5.0),
    "every tenth heading wild": fails_safe(JUMPS, 5.0),
    "heading is no number": fails_safe(LOST, 1.0, 3.0),
    "readings 1 s late": fails_safe(LOST, 1.0, 3.0),
    "second compass off by 30 deg": tells("compasses disagree", 11.0),
    "second compass drifts by 1 deg/s": steers_on(1.0),
    "first of two compasses lost": tells("compasses is silent", 1.0, 1.0),
    "first of two compasses frozen": tells("stands still", 5.0, 5.0),
    "first of two compasses jumps by 40 deg": tells("jumps", 1.0, 1.0),
    "first of two compasses noisy, 10 deg": tells("jumps", 5.0, 8.0),
    "first of two compasses drifts by 1 deg/s": steers_on(20.0),
    "second of two compasses lost": steers_on(1.0),
    "second of two compasses frozen": tells("stands still", 5.0, 1.0),
    "both compasses lost": fails_safe(LOST, 1.0, 3.0),
    "both compasses frozen": fails_safe(FROZEN, 5.0),
    "rate off by 5 deg/s": tells("rate of turn", 7.0, 10.0),
    "rate frozen": steers_on(20.0),
    "rate reversed": Expect(("failsafe", "degraded"), "rate of turn", 5.0, 30.0),
    "rate noise of 5 deg/s": steers_on(8.0),
    "speed lost": steers_on(1.0),
    "speed frozen": steers_on(1.0),
    "speed three times too high": steers_on(5.0),
    "position lost": steers_on(1.0),
    "position jumps by 200 m": steers_on(1.0),
    # a rudder that need not move shows nothing: what counts on a course that is held is how far she goes off it
    "rudder stuck": may_end(15.0),
    "rudder stuck, with a rudder sensor": fails_safe("rudder does not move", 3.0, 10.0),
    "rudder reversed": fails_safe("wrong way", 6.0, 20.0),
    "rudder reversed, with a rudder sensor": fails_safe("wrong way", 5.0, 15.0),
    # with the next wave these may be found to turn her wrongly, or not at all
    "rudder at a tenth of its rate": may_end(15.0),
    "rudder linkage slipped by 8 deg": may_end(10.0),
    # where a wave pushes her to the same side it is as if she were pushed harder than her rudder holds
    "rudder runs hard over": fails_safe("rudder|pushed", 5.0, 130.0),
    "rudder stops at 5 deg": steers_on(5.0),
    "rudder play of 3 deg": steers_on(8.0),
    # a rudder that trails, or one in the wake of a screw that turns astern, may be found to turn her no more
    "rudder linkage broken": may_end(15.0),
    "rudder sensor lost": steers_on(2.0),
    "rudder sensor frozen": fails_safe("rudder does not move", 15.0, 5.0),
    "rudder sensor off by 8 deg": fails_safe("rudder", 5.0, 8.0),
    "no report of the rudder": lets_go("reports neither", 4.0),
    "engine stopped": steers_on(10.0),
    "engine astern": may_end(45.0),
    "pushed by a gust worth 15 deg of rudder": steers_on(20.0),
    "pushed by more than the rudder can hold": Expect(("same", "degraded", "failsafe"), "pushed", 5.0, 180.0),
    "heels by 35 deg": tells("heeling", 10.0),
    "firmware reboots": lets_go("rebooted", 1.0),
    "somebody chooses HOLD": lets_go("mode HOLD", 1.5),
    "somebody disarms": lets_go("disarmed", 1.5),
    "a hand on the sticks": lets_go("stick", 1.0),
    "the radio's override switch goes off": lets_go("switch", 1.0),
    "overrides ignored": HELMLESS,
    "another ground station steers": lets_go("does not obey", 3.0),
    "battery low": tells("battery", 2.0),
    "geofence breached": tells("fence", 2.0),
    "shallow water": tells("hallow", 2.0),
    "vehicle's clock steps 5 s ahead": steers_on(2.0),
    "vehicle's clock steps 5 s back": lets_go("rebooted", 1.0),
    "heartbeats lost": lets_go("no heartbeat", 9.0),
    "link silent": fails_safe(LOST, 1.0, 3.0),
    "link silent for 2 s": fails_safe(LOST, 1.0, 3.0),
    "link deaf: nothing we send arrives": HELMLESS,
    "link half open": fails_safe(LOST, 1.0, 3.0),
    "link loses 30 %": steers_on(3.0),
    "link 0.3 s late each way": steers_on(5.0),
    "link jitter of 0.3 s": steers_on(5.0),
    "link doubles and reorders 30 %": steers_on(3.0),
    "link damages 30 %": steers_on(4.0),
    "link cuts 30 % short": steers_on(3.0),
    "link flooded with 500 packets/s": steers_on(3.0),
    "the loop stalls for 2 s": steers_on(8.0),
    "the law returns no number": Expect(("fault",), "not finite", 0.2, 1.0),
    "limits broken, law wants 60 deg": Expect(("fault",), "envelope", 0.2, 1.0),
}


BEHIND = may_end(180.0)
"""A boat whose rudder cannot turn her falls behind the turn that she would have made, and may be said not to answer."""
OPEN_LOOP = steers_on(60.0)
"""A zigzag gives rudder and waits for the heading: what slows the rudder shifts the whole of it."""
SPECIAL: dict[tuple[str, str], Expect] = {
    ("first of two compasses jumps by 40 deg", "trial"): ends_trial("jumps", 1.0),
    ("second of two compasses frozen", "trial"): ends_trial("stands still", 5.0),
    ("heels by 35 deg", "trial"): ends_trial("heeling", 10.0),
    ("battery low", "trial"): ends_trial("battery", 2.0),
    ("geofence breached", "trial"): ends_trial("fence", 2.0),
    ("shallow water", "trial"): ends_trial("hallow", 2.0),
    ("rudder at a tenth of its rate", "turn"): BEHIND,
    ("rudder stops at 5 deg", "turn"): BEHIND,
    ("rudder linkage broken", "turn"): BEHIND,
    ("engine stopped", "turn"): BEHIND,
    ("engine astern", "turn"): BEHIND,
    # stuck where it turns her, it is wrong only when the turn, or this side of the zigzag, should end
    ("rudder stuck", "turn"): fails_safe("rudder", 16.0, 45.0),
    ("rudder stuck", "trial"): fails_safe("rudder", 14.0, 30.0),
    ("rudder reversed", "turn"): fails_safe("rudder", 5.0, 15.0),
    ("rudder runs hard over", "turn"): fails_safe("rudder", 12.0, 45.0),
    # a zigzag's rudder rests until the heading is reached, as if a heavy gust had come: she is far off when it is sure
    ("rudder reversed", "trial"): fails_safe("rudder", 10.0, 20.0),
    ("rudder at a tenth of its rate", "trial"): Expect(("same", "failsafe"), off_deg=60.0),
    ("rudder linkage slipped by 8 deg", "trial"): OPEN_LOOP,
    ("rudder stops at 5 deg", "trial"): OPEN_LOOP,
    ("rudder play of 3 deg", "trial"): OPEN_LOOP,
    ("link 0.3 s late each way", "trial"): OPEN_LOOP,
    ("link jitter of 0.3 s", "trial"): OPEN_LOOP,
    # more than the zigzag's own rudder, and turned round by it
    ("pushed by a gust worth 15 deg of rudder", "trial"): may_end(30.0),
    ("pushed by more than the rudder can hold", "trial"): fails_safe("pushed|turns against", 5.0, 30.0),
    # a rudder that is not obeyed shows when the side changes, not before
    ("rudder stuck, with a rudder sensor", "trial"): fails_safe("rudder does not move", 7.0, 10.0),
    ("overrides ignored", "trial"): lets_go("does not obey", 7.0),
    ("link deaf: nothing we send arrives", "trial"): lets_go("does not obey", 7.0),
    # held near a line she weaves, and whether she answers wrongly or not at all is soon told from neither
    ("rudder reversed", "track"): fails_safe("rudder", 5.0, 15.0),
    # no law steers a zigzag, and its rudder keeps to the angle that was ordered until the side changes
    ("the law returns no number", "trial"): steers_on(0.0),
    ("limits broken, law wants 60 deg", "trial"): Expect(("fault",), "envelope", 5.0, 1.0),
    # the wave filter keeps the rudder still on a course that is held: until it moves nothing tells of its sensor
    ("rudder sensor frozen", "heading"): Expect(("same", "failsafe"), off_deg=5.0),
    ("rudder sensor frozen", "track"): Expect(("same", "failsafe"), off_deg=5.0),
    ("rudder stuck, with a rudder sensor", "heading"): Expect(("same", "failsafe"), off_deg=10.0),
    ("rudder stuck, with a rudder sensor", "track"): Expect(("same", "failsafe", "override"), off_deg=10.0),
    ("rudder sensor off by 8 deg", "turn"): fails_safe("rudder", 15.0, 2.0),
    ("speed lost", "track"): tells("", 6.0, 5.0),
    ("position lost", "track"): tells("", 6.0, 5.0),
    # nothing on board can tell which of two places is the true one: the boat goes back to the line
    ("position jumps by 200 m", "track"): tells("", 5.0, 90.0),
}
SECOND: dict[str, Expect] = {
    # what remains is one compass, and a gyro that denies it: steering ends
    "first of two compasses frozen": fails_safe(FROZEN, 5.0, 5.0),
    # the other compass comes at half the pace
    "first of two compasses noisy, 10 deg": tells("jumps", 5.0, 15.0),
    # said already, and steered by heading alone already
    "rate off by 5 deg/s": steers_on(5.0),
    "rate reversed": steers_on(5.0),
    "rate frozen": steers_on(5.0),
    # a rudder that rests more, steered by headings alone, shows less of itself
    "rudder reversed": fails_safe("rudder", 15.0, 30.0),
    "rudder reversed, with a rudder sensor": fails_safe("rudder", 5.0, 15.0),
    "rudder stuck, with a rudder sensor": Expect(("same", "failsafe"), off_deg=15.0),
    "rudder sensor frozen": Expect(("same", "failsafe"), off_deg=10.0),
    "second of two compasses frozen": tells("disagree", 15.0, 1.0),
}
"""In the state *degraded* the gyro is off by 10 deg/s already: of these the second fault goes otherwise than alone."""


def expected(cell: Cell) -> Expect:
    """Return what is expected of a cell."""
    ended = ENDED.get(cell.state)
    if ended is not None:
        return Expect(ended)
    if cell.state == "degraded" and cell.row in SECOND:
        return SECOND[cell.row]
    wanted = SPECIAL.get((cell.row, cell.state), EXPECTED[cell.row])
    return wanted._replace(off_deg=wanted.off_deg * QUICK.get(cell.state, 1.0))


def complaints(cell: Cell) -> Iterator[str]:
    """Yield what is not as expected of a cell."""
    wanted = expected(cell)
    same = {"turn": "heading"}.get(cell.state, cell.state)
    ends = {same if end == "same" else end for end in wanted.ends}
    if cell.ends not in ends:
        yield f"ends in {cell.ends}, not in {' or '.join(sorted(ends))}"
    if wanted.within < math.inf and (cell.detected is None or cell.detected > wanted.within):
        seen = "not seen" if cell.detected is None else f"seen after {cell.detected:.1f} s"
        yield f"{seen}, limit {wanted.within:g} s"
    if cell.off_deg > wanted.off_deg:
        yield f"{cell.off_deg:.0f} deg off, limit {wanted.off_deg:g}"
    if wanted.says and not any(re.search(wanted.says, alarm) for alarm in cell.alarms):
        yield f"says nothing of {wanted.says!r}"
    if cell.again is False:
        yield "does not engage again"
    yield from cell.broken
