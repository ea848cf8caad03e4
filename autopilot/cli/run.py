"""`autopilot run`: steer a boat in real time."""

from __future__ import annotations

import argparse
import math
import os
import stat
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from autopilot.control.registry import TRIAL_LAW, filed_laws
from autopilot.errors import InputError
from autopilot.files.printable import folded, rewrite_line
from autopilot.signals import Tick

if TYPE_CHECKING:
    from autopilot.links.ground_station.mission import Mission, MissionItem
    from autopilot.runtime.app import App
    from autopilot.runtime.build_links import Stations
    from autopilot.vessel.schema import Vessel


ROUTE_MOST_BYTES = 1 << 20
NOT_READ = (
    "orders are typed at a terminal: what comes by a pipe is not read; over SSH use ssh -t, from programs --serve"
)


def is_pipe(stream: TextIO) -> bool:
    """Return whether a stream is a pipe's; one that is closed, or no file, is none."""
    try:
        return stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode)
    except (OSError, ValueError):
        return False


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import SECONDS, SYSTEM_ID, NumberOption, number
    from autopilot.cli.steering import add_steering_options

    parser.description = (
        "Steer a boat in real time. On a terminal, type: e 90 (engage on 90 deg), +10, -1, r 5, f, s, q."
    )
    add_steering_options(parser)
    parser.add_argument(
        "--serve",
        action="append",
        default=[],
        metavar="URL",
        help="be a MAVLink surface boat for ground stations: udpout:127.0.0.1:14550, tcpin:127.0.0.1:5762; repeatable",
    )
    parser.add_argument(
        "--system", action=SYSTEM_ID, default=1, metavar="ID", help="Norrbin's system id for --serve (default 1)"
    )
    parser.add_argument(
        "--engage",
        metavar="HEADING",
        help="engage on this heading in degrees, on the `present` one, or hold the `wind`'s angle",
    )
    parser.add_argument("--follow", choices=("plotter",), help="follow the chart plotter on the NMEA links")
    parser.add_argument(
        "--steer",
        choices=("rc_override", "manual_control", "guided", "offboard"),
        help="how to steer over MAVLink (default: the file's helm.method); guided: the firmware steers to headings; "
        "offboard: so does PX4, which works the throttle too",
    )
    parser.add_argument(
        "--offboard-speed-m-s",
        metavar="V",
        action=number(0.1, 50.0),
        help="speed that PX4 goes at with --steer offboard (default: the file's helm.offboard_speed_m_s)",
    )
    parser.add_argument(
        "--route",
        type=Path,
        metavar="FILE",
        help="waypoint file (QGC WPL 110), followed when `t` is typed or AUTO is set",
    )
    parser.add_argument(
        "--law",
        choices=filed_laws(),
        help="law to steer with (default: the file's)",
    )
    parser.add_argument(
        "--turn-rate-deg-s",
        action=NumberOption,
        metavar="R",
        help="turn no faster (default: the file's, or what the rudder does)",
    )
    parser.add_argument(
        "--turn-radius-m",
        action=NumberOption,
        metavar="R",
        help="turn no tighter, through the water (default: the file's)",
    )
    parser.add_argument(
        "--learn",
        action="store_true",
        help="learn the boat's model while steering; type learn, adopt, revert on a terminal",
    )
    parser.add_argument("--duration", action=SECONDS, metavar="S", help="stop after this time (default: run on)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Steer until the duration is over, a signal comes or the skipper quits."""
    from autopilot.cli.options import named_vessel
    from autopilot.cli.steering import Voyage, plan_of, steer
    from autopilot.cli.terminal import TypedLines, columns
    from autopilot.guidance.plotter import PlotterGuide
    from autopilot.links.north import MAGNETIC_LEADS
    from autopilot.operators.skipper import (
        FOLLOW_HELP,
        HELP,
        LEARN_HELP,
        MOB_HELP,
        ROUTE_HELP,
        SWING_HELP,
        WIND_HELP,
        Skipper,
    )
    from autopilot.operators.trial_script import PATTERN_HELP, heading_of
    from autopilot.runtime.build import limits_of
    from autopilot.runtime.build_links import refuse_wind_hold

    vessel = named_vessel(arguments.vessel)
    if arguments.steer is not None:
        vessel = replace(vessel, helm=replace(vessel.helm, method=arguments.steer))
    vessel = with_offboard_speed(vessel, arguments.offboard_speed_m_s)
    vessel = turning_as_asked(vessel, arguments.turn_rate_deg_s, arguments.turn_radius_m)
    law = law_of_run(vessel, arguments.law)
    guide = PlotterGuide()
    if arguments.route is not None and vessel.sensors.magnetic:
        raise InputError(f"--route {arguments.route}: {MAGNETIC_LEADS}")
    mission = load_mission(arguments.vessel, arguments.route)
    skipper = Skipper(limits_of(vessel).angle_max, guide, mission)
    if arguments.engage == "wind":
        refuse_wind_hold(arguments.link)
        skipper.await_wind()
    elif arguments.engage is not None:
        try:
            skipper.engage(None if arguments.engage == "present" else heading_of(arguments.engage))
        except InputError:
            needed = "needed are degrees from 0 to 360, `present` or `wind`"
            raise InputError(f"--engage {arguments.engage}: {needed}") from None
    if arguments.follow is not None:
        skipper.follow()
    must_engage = arguments.engage is not None or arguments.follow is not None
    listens = sys.stdin is not None and sys.stdin.isatty()
    typed = TypedLines() if listens else None
    if listens:
        shown = [HELP, FOLLOW_HELP, ROUTE_HELP, WIND_HELP, MOB_HELP]
        shown += [SWING_HELP] * (vessel.drive.kind == "two_thrusters") + [LEARN_HELP] * arguments.learn  # fmt: skip
        skipper.help = f"{'  '.join(shown)}\n{PATTERN_HELP}"
        print(folded(skipper.help, columns(), 0))
    elif sys.stdin is not None and is_pipe(sys.stdin):
        print(NOT_READ, flush=True)

    def watch(app: App, tick: Tick) -> bool:
        for line in typed.poll() if typed is not None else ():
            try:
                answer = app.learning.type_line(line) if app.learning is not None else None
                said = answer if answer is not None else skipper.type_line(line)
            except InputError as error:
                said = str(error)
            rewrite_line(sys.stdout, f"> {line}", "\n")
            print(said, flush=True)
        return skipper.quit

    plan = plan_of(vessel, arguments, skipper)
    plan = plan._replace(
        law=law,
        options=plan.options._replace(guide=guide, helm=skipper),
        skipper=skipper,
        stations=stations_of(arguments),
        armed=must_engage,
        learns=arguments.learn,
        resume=skipper.engage,
    )
    duration = math.inf if arguments.duration is None else arguments.duration
    return steer(arguments, plan, Voyage(watch, duration, must_engage, typed=typed))


def turning_as_asked(vessel: Vessel, rate_deg_s: float | None, radius_m: float | None) -> Vessel:
    """Return the vessel with the preset rate [deg/s] and radius [m] of its turns; None: the file's. InputError."""
    asked = {"turn_rate_max_deg_s": rate_deg_s, "turn_radius_m": radius_m}
    given: dict[str, Any] = {key: value for key, value in asked.items() if value is not None}
    if not given:
        return vessel

    from autopilot.vessel.parameters import parameters_of

    turning = replace(vessel, guidance=replace(vessel.guidance, **given))
    allowed = {parameter.path: parameter for parameter in parameters_of(turning)}
    for key, value in given.items():
        known = allowed[f"guidance.{key}"]
        if not (known.low or 0.0) <= value <= (known.high or math.inf):
            option = "--turn-rate-deg-s" if key == "turn_rate_max_deg_s" else "--turn-radius-m"
            raise InputError(f"{option} {value:g}: allowed is {known.allowed}")
    return turning


def with_offboard_speed(vessel: Vessel, speed: float | None) -> Vessel:
    """Return the vessel with the speed [m/s] to go at in PX4's Offboard mode. InputError where one lacks."""
    from dataclasses import replace

    if speed is not None and vessel.helm.method != "offboard":
        raise InputError(f"--offboard-speed-m-s {speed:g}: only with --steer offboard is the speed ours; leave it out")
    if speed is not None:
        return replace(vessel, helm=replace(vessel.helm, offboard_speed_m_s=speed))
    if vessel.helm.method == "offboard" and vessel.helm.offboard_speed_m_s is None:
        raise InputError(
            "--steer offboard: PX4 works the throttle and must be given a speed; add --offboard-speed-m-s, as 1.5"
        )
    return vessel


def law_of_run(vessel: Vessel, law: str | None) -> str | None:
    """Return the law to steer with: none of ours, and so no gains needed, where the firmware steers. InputError."""
    if not vessel.helm.firmware_steers:
        return law
    if law is not None:
        method = vessel.helm.method
        raise InputError(f"--law {law}: with --steer {method} the firmware's own controller steers; leave --law out")
    return TRIAL_LAW


def stations_of(arguments: argparse.Namespace) -> Stations:
    """Return the ground stations that the options name. Raises InputError."""
    from autopilot.links.url import parse_url
    from autopilot.runtime.build_links import Stations

    for url in arguments.serve:
        if parse_url(url).protocol != "mavlink":
            raise InputError(f"--serve {url}: ground stations speak MAVLink; write it like udpout:127.0.0.1:14550")
    return Stations(tuple(arguments.serve), arguments.system)


def load_mission(vessel_path: str, route: Path | None) -> Mission:
    """Return the route of a file, or as an earlier run has left it; it is followed only when that is ordered.

    Raises InputError where the file named is none; one that was left is said and not used.
    """
    from autopilot.guidance.track import TrackGuide
    from autopilot.links.ground_station.mission import Mission
    from autopilot.runtime.app import mission_file

    kept = mission_file(vessel_path)
    items: tuple[MissionItem, ...] = ()
    if route is not None:
        items = _read(route)
    elif kept.exists():
        try:
            items = _read(kept)
        except InputError as error:
            print(f"the route of an earlier run is not used: {error}", file=sys.stderr)
    if items:
        print(f"route of {len(items)} waypoints from {route or kept}; followed when `t` is typed or mode AUTO is set")
    return Mission(TrackGuide(), items)


def _read(path: Path) -> tuple[MissionItem, ...]:
    from autopilot.files.outside import read_regular
    from autopilot.links.ground_station.mission import parse_items

    try:
        return parse_items(read_regular(path, ROUTE_MOST_BYTES).decode(), str(path))
    except OSError as error:
        raise InputError(f"route {path}: {error.strerror}; give a waypoint file that can be read") from error
    except UnicodeDecodeError:
        raise InputError(f"route {path}: not a text; give a waypoint file") from None
