"""`autopilot new-boat`: from nothing to the first hold of a boat of your own, step by step."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.options import SPEEDUP, number
from autopilot.errors import ExitCode, InputError, RefusedError

if TYPE_CHECKING:
    from autopilot.cli.commissioning import Boat, Checklist, Step

DESCRIPTION = """\
Begin with a boat of your own: find its links, write its file, then go through
doctor, proof of control, zigzag, identification, gains and the first hold. Leave it whenever you like; the same command
goes on where you left. Each step is an ordinary command, printed before it runs."""
LENGTHS = number(0.2, 500.0)
SPEEDS_KN = number(0.1, 80.0)
STOPS = number(1.0, 90.0)
SIDES = number(0.1, 600.0)


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "new-boat",
        help="begin with a boat of your own: its file, then every step to the first hold",
        description=DESCRIPTION,
    )
    parser.add_argument("file", type=Path, metavar="NAME.yaml", help="the boat's file: written where it is not there")
    parser.add_argument(
        "--link", action="append", default=[], metavar="URL", help="as for `autopilot run` (default: what is found)"
    )
    parser.add_argument("--as-gcs", action="store_true", help="as for `autopilot run`")
    parser.add_argument("--length-m", action=LENGTHS, metavar="L", help="length of the waterline")
    parser.add_argument("--speed-kn", action=SPEEDS_KN, metavar="U", help="the speed that is sailed most")
    parser.add_argument("--rudder-max-deg", action=STOPS, metavar="DEG", help="end stop of the rudder, each side")
    parser.add_argument(
        "--side-to-side-s", action=SIDES, metavar="S", help="seconds from one end stop to the other at full speed"
    )
    parser.add_argument("--list", action="store_true", help="show what is done and what comes next, and end")
    parser.add_argument("--redo", metavar="STEP", help="do this step and those after it again")
    parser.add_argument(
        "--yes", action="store_true", help="ask nothing: every step that the exit code finds good is good"
    )
    parser.add_argument("--speedup", action=SPEEDUP, default=1.0, metavar="X", help="for a simulator")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Go on from where the list was left. Raises InputError, and RefusedError where a step is not good enough."""
    from autopilot.cli.commissioning import Boat, Checklist
    from autopilot.vessel.file import load_vessel, refuse_bare_name

    file: Path = arguments.file
    refuse_bare_name(file)
    talk = Talk(arguments.yes)
    checklist = Checklist(file)
    if arguments.redo is not None:
        checklist.redo(arguments.redo)
        checklist.save()
    if not file.exists():
        if arguments.list:
            raise InputError(f"{file}: not there yet; autopilot new-boat {file} begins it")
        write_boat(arguments, talk)
    if arguments.list:
        print("\n".join(checklist.lines()))
        return int(ExitCode.OK)
    checklist.links = links_of(arguments, checklist, talk)
    checklist.save()
    while (step := checklist.next) is not None:
        print("\n".join(["", *checklist.lines(), ""]))
        take(step, Boat(file, (*checklist.links, *_pace(step, arguments)), load_vessel(file)), talk)
        checklist.tick_off(step, datetime.now())
        checklist.save()
    print("\n".join(["", *checklist.lines(), ""]))
    print(f"Done: {file} steers. Every day: autopilot run {file} {' '.join(checklist.links)}")
    print("From power-on: autopilot install-service. Look at the first hold again: autopilot replay")
    return int(ExitCode.OK)


def _pace(step: Step, arguments: argparse.Namespace) -> tuple[str, ...]:
    steers = step.name in ("rudder", "zigzag", "hold")
    return ("--speedup", f"{arguments.speedup:g}") if steers and arguments.speedup != 1.0 else ()


class Talk:
    """Questions on the terminal; none where `silent`, or where nobody is there to answer."""

    def __init__(self, silent: bool) -> None:
        self.silent = silent or not sys.stdin.isatty()
        self._says_yes = silent

    def number(self, words: str, option: str, check: Callable[[float], None]) -> float:
        """Return a number that is typed; what `check` refuses is asked for again. InputError where nobody answers."""
        from autopilot.files.outside import typed_number

        if self.silent:
            raise InputError(f"{option} is needed where nobody answers: {words}")
        while True:
            try:
                value = typed_number(input(f"{words}: ").strip())
                check(value)
            except InputError as error:
                print(f"  {error}")
            else:
                return value

    def yes(self, words: str) -> bool:
        """Return whether the answer is yes; without anybody to answer it is, where --yes says so. Else InputError."""
        if self._says_yes:
            return True
        if self.silent:
            raise InputError(f"nobody answers {words!r}; run this on a terminal, or with --yes")
        while True:
            answer = input(f"{words} [y/n] ").strip().lower()
            if answer in ("y", "yes", "n", "no"):
                return answer[0] == "y"

    def ready(self, words: str) -> None:
        """Wait until the operator is ready."""
        print(words)
        if not self.silent:
            input("Press Enter to begin, Ctrl-C to leave: ")

    def seconds(self, words: str) -> float:
        """Return the time between two presses of Enter."""
        input(f"{words} Press Enter as it leaves one stop: ")
        begun = time.monotonic()
        input("Press Enter as it reaches the other: ")
        return time.monotonic() - begun


def write_boat(arguments: argparse.Namespace, talk: Talk) -> None:
    """Ask what the boat is like and write its file. Raises InputError."""
    from autopilot.files.saving import save_text
    from autopilot.identification.verdict import KNOT_M_S
    from autopilot.vessel.file import dump_vessel, rounded
    from autopilot.vessel.fleet import first_model
    from autopilot.vessel.schema import SCHEMA_VERSION, Helm, Rudder, Vessel

    file: Path = arguments.file
    print(f"{file} is not there yet. Four numbers begin it; the zigzag will find the rest.")

    def asked(given: float | None, words: str, option: str, allowed: Any) -> float:
        def check(value: float) -> None:
            if not allowed.low <= value <= allowed.high:
                raise InputError(f"allowed is {allowed.low:g} to {allowed.high:g}")

        return given if given is not None else talk.number(words, option, check)

    length = asked(arguments.length_m, "Length of the waterline in metres", "--length-m", LENGTHS)
    speed = asked(arguments.speed_kn, "Speed that you sail most, in knots", "--speed-kn", SPEEDS_KN)
    stop = asked(arguments.rudder_max_deg, "End stop of the rudder in degrees, each side", "--rudder-max-deg", STOPS)
    side = arguments.side_to_side_s
    if side is None and not talk.silent and talk.yes("Can the rudder be moved from stop to stop now, at full speed?"):
        side = round(talk.seconds("Move it from one stop to the other."), 2)
    side = asked(side, "Seconds from one end stop to the other", "--side-to-side-s", SIDES)
    boat = Vessel(
        schema_version=SCHEMA_VERSION,
        name=file.stem,
        length_m=length,
        model=first_model(length, speed * KNOT_M_S),
        rudder=Rudder(stop, rounded(2.0 * stop / side), source="stops and time from side to side, measured"),
        helm=Helm(rudder_at_full_pwm_deg=stop, source="assumed to be the end stop; measure it"),
    )
    save_text(file, dump_vessel(boat), overwrite=False)
    print(f"wrote {file}; its model is {boat.model.source}")


def links_of(arguments: argparse.Namespace, checklist: Checklist, talk: Talk) -> tuple[str, ...]:
    """Return the options that name the links: as given, as kept, or as found. Raises InputError."""
    if arguments.link:
        given = tuple(word for url in arguments.link for word in ("--link", url))
        return (*given, "--as-gcs") if arguments.as_gcs else given
    if checklist.links:
        return checklist.links
    from autopilot.doctor.discovery import candidates, discover

    print("Looking for what sends here:")
    found = discover(candidates(), tell=lambda url: print(f"  {url} ...", flush=True))
    for sender in found:
        print(f"  found {sender.words}")
    useful = [sender for sender in found if sender.has_heading]
    if not useful:
        raise InputError(
            "no heading was found on this machine's lines; switch the instruments on and look at the wiring, or name "
            "the link with --link (a boat on the network is not looked for)"
        )
    chosen = next((each for each in useful if talk.yes(f"Use {each.url}?")), None)
    if chosen is None:
        raise InputError("no link was chosen; name it with --link")
    gcs = chosen.protocol == "MAVLink" and talk.yes(
        "Steer with the ground station's id (--as-gcs), which ArduPilot obeys?"
    )
    return ("--link", chosen.url, *(("--as-gcs",) if gcs else ()))


def take(step: Step, boat: Boat, talk: Talk) -> None:
    """Run a step. Raises RefusedError where it is not good enough."""
    command = step.command(boat)
    print(f"== {step.title}\nautopilot {' '.join(command)}")
    talk.ready(step.before)
    code = subprocess.run([sys.executable, "-m", "autopilot", *command], check=False).returncode
    if code != 0 or (step.question and not talk.yes(step.question)):
        again = f"then: autopilot new-boat {boat.file}"
        raise RefusedError(f"{step.title} is not done. Good enough is: {step.good}. If not: {step.otherwise}; {again}")
