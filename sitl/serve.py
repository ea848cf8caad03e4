"""Serving the simulated boat in real time: transports on one side, the sans-clock endpoints on the other.

A line that damages what it carries: loss, delay, jitter, doubling, overtaking, changed bytes, cut packets, noise,
and a connection that is open on one side only. Seeded, on whatever clock is given, in front of any endpoint.

From the options of `sitl serve` to a world and its opened ports.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import heapq
import math
import select
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from random import Random
from typing import IO, NamedTuple, Protocol

import numpy as np

from autopilot.errors import InputError
from autopilot.files.outside import typed_number
from autopilot.files.saving import create_unused
from autopilot.links.base import Transport
from autopilot.links.mavlink.signing import LinkSigning, Signing
from autopilot.links.transports import TcpServerTransport
from autopilot.links.transports.medium import UrlOptions
from autopilot.links.url import BAUD_MAX, BAUD_MIN, SCHEMES, open_transport, parse_url
from autopilot.vessel.file import load_vessel
from sitl.drives import DriveLine, JrkController, MaestroController, PypilotController, ValveController
from sitl.fault_table import Damage
from sitl.faults import Fault, FaultBoard, FaultService
from sitl.firmware import Firmware
from sitl.lines import FirmwareTcpServer, PtyTransport
from sitl.px4 import firmware_of
from sitl.registry import KINDS, PLANTS, USUAL, that_act_at
from sitl.scenario import Scenario, load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.wire_nmea import PLOTTER, NmeaInstruments, chosen_rates
from sitl.world import STEP, World

LAG_MAX_S = 2.0
"""Wall time that the simulation may fall behind before its clock is set back instead of running after it."""
SILENT_PEER_S = 5.0
"""Simulated time without a word from a peer, after which another may take its place."""

TRUTH_PERIOD = 0.1
TRUTH_COLUMNS = (
    *("time_s", "north_m", "east_m", "heading_rad", "yaw_rate_rad_s", "rudder_rad"),
    *("speed_m_s", "sway_m_s", "roll_rad"),
)


class Endpoint(Protocol):
    """The boat's side of one link, on whatever clock is given."""

    def receive(self, now: float, data: bytes) -> None:
        """Take bytes that arrived at `now` [s]."""

    def transmit(self, now: float) -> list[bytes]:
        """Return what has left by `now` [s]."""


class Port(NamedTuple):
    """An endpoint and the transport that carries it."""

    transport: Transport
    endpoint: Endpoint


class TruthFile:
    """What the boat really did, ten times a simulated second, as CSV; where `path` exists, its next free name.

    A full disk ends the record, not the boat. Raises InputError where the file cannot be made.
    """

    def __init__(self, path: Path, world: World) -> None:
        try:
            descriptor, self.path = create_unused(path)
        except OSError as error:
            raise InputError(f"--truth: {path} cannot be written: {error.strerror}.") from error
        self._file: IO[str] = open(descriptor, "w", 1, newline="", encoding="utf-8")  # noqa: PTH123, SIM115
        self._world = world
        self._rows = csv.writer(self._file)
        self._failed = False
        self._next = 0.0
        self._write(TRUTH_COLUMNS)
        self._after_step(world.time)
        world.watchers.append(self._after_step)

    def _after_step(self, now: float) -> None:
        if now + 1.0e-9 < self._next:
            return
        self._next += TRUTH_PERIOD
        state = self._world.boat.state
        values = (state.north, state.east, state.heading, state.rate, state.rudder, state.speed, state.sway, state.roll)
        self._write([f"{now:.3f}", *(f"{value:.7g}" for value in values)])

    def close(self) -> None:
        """Write what is left and close the file."""
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)

    def _write(self, row: Sequence[str]) -> None:
        if not self._failed:
            try:
                self._rows.writerow(row)
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        if not self._failed:
            self._failed = True
            print(f"sitl: {self.path} ends before its time: {error.strerror}", file=sys.stderr)


class Pace:
    """Simulated time from wall time: `speedup` times as fast, and late rather than rushed when it cannot keep up."""

    def __init__(self, speedup: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._speedup = speedup
        self._clock = clock
        self._start = clock()
        self.lost = 0.0
        """Wall seconds given up because the machine was too slow."""

    def simulated(self, reached: float) -> float:
        """Return the simulated time of this instant, where the simulation has reached `reached` [s]."""
        now = (self._clock() - self._start) * self._speedup
        late = (now - reached) / self._speedup - LAG_MAX_S
        if late > 0.0:
            self._start += late
            self.lost += late
            now -= late * self._speedup
        return now

    def wait_for(self, simulated: float) -> float:
        """Return the wall seconds until the simulated time, at least 0."""
        return max(simulated / self._speedup - (self._clock() - self._start), 0.0)


def serve(
    world: World,
    ports: Sequence[Port],
    pace: Pace,
    duration: float | None,
    should_stop: Callable[[], bool],
    service: FaultService | None = None,
) -> None:
    """Run until `should_stop` or for `duration` simulated seconds. Raises LinkError when a transport is gone."""
    received = [world.time] * len(ports)
    while not should_stop():
        now = pace.simulated(world.time)
        if duration is not None and now >= duration:
            world.advance(duration)
            return
        # ports in turn, in the order the user gave them: one clock reading for all
        for number, (transport, endpoint) in enumerate(ports):
            for data in transport.receive():
                received[number] = now
                endpoint.receive(now, data)
            if now - received[number] > SILENT_PEER_S:
                # whoever starts again speaks from another port
                received[number] = now
                transport.forget_peer()
        world.advance(now)
        if service is not None:
            service.serve()
        for transport, endpoint in ports:
            for packet in endpoint.transmit(now):
                transport.send(packet)
        descriptors = [port.transport.fileno() for port in ports] + ([service.fileno()] if service is not None else [])
        waiting = [descriptor for descriptor in descriptors if descriptor >= 0]
        select.select(waiting, [], [], pace.wait_for(world.time + STEP))


NAMES = {kind.removeprefix("link_"): kind for kind, _ in that_act_at("line")}
"""Names of `--chaos`, and the faults that they stand for: one works all the time, the other when it is ordered to."""
REORDER_S = 0.1
"""A packet that is overtaken waits so long."""
NOISE_MOST = 64
MOST_UNDER_WAY = 20000


class ChaosLine:
    """One direction. What is put in comes out of `take`, or not, or later, or something else.

    is_stream: the bytes belong to a stream: they are lost and damaged, but never overtake each other.
    """

    def __init__(self, seed: int = 0, is_stream: bool = False) -> None:
        self._random = Random(seed)
        self._is_stream = is_stream
        self._under_way: list[tuple[float, int, bytes]] = []
        self._number = 0
        self._latest = -math.inf
        self._noise_due: float | None = None
        self.lost = self.damaged = 0

    def put(self, time: float, data: bytes, damage: Damage) -> None:
        """Send a packet at `time` [s] over a line that is so bad."""
        chance = self._random.random
        if damage.still or chance() < damage.loss or len(self._under_way) >= MOST_UNDER_WAY:
            self.lost += 1
            return
        if data and chance() < damage.truncate:
            data = data[: self._random.randrange(len(data))]
            self.damaged += 1
        if data and chance() < damage.corrupt:
            data = self._corrupted(data)
            self.damaged += 1
        for _ in range(2 if chance() < damage.duplicate else 1):
            late = damage.delay + damage.jitter * chance() + (REORDER_S if chance() < damage.reorder else 0.0)
            self._send(time + late, data)

    def make_noise(self, time: float, damage: Damage) -> None:
        """Put in the packets of noise that are due by `time` [s]."""
        if damage.flood <= 0.0 or damage.still:
            self._noise_due = None
            return
        due = time if self._noise_due is None else self._noise_due
        while due <= time:
            self._send(due, self._random.randbytes(self._random.randrange(1, NOISE_MOST)))
            due += 1.0 / damage.flood
        self._noise_due = due

    def take(self, time: float) -> list[bytes]:
        """Return what has arrived by `time` [s], in the order of arrival."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= time + 1.0e-9:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived

    def _send(self, arrival: float, data: bytes) -> None:
        if self._is_stream:
            arrival = self._latest = max(arrival, self._latest)
        self._number += 1
        heapq.heappush(self._under_way, (arrival, self._number, data))

    def _corrupted(self, data: bytes) -> bytes:
        changed = bytearray(data)
        for _ in range(self._random.randrange(1, 4)):
            changed[self._random.randrange(len(changed))] ^= self._random.randrange(1, 256)
        return bytes(changed)


class ChaosPort:
    """An `Endpoint` with a bad line on either way, as bad as the faults of the moment say; without any, clear."""

    def __init__(self, endpoint: Endpoint, world: World, is_stream: bool, seed: np.random.SeedSequence) -> None:
        self._endpoint = endpoint
        self._world = world
        to_boat, from_boat = seed.generate_state(2)
        self.to_boat = ChaosLine(int(to_boat), is_stream)
        self.from_boat = ChaosLine(int(from_boat), is_stream)

    def receive(self, now: float, data: bytes) -> None:
        """Take bytes that set out for the boat at `now` [s]."""
        faults, time = self._world.faults, self._world.time_at(now)
        damage = damage_at(faults, time)
        for fault, effect in faults.acting("to_boat", time):
            damage = effect(fault, damage)
        self._pass_on(now)
        self.to_boat.put(time, data, damage)
        self._pass_on(now)

    def advance(self, now: float) -> None:
        """Move the world on to `now` [s]."""
        self._world.advance(now)

    def transmit(self, now: float) -> list[bytes]:
        """Return what has come through by `now` [s]."""
        time = self._world.time_at(now)
        damage = damage_at(self._world.faults, time)
        self._pass_on(now)
        for data in self._endpoint.transmit(now):
            self.from_boat.put(time, data, damage)
        self.to_boat.make_noise(time, damage)
        self.from_boat.make_noise(time, damage)
        return self.from_boat.take(time)

    def _pass_on(self, now: float) -> None:
        for data in self.to_boat.take(self._world.time_at(now)):
            self._endpoint.receive(now, data)


def damage_at(faults: FaultBoard, time: float) -> Damage:
    """Return how bad the line is at `time` [s], either way."""
    damage = Damage()
    for fault, effect in faults.acting("line", time):
        damage = effect(fault, damage)
    return damage


def chaos_faults(text: str) -> Iterable[Fault]:
    """Return the faults, from the start to the end, that `loss=0.05,delay=0.1` stands for. Raises InputError."""
    found: dict[str, Fault] = {}
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        if name not in NAMES or name in found:
            raise InputError(f"--chaos {text}: {name!r} is unknown or named twice, allowed are {', '.join(NAMES)}.")
        kind = KINDS[NAMES[name]]
        size, begin = 1.0, 0.0
        if kind.unit:
            size = _number(text, name, value, kind.low, kind.high)
        elif equals:
            begin = _number(text, name, value, 0.0, 1.0e6)  # it has no size, but may begin later
        found[name] = Fault(NAMES[name], begin, math.inf, size)
    return found.values()


def _number(text: str, name: str, value: str, low: float, high: float) -> float:
    try:
        number = typed_number(value)
    except ValueError:
        number = math.nan
    if not low <= number <= high:
        raise InputError(f"--chaos {text}: {name} is {value!r}, it must be a number from {low:g} to {high:g}.")
    return number


DRIVES: dict[str, Callable[[World, int], DriveLine]] = {
    "pypilot": PypilotController,
    "jrk": JrkController,
    "maestro": MaestroController,
    "valve": ValveController,
}
"""Rudder drives by the names that link URLs give them."""
NETWORK_BAUD = 115200
"""Instruments on a socket stand behind a multiplexer with a line of this speed."""


def world_from(arguments: argparse.Namespace) -> World:
    """Return the world that vessel, scenario and options describe. Raises InputError."""
    vessel = load_vessel(arguments.vessel)
    scenario = afloat(arguments.vessel, load_scenario(arguments.scenario), vessel.drive.kind)
    speed, depth = arguments.speed_m_s, arguments.depth_draughts
    scenario = with_options(scenario, arguments.armed, arguments.mode, speed, depth)
    world = World(vessel, scenario, arguments.seed)
    for fault in chaos_faults(arguments.chaos) if arguments.chaos else ():
        world.faults.add(fault)
    return world


DRIVEN = {"two_thrusters": "twin_thruster", "outboard": "outboard", "jet": "outboard"}
"""Plants that steer by thrust, by the vessel's drive."""
SHIPPED = {"bow_thruster": "small_craft"}
"""Plants of shipped vessels that are not called as their plant is."""


def afloat(vessel: str, scenario: Scenario, drive: str = "rudder") -> Scenario:
    """Return the scenario with the plant of this name, where `vessel` names one and the scenario names none; else with
    one that has the vessel's `drive`."""
    if scenario.plant != USUAL:
        return scenario
    plant = vessel if vessel in PLANTS else SHIPPED.get(vessel, DRIVEN.get(drive, USUAL))
    return dataclasses.replace(scenario, plant=plant)


def with_options(
    scenario: Scenario, armed: bool | None, mode: str | None, speed: float | None, depth: float | None
) -> Scenario:
    """Return the scenario with what the command line says instead; None: as the scenario has it."""
    vehicle, start = scenario.vehicle, scenario.start
    if armed is not None:
        vehicle = dataclasses.replace(vehicle, armed=armed)
    if mode is not None:
        vehicle = dataclasses.replace(vehicle, mode=mode)  # type: ignore[arg-type]  # argparse allows no other
    if speed is not None:
        start = dataclasses.replace(start, speed_m_s=speed)
    depth = scenario.depth_draughts if depth is None else depth
    return dataclasses.replace(scenario, vehicle=vehicle, start=start, depth_draughts=depth)


class Lines(NamedTuple):
    """What is served beside MAVLink, as options say it: `--nmea` with its sentences, `--drive` and `--n2k`."""

    nmea: str | None = None
    sentences: str = ""
    drive: str | None = None
    n2k: str | None = None


def open_ports(world: World, urls: list[str], lines: Lines, signing: Signing | None = None) -> list[tuple[str, Port]]:
    """Open every link; return what its ready line says, and the port. Raises InputError and LinkError."""
    ports: list[tuple[str, Port]] = []
    try:
        if urls:
            firmware = firmware_of(world)
            for url in urls:
                port = mavlink_port(firmware, url, signing.link() if signing else None)
                ports.append((f"mavlink {url}", port))
        if lines.nmea is not None:
            _check_route(world, lines.sentences)
            ports.append(nmea_port(world, lines.nmea, lines.sentences))
        if lines.drive is not None:
            ports.append(drive_port(world, lines.drive))
        if lines.n2k is not None:
            ports.append(n2k_port(world, lines.n2k))
    except BaseException:
        for _, port in ports:
            port.transport.close()
        raise
    seeds = world.chaos_seed.spawn(len(ports))
    # before each a line that is as bad as the faults of the moment say
    return [
        (line, Port(far, ChaosPort(endpoint, world, far.is_stream, seed)))
        for (line, (far, endpoint)), seed in zip(ports, seeds, strict=True)
    ]


def mavlink_port(firmware: Firmware, url: str, signing: LinkSigning | None = None) -> Port:
    """Open one MAVLink link of the flight controller. Raises InputError and LinkError."""
    link = parse_url(url)
    if link.protocol != "mavlink":
        raise InputError(f"--mavlink {url}: an NMEA link; the instruments are served by --nmea PATH:BAUD.")
    transport = open_transport(link)
    is_stream = transport.is_stream
    if isinstance(transport, TcpServerTransport):
        transport = FirmwareTcpServer(transport, lambda: firmware.world.time)
    return Port(transport, MavlinkVehicle(firmware, is_stream, signing))


def nmea_port(world: World, text: str, sentences: str) -> tuple[str, Port]:
    """Put the instruments on a pseudo-terminal or a socket: ready line and port. Raises InputError and LinkError."""
    if text.partition(":")[0] not in SCHEMES:
        path, baud = _path_and_baud("--nmea", text)
        instruments = NmeaInstruments(world, chosen_rates(sentences, baud), baud)
        return f"nmea {path} ({baud} baud)", Port(PtyTransport(path), instruments)
    link = parse_url(text)
    if link.protocol != "nmea" or link.options != UrlOptions():
        raise InputError(
            f"--nmea {text}: write PATH:BAUD, or an NMEA link without options such as nmea-tcpin:HOST:PORT."
        )
    baud = link.baud or NETWORK_BAUD
    rates = chosen_rates(sentences, baud)
    transport = open_transport(link)
    return f"nmea {text}", Port(transport, NmeaInstruments(world, rates, baud, transport.is_stream))


def n2k_port(world: World, text: str) -> tuple[str, Port]:
    """Put the boat's NMEA 2000 network behind a Yacht Devices gateway, or on a CAN bus: ready line and port."""
    from autopilot.links.n2k.link import open_bus
    from sitl.wire_n2k import BusTransport, N2kNetwork

    link = parse_url(text)
    if link.protocol not in ("n2k", "ydwg") or link.options != UrlOptions():
        raise InputError(
            f"--n2k {text}: write an NMEA 2000 link without options, such as n2k:ydwg-tcpin:127.0.0.1:1457 or "
            "n2k:socketcan:vcan0."
        )
    is_text = link.protocol == "ydwg"
    transport = open_transport(link) if is_text else BusTransport(text, open_bus(text, link.host, link.path))
    return f"n2k {text}", Port(transport, N2kNetwork(world, is_text))


def drive_port(world: World, text: str) -> tuple[str, Port]:
    """Put a rudder drive on a pseudo-terminal: its ready line, and the port. Raises InputError and LinkError."""
    kind, _, place = text.partition(":")
    if kind not in DRIVES:
        raise InputError(f"--drive {text}: {kind!r} is no drive; allowed are {', '.join(DRIVES)}, each with PATH:BAUD.")
    path, baud = _path_and_baud("--drive", place)
    return f"drive {kind} {path} ({baud} baud)", Port(PtyTransport(path), DRIVES[kind](world, baud))


def _check_route(world: World, sentences: str) -> None:
    named = {item.strip().partition(":")[0] for item in sentences.split(",")}
    if not world.scenario.route and (spoken := sorted(named & set(PLOTTER))):
        raise InputError(
            f"--sentences: {', '.join(spoken)} come from a chart plotter; give the scenario a route, such as "
            "route: [[0, 0], [500, 0]] (metres north and east of the start)."
        )


def _path_and_baud(option: str, text: str) -> tuple[str, int]:
    path, _, digits = text.rpartition(":")
    baud = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 9 else 0
    if not path or not BAUD_MIN <= baud <= BAUD_MAX:
        raise InputError(
            f"{option} {text}: write a path and a baud rate from {BAUD_MIN} to {BAUD_MAX}, e.g. /tmp/norrbin-nmea:4800."
        )
    return path, baud
