"""What `run` and `trial` share: options, building the session, signals, the status line, and how it ends."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from autopilot.angles import compass_deg
from autopilot.cli.ending import Ending, Held, add_log_options, alarm_links, last_line, open_log
from autopilot.cli.option_numbers import SPEEDUP, SYSTEM_ID, WAITING
from autopilot.cli.serving import BackgroundSaver, Serving, open_boat_links
from autopilot.cli.signing import add_signing_option, signing_of
from autopilot.cli.terminal import StatusLine, TypedLines, steady_output
from autopilot.cli.tuning_desk import LearningDesk, TuningDesk
from autopilot.cli.upkeep import Upkeep, add_upkeep_options, real_time_of, resumption_of
from autopilot.cli.waiting import add_waiting_option, patience_of
from autopilot.errors import ExitCode
from autopilot.files.printable import terminal_of
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.alarm_outputs import Acknowledgements
from autopilot.links.base import close_all
from autopilot.links.ground_station.access import AccessPolicy, AccessRules
from autopilot.links.mavlink.signing import Signing
from autopilot.links.url import parse_url
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import LinkOptions, access_rules_of, alarm_outputs_of, build_links, refuse_failsafe
from autopilot.runtime.clock import MonotonicClock
from autopilot.runtime.machine import LoopHealth
from autopilot.runtime.session import Orders, Session
from autopilot.runtime.vessel_store import VesselStore, tuned_file
from autopilot.signals import Mode, Tick
from autopilot.supervision.panel import sentences_of
from autopilot.vessel.schema import Vessel


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
    add_upkeep_options(parser)
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


class Voyage(NamedTuple):
    """What a session is for: who gives the `orders`, `watch`, which is asked after every tick whether all is done, and
    the `duration` [s] at most.

    law: that of the file where None. must_engage: steering is wanted by itself, not by a later order. guide: the chart
    plotter that may be followed. serving: the ground stations that may look and order. desk: learns the boat on the
    way. describe: a tick in words, for the status line. resumes: is told the heading [rad] that a process which died
    has held, where the vessel file lets it be held again. typed: the lines that are typed at the terminal.
    """

    orders: Orders
    watch: Callable[[Tick], bool]
    duration: float
    law: str | None = None
    must_engage: bool = True
    guide: PlotterGuide | None = None
    serving: Serving | None = None
    desk: LearningDesk | None = None
    describe: Callable[[Tick], str] | None = None
    resumes: Callable[[float], None] | None = None
    typed: TypedLines | None = None


@steady_output()
def steer(vessel: Vessel, arguments: argparse.Namespace, voyage: Voyage) -> int:
    """Run a session to its end and return the exit code; a signal ends it with the rudder released.

    The last line printed says what became of rudder, course and log.
    """
    wanted = real_time_of(arguments)
    pilot = build_pilot(vessel, voyage.law, learns=voyage.desk is not None)
    clock = MonotonicClock(arguments.speedup)
    signing = signing_of(arguments)
    policy = AccessPolicy(_access_rules(vessel, arguments))
    ending = Ending(arguments.link, arguments.wait, voyage.must_engage, vessel.failsafe.heading_timeout_s, signing)
    options = LinkOptions(
        arguments.as_gcs, arguments.vehicle_system, voyage.guide, signing, tuple(arguments.forward), policy
    )
    options = options._replace(with_other_pilot=arguments.with_other_pilot)
    options = options._replace(reconnect=arguments.reconnect, opened=patience_of(arguments), heard=ending.heard)
    saver = BackgroundSaver()
    resumption = resumption_of(arguments, vessel, saver) if voyage.resumes is not None else None
    upkeep = Upkeep(wanted, resumption)
    refuse = partial(refuse_failsafe, urls=arguments.link)
    store = VesselStore(vessel, pilot, voyage.law, tuned_file(arguments.vessel), saver, refuse)
    tuner = TuningDesk(store, voyage.desk)
    is_tuned = voyage.desk is not None or (voyage.serving is not None and bool(voyage.serving.urls))
    # closes what is open until the session has taken it over, whatever happens in between
    with contextlib.ExitStack() as opened:
        links = build_links(vessel, arguments.link, options)
        opened.callback(close_all, links)
        if voyage.serving is not None:
            links += open_boat_links(voyage.serving, store, arguments.vessel, saver, signing, policy, tuner)
        if is_tuned:
            print(_which_file(arguments.vessel, store))
        if voyage.desk is not None:
            voyage.desk.attach(pilot, store)
        store.log = recorder = open_log(arguments, vessel, voyage.law, clock.now())
        if recorder is not None:
            opened.callback(recorder.close)
        outputs, _ = alarm_outputs_of(vessel, terminal_of(sys.stderr) if sys.stderr.isatty() else None)
        links += [*alarm_links(recorder), *outputs, LoopHealth(1.0 / vessel.control.rate_hz)]
        if isinstance(voyage.orders, Skipper):
            links.append(Acknowledgements(voyage.orders))
        if voyage.resumes is not None and resumption is not None and (heading := resumption.left()) is not None:
            held_before = f"{compass_deg(heading):.0f} deg"
            print(f"the process before this one ended while it held {held_before}: engaging on it again")
            voyage.resumes(heading)
        _say_north(vessel, arguments.link)
        status, held = StatusLine(voyage.describe, voyage.typed, vessel.sensors.magnetic), Held()

        def after(tick: Tick) -> bool:
            is_over = voyage.watch(tick)  # takes the keys before the first status line, into which they would be echoed
            status.show(tick)
            held(tick)
            tuner.turn()
            if voyage.desk is not None and (news := voyage.desk.news(tick)):
                status.say(news)
            if said := ending.news():
                status.say(said)
            upkeep.ticked(tick)
            return ending(tick) or (is_over and ending.is_wanted())

        session = Session(pilot, links, clock, vessel.control.rate_hz, voyage.orders, recorder)
        try:
            # leaving the session, which comes first, gives the rudder back whatever happened
            with ending.at_signals(), upkeep, session:
                opened.pop_all()
                session.run(clock.now() + voyage.duration, after)
            ending.final(session.tick)
        except Exception as error:
            ending.failed(error)
            raise
        finally:
            status.end()
            tuner.close()
            saver.close()
            _print_refusals(signing, policy)
            print(last_line(ending, held, recorder, session.releases), flush=True)
    last = session.tick
    if last is not None and last.mode in (Mode.FAILSAFE, Mode.FAULT):
        why = f": {'; '.join(sentences_of(last.alarms))}" if last.alarms else ""
        print(f"ended in {'fault' if last.mode is Mode.FAULT else 'fail-safe'}{why}", file=sys.stderr)
        return int(ExitCode.FAILSAFE)
    return int(ExitCode.OK)


def _access_rules(vessel: Vessel, arguments: argparse.Namespace) -> AccessRules:
    rules = access_rules_of(vessel)
    return rules._replace(orders_without_key=rules.orders_without_key or arguments.orders_without_key)


def _print_refusals(signing: Signing | None, policy: AccessPolicy) -> None:
    for summary in (signing.summary if signing is not None else "", policy.summary):
        if summary:
            print(summary)


def _which_file(vessel_path: str, store: VesselStore) -> str:
    """Say which file is in force, and where changes go."""
    kept = store.saved_as
    older = f"; changes of an earlier run are in {kept}: start with that file to use them" if kept.exists() else ""
    return f"in force: {vessel_path}; what is changed while it runs is kept in {kept}{older}"


def _say_north(vessel: Vessel, urls: list[str]) -> None:
    """Say which north courses count from where that is not beyond doubt."""
    if vessel.sensors.magnetic:
        print("headings and courses are magnetic (sensors.magnetic)")
    elif vessel.sensors.variation_deg == 0.0 and any(parse_url(url).protocol in ("nmea", "n2k") for url in urls):
        print("sensors.variation_deg is 0: magnetic headings count as true")
