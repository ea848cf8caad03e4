"""A boat, its flight controller and the pilot in lockstep: no process, no socket, no waiting.

The pilot is put together as `autopilot run` does it, and talks MAVLink to the simulated flight controller over a line
in memory. The clock is the program's: a minute at sea takes a few seconds, and the same scenario gives the same ticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from autopilot.errors import InputError
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.transports import loopback_pair
from autopilot.runtime.app import App, Plan
from autopilot.runtime.build_links import LinkOptions, companion_settings_of
from autopilot.runtime.log_files import FileSink
from autopilot.signals import Order, Tick
from autopilot.vessel.schema import Vessel
from sitl.px4 import firmware_of
from sitl.scenario import Scenario, load_scenario
from sitl.serve import afloat
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import World

STEP = 0.025


class Clock:
    """The program's time; who waits is carried on by `carry`."""

    def __init__(self, carry: Callable[[float], None]) -> None:
        self.time = 0.0
        self._carry = carry

    def now(self) -> float:
        """Return the time [s]."""
        return self.time

    def wait(self, descriptors: Iterable[int], until: float) -> None:
        """Let a step pass: only a session that is closed waits, for its rudder to be free, and the boat sails on."""
        self.time = round(self.time + STEP, 9)
        self._carry(self.time)


def simulate(
    vessel: Vessel,
    orders: Callable[[float, Tick | None], Order],
    seconds: float,
    *,
    boat: Vessel | str | None = None,
    scenario: str | Scenario = "calm",
    log: str | Path | None = None,
) -> list[Tick]:
    """Return the ticks of `seconds` in which a pilot of `vessel` steers a boat by `orders`.

    boat: what really sails, a vessel or the name of a plant (`mmg_tanker`); None: the vessel itself. scenario: one that
    is loaded, a shipped one (`calm`, `sea-state-5`) or a file; its seed is that of all random numbers. log: where the
    run is written, as by `autopilot run --log`. Raises InputError.
    """
    from autopilot.vessel.file import load_vessel

    if not 0.0 < seconds < math.inf:
        raise InputError(f"seconds {seconds}: a number above 0 is needed")
    sailing = vessel if boat is None else load_vessel(boat) if isinstance(boat, str) else boat
    loaded = load_scenario(scenario) if isinstance(scenario, str) else scenario
    world = World(sailing, afloat(boat if isinstance(boat, str) else "", loaded, sailing.drive.kind))
    vehicle = MavlinkVehicle(firmware_of(world))
    near, far = loopback_pair("line")
    link = CompanionLink(near, companion_settings_of(vessel, LinkOptions(as_gcs=not vessel.helm.firmware_steers)))

    def carry(now: float) -> None:
        for data in far.receive():
            vehicle.receive(now, data)
        vehicle.advance(now)
        for data in vehicle.transmit(now):
            far.send(data)

    clock, ticks = Clock(carry), []
    sink = None if log is None else partial(FileSink, Path(log))
    with App(Plan(vessel, orders, links=(link,), log=sink), clock) as app:
        while clock.time < seconds:
            clock.time = round(clock.time + STEP, 9)
            carry(clock.time)
            if app.session.poll(clock.time):
                assert app.session.tick is not None
                ticks.append(app.session.tick)
    return ticks
