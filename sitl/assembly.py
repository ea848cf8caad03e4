"""From the options of `sitl serve` to a world and its opened ports."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable

import numpy as np

from autopilot.errors import InputError
from autopilot.links.signing import LinkSigning, Signing
from autopilot.links.transports import TcpServerTransport
from autopilot.links.url import BAUD_MAX, BAUD_MIN, SCHEMES, open_transport, parse_url
from autopilot.links.url_options import UrlOptions
from autopilot.params.vessel_file import load_vessel
from sitl.chaos import ChaosPort, chaos_faults
from sitl.drive_line import DriveLine
from sitl.firmware import Firmware
from sitl.firmware_tcp import FirmwareTcpServer
from sitl.pty_line import PtyTransport
from sitl.scenario import Scenario, load_scenario
from sitl.serve import Port
from sitl.wire_mavlink import MavlinkVehicle
from sitl.wire_nmea import PLOTTER, NmeaInstruments, chosen_rates
from sitl.wire_pololu import JrkController, MaestroController
from sitl.wire_pypilot import PypilotController
from sitl.world import World

DRIVES: dict[str, Callable[[World, int], DriveLine]] = {
    "pypilot": PypilotController,
    "jrk": JrkController,
    "maestro": MaestroController,
}
"""Rudder drives by the names that link URLs give them."""
NETWORK_BAUD = 115200
"""Instruments on a socket stand behind a multiplexer with a line of this speed."""


def world_from(arguments: argparse.Namespace) -> World:
    """Return the world that vessel, scenario and options describe. Raises InputError."""
    vessel = load_vessel(arguments.vessel)
    scenario = with_options(load_scenario(arguments.scenario), arguments.armed, arguments.mode, arguments.speed_m_s)
    world = World(vessel, scenario, arguments.seed)
    for fault in chaos_faults(arguments.chaos) if arguments.chaos else ():
        world.faults.add(fault)
    return world


def with_options(scenario: Scenario, armed: bool | None, mode: str | None, speed: float | None) -> Scenario:
    """Return the scenario with what the command line says instead; None: as the scenario has it."""
    vehicle, start = scenario.vehicle, scenario.start
    if armed is not None:
        vehicle = dataclasses.replace(vehicle, armed=armed)
    if mode is not None:
        vehicle = dataclasses.replace(vehicle, mode=mode)  # type: ignore[arg-type]  # argparse allows no other
    if speed is not None:
        start = dataclasses.replace(start, speed_m_s=speed)
    return dataclasses.replace(scenario, vehicle=vehicle, start=start)


def open_ports(
    world: World,
    urls: list[str],
    nmea: str | None,
    sentences: str,
    drive: str | None = None,
    signing: Signing | None = None,
) -> list[tuple[str, Port]]:
    """Open every link; return what its ready line says, and the port. Raises InputError and LinkError."""
    ports: list[tuple[str, Port]] = []
    try:
        if urls:
            firmware = Firmware(world)
            for url in urls:
                port = mavlink_port(firmware, url, signing.link() if signing else None)
                ports.append((f"mavlink {url}", port))
        if nmea is not None:
            _check_route(world, sentences)
            ports.append(nmea_port(world, nmea, sentences))
        if drive is not None:
            ports.append(drive_port(world, drive))
    except BaseException:
        for _, port in ports:
            port.transport.close()
        raise
    seeds = world.chaos_seed.spawn(len(ports))
    return [(line, behind_bad_line(world, port, seed)) for (line, port), seed in zip(ports, seeds, strict=True)]


def behind_bad_line(world: World, port: Port, seed: np.random.SeedSequence) -> Port:
    """Return the port with a line before it that is as bad as the faults of the moment say."""
    return Port(port.transport, ChaosPort(port.endpoint, world, port.transport.is_stream, seed))


def mavlink_port(firmware: Firmware, url: str, signing: LinkSigning | None = None) -> Port:
    """Open one MAVLink link of the flight controller. Raises InputError and LinkError."""
    link = parse_url(url)
    if link.protocol != "mavlink":
        raise InputError(f"--mavlink {url}: an NMEA link; the instruments are served by --nmea PATH:BAUD.")
    is_stream = link.medium in ("tcp", "tcpin", "serial")
    transport = open_transport(link)
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
    is_stream = link.medium in ("tcp", "tcpin", "serial")
    instruments = NmeaInstruments(world, chosen_rates(sentences, baud), baud, is_stream)
    return f"nmea {text}", Port(open_transport(link), instruments)


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
