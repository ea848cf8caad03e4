"""What `run` and `trial` share: options, the plan of the run they make, where they keep their log, signals, the status
line, and how they end: when to stop, why, and the one line that says what became of rudder, course and log.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NamedTuple

from autopilot.cli.options import (
    SPEEDUP,
    SYSTEM_ID,
    WAITING,
    add_signing_option,
    add_waiting_option,
    number,
    patience_of,
    signing_of,
    whole_number,
)
from autopilot.cli.terminal import StatusLine, TypedLines, steady_output
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.estimation.path_delay import PathDelay
from autopilot.files.printable import terminal_of
from autopilot.files.saving import check_folder
from autopilot.interruption import NAMES, REAL_TIME, STRAY, ended_by
from autopilot.links.base import LinkError
from autopilot.links.ground_station.access import AccessPolicy
from autopilot.links.mavlink.signing import hint_of
from autopilot.links.rudder_order import release_sentence
from autopilot.links.url import came, parse_url
from autopilot.report.steered import Steered, Verdict
from autopilot.runtime.app import App, Machine, Plan
from autopilot.runtime.build_links import KINDS, LinkOptions, access_rules_of
from autopilot.runtime.machine import MonotonicClock, RealTime, cpus_of
from autopilot.runtime.session import Orders
from autopilot.signals import Mode, Tick
from autopilot.supervision.panel import sentences_of
from autopilot.supervision.supervisor import ORDER_WAITS
from autopilot.vessel.schema import Vessel

if TYPE_CHECKING:
    from autopilot.runtime.log_files import Sink
    from autopilot.runtime.record import Recorder


PART_MB = 64.0
TOTAL_MB = 2000.0
LEAST_PARTS = 4


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add `--log`, `--log-dir` and how much may be in the folder."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--log",
        metavar="FILE.tlog",
        type=Path,
        help="write everything to this log; if it exists, to the next free name: FILE-2.tlog",
    )
    where.add_argument(
        "--log-dir",
        metavar="DIR",
        type=Path,
        help=f"write everything to a log in this folder, in parts of {PART_MB:g} MB; the oldest parts are removed",
    )
    parser.add_argument(
        "--log-total-mb",
        metavar="MB",
        action=number(1.0, 1.0e7),
        help=f"most disk space for all logs of --log-dir (default {TOTAL_MB:g})",
    )


def log_place(arguments: argparse.Namespace) -> Sink:
    """Return where the options want the log, which is written from a thread of its own. Raises InputError."""
    from autopilot.runtime.log_files import MEGABYTE, FileSink, FolderLimits, FolderSink, ThreadedSink, log_file

    total = arguments.log_total_mb or TOTAL_MB
    if arguments.log is not None:
        folder = arguments.log.parent
        if not folder.is_dir():
            raise InputError(
                f"--log {arguments.log}: there is no folder {folder}, perhaps because a disk is not mounted; if it is "
                f"to be a new one, make it first: mkdir -p {shlex.quote(str(folder))}"
            )
        sink: FileSink | FolderSink = log_file(arguments.log)
    else:
        part = min(PART_MB, total / LEAST_PARTS)
        sink = FolderSink(arguments.log_dir, FolderLimits(int(total * MEGABYTE), int(part * MEGABYTE)))
    if arguments.log is not None and sink.path != arguments.log:
        print(f"{arguments.log} exists and is kept: this log is {sink.path}")
    return ThreadedSink(sink)


ENGAGE_PATIENCE = 20.0
"""Time [s] after the first heading in which an ordered engagement must come about; in PX4's Offboard mode, whose proof
is sailed when a human has given it, as long as an order waits."""
BACKGROUND = (signal.SIGTTIN, signal.SIGTTOU)
NOT_STOPPED = "Ctrl-Z is not obeyed: a stopped pilot leaves the rudder where it is; s: standby  q: quit"


class Ending:
    """Whether to stop, and the checks that end a run early. Called after every tick."""

    def __init__(self, plan: Plan, wait: float, must_engage: bool) -> None:
        self.stop = False
        self.why = ""
        self._asked_to_stand_still = False
        self._heading_timeout = plan.vessel.failsafe.heading_timeout_s
        self._arrivals = {} if plan.options.arrivals is None else plan.options.arrivals
        self._signing = plan.options.signing
        self._links = ", ".join(plan.urls)
        self._wait = wait
        self._must_engage = must_engage
        patience = ORDER_WAITS if plan.vessel.helm.method == "offboard" else ENGAGE_PATIENCE
        self._patience = patience if wait > 0.0 else math.inf
        self._first_heading: float | None = None
        self.engaged = False

    def __call__(self, tick: Tick) -> bool:
        """Return whether to stop now. Raises LinkError or RefusedError where going on makes no sense."""
        if tick.mode is Mode.ENGAGED:
            self.engaged = True
        if self._first_heading is None:
            if tick.state.valid:
                self._first_heading = tick.now
                for line in self._arrivals.values():
                    line.forget()
            elif 0.0 < self._wait <= tick.now:
                raise self._silence(self._wait)
        elif self._must_engage and not self.engaged and tick.now - self._first_heading > self._patience:
            raise self._refusal(tick)
        return self.stop

    def is_wanted(self) -> bool:
        """Note that the skipper, or the script, has come to its end; return True."""
        self.why = "ended as ordered"
        return True

    def failed(self, error: Exception) -> None:
        """Note that something ended the run."""
        self.why = "ended, refused" if isinstance(error, RefusedError) else "ended by an error"
        if isinstance(error, LinkError):
            self.why = "ended, the link does not bring what is needed"

    def final(self, tick: Tick | None) -> None:
        """Raise LinkError or RefusedError where the time ran out with nothing steered, or with the vehicle gone."""
        if self.stop or tick is None:
            return
        self.why = self.why or f"ended after {tick.now:.0f} s"
        if tick.mode in (Mode.FAILSAFE, Mode.FAULT):
            self.why = f"ended in {'fault' if tick.mode is Mode.FAULT else 'fail-safe'}"
        if self._first_heading is None:
            raise self._silence(tick.now)
        if self._must_engage and not self.engaged:
            raise self._refusal(tick)
        if tick.mode is Mode.OVERRIDE and tick.state.heading_age > self._heading_timeout:
            raise LinkError(
                f"no heading has come over {self._links} for {tick.state.heading_age:.0f} s, at the end of the run "
                f"({'; '.join(sentences_of(tick.alarms))}): check that the vehicle is on and still connected"
            )

    @contextlib.contextmanager
    def at_signals(self) -> Iterator[None]:
        """Every signal that would end the program ends the run after its tick; those of job control stop nothing."""

        def stop(number: int, _frame: FrameType | None) -> None:
            self.stop = True
            self.why = f"ended by {ended_by(number)}"

        def stay(_number: int, _frame: FrameType | None) -> None:
            self._asked_to_stand_still = True

        stray = (*STRAY, *REAL_TIME)
        wanted = (
            dict.fromkeys((*NAMES, *stray), stop) | {signal.SIGTSTP: stay} | dict.fromkeys(BACKGROUND, signal.SIG_IGN)
        )
        before = {number: signal.getsignal(number) for number in wanted}
        for each in (signal.SIGHUP, *stray):  # nohup: it goes on without its terminal
            if before[each] is signal.SIG_IGN:
                del before[each]
        for each in before:
            signal.signal(each, wanted[each])
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def news(self) -> str:
        """Return what is to be said of a key that was pressed, "" where there is nothing."""
        asked, self._asked_to_stand_still = self._asked_to_stand_still, False
        return NOT_STOPPED if asked else ""

    def _silence(self, seconds: float) -> LinkError:
        return LinkError(
            f"no heading came over {self._links} in {seconds:.0f} s: "
            f"{came(self._arrivals.values()) or 'check that the compass is on and sends here'}{hint_of(self._signing)}"
        )

    def _refusal(self, tick: Tick) -> RefusedError:
        return RefusedError("; ".join(sentences_of(tick.alarms)) or "the pilot did not engage")


def log_words(recorder: Recorder | None) -> str:
    """Return where the log is, and what is missing in it."""
    if recorder is None:
        return "no log was kept"
    try:
        size = recorder.path.stat().st_size
    except OSError:
        return f"log {recorder.path} is not there any more"
    why = recorder.failed or "the disk was full or too slow, or the log was removed"
    gaps = f", {recorder.dropped} ticks missing: {why}"
    return f"log {recorder.path} ({size / 1e6:.1f} MB{gaps if recorder.dropped else ''})"


def path_words(path: PathDelay, filed: float) -> str:
    """Return how late the orders came to the rudder, "" where it was not measured; filed [s]: the delay of the file."""
    if math.isnan(path.delay):
        return ""
    longer = "; the boat was steered by what was measured: a quicker line steers better (docs/links.md)"
    return f"path delay measured {path.delay:.2f} s, filed {filed:.2f} s{longer if path.late else ''}"


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
        help="let a ground station at this MAVLink link see and command the flight controller; repeatable. Behind a "
        "slow radio: 'serial:/dev/ttyUSB0:57600?rate=ATTITUDE:2,others:1'",
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
        help="give up if no heading comes for this long (0: never, nor where --engage is refused)",
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
    typed: the lines that are typed at the terminal. verdict: what the voyage was good for, None where nothing is said.
    """

    watch: Callable[[App, Tick], bool]
    duration: float
    must_engage: bool = True
    describe: Callable[[Tick], str] | None = None
    typed: TypedLines | None = None
    verdict: Callable[[Steered], Verdict | None] = lambda steered: steered.verdict


def plan_of(vessel: Vessel, arguments: argparse.Namespace, orders: Orders) -> Plan:
    """Return the plan of what the shared options ask for. Raises InputError."""
    cpus = () if arguments.cpu is None else cpus_of(arguments.cpu)
    if arguments.log_total_mb is not None and arguments.log_dir is None:
        raise InputError("--log-total-mb goes with --log-dir")
    rules = access_rules_of(vessel)
    rules = rules._replace(orders_without_key=rules.orders_without_key or arguments.orders_without_key)
    options = LinkOptions(
        as_gcs=arguments.as_gcs,
        vehicle_system=arguments.vehicle_system,
        signing=signing_of(arguments),
        forward=tuple(arguments.forward),
        policy=AccessPolicy(rules),
        reconnect=arguments.reconnect,
        with_other_pilot=arguments.with_other_pilot,
        opened=patience_of(arguments),
        arrivals={},
    )
    return Plan(
        vessel,
        orders,
        arguments.vessel,
        urls=tuple(arguments.link),
        options=options,
        log=partial(log_place, arguments) if arguments.log or arguments.log_dir else None,
        machine=Machine(RealTime(arguments.realtime, cpus), restart_file=restart_file(arguments)),
    )


def restart_file(arguments: argparse.Namespace) -> Path | None:
    """Return where the heading that is held is noted: as the option says, or in the folder that the service gives."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    place: Path | None = arguments.state
    if place is not None:
        check_folder(place)
    return place or (Path(folder) / NOTE_NAME if folder else None)


def with_bell(plan: Plan) -> Plan:
    """Return the plan with the bell of the terminal that error output goes to now: inside `steady_output` one that
    keeps nobody waiting."""
    if plan.machine is None or not sys.stderr.isatty():
        return plan
    return plan._replace(machine=plan.machine._replace(bell=terminal_of(sys.stderr)))


@steady_output()
def steer(arguments: argparse.Namespace, plan: Plan, voyage: Voyage) -> int:
    """Carry out a plan to its end and return the exit code; a signal ends it with the rudder released.

    The last lines printed say how well it was steered, and what became of rudder, course and log.
    """
    plan = with_bell(plan)
    vessel, options = plan.vessel, plan.options
    ending = Ending(plan, arguments.wait, voyage.must_engage)
    clock = MonotonicClock(arguments.speedup)
    app = App(plan, clock)
    session = app.session
    steered = Steered(vessel.drive.kind)
    status: StatusLine | None = None
    try:
        # leaving the app, which comes first, gives the rudder back whatever happened
        with ending.at_signals(), app:
            for notice in [*app.notices, *_about_north(vessel, plan.urls)]:
                print(notice)
            describe = voyage.describe or (lambda tick: _left(voyage.duration - tick.now))
            line = status = StatusLine(describe, voyage.typed, vessel.sensors.magnetic)

            def after(tick: Tick) -> bool:
                is_over = voyage.watch(app, tick)  # takes the keys before the status line, which would echo them
                line.update(tick)
                steered(tick)
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
        if verdict := voyage.verdict(steered):
            print(verdict.sentence)
        if words := path_words(app.pilot.state.estimate.path, vessel.control.loop_delay_s):
            print(words)
        rudder, log = release_sentence(session.releases), log_words(app.recorder)
        print(f"{ending.why or 'ended'}: {rudder}; {steered.words}; {log}", flush=True)
    last = session.tick
    if last is not None and last.mode in (Mode.FAILSAFE, Mode.FAULT):
        why = f": {'; '.join(sentences_of(last.alarms))}" if last.alarms else ""
        print(f"ended in {'fault' if last.mode is Mode.FAULT else 'fail-safe'}{why}", file=sys.stderr)
        return int(ExitCode.FAILSAFE)
    return int(ExitCode.OK)


def _left(seconds: float) -> str:
    return f"{seconds:.0f} s left" if 0.0 <= seconds < math.inf else ""


def _about_north(vessel: Vessel, urls: tuple[str, ...]) -> list[str]:
    """Return which north courses count from where that is not beyond doubt."""
    if vessel.sensors.magnetic:
        return ["headings and courses are magnetic (sensors.magnetic)"]
    has_compass = any(KINDS[parse_url(url).protocol].has_compass for url in urls)
    if vessel.sensors.earth_field and vessel.sensors.variation_deg is None and has_compass:
        return ["until an instrument gives the magnetic variation, the World Magnetic Model does (sensors.earth_field)"]
    if vessel.sensors.variation_deg == 0.0 and has_compass:
        return ["sensors.variation_deg is 0: magnetic headings count as true"]
    return []
