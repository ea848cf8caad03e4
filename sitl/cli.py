"""The `sitl` command: a simulated boat that stands in for the real one on its links."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from autopilot import __version__
from autopilot.cli.main import answer
from autopilot.cli.options import (
    SEED,
    SPEEDUP,
    HelpText,
    Parser,
    add_completion_parser,
    add_waiting_option,
    number,
    patience_of,
    whole_number,
)
from autopilot.errors import ExitCode, InputError
from autopilot.interruption import stop_on_signal
from sitl.campaign import command as campaign
from sitl.scenario import load_scenario, shipped_scenarios

DEFAULT_SERVICE = "127.0.0.1:14599"
DEFAULT_MAVLINK = "udpout:127.0.0.1:14550"
DEFAULT_SENTENCES = "HDG,ROT,RSA,VHW"
SIMULATED = number(0.001, 1.0e6)
"""Seconds of a simulation."""

EXIT_CODES = """exit codes:
  0  ended by --duration, Ctrl-C or a termination signal
  2  bad usage, or a file that cannot be used
  3  a link could not be opened or was lost
  4  refused: a replayed run whose gains must not be engaged
  6  a replayed run differs from the compiled one
"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of `sitl`."""
    parser: argparse.ArgumentParser = Parser(
        prog="sitl",
        description="A simulated boat on real links.",
        epilog=EXIT_CODES,
        formatter_class=HelpText,
    )
    parser.add_argument("--version", action="version", version=f"norrbin {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    serve = commands.add_parser(
        "serve",
        help="the boat as a MAVLink flight controller and as instruments on a pseudo-terminal",
        description="Serve a simulated boat as an ArduRover flight controller over MAVLink and as NMEA instruments "
        "with a rudder drive on a pseudo-terminal. One line 'ready ...' is printed for each link.",
        epilog=EXIT_CODES,
        formatter_class=HelpText,
    )
    _add_serve_options(serve)
    physics = commands.add_parser(
        "ardupilot-physics",
        help="the boat as the physics behind a real ArduRover (ArduPilot's JSON simulator interface)",
        description="Move the boat of a vessel file for ArduPilot's simulator, in lock-step: start it, then "
        "`ardurover --model JSON:127.0.0.1` or `sim_vehicle.py -v Rover --model JSON:127.0.0.1`.",
        epilog=EXIT_CODES,
        formatter_class=HelpText,
    )
    _add_physics_options(physics)
    _add_fault_command(commands)
    campaign.add_parser(commands)
    campaign.add_tune_parser(commands)
    campaign.add_envelope_parser(commands)
    add_completion_parser(commands, "sitl", build_parser)
    return parser


def _add_boat_options(parser: argparse.ArgumentParser) -> None:
    """Add what says which boat is simulated, and for how long."""
    parser.add_argument(
        "vessel",
        metavar="VESSEL.yaml",
        help="vessel file, or the name of a shipped one (lanxin) or of a plant (mmg_tanker)",
    )
    parser.add_argument(
        "--scenario",
        metavar="FILE",
        default="calm",
        help=f"scenario file, or a shipped one: {', '.join(shipped_scenarios())} (default calm)",
    )
    parser.add_argument("--seed", metavar="N", action=SEED, help="seed of all random numbers (default: the scenario's)")
    parser.add_argument("--duration", metavar="S", action=SIMULATED, help="stop after this many simulated seconds")


def _add_physics_options(physics: argparse.ArgumentParser) -> None:
    _add_boat_options(physics)
    physics.add_argument(
        "--listen", metavar="HOST:PORT", default="127.0.0.1:9002", help="where ArduPilot sends (default %(default)s)"
    )
    for name, output in (("steering", 1), ("throttle", 3)):
        physics.add_argument(
            f"--{name}-servo",
            metavar="N",
            action=whole_number(1, 32),
            default=output,
            help=f"{name} output (default {output})",
        )
    physics.set_defaults(run=run_physics)


def _add_serve_options(serve: argparse.ArgumentParser) -> None:
    _add_boat_options(serve)
    serve.add_argument(
        "--mavlink",
        metavar="URL",
        action="append",
        help=f"MAVLink link, may be repeated: udpout:, udpin:, tcpin:, serial: (default {DEFAULT_MAVLINK} "
        "where no link is given)",
    )
    serve.add_argument(
        "--nmea",
        metavar="PATH:BAUD|URL",
        help="pseudo-terminal for NMEA, e.g. /tmp/norrbin-nmea:4800, or nmea-tcpin:, nmea-udpout: and so on",
    )
    serve.add_argument(
        "--sentences",
        metavar="LIST",
        default=DEFAULT_SENTENCES,
        help=f"sentences on the NMEA line, each with its rate if wanted: HDG:10,ROT (default {DEFAULT_SENTENCES})",
    )
    serve.add_argument(
        "--n2k",
        metavar="URL",
        help="NMEA 2000 network: n2k:ydwg-tcpin:127.0.0.1:1457 (a Yacht Devices gateway) or n2k:socketcan:vcan0",
    )
    serve.add_argument(
        "--drive",
        metavar="KIND:PATH:BAUD",
        help="rudder drive on a pseudo-terminal of its own: pypilot, jrk, maestro, valve; pypilot:/tmp/drive:38400",
    )
    serve.add_argument(
        "--signing-key",
        metavar="FILE",
        help="the flight controller signs with the key in FILE and obeys only messages signed with it",
    )
    serve.add_argument(
        "--chaos",
        metavar="LIST",
        help="bad lines from the start: loss=0.05,delay=0.1,jitter=,duplicate=,reorder=,corrupt=,truncate=,flood=,"
        "half_open=",
    )
    serve.add_argument(
        "--control", metavar="HOST:PORT", help=f"listen there for `sitl fault`, e.g. {DEFAULT_SERVICE}; loopback only"
    )
    serve.add_argument("--speedup", metavar="X", action=SPEEDUP, default=1.0, help="simulated seconds per second")
    arming = serve.add_mutually_exclusive_group()
    arming.add_argument(
        "--armed", action="store_true", default=None, help="start armed (default: as the scenario says)"
    )
    arming.add_argument("--disarmed", dest="armed", action="store_false", help="start disarmed")
    serve.add_argument("--mode", choices=("MANUAL", "HOLD", "GUIDED"), help="mode at the start")
    serve.add_argument(
        "--speed-m-s", metavar="X", action=number(0.0, 50.0), help="speed at the start, held by the throttle"
    )
    serve.add_argument(
        "--depth-draughts",
        metavar="X",
        action=number(1.2, 100.0),
        help="depth of the water in draughts of mmg_tanker (default: the scenario's; deep)",
    )
    serve.add_argument("--truth", metavar="FILE.csv", type=Path, help="write the true motion of the boat")
    serve.set_defaults(run=run_serve)


def _add_fault_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """`sitl fault`: a fault for a boat that is being served, from the command line."""
    fault = commands.add_parser(
        "fault",
        help="a fault for a boat that is being served with --control",
        description="Give a served boat a fault: `sitl fault rudder_stuck for=10`. `list` names "
        "the active faults, `clear [KIND]` ends them; --kinds shows every kind with its size.",
        epilog=EXIT_CODES,
        formatter_class=HelpText,
    )
    fault.add_argument(
        "words",
        metavar="WORD",
        nargs="*",
        help="KIND [size=X] [for=S] [ramp=S] [after=S] [source=first|second], list, clear",
    )
    fault.add_argument(
        "--control", metavar="HOST:PORT", default=DEFAULT_SERVICE, help="where the boat listens (default %(default)s)"
    )
    fault.add_argument("--kinds", action="store_true", help="print the table of faults, and stop")
    add_waiting_option(fault)
    fault.set_defaults(run=_run_fault)


def _run_fault(arguments: argparse.Namespace) -> int:
    """Pass one line to a served boat and print its answer."""
    from autopilot.files.printable import aligned
    from sitl.faults import ask, kinds_table

    if arguments.kinds:
        print(*aligned(kinds_table()), sep="\n")
        return int(ExitCode.OK)
    said = patience_of(arguments)(lambda: ask(arguments.control, " ".join(arguments.words)))
    verdict, _, answer = said.partition(" ")
    if verdict != "ok":
        raise InputError(answer)
    print(answer)
    return int(ExitCode.OK)


def main(argv: Sequence[str] | None = None, program: str = "sitl") -> int:
    """Run `sitl` in the name of `program` and return its exit code."""
    return answer(program, sys.argv[1:] if argv is None else argv, lambda given: build_parser())


def run_serve(arguments: argparse.Namespace) -> int:
    """Serve until stopped."""
    from autopilot.links.mavlink.signing import open_signing
    from sitl.faults import FaultService
    from sitl.serve import Lines, Pace, TruthFile, open_ports, serve, world_from

    should_stop = stop_on_signal()
    world = world_from(arguments)
    truth = TruthFile(arguments.truth, world) if arguments.truth else None
    if truth is not None and truth.path != arguments.truth:
        print(f"{arguments.truth} exists and is kept: the truth goes to {truth.path}", flush=True)
    ports, service = [], None
    try:
        urls = arguments.mavlink or ([] if arguments.nmea or arguments.drive or arguments.n2k else [DEFAULT_MAVLINK])
        signing = open_signing(arguments.signing_key) if arguments.signing_key else None
        lines = Lines(arguments.nmea, arguments.sentences, arguments.drive, arguments.n2k)
        ports = open_ports(world, urls, lines, signing)
        if arguments.control:
            service = FaultService(world, arguments.control)
            print(f"ready control {arguments.control}", flush=True)
        for line, _ in ports:
            print(f"ready {line}", flush=True)
        pace = Pace(arguments.speedup)
        serve(world, [port for _, port in ports], pace, arguments.duration, should_stop, service)
    finally:
        for _, port in ports:
            port.transport.close()
        if service is not None:
            service.close()
        if truth:
            truth.close()
    if pace.lost > 0.0:
        print(f"sitl: this machine was {pace.lost:.1f} s too slow for --speedup {arguments.speedup:g}", file=sys.stderr)
    return int(ExitCode.OK)


def run_physics(arguments: argparse.Namespace) -> int:
    """Move the boat for ArduPilot until stopped."""
    from autopilot.vessel.file import load_vessel
    from sitl.ardupilot import ArdupilotPhysics, Outputs, open_socket, serve_physics
    from sitl.serve import afloat

    should_stop = stop_on_signal()
    outputs = Outputs(arguments.steering_servo, arguments.throttle_servo)
    physics = ArdupilotPhysics(
        load_vessel(arguments.vessel),
        afloat(arguments.vessel, load_scenario(arguments.scenario)),
        arguments.seed,
        outputs,
    )
    with open_socket(arguments.listen) as line:
        print(f"ready physics {line.getsockname()[0]}:{line.getsockname()[1]}", flush=True)
        serve_physics(line, physics, arguments.duration, should_stop)
    print(
        f"{physics.frames} frames, {physics.repeated} repeated, {physics.restarts} restarts, {physics.bad} datagrams "
        "that were none"
    )
    return int(ExitCode.OK)
