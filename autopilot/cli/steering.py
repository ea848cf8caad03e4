"""What `run` and `trial` share: options, building the session, signals, the status line, and how it ends."""

from __future__ import annotations

import argparse
import contextlib
import math
import signal
import sys
from collections.abc import Callable, Iterator
from functools import partial
from types import FrameType

from autopilot.angles import compass_deg
from autopilot.build import build_pilot
from autopilot.build_links import LinkOptions, admission_of, alarm_outputs_of, build_links, refuse_failsafe
from autopilot.cli.learning_desk import LearningDesk
from autopilot.cli.log_keeping import add_log_options, alarm_links, gaps_of, open_log
from autopilot.cli.serving import BackgroundSaver, Serving, open_boat_links
from autopilot.cli.signing import add_signing_option, signing_of
from autopilot.cli.skipper import Skipper
from autopilot.cli.tuning_desk import TuningDesk
from autopilot.cli.upkeep import Upkeep, add_upkeep_options, real_time_of, resumption_of
from autopilot.errors import ExitCode, RefusedError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.admission import Admission, Doors
from autopilot.links.alarm_outputs import Acknowledgements
from autopilot.links.base import LinkError
from autopilot.links.signing import Signing, hint_of
from autopilot.loop.clock import MonotonicClock
from autopilot.loop.health import LoopHealth
from autopilot.loop.session import Orders, Session
from autopilot.loop.vessel_in_force import VesselInForce, tuned_file
from autopilot.params.vessel import Vessel
from autopilot.printable import printable, rewrite_line, terminal_of
from autopilot.signals import Mode, OrderKind, Tick

STATUS_PERIOD = 0.5
ALARM_CHARACTERS = 400
ENGAGE_PATIENCE = 20.0
"""Time [s] after the first heading in which an ordered engagement must come about."""


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
    parser.add_argument(
        "--reconnect",
        action="store_true",
        help="open links that are lost, or not there yet, again and again instead of ending",
    )
    parser.add_argument(
        "--as-gcs", action="store_true", help="send steering with the ground station's id, which ArduPilot obeys"
    )
    parser.add_argument(
        "--forward",
        action="append",
        default=[],
        metavar="URL",
        help="let a ground station at this MAVLink link see and command the flight controller through us; repeatable",
    )
    add_signing_option(parser)
    parser.add_argument("--vehicle-system", type=int, metavar="ID", help="MAVLink system id of the vehicle")
    parser.add_argument(
        "--wait", type=float, default=30.0, metavar="S", help="give up when no heading comes for this long (0: never)"
    )
    parser.add_argument(
        "--speedup", type=float, default=1.0, metavar="X", help="for a simulator that runs X times faster"
    )


class Ending:
    """Whether to stop, and the checks that end a run early. Called after every tick."""

    def __init__(
        self, links: list[str], wait: float, must_engage: bool, heading_timeout: float, signing: Signing | None = None
    ) -> None:
        self.stop = False
        self._heading_timeout = heading_timeout
        self._signing = signing
        self._links = ", ".join(links)
        self._wait = wait
        self._must_engage = must_engage
        self._first_heading: float | None = None
        self.engaged = False

    def __call__(self, tick: Tick) -> bool:
        """Return whether to stop now. Raises LinkError or RefusedError where going on makes no sense."""
        if tick.mode is Mode.ENGAGED:
            self.engaged = True
        if self._first_heading is None:
            if tick.state.valid:
                self._first_heading = tick.now
            elif 0.0 < self._wait <= tick.now:
                raise self._silence(self._wait)
        elif self._must_engage and not self.engaged and tick.now - self._first_heading > ENGAGE_PATIENCE:
            raise self._refusal(tick)
        return self.stop

    def final(self, tick: Tick | None) -> None:
        """Raise LinkError or RefusedError where the time ran out with nothing steered, or with the vehicle gone."""
        if self.stop or tick is None:
            return
        if self._first_heading is None:
            raise self._silence(tick.now)
        if self._must_engage and not self.engaged:
            raise self._refusal(tick)
        if tick.mode is Mode.OVERRIDE and tick.state.heading_age > self._heading_timeout:
            raise LinkError(
                f"no heading has come over {self._links} for {tick.state.heading_age:.0f} s, at the end of the run "
                f"({'; '.join(tick.alarms)}): check that the vehicle is on and still connected"
            )

    def _silence(self, seconds: float) -> LinkError:
        return LinkError(
            f"no heading came over {self._links} in {seconds:.0f} s: check that the vehicle or compass is on, that it "
            f"sends to this address, the baud rate, and sensors.variation_deg for a compass that knows no true north"
            f"{hint_of(self._signing)}"
        )

    def _refusal(self, tick: Tick) -> RefusedError:
        return RefusedError("; ".join(tick.alarms) or "the pilot did not engage")


def steer(
    vessel: Vessel,
    arguments: argparse.Namespace,
    orders: Orders,
    watch: Callable[[Tick], bool],
    duration: float,
    law: str | None = None,
    must_engage: bool = True,
    guide: PlotterGuide | None = None,
    serving: Serving | None = None,
    desk: LearningDesk | None = None,
    describe: Callable[[Tick], str] | None = None,
    resumes: Callable[[float], None] | None = None,
) -> int:
    """Run a session to its end and return the exit code; SIGINT and SIGTERM end it with the rudder released.

    `resumes` is told the heading [rad] that a process which died has held, where the vessel file lets it be held again.
    """
    wanted = real_time_of(arguments)
    pilot = build_pilot(vessel, law, learns=desk is not None)
    clock = MonotonicClock(arguments.speedup)
    signing = signing_of(arguments)
    doors = Doors(_admission(vessel, serving))
    ending = Ending(arguments.link, arguments.wait, must_engage, vessel.failsafe.heading_timeout_s, signing)
    options = LinkOptions(arguments.as_gcs, arguments.vehicle_system, guide, signing, tuple(arguments.forward), doors)
    options = options._replace(reconnect=arguments.reconnect)
    links = build_links(vessel, arguments.link, options)
    recorder = None
    saver = BackgroundSaver()
    resumption = resumption_of(arguments, vessel, saver) if resumes is not None else None
    upkeep = Upkeep(wanted, resumption)
    refuse = partial(refuse_failsafe, urls=arguments.link)
    in_force = VesselInForce(vessel, pilot, law, tuned_file(arguments.vessel), saver, refuse)
    tuner = TuningDesk(in_force, desk)
    is_tuned = desk is not None or (serving is not None and bool(serving.urls))
    try:
        if serving is not None:
            links = [*links, *open_boat_links(serving, in_force, arguments.vessel, saver, signing, doors, tuner)]
        if is_tuned:
            print(_which_file(arguments.vessel, in_force))
        if desk is not None:
            desk.attach(pilot, in_force)
        in_force.log = recorder = open_log(arguments, vessel, law, clock.now())
        outputs, _ = alarm_outputs_of(vessel, terminal_of(sys.stderr) if sys.stderr.isatty() else None)
        links = [*links, *alarm_links(recorder), *outputs, LoopHealth(1.0 / vessel.control.rate_hz)]
        if isinstance(orders, Skipper):
            links.append(Acknowledgements(orders))
    except Exception:
        for link in links:
            link.close()
        raise
    if resumes is not None and resumption is not None and (heading := resumption.left()) is not None:
        print(f"the process before this one ended while it held {compass_deg(heading):.0f} deg: engaging on it again")
        resumes(heading)
    status = StatusLine(describe)

    def after(tick: Tick) -> bool:
        status.show(tick)
        tuner.turn()
        if desk is not None and (news := desk.news(tick)):
            status.say(news)
        upkeep.ticked(tick)
        return ending(tick) or watch(tick)

    try:
        # leaving the session, which comes first, gives the rudder back whatever happened
        with (
            _signals_end(ending),
            upkeep,
            Session(pilot, links, clock, vessel.control.rate_hz, orders, recorder) as session,
        ):
            session.run(clock.now() + duration, after)
        ending.final(session.tick)
    finally:
        status.end()
        tuner.close()
        saver.close()
    _print_refusals(signing, doors)
    if gaps := gaps_of(recorder):
        print(gaps)
    last = session.tick
    if last is not None and last.mode in (Mode.FAILSAFE, Mode.FAULT):
        why = f": {'; '.join(last.alarms)}" if last.alarms else ""
        print(f"ended in {'fault' if last.mode is Mode.FAULT else 'fail-safe'}{why}", file=sys.stderr)
        return int(ExitCode.FAILSAFE)
    return int(ExitCode.OK)


def _admission(vessel: Vessel, serving: Serving | None) -> Admission:
    admission = admission_of(vessel)
    is_asked = serving is not None and serving.orders_without_key
    return admission._replace(orders_without_key=admission.orders_without_key or is_asked)


def _print_refusals(signing: Signing | None, doors: Doors) -> None:
    for summary in (signing.summary if signing is not None else "", doors.summary):
        if summary:
            print(summary)


@contextlib.contextmanager
def _signals_end(ending: Ending) -> Iterator[None]:
    """SIGINT and SIGTERM end the run after the tick they come in."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        ending.stop = True

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _which_file(vessel_path: str, in_force: VesselInForce) -> str:
    """Say which file is in force, and where changes go."""
    kept = in_force.saved_as
    older = f"; changes of an earlier run are in {kept}: start with that file to use them" if kept.exists() else ""
    return f"in force: {vessel_path}; what is changed while it runs is kept in {kept}{older}"


class StatusLine:
    """One line that is rewritten on a terminal; elsewhere a line for each change of mode or alarm."""

    def __init__(self, describe: Callable[[Tick], str] | None = None) -> None:
        """describe: what stands before the status, such as how far a trial has come."""
        self._describe = describe
        self._live = sys.stdout.isatty()
        self._next = -math.inf
        self._said: tuple[Mode, tuple[str, ...]] | None = None

    def show(self, tick: Tick) -> None:
        """Show the tick where it is time to."""
        if (tick.mode, tick.alarms) != self._said:
            self._said = (tick.mode, tick.alarms)
            said = "".join(f"  ! {printable(alarm, ALARM_CHARACTERS)}" for alarm in tick.alarms)
            self._print_line(f"{tick.now:8.1f} s  {tick.mode.name}{said}")
        elif self._live and tick.now >= self._next:
            self._next = tick.now + STATUS_PERIOD
            ahead = self._describe(tick) if self._describe is not None else ""
            rewrite_line(sys.stdout, f"{ahead}{'  ' if ahead else ''}{status_text(tick)}")

    def end(self) -> None:
        """Leave the line."""
        if self._live:
            rewrite_line(sys.stdout, "")

    def say(self, text: str) -> None:
        """Print a text above the line."""
        self._print_line(text)

    def _print_line(self, line: str) -> None:
        if self._live:
            rewrite_line(sys.stdout, line, "\n")
        else:
            print(line, flush=True)


def status_text(tick: Tick) -> str:
    """Return the status of a tick in one line, in degrees and knots."""
    state = tick.state
    if not state.valid:
        return f"{tick.mode.name:8s}  no heading yet"
    ordered = f"{compass_deg(tick.reference.heading):5.1f}" if tick.order.kind is OrderKind.HEADING else "  -  "
    return (
        f"{tick.mode.name:8s}  heading {compass_deg(state.heading):5.1f}  reference {ordered}  "
        f"rate {math.degrees(state.rate):+5.1f} deg/s  rudder {math.degrees(state.rudder):+5.1f}  "
        f"order {math.degrees(tick.command.angle):+5.1f}  bias {math.degrees(state.bias):+4.1f}  "
        f"{state.speed * 3600.0 / 1852.0:4.1f} kn"
    )
