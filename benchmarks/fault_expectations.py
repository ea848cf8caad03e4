"""What the pilot must do about each fault of the matrix, from what a skipper can bear.

A kind of need is given to each fault (`NEEDS`), and what is wanted of a cell follows from that need and the state
(`expected`). No number here was measured: where the pilot does not reach one, the cell fails.

Headings are compared with the same run without the fault, as long as the pilot steers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from fault_cells import Cell

ENGAGED = ("heading", "turn", "track", "trial", "degraded")
ENDED = {"standby": ("standby",), "override": ("override",), "fail-safe": ("failsafe", "override", "fault")}
"""States at the end where the pilot did not steer: it goes on not steering."""

FAULT_S = 0.2
"""A value that cannot be is known in the tick that makes it: a rudder that runs at 20 deg/s has moved by 4 deg."""
AT_ONCE_S = 1.0
"""Without a heading nobody steers, and a hand on the helm must have it. A boat may turn by 20 deg in this time [s]."""
HANDS_S = 1.5
"""Mode and arming come with a heartbeat a second: who takes the helm by these has it with the next one."""
WARNED_S = 2.0
"""A warning that another instrument has given already is passed on while it is still the same event."""
REPORTED_S = 3.0
"""A report that contradicts the order: a rudder goes from stop to stop in this time, so it is no longer on its way."""
SOON_S = 5.0
"""A fault that steers the boat wrongly: 5 s at 9 kn are 23 m, three lengths of the boat, at 20 deg off 8 m aside."""
KNOWN_S = 10.0
"""What does no harm by itself, and is to be known before the next thing fails."""
WATCHED_S = 16.0
"""A skipper looks elsewhere for so long, and every fault is watched for so long at least."""

BORNE_DEG = 10.0
"""A good helmsman in a seaway stays within this: nobody needs to know."""
REVERSED_DEG = 15.0
"""A rudder that works the wrong way makes every correction worse."""
NOTICED_DEG = 20.0
"""Off by this while a skipper looks elsewhere, a boat at 9 kn has left a fairway of 50 m."""
MOST_DEG = 45.0
"""Whatever has happened: by then it has been said, and a boat that is still being steered is held."""
SWING_DEG = 20.0
"""The boat turns by this in a second: in a turn or a zigzag one second behind is no danger."""
SWINGING = ("turn", "trial")


class Expect(NamedTuple):
    """What is wanted of a cell.

    ends: states allowed at the end, `same` is the one before. says: what one of the new alarms must hold, a regular
    expression, '' for anything, where one is wanted. within [s]: by then an alarm or another state. unnoticed_deg: so
    far off is the boat at most before that, or, with `soon` [s], is seen so soon. off_deg: limit of the heading for as
    long as the pilot steers; where `off_until_noticed`, before it is noticed.
    """

    ends: tuple[str, ...]
    says: str = ""
    within: float = math.inf
    unnoticed_deg: float = MOST_DEG
    soon: float = 0.0
    off_deg: float = MOST_DEG
    off_until_noticed: bool = False
    swings: bool = True
    """Whether the limits of the heading are wider by `SWING_DEG` where the boat swings anyway."""


GOES_ON = ("same", "degraded")
LETS_GO = ("failsafe", "override")

NOTHING = Expect(("same",), unnoticed_deg=0.0, off_deg=0.0, swings=False)
BORNE = Expect(GOES_ON, unnoticed_deg=BORNE_DEG, off_deg=BORNE_DEG)
"""Steering goes on as if nothing were, and nothing needs to be said."""
WITHSTOOD = Expect(GOES_ON, unnoticed_deg=NOTICED_DEG, off_deg=NOTICED_DEG)
"""A gust that the rudder can hold: a boat let go in it has no helmsman at all."""
OVERWHELMED = Expect((*GOES_ON, "failsafe"), "pushed|turns against|rudder", SOON_S, MOST_DEG, off_until_noticed=True)
"""No rudder holds the boat: what the skipper needs is the word, in time; the pilot may go on doing what can be done."""
CRASHED = Expect(("fault",), "not finite|envelope", FAULT_S, BORNE_DEG, off_deg=BORNE_DEG)


def stops(says: str, within: float) -> Expect:
    """Nothing is left to steer by: the fail-safe. A link that then stays silent makes an override of it."""
    return Expect(LETS_GO, says, within, BORNE_DEG, off_deg=BORNE_DEG)


def yields(says: str, within: float) -> Expect:
    """Somebody else has the helm, or nobody hears us: it is given up."""
    return Expect(("override",), says, within, BORNE_DEG, off_deg=BORNE_DEG)


def announced(says: str, within: float) -> Expect:
    """It is said, and steering goes on, in doubt or not; an alarm that is new ends a trial."""
    return Expect(GOES_ON, says, within, BORNE_DEG, off_deg=BORNE_DEG)


def noticed(says: str = "") -> Expect:
    """It shows only as the boat leaves its course: noticed before the boat is far off, and borne until then."""
    return Expect((*GOES_ON, *LETS_GO), says, unnoticed_deg=NOTICED_DEG)


def reported(says: str) -> Expect:
    """A sensor or report shows it as soon as the rudder should move: noticed in 3 s, or less than 10 deg off."""
    return Expect((*GOES_ON, *LETS_GO), says, unnoticed_deg=BORNE_DEG, soon=REPORTED_S, swings=False)


IGNORED = Expect(LETS_GO, "does not obey|rudder", SOON_S, swings=False)
"""Nothing that is ordered is done."""
REVERSED = Expect(("failsafe",), "rudder|turns against", SOON_S, REVERSED_DEG, off_deg=REVERSED_DEG, swings=False)
HARD_OVER = Expect(("failsafe",), "rudder|pushed", WATCHED_S, swings=False)
"""Where the boat turns to the same side already it may show late: what counts is how far the boat has come round."""

FROZEN, LOST, JUMPS = "heading frozen", "heading lost", "heading jumps"
NEEDS: Mapping[str, Expect] = {
    "nothing": NOTHING,
    "heading lost": stops(LOST, AT_ONCE_S),
    "heading lost for 0.6 s": BORNE,
    "heading frozen": stops(FROZEN, SOON_S),
    "heading and rate frozen": stops(FROZEN, SOON_S),
    "heading frozen, compass without rate": stops(FROZEN, SOON_S),
    "heading jumps by 40 deg": stops(JUMPS, AT_ONCE_S),
    "heading jumps by 40 deg and back": stops(JUMPS, AT_ONCE_S),
    "heading jumps by 12 deg": announced("compass jumps", SOON_S),
    "two compasses on one line, 15 deg apart": announced("compass jumps", SOON_S),
    "heading drifts by 1 deg/s": noticed(),
    "heading noise of 10 deg": stops(JUMPS, SOON_S),
    "every tenth heading wild": stops(JUMPS, SOON_S),
    "heading is no number": stops(LOST, AT_ONCE_S),
    "readings 1 s late": stops(LOST, AT_ONCE_S),
    "compass 0.3 s late": noticed(),
    "gyro 0.3 s late": noticed(),
    "compass and gyro 0.3 s late": noticed(),
    "second compass off by 30 deg": announced("heading monitor: two compasses disagree", KNOWN_S),
    "second compass drifts by 1 deg/s": announced("heading monitor: two compasses disagree", NOTICED_DEG / 1.0),
    "first of two compasses lost": announced("compasses is silent", AT_ONCE_S),
    "first of two compasses frozen": announced("stands still|frozen", SOON_S),
    "first of two compasses jumps by 40 deg": announced("jumps", AT_ONCE_S),
    "first of two compasses noisy, 10 deg": announced("jumps|is noisy", SOON_S),
    "first of two compasses drifts by 1 deg/s": noticed("heading monitor: two compasses disagree"),
    "second of two compasses lost": BORNE,
    "second of two compasses frozen": announced("stands still|disagree", SOON_S),
    "both compasses lost": stops(LOST, AT_ONCE_S),
    "both compasses frozen": stops(FROZEN, SOON_S),
    "rate off by 5 deg/s": noticed("rate of turn"),
    "rate frozen": noticed("rate of turn"),
    "rate reversed": noticed("rate of turn")._replace(within=SOON_S),
    "rate in deg/s for rad/s": noticed("rate of turn")._replace(within=SOON_S),
    "rate noise of 5 deg/s": BORNE,
    "speed lost": BORNE,
    "speed frozen": BORNE,
    "speed frozen, and the engine stops": noticed(),
    "speed three times too high": noticed(),
    "speed a third of the true one": noticed(),
    "speed 0.15 of the true one": noticed(),
    "head stream, speed over the ground alone": noticed(),
    "following stream, speed over the ground alone": noticed(),
    "log lost in a head stream": noticed(),
    "position lost": BORNE,
    "position jumps by 200 m": BORNE,
    "rudder stuck": noticed("rudder|pushed|off heading"),
    "rudder stuck, with a rudder sensor": reported("rudder not responding|does not obey"),
    "rudder stuck before engaging": noticed("rudder|pushed|off heading"),
    "rudder reversed": REVERSED,
    "rudder reversed, with a rudder sensor": REVERSED,
    "rudder at a tenth of its rate": noticed(),
    "rudder at a quarter of its rate": noticed(),
    "rudder at a quarter of its rate, with a rudder sensor": noticed(),
    "rudder 0.3 s late": noticed(),
    "rudder linkage slipped by 8 deg": noticed(),
    "rudder runs hard over": HARD_OVER,
    "rudder stops at 5 deg": noticed(),
    "backlash of 2 deg": BORNE,
    "backlash of 6 deg": noticed(),
    "rudder linkage broken": noticed(),
    "rudder sensor lost": BORNE,
    "rudder sensor frozen": reported("rudder"),
    "rudder sensor off by 8 deg": stops("rudder", SOON_S),
    "no report of the rudder": yields("reports neither", SOON_S),
    "engine stopped": noticed(),
    "engine astern": noticed(),
    "pushed by a gust worth 15 deg of rudder": WITHSTOOD,
    "pushed by more than the rudder can hold": OVERWHELMED,
    "heels by 35 deg": announced("heeling", KNOWN_S),
    "firmware reboots": yields("rebooted", AT_ONCE_S),
    "somebody chooses HOLD": yields("mode HOLD", HANDS_S),
    "somebody disarms": yields("disarmed", HANDS_S),
    "a hand on the sticks": yields("stick", AT_ONCE_S),
    "the radio's override switch goes off": yields("switch", AT_ONCE_S),
    "overrides ignored": IGNORED,
    "another ground station steers": yields("does not obey", REPORTED_S),
    "battery low": announced("battery", WARNED_S),
    "geofence breached": announced("fence", WARNED_S),
    "shallow water": announced("hallow", WARNED_S),
    "vehicle's clock steps 5 s ahead": BORNE,
    "vehicle's clock steps 5 s back": yields("rebooted", AT_ONCE_S),
    "heartbeats lost": yields("no heartbeat", KNOWN_S),
    "link silent": stops(LOST, AT_ONCE_S),
    "link silent for 2 s": stops(LOST, AT_ONCE_S),
    "link deaf: nothing we send arrives": IGNORED,
    "link half open": stops(LOST, AT_ONCE_S),
    "link loses 30 %": BORNE,
    "link 0.3 s late each way": BORNE,
    "link jitter of 0.3 s": BORNE,
    "link doubles and reorders 30 %": BORNE,
    "link damages 30 %": BORNE,
    "link cuts 30 % short": BORNE,
    "link flooded with 500 packets/s": BORNE,
    "the loop stalls for 2 s": BORNE,
    "the law returns no number": CRASHED,
    "limits broken, law wants 60 deg": CRASHED,
}

ON_A_TRACK: Mapping[str, Expect] = {
    "speed lost": announced("", SOON_S),
    "position lost": announced("", SOON_S),
    "position jumps by 200 m": announced("", SOON_S),
}
"""On a track the position is what is steered by; elsewhere it is not looked at."""
IN_A_TRIAL: Mapping[str, Expect] = {
    "the law returns no number": BORNE,
    "limits broken, law wants 60 deg": CRASHED._replace(within=SOON_S),
}
"""No law steers a zigzag: its rudder keeps to the angle that was ordered until the side changes."""
SAID_ALREADY = ("rate ", "gyro ")
"""Faults of the gyro: in the state *degraded* it has been found wrong already and is not steered by."""


def expected(cell: Cell) -> Expect:
    """Return what is wanted of a cell: its fault's need, as the state changes it."""
    if (ended := ENDED.get(cell.state)) is not None:
        return Expect(ended)
    wanted = NEEDS[cell.row]
    if cell.state == "track":
        wanted = ON_A_TRACK.get(cell.row, wanted)
    if cell.state == "trial":
        wanted = IN_A_TRIAL.get(cell.row, wanted)
    if cell.state == "degraded" and cell.row.startswith(SAID_ALREADY):
        wanted = BORNE
    if cell.state == "trial" and wanted is not NOTHING and wanted.ends[:1] == ("same",):
        # an alarm ends a trial: the boat holds its heading
        wanted = wanted._replace(ends=(*wanted.ends, "heading"))
    if cell.state == "degraded" and "degraded" in wanted.ends and wanted not in (BORNE, WITHSTOOD):
        # with a second fault there may be nothing left to steer by
        wanted = wanted._replace(ends=(*wanted.ends, "failsafe"))
    if cell.state in SWINGING and wanted.swings:
        wanted = wanted._replace(
            unnoticed_deg=min(wanted.unnoticed_deg + SWING_DEG, MOST_DEG),
            off_deg=min(wanted.off_deg + SWING_DEG, MOST_DEG),
        )
    return wanted


def complaints(cell: Cell) -> Iterator[str]:
    """Yield what is not as wanted of a cell."""
    wanted = expected(cell)
    same = {"turn": "heading"}.get(cell.state, cell.state)
    ends = {same if end == "same" else end for end in wanted.ends}
    if cell.ends not in ends:
        yield f"ends in {cell.ends}, not in {' or '.join(sorted(ends))}"
    if cell.state in ENGAGED:
        yield from _unnoticed(cell, wanted)
        if cell.off_deg > wanted.off_deg and not wanted.off_until_noticed:
            yield f"{cell.off_deg:.0f} deg off, limit {wanted.off_deg:g} deg"
    if cell.again is False:
        yield "does not engage again"
    yield from cell.broken


def _unnoticed(cell: Cell, wanted: Expect) -> Iterator[str]:
    detected = math.inf if cell.detected is None else cell.detected
    seen = "not noticed" if cell.detected is None else f"noticed after {detected:.1f} s"
    if detected > wanted.within:
        yield f"{seen}, limit {wanted.within:g} s"
    if cell.unnoticed_deg > wanted.unnoticed_deg and detected > wanted.soon:
        limit = f"{wanted.unnoticed_deg:g} deg" + (f" or {wanted.soon:g} s" if wanted.soon else "")
        yield f"{seen}, {cell.unnoticed_deg:.0f} deg off by then, limit {limit}"
    if wanted.says and cell.detected is not None and not any(re.search(wanted.says, alarm) for alarm in cell.alarms):
        yield f"says nothing of {wanted.says!r}"
