"""The faults of the matrix, and its cells: a boat in a state gets a fault; what the pilot did about it, and when."""

from __future__ import annotations

import functools
import itertools
import math
import os
import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, cast

from fault_boat import ALONE_S, BEGINNINGS, FaultBoat, Injected, Moment, bring_into, deviation_deg, engage, is_engaged
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.control import registry
from autopilot.control.law import LawInForce
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.signals import Mode, Tick
from autopilot.supervision.panel import sentences_of
from sitl.registry import FaultKind, Source

STALL_S = 2.0
WINDOW_S = 16.0
"""So long a fault is watched."""
DRIFT_S = 25.0
"""One that grows by 1 deg/s is watched for so long: it is 20 deg after 20 s."""
STREAM_M_S = 3.2
"""0.7 of the boat's speed; it is met within `EDGE_S` [s]."""
EDGE_S = 3.0
LATE_S = 0.3


class Row(NamedTuple):
    """A fault by its name in the matrix: what is injected, over which links, by the simulator or by `do`; is_before: it
    is there before the pilot steers, and counts from then on."""

    name: str
    faults: tuple[Injected, ...] = ()
    method: str = "companion"
    do: Callable[[FaultBoat], None] | None = None
    window_s: float = WINDOW_S
    is_before: bool = False

    def inject(self, boat: FaultBoat) -> None:
        """Begin the fault now."""
        for fault in self.faults:
            boat.add(fault)
        if self.do is not None:
            self.do(boat)


def simple(
    name: str, kind: FaultKind, size: float | None = None, method: str = "companion", end: float = math.inf
) -> Row:
    """Return the row of one fault of the simulator, until `end` [s] after it began."""
    return Row(name, (Injected(kind, size, 0.0, end),), method)


def of_two(name: str, kind: FaultKind, size: float | None = None, source: Source = "first") -> Row:
    """Return the row of a fault that one of two compasses has."""
    return Row(name, (Injected(kind, size, 0.0, math.inf, source),), "both")


def taking_turns(name: str, apart_deg: float, each_s: float) -> Row:
    """Return the row of two compasses that reach the pilot by one name, one after the other for so long each."""
    begins = (2.0 * each_s * number for number in range(math.ceil(0.5 * WINDOW_S / each_s)))
    return Row(name, tuple(Injected("heading_jump", apart_deg, begin, begin + each_s) for begin in begins))


def late(name: str, *kinds: FaultKind) -> Row:
    """Return the row of what is late without its time stamps telling so; the delay sets in within a second."""
    return Row(name, tuple(Injected(kind, LATE_S, ramp=1.0) for kind in kinds))


def stream(speed_m_s: float) -> Injected:
    """Return the edge of a stream that sets the boat ahead, or astern for a negative speed."""
    return Injected("stream", speed_m_s, ramp=EDGE_S)


def constant_demand(rudder: float) -> LawInForce:
    """Return a law that returns nonsense: it says `rudder` [rad] whatever it is given."""
    return LawInForce(
        registry.LAWS[registry.TRIAL_LAW]._replace(name="nan", step=lambda _, memory, __: (rudder, memory)),
        registry.NoGains(),
    )


def law_of_no_numbers(boat: FaultBoat) -> None:
    """Put a law in that returns no number."""
    pilot = boat.session._pilot
    pilot._config = pilot._config._replace(law=constant_demand(math.nan))


def limits_broken(boat: FaultBoat) -> None:
    """Let the law's own limits pass 60 deg of rudder, so that only the supervisor's envelope stands."""
    pilot = boat.session._pilot
    config = pilot._config
    wide = config.boat.limits._replace(angle_max=math.radians(60.0), rate_max=math.inf)
    pilot._config = config._replace(
        law=constant_demand(math.radians(60.0)),
        boat=config.boat._replace(limits=wide),
        steering=config.steering._replace(limits=wide),
    )


def stall(boat: FaultBoat) -> None:
    """Hold the loop for two seconds, as a machine that swaps does."""
    boat.stalled_until = boat.clock.time + STALL_S


def rival(boat: FaultBoat) -> None:
    """Let another ground station with our id steer, forty times a second."""
    codec = MavlinkCodec(255, 190)
    message: Any = dialect.MAVLink_rc_channels_override_message(1, 1, 1650, *[65535] * 7)

    boat.hooks.append(lambda: boat.vehicle.receive(boat.clock.time, codec.encode(message)))


ROWS: tuple[Row, ...] = (
    Row("nothing"),
    simple("heading lost", "heading_dropout"),
    simple("heading lost for 0.6 s", "heading_dropout", end=0.6),
    simple("heading frozen", "heading_frozen"),
    Row("heading and rate frozen", (Injected("heading_frozen"), Injected("rate_frozen"))),
    simple("heading frozen, compass without rate", "heading_frozen", method="instruments"),
    simple("heading jumps by 40 deg", "heading_jump", 40.0),
    simple("heading jumps by 40 deg and back", "heading_jump", 40.0, end=2.0),
    simple("heading jumps by 12 deg", "heading_jump", 12.0),
    taking_turns("two compasses on one line, 15 deg apart", 15.0, 2.2),
    simple("heading drifts by 1 deg/s", "heading_drift", 1.0)._replace(window_s=DRIFT_S),
    simple("heading noise of 10 deg", "heading_noise", 10.0),
    simple("every tenth heading wild", "heading_spikes", 0.1),
    simple("heading is no number", "heading_nan"),
    simple("readings 1 s late", "heading_late", 1.0),
    late("compass 0.3 s late", "heading_lag"),
    late("gyro 0.3 s late", "rate_lag"),
    late("compass and gyro 0.3 s late", "heading_lag", "rate_lag"),
    of_two("second compass off by 30 deg", "heading_jump", 30.0, "second"),
    of_two("second compass drifts by 1 deg/s", "heading_drift", 1.0, "second")._replace(window_s=DRIFT_S),
    of_two("first of two compasses lost", "heading_dropout"),
    of_two("first of two compasses frozen", "heading_frozen"),
    of_two("first of two compasses jumps by 40 deg", "heading_jump", 40.0),
    of_two("first of two compasses noisy, 10 deg", "heading_noise", 10.0),
    of_two("first of two compasses drifts by 1 deg/s", "heading_drift", 1.0)._replace(window_s=DRIFT_S),
    of_two("second of two compasses lost", "heading_dropout", None, "second"),
    of_two("second of two compasses frozen", "heading_frozen", None, "second"),
    simple("both compasses lost", "heading_dropout", None, "both"),
    simple("both compasses frozen", "heading_frozen", None, "both"),
    simple("rate off by 5 deg/s", "rate_bias", 5.0),
    simple("rate frozen", "rate_frozen"),
    simple("rate reversed", "rate_reversed"),
    simple("rate in deg/s for rad/s", "rate_scaled", 57.3),
    simple("rate noise of 5 deg/s", "rate_noise", 5.0),
    simple("speed lost", "speed_lost"),
    simple("speed frozen", "speed_frozen"),
    Row("speed frozen, and the engine stops", (Injected("speed_frozen"), Injected("engine_stopped"))),
    simple("speed three times too high", "speed_wrong", 3.0),
    simple("speed a third of the true one", "speed_wrong", 0.33),
    simple("speed 0.15 of the true one", "speed_wrong", 0.15),
    Row("head stream, speed over the ground alone", (stream(-STREAM_M_S),)),
    Row("following stream, speed over the ground alone", (stream(STREAM_M_S),)),
    Row("log lost in a head stream", (Injected("log_lost"), stream(-STREAM_M_S)), "instruments"),
    simple("position lost", "position_lost"),
    simple("position jumps by 200 m", "position_jump", 200.0),
    simple("rudder stuck", "rudder_stuck"),
    simple("rudder stuck, with a rudder sensor", "rudder_stuck", None, "instruments"),
    simple("rudder stuck before engaging", "rudder_stuck")._replace(is_before=True),
    simple("rudder reversed", "rudder_reversed"),
    simple("rudder reversed, with a rudder sensor", "rudder_reversed", None, "instruments"),
    simple("rudder at a tenth of its rate", "rudder_slow", 0.1),
    simple("rudder at a quarter of its rate", "rudder_slow", 0.25),
    simple("rudder at a quarter of its rate, with a rudder sensor", "rudder_slow", 0.25, "instruments"),
    late("rudder 0.3 s late", "rudder_late"),
    simple("rudder linkage slipped by 8 deg", "rudder_offset", 8.0),
    simple("rudder runs hard over", "rudder_hard_over", 1.0),
    simple("rudder stops at 5 deg", "rudder_limited", 5.0),
    simple("backlash of 2 deg", "rudder_play", 1.0),
    simple("backlash of 6 deg", "rudder_play", 3.0),
    simple("rudder linkage broken", "rudder_free"),
    simple("rudder sensor lost", "feedback_lost", None, "instruments"),
    simple("rudder sensor frozen", "feedback_frozen", None, "instruments"),
    simple("rudder sensor off by 8 deg", "feedback_offset", 8.0, "instruments"),
    simple("no report of the rudder", "feedback_lost"),
    simple("engine stopped", "engine_stopped"),
    simple("engine astern", "engine_astern", 0.5),
    simple("pushed by a gust worth 15 deg of rudder", "yaw_push", 15.0),
    simple("pushed by more than the rudder can hold", "yaw_push", 45.0),
    simple("heels by 35 deg", "heel", 35.0),
    simple("firmware reboots", "reboot"),
    simple("somebody chooses HOLD", "mode", 4.0),
    simple("somebody disarms", "disarm"),
    simple("a hand on the sticks", "stick", 0.8),
    simple("the radio's override switch goes off", "switch"),
    simple("overrides ignored", "overrides_ignored"),
    Row("another ground station steers", (), "companion", rival),
    simple("battery low", "battery_low"),
    simple("geofence breached", "geofence"),
    simple("shallow water", "shallow"),
    simple("vehicle's clock steps 5 s ahead", "clock_step", 5.0),
    simple("vehicle's clock steps 5 s back", "clock_step", -5.0),
    simple("heartbeats lost", "heartbeat_lost"),
    simple("link silent", "silence"),
    simple("link silent for 2 s", "silence", end=2.0),
    simple("link deaf: nothing we send arrives", "link_deaf"),
    simple("link half open", "link_half_open"),
    simple("link loses 30 %", "link_loss", 0.3),
    simple("link 0.3 s late each way", "link_delay", 0.3),
    simple("link jitter of 0.3 s", "link_jitter", 0.3),
    simple("link doubles and reorders 30 %", "link_duplicate", 0.3),
    simple("link damages 30 %", "link_corrupt", 0.3),
    simple("link cuts 30 % short", "link_truncate", 0.3),
    simple("link flooded with 500 packets/s", "link_flood", 500.0),
    Row("the loop stalls for 2 s", (), "companion", stall),
    Row("the law returns no number", (), "companion", law_of_no_numbers),
    Row("limits broken, law wants 60 deg", (), "companion", limits_broken),
)


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
    """Return whether there is such a state: where there is no flight controller, nobody but the skipper takes over; and
    what the pilot finds as it begins to steer it finds in the state that it begins with."""
    return state in BEGINNINGS if row.is_before else not (state == "override" and row.method == "instruments")


def run_cells(rows: Iterable[Row], states: Iterable[str], workers: int, seed: int = 1) -> Iterator[Cell]:
    """Yield the cell of every row and state, in the sea and with the noise of a seed. Each state is reached once for
    each kind of links, then forked."""
    by_links = sorted(rows, key=lambda row: (row.method, row.is_before))
    for (method, _), group in itertools.groupby(by_links, key=lambda row: (row.method, row.is_before)):
        every = list(group)
        for state in states:
            if chosen := [row for row in every if has_cell(row, state)]:
                yield from _cells_of(method, state, chosen, workers, seed)


def _cells_of(method: str, state: str, rows: list[Row], workers: int, seed: int) -> Iterator[Cell]:
    boat, is_before = FaultBoat(method, seed), rows[0].is_before
    if is_before:
        boat.run(ALONE_S)
    else:
        bring_into(boat, state)
    window_s = max(row.window_s for row in rows)
    clean: Any = in_child(lambda: _run(boat, Row("nothing", is_before=is_before), state, window_s))()
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


def _run(boat: FaultBoat, row: Row, state: str, window_s: float) -> list[Moment]:
    """Return what happens after the tick in which the fault, or where that was there before the pilot, begins."""
    if row.is_before:
        row.inject(boat)
        engage(boat, state)
    first = len(boat.moments)
    if not row.is_before:
        row.inject(boat)
    boat.run(window_s)
    return boat.moments[first:]


def cell(boat: FaultBoat, row: Row, state: str, clean: list[Moment]) -> Cell:
    """Give the boat the fault of the row and return what came of it."""
    moments = _run(boat, row, state, row.window_s)
    begin = round(boat.clock.time - row.window_s, 9)
    before = boat.moments[: -len(moments)][-40:]
    known = {alarm for moment in before for alarm in moment.tick.alarms}
    was = before[-1].tick
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
