"""What `run` and `trial` share: options, the plan of the run they make, signals, the status line, and how it ends."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from autopilot.cli.ending import Ending, Held, add_log_options, last_line, log_place
from autopilot.cli.options import (
    SPEEDUP,
    SYSTEM_ID,
    WAITING,
    add_signing_option,
    add_waiting_option,
    patience_of,
    signing_of,
    whole_number,
)
from autopilot.cli.terminal import StatusLine, TypedLines, steady_output
from autopilot.errors import ExitCode
from autopilot.files.printable import terminal_of
from autopilot.links.ground_station.access import AccessPolicy, AccessRules
from autopilot.links.url import parse_url
from autopilot.runtime.app import App, Machine, Plan
from autopilot.runtime.build_links import KINDS, LinkOptions, access_rules_of
from autopilot.runtime.clock import MonotonicClock
from autopilot.runtime.machine import RealTime, cpus_of
from autopilot.runtime.session import Orders
from autopilot.signals import Mode, Tick
from autopilot.supervision.panel import sentences_of
from autopilot.vessel.schema import Vessel

PRIORITY = 40
"""Below the kernel's interrupt threads, which have 50."""
NOTE_NAME = "held-heading.json"


def add_steering_options(parser: argparse.ArgumentParser, needs_link: bool = True) -> None:
    """Add the options of every command that steers. needs_link: whether it always steers."""
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file, or the name of a shipped one (lanxin)")
    parser.add_argument(
        "--link",
        action="append",
        required=needs_link,
        metavar="URL",
        help="udpin:127.0.0.1:14550, tcp:HOST:PORT, serial:/dev/ttyUSB0:115200, nmea:/dev/ttyUSB1:4800; repeatable",
    )
    add_log_options(parser)
    add_waiting_option(parser)
    parser.add_argument(
        "--reconnect",
        action="store_true",
        help="keep reopening links that are lost or not there yet, instead of ending",
    )
    parser.add_argument(
        "--as-gcs", action="store_true", help="send steering with the ground station's id, which ArduPilot obeys"
    )
    parser.add_argument(
        "--with-other-pilot", action="store_true", help="engage although another pilot already steers this boat"
    )
    parser.add_argument(
        "--forward",
        action="append",
        default=[],
        metavar="URL",
        help="let a ground station at this MAVLink link see and command the flight controller; repeatable",
    )
    parser.add_argument(
        "--orders-without-key",
        action="store_true",
        help="take orders over --serve and --forward from other machines and serial lines without a --signing-key",
    )
    add_signing_option(parser)
    parser.add_argument("--vehicle-system", action=SYSTEM_ID, metavar="ID", help="MAVLink system id of the vehicle")
    parser.add_argument(
        "--wait",
        action=WAITING,
        default=30.0,
        metavar="S",
        help="give up if no heading comes for this long (0: never)",
    )
    parser.add_argument(
        "--speedup", action=SPEEDUP, default=1.0, metavar="X", help="for a simulator that runs X times faster"
    )
    parser.add_argument(
        "--realtime",
        metavar="PRIORITY",
        nargs="?",
        action=whole_number(1, 99),
        const=PRIORITY,
        help=f"steer with real-time priority, 1 to 99 (without a number {PRIORITY}), and memory locked",
    )
    parser.add_argument("--cpu", metavar="N", help="keep to this core, or to these: 3 or 2,3")
    parser.add_argument(
        "--state",
        metavar="FILE",
        type=Path,
        help="record the steered heading there, for failsafe.reengage_after_restart_s (default: in $RUNTIME_DIRECTORY)",
    )


class Voyage(NamedTuple):
    """How a plan is carried out: `watch` is asked after every tick whether all is done, `duration` [s] at most.

    must_engage: steering is wanted by itself, not by a later order. describe: a tick in words, for the status line.
    typed: the lines that are typed at the terminal.
    """

    watch: Callable[[App, Tick], bool]
    duration: float
    must_engage: bool = True
    describe: Callable[[Tick], str] | None = None
    typed: TypedLines | None = None


def plan_of(vessel: Vessel, arguments: argparse.Namespace, orders: Orders) -> Plan:
    """Return the plan of what the shared options ask for. Raises InputError."""
    cpus = () if arguments.cpu is None else cpus_of(arguments.cpu)
    options = LinkOptions(
        as_gcs=arguments.as_gcs,
        vehicle_system=arguments.vehicle_system,
        signing=signing_of(arguments),
        forward=tuple(arguments.forward),
        policy=AccessPolicy(_access_rules(vessel, arguments)),
        reconnect=arguments.reconnect,
        with_other_pilot=arguments.with_other_pilot,
        opened=patience_of(arguments),
        arrivals={},
    )
    bell = terminal_of(sys.stderr) if sys.stderr.isatty() else None
    return Plan(
        vessel,
        orders,
        arguments.vessel,
        urls=tuple(arguments.link),
        options=options,
        log=partial(log_place, arguments) if arguments.log or arguments.log_dir else None,
        machine=Machine(RealTime(arguments.realtime, cpus), bell, restart_file(arguments)),
    )


def restart_file(arguments: argparse.Namespace) -> Path | None:
    """Return where the heading that is held is noted: as the option says, or in the folder that the service gives."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    place: Path | None = arguments.state
    return place or (Path(folder) / NOTE_NAME if folder else None)


@steady_output()
def steer(arguments: argparse.Namespace, plan: Plan, voyage: Voyage) -> int:
    """Carry out a plan to its end and return the exit code; a signal ends it with the rudder released.

    The last line printed says what became of rudder, course and log.
    """
    vessel, options = plan.vessel, plan.options
    ending = Ending(plan, arguments.wait, voyage.must_engage)
    clock = MonotonicClock(arguments.speedup)
    app = App(plan, clock)
    session = app.session
    held = Held()
    status: StatusLine | None = None
    try:
        # leaving the app, which comes first, gives the rudder back whatever happened
        with ending.at_signals(), app:
            for notice in [*app.notices, *_about_north(vessel, plan.urls)]:
                print(notice)
            line = status = StatusLine(voyage.describe, voyage.typed, vessel.sensors.magnetic)

            def after(tick: Tick) -> bool:
                is_over = voyage.watch(app, tick)  # takes the keys before the status line, which would echo them
                line.update(tick)
                held(tick)
                for news in (app.learning.news(tick) if app.learning is not None else "", ending.news()):
                    if news:
                        line.print_line(news)
                return ending(tick) or (is_over and ending.is_wanted())

            app.run(voyage.duration, after)
        ending.final(session.tick)
    except Exception as error:
        ending.failed(error)
        raise
    finally:
        if status is not None:
            status.end()
        for refusing in (options.signing, options.policy):
            if refusing is not None and refusing.summary:
                print(refusing.summary)
        print(last_line(ending, held, app.recorder, session.releases), flush=True)
    last = session.tick
    if last is not None and last.mode in (Mode.FAILSAFE, Mode.FAULT):
        why = f": {'; '.join(sentences_of(last.alarms))}" if last.alarms else ""
        print(f"ended in {'fault' if last.mode is Mode.FAULT else 'fail-safe'}{why}", file=sys.stderr)
        return int(ExitCode.FAILSAFE)
    return int(ExitCode.OK)


def _access_rules(vessel: Vessel, arguments: argparse.Namespace) -> AccessRules:
    rules = access_rules_of(vessel)
    return rules._replace(orders_without_key=rules.orders_without_key or arguments.orders_without_key)


def _about_north(vessel: Vessel, urls: tuple[str, ...]) -> list[str]:
    """Return which north courses count from where that is not beyond doubt."""
    if vessel.sensors.magnetic:
        return ["headings and courses are magnetic (sensors.magnetic)"]
    if vessel.sensors.variation_deg == 0.0 and any(KINDS[parse_url(url).protocol].has_compass for url in urls):
        return ["sensors.variation_deg is 0: magnetic headings count as true"]
    return []
