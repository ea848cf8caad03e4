"""What keeps a steering process well, beside the steering: service manager, real time, garbage, resumption."""

from __future__ import annotations

import argparse
import faulthandler
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from autopilot.cli.option_numbers import whole_number
from autopilot.cli.resumption import Resumption
from autopilot.errors import InputError, RefusedError
from autopilot.links.base import LinkError
from autopilot.loop.real_time import RealTime, SlackCollector, cpus_of, make_real_time
from autopilot.loop.service_manager import ServiceManager
from autopilot.params.vessel import Vessel
from autopilot.signals import Tick

PRIORITY = 40
"""Below the kernel's interrupt threads, which have 50."""
NOTE_NAME = "held-heading.json"
FAULT = "autopilot: the program failed; the rudder was given back. Keep the log and report what follows"


def add_upkeep_options(parser: argparse.ArgumentParser) -> None:
    """Add `--realtime`, `--cpu` and `--state`."""
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
        help="note there what is steered, for failsafe.reengage_after_restart_s (default: in $RUNTIME_DIRECTORY)",
    )


def real_time_of(arguments: argparse.Namespace) -> RealTime:
    """Return what the options ask for. Raises InputError."""
    return RealTime(arguments.realtime, () if arguments.cpu is None else cpus_of(arguments.cpu))


def resumption_of(
    arguments: argparse.Namespace, vessel: Vessel, save: Callable[[Path, str], None]
) -> Resumption | None:
    """Return who keeps note of what is steered; None where the vessel file or the place for it is missing."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    place = arguments.state or (Path(folder) / NOTE_NAME if folder else None)
    within = vessel.failsafe.reengage_after_restart_s
    return Resumption(place, within, save) if place is not None and within > 0.0 else None


class Upkeep:
    """Round the running session: enter it when all threads run, call it after every tick.

    An end that was meant, or that a link or a refusal brought, is no end to resume from; a fault of ours is one.
    """

    def __init__(self, wanted: RealTime, resumption: Resumption | None) -> None:
        self._wanted = wanted
        self._resumption = resumption
        self._manager = ServiceManager()
        self._collect: SlackCollector | None = None

    def __enter__(self) -> Upkeep:
        # a watchdog ends the process with SIGABRT: then it says where it stood
        if sys.stderr is not None and not faulthandler.is_enabled():
            faulthandler.enable()
        self._collect = SlackCollector()
        for sentence in make_real_time(self._wanted):
            print(sentence, file=sys.stderr)
        return self

    def ticked(self, tick: Tick) -> None:
        """Do what falls due in the slack behind a tick."""
        self._manager.ticked(tick)
        if self._resumption is not None:
            self._resumption.ticked(tick)
        if self._collect is not None:
            self._collect()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._collect is not None:
            self._collect.close()
        self._manager.close()
        was_meant = error is None or isinstance(error, LinkError | InputError | RefusedError)
        if was_meant and self._resumption is not None:
            self._resumption.close()
        if not was_meant:
            print(FAULT, file=sys.stderr)
