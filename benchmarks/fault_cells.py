"""One cell of the matrix: a boat in a state gets a fault; what the pilot did about it, and when."""

from __future__ import annotations

import functools
import itertools
import math
import os
import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, cast

from fault_boat import FaultBoat, Moment, bring_into, deviation_deg, is_engaged
from fault_rows import Row

from autopilot.signals import Mode, Tick
from autopilot.supervision.panel import sentences_of

LATE_LIMIT_S = 15.0
"""So long after the fault is over an order may take to engage again."""


class Cell(NamedTuple):
    """What happened. Times [s] since the fault began, None where nothing was said or done.

    detected: the first new alarm or change of state. left: when the pilot left off steering. ends: the state at the
    end, and what the rudder does then. alarms: the new ones, in order. off_deg: how far the boat had gone from where
    it would have been, while the pilot steered; unnoticed_deg: the same before the fault was detected. again: whether
    the boat could be engaged when all was well again.
    """

    row: str
    state: str
    detected: float | None
    left: float | None
    passed: tuple[str, ...]
    ends: str
    rudder: str
    alarms: tuple[str, ...]
    off_deg: float
    unnoticed_deg: float
    broken: tuple[str, ...]
    again: bool | None


def state_name(tick: Tick) -> str:
    """Return the supervisor's state in a word."""
    return tick.supervisor.name.lower()


def has_cell(row: Row, state: str) -> bool:
    """Return whether there is such a state: where there is no flight controller, nobody but the skipper takes over."""
    return not (state == "override" and row.method == "instruments")


def run_cells(rows: Iterable[Row], states: Iterable[str], workers: int, seed: int = 1) -> Iterator[Cell]:
    """Yield the cell of every row and state, in the sea and with the noise of a seed. Each state is reached once for
    each kind of links, then forked."""
    by_method = sorted(rows, key=lambda row: row.method)
    for method, group in itertools.groupby(by_method, key=lambda row: row.method):
        every = list(group)
        for state in states:
            if chosen := [row for row in every if has_cell(row, state)]:
                yield from _cells_of(method, state, chosen, workers, seed)


def _cells_of(method: str, state: str, rows: list[Row], workers: int, seed: int) -> Iterator[Cell]:
    boat = FaultBoat(method, seed)
    bring_into(boat, state)
    clean: Any = in_child(lambda: _run(boat, None, max(row.window_s for row in rows)))()
    jobs = [functools.partial(cell, boat, row, state, clean) for row in rows]
    for first in range(0, len(jobs), workers):
        # all of these children run at once
        for result in [in_child(job) for job in jobs[first : first + workers]]:
            yield cast(Cell, result())


def in_child(work: Callable[[], object]) -> Callable[[], object]:
    """Begin `work` in a forked process, where it may change everything; what is returned waits for its result."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(reading)
            with os.fdopen(writing, "wb") as out:
                pickle.dump(work(), out)
            code = 0
        except Exception:
            traceback.print_exc()
        finally:
            os._exit(code)
    os.close(writing)

    def result() -> object:
        with os.fdopen(reading, "rb") as file:
            data = file.read()
        os.waitpid(child, 0)
        return pickle.loads(data)

    return result


def _run(boat: FaultBoat, row: Row | None, window_s: float) -> list[Moment]:
    first = len(boat.moments)
    if row is not None:
        row.inject(boat)
    boat.run(window_s)
    return boat.moments[first:]


def cell(boat: FaultBoat, row: Row, state: str, clean: list[Moment]) -> Cell:
    """Give the boat the fault of the row and return what came of it."""
    begin = boat.clock.time
    before = boat.moments[-40:]
    known = {alarm for moment in before for alarm in moment.tick.alarms}
    was = boat.tick
    moments = _run(boat, row, row.window_s)
    clean = [moment for moment in clean if moment.tick.now <= moments[-1].tick.now]
    # what would have been said and done without the fault is not its doing
    known |= {alarm for moment in clean for alarm in moment.tick.alarms}
    usual = {state_name(moment.tick) for moment in clean} | {state_name(was)}
    news = [moment.tick for moment in moments if not known.issuperset(moment.tick.alarms)]
    changed = [moment.tick for moment in moments if state_name(moment.tick) not in usual]
    left = next((m.tick.now - begin for m in moments if is_engaged(was) and not is_engaged(m.tick)), None)
    signs = [ticks[0].now - begin for ticks in (news, changed) if ticks]
    detected = min(signs, default=None)
    steered_until = begin + (math.inf if left is None else left)
    off = [(time, degrees) for time, degrees in deviation_deg(moments, clean) if time <= steered_until]
    unnoticed_until = begin + (math.inf if detected is None else detected)
    last = moments[-1].tick
    broken = tuple(_broken(moments, state, boat))
    again = _engages_again(boat) if state == "heading" else None
    return Cell(
        row=row.name,
        state=state,
        detected=detected,
        left=left,
        passed=tuple(name for name, _ in itertools.groupby(state_name(moment.tick) for moment in moments)),
        ends=state_name(last),
        rudder=_rudder(moments),
        alarms=sentences_of(dict.fromkeys(alarm for tick in news for alarm in tick.alarms if alarm not in known)),
        off_deg=max((degrees for _, degrees in off), default=0.0),
        unnoticed_deg=max((degrees for time, degrees in off if time <= unnoticed_until), default=0.0),
        broken=broken,
        again=again,
    )


def _rudder(moments: list[Moment]) -> str:
    last = moments[-1].tick
    if last.mode is Mode.ENGAGED:
        return "steers"
    held = [moment.tick for moment in moments if moment.tick.mode is not Mode.ENGAGED and moment.tick.command.engaged]
    if last.command.engaged:
        return "held amidships" if abs(last.command.angle) < 1.0e-6 else "held"
    if held:
        return f"held {held[-1].now - held[0].now:.0f} s, released"
    return "released"


def _broken(moments: list[Moment], state: str, boat: FaultBoat) -> Iterator[str]:
    """What no run may do, whatever has failed."""
    envelope = boat.config.boat.limits
    last: Tick | None = None
    for tick, _, _ in moments:
        command = tick.command
        if not math.isfinite(command.angle):
            yield f"{tick.now:.2f} s: a command that is no number"
        if abs(command.angle) > envelope.angle_max + 1.0e-9:
            yield f"{tick.now:.2f} s: a command of {math.degrees(command.angle):.1f} deg"
        if last is not None and last.command.engaged and command.engaged:
            rate = abs(command.angle - last.command.angle) / max(tick.now - last.now, 1.0e-6)
            if rate > envelope.rate_max + 1.0e-6:
                yield f"{tick.now:.2f} s: a command that moves at {math.degrees(rate):.1f} deg/s"
        if tick.mode in (Mode.STANDBY, Mode.OVERRIDE) and command.engaged:
            yield f"{tick.now:.2f} s: {tick.mode.name} commands the rudder"
        if tick.mode is Mode.ENGAGED and state in ("standby", "override", "fail-safe"):
            yield f"{tick.now:.2f} s: it engages by itself"
        last = tick


def _engages_again(boat: FaultBoat) -> bool | None:
    """All is put right by people; then an order must engage."""
    pilot = boat.session._pilot
    boat.world.faults.clear(boat.world.time)
    boat.hooks.clear()
    pilot._config = boat.config
    boat.run(2.0)
    if boat.firmware is not None:
        boat.firmware.set_mode(0)
        boat.firmware.set_armed(True)
    boat.type_line("s")
    boat.run(3.0)
    boat.type_line("e")
    return boat.run(LATE_LIMIT_S, until=is_engaged)
