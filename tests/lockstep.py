"""Pilot, companion link and simulated flight controller in lockstep on one clock, over a line that may be bad."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from autopilot.links.base import Link
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.router import ForwardLink, RoutedTransport, Router, budget_for, filter_of
from autopilot.links.mavlink.signing import CountingTimestamps, Signing
from autopilot.links.transports import LoopbackTransport, loopback_pair
from autopilot.links.url import FORWARD_OPTIONS, open_transport, parse_url
from autopilot.runtime.app import App, Plan
from autopilot.runtime.build_links import LinkOptions, companion_settings_of
from autopilot.runtime.log_files import FileSink
from autopilot.signals import Mode, Order, OrderKind, Tick
from autopilot.vessel.schema import Vessel
from sitl.lockstep import STEP, Clock
from sitl.px4 import firmware_of
from sitl.scenario import Scenario, load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import Pace, World

GUIDED_AT_S = 1.5
Hook = Callable[["Lockstep"], None]


class BadLine:
    """What happens to datagrams on one way: each is lost, doubled, delayed, split, joined to the next, or cut short."""

    def __init__(
        self, seed: int = 0, loss: float = 0.0, double: float = 0.0, delay: float = 0.0, **cuts: float
    ) -> None:
        self._random = Random(seed)
        self._loss, self._double, self._delay = loss, double, delay
        self._split, self._join, self._cut = (cuts.pop(name, 0.0) for name in ("split", "join", "cut"))
        assert not cuts, f"unknown: {cuts}"
        self._under_way: list[tuple[float, int, bytes]] = []
        self._joined = b""
        self._number = 0
        self.lost = self.damaged = 0

    def put(self, now: float, data: bytes) -> None:
        """Send a datagram at `now` [s]."""
        chance = self._random.random
        if chance() < self._loss:
            self.lost += 1
            return
        if chance() < self._cut:
            self.damaged += 1
            data = data[: self._random.randrange(1, len(data))]
        if chance() < self._join:
            self._joined += data
            return
        data, self._joined = self._joined + data, b""
        pieces = [data]
        if len(data) > 1 and chance() < self._split:
            place = self._random.randrange(1, len(data))
            pieces = [data[:place], data[place:]]
            self.damaged += 1
        for piece in pieces * (2 if chance() < self._double else 1):
            self._number += 1
            self._under_way.append((now + self._delay * chance(), self._number, piece))

    def take(self, now: float) -> list[bytes]:
        """Return what arrives by `now` [s]; what was delayed less overtakes."""
        arrived = sorted(each for each in self._under_way if each[0] <= now)
        self._under_way = [each for each in self._under_way if each[0] > now]
        return [data for _, _, data in arrived]


class SlowLine(BadLine):
    """Everything comes so many seconds later."""

    def __init__(self, delay: float) -> None:
        super().__init__()
        self._later = delay

    def put(self, now: float, data: bytes) -> None:
        """Send a datagram at `now` [s]."""
        super().put(now + self._later, data)


class StragglingLine(BadLine):
    """From a time [s] on, a share of what is sent comes 3 to 4 s late."""

    def __init__(self, seed: int, share: float, begun: float) -> None:
        super().__init__(seed)
        self._share, self._begun = share, begun

    def put(self, now: float, data: bytes) -> None:
        """Send a datagram at `now` [s]."""
        is_late = now >= self._begun and self._random.random() < self._share
        super().put(now + self._random.uniform(3.0, 4.0) if is_late else now, data)


class StalledLine(BadLine):
    """Holds everything from a time on, for so long [s], and then delivers it so many times as fast as it came."""

    def __init__(self, begun: float, lasts: float, drained: float = math.inf) -> None:
        super().__init__()
        self._begun, self._end, self._drained = begun, begun + lasts, drained

    def put(self, now: float, data: bytes) -> None:
        """Send a datagram at `now` [s]."""
        caught_up = self._end + (now - self._begun) / self._drained
        super().put(max(now, caught_up) if now >= self._begun else now, data)


def goes_guided(boat: Lockstep) -> None:
    """A hook: the hand that drove the boat in MANUAL hands it over to GUIDED under way."""
    if boat.now >= GUIDED_AT_S and boat.firmware.set_mode(15):
        boat.hooks.remove(goes_guided)


def stick_follows(boat: Lockstep) -> None:
    """A hook: a hand gives throttle when the pilot has engaged, and takes it away when it has not."""
    is_engaged = bool(boat.ticks) and boat.tick.mode in (Mode.ENGAGED, Mode.FAILSAFE)
    boat.firmware.sticks[2] = boat.ahead_us if is_engaged else 1500


class Lockstep:
    """`run` moves all on together. `order` may be changed at any time; `ticks` keeps every tick.

    hooks: called each step, before the vehicle; to put strange datagrams on the line use `inject`.
    measured_every: steps of the simulation from one reading of its sensors to the next.
    key: signs the line, and that of `forward`, the URL of a link to ground stations behind the pilot.
    """

    def __init__(
        self,
        vessel: Vessel,
        *,
        law: str | None = None,
        settings: dict[str, Any] | None = None,
        parameters: dict[str, float] | None = None,
        vehicle: dict[str, Any] | None = None,
        lines: Sequence[BadLine] = (),
        is_stream: bool = False,
        log: Path | None = None,
        measured_every: int = 1,
        scenario: Scenario | None = None,
        key: bytes = b"",
        forward: str = "",
    ) -> None:
        ours, theirs = (Signing(key, CountingTimestamps()) if key else None for _ in range(2))
        scenario = scenario or load_scenario("calm")
        scenario = dataclasses.replace(scenario, vehicle=dataclasses.replace(scenario.vehicle, **(vehicle or {})))
        self.world = World(vessel, scenario, pace=Pace(measured_every, measured_every))
        self.firmware = firmware_of(self.world)
        for name, value in (parameters or {}).items():
            assert self.firmware.parameters.set(name, value) is not None, name
        self.ahead_us = self.firmware.sticks[2]
        self.vehicle = MavlinkVehicle(self.firmware, is_stream, theirs.link() if theirs else None)
        near, self.far = loopback_pair("line")
        near.is_stream = is_stream
        self.near: LoopbackTransport = near
        self.up, self.down = lines or (BadLine(), BadLine())
        wired = companion_settings_of(vessel, LinkOptions(as_gcs=not vessel.helm.firmware_steers))
        signing, router, behind = ours.link() if ours else None, Router(), list[Link]()
        if forward:
            url = parse_url(forward, FORWARD_OPTIONS)
            link = ours.link() if ours else None
            behind.append(ForwardLink(open_transport(url), router, budget_for(0), link, outgoing=filter_of(url)))
        line = RoutedTransport(near, router, signing) if forward else near
        self.link = CompanionLink(line, wired._replace(**(settings or {})), signing)
        self.order = Order()
        self.clock = Clock(lambda now: self.carry(now))
        self.ticks: deque[Tick] = deque()
        self.hooks: list[Hook] = []
        self.sent: list[tuple[float, Any]] = []
        place = None if log is None else partial(FileSink, log)
        plan = Plan(vessel, lambda now, tick: self.order, law=law, links=(self.link, *behind), log=place)
        app = App(plan, self.clock)
        self.pilot, self.session = app.pilot, app.session

    @property
    def now(self) -> float:
        return self.clock.time

    @property
    def tick(self) -> Tick:
        return self.ticks[-1]

    def engage(self, heading_deg: float) -> None:
        self.order = Order(OrderKind.HEADING, math.radians(heading_deg), serial=self.order.serial + 1)

    def inject(self, data: bytes) -> None:
        """Put bytes in front of the companion, as if somebody else had sent them."""
        self.far.send(data)

    def run(self, seconds: float, until: Callable[[Tick], bool] | None = None) -> bool:
        """Move on; return whether `until` came true of a tick."""
        for _ in range(round(seconds / STEP)):
            self.clock.time = now = round(self.clock.time + STEP, 9)
            for hook in list(self.hooks):
                hook(self)
            self.carry(now)
            if self.session.poll(now):
                assert self.session.tick is not None
                self.ticks.append(self.session.tick)
                if until is not None and until(self.session.tick):
                    return True
        return False

    def carry(self, now: float) -> None:
        """Let both sides' datagrams travel."""
        for data in self.far.receive():
            self.up.put(now, data)
        for data in self.up.take(now):
            self.vehicle.receive(now, data)
        self.vehicle.advance(now)
        for data in self.vehicle.transmit(now):
            self.down.put(now, data)
        for data in self.down.take(now):
            self.far.send(data)

    def engaged(self, tick: Tick) -> bool:
        """For `until`."""
        return tick.mode is Mode.ENGAGED


def keep_packets(boat: Lockstep) -> list[Any]:
    """Return a list that everything received and sent from now on is added to."""
    kept: list[Any] = []
    take = boat.link.take_packets

    def taken() -> list[tuple[float, bytes]]:
        found = take()
        reader = MavlinkCodec()
        kept.extend((time, message) for time, data in found for message in reader.decode(data))
        return found

    boat.link.take_packets = taken  # type: ignore[method-assign]
    return kept
