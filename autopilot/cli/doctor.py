"""`autopilot doctor`: check whether this machine and these links are fit to steer Go or no-go, with reason and cure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import aligned, json_text

if TYPE_CHECKING:
    from autopilot.doctor.machine import Finding
    from autopilot.vessel.schema import Vessel

RATE_HZ = 20.0
WORDS = ("go", "warn", "NO GO")
DESCRIPTION = """\
Measure this machine: how late it wakes, memory, disk, clock, supply, versions, serial lines. With --link also how often
and how evenly headings come, whether the vehicle would accept orders, and which of its parameters stand in the
way; nothing is steered. Exit code 0: go, perhaps with warnings; 4: no go, as where the helm is refused."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import SPEEDUP, add_waiting_option, number

    parser.description = DESCRIPTION
    parser.add_argument("vessel", metavar="VESSEL.yaml", nargs="?", help="vessel file, or the name of a shipped one")
    parser.add_argument("--link", action="append", default=[], metavar="URL", help="as for `autopilot run`; repeatable")
    parser.add_argument("--as-gcs", action="store_true", help="as for `autopilot run`")
    add_waiting_option(parser)
    parser.add_argument(
        "--seconds", action=number(1.0, 3600.0), default=10.0, metavar="S", help="listen to the links for this long"
    )
    parser.add_argument(
        "--log-dir", type=Path, default=Path(), metavar="DIR", help="the disk to look at (default: here)"
    )
    parser.add_argument(
        "--log", metavar="FILE.tlog", help="a log of `autopilot run` or `trial`: how late orders came to the rudder"
    )
    parser.add_argument(
        "--speedup", action=SPEEDUP, default=1.0, metavar="X", help="for a simulator that runs X times faster"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Look, print, and return the exit code."""
    from autopilot.doctor.machine import Verdict, worst

    if arguments.link and arguments.vessel is None:
        raise InputError("doctor: with --link give the vessel file too; it says what the instruments are like")
    findings = _findings(arguments)
    verdict = worst(findings)
    if arguments.json:
        table = [{**found._asdict(), "verdict": WORDS[found.verdict].lower()} for found in findings]
        print(json_text({"verdict": WORDS[verdict].lower(), "findings": table}))
    else:
        print(summary(findings), end="\n\n")
        _show(findings)
    return int(ExitCode.REFUSED if verdict is Verdict.NO_GO else ExitCode.OK)


def _findings(arguments: argparse.Namespace) -> list[Finding]:
    from autopilot.cli.options import named_vessel
    from autopilot.doctor import machine

    vessel = None if arguments.vessel is None else named_vessel(arguments.vessel)
    rate = RATE_HZ if vessel is None else vessel.control.rate_hz
    looked = [
        machine.versions(),
        machine.wake_up(rate),
        machine.cyclictest(),
        machine.real_time(),
        machine.memory(),
        machine.disk(arguments.log_dir),
        machine.clock_kept(),
        machine.supply(),
        machine.temperature(),
        machine.hardware_watchdog(),
        machine.serial_lines(),
    ]
    if arguments.log:
        looked.append(_path(arguments.log))
    if vessel is not None and arguments.link:
        looked += _links(arguments, vessel)
    return [finding for finding in looked if finding is not None]


def _path(log: str) -> Finding:
    """Return how late orders came to the rudder in a log. Raises InputError."""
    from autopilot.doctor.machine import Finding, Verdict
    from autopilot.estimation.tuning import PATH_LATER
    from autopilot.logs.own_log import path_of

    measured, filed = path_of(log)
    if measured != measured:
        found = "not measured: it takes ten movements or more, while engaged, of a rudder with an echo or a sensor"
        return Finding("path delay", Verdict.GO, found)
    verdict = Verdict.WARN if measured - filed > PATH_LATER else Verdict.GO
    found = f"orders came {measured:.2f} s after their headings, control.loop_delay_s is {filed:.2f}"
    cure = "a quicker line, or less on this one; the boat is steered by what is measured (docs/links.md)"
    return Finding("path delay", verdict, found, cure, {"measured_s": measured, "filed_s": filed})


def _links(arguments: argparse.Namespace, vessel: Vessel) -> list[Finding]:
    from functools import partial

    from autopilot.cli.options import patience_of
    from autopilot.doctor.vehicle import examine
    from autopilot.links.url import RecordingTransport, came
    from autopilot.runtime.build_links import LinkOptions, open_links
    from autopilot.runtime.machine import MonotonicClock

    arrivals: dict[str, RecordingTransport] = {}
    options = LinkOptions(as_gcs=arguments.as_gcs, arrivals=arrivals, opened=patience_of(arguments))
    opened = partial(open_links, vessel, arguments.link, options)
    clock, timeout = MonotonicClock(arguments.speedup), vessel.failsafe.heading_timeout_s
    return examine(opened, clock, arguments.seconds, timeout, vessel, lambda: came(arrivals.values()))


def summary(findings: list[Finding]) -> str:
    """Return the verdict and what stands behind it, in one sentence."""
    from autopilot.doctor.machine import Verdict, worst

    against = {verdict: [each.name for each in findings if each.verdict is verdict] for verdict in Verdict}
    if worst(findings) is Verdict.NO_GO:
        return f"NO GO: {', '.join(against[Verdict.NO_GO])}. What to do stands behind the arrows."
    warned = against[Verdict.WARN]
    count = f"{len(warned)} warning{'s' if len(warned) != 1 else ''}"
    return f"GO, {count}: {', '.join(warned)}." if warned else "GO: this machine and these links are fit to steer."


def _show(findings: list[Finding]) -> None:
    rows: list[tuple[str, str, str]] = []
    for finding in findings:
        rows.append((f"{WORDS[finding.verdict]:5}", finding.name, finding.found))
        rows += [("", "", f"-> {finding.cure}")] * bool(finding.verdict and finding.cure)
    print(*aligned(rows, has_head=False), sep="\n")
